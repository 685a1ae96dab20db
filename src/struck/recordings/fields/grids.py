"""Linear interpolation over grids, one axis after the other: how 2007 reads its table."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_SAME = 1e-9  # share of an axis within which two values are the same


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Axis:
    """One coordinate of a grid.

    Parameters
    ----------
    nodes : array (n,)
        Ascending.
    period : float
        After which the coordinate begins anew; 0 for none.
    """

    nodes: Array
    period: float = 0.0

    @classmethod
    def through(cls, values: Array, period: float = 0.0) -> Axis:
        """Make the axis of all different values."""
        nodes = np.sort(values % period if period else values)
        least = _SAME * max(period, float(np.ptp(nodes)), float(np.abs(nodes).max()))
        kept = np.concatenate([[True], np.diff(nodes) > least])
        if period and nodes[-1] > nodes[0] + period - least:
            kept &= nodes < nodes[0] + period - least
        return cls(nodes=nodes[kept], period=period)

    def weights(self, values: Array) -> Array:
        """Return what each node counts for at values (K,): (K, n).

        Beyond the ends of an axis without a period: its last node. Close to a node: exactly that.
        """
        nodes, count = self.nodes, len(self.nodes)
        if self.period:
            values = nodes[0] + (values - nodes[0]) % self.period
            nodes = np.append(nodes, nodes[0] + self.period)
        below = np.clip(np.searchsorted(nodes, values, side="right") - 1, 0, max(len(nodes) - 2, 0))
        above = np.minimum(below + 1, len(nodes) - 1)
        gaps = nodes[above] - nodes[below]
        shares = np.clip((values - nodes[below]) / np.where(gaps > 0, gaps, 1.0), 0.0, 1.0)
        shares = np.where(shares < _SAME, 0.0, np.where(shares > 1 - _SAME, 1.0, shares))
        weights = np.zeros((len(values), count))
        rows = np.arange(len(values))
        np.add.at(weights, (rows, below), 1 - shares)
        np.add.at(weights, (rows, above % count), shares)
        return weights


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Grid:
    """Places at all combinations of the nodes of some axes.

    Parameters
    ----------
    axes : tuple of Axis
    sources : array (nodes,)
        Number of the place that each combination stands for, the last axis fastest.
    count : int
        How many places there are.
    """

    axes: tuple[Axis, ...]
    sources: Index
    count: int

    def weights(self, points: Array) -> Array:
        """Return what each place counts for at points (K, axes): (K, count)."""
        products = np.ones((len(points), 1))
        for axis, values in zip(self.axes, points.T, strict=True):
            share = axis.weights(values)
            products = (products[:, :, None] * share[:, None]).reshape(len(points), -1)
        gathered = np.zeros((self.count, len(points)))
        np.add.at(gathered, self.sources, products.T)
        return gathered.T


def combinations(axes: tuple[Axis, ...]) -> Array:
    """Return the coordinates of all combinations of nodes, the last axis fastest (nodes, axes)."""
    every = np.meshgrid(*(axis.nodes for axis in axes), indexing="ij")
    return np.stack([each.ravel() for each in every], axis=1)

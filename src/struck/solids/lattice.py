"""A body-centred cubic lattice over a body, and its tetrahedra (Labelle & Shewchuk 2007)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_BLOCK = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lattice:
    """Corners and centres of a grid of cells.

    Parameters
    ----------
    origin, cell : array (3,)
        Lowest corner and edges of a cell, m.
    counts : array (3,)
        Cells along each axis.
    """

    origin: Array
    cell: Array
    counts: Index

    @classmethod
    def over(cls, bounds: Array, spacing: float) -> Lattice:
        """Lay cells of about `spacing` over a box, its faces on lattice planes, one cell beyond.

        So boxes keep their edges, and symmetric bodies get a symmetric lattice.
        """
        extent = bounds[1] - bounds[0]
        inner = np.maximum(np.round(extent / spacing), 1).astype(np.int64)
        cell = extent / inner
        return cls(origin=bounds[0] - cell, cell=cell, counts=inner + 2)

    def positions(self, numbers: Index) -> Array:
        """Return positions of lattice points, numbered corners first, then centres (K, 3)."""
        corners = int(np.prod(self.counts + 1))
        centre = numbers >= corners
        triples = np.empty((len(numbers), 3))
        triples[~centre] = _triples(numbers[~centre], self.counts + 1)
        triples[centre] = _triples(numbers[centre] - corners, self.counts) + 0.5
        return self.origin + triples * self.cell

    def sampled(self, depth: Callable[[Array], Array]) -> tuple[Array, Array]:
        """Evaluate a 1-Lipschitz function at corners and centres.

        Far from its zero only the sign is needed, so one value serves a whole block there.
        """
        half = self.cell * _BLOCK / 2
        blocks = -(-(self.counts + 1) // _BLOCK)
        middles = self.origin + half * (2 * _triples(np.arange(np.prod(blocks)), blocks) + 1)
        coarse = depth(middles).reshape(blocks)
        near = np.abs(coarse) <= np.linalg.norm(half) * (1 + 1e-9)
        numbers = np.arange(np.prod(self.counts + 1) + np.prod(self.counts))
        values = np.concatenate(
            [_spread(coarse, self.counts + 1).ravel(), _spread(coarse, self.counts).ravel()]
        )
        close = np.concatenate(
            [_spread(near, self.counts + 1).ravel(), _spread(near, self.counts).ravel()]
        )
        values[close] = depth(self.positions(numbers[close]))
        corners = int(np.prod(self.counts + 1))
        return values[:corners].reshape(self.counts + 1), values[corners:].reshape(self.counts)

    def tetrahedra(self, corners: Array, centres: Array) -> Index:
        """Return the tetrahedra with a vertex inside (negative): (T, 4) point numbers.

        Each joins two neighbouring centres to an edge of the face between their cells.
        """
        first = int(np.prod(self.counts + 1))
        number = np.arange(first).reshape(self.counts + 1)
        middle = first + np.arange(np.prod(self.counts)).reshape(self.counts)
        parts = []
        for axis in range(3):
            ring = [_face(number, axis, u, v) for u, v in _AROUND]
            ends = [_one_less(middle, axis, 0), _one_less(middle, axis, 1)]
            inside = [_face(corners, axis, u, v) < 0 for u, v in _AROUND]
            inside += [_one_less(centres, axis, 0) < 0, _one_less(centres, axis, 1) < 0]
            chosen = np.any(inside, axis=0)
            low, high, *rim = (grid[chosen] for grid in (*ends, *ring))
            parts += [np.stack([low, high, rim[q], rim[q - 3]], axis=1) for q in range(4)]
        return np.vstack(parts)


_AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))


def _triples(numbers: Index, counts: Index) -> Array:
    return np.stack(np.unravel_index(numbers, counts), axis=1).astype(np.float64)


def _spread(coarse: NDArray, counts: Index) -> NDArray:
    """Repeat a value of each block over the points that lie in it."""
    index = [np.arange(count) // _BLOCK for count in counts]
    return coarse[np.ix_(*index)]


def _one_less(grid: NDArray, axis: int, start: int) -> NDArray:
    """Drop the last (start 0) or first (start 1) layer along an axis."""
    return np.take(grid, range(start, grid.shape[axis] - 1 + start), axis=axis)


def _face(grid: NDArray, axis: int, u: int, v: int) -> NDArray:
    """Return one corner of the faces between neighbouring cells along an axis."""
    inner = np.take(grid, range(1, grid.shape[axis] - 1), axis=axis)
    return _one_less(_one_less(inner, (axis + 1) % 3, u), (axis + 2) % 3, v)

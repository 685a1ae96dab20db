"""A body-centred cubic lattice over a body, and its tetrahedra (Labelle & Shewchuk 2007)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.model.arrays import Array, Index

_BLOCK = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lattice:
    """Corners and centres of a grid of cells."""

    origin: Array  # lowest corner, m
    cell: Array  # edges of a cell, m
    counts: Index  # cells along each axis

    @classmethod
    def over(cls, bounds: Array, spacing: float) -> Lattice:
        """Lay cells of about `spacing` over a box, one beyond it, its faces on lattice planes."""
        # So boxes keep their edges, and symmetric bodies get a symmetric lattice.
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

    def sampled(self, depths: Callable[[Array], Array]) -> tuple[Array, Array]:
        """Evaluate n 1-Lipschitz functions at corners (I, J, K, n) and centres."""
        # Far from all zeros only the signs are needed, so one value serves a whole block there.
        half = self.cell * _BLOCK / 2
        blocks = -(-(self.counts + 1) // _BLOCK)
        middles = self.origin + half * (2 * _triples(np.arange(np.prod(blocks)), blocks) + 1)
        coarse = _columns(depths, middles)
        # Both ends of an edge that leaves the block must have values of their own.
        reach = np.linalg.norm(half) + max(self.cell.max(), np.linalg.norm(self.cell) / 2)
        near = (np.abs(coarse) <= reach).any(axis=1).reshape(blocks)
        coarse = coarse.reshape(*blocks, -1)
        shapes = (self.counts + 1, self.counts)
        values = np.concatenate([_spread(coarse, s).reshape(-1, coarse.shape[-1]) for s in shapes])
        close = np.flatnonzero(np.concatenate([_spread(near, s).ravel() for s in shapes]))
        values[close] = _columns(depths, self.positions(close))
        corners, centres = np.split(values, [int(np.prod(shapes[0]))])
        return corners.reshape(*shapes[0], -1), centres.reshape(*shapes[1], -1)

    def tetrahedra(self, corners: Array, centres: Array) -> Index:
        """Return the tetrahedra, as point numbers (T, 4), that may reach into the body."""
        # Each joins two neighbouring centres to an edge of the face between their cells. Functions
        # at `corners` (I, J, K, n) and `centres` are negative at one of its corners or more.
        first = int(np.prod(self.counts + 1))
        number = np.arange(first).reshape(self.counts + 1)
        middle = first + np.arange(np.prod(self.counts)).reshape(self.counts)
        parts = []
        for axis in range(3):
            ring = [_face(number, axis, u, v) for u, v in _AROUND]
            ends = [_one_less(middle, axis, 0), _one_less(middle, axis, 1)]
            inside = [_face(corners, axis, u, v) < 0 for u, v in _AROUND]
            inside += [_one_less(centres, axis, 0) < 0, _one_less(centres, axis, 1) < 0]
            chosen = np.any(inside, axis=0).all(axis=-1)
            low, high, *rim = (grid[chosen] for grid in (*ends, *ring))
            parts += [np.stack([low, high, rim[q], rim[q - 3]], axis=1) for q in range(4)]
        return np.vstack(parts)


_AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))


def _columns(depths: Callable[[Array], Array], points: Array) -> Array:
    return np.asarray(depths(points), np.float64).reshape(len(points), -1)


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

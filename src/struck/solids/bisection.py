"""Tetrahedra halved where they are too coarse, neighbours with them so that all still fit.

Each is halved at its longest edge, ties broken alike everywhere, which keeps the shapes good and
ends after few steps (Rivara 1991).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from struck.solids.cutting import PAIRS, Cells

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
Depths = Callable[[Array], Array]
# Of the depth halfway along an edge against the mean of its ends, in lengths of the edge.
_LARGEST_MISS = 0.2
# Only surfaces nearer than this matter to an edge, in lengths of the edge.
_NEAR = 0.5


def refined(cells: Cells, depths: Depths, *, shortest: float, most: int) -> Cells:
    """Halve tetrahedra where the surfaces bend or come near each other within one edge.

    Parameters
    ----------
    cells : Cells
    depths : callable
        Depths (K, n) of points (K, 3).
    shortest : float
        No edge shorter than twice this is halved for its own sake, m.
    most : int
        Edges that may be halved for their own sake; the worst come first.
    """
    middles = _Middles(depths, cells.depths.shape[1])
    while most > 0:
        edges = np.unique(_keys(cells.tetrahedra))
        miss = _misses(cells, edges, middles, shortest)
        wanted = np.flatnonzero(miss > _LARGEST_MISS)
        if not len(wanted):
            break
        worst = wanted[np.argsort(-miss[wanted], kind="stable")[:most]]
        most -= len(worst)
        cells = _halved(cells, edges[worst], middles)
    return cells


def _keys(tetrahedra: Index) -> Index:
    """Return one number for each edge of each tetrahedron (T, 6)."""
    first, second = tetrahedra[:, np.array(PAIRS)].transpose(2, 0, 1)
    return (np.minimum(first, second) << 32) | np.maximum(first, second)


def _ends(keys: Index) -> Index:
    """Return the ends (E, 2) of edges."""
    return np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=-1)


class _Middles:
    """Depths halfway along edges, each asked for once."""

    def __init__(self, depths: Depths, surfaces: int) -> None:
        self._depths = depths
        self._keys = np.empty(0, np.int64)
        self._known = np.empty((0, surfaces))

    def of(self, points: Array, edges: Index) -> Array:
        """Return the depths halfway along edges (E, n)."""
        fresh = np.setdiff1d(edges, self._keys)
        if len(fresh):
            found = np.asarray(self._depths(points[_ends(fresh)].mean(axis=1)), np.float64)
            keys = np.concatenate([self._keys, fresh])
            order = np.argsort(keys)
            known = np.vstack([self._known, found.reshape(len(fresh), -1)])
            self._keys, self._known = keys[order], known[order]
        return self._known[np.searchsorted(self._keys, edges)]


def _misses(cells: Cells, edges: Index, middles: _Middles, shortest: float) -> Array:
    """Return how far depths halfway are from the mean of both ends, in edge lengths (E,)."""
    ends = _ends(edges)
    length = np.linalg.norm(np.diff(cells.points[ends], axis=1)[:, 0], axis=1)
    nearest = np.abs(cells.depths[ends]).min(axis=1)
    close = (nearest < length[:, None]).any(axis=1) & (length > 2 * shortest)
    middle = middles.of(cells.points, edges[close])
    off = np.abs(middle - cells.depths[ends[close]].mean(axis=1)) / length[close, None]
    near = np.abs(middle) < _NEAR * length[close, None]
    misses = np.zeros(len(edges))
    misses[close] = np.where(near, off, 0.0).max(axis=1)
    return misses


def _halved(cells: Cells, marked: Index, middles: _Middles) -> Cells:
    """Halve the marked edges, and what else must be for all tetrahedra to fit together."""
    cut = np.empty(0, np.int64)
    while True:
        marked, hit, longest = _closed(cells, marked)
        if not hit.any():
            return cells
        edges = np.setdiff1d(longest, cut)
        cells = replace(
            cells,
            points=np.vstack([cells.points, cells.points[_ends(edges)].mean(axis=1)]),
            depths=np.vstack([cells.depths, middles.of(cells.points, edges)]),
        )
        cut = np.concatenate([cut, edges])  # in the order of the new points
        order = np.argsort(cut)
        middle = len(cells.points) - len(cut) + order[np.searchsorted(cut, longest, sorter=order)]
        cells = _split(cells, hit, _ends(longest), middle)


def _closed(cells: Cells, marked: Index) -> tuple[Index, Flags, Index]:
    """Mark the longest edge of every tetrahedron with a marked edge, until no more are.

    Return the marked edges, which tetrahedra have any, and the longest edge of each of those.
    """
    keys = _keys(cells.tetrahedra)
    while True:
        hit = np.isin(keys, marked).any(axis=1)
        longest = _longest(cells, keys, hit)
        more = np.setdiff1d(longest, marked)
        if not len(more):
            return marked, hit, longest
        marked = np.concatenate([marked, more])


def _longest(cells: Cells, keys: Index, hit: Flags) -> Index:
    """Return the longest edge of the hit tetrahedra, of equally long ones the last."""
    first, second = cells.tetrahedra[hit][:, np.array(PAIRS)].transpose(2, 0, 1)
    length = np.linalg.norm(cells.points[first] - cells.points[second], axis=2)
    longest = length >= length.max(axis=1, keepdims=True, initial=0.0) * (1 - 1e-9)
    return np.where(longest, keys[hit], -1).max(axis=1, initial=-1)


def _split(cells: Cells, hit: Flags, ends: Index, middle: Index) -> Cells:
    """Replace each hit tetrahedron by two that meet in the middle of one of its edges."""
    old = cells.tetrahedra[hit]
    halves = [np.where(old == ends[:, end : end + 1], middle[:, None], old) for end in (0, 1)]
    return replace(cells, tetrahedra=np.vstack([cells.tetrahedra[~hit], *halves]))

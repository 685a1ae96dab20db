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
    fresh = cells.tetrahedra
    while most > 0:
        edges = np.unique(_keys(fresh))
        miss = _misses(cells, edges, middles, shortest)
        wanted = np.flatnonzero(miss > _LARGEST_MISS)
        if not len(wanted):
            break
        worst = wanted[np.argsort(-miss[wanted], kind="stable")[:most]]
        most -= len(worst)
        cells, whole = _halved(cells, edges[worst], middles)
        fresh = cells.tetrahedra[whole:]
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
    """Return how far depths halfway are from the mean of both ends, in edge lengths (E,).

    Edges are 0 that need no halving: the short ones, and those whose ends are too far from each
    surface, or too unlike in depth, for a 1-Lipschitz function to miss by much.
    """
    ends = _ends(edges)
    length = np.linalg.norm(cells.points[ends[:, 0]] - cells.points[ends[:, 1]], axis=1)[:, None]
    first, second = cells.depths[ends[:, 0]], cells.depths[ends[:, 1]]
    within = np.maximum(np.abs(first), np.abs(second)) < (_NEAR + 0.5) * length
    alike = np.abs(first - second) < (1 - 2 * _LARGEST_MISS) * length
    worth = (within & alike).any(axis=1) & (length[:, 0] > 2 * shortest)
    middle = middles.of(cells.points, edges[worth])
    length = length[worth]
    off = np.abs(middle - (first[worth] + second[worth]) / 2) / length
    misses = np.zeros(len(edges))
    misses[worth] = np.where(np.abs(middle) < _NEAR * length, off, 0.0).max(axis=1)
    return misses


def _halved(cells: Cells, marked: Index, middles: _Middles) -> tuple[Cells, int]:
    """Halve the marked edges, and what else must be for all tetrahedra to fit together.

    Return the tetrahedra, those left whole first, and how many these are.
    """
    cut, whole = np.empty(0, np.int64), len(cells.tetrahedra)
    while True:
        marked, hit, longest = _closed(cells, marked)
        if not len(hit):
            return cells, whole
        whole -= int(np.count_nonzero(hit < whole))
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


def _closed(cells: Cells, marked: Index) -> tuple[Index, Index, Index]:
    """Mark the longest edge of every tetrahedron with a marked edge, until no more are.

    Return the marked edges, the tetrahedra that have any, and the longest edge of each of those.
    """
    longest = np.full(len(cells.tetrahedra), -1)
    fresh = marked = np.unique(marked)
    while len(fresh):
        reached = _having(cells, fresh)
        reached = reached[longest[reached] < 0]
        longest[reached] = _longest(cells, reached)
        fresh = np.setdiff1d(longest[reached], marked)
        marked = np.union1d(marked, fresh)
    hit = np.flatnonzero(longest >= 0)
    return marked, hit, longest[hit]


def _having(cells: Cells, edges: Index) -> Index:
    """Return the tetrahedra that have any of some edges, sorted ones."""
    touched = np.zeros(len(cells.points), bool)
    touched[_ends(edges)] = True
    likely = np.flatnonzero(np.count_nonzero(touched[cells.tetrahedra], axis=1) > 1)
    keys = _keys(cells.tetrahedra[likely])
    place = np.minimum(np.searchsorted(edges, keys), len(edges) - 1)
    return likely[(edges[place] == keys).any(axis=1)]


def _longest(cells: Cells, chosen: Index) -> Index:
    """Return the longest edge of the chosen tetrahedra, of equally long ones the last."""
    tetrahedra = cells.tetrahedra[chosen]
    first, second = cells.points[tetrahedra[:, np.array(PAIRS)]].transpose(2, 0, 1, 3)
    length = np.linalg.norm(first - second, axis=2)
    longest = length >= length.max(axis=1, keepdims=True, initial=0.0) * (1 - 1e-9)
    return np.where(longest, _keys(tetrahedra), -1).max(axis=1, initial=-1)


def _split(cells: Cells, hit: Index, ends: Index, middle: Index) -> Cells:
    """Replace each hit tetrahedron by two that meet in the middle of one of its edges."""
    old = cells.tetrahedra[hit]
    halves = [np.where(old == ends[:, end : end + 1], middle[:, None], old) for end in (0, 1)]
    return replace(cells, tetrahedra=np.vstack([np.delete(cells.tetrahedra, hit, 0), *halves]))

"""A surface between inside and outside, from a lattice (marching tetrahedra, Doi & Koide 1991).

Lattice points too near the surface move onto it first, so no triangle becomes a needle (Labelle &
Shewchuk 2007). Only tetrahedra on the surface are made: those within cost nothing.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from struck.model.mesh import Mesh
from struck.solids.filling.lattice import Lattice
from struck.solids.volume_mesh import side_keys

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
Distances = Callable[[Array], Array]
# Shares of an edge within which the surface pulls a lattice point over; long edges join two
# corners or two centres, short ones a corner and a centre (Labelle & Shewchuk, table 1).
_LONG, _SHORT = 0.24999, 0.41189
# Of the depths of points that do not move, in cells.
_LEAST = 0.1
_SIDES = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def isosurface(
    lattice: Lattice, inside: Flags, distances: Distances, *, moved: bool = True
) -> Mesh | None:
    """Return the surface around the lattice points inside, normals outward; None without any.

    Parameters
    ----------
    lattice : Lattice
    inside : array (N,)
        Which of its points are: corners first, then centres.
    distances : callable
        Distances of points (K, 3) from the surface, m (K,): asked for beside it alone.
    moved : bool
        Whether lattice points may move onto the surface. Where it grazes them, parts of it can
        meet in an edge then; otherwise each edge belongs to two triangles, some of them needles.
    """
    depths = np.where(inside, -1.0, 1.0)
    near = np.unique(_astride(lattice, depths))
    if not len(near):
        return None
    least = 0.0 if moved else _LEAST * float(lattice.cell.min())
    depths[near] *= np.maximum(distances(lattice.positions(near)), least)
    points = _warped(lattice, depths) if moved else _Points.still(lattice, depths)
    return points.triangles(_astride(lattice, points.depths))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Points:
    """Lattice points, some of them `moved` (M,) to `places` (M, 3), and all `depths` (N,)."""

    lattice: Lattice
    depths: Array
    moved: Index
    places: Array

    @classmethod
    def still(cls, lattice: Lattice, depths: Array) -> Self:
        """Leave all points where they are."""
        return cls(
            lattice=lattice, depths=depths, moved=np.empty(0, np.int64), places=np.empty((0, 3))
        )

    def at(self, numbers: Index) -> Array:
        """Return the positions of points (K, 3)."""
        positions = self.lattice.positions(numbers)
        known, found = _found(self.moved, numbers)
        positions[known] = self.places[found[known]]
        return positions

    def between(self, pairs: Index) -> Array:
        """Return where the surface crosses edges (E, 2), m (E, 3); a point is its own edge."""
        first, second = self.depths[pairs].T
        rise = second - first
        share = np.divide(-first, rise, out=np.zeros_like(first), where=rise != 0)[:, None]
        return self.at(pairs[:, 0]) * (1 - share) + self.at(pairs[:, 1]) * share

    def triangles(self, tetrahedra: Index) -> Mesh | None:
        """Return the surface within `tetrahedra` (T, 4)."""
        signs = np.sign(self.depths[tetrahedra])
        order = np.argsort(signs, axis=1, kind="stable")
        ordered = np.take_along_axis(tetrahedra, order, axis=1)
        counts = np.stack([(signs < 0).sum(axis=1), (signs > 0).sum(axis=1)], axis=1)
        corners, within = [np.empty((0, 3, 2), np.int64)], [np.empty(0, np.int64)]
        for wanted, tiles in _TILES.items():
            chosen = ordered[(counts == wanted).all(axis=1)]
            for tile in tiles:
                corners.append(chosen[:, np.array(tile)])
                within.append(chosen[:, 0])
        return self._oriented(np.concatenate(corners), np.concatenate(within))

    def _oriented(self, corners: Index, within: Index) -> Mesh | None:
        """Join triangles, given by the edges (F, 3, 2) that they cut, away from points within."""
        stride = len(self.depths)
        keys = corners.min(axis=2) * stride + corners.max(axis=2)
        used, local = np.unique(keys, return_inverse=True)
        faces = local.reshape(-1, 3)
        # Triangles between two tetrahedra within come from both.
        _, first, times = np.unique(
            side_keys(faces, len(used)), return_index=True, return_counts=True
        )
        faces, within = faces[first[times == 1]], within[first[times == 1]]
        if not len(faces):
            return None
        points = self.between(np.stack(np.divmod(used, stride), axis=1))
        a, b, c = points[faces].transpose(1, 0, 2)
        inward = np.einsum("fd,fd->f", np.cross(b - a, c - a), a - self.at(within)) < 0
        return Mesh(points=points, faces=np.where(inward[:, None], faces[:, ::-1], faces))


def _astride(lattice: Lattice, depths: Array) -> Index:
    """Return the tetrahedra with points within and others on the surface or outside (T, 4)."""
    both = np.stack([depths, np.where(depths < 0, 1.0, -1.0)], axis=1)
    first = int(np.prod(lattice.counts + 1))
    corners, centres = both[:first], both[first:]
    return lattice.tetrahedra(
        corners.reshape(*(lattice.counts + 1), 2), centres.reshape(*lattice.counts, 2)
    )


def _warped(lattice: Lattice, depths: Array) -> _Points:
    """Move points that the surface passes too near onto the nearest place where it does."""
    still = _Points.still(lattice, depths)
    edges = _crossed(_astride(lattice, depths), depths)
    first, second = depths[edges].T
    share = first / (first - second)
    centre = edges >= np.prod(lattice.counts + 1)
    reach = np.where(centre[:, 0] == centre[:, 1], _LONG, _SHORT)
    nearness = np.concatenate([share, 1 - share]) / np.tile(reach, 2)
    ends = edges.T.ravel()
    order = np.lexsort((nearness, ends))
    order = order[nearness[order] < 1]
    moved, nearest = np.unique(ends[order], return_index=True)
    depths = depths.copy()
    places = still.between(edges[order[nearest] % len(edges)]) if len(moved) else np.empty((0, 3))
    depths[moved] = 0.0
    return _Points(lattice=lattice, depths=depths, moved=moved, places=places)


def _crossed(tetrahedra: Index, depths: Array) -> Index:
    """Return the edges with one end within and one outside, each once (E, 2)."""
    keys = [
        np.minimum(a, b) * len(depths) + np.maximum(a, b)
        for a, b in (tetrahedra[:, side].T for side in _SIDES)
        for a, b in [_unlike(a, b, depths)]
    ]
    return np.stack(np.divmod(np.unique(np.concatenate(keys)), len(depths)), axis=1)


def _unlike(first: Index, second: Index, depths: Array) -> tuple[Index, Index]:
    unlike = np.sign(depths[first]) * np.sign(depths[second]) < 0
    return first[unlike], second[unlike]


def _found(known: Index, wanted: Index) -> tuple[Flags, Index]:
    """Tell which of the `wanted` are among sorted `known` ones, and where."""
    place = np.minimum(np.searchsorted(known, wanted), max(len(known) - 1, 0))
    return (known[place] == wanted if len(known) else np.zeros(len(wanted), bool)), place


# By counts of corners within and outside, corners ordered from within to outside: triangles, each
# corner on the edge between two of them, or on one that lies on the surface.
_TILES = {
    (1, 0): [((1, 1), (2, 2), (3, 3))],
    (1, 1): [((1, 1), (2, 2), (0, 3))],
    (1, 2): [((1, 1), (0, 2), (0, 3))],
    (1, 3): [((0, 1), (0, 2), (0, 3))],
    (2, 1): [((2, 2), (0, 3), (1, 3))],
    (2, 2): [((0, 2), (0, 3), (1, 3)), ((0, 2), (1, 3), (1, 2))],
    (3, 1): [((0, 3), (1, 3), (2, 3))],
}

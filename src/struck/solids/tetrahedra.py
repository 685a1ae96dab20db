"""Isosurface stuffing: tetrahedra of good shape in any body (Labelle & Shewchuk 2007).

Lattice points too near the boundary move onto it; tetrahedra that the boundary still cuts are
replaced by their part inside. Quadrilaterals are halved from their lowest-numbered corner, so
neighbours agree.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError
from struck.solids.lattice import Lattice
from struck.solids.volume import VolumeMesh, unique_rows

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# Shares of an edge within which the boundary pulls a lattice point over; long edges join two
# corners or two centres, short ones a corner and a centre (their table 1, safe for all shapes).
_LONG, _SHORT = 0.24999, 0.41189
_PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))


def stuffed(
    depth: Callable[[Array], Array], bounds: Array, spacing: float, up: str = "z"
) -> VolumeMesh:
    """Fill a body with linear tetrahedra.

    Parameters
    ----------
    depth : callable
        1-Lipschitz function of points (K, 3), negative in the body, m (K,).
    bounds : array (2, 3)
        Corners of a box around the body, m.
    spacing : float
        Of the lattice, m.
    up : str
        The axis that points up.

    Raises
    ------
    MeshError
        When no lattice point lies in the body.
    """
    lattice = Lattice.over(bounds, spacing)
    corners, centres = lattice.sampled(depth)
    tetrahedra = lattice.tetrahedra(corners, centres)
    if not len(tetrahedra):
        raise MeshError(
            f"no point of a lattice of {spacing:.3g} m lies in the body: use a finer one"
        )
    numbers, local = np.unique(tetrahedra, return_inverse=True)
    values = np.concatenate([corners.ravel(), centres.ravel()])[numbers]
    points, values = _warped(
        lattice.positions(numbers), values, local.reshape(-1, 4), numbers >= corners.size
    )
    points, elements = _cut(points, values, local.reshape(-1, 4))
    return VolumeMesh(nodes=points, elements=elements, kind="tet4", up=up)


def _edges(tetrahedra: Index) -> Index:
    pairs = np.sort(tetrahedra[:, np.array(_PAIRS)].reshape(-1, 2), axis=1)
    return unique_rows(pairs)[0]


def _crossings(points: Array, depth: Array, edges: Index) -> tuple[Index, Array, Array]:
    """Return the edges that cross the boundary, the share from their first end, and where."""
    crossed = edges[depth[edges[:, 0]] * depth[edges[:, 1]] < 0]
    first, second = depth[crossed].T
    share = first / (first - second)
    where = points[crossed[:, 0]] * (1 - share)[:, None] + points[crossed[:, 1]] * share[:, None]
    return crossed, share, where


def _warped(
    points: Array, depth: Array, tetrahedra: Index, is_centre: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Move points that the boundary passes too near onto the nearest crossing."""
    edges, share, where = _crossings(points, depth, _edges(tetrahedra))
    reach = np.where(is_centre[edges[:, 0]] == is_centre[edges[:, 1]], _LONG, _SHORT)
    ends = np.concatenate([edges[:, 0], edges[:, 1]])
    nearness = np.concatenate([share, 1 - share]) / np.tile(reach, 2)
    order = np.lexsort((nearness, ends))
    order = order[nearness[order] < 1]
    moved, first = np.unique(ends[order], return_index=True)
    points, depth = points.copy(), depth.copy()
    points[moved] = np.tile(where, (2, 1))[order[first]]
    depth[moved] = 0.0
    return points, depth


def _cut(points: Array, depth: Array, tetrahedra: Index) -> tuple[Array, Index]:
    """Keep the inner part of every tetrahedron; return used points and tetrahedra."""
    crossed, _, where = _crossings(points, depth, _edges(tetrahedra))
    keys = crossed[:, 0] * len(points) + crossed[:, 1]

    def crossing(a: Index, b: Index) -> Index:
        return len(points) + np.searchsorted(
            keys, np.minimum(a, b) * len(points) + np.maximum(a, b)
        )

    signs = np.sign(depth)[tetrahedra]
    order = np.argsort(signs, axis=1, kind="stable")
    ordered = np.take_along_axis(tetrahedra, order, axis=1)
    inside, outside = (signs < 0).sum(axis=1), (signs > 0).sum(axis=1)
    parts = [ordered[(outside == 0) & (inside > 0)]]
    for (few, many), stencil in _STENCILS.items():
        a, b, c, d = ordered[(inside == few) & (outside == many)].T
        parts += stencil(a, b, c, d, crossing)
    every = np.vstack([points, where])
    return _oriented(every, np.vstack(parts))


def _oriented(points: Array, tetrahedra: Index) -> tuple[Array, Index]:
    """Give all tetrahedra positive volume, drop empty ones and unused points."""
    corners = points[tetrahedra]
    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1])
    turned = np.where((volumes < 0)[:, None], tetrahedra[:, [0, 2, 1, 3]], tetrahedra)
    solid = turned[np.abs(volumes) > 1e-9 * np.abs(volumes).max()]
    used, local = np.unique(solid, return_inverse=True)
    return points[used], local.reshape(-1, 4)


def _prism(bottom: Index, top: Index) -> list[Index]:
    """Split prisms between triangles (m, 3) into three tetrahedra each.

    The lowest corner comes first; its two faces are halved from it, the face opposite from its
    own lowest corner.
    """
    lowest = np.hstack([bottom, top]).argmin(axis=1)
    flipped = (lowest >= 3)[:, None]
    low, high = np.where(flipped, top, bottom), np.where(flipped, bottom, top)
    turn = (lowest[:, None] % 3 + np.arange(3)) % 3
    low, high = np.take_along_axis(low, turn, axis=1), np.take_along_axis(high, turn, axis=1)
    (a, b, c), (x, y, z) = low.T, high.T
    from_b = (np.minimum(b, z) < np.minimum(c, y))[:, None]
    first = np.where(from_b, np.stack([a, b, c, z], 1), np.stack([a, b, c, y], 1))
    second = np.where(from_b, np.stack([a, b, z, y], 1), np.stack([a, y, c, z], 1))
    return [first, second, np.stack([a, x, y, z], axis=1)]


def _pyramid(apex: Index, quad: tuple[Index, Index, Index, Index]) -> list[Index]:
    """Split pyramids over quadrilaterals a, b, c, d into two tetrahedra each."""
    a, b, c, d = quad
    from_a = (np.minimum(a, c) < np.minimum(b, d))[:, None]
    first = np.where(from_a, np.stack([apex, a, b, c], 1), np.stack([apex, b, c, d], 1))
    second = np.where(from_a, np.stack([apex, a, c, d], 1), np.stack([apex, a, b, d], 1))
    return [first, second]


# By counts of corners inside and outside, corners ordered from inside to outside.
_STENCILS = {
    (1, 3): lambda a, b, c, d, x: [np.stack([a, x(a, b), x(a, c), x(a, d)], axis=1)],
    (1, 2): lambda a, b, c, d, x: [np.stack([a, b, x(a, c), x(a, d)], axis=1)],
    (1, 1): lambda a, b, c, d, x: [np.stack([a, b, c, x(a, d)], axis=1)],
    (2, 1): lambda a, b, c, d, x: _pyramid(c, (a, b, x(b, d), x(a, d))),
    (2, 2): lambda a, b, c, d, x: _prism(
        np.stack([a, x(a, c), x(a, d)], axis=1), np.stack([b, x(b, c), x(b, d)], axis=1)
    ),
    (3, 1): lambda a, b, c, d, x: _prism(
        np.stack([a, b, c], axis=1), np.stack([x(a, d), x(b, d), x(c, d)], axis=1)
    ),
}

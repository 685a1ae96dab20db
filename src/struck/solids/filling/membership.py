"""Which of the cells that surfaces cut are in a body, where surfaces meet at its concave creases.

Beyond one of two such surfaces the body may go on, behind the other. Cells on the same sides of all
surfaces are in the body together or not at all (set membership: Tilove 1980, IEEE Trans. Comput.
C-29, 874). Where a surface has cut what it does not bound, the cuts can be undone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from struck.model.arrays import Array, Index, Mask
from struck.model.mesh_topology import components
from struck.solids.lattice import Cells, Depths, determinants, shape_of
from struck.solids.volume_mesh import VolumeMesh

_JUDGED = 16  # cells of each region, the largest ones: they mostly agree
_DOUBTFUL = 0.05  # weight of a cell that is elsewhere if its surfaces are flat
_STEP = 1e-3  # of the spacing, for slopes of depths
_SLOPES = (0.5, 1.5)  # of a depth that changes as a distance does
_FARTHEST = 0.25  # spacings by which a depth may be off; more, and it is that of another place
_PARALLEL = 0.05  # share of the steepest slope below which surfaces count as parallel


Heights = Callable[[Array], tuple[Array, Array]]
"""Of points (K, 3): heights above n surfaces carried on past their borders, and distances, m."""


def kept(cells: Cells, heights: Heights, distance: Depths, spacing: float) -> Cells:
    """Return the cells in the body, their depths 0 only where a surface bounds it."""
    # Cells that hang together on the same sides of all surfaces are judged as one, by the signed
    # `distance` to the body.
    mesh = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4")
    signs = np.sign(np.sign(cells.depths)[cells.tetrahedra].sum(axis=1))
    pairs = mesh.neighbours()
    alike = (signs[pairs[:, 0]] == signs[pairs[:, 1]]).all(axis=1)
    regions = components(pairs[alike], len(signs))
    corners = cells.points[cells.tetrahedra]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    chosen = _largest(regions, volumes)
    plain = corners[chosen].mean(axis=1)
    bent = _places(cells, chosen, heights, spacing)
    straight, curved = (np.where(distance(where) <= 0, 1.0, -1.0) for where in (plain, bent))
    votes = np.where(straight == curved, straight, _DOUBTFUL * curved) * volumes[chosen]
    inside = np.bincount(regions[chosen], weights=votes, minlength=regions.max() + 1) > 0
    result = replace(cells, tetrahedra=cells.tetrahedra[inside[regions]])
    return replace(result, depths=_bounding(result, heights)) if inside.any() else result


def _largest(regions: Index, volumes: Array) -> Index:
    """Return the numbers of the largest cells of each region."""
    order = np.lexsort((-volumes, regions))
    first = np.searchsorted(regions[order], regions[order])
    return order[np.arange(len(order)) - first < _JUDGED]


def _places(cells: Cells, chosen: Index, heights: Heights, spacing: float) -> Array:
    """Return where cells lie by the depths of their corners, as surfaces are curved (K, 3)."""
    corners = cells.tetrahedra[chosen]
    middles, wanted = cells.points[corners].mean(axis=1), cells.depths[corners].mean(axis=1)
    step = _STEP * spacing
    found, lengths = heights(middles)
    slopes = np.stack(
        [(heights(middles + way)[0] - found) / step for way in step * np.eye(3)], axis=2
    )
    steep = np.linalg.norm(slopes, axis=2)
    counts = (cells.depths[corners] == 0).any(axis=1) & (lengths < spacing)
    counts &= np.abs(wanted - found) < _FARTHEST * spacing
    counts &= (steep > _SLOPES[0]) & (steep < _SLOPES[1])
    slopes = np.where(counts[:, :, None], slopes, 0.0)
    off = np.where(counts, wanted - found, 0.0)
    return middles + np.einsum("kdn,kn->kd", np.linalg.pinv(slopes, rcond=_PARALLEL), off)


def _bounding(cells: Cells, heights: Heights) -> Array:
    """Return depths that are 0 only at corners of sides that bound the cells on that surface."""
    mesh = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4")
    sides = mesh.boundary_sides()[0]
    flat = (cells.depths[sides] == 0).all(axis=1)
    # One surface may go on where another lies: the nearer of them is what bounds the body.
    several = np.flatnonzero(flat.sum(axis=1) > 1)
    if len(several):
        away = heights(cells.points[sides[several]].mean(axis=1))[1]
        nearest = np.where(flat[several], away, np.inf).argmin(axis=1)
        flat[several] = np.arange(flat.shape[1]) == nearest[:, None]
    on = np.zeros(cells.depths.shape, bool)
    for corner in sides.T:
        np.logical_or.at(on, corner, flat)
    return np.where((cells.depths == 0) & ~on, _NEEDLESS, cells.depths)


_NEEDLESS = -np.finfo(float).tiny  # depth of a point below a surface that only made it
_FLAT, _FAIR = 1e-3, 0.1  # shapes: no flatter ones are made, and none worse below the other
_SAME = 1e-6  # share of their volume that tetrahedra around a point may lose with it
_ROUNDS = 20  # more of them take hardly any more points out


def mended(cells: Cells) -> Cells:
    """Return the cells without the points of cuts by surfaces that do not bound the body there."""
    # Such a point moves onto a neighbour on all surfaces that it lies on, with the edges between
    # them; the tetrahedra around it must fill the same space afterwards.
    needless = (cells.depths == _NEEDLESS).any(axis=1)
    turn = np.random.default_rng(0).permutation(len(needless))
    for _ in range(_ROUNDS):
        moved, onto = _moves(cells, needless)
        if not len(moved):
            break
        rank = np.full(len(needless), -1)
        rank[moved] = turn[moved]
        ranks = rank[cells.tetrahedra]  # of neighbours only one may move at a time
        waits = np.zeros(len(needless), bool)
        waits[cells.tetrahedra[ranks < ranks.max(axis=1, keepdims=True)]] = True
        goal = np.arange(len(needless))
        goal[moved] = np.where(waits[moved], moved, onto)
        tetrahedra = goal[cells.tetrahedra]
        flat = (np.diff(np.sort(tetrahedra, axis=1), axis=1) == 0).any(axis=1)
        near = np.zeros(len(needless), bool)
        near[cells.tetrahedra[(tetrahedra != cells.tetrahedra).any(axis=1)]] = True
        needless &= (goal == np.arange(len(goal))) & (near | waits)
        cells = replace(cells, tetrahedra=tetrahedra[~flat])
    return cells.compact()


def _moves(cells: Cells, needless: Mask) -> tuple[Index, Index]:
    """Return points that can be taken out (K,), and the neighbours that they move onto (K,)."""
    count, tetrahedra = len(cells.points), cells.tetrahedra
    around, place = np.nonzero(needless[tetrahedra])
    points = tetrahedra[around, place]
    order = np.argsort(points, kind="stable")
    points, around = points[order], around[order]
    pairs = np.unique((points * count)[:, None] + tetrahedra[around])
    point, goal = pairs // count, pairs % count
    on = cells.depths == 0
    able = (point != goal) & (~on[point] | on[goal]).all(axis=1)
    point, goal = point[able], goal[able]
    first, last = (np.searchsorted(points, point, side=side) for side in ("left", "right"))
    pair = np.repeat(np.arange(len(point)), last - first)
    old = around[np.arange(len(pair)) - np.repeat(np.cumsum(last - first) - last, last - first)]
    stays = (tetrahedra[old] != goal[pair][:, None]).all(axis=1)
    kept, last = pair[stays], old[stays]
    new = np.where(tetrahedra[last] == point[kept][:, None], goal[kept][:, None], tetrahedra[last])
    whole = np.bincount(pair, weights=_six(cells.points[tetrahedra])[old], minlength=len(point))
    filled = np.bincount(kept, weights=_six(cells.points[new]), minlength=len(point))
    same = np.abs(filled - whole) < _SAME * whole
    worst, becomes = np.full((2, len(point)), np.inf)
    np.minimum.at(worst, pair, shape_of(cells.points[tetrahedra])[old])
    np.minimum.at(becomes, kept[same[kept]], shape_of(cells.points[new[same[kept]]]))
    fits = same & (becomes >= np.clip(worst, _FLAT, _FAIR))
    best = np.lexsort((-becomes, point))
    best = best[fits[best]]
    moved, once = np.unique(point[best], return_index=True)
    return moved, goal[best][once]


def _six(corners: Array) -> Array:
    """Return six times the volumes of tetrahedra (T, 4, 3), m^3."""
    return determinants((corners[:, 1:] - corners[:, :1]).transpose(1, 2, 0))

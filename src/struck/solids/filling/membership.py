"""Which of the cells that surfaces cut are in a body, where surfaces meet at its concave creases.

Beyond one of two such surfaces the body may continue, behind the other. Cells on the same sides of
all surfaces are in the body together or not at all (set membership: Tilove 1980, IEEE Trans.
Comput. C-29, 874). Where a surface has cut what it does not bound, the cuts can be undone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from struck.model.arrays import Array, Index, Mask
from struck.model.mesh_topology import components
from struck.solids.lattice import Cells, Depths, determinants, shape_of
from struck.solids.volume_mesh import VolumeMesh

_JUDGED_CELLS = 16  # cells of each region, the largest ones: they mostly agree
_DOUBT_WEIGHT = 0.05  # weight of a cell that is elsewhere if its surfaces are flat
_STEP = 1e-3  # of the spacing, for slopes of depths
_SLOPE_RANGE = (0.5, 1.5)  # of a depth that changes as a distance does
_MAX_DEVIATION = 0.25  # spacings by which a depth may be off; more, and it is that of another place
_PARALLEL_TOLERANCE = 0.05  # fraction of the steepest slope below which surfaces count as parallel


Heights = Callable[[Array], tuple[Array, Array]]
"""From points (K, 3) to heights above n surfaces extended past their borders, and distances, m."""


def select_cells(cells: Cells, heights: Heights, distance: Depths, spacing: float) -> Cells:
    """Return the cells in the body, their depths 0 only where a surface bounds it."""
    # Cells that hang together on the same sides of all surfaces are judged as one, by the signed
    # `distance` to the body.
    mesh = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4")
    signs = np.sign(np.sign(cells.depths)[cells.tetrahedra].sum(axis=1))
    pairs = mesh.neighbours()
    is_same_side = (signs[pairs[:, 0]] == signs[pairs[:, 1]]).all(axis=1)
    regions = components(pairs[is_same_side], len(signs))
    corners = cells.points[cells.tetrahedra]
    volumes = np.abs(np.linalg.det(corners[:, 1:] - corners[:, :1]))
    chosen = _find_largest(regions, volumes)
    centroids = corners[chosen].mean(axis=1)
    curved_places = _curved_places(cells, chosen, heights, spacing)
    straight_signs, curved_signs = (
        np.where(distance(points) <= 0, 1.0, -1.0) for points in (centroids, curved_places)
    )
    votes = (
        np.where(straight_signs == curved_signs, straight_signs, _DOUBT_WEIGHT * curved_signs)
        * volumes[chosen]
    )
    is_inside = np.bincount(regions[chosen], weights=votes, minlength=regions.max() + 1) > 0
    result = replace(cells, tetrahedra=cells.tetrahedra[is_inside[regions]])
    return replace(result, depths=_bounding(result, heights)) if is_inside.any() else result


def _find_largest(regions: Index, volumes: Array) -> Index:
    """Return the numbers of the largest cells of each region."""
    order = np.lexsort((-volumes, regions))
    first = np.searchsorted(regions[order], regions[order])
    return order[np.arange(len(order)) - first < _JUDGED_CELLS]


def _curved_places(cells: Cells, chosen: Index, heights: Heights, spacing: float) -> Array:
    """Return where cells lie by the depths of their corners, as surfaces are curved (K, 3)."""
    corners = cells.tetrahedra[chosen]
    centroids, mean_depths = cells.points[corners].mean(axis=1), cells.depths[corners].mean(axis=1)
    step = _STEP * spacing
    centre_heights, lengths = heights(centroids)
    slopes = np.stack(
        [(heights(centroids + offset)[0] - centre_heights) / step for offset in step * np.eye(3)],
        axis=2,
    )
    steepness = np.linalg.norm(slopes, axis=2)
    is_counted = (cells.depths[corners] == 0).any(axis=1) & (lengths < spacing)
    is_counted &= np.abs(mean_depths - centre_heights) < _MAX_DEVIATION * spacing
    is_counted &= (steepness > _SLOPE_RANGE[0]) & (steepness < _SLOPE_RANGE[1])
    slopes = np.where(is_counted[:, :, None], slopes, 0.0)
    deviations = np.where(is_counted, mean_depths - centre_heights, 0.0)
    return centroids + np.einsum(
        "kdn,kn->kd", np.linalg.pinv(slopes, rcond=_PARALLEL_TOLERANCE), deviations
    )


def _bounding(cells: Cells, heights: Heights) -> Array:
    """Return depths that are 0 only at corners of sides that bound the cells on that surface."""
    mesh = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4")
    sides = mesh.boundary_sides()[0]
    is_on_surface = (cells.depths[sides] == 0).all(axis=1)
    # One surface may be extended where another lies: the nearer of them bounds the body.
    shared_sides = np.flatnonzero(is_on_surface.sum(axis=1) > 1)
    if len(shared_sides):
        distances = heights(cells.points[sides[shared_sides]].mean(axis=1))[1]
        nearest_surfaces = np.where(is_on_surface[shared_sides], distances, np.inf).argmin(axis=1)
        is_on_surface[shared_sides] = np.arange(is_on_surface.shape[1]) == nearest_surfaces[:, None]
    on = np.zeros(cells.depths.shape, bool)
    for corner in sides.T:
        np.logical_or.at(on, corner, is_on_surface)
    return np.where((cells.depths == 0) & ~on, _NEEDLESS_DEPTH, cells.depths)


_NEEDLESS_DEPTH = -np.finfo(float).tiny  # depth of a point below a surface that only made it
_FLAT, _FAIR = 1e-3, 0.1  # shapes: no flatter ones are made, and none worse below the other
_VOLUME_TOLERANCE = 1e-6  # fraction of their volume that tetrahedra around a point may lose with it
_ROUNDS = 20  # more of them remove few more points


def undo_needless_cuts(cells: Cells) -> Cells:
    """Return the cells without the points of cuts by surfaces that do not bound the body there."""
    # Such a point moves onto a neighbour on all surfaces that it lies on, with the edges between
    # them; the tetrahedra around it must fill the same space afterwards.
    is_needless = (cells.depths == _NEEDLESS_DEPTH).any(axis=1)
    priorities = np.random.default_rng(0).permutation(len(is_needless))
    for _ in range(_ROUNDS):
        moved_points, targets_of_moves = _moves(cells, is_needless)
        if not len(moved_points):
            break
        rank = np.full(len(is_needless), -1)
        rank[moved_points] = priorities[moved_points]
        ranks = rank[cells.tetrahedra]  # of neighbours only one may move at a time
        is_waiting = np.zeros(len(is_needless), bool)
        is_waiting[cells.tetrahedra[ranks < ranks.max(axis=1, keepdims=True)]] = True
        goal = np.arange(len(is_needless))
        goal[moved_points] = np.where(is_waiting[moved_points], moved_points, targets_of_moves)
        tetrahedra = goal[cells.tetrahedra]
        is_flat = (np.diff(np.sort(tetrahedra, axis=1), axis=1) == 0).any(axis=1)
        is_near = np.zeros(len(is_needless), bool)
        is_near[cells.tetrahedra[(tetrahedra != cells.tetrahedra).any(axis=1)]] = True
        is_needless &= (goal == np.arange(len(goal))) & (is_near | is_waiting)
        cells = replace(cells, tetrahedra=tetrahedra[~is_flat])
    return cells.compact()


def _moves(cells: Cells, is_needless: Mask) -> tuple[Index, Index]:
    """Return points that can be taken out (K,), and the neighbours that they move onto (K,)."""
    count, tetrahedra = len(cells.points), cells.tetrahedra
    owners, place = np.nonzero(is_needless[tetrahedra])
    points = tetrahedra[owners, place]
    order = np.argsort(points, kind="stable")
    points, owners = points[order], owners[order]
    pairs = np.unique((points * count)[:, None] + tetrahedra[owners])
    point, goal = pairs // count, pairs % count
    on = cells.depths == 0
    is_allowed = (point != goal) & (~on[point] | on[goal]).all(axis=1)
    point, goal = point[is_allowed], goal[is_allowed]
    first, last = (np.searchsorted(points, point, side=side) for side in ("left", "right"))
    pair = np.repeat(np.arange(len(point)), last - first)
    old = owners[np.arange(len(pair)) - np.repeat(np.cumsum(last - first) - last, last - first)]
    is_staying = (tetrahedra[old] != goal[pair][:, None]).all(axis=1)
    staying_moves, last = pair[is_staying], old[is_staying]
    new = np.where(
        tetrahedra[last] == point[staying_moves][:, None],
        goal[staying_moves][:, None],
        tetrahedra[last],
    )
    old_volumes = np.bincount(
        pair, weights=_six_volumes(cells.points[tetrahedra])[old], minlength=len(point)
    )
    new_volumes = np.bincount(
        staying_moves, weights=_six_volumes(cells.points[new]), minlength=len(point)
    )
    is_filled = np.abs(new_volumes - old_volumes) < _VOLUME_TOLERANCE * old_volumes
    old_shapes, new_shapes = np.full((2, len(point)), np.inf)
    np.minimum.at(old_shapes, pair, shape_of(cells.points[tetrahedra])[old])
    np.minimum.at(
        new_shapes,
        staying_moves[is_filled[staying_moves]],
        shape_of(cells.points[new[is_filled[staying_moves]]]),
    )
    is_valid = is_filled & (new_shapes >= np.clip(old_shapes, _FLAT, _FAIR))
    ranking = np.lexsort((-new_shapes, point))
    ranking = ranking[is_valid[ranking]]
    moved_points, first_moves = np.unique(point[ranking], return_index=True)
    return moved_points, goal[ranking][first_moves]


def _six_volumes(corners: Array) -> Array:
    """Return six times the volumes of tetrahedra (T, 4, 3), m^3."""
    return determinants((corners[:, 1:] - corners[:, :1]).transpose(1, 2, 0))

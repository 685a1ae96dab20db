"""Structured curved hexahedra: flat sheets of quadrilaterals, stacked in layers, glued.

A sheet is a mesh of 8-node quadrilaterals in the plane of two parameters; `stack_layers` lays it on
itself along a third one; a body maps the three parameters to space, so that every node, mid-edge
nodes included, lies exactly where the body's own formula puts it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from struck.model.arrays import Array, Index
from struck.model.mesh_topology import components
from struck.solids.polygon_mesh import Boundary, Loops, inner_angles, keys, sides, triangulate
from struck.solids.volume_mesh import unique_rows


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuadrilateralSheet:
    """Curved 8-node quadrilaterals in a plane."""

    points: Array  # (N, 2)
    quads: Index  # (Q, 8): corners counter-clockwise, midside nodes of (0,1), (1,2), (2,3), (3,0)


# Row and column of the nodes of a quadrilateral in its block of three by three.
_IN_BLOCK = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))


def lattice(first: Array, second: Array, *, closed: bool = False) -> QuadrilateralSheet:
    """Lay quadrilaterals on a rectangular lattice; `closed` in the second direction: an angle."""
    # Ascending coordinates (2m + 1,), (2n + 1,) or, closed, (2n,): ends and midpoints of elements.
    number = np.arange(len(first) * len(second)).reshape(len(first), len(second))
    if closed:
        number = np.hstack([number, number[:, :1]])
    rows, columns = number.shape[0] - 2, number.shape[1] - 2
    nodes = [number[i : rows + i : 2, j : columns + j : 2].ravel() for i, j in _IN_BLOCK]
    points = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    used_nodes, quads = np.unique(np.stack(nodes, axis=1), return_inverse=True)
    return QuadrilateralSheet(points=points[used_nodes], quads=quads.reshape(-1, 8))


def angles(count: int) -> Array:
    """Return the angles of the ends and midpoints of `count` elements on a circle (2 count,)."""
    return np.linspace(-np.pi / 4, 7 * np.pi / 4, 2 * count, endpoint=False)


_ROUNDING = 0.4  # how far the sides of the core bulge towards circles: 0 a square, 1 a disc
_CORE = 0.6  # half the width of the core


def disc(count: int, rings: int) -> QuadrilateralSheet:
    """Mesh the unit disc without a pole: a rounded square core within rings (an O-grid)."""
    # `count` is a multiple of 4, the elements on the circle; their nodes lie at `angles`.
    side = np.tan(np.linspace(-np.pi / 4, np.pi / 4, count // 2 + 1))
    side /= np.sqrt(1 - _ROUNDING / 2 + _ROUNDING * side**2 / 2)
    core = lattice(side, side)
    ring = lattice(np.linspace(0, 1, 2 * rings + 1), angles(count), closed=True)
    points, quads = merge_meshes(
        [_map_to_core(core.points), _map_to_ring(*ring.points.T)], [core.quads, ring.quads]
    )
    return QuadrilateralSheet(points=points, quads=quads)


def _map_to_core(square: Array) -> Array:
    """Map the square from -1 to 1 on the core, smoothly (elliptical map, softened)."""
    return _CORE * square * np.sqrt(1 - _ROUNDING / 2 * square[:, ::-1] ** 2)


def _map_to_ring(positions: Array, angle: Array) -> Array:
    """Return points from the core's edge (outward = 0) to the unit circle (1), angle kept."""
    quarter = np.round(angle / (np.pi / 2)) * (np.pi / 2)
    slope = np.tan(angle - quarter)
    edge = slope / np.sqrt(1 - _ROUNDING / 2 + _ROUNDING * slope**2 / 2)
    corner = _map_to_core(np.stack([np.ones_like(edge), edge], axis=1))
    radius = (1 - positions) * np.hypot(*corner.T) + positions
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def make_sheet(points: Array, corners: Index) -> QuadrilateralSheet:
    """Make a sheet of straight-sided quadrilaterals from their corners (Q, 4)."""
    edges, place = unique_rows(np.sort(sides(corners).reshape(-1, 2), axis=1))
    midside_nodes = len(points) + place.reshape(-1, 4)
    return QuadrilateralSheet(
        points=np.vstack([points, points[edges].mean(axis=1)]),
        quads=np.hstack([corners, midside_nodes]),
    )


def stack_layers(sheet: QuadrilateralSheet, levels: Array) -> tuple[Array, Index]:
    """Lay a sheet on itself in layers: coordinates of all nodes (N, 3), hexahedra (E, 20)."""
    # `levels` (2 L + 1,): ascending third coordinates of the ends and midpoints of L layers.
    corners = np.unique(sheet.quads[:, :4])
    rank = np.zeros(len(sheet.points), np.int64)
    rank[corners] = np.arange(len(corners))
    node_count = len(sheet.points)
    step = node_count + len(corners)
    one_layer = np.hstack(
        [
            sheet.quads[:, :4],
            sheet.quads[:, :4] + step,
            sheet.quads[:, 4:],
            sheet.quads[:, 4:] + step,
            rank[sheet.quads[:, :4]] + node_count,
        ]
    )
    layers = len(levels) // 2
    elements = (one_layer[None] + step * np.arange(layers)[:, None, None]).reshape(-1, 20)
    flat = (sheet.points, sheet.points[corners])
    parts = [np.insert(flat[i % 2], 2, level, axis=1) for i, level in enumerate(levels)]
    return np.vstack(parts), elements


_MERGE_TOLERANCE = 1e-9  # of the longest extent: far below any element, far above rounding


def merge_meshes(points: list[Array], cells: list[Index]) -> tuple[Array, Index]:
    """Glue meshes of one kind of cell where their nodes coincide; drop unused nodes."""
    first_nodes = np.cumsum([0] + [len(part) for part in points[:-1]])
    all_points = np.vstack(points)
    nodes = np.vstack([part + start for part, start in zip(cells, first_nodes, strict=True)])
    reach = _MERGE_TOLERANCE * np.ptp(all_points, axis=0).max()
    group = components(
        KDTree(all_points).query_pairs(reach, output_type="ndarray"), len(all_points)
    )
    _, first = np.unique(group, return_index=True)
    used_nodes, new_cells = np.unique(first[group[nodes]], return_inverse=True)
    return all_points[used_nodes], new_cells.reshape(nodes.shape)


def divide_breaks(breaks: Array, count: int) -> Array:
    """Divide all of `breaks` into about `count` elements: their ends and midpoints (2 m + 1,)."""
    lengths = np.diff(breaks)
    interval_counts = np.maximum(1, np.round(count * lengths / lengths.sum())).astype(int)
    segments = [
        np.linspace(low, high, 2 * interval_count, endpoint=False)
        for low, high, interval_count in zip(breaks[:-1], breaks[1:], interval_counts, strict=True)
    ]
    return np.concatenate([*segments, breaks[-1:]])


def quadrilaterals(loops: Loops, size: float) -> QuadrilateralSheet:
    """Mesh the inside of an outline and its holes, in quadrilaterals of edge `size`, m."""
    # The edges are smaller where corners stand closer together.
    points, triangles, boundary = triangulate(loops, 2 * size)
    pairs, single = _pair_triangles(points, triangles)
    points, corners = _cut_polygons(points, [pairs, single], boundary)
    return make_sheet(_smooth(points, corners), corners)


_MAX_ANGLE = np.radians(150.0)  # angle that a pair of triangles may have


def _pair_triangles(points: Array, triangles: Index) -> tuple[Index, Index]:
    """Join triangles to quadrilaterals (P, 4), best ones first; return unpaired ones (T, 3) too."""
    edges = keys(sides(triangles)).ravel()
    order = np.argsort(edges, kind="stable")
    shared_sides = np.flatnonzero(edges[order][1:] == edges[order][:-1])
    first, second = order[shared_sides], order[shared_sides + 1]
    quads = _join_triangles(triangles, first, second)
    angles = inner_angles(points[quads])
    is_convex = (angles > 0).all(axis=1) & (angles.max(axis=1) < _MAX_ANGLE)
    deviations = np.abs(angles - np.pi / 2).max(axis=1)
    is_free, chosen = np.ones(len(triangles), bool), []
    for pair in np.lexsort((first, deviations.round(9))):
        members = [first[pair] // 3, second[pair] // 3]
        if is_convex[pair] and is_free[members].all():
            is_free[members] = False
            chosen.append(pair)
    return quads[chosen].reshape(-1, 4), triangles[is_free]


def _join_triangles(triangles: Index, first: Index, second: Index) -> Index:
    """Return the corners around both triangles that share an edge (given by flat side numbers)."""
    a, b, opposite_corners = (triangles[first // 3, (first + i) % 3] for i in range(3))
    return np.stack([a, triangles[second // 3, (second + 2) % 3], b, opposite_corners], axis=1)


def _cut_polygons(points: Array, groups: list[Index], boundary: Boundary) -> tuple[Array, Index]:
    """Cut polygons into quadrilaterals between corners, midpoints of sides and centres."""
    edges = np.vstack([sides(cells).reshape(-1, 2) for cells in groups])
    numbers, first, place = np.unique(keys(edges), return_index=True, return_inverse=True)
    midpoints = points[edges[first]].mean(axis=1)
    midpoints[np.searchsorted(numbers, keys(boundary.ends))] = boundary.midpoints
    parts, corners, position, start = [points, midpoints], [], 0, len(points) + len(midpoints)
    for cells in groups:
        midpoint_nodes = len(points) + place[position : position + cells.size].reshape(cells.shape)
        centre = np.broadcast_to(start + np.arange(len(cells))[:, None], cells.shape)
        quads = np.stack(
            [cells, midpoint_nodes, centre, np.roll(midpoint_nodes, 1, axis=1)], axis=-1
        )
        corners.append(quads.reshape(-1, 4))
        parts.append(points[cells].mean(axis=1))
        position, start = position + cells.size, start + len(cells)
    return np.vstack(parts), np.vstack(corners)


def _smooth(points: Array, corners: Index, sweeps: int = 8) -> Array:
    """Move inner points to the centre of their neighbours while that does not harm any cell."""
    edges, counts = np.unique(keys(sides(corners)), return_counts=True)
    ends = np.stack([edges >> 32, edges & 0xFFFFFFFF], axis=1)
    is_inner = np.ones(len(points), bool)
    is_inner[ends[counts == 1]] = False
    directed_ends = np.vstack([ends, ends[:, ::-1]])
    degree = np.bincount(directed_ends[:, 0], minlength=len(points))[:, None]
    for _ in range(sweeps):
        sums = np.zeros_like(points)
        np.add.at(sums, directed_ends[:, 0], points[directed_ends[:, 1]])
        new_points = np.where(is_inner[:, None], (points + sums / degree) / 2, points)
        if _quality(new_points, corners) < _quality(points, corners):
            break
        points = new_points
    return points


def _quality(points: Array, corners: Index) -> float:
    """Return the smallest sine of a corner's angle, negative where a cell is turned over."""
    return float(np.sin(inner_angles(points[corners])).min())

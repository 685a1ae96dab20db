"""Structured curved hexahedra: flat sheets of quadrilaterals, stacked in layers, glued.

A sheet is a mesh of 8-node quadrilaterals in the plane of two parameters; `stacked` lays it on
itself along a third one; a body maps the three parameters to space, so that every node, mid-edge
nodes included, lies exactly where the body's own formula puts it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from struck.model.arrays import Array, Index
from struck.model.mesh_topology import components
from struck.solids.polygon_mesh import Boundary, Loops, inner_angles, keys, sides, triangulated
from struck.solids.volume_mesh import unique_rows


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class QuadrilateralSheet:
    """Curved 8-node quadrilaterals in a plane."""

    points: Array  # (N, 2)
    quads: Index  # (Q, 8): corners counter-clockwise, middles of (0,1), (1,2), (2,3), (3,0)


# Row and column of the nodes of a quadrilateral in its block of three by three.
_IN_BLOCK = ((0, 0), (2, 0), (2, 2), (0, 2), (1, 0), (2, 1), (1, 2), (0, 1))


def lattice(first: Array, second: Array, *, closed: bool = False) -> QuadrilateralSheet:
    """Lay quadrilaterals on a rectangular lattice; `closed` in the second direction: an angle."""
    # Ascending coordinates (2m + 1,), (2n + 1,) or, closed, (2n,): ends of elements, and middles.
    number = np.arange(len(first) * len(second)).reshape(len(first), len(second))
    if closed:
        number = np.hstack([number, number[:, :1]])
    rows, columns = number.shape[0] - 2, number.shape[1] - 2
    nodes = [number[i : rows + i : 2, j : columns + j : 2].ravel() for i, j in _IN_BLOCK]
    points = np.stack(np.meshgrid(first, second, indexing="ij"), axis=-1).reshape(-1, 2)
    used, quads = np.unique(np.stack(nodes, axis=1), return_inverse=True)
    return QuadrilateralSheet(points=points[used], quads=quads.reshape(-1, 8))


def angles(around: int) -> Array:
    """Return the angles of the ends and middles of `around` elements on a circle (2 around,)."""
    return np.linspace(-np.pi / 4, 7 * np.pi / 4, 2 * around, endpoint=False)


_ROUNDING = 0.4  # how far the sides of the core bulge towards circles: 0 a square, 1 a disc
_CORE = 0.6  # half the width of the core


def disc(around: int, rings: int) -> QuadrilateralSheet:
    """Mesh the unit disc without a pole: a rounded square core within rings (an O-grid)."""
    # `around` is a multiple of 4, the elements on the circle; their nodes lie at `angles`.
    side = np.tan(np.linspace(-np.pi / 4, np.pi / 4, around // 2 + 1))
    side /= np.sqrt(1 - _ROUNDING / 2 + _ROUNDING * side**2 / 2)
    core = lattice(side, side)
    ring = lattice(np.linspace(0, 1, 2 * rings + 1), angles(around), closed=True)
    points, quads = merged(
        [_rounded(core.points), _between_core_and_circle(*ring.points.T)], [core.quads, ring.quads]
    )
    return QuadrilateralSheet(points=points, quads=quads)


def _rounded(square: Array) -> Array:
    """Map the square from -1 to 1 on the core, smoothly (elliptical map, softened)."""
    return _CORE * square * np.sqrt(1 - _ROUNDING / 2 * square[:, ::-1] ** 2)


def _between_core_and_circle(outward: Array, angle: Array) -> Array:
    """Return points from the core's edge (outward = 0) to the unit circle (1), angle kept."""
    quarter = np.round(angle / (np.pi / 2)) * (np.pi / 2)
    slope = np.tan(angle - quarter)
    edge = slope / np.sqrt(1 - _ROUNDING / 2 + _ROUNDING * slope**2 / 2)
    corner = _rounded(np.stack([np.ones_like(edge), edge], axis=1))
    radius = (1 - outward) * np.hypot(*corner.T) + outward
    return radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def with_middles(points: Array, corners: Index) -> QuadrilateralSheet:
    """Make a sheet of straight-sided quadrilaterals from their corners (Q, 4)."""
    edges, place = unique_rows(np.sort(sides(corners).reshape(-1, 2), axis=1))
    middles = len(points) + place.reshape(-1, 4)
    return QuadrilateralSheet(
        points=np.vstack([points, points[edges].mean(axis=1)]), quads=np.hstack([corners, middles])
    )


def stacked(sheet: QuadrilateralSheet, levels: Array) -> tuple[Array, Index]:
    """Lay a sheet on itself in layers: coordinates of all nodes (N, 3), hexahedra (E, 20)."""
    # `levels` (2 L + 1,): ascending third coordinates of the ends and middles of L layers.
    corners = np.unique(sheet.quads[:, :4])
    rank = np.zeros(len(sheet.points), np.int64)
    rank[corners] = np.arange(len(corners))
    whole = len(sheet.points)
    step = whole + len(corners)
    one_layer = np.hstack(
        [
            sheet.quads[:, :4],
            sheet.quads[:, :4] + step,
            sheet.quads[:, 4:],
            sheet.quads[:, 4:] + step,
            rank[sheet.quads[:, :4]] + whole,
        ]
    )
    layers = len(levels) // 2
    elements = (one_layer[None] + step * np.arange(layers)[:, None, None]).reshape(-1, 20)
    flat = (sheet.points, sheet.points[corners])
    parts = [np.insert(flat[i % 2], 2, level, axis=1) for i, level in enumerate(levels)]
    return np.vstack(parts), elements


_COINCIDENT = 1e-9  # of the longest extent: far below any element, far above rounding


def merged(points: list[Array], cells: list[Index]) -> tuple[Array, Index]:
    """Glue meshes of one kind of cell where their nodes coincide; drop unused nodes."""
    starts = np.cumsum([0] + [len(part) for part in points[:-1]])
    joined = np.vstack(points)
    nodes = np.vstack([part + start for part, start in zip(cells, starts, strict=True)])
    reach = _COINCIDENT * np.ptp(joined, axis=0).max()
    group = components(KDTree(joined).query_pairs(reach, output_type="ndarray"), len(joined))
    _, first = np.unique(group, return_index=True)
    used, glued = np.unique(first[group[nodes]], return_inverse=True)
    return joined[used], glued.reshape(nodes.shape)


def divided(breaks: Array, count: int) -> Array:
    """Share about `count` elements among the intervals of `breaks`: ends and middles (2 m + 1,)."""
    lengths = np.diff(breaks)
    shares = np.maximum(1, np.round(count * lengths / lengths.sum())).astype(int)
    starts = [
        np.linspace(low, high, 2 * share, endpoint=False)
        for low, high, share in zip(breaks[:-1], breaks[1:], shares, strict=True)
    ]
    return np.concatenate([*starts, breaks[-1:]])


def quadrilaterals(loops: Loops, size: float) -> QuadrilateralSheet:
    """Mesh the inside of an outline and its holes, in quadrilaterals of edge `size`, m."""
    # The edges are smaller where corners stand closer together.
    points, triangles, boundary = triangulated(loops, 2 * size)
    pairs, single = _paired(points, triangles)
    points, corners = _cut(points, [pairs, single], boundary)
    return with_middles(_smoothed(points, corners), corners)


_WIDEST = np.radians(150.0)  # angle that a pair of triangles may have


def _paired(points: Array, triangles: Index) -> tuple[Index, Index]:
    """Join triangles to quadrilaterals (P, 4), best ones first; return unpaired ones (T, 3) too."""
    edges = keys(sides(triangles)).ravel()
    order = np.argsort(edges, kind="stable")
    twice = np.flatnonzero(edges[order][1:] == edges[order][:-1])
    first, second = order[twice], order[twice + 1]
    quads = _joined(triangles, first, second)
    angles = inner_angles(points[quads])
    convex = (angles > 0).all(axis=1) & (angles.max(axis=1) < _WIDEST)
    worst = np.abs(angles - np.pi / 2).max(axis=1)
    free, chosen = np.ones(len(triangles), bool), []
    for pair in np.lexsort((first, worst.round(9))):
        members = [first[pair] // 3, second[pair] // 3]
        if convex[pair] and free[members].all():
            free[members] = False
            chosen.append(pair)
    return quads[chosen].reshape(-1, 4), triangles[free]


def _joined(triangles: Index, first: Index, second: Index) -> Index:
    """Return the corners around both triangles that share an edge (given by flat side numbers)."""
    a, b, opposite = (triangles[first // 3, (first + i) % 3] for i in range(3))
    return np.stack([a, triangles[second // 3, (second + 2) % 3], b, opposite], axis=1)


def _cut(points: Array, groups: list[Index], boundary: Boundary) -> tuple[Array, Index]:
    """Cut polygons into quadrilaterals between corner, middles of sides and centre."""
    edges = np.vstack([sides(cells).reshape(-1, 2) for cells in groups])
    numbers, first, place = np.unique(keys(edges), return_index=True, return_inverse=True)
    middles = points[edges[first]].mean(axis=1)
    middles[np.searchsorted(numbers, keys(boundary.ends))] = boundary.middles
    parts, corners, done, start = [points, middles], [], 0, len(points) + len(middles)
    for cells in groups:
        middle = len(points) + place[done : done + cells.size].reshape(cells.shape)
        centre = np.broadcast_to(start + np.arange(len(cells))[:, None], cells.shape)
        quads = np.stack([cells, middle, centre, np.roll(middle, 1, axis=1)], axis=-1)
        corners.append(quads.reshape(-1, 4))
        parts.append(points[cells].mean(axis=1))
        done, start = done + cells.size, start + len(cells)
    return np.vstack(parts), np.vstack(corners)


def _smoothed(points: Array, corners: Index, sweeps: int = 8) -> Array:
    """Move inner points to the centre of their neighbours while that does not harm any cell."""
    edges, counts = np.unique(keys(sides(corners)), return_counts=True)
    ends = np.stack([edges >> 32, edges & 0xFFFFFFFF], axis=1)
    inner = np.ones(len(points), bool)
    inner[ends[counts == 1]] = False
    both = np.vstack([ends, ends[:, ::-1]])
    degree = np.bincount(both[:, 0], minlength=len(points))[:, None]
    for _ in range(sweeps):
        total = np.zeros_like(points)
        np.add.at(total, both[:, 0], points[both[:, 1]])
        moved = np.where(inner[:, None], (points + total / degree) / 2, points)
        if _quality(moved, corners) < _quality(points, corners):
            break
        points = moved
    return points


def _quality(points: Array, corners: Index) -> float:
    """Return the smallest sine of a corner's angle, negative where a cell is turned over."""
    return float(np.sin(inner_angles(points[corners])).min())

"""Quadrilaterals inside a polygon: triangles in pairs, cut about their centres."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.solids.hexahedra import Sheet, with_middles
from struck.solids.outline import Loops
from struck.solids.polygon_mesh import Boundary, inner_angles, keys, sides, triangulated

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def quadrilaterals(loops: Loops, size: float) -> Sheet:
    """Mesh the inside of an outline and its holes.

    Parameters
    ----------
    loops : tuple of arrays (n, 2)
        The outline and its holes, checked by `outline.check_loops`.
    size : float
        Edge of the quadrilaterals, m; smaller where corners stand closer together.

    Raises
    ------
    MeshError
        When the outline has corners too sharp or too close to mesh.
    """
    points, triangles, boundary = triangulated(loops, 2 * size)
    pairs, single = _paired(points, triangles)
    points, corners = _cut(points, [pairs, single], boundary)
    return with_middles(_smoothed(points, corners), corners)


_WIDEST = np.radians(150.0)  # angle that a pair of triangles may have


def _paired(points: Array, triangles: Index) -> tuple[Index, Index]:
    """Join triangles to quadrilaterals, best ones first: pairs (P, 4) and those left (T, 3)."""
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
    beyond = triangles[second // 3, (second + 2) % 3]
    return np.stack([a, beyond, b, opposite], axis=1)


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

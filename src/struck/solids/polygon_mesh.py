"""Triangles inside a polygon: a Delaunay triangulation refined as Ruppert does.

Points on a square lattice give squares in the open; circumcentres of poor triangles and midpoints
of missing or encroached boundary edges repair the rest (Ruppert 1995, J. Algorithms 18, in whole
rounds instead of one point at a time).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import Delaunay

from struck.errors import MeshError, OptionError
from struck.model.arrays import Array, Index, Mask

Pairs = Sequence[Sequence[float]] | Array
Loops = tuple[Array, ...]
Ends = tuple[Array, Array]
_MAX_PAIRS = 2**16  # pairs of edges, to bound the memory


def as_points(name: str, values: Pairs) -> tuple[tuple[float, float], ...]:
    """Return pairs of floats; OptionError unless `values` are finite pairs."""
    points = np.array(values, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise OptionError(f"{name} has the form {points.shape}: give finite pairs of numbers, in m")
    return tuple((float(x), float(y)) for x, y in points)


def crossing(polygon: Array) -> Array | None:
    """Return a place where edges of the closed `polygon` (n, 2) meet that should not, or None."""
    count, edges = len(polygon), _ends(polygon)
    for batch in np.array_split(np.arange(count), math.ceil(count**2 / _MAX_PAIRS)):
        first, second = np.repeat(batch, count), np.tile(np.arange(count), len(batch))
        # Neighbours meet, and so do the first edge and the last.
        is_separate = (second >= first + 2) & (second - first < count - 1)
        place = _meeting(edges, first[is_separate], edges, second[is_separate])
        if place is not None:
            return place
    return None


def _meeting(edges: Ends, first: Index, others: Ends, second: Index) -> Array | None:
    """Return the first edge's start where an edge of one set meets one of the other, or None."""
    (a, b), (c, d) = (end[first] for end in edges), (end[second] for end in others)
    low = np.maximum(np.minimum(a, b), np.minimum(c, d))
    high = np.minimum(np.maximum(a, b), np.maximum(c, d))
    # Few boxes overlap: orientations are computed of these pairs alone.
    near = np.flatnonzero((low <= high).all(axis=1))
    a, b, c, d = a[near], b[near], c[near], d[near]
    is_straddled = (_turn(a, b, c) * _turn(a, b, d) <= 0) & (_turn(c, d, a) * _turn(c, d, b) <= 0)
    hits = np.flatnonzero(is_straddled)
    return a[hits[0]] if len(hits) else None


def _turn(a: Array, b: Array, c: Array) -> Array:
    """Return the sign of the turn from a over b to c: 1 left, -1 right, 0 straight."""
    cross = (b - a)[..., 0] * (c - a)[..., 1] - (b - a)[..., 1] * (c - a)[..., 0]
    noise = 1e-14 * np.linalg.norm(b - a, axis=-1) * np.linalg.norm(c - a, axis=-1)
    return np.where(np.abs(cross) <= noise, 0.0, np.sign(cross))


def signed_area(polygon: Array) -> float:
    """Return the area of a polygon (n, 2), m^2; negative where it runs clockwise."""
    x, y = (polygon - polygon[0]).T
    return float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y) / 2)


def contains(edges: Ends, points: Array) -> Mask:
    """Return which points (K, 2) lie inside an odd number of loops, given by all their edges."""
    is_inside = np.zeros(len(points), bool)
    for a, b in zip(*edges, strict=True):
        is_spanned = (a[1] <= points[:, 1]) != (b[1] <= points[:, 1])
        if is_spanned.any():
            at = a[0] + (points[is_spanned, 1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
            is_inside[is_spanned] ^= points[is_spanned, 0] < at
    return is_inside


def edges_of(loops: Loops) -> Ends:
    """Return where the edges of all loops start and end."""
    return np.vstack(loops), np.vstack([np.roll(loop, -1, axis=0) for loop in loops])


def _ends(polygon: Array) -> Ends:
    return edges_of((polygon,))


def distance_to_edges(edges: Ends, points: Array) -> Array:
    """Return the distances of points (K, 2) to the nearest edge (K,)."""
    distances = np.full(len(points), np.inf)
    for a, b in zip(*edges, strict=True):
        fractions = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        distances = np.minimum(
            distances, np.linalg.norm(points - a - fractions[:, None] * (b - a), axis=1)
        )
    return distances


def check_loops(loops: Loops) -> None:
    """Raise MeshError on an outline and holes (n, 2) without an inside."""
    for name, loop in zip(_names(loops), loops, strict=True):
        _check_loop(name, loop)
    for i, name in enumerate(_names(loops)[1:], start=1):
        _check_hole(name, loops[i], loops[:1], loops[1:i])


def _check_loop(name: str, loop: Array) -> None:
    if len(loop) < 3:
        raise MeshError(f"{name} has {len(loop)} corners: give at least 3")
    previous_vectors, next_vectors = (
        np.roll(loop, 1, axis=0) - loop,
        np.roll(loop, -1, axis=0) - loop,
    )
    steps = np.linalg.norm(next_vectors, axis=1)
    if steps.min() <= 1e-9 * np.ptp(loop, axis=0).max():
        raise MeshError(f"{name} repeats corner {place_of(loop[np.argmin(steps)])}: give it once")
    is_folded = (_turn(np.zeros(2), previous_vectors, next_vectors) == 0) & (
        np.sum(previous_vectors * next_vectors, axis=1) > 0
    )
    if is_folded.any():
        raise MeshError(
            f"{name} folds back at {place_of(loop[np.argmax(is_folded)])}: leave that out"
        )
    place = crossing(loop)
    if place is not None:
        raise MeshError(f"{name} crosses itself near {place_of(place)}: untangle its corners")


def _check_hole(name: str, hole: Array, outline: Loops, others: Loops) -> None:
    for loop in outline + others:
        all_edges = np.arange(len(loop))
        for edge in range(len(hole)):
            place = _meeting(_ends(hole), np.full(len(loop), edge), _ends(loop), all_edges)
            if place is not None:
                raise MeshError(f"{name} touches another edge near {place_of(place)}: move it away")
    if not contains(edges_of(outline), hole[:1])[0]:
        raise MeshError(f"{name} lies outside the outline: move it inside")
    for earlier_hole in others:
        if contains(_ends(earlier_hole), hole[:1])[0] or contains(_ends(hole), earlier_hole[:1])[0]:
            raise MeshError(f"{name} overlaps another hole: give one hole for both")


def _names(loops: Loops) -> list[str]:
    return ["the outline", *(f"hole {i + 1}" for i in range(len(loops) - 1))]


def place_of(point: Array) -> str:
    """Return a point (x, y) in words, m."""
    return f"({point[0]:.6g}, {point[1]:.6g}) m"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Boundary:
    """Edges of the triangulation on the outline."""

    ends: Index  # (S, 2), point indices
    midpoints: Array  # (S, 2): where the outline runs between them: at a corner, or halfway
    sharp: Index  # indices of points at corners under 60 degrees

    @property
    def ends_at_sharp_corner(self) -> Mask:
        """Which edges end at a sharp corner (S,)."""
        return np.any(np.isin(self.ends, self.sharp), axis=1)

    def edges(self, points: Array) -> Ends:
        """Return where the edges start and end (S, 2), (S, 2)."""
        return points[self.ends[:, 0]], points[self.ends[:, 1]]

    def split(self, chosen: Mask, points: Array) -> Boundary:
        """Return the boundary with chosen edges cut at their midpoints, numbered after `points`."""
        number = len(points) + np.arange(np.count_nonzero(chosen))
        a, b = self.ends[chosen].T
        halves = [np.stack([a, number], axis=1), np.stack([number, b], axis=1)]
        tips = [(points[a] + self.midpoints[chosen]) / 2, (self.midpoints[chosen] + points[b]) / 2]
        return replace(
            self,
            ends=np.vstack([self.ends[~chosen], *halves]),
            midpoints=np.vstack([self.midpoints[~chosen], *tips]),
        )


_ROUNDS = 60
_POOR = np.radians(25.0)  # smallest angle; Ruppert's rounds end for 20.7 degrees, mostly for 30


def triangulate(loops: Loops, size: float) -> tuple[Array, Index, Boundary]:
    """Triangulate the inside of loops: points (N, 2), triangles (T, 3), boundary."""
    points, boundary = _resample(loops, size)
    points = np.vstack([points, _lattice_inside(loops, size)])
    for _ in range(_ROUNDS):
        triangles = _triangulate_inside(points, boundary)
        is_split, new_points = ~_is_present(boundary, triangles), np.zeros((0, 2))
        if not is_split.any():
            is_split, new_points = _repairs(points, triangles, boundary, size)
        if not (is_split.any() or len(new_points)):
            break
        midpoints = boundary.midpoints[is_split]
        boundary = boundary.split(is_split, points)
        points = np.vstack([points, midpoints, new_points])
    triangles = _triangulate_inside(points, boundary)
    if not _is_present(boundary, triangles).all():
        raise MeshError(
            "the outline has edges too close together or corners too sharp to mesh: "
            "widen the narrowest gap or blunt the sharpest corner"
        )
    return points, triangles, boundary


def _is_present(boundary: Boundary, triangles: Index) -> Mask:
    return np.isin(keys(boundary.ends), keys(sides(triangles)))


def _resample(loops: Loops, size: float) -> tuple[Array, Boundary]:
    """Walk the loops in edges of at most `size`, over short edges of a smooth bend in pairs."""
    points, ends, all_midpoints, sharp, start = [], [], [], [], 0
    for loop in loops:
        stops, midpoints, is_sharp = _strides(loop, size)
        number = start + np.arange(len(stops))
        points.append(stops)
        all_midpoints.append(midpoints)
        sharp.append(number[is_sharp])
        ends.append(np.stack([number, np.roll(number, -1)], axis=1))
        start += len(number)
    boundary = Boundary(
        ends=np.vstack(ends), midpoints=np.vstack(all_midpoints), sharp=np.concatenate(sharp)
    )
    return np.vstack(points), boundary


_SHARP = np.radians(120.0)  # of turn, so 60 degrees of corner


def _strides(loop: Array, size: float) -> tuple[Array, Array, Mask]:
    """Return where strides along a loop begin, where each is half done, and sharp beginnings."""
    # The first strides from a sharp corner are equally long along both its edges: then neither
    # edge calls for cuts of the other, again and again towards the corner.
    loop = np.roll(loop, -int(np.argmax(_bends(_steps(loop)))), axis=0)
    steps = _steps(loop)
    lengths, sharp = np.linalg.norm(steps, axis=1), _bends(steps) > _SHARP
    equal = sharp * np.minimum(np.minimum(lengths, np.roll(lengths, 1)) / 3, size)
    is_double = _strides_of_two(steps, sharp, size)
    stops, halves, is_sharp, edge = [], [], [], 0
    while edge < len(loop):
        if is_double[edge]:
            at, half = loop[edge : edge + 1], loop[edge + 1 : edge + 2]
        else:
            distances = _stops(lengths[edge], equal[edge], equal[edge + 1 - len(loop)], size)
            fractions = distances[:, None] / lengths[edge]
            at = loop[edge] + fractions[:-1] * steps[edge]
            half = loop[edge] + (fractions[:-1] + fractions[1:]) / 2 * steps[edge]
        stops.append(at)
        halves.append(half)
        is_sharp.append(sharp[edge] & (np.arange(len(at)) == 0))
        edge += 2 if is_double[edge] else 1
    return np.vstack(stops), np.vstack(halves), np.concatenate(is_sharp)


def _steps(loop: Array) -> Array:
    return np.roll(loop, -1, axis=0) - loop


def _stops(length: float, first: float, last: float, size: float) -> Array:
    """Return distances from 0 to `length` in steps of `size` at most, first and last step given."""
    inner = length - first - last
    inner_stops = np.linspace(first, first + inner, int(np.ceil(inner / size - 1e-9)) + 1)
    return np.concatenate([[0.0] if first else [], inner_stops, [length] if last else []])


_BEND = 0.5  # rad; the corner within a stride leaves its quadrilaterals convex


def _strides_of_two(steps: Array, sharp: Mask, size: float) -> Mask:
    """Return where an edge and the next are short, similar, nearly in line, off sharp corners."""
    lengths = np.linalg.norm(steps, axis=1)
    following = np.roll(lengths, -1)
    is_similar = np.maximum(lengths, following) < 2 * np.minimum(lengths, following)
    is_fitting = (lengths + following <= size) & is_similar & (np.roll(_bends(steps), -1) < _BEND)
    is_fitting &= ~(sharp | np.roll(sharp, -2))
    is_fitting[-1] = False
    return is_fitting


def _bends(steps: Array) -> Array:
    """Return the absolute angles by which a loop turns at the start of each step, rad."""
    previous_steps = np.roll(steps, 1, axis=0)
    cross = previous_steps[:, 0] * steps[:, 1] - previous_steps[:, 1] * steps[:, 0]
    return np.abs(np.arctan2(cross, np.sum(previous_steps * steps, axis=1)))


def _lattice_inside(loops: Loops, size: float) -> Array:
    """Return the points of a square lattice along the outline's longest edge, off the boundary."""
    steps = _steps(loops[0])
    lengths = np.linalg.norm(steps, axis=1)
    x, y = steps[np.argmax((lengths / lengths.max()).round(9))]
    rotation = np.array([[x, -y], [y, x]]) / np.hypot(x, y)
    rotated_loop = loops[0] @ rotation
    low, high = rotated_loop.min(axis=0), rotated_loop.max(axis=0)
    counts = np.ceil((high - low) / size - 1e-9).astype(int)
    axes = [np.linspace(a, b, n + 1)[1:-1] for a, b, n in zip(low, high, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2) @ rotation.T
    points = points[contains(edges_of(loops), points)]
    return points[distance_to_edges(edges_of(loops), points) > 0.6 * size]


def _triangulate_inside(points: Array, boundary: Boundary) -> Index:
    triangles = Delaunay(points).simplices.astype(np.int64)
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    longest = np.max([np.sum(side**2, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    is_flat = np.abs(area) < 1e-9 * longest
    return triangles[~is_flat & contains(boundary.edges(points), (a + b + c) / 3)]


def sides(cells: Index) -> Index:
    """Return the sides of polygons (K, n) as pairs of point indices (K, n, 2)."""
    return np.stack([cells, np.roll(cells, -1, axis=1)], axis=-1)


def keys(edges: Index) -> Index:
    """Return one number for each undirected edge (..., 2)."""
    low, high = edges.min(axis=-1), edges.max(axis=-1)
    return (low << 32) | high


def _repairs(
    points: Array, triangles: Index, boundary: Boundary, size: float
) -> tuple[Mask, Array]:
    """Return which boundary edges to split and which points to add for better triangles."""
    angles = inner_angles(points[triangles])
    at_corner = _find_sharp_vertices(triangles, boundary, angles.argmin(axis=1))
    centres, radii = _circumcircles(points[triangles])
    is_poor = ((angles.min(axis=1) < _POOR) & ~at_corner) | (radii > size)
    order = np.flatnonzero(is_poor)[np.argsort(-radii[is_poor])]
    centres, radii = centres[order], radii[order]
    a, b = boundary.edges(points)
    gap = np.linalg.norm(centres[:, None] - (a + b) / 2, axis=2)
    is_encroached = gap < np.linalg.norm(b - a, axis=1) / 2 * (1 - 1e-9)
    is_free = ~is_encroached.any(axis=1) & contains((a, b), centres)
    is_split = is_encroached.any(axis=0) & ~boundary.ends_at_sharp_corner
    return is_split, _select_separated(centres[is_free], 0.7 * radii[is_free])


def inner_angles(corners: Array) -> Array:
    """Return the inner angles of convex polygons (K, n, 2): (K, n)."""
    next_vectors, previous_vectors = (
        np.roll(corners, -1, axis=1) - corners,
        np.roll(corners, 1, axis=1) - corners,
    )
    cross = (
        next_vectors[..., 0] * previous_vectors[..., 1]
        - next_vectors[..., 1] * previous_vectors[..., 0]
    )
    return np.arctan2(cross, np.sum(next_vectors * previous_vectors, axis=-1))


def _find_sharp_vertices(triangles: Index, boundary: Boundary, vertex: Index) -> Mask:
    """Return triangles with two boundary sides at the chosen vertex, an angle that stays sharp."""
    on_boundary = np.isin(keys(sides(triangles)), keys(boundary.ends))
    rows = np.arange(len(triangles))
    return on_boundary[rows, vertex] & on_boundary[rows, vertex - 1]


def _circumcircles(corners: Array) -> tuple[Array, Array]:
    a, b, c = np.moveaxis(corners, 1, 0)
    u, v = b - a, c - a
    squares = np.stack([np.sum(u * u, axis=1), np.sum(v * v, axis=1)], axis=1)
    offset = np.linalg.solve(2 * np.stack([u, v], axis=1), squares[..., None])[..., 0]
    return a + offset, np.linalg.norm(offset, axis=1)


def _select_separated(points: Array, gaps: Array) -> Array:
    """Select points in order that lie at least their gap away from all points selected before."""
    selected = np.zeros((0, 2))
    for point, gap in zip(points, gaps, strict=True):
        if not len(selected) or np.linalg.norm(selected - point, axis=1).min() > gap:
            selected = np.vstack([selected, point])
    return selected

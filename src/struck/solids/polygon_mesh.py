"""Triangles inside a polygon: a Delaunay triangulation refined as Ruppert does.

Points on a square lattice give squares in the open; circumcentres of poor triangles and middles
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
_AT_ONCE = 2**16  # pairs of edges, to bound the memory


def as_points(name: str, values: Pairs) -> tuple[tuple[float, float], ...]:
    """Return pairs of floats; OptionError unless `values` are finite pairs."""
    points = np.array(values, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise OptionError(f"{name} has the form {points.shape}: give finite pairs of numbers, in m")
    return tuple((float(x), float(y)) for x, y in points)


def crossing(polygon: Array) -> Array | None:
    """Return a place where edges of the closed `polygon` (n, 2) meet that should not, or None."""
    count, edges = len(polygon), _ends(polygon)
    for some in np.array_split(np.arange(count), math.ceil(count**2 / _AT_ONCE)):
        first, second = np.repeat(some, count), np.tile(np.arange(count), len(some))
        # Neighbours meet, and so do the first edge and the last.
        apart = (second >= first + 2) & (second - first < count - 1)
        place = _meeting(edges, first[apart], edges, second[apart])
        if place is not None:
            return place
    return None


def _meeting(edges: Ends, first: Index, others: Ends, second: Index) -> Array | None:
    """Return the first edge's start where an edge of one set meets one of the other, or None."""
    (a, b), (c, d) = (end[first] for end in edges), (end[second] for end in others)
    turns = [_turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)]
    straddled = (turns[0] * turns[1] <= 0) & (turns[2] * turns[3] <= 0)
    lowest = np.maximum(np.minimum(a, b), np.minimum(c, d))
    highest = np.minimum(np.maximum(a, b), np.maximum(c, d))
    met = np.flatnonzero(straddled & (lowest <= highest).all(axis=1))
    return a[met[0]] if len(met) else None


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
    inside = np.zeros(len(points), bool)
    for a, b in zip(*edges, strict=True):
        spans = (a[1] <= points[:, 1]) != (b[1] <= points[:, 1])
        if spans.any():
            at = a[0] + (points[spans, 1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
            inside[spans] ^= points[spans, 0] < at
    return inside


def edges_of(loops: Loops) -> Ends:
    """Return where the edges of all loops start and end."""
    return np.vstack(loops), np.vstack([np.roll(loop, -1, axis=0) for loop in loops])


def _ends(polygon: Array) -> Ends:
    return edges_of((polygon,))


def distance_to_edges(edges: Ends, points: Array) -> Array:
    """Return the distances of points (K, 2) to the nearest edge (K,)."""
    nearest = np.full(len(points), np.inf)
    for a, b in zip(*edges, strict=True):
        share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
    return nearest


def check_loops(loops: Loops) -> None:
    """Raise MeshError on an outline and holes (n, 2) without an inside."""
    for name, loop in zip(_names(loops), loops, strict=True):
        _check_loop(name, loop)
    for i, name in enumerate(_names(loops)[1:], start=1):
        _check_hole(name, loops[i], loops[:1], loops[1:i])


def _check_loop(name: str, loop: Array) -> None:
    if len(loop) < 3:
        raise MeshError(f"{name} has {len(loop)} corners: give at least 3")
    back, ahead = np.roll(loop, 1, axis=0) - loop, np.roll(loop, -1, axis=0) - loop
    steps = np.linalg.norm(ahead, axis=1)
    if steps.min() <= 1e-9 * np.ptp(loop, axis=0).max():
        raise MeshError(f"{name} repeats corner {place_of(loop[np.argmin(steps)])}: give it once")
    folded = (_turn(np.zeros(2), back, ahead) == 0) & (np.sum(back * ahead, axis=1) > 0)
    if folded.any():
        raise MeshError(f"{name} folds back at {place_of(loop[np.argmax(folded)])}: leave that out")
    place = crossing(loop)
    if place is not None:
        raise MeshError(f"{name} crosses itself near {place_of(place)}: untangle its corners")


def _check_hole(name: str, hole: Array, outline: Loops, others: Loops) -> None:
    for loop in outline + others:
        every = np.arange(len(loop))
        for edge in range(len(hole)):
            place = _meeting(_ends(hole), np.full(len(loop), edge), _ends(loop), every)
            if place is not None:
                raise MeshError(f"{name} touches another edge near {place_of(place)}: move it away")
    if not contains(edges_of(outline), hole[:1])[0]:
        raise MeshError(f"{name} lies outside the outline: move it inside")
    for other in others:
        if contains(_ends(other), hole[:1])[0] or contains(_ends(hole), other[:1])[0]:
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
    middles: Array  # (S, 2): where the outline runs between them: at a corner, or halfway
    sharp: Index  # indices of points at corners under 60 degrees

    @property
    def at_sharp_corner(self) -> Mask:
        """Which edges end at a sharp corner (S,)."""
        return np.any(np.isin(self.ends, self.sharp), axis=1)

    def edges(self, points: Array) -> Ends:
        """Return where the edges start and end (S, 2), (S, 2)."""
        return points[self.ends[:, 0]], points[self.ends[:, 1]]

    def split(self, chosen: Mask, points: Array) -> Boundary:
        """Return the boundary with chosen edges cut at their middles, to be put after `points`."""
        number = len(points) + np.arange(np.count_nonzero(chosen))
        a, b = self.ends[chosen].T
        halves = [np.stack([a, number], axis=1), np.stack([number, b], axis=1)]
        tips = [(points[a] + self.middles[chosen]) / 2, (self.middles[chosen] + points[b]) / 2]
        return replace(
            self,
            ends=np.vstack([self.ends[~chosen], *halves]),
            middles=np.vstack([self.middles[~chosen], *tips]),
        )


_ROUNDS = 60
_POOR = np.radians(25.0)  # smallest angle; Ruppert's rounds end for 20.7 degrees, mostly for 30


def triangulated(loops: Loops, size: float) -> tuple[Array, Index, Boundary]:
    """Triangulate the inside of loops: points (N, 2), triangles (T, 3), boundary."""
    points, boundary = _resampled(loops, size)
    points = np.vstack([points, _lattice_inside(loops, size)])
    for _ in range(_ROUNDS):
        triangles = _inside(points, boundary)
        split, added = ~_present(boundary, triangles), np.zeros((0, 2))
        if not split.any():
            split, added = _repairs(points, triangles, boundary, size)
        if not (split.any() or len(added)):
            break
        middles = boundary.middles[split]
        boundary = boundary.split(split, points)
        points = np.vstack([points, middles, added])
    triangles = _inside(points, boundary)
    if not _present(boundary, triangles).all():
        raise MeshError(
            "the outline has edges too close together or corners too sharp to mesh: "
            "widen the narrowest gap or blunt the sharpest corner"
        )
    return points, triangles, boundary


def _present(boundary: Boundary, triangles: Index) -> Mask:
    return np.isin(keys(boundary.ends), keys(sides(triangles)))


def _resampled(loops: Loops, size: float) -> tuple[Array, Boundary]:
    """Walk the loops in edges of at most `size`, over short edges of a smooth bend in pairs."""
    points, ends, middles, sharp, start = [], [], [], [], 0
    for loop in loops:
        kept, between, pointed = _strides(loop, size)
        number = start + np.arange(len(kept))
        points.append(kept)
        middles.append(between)
        sharp.append(number[pointed])
        ends.append(np.stack([number, np.roll(number, -1)], axis=1))
        start += len(number)
    joined = Boundary(ends=np.vstack(ends), middles=np.vstack(middles), sharp=np.concatenate(sharp))
    return np.vstack(points), joined


_SHARP = np.radians(120.0)  # of turn, so 60 degrees of corner


def _strides(loop: Array, size: float) -> tuple[Array, Array, Mask]:
    """Return where strides along a loop begin, where each is half done, and sharp beginnings."""
    # The first strides from a sharp corner are equally long along both its edges: then neither
    # edge calls for cuts of the other, again and again towards the corner.
    loop = np.roll(loop, -int(np.argmax(_bends(_steps(loop)))), axis=0)
    steps = _steps(loop)
    lengths, sharp = np.linalg.norm(steps, axis=1), _bends(steps) > _SHARP
    equal = sharp * np.minimum(np.minimum(lengths, np.roll(lengths, 1)) / 3, size)
    together = _strides_of_two(steps, sharp, size)
    stops, halves, pointed, edge = [], [], [], 0
    while edge < len(loop):
        if together[edge]:
            at, half = loop[edge : edge + 1], loop[edge + 1 : edge + 2]
        else:
            share = _stops(lengths[edge], equal[edge], equal[edge + 1 - len(loop)], size)
            share = share[:, None] / lengths[edge]
            at = loop[edge] + share[:-1] * steps[edge]
            half = loop[edge] + (share[:-1] + share[1:]) / 2 * steps[edge]
        stops.append(at)
        halves.append(half)
        pointed.append(sharp[edge] & (np.arange(len(at)) == 0))
        edge += 2 if together[edge] else 1
    return np.vstack(stops), np.vstack(halves), np.concatenate(pointed)


def _steps(loop: Array) -> Array:
    return np.roll(loop, -1, axis=0) - loop


def _stops(length: float, first: float, last: float, size: float) -> Array:
    """Return distances from 0 to `length` in steps of `size` at most, first and last step given."""
    inner = length - first - last
    even = np.linspace(first, first + inner, int(np.ceil(inner / size - 1e-9)) + 1)
    return np.concatenate([[0.0] if first else [], even, [length] if last else []])


_BEND = 0.5  # rad; the corner in the middle of a stride leaves its quadrilaterals convex


def _strides_of_two(steps: Array, sharp: Mask, size: float) -> Mask:
    """Return where an edge and the next one are short, alike, nearly in line, off sharp corners."""
    lengths = np.linalg.norm(steps, axis=1)
    following = np.roll(lengths, -1)
    alike = np.maximum(lengths, following) < 2 * np.minimum(lengths, following)
    fitting = (lengths + following <= size) & alike & (np.roll(_bends(steps), -1) < _BEND)
    fitting &= ~(sharp | np.roll(sharp, -2))
    fitting[-1] = False
    return fitting


def _bends(steps: Array) -> Array:
    """Return the absolute angles by which a loop turns at the start of each step, rad."""
    before = np.roll(steps, 1, axis=0)
    cross = before[:, 0] * steps[:, 1] - before[:, 1] * steps[:, 0]
    return np.abs(np.arctan2(cross, np.sum(before * steps, axis=1)))


def _lattice_inside(loops: Loops, size: float) -> Array:
    """Return the points of a square lattice along the outline's longest edge, off the boundary."""
    steps = _steps(loops[0])
    lengths = np.linalg.norm(steps, axis=1)
    x, y = steps[np.argmax((lengths / lengths.max()).round(9))]
    turn = np.array([[x, -y], [y, x]]) / np.hypot(x, y)
    turned = loops[0] @ turn
    low, high = turned.min(axis=0), turned.max(axis=0)
    counts = np.ceil((high - low) / size - 1e-9).astype(int)
    axes = [np.linspace(a, b, n + 1)[1:-1] for a, b, n in zip(low, high, counts, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2) @ turn.T
    points = points[contains(edges_of(loops), points)]
    return points[distance_to_edges(edges_of(loops), points) > 0.6 * size]


def _inside(points: Array, boundary: Boundary) -> Index:
    triangles = Delaunay(points).simplices.astype(np.int64)
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    area = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    triangles[area < 0] = triangles[area < 0][:, ::-1]
    longest = np.max([np.sum(side**2, axis=1) for side in (b - a, c - b, a - c)], axis=0)
    flat = np.abs(area) < 1e-9 * longest
    return triangles[~flat & contains(boundary.edges(points), (a + b + c) / 3)]


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
    at_corner = _between_edges(triangles, boundary, angles.argmin(axis=1))
    centres, radii = _circumcircles(points[triangles])
    poor = ((angles.min(axis=1) < _POOR) & ~at_corner) | (radii > size)
    order = np.flatnonzero(poor)[np.argsort(-radii[poor])]
    centres, radii = centres[order], radii[order]
    a, b = boundary.edges(points)
    gap = np.linalg.norm(centres[:, None] - (a + b) / 2, axis=2)
    encroached = gap < np.linalg.norm(b - a, axis=1) / 2 * (1 - 1e-9)
    free = ~encroached.any(axis=1) & contains((a, b), centres)
    split = encroached.any(axis=0) & ~boundary.at_sharp_corner
    return split, _apart(centres[free], 0.7 * radii[free])


def inner_angles(corners: Array) -> Array:
    """Return the inner angles of convex polygons (K, n, 2): (K, n)."""
    ahead, back = np.roll(corners, -1, axis=1) - corners, np.roll(corners, 1, axis=1) - corners
    cross = ahead[..., 0] * back[..., 1] - ahead[..., 1] * back[..., 0]
    return np.arctan2(cross, np.sum(ahead * back, axis=-1))


def _between_edges(triangles: Index, boundary: Boundary, vertex: Index) -> Mask:
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


def _apart(points: Array, gaps: Array) -> Array:
    """Keep points in order that lie at least their gap away from all points kept before."""
    kept = np.zeros((0, 2))
    for point, gap in zip(points, gaps, strict=True):
        if not len(kept) or np.linalg.norm(kept - point, axis=1).min() > gap:
            kept = np.vstack([kept, point])
    return kept

"""Polygons in the plane: what makes an outline with holes one, and where its inside is."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError, OptionError

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Pairs = Sequence[Sequence[float]] | Array
Loops = tuple[Array, ...]
Ends = tuple[Array, Array]


def as_points(name: str, values: Pairs) -> tuple[tuple[float, float], ...]:
    """Return pairs of floats.

    Raises
    ------
    OptionError
        Unless `values` are finite pairs.
    """
    points = np.array(values, dtype=np.float64)
    if points.ndim != 2 or points.shape[1] != 2 or not np.isfinite(points).all():
        raise OptionError(f"{name} has the form {points.shape}: give finite pairs of numbers, in m")
    return tuple((float(x), float(y)) for x, y in points)


def crossing(polygon: Array) -> Array | None:
    """Return a place where edges of the closed `polygon` (n, 2) meet that should not, or None."""
    count, edges = len(polygon), _ends(polygon)
    for edge in range(count - 2):
        others = np.arange(edge + 2, count - (edge == 0))  # the first and last edge are neighbours
        place = _meeting(edges, np.full(len(others), edge), edges, others)
        if place is not None:
            return place
    return None


def _meeting(edges: Ends, first: Index, others: Ends, second: Index) -> Array | None:
    """Return the first edge's start where an edge of one set meets one of the other, or None."""
    (a, b), (c, d) = (end[first] for end in edges), (end[second] for end in others)
    turns = [_turn(a, b, c), _turn(a, b, d), _turn(c, d, a), _turn(c, d, b)]
    straddled = (turns[0] * turns[1] <= 0) & (turns[2] * turns[3] <= 0)
    lowest, highest = (
        np.maximum(np.minimum(a, b), np.minimum(c, d)),
        np.minimum(np.maximum(a, b), np.maximum(c, d)),
    )
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


def contains(edges: Ends, points: Array) -> NDArray[np.bool_]:
    """Tell which points (K, 2) lie inside an odd number of loops, given by all their edges."""
    inside = np.zeros(len(points), bool)
    for a, b in zip(*edges, strict=True):
        spans = (a[1] <= points[:, 1]) != (b[1] <= points[:, 1])
        if spans.any():
            at = a[0] + (points[spans, 1] - a[1]) / (b[1] - a[1]) * (b[0] - a[0])
            inside[spans] ^= points[spans, 0] < at
    return inside


def _ends(polygon: Array) -> Ends:
    return polygon, np.roll(polygon, -1, axis=0)


def edges_of(loops: Loops) -> Ends:
    """Return where the edges of all loops start and end."""
    return np.vstack(loops), np.vstack([np.roll(loop, -1, axis=0) for loop in loops])


def distance_to_edges(edges: Ends, points: Array) -> Array:
    """Return the distances of points (K, 2) to the nearest edge (K,)."""
    nearest = np.full(len(points), np.inf)
    for a, b in zip(*edges, strict=True):
        share = np.clip((points - a) @ (b - a) / ((b - a) @ (b - a)), 0, 1)
        nearest = np.minimum(nearest, np.linalg.norm(points - a - share[:, None] * (b - a), axis=1))
    return nearest


def check_loops(loops: Loops) -> None:
    """Refuse outlines without an inside.

    Parameters
    ----------
    loops : tuple of arrays (n, 2)
        The outline, then its holes.

    Raises
    ------
    MeshError
        On fewer than three corners, repeated corners, edges that meet, holes outside.
    """
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
        raise MeshError(f"{name} repeats corner {_place(loop[np.argmin(steps)])}: give it once")
    folded = (_turn(np.zeros(2), back, ahead) == 0) & (np.sum(back * ahead, axis=1) > 0)
    if folded.any():
        raise MeshError(f"{name} folds back at {_place(loop[np.argmax(folded)])}: leave that out")
    place = crossing(loop)
    if place is not None:
        raise MeshError(f"{name} crosses itself near {_place(place)}: untangle its corners")


def _check_hole(name: str, hole: Array, outline: Loops, others: Loops) -> None:
    for loop in outline + others:
        every = np.arange(len(loop))
        for edge in range(len(hole)):
            place = _meeting(_ends(hole), np.full(len(loop), edge), _ends(loop), every)
            if place is not None:
                raise MeshError(f"{name} touches another edge near {_place(place)}: move it away")
    if not contains(edges_of(outline), hole[:1])[0]:
        raise MeshError(f"{name} lies outside the outline: move it inside")
    for other in others:
        if contains(_ends(other), hole[:1])[0] or contains(_ends(hole), other[:1])[0]:
            raise MeshError(f"{name} overlaps another hole: give one hole for both")


def _names(loops: Loops) -> list[str]:
    return ["the outline", *(f"hole {i + 1}" for i in range(len(loops) - 1))]


def _place(point: Array) -> str:
    return f"({point[0]:.6g}, {point[1]:.6g}) m"

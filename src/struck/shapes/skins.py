"""Closed surfaces of flat bodies: a plan, its twin below, and the rims between."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np

from struck.model.arrays import Array, Index
from struck.model.mesh import Mesh
from struck.shapes.shape import INSET, places_on

# Plans of disks and rings: triangles between circles, and places by name.

_FEWEST_AROUND = 12


def disk(radius: float, spacing: float) -> tuple[Array, Index]:
    """Return points (N, 2) and counter-clockwise triangles (T, 3) of a disk around the origin.

    Vertices lie about `spacing` m apart, the outer ones on the circle.
    """
    steps = max(2, math.ceil(radius / spacing))
    radii = radius * np.arange(1, steps + 1) / steps
    points, triangles = _between(radii, _around(radii, spacing))
    first = np.arange(_around(radii[:1], spacing)[0])
    fan = np.column_stack([np.zeros_like(first), first + 1, np.roll(first, -1) + 1])
    return np.vstack([np.zeros((1, 2)), points]), np.vstack([fan, triangles + 1])


def annulus(radius: float, hole: float, spacing: float) -> tuple[Array, Index]:
    """Return points (N, 2) and counter-clockwise triangles (T, 3) of a ring around the origin."""
    steps = math.ceil((radius - hole) / spacing)
    radii = np.linspace(hole, radius, max(2, steps) + 1)
    counts = _around(radii, spacing)
    if steps < 2:  # chords of unequal polygons might cross
        counts[:] = counts.max()
    return _between(radii, counts)


def places_on_disk(radius: float, hole: float, thickness: float) -> Mapping[str, Array]:
    """Return contacts on a disk or ring by name, at y = 0.

    "middle" (also "top") of the disk, or between the edges of the ring; "quarter" of its breadth
    from the edge; "edge" (also "rim") 1 % off it.
    """
    if hole == 0:
        distances = {"middle": 0.0, "quarter": radius / 2, "edge": radius * (1 - INSET)}
    else:
        breadth = radius - hole
        inward = {"middle": 0.5, "quarter": 0.25, "edge": INSET}
        distances = {name: radius - share * breadth for name, share in inward.items()}
    distances |= {"top": distances["middle"], "rim": distances["edge"]}
    return places_on({name: (x, 0.0) for name, x in distances.items()}, thickness)


def _around(radii: Array, spacing: float) -> Index:
    return np.maximum(_FEWEST_AROUND, np.ceil(2 * np.pi * radii / spacing)).astype(np.int64)


def _between(radii: Array, counts: Index) -> tuple[Array, Index]:
    """Return points on circles and the triangles between each and the next."""
    starts = np.append(0, np.cumsum(counts))
    points = np.vstack([_circle(r, n) for r, n in zip(radii, counts, strict=True)])
    triangles = [_belt(*counts[i : i + 2], *starts[i : i + 2]) for i in range(len(radii) - 1)]
    return points, np.vstack(triangles)


def _circle(radius: float, count: int) -> Array:
    angles = 2 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def _belt(inner: int, outer: int, inner_start: int, outer_start: int) -> Index:
    """Return the triangles between two circles whose points start at the same angle.

    Each edge of one circle meets that point of the other which is reached at its middle when one
    walks around both: fractions of a turn are compared as whole numbers.
    """
    i, j = np.arange(inner), np.arange(outer)
    # How many middles of outer edges come before that of each inner edge, and the reverse.
    apex_outside = -((outer * (2 * i + 1) - inner) // (-2 * inner)) % outer
    apex_inside = ((inner * (2 * j + 1) - outer) // (2 * outer) + 1) % inner
    inward = [i + inner_start, apex_outside + outer_start, (i + 1) % inner + inner_start]
    outward = [j + outer_start, (j + 1) % outer + outer_start, apex_inside + inner_start]
    return np.vstack([np.column_stack(inward), np.column_stack(outward)])


# Closed surfaces of round bars: rods and tubes along x.

_AROUND = 24


def sleeve(
    length: float, radius: float, bore: float, spacing: float, *, around: int = _AROUND
) -> Mesh:
    """Return the surface of a rod or tube along x from 0 to `length` m.

    Parameters
    ----------
    length, radius : float
        m.
    bore : float
        Inner radius of a tube, m; 0 makes a rod with flat ends.
    spacing : float
        About how far apart vertices lie along x, m.
    around : int
        Sides of the polygon, one vertex of which points up; it has the area of the circle, so
        that the body keeps its volume.
    """
    x = np.linspace(0, length, max(2, int(np.ceil(length / spacing))) + 1)
    sides = np.arange(len(x) * around).reshape(len(x), around)
    outer, outside = _tube(x, radius, sides)
    if bore:
        inner, inside = _tube(x, bore, sides + sides.size)
        first, last = (_sleeves_between(sides[k], sides[k] + sides.size) for k in (0, -1))
        ends = [first, last[:, ::-1]]
        return _joined([outer, inner], [outside, inside[:, ::-1], *ends])
    middles = np.array([[0, 0, 0], [length, 0, 0]], dtype=float)
    first, last = (_fan(sides[k], sides.size + number) for number, k in enumerate((0, -1)))
    return _joined([outer, middles], [outside, first, last[:, ::-1]])


def _joined(points: list[Array], faces: list[Index]) -> Mesh:
    return Mesh(points=np.vstack(points), faces=np.vstack(faces))


def _tube(x: Array, radius: float, numbers: Index) -> tuple[Array, Index]:
    """Return points and outward triangles of a cylinder's mantle."""
    around = numbers.shape[1]
    angles = 2 * np.pi * np.arange(around) / around
    reach = radius * np.sqrt(angles[1] / np.sin(angles[1]))
    points = np.empty((len(x), around, 3))
    points[..., 0] = x[:, None]
    points[..., 1] = reach * np.sin(angles)
    points[..., 2] = reach * np.cos(angles)
    rings = [_sleeves_between(second, first) for first, second in itertools.pairwise(numbers)]
    return points.reshape(-1, 3), np.vstack(rings)


def _sleeves_between(first: Index, second: Index) -> Index:
    """Return the triangles between two rings of as many vertices."""
    following, across = np.roll(first, -1), np.roll(second, -1)
    halves = [np.column_stack([first, following, across]), np.column_stack([first, across, second])]
    return np.vstack(halves)


def _fan(ring: Index, middle: int) -> Index:
    return np.column_stack([ring, np.roll(ring, -1), np.full(len(ring), middle)])


def slab(points: Array, triangles: Index, thickness: float) -> Mesh:
    """Return the surface of a plate.

    Parameters
    ----------
    points : array (N, 2)
        Of its plan, m.
    triangles : array (T, 3)
        Of the plan, counter-clockwise; open edges become rims.
    thickness : float
        m, half of it above the plan.
    """
    count = len(points)
    heights = np.repeat([thickness / 2, -thickness / 2], count)
    both = np.column_stack([np.vstack([points, points]), heights])
    start, end = rim(triangles).T
    walls = np.vstack(
        [
            np.column_stack([start, start + count, end + count]),
            np.column_stack([start, end + count, end]),
        ]
    )
    return Mesh(points=both, faces=np.vstack([triangles, triangles[:, ::-1] + count, walls]))


def rim(triangles: Index) -> Index:
    """Return the edges (E, 2) that one triangle alone has, in its sense of rotation."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, kinds, counts = np.unique(
        np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return edges[counts[kinds.ravel()] == 1]


def rectangle(
    length: float, width: float, spacing: float, *, corner: tuple[float, float] = (0.0, 0.0)
) -> tuple[Array, Index]:
    """Return points (N, 2) and triangles (T, 3) of a rectangle from its lower left corner on."""
    x = corner[0] + np.linspace(0, length, _steps(length, spacing) + 1)
    y = corner[1] + np.linspace(0, width, _steps(width, spacing) + 1)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    numbers = np.arange(len(points)).reshape(len(x), len(y))
    squares = [numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:]]
    first, second, third, fourth = (part.ravel() for part in squares)
    halves = [np.column_stack([first, second, third]), np.column_stack([first, third, fourth])]
    return points, np.vstack(halves)


def _steps(length: float, spacing: float) -> int:
    return max(2, int(np.ceil(length / spacing)))

"""Plans of disks and rings: triangles between circles, and places by name."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from struck.shapes.plans import INSET, places_on

Array = NDArray[np.float64]
Index = NDArray[np.int64]

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

"""Geometry of slender and of flat bodies: their closed surfaces, and places on them by name."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

import numpy as np

from struck.model.arrays import Array, Index
from struck.model.mesh import Mesh

# Places near an edge stand off it by this share.
INSET = 0.01
_MIN_CIRCLE_VERTICES = 12  # vertices of the circles of a disk
_ROD_VERTICES = 24  # of those of a rod


@dataclass(frozen=True, slots=True, kw_only=True)
class Rod:
    """A body along x from 0 to its length, its middle line at z = 0."""

    length: float  # m
    area: float  # of its section, m^2
    height: float  # from bottom to top, m
    mantle: Callable[[float, float], Mesh]  # closed surface by length and spacing, m

    @property
    def volume(self) -> float:
        """Volume of the body, m^3."""
        return self.area * self.length

    @property
    def extent(self) -> float:
        """Length of the string, bar or tube, m."""
        return self.length

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts on the top: "middle" (also "top"), "quarter" of the length, and "end"."""
        positions = {"top": 0.5, "middle": 0.5, "quarter": 0.25, "end": 1 - INSET}
        return _place_on_top(
            {name: (u * self.length, 0.0) for name, u in positions.items()}, self.height
        )

    def skin(self, spacing: float) -> Mesh:
        """Return the rod's closed surface with vertices about `spacing` m apart along x."""
        return self.mantle(self.length, spacing)


class Plan(Protocol):
    """A region in the plane of x and y."""

    @property
    def area(self) -> float:
        """Area of the region, m^2."""
        ...

    @property
    def extent(self) -> float:
        """Longest edge or diameter of the region, m."""
        ...

    def marks(self) -> Mapping[str, tuple[float, float]]:
        """Return the region's places by name, m."""
        ...

    def triangulate(self, spacing: float) -> tuple[Array, Index]:
        """Return points (N, 2) and counter-clockwise triangles (T, 3) that fill it."""
        ...


@dataclass(frozen=True, slots=True)
class Sheet:
    """A flat body: a plan of constant thickness, m, whose middle plane is z = 0."""

    plan: Plan
    thickness: float

    @property
    def volume(self) -> float:
        """Volume of the body, m^3."""
        return self.plan.area * self.thickness

    @property
    def extent(self) -> float:
        """Longest edge or diameter of the plan, m."""
        return self.plan.extent

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts on the top by name, m (3,)."""
        return _place_on_top(self.plan.marks(), self.thickness)

    def skin(self, spacing: float) -> Mesh:
        """Return the sheet's closed surface with vertices about `spacing` m apart over the plan."""
        return slab(*self.plan.triangulate(spacing), self.thickness)


@dataclass(frozen=True, slots=True)
class Rectangle:
    """A rectangle from the origin to (length, width), m."""

    length: float
    width: float

    @property
    def area(self) -> float:
        """Area of the rectangle, m^2."""
        return self.length * self.width

    @property
    def extent(self) -> float:
        """Longest edge of the rectangle, m."""
        return max(self.length, self.width)

    def marks(self) -> Mapping[str, tuple[float, float]]:
        """Return the rectangle's places by name, m."""
        positions = {"top": (0.5, 0.5), "middle": (0.5, 0.5), "quarter": (0.25, 0.25)}
        positions |= {"edge": (1 - INSET, 0.5), "corner": (1 - INSET, 1 - INSET)}
        return {name: (u * self.length, v * self.width) for name, (u, v) in positions.items()}

    def triangulate(self, spacing: float) -> tuple[Array, Index]:
        """Return points (N, 2) and counter-clockwise triangles (T, 3) that fill it."""
        return rectangle(self.length, self.width, spacing)


@dataclass(frozen=True, slots=True)
class Disk:
    """A disk around the origin, or a ring where it has a round hole; radii in m."""

    radius: float
    hole: float = 0.0

    @property
    def area(self) -> float:
        """Area of the disc or ring, m^2."""
        return math.pi * (self.radius**2 - self.hole**2)

    @property
    def extent(self) -> float:
        """Outer diameter of the disc or ring, m."""
        return 2 * self.radius

    def marks(self) -> Mapping[str, tuple[float, float]]:
        """Return the disc's places by name, m, at y = 0."""
        insets = {"middle": 0.5, "quarter": 0.25} if self.hole else {"middle": 1.0, "quarter": 0.5}
        insets |= {"edge": INSET, "top": insets["middle"], "rim": INSET}
        breadth = self.radius - self.hole
        return {name: (self.radius - inset * breadth, 0.0) for name, inset in insets.items()}

    def triangulate(self, spacing: float) -> tuple[Array, Index]:
        """Return points (N, 2) and counter-clockwise triangles (T, 3) that fill it."""
        return self._triangulate_ring(spacing) if self.hole else self._triangulate_disk(spacing)

    def _triangulate_disk(self, spacing: float) -> tuple[Array, Index]:
        steps = max(2, math.ceil(self.radius / spacing))
        radii = self.radius * np.arange(1, steps + 1) / steps
        points, triangles = _triangulate_circles(radii, _counts_around(radii, spacing))
        first = np.arange(_counts_around(radii[:1], spacing)[0])
        fan = np.column_stack([np.zeros_like(first), first + 1, np.roll(first, -1) + 1])
        return np.vstack([np.zeros((1, 2)), points]), np.vstack([fan, triangles + 1])

    def _triangulate_ring(self, spacing: float) -> tuple[Array, Index]:
        steps = math.ceil((self.radius - self.hole) / spacing)
        radii = np.linspace(self.hole, self.radius, max(2, steps) + 1)
        counts = _counts_around(radii, spacing)
        if steps < 2:  # chords of unequal polygons might cross
            counts[:] = counts.max()
        return _triangulate_circles(radii, counts)


def _place_on_top(plan: Mapping[str, tuple[float, float]], height: float) -> Mapping[str, Array]:
    """Return contacts (3,), m, half the height above places in the plan."""
    places = {name: np.array([x, y, height / 2]) for name, (x, y) in plan.items()}
    for place in places.values():
        place.setflags(write=False)
    return MappingProxyType(places)


def _counts_around(radii: Array, spacing: float) -> Index:
    return np.maximum(_MIN_CIRCLE_VERTICES, np.ceil(2 * np.pi * radii / spacing)).astype(np.int64)


def _triangulate_circles(radii: Array, counts: Index) -> tuple[Array, Index]:
    """Return points on circles and the triangles between each and the next."""
    start_indices = np.append(0, np.cumsum(counts))
    points = np.vstack([_circle(r, n) for r, n in zip(radii, counts, strict=True)])
    triangles = [
        _belt(*counts[i : i + 2], *start_indices[i : i + 2]) for i in range(len(radii) - 1)
    ]
    return points, np.vstack(triangles)


def _circle(radius: float, count: int) -> Array:
    angles = 2 * np.pi * np.arange(count) / count
    return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def _belt(inner: int, outer: int, inner_start: int, outer_start: int) -> Index:
    """Return the triangles between two circles whose points start at the same angle."""
    # Each edge of one circle meets that point of the other which is reached at its middle when
    # one walks around both: fractions of a turn are compared as whole numbers.
    i, j = np.arange(inner), np.arange(outer)
    # Number of midpoints of outer edges before that of each inner edge, and the reverse.
    outer_apexes = -((outer * (2 * i + 1) - inner) // (-2 * inner)) % outer
    inner_apexes = ((inner * (2 * j + 1) - outer) // (2 * outer) + 1) % inner
    inner_triangles = [i + inner_start, outer_apexes + outer_start, (i + 1) % inner + inner_start]
    outer_triangles = [j + outer_start, (j + 1) % outer + outer_start, inner_apexes + inner_start]
    return np.vstack([np.column_stack(inner_triangles), np.column_stack(outer_triangles)])


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


def slab(points: Array, triangles: Index, thickness: float) -> Mesh:
    """Return the surface of a plate with its middle plane at z = 0: two faces, and their rims.

    The plan has points (N, 2), m, and counter-clockwise triangles (T, 3).
    """
    count = len(points)
    heights = np.repeat([thickness / 2, -thickness / 2], count)
    vertices = np.column_stack([np.vstack([points, points]), heights])
    start, end = _rim(triangles).T
    walls = np.vstack(
        [
            np.column_stack([start, start + count, end + count]),
            np.column_stack([start, end + count, end]),
        ]
    )
    return Mesh(points=vertices, faces=np.vstack([triangles, triangles[:, ::-1] + count, walls]))


def _rim(triangles: Index) -> Index:
    """Return the edges (E, 2) that one triangle alone has, in its sense of rotation."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, kinds, counts = np.unique(
        np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return edges[counts[kinds.ravel()] == 1]


def sleeve(
    length: float, radius: float, bore: float, spacing: float, *, vertex_count: int = _ROD_VERTICES
) -> Mesh:
    """Return the surface of a rod along x, or of a tube where the `bore` (inner radius) is not 0.

    Its polygon, one vertex of which points up, has the area of the circle, so that the body keeps
    its volume.
    """
    x = np.linspace(0, length, _steps(length, spacing) + 1)
    sides = np.arange(len(x) * vertex_count).reshape(len(x), vertex_count)
    outer, outer_triangles = _tube(x, radius, sides)
    if bore:
        inner, inner_triangles = _tube(x, bore, sides + sides.size)
        first, last = (_triangulate_rings(sides[k], sides[k] + sides.size) for k in (0, -1))
        parts = [outer, inner], [outer_triangles, inner_triangles[:, ::-1], first, last[:, ::-1]]
    else:
        centres = np.array([[0, 0, 0], [length, 0, 0]], dtype=float)
        caps = [
            np.column_stack(
                [sides[k], np.roll(sides[k], -1), np.full(vertex_count, sides.size + number)]
            )
            for number, k in enumerate((0, -1))
        ]
        parts = [outer, centres], [outer_triangles, caps[0], caps[1][:, ::-1]]
    return Mesh(points=np.vstack(parts[0]), faces=np.vstack(parts[1]))


def _tube(x: Array, radius: float, numbers: Index) -> tuple[Array, Index]:
    """Return points and outward triangles of a cylinder's mantle."""
    vertex_count = numbers.shape[1]
    angles = 2 * np.pi * np.arange(vertex_count) / vertex_count
    reach = radius * np.sqrt(angles[1] / np.sin(angles[1]))
    points = np.empty((len(x), vertex_count, 3))
    points[..., 0] = x[:, None]
    points[..., 1] = reach * np.sin(angles)
    points[..., 2] = reach * np.cos(angles)
    rings = [_triangulate_rings(second, first) for first, second in itertools.pairwise(numbers)]
    return points.reshape(-1, 3), np.vstack(rings)


def _triangulate_rings(first: Index, second: Index) -> Index:
    """Return the triangles between two rings of as many vertices."""
    following, next_second = np.roll(first, -1), np.roll(second, -1)
    halves = [
        np.column_stack([first, following, next_second]),
        np.column_stack([first, next_second, second]),
    ]
    return np.vstack(halves)

"""A simple polygon as a plan: triangulations with elements, ears, and nodes for integrals.

Quadratic elements conform, so their eigenvalues bound the true ones from above, one by one.
Crouzeix-Raviart elements do not; corrected by their size, theirs bound the true ones from below
(Carstensen & Gedicke 2014; Liu 2015). Counted by inertia, one such bound proves that no more
eigenvalues than those found lie below a value. Ears keep angles continuous inside the polygon.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from struck.model.arrays import Array, Index
from struck.model.provenance import Progress, silent
from struck.shapes.skins import INSET
from struck.solids.fem.factorisation import Factoriser
from struck.solids.fem.lanczos import Mass, block_lanczos
from struck.solids.polygon_mesh import (
    contains,
    distance_to_edges,
    edges_of,
    sides,
    signed_area,
    triangulate,
)

# Liu 2015: the Crouzeix-Raviart interpolation error in L2 is at most this times the longest edge
# times its error in the gradient.
_INTERPOLATION = 0.1893
_SLICE_SIZE = 120  # eigenvalues a slice


class Triangulation:
    """Triangles (T, 3), counter-clockwise, between points (N, 2), m, that fill a polygon."""

    def __init__(self, points: Array, triangles: Index) -> None:
        self.points = points
        self.triangles = triangles

    @classmethod
    def of(cls, corners: Array, longest: float) -> Triangulation:
        """Fill a polygon (n, 2) with triangles whose edges are at most `longest` m.

        A coarse triangulation is halved: that is quicker, and keeps its angles.
        """
        times = max(
            0, round(np.log2(float(np.ptp(corners, axis=0).max()) / longest / _COARSE_EDGES))
        )
        size = 2**times * longest / np.sqrt(2)
        while True:
            filling = cls(*triangulate((corners,), size)[:2])
            length_ratio = filling.longest / (2**times * longest)
            if length_ratio <= 1:
                break
            size *= 0.97 / length_ratio
        for _ in range(times):
            filling = filling.halve()
        return filling

    @cached_property
    def _edges(self) -> tuple[Index, Index, NDArray[np.bool_]]:
        """Edges (E, 2), numbers of edges opposite corners (T, 3), and mask of inner ones (E,)."""
        all_sides = np.sort(sides(self.triangles), axis=2)[:, [1, 2, 0]]
        edges, numbers, counts = np.unique(
            all_sides.reshape(-1, 2), axis=0, return_inverse=True, return_counts=True
        )
        return edges, numbers.reshape(-1, 3), counts == 2

    @property
    def longest(self) -> float:
        """Length of the longest edge, m."""
        start, end = np.moveaxis(self.points[self._edges[0]], 1, 0)
        return float(np.linalg.norm(end - start, axis=1).max())

    def halve(self) -> Triangulation:
        """Cut each triangle into four congruent ones."""
        edges, opposite_edges, _ = self._edges
        a, b, c = self.triangles.T
        p, q, r = (opposite_edges + len(self.points)).T
        parts = [np.stack(part, axis=1) for part in ((a, r, q), (r, b, p), (q, p, c), (p, q, r))]
        return Triangulation(
            np.vstack([self.points, self.points[edges].mean(axis=1)]), np.vstack(parts)
        )

    @cached_property
    def _gradients(self) -> tuple[Array, Array]:
        """Return gradients of the area coordinates (T, 3, 2) and areas (T,)."""
        corners = self.points[self.triangles]
        edge_vectors = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
        doubled_areas = (
            edge_vectors[:, 0, 0] * edge_vectors[:, 1, 1]
            - edge_vectors[:, 0, 1] * edge_vectors[:, 1, 0]
        )
        inwards = np.stack([-edge_vectors[..., 1], edge_vectors[..., 0]], axis=2)
        return inwards / doubled_areas[:, None, None], doubled_areas / 2

    def assemble_quadratic(self) -> Pencil:
        """Return the matrices of six-node triangles, held along the boundary."""
        slopes, areas = self._gradients
        edges, opposite_edges, is_inner = self._edges
        numbers = np.hstack([self.triangles, len(self.points) + opposite_edges])
        node_gradients = np.einsum("qni,tid->tqnd", _RISES, slopes)
        stiffness = np.einsum("t,tqnd,tqmd->tnm", areas / 3, node_gradients, node_gradients)
        is_free = np.ones(len(self.points) + len(edges), bool)
        is_free[edges[~is_inner]] = False
        is_free[len(self.points) :] = is_inner
        return Pencil.of(numbers, is_free, stiffness, areas[:, None, None] * _QUADRATIC_MASS)

    def assemble_nonconforming(self) -> Pencil:
        """Return the matrices of Crouzeix-Raviart elements, held along the boundary."""
        slopes, areas = self._gradients
        _, opposite_edges, is_inner = self._edges
        stiffness = 4 * areas[:, None, None] * (slopes @ np.swapaxes(slopes, 1, 2))
        return Pencil.of(opposite_edges, is_inner, stiffness, areas[:, None, None] * np.eye(3) / 3)

    @property
    def slack(self) -> float:
        """Bound of how far a true eigenvalue lies below a Crouzeix-Raviart one, m^2 (Liu 2015).

        lambda >= raviart / (1 + slack * raviart).
        """
        return (_INTERPOLATION * self.longest) ** 2


def edge_for(slack: float) -> float:
    """Return the longest edge that a triangulation of some slack, m^2, may have, m."""
    return float(np.sqrt(slack)) / _INTERPOLATION


_COARSE_EDGES = 12  # edges along the extent
# Derivatives of the six quadratic shape functions by area coordinates, at the three mid-sides.
_CORNERS = np.eye(3)
_MIDPOINTS = (1 - _CORNERS) / 2
_RISES = np.array(
    [
        [(4 * at[i] - 1) * _CORNERS[i] for i in range(3)]
        + [4 * (at[j] * _CORNERS[k] + at[k] * _CORNERS[j]) for j, k in ((1, 2), (2, 0), (0, 1))]
        for at in _MIDPOINTS
    ]
)
_QUADRATIC_MASS = (
    np.block(
        [
            [7 * np.eye(3) - np.ones((3, 3)), -4 * np.eye(3)],
            [-4 * np.eye(3), 16 * np.eye(3) + 16 * np.ones((3, 3))],
        ]
    )
    / 180
)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pencil:
    """Stiffness and mass matrix of a membrane under unit tension and of unit density."""

    stiffness: sparse.csc_matrix
    mass: sparse.csc_matrix
    factorise: Factoriser

    @classmethod
    def of(
        cls, numbers: Index, is_free: NDArray[np.bool_], stiffness: Array, mass: Array
    ) -> Pencil:
        """Add up element matrices (T, n, n) over node numbers (T, n), without nodes not free."""
        rows = np.repeat(numbers, numbers.shape[1], axis=1).ravel()
        columns = np.tile(numbers, (1, numbers.shape[1])).ravel()
        shape = (len(is_free), len(is_free))
        matrices = [
            sparse.coo_matrix((part.ravel(), (rows, columns)), shape=shape).tocsc()[is_free][
                :, is_free
            ]
            for part in (stiffness, mass)
        ]
        return cls(stiffness=matrices[0], mass=matrices[1], factorise=Factoriser())

    def count(self, value: float) -> int:
        """Return how many eigenvalues lie below a value: the inertia of K - value M."""
        return self.factorise(self._shift(value)).negative

    def find_below(self, value: float, progress: Progress = silent) -> Array:
        """Return all eigenvalues below a value, ascending; counted by inertia, none is missed."""
        total_count = self.count(value)
        ends = value * np.linspace(0, 1, -(-total_count // _SLICE_SIZE) + 1)
        counts = [0, *(self.count(end) for end in ends[1:-1]), total_count]
        slices = zip(ends[:-1], ends[1:], counts[:-1], counts[1:], strict=True)
        parts = [np.zeros(0)]
        for number, limits in enumerate(slices):
            progress(
                "finding about where the modes lie", number * _SLICE_SIZE / max(total_count, 1)
            )
            parts.append(self._slice(*limits))
        return np.concatenate(parts)

    def _slice(self, low: float, high: float, low_count: int, up_to: int) -> Array:
        """Return the eigenvalues between two values with known numbers of eigenvalues below."""
        shift = (low + high) / 2
        factor = self.factorise(self._shift(shift))
        if up_to == low_count:
            return np.zeros(0)
        pairs = block_lanczos(
            factor.solve,
            cast("Mass", self.mass),  # only multiplies
            shift,
            up_to - factor.negative,
            np.zeros((self.mass.shape[0], 0)),
            below=factor.negative - low_count,
        )
        return pairs.values

    def _shift(self, value: float) -> sparse.csc_matrix:
        return sparse.tril(self.stiffness - value * self.mass, format="csc")


_SMALLEST_BEND = 1e-12  # rad
_GRID = 61  # points per side of the search for the deepest place
_INTEGER_TOLERANCE = 1e-9  # how near to a whole number pi / angle counts as one


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Polygon:
    """Simple polygon, cut into ears."""

    corners: Array  # (n, 2), counter-clockwise, without angles of pi, m
    ears: Index  # (n - 2, 3), triangles between corners, counter-clockwise, which fill the polygon
    # (n, n - 2), angles at which corners see the ears' centroids, from the edge that leaves the
    # corner, followed through the inside; in a spiral they exceed 2 pi
    bearings: Array

    @property
    def area(self) -> float:
        """Area of the polygon, m^2."""
        return signed_area(self.corners)

    @property
    def extent(self) -> float:
        """Longer side of the polygon's bounding box, m."""
        return float(np.ptp(self.corners, axis=0).max())

    def marks(self) -> Mapping[str, tuple[float, float]]:
        """Return places by name, m: deep inside the polygon, and 1 % of the extent off edges."""
        top, edge = _find_deepest_point(self.corners), int(np.argmax(self.lengths))
        midpoint = (self.corners[edge] + self.corners[(edge + 1) % len(self.corners)]) / 2
        corner = self.corners[np.argmax(np.linalg.norm(self.corners - top, axis=1))]
        inner_places = {
            "edge": _find_inner_place(self, midpoint),
            "corner": _find_inner_place(self, corner),
        }
        places = {"top": top, "middle": top, **inner_places}
        return {name: (float(x), float(y)) for name, (x, y) in places.items()}

    def triangulate(self, spacing: float) -> tuple[Array, Index]:
        """Return points (N, 2) and counter-clockwise triangles (T, 3) that fill it."""
        return triangulate((self.corners,), spacing)[:2]

    @property
    def lengths(self) -> Array:
        """Lengths of the edges that leave the corners (n,), m."""
        return np.linalg.norm(self._leaving, axis=1)

    @property
    def angles(self) -> Array:
        """Inner angles of the polygon (n,), rad."""
        return inner_angles(self.corners)

    @property
    def powers(self) -> Array:
        """Pi over each inner angle: along the edges, solutions rise with multiples of these."""
        return np.pi / self.angles

    @property
    def singular(self) -> Index:
        """Corners where solutions are not smooth: pi / angle is no whole number."""
        return np.flatnonzero(np.abs(self.powers - np.round(self.powers)) > _INTEGER_TOLERANCE)

    @property
    def reaches(self) -> Array:
        """Distances from each corner to the farthest other (n,), m."""
        return np.linalg.norm(self.corners[:, None] - self.corners, axis=2).max(axis=1)

    @property
    def clearances(self) -> Array:
        """Distances from each corner to its neighbours and to the other edges (n,), m."""
        distances, count = np.minimum(self.lengths, np.roll(self.lengths, 1)), len(self.corners)
        for corner, place in enumerate(self.corners):
            others = (corner + np.arange(1, count - 1)) % count
            edges = self.corners[others], self.corners[(others + 1) % count]
            distances[corner] = min(distances[corner], distance_to_edges(edges, place[None])[0])
        return distances

    @property
    def _leaving(self) -> Array:
        return np.roll(self.corners, -1, axis=0) - self.corners

    def place_on_edge(self, edge: int, fractions: Array) -> tuple[Array, Array]:
        """Return points (K, 2) at shares of the way along an edge, and its outward normal (2,)."""
        edge_vector = self._leaving[edge]
        outwards = np.array([edge_vector[1], -edge_vector[0]]) / np.linalg.norm(edge_vector)
        return self.corners[edge] + fractions[:, None] * edge_vector, outwards

    def find_nearest_edges(self, points: Array) -> Index:
        """Return the edges that points (K, 2) are nearest to (K,)."""
        return np.linalg.norm(points[:, None] - self._feet(points), axis=2).argmin(axis=1)

    def ear_of_edge(self, edge: int) -> int:
        """Return the ear along which an edge runs."""
        is_along = np.isin(self.ears, [edge, (edge + 1) % len(self.corners)]).sum(axis=1) == 2
        return int(np.flatnonzero(is_along)[0])

    def locate(self, points: Array) -> tuple[Array, Index]:
        """Return points (K, 2), moved to the nearest edge if outside, and their ears (K,)."""
        ears, depths = self._find_deepest_ear(points)
        is_outside = depths < 0
        points = points.copy()
        feet = self._feet(points[is_outside])
        points[is_outside] = feet[np.arange(len(feet)), self.find_nearest_edges(points[is_outside])]
        ears[is_outside] = self._find_deepest_ear(points[is_outside])[0]
        return points, ears

    def polar(self, corner: int, points: Array, ears: Index) -> tuple[Array, Array]:
        """Return distances and continuous angles (K,) of points in ears, seen from a corner."""
        centroid = self.corners[self.ears].mean(axis=1) - self.corners[corner]
        vectors = points - self.corners[corner]
        angles, ear_angles = (np.arctan2(at[:, 1], at[:, 0]) for at in (vectors, centroid))
        differences = (angles - ear_angles[ears] + np.pi) % (2 * np.pi) - np.pi
        return np.linalg.norm(vectors, axis=1), self.bearings[corner][ears] + differences

    def _find_deepest_ear(self, points: Array) -> tuple[Index, Array]:
        """Return the ear in which each point lies deepest, and how deep."""
        depths = np.full((len(points), len(self.ears)), np.inf)
        for start, end in ((0, 1), (1, 2), (2, 0)):
            a, b = self.corners[self.ears[:, start]], self.corners[self.ears[:, end]]
            height = cross(b - a, points[:, None] - a) / np.linalg.norm(b - a, axis=1)
            depths = np.minimum(depths, height)
        return depths.argmax(axis=1), depths.max(axis=1)

    def _feet(self, points: Array) -> Array:
        """Return the points on all edges that are nearest to points: (K, n, 2)."""
        steps = self._leaving
        fractions = np.einsum("kei,ei->ke", points[:, None] - self.corners, steps)
        fractions = np.clip(fractions / np.sum(steps**2, axis=1), 0, 1)
        return self.corners + fractions[..., None] * steps


def plan_of(corners: Array) -> Polygon:
    """Return the plan of a simple polygon (n, 2) given in either direction round."""
    corners = corners if signed_area(corners) > 0 else corners[::-1]
    corners = corners[np.abs(inner_angles(corners) - np.pi) > _SMALLEST_BEND]
    ears = _cut_ears(corners)
    return Polygon(corners=corners, ears=ears, bearings=_bearings(corners, ears))


def cross(first: Array, second: Array) -> Array:
    """Return the cross products of plane vectors (..., 2)."""
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def inner_angles(corners: Array) -> Array:
    """Return the angles inside a counter-clockwise polygon (n, 2), rad: up to 2 pi."""
    next_vectors, previous_vectors = (
        np.roll(corners, -1, axis=0) - corners,
        np.roll(corners, 1, axis=0) - corners,
    )
    return np.arctan2(
        cross(next_vectors, previous_vectors), np.sum(next_vectors * previous_vectors, axis=1)
    ) % (2 * np.pi)


def _cut_ears(corners: Array) -> Index:
    """Cut off the roundest ear, again and again (Meisters 1975: there always is one)."""
    left, ears = list(range(len(corners))), []
    while len(left) > 3:
        triples = np.stack([np.roll(left, 1), left, np.roll(left, -1)], axis=1)
        roundness = [_roundness(corners, triple, left) for triple in triples]
        best_index = int(np.argmax(roundness))
        ears.append(triples[best_index])
        left.pop(best_index)
    return np.array([*ears, left], dtype=np.int64)


def _roundness(corners: Array, triple: Index, left: list[int]) -> float:
    """Return how round an ear is, 0 where none can be cut off."""
    a, b, c = corners[triple]
    area = float(cross(b - a, c - a))
    others = corners[np.setdiff1d(left, triple)]
    sides = ((a, b), (b, c), (c, a))
    is_inside = np.all([cross(end - start, others - start) >= 0 for start, end in sides], axis=0)
    return 0.0 if area <= 0 or is_inside.any() else area / max(sum((q - p) ** 2) for p, q in sides)


def _bearings(corners: Array, ears: Index) -> Array:
    """Follow the angles at which each corner sees the ears, from ear to ear across their sides."""
    bearings = np.zeros((len(corners), len(ears)))
    leaving = np.roll(corners, -1, axis=0) - corners
    centroids, doors = corners[ears].mean(axis=1), _doors(ears)
    for corner, place in enumerate(corners):
        start = int(np.flatnonzero((ears == corner).any(axis=1))[0])
        ear_angles = {start: _turn(leaving[corner], centroids[start] - place) % (2 * np.pi)}
        waiting = [start]
        while waiting:
            current = waiting.pop()
            for neighbour, ends in doors[current]:
                if neighbour not in ear_angles:
                    door = corners[ends].mean(axis=0) - place
                    steps = (centroids[current] - place, door, centroids[neighbour] - place)
                    ear_angles[neighbour] = (
                        ear_angles[current] + _turn(*steps[:2]) + _turn(*steps[1:])
                    )
                    waiting.append(neighbour)
        bearings[corner] = [ear_angles[ear] for ear in range(len(ears))]
    return bearings


def _turn(first: Array, second: Array) -> float:
    """Return the angle from one vector to another, within half a turn."""
    return float(np.arctan2(cross(first, second), np.sum(first * second)))


def _doors(ears: Index) -> list[list[tuple[int, list[int]]]]:
    """Return for each ear its neighbours and the corners at the ends of the common sides."""
    return [
        [
            (neighbour, common.tolist())
            for neighbour, neighbour_ear in enumerate(ears)
            if neighbour != number and len(common := np.intersect1d(ear, neighbour_ear)) == 2
        ]
        for number, ear in enumerate(ears)
    ]


def _find_deepest_point(corners: Array) -> Array:
    """Return the place farthest from the edges; of several, that nearest the box's middle."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    fractions = np.stack(np.meshgrid(*[np.linspace(0, 1, _GRID)] * 2), axis=-1).reshape(-1, 2)
    points, edges = low + fractions * (high - low), edges_of((corners,))
    points = points[contains(edges, points)]
    depths = distance_to_edges(edges, points)
    deep = points[depths > 0.98 * depths.max()]
    return deep[np.argmin(np.linalg.norm(deep - (low + high) / 2, axis=1))]


def _find_inner_place(plan: Polygon, place: Array) -> Array:
    """Return an inner place near one on the boundary: the deepest at a small distance."""
    radius = INSET * plan.extent
    angles = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    edges = edges_of((plan.corners,))
    while True:
        ring = place + radius * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        ring = ring[contains(edges, ring)]
        if len(ring):
            return ring[np.argmax(distance_to_edges(edges, ring))]
        radius /= 2


# Nodes are denser towards corners, where solutions rise with a broken power of the distance.
_EDGE_EXPONENT = 2.5
_COARSE_TRIANGLES, _TOUCHING = 2, 1e-9
_NODES_PER_RADIAN = 0.6  # of the phase of a wave: half of it would do for an infinite line
_EXTRA_NODES, _EXTRA_CORNER_NODES = 7, 10


class Nodes(NamedTuple):
    """Places in a plan with weights for integrals."""

    points: Array  # (K, 2), m
    ears: Index  # (K,), ears of the plan that hold them
    weights: Array  # (K,), m or m^2
    normals: Array  # (K, 2), out of the plan; zero inside


def edge_nodes(plan: Polygon, counts: Array, exponent: float = _EDGE_EXPONENT) -> Nodes:
    """Return nodes on all edges, `counts` (n,) of them on each, for integrals along them.

    Gauss-Legendre points drawn towards the corners by Kress' substitution (Kress 1990).
    """
    parts = []
    for edge, (length, count) in enumerate(zip(plan.lengths, counts.tolist(), strict=True)):
        positions, weights = _gauss(int(np.ceil(count)))
        start_powers, end_powers = positions**exponent, (1 - positions) ** exponent
        stretch = (
            exponent
            * (positions * (1 - positions)) ** (exponent - 1)
            / (start_powers + end_powers) ** 2
        )
        points, outwards = plan.place_on_edge(edge, start_powers / (start_powers + end_powers))
        ears, normals = plan.ear_of_edge(edge), np.tile(outwards, (len(points), 1))
        parts.append((points, np.full(len(points), ears), length * weights * stretch, normals))
    return Nodes(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def area_nodes(plan: Polygon, wavenumber: float) -> Nodes:
    """Return nodes for integrals over the plan of products of two solutions, 1/m `wavenumber`.

    Gauss-Legendre points in triangles, laid out as rays from one vertex (Duffy 1982): from the
    plan's corner, if there is one, and denser towards it.
    """
    filling = Triangulation.of(plan.corners, plan.extent / _COARSE_TRIANGLES).halve()
    corners = filling.points[filling.triangles]
    gaps = np.linalg.norm(corners[:, :, None] - plan.corners, axis=3).min(axis=2)
    tips = gaps.argmin(axis=1)
    rotated_triangles = np.stack(
        [np.roll(each, -tip, axis=0) for each, tip in zip(corners, tips, strict=True)]
    )
    touching = gaps.min(axis=1) < _TOUCHING * plan.extent
    phase = _NODES_PER_RADIAN * wavenumber * filling.longest
    parts = [
        _rays(rotated_triangles[touching], int(_EXTRA_CORNER_NODES + phase), 2),
        _rays(rotated_triangles[~touching], int(_EXTRA_NODES + phase), 1),
    ]
    points, weights = (np.concatenate(each) for each in zip(*parts, strict=True))
    points, ears = plan.locate(points)
    return Nodes(points, ears, weights, np.zeros_like(points))


def _rays(triangles: Array, count: int, exponent: int) -> tuple[Array, Array]:
    """Return points and weights of products of rules in triangles (T, 3, 2), from their tips."""
    positions, weights = _gauss(count)
    out = positions**exponent
    growth = out * exponent * positions ** (exponent - 1) * weights
    tips, first, second = np.moveaxis(triangles, 1, 0)
    ends = (first[:, None] - tips[:, None]) + positions[:, None] * (second - first)[:, None]
    points = tips[:, None, None] + out[:, None, None] * ends[:, None]
    areas = cross(first - tips, second - tips)[:, None, None]
    return points.reshape(-1, 2), (areas * growth[:, None] * weights).ravel()


def random_nodes(plan: Polygon, count: int) -> Nodes:
    """Return `count` places inside, at random with a fixed seed."""
    generator = np.random.default_rng(0)
    first, second, third = np.moveaxis(plan.corners[plan.ears], 1, 0)
    areas = cross(second - first, third - first) / 2
    ears = generator.choice(len(areas), count, p=areas / areas.sum())
    u, v = generator.random((2, count))
    u, v = np.where(u + v > 1, 1 - u, u)[:, None], np.where(u + v > 1, 1 - v, v)[:, None]
    points = first[ears] + u * (second - first)[ears] + v * (third - first)[ears]
    return Nodes(points, ears, np.full(count, areas.sum() / count), np.zeros_like(points))


# Growth of the sources' distance from the edges with that from a corner, and this distance in
# spacings.
_RECEDING, _SOURCES_PER_DISTANCE = 0.5, 4


def place_sources(
    plan: Polygon, max_distance: float, clearance_fraction: float, max_spacing: float
) -> Array:
    """Return points (C, 2) outside a plan, about as dense as they are far from its edges."""

    def distances(points: Array) -> Array:
        corner_distances = np.linalg.norm(points[:, None] - plan.corners, axis=2)
        return np.minimum(
            max_distance,
            (clearance_fraction * plan.clearances + _RECEDING * corner_distances).min(axis=1),
        )

    points, source_distances = [np.zeros((0, 2))], [np.zeros(0)]
    for corner, bend in enumerate(np.pi - plan.angles):
        fine, _ = plan.place_on_edge(corner, np.linspace(0, 1, _FINE))
        spacings = np.minimum(distances(fine) / _SOURCES_PER_DISTANCE, max_spacing)
        at, outwards = plan.place_on_edge(corner, _spread(plan.lengths[corner] / spacings))
        points.append(at + distances(at)[:, None] * outwards)
        source_distances.append(distances(at))
        if bend > 0:
            radius = distances(fine[:1])
            angles = -bend * _spread(np.full(_FINE, bend * radius / spacings[0]))
            normals = complex(*outwards) * np.exp(1j * angles)
            points.append(fine[0] + radius * np.stack([normals.real, normals.imag], axis=1))
            source_distances.append(np.repeat(radius, len(angles)))
    candidates, edges = np.vstack(points), edges_of((plan.corners,))
    clear = distance_to_edges(edges, candidates) > _CLEAR * np.concatenate(source_distances)
    return candidates[clear & ~contains(edges, candidates)]


_FINE, _CLEAR = 400, 0.8


def _spread(densities: Array) -> Array:
    """Return fractions of a way, given how many points the whole would have if dense as here."""
    steps = (densities[1:] + densities[:-1]) / 2 / (len(densities) - 1)
    cumulative_counts = np.concatenate([[0.0], np.cumsum(steps)])
    parts = int(np.ceil(cumulative_counts[-1]))
    midpoints = (np.arange(parts) + 0.5) / parts * cumulative_counts[-1]
    return np.interp(midpoints, cumulative_counts, np.linspace(0, 1, len(densities)))


def _gauss(count: int) -> tuple[Array, Array]:
    """Return the points and weights of a Gauss-Legendre rule on 0 to 1."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return (points + 1) / 2, weights / 2

"""A simple polygon as a plan: its corners, its ears, and angles that stay continuous inside it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.solids.outline import distance_to_edges, signed_area

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_SMALLEST_BEND = 1e-12  # rad
_WHOLE = 1e-9  # how near to a whole number pi / angle counts as one


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plan:
    """A simple polygon, cut into ears.

    Parameters
    ----------
    corners : array (n, 2)
        Counter-clockwise, none of them straight.
    ears : array (n - 2, 3)
        Triangles between corners, counter-clockwise, which fill the polygon.
    bearings : array (n, n - 2)
        Angles at which corners see the ears' centroids, from the edge that leaves the corner,
        followed through the inside; those of a spiral exceed 2 pi.
    """

    corners: Array
    ears: Index
    bearings: Array

    @property
    def area(self) -> float:
        """Area, m^2."""
        return signed_area(self.corners)

    @property
    def lengths(self) -> Array:
        """Lengths of the edges that leave the corners (n,), m."""
        return np.linalg.norm(self._leaving, axis=1)

    @property
    def angles(self) -> Array:
        """Inner angles (n,), rad."""
        return inner_angles(self.corners)

    @property
    def powers(self) -> Array:
        """Pi / angle of each corner: along its edges, solutions rise with multiples of these."""
        return np.pi / self.angles

    @property
    def singular(self) -> Index:
        """Corners where solutions are not smooth: pi / angle is no whole number."""
        return np.flatnonzero(np.abs(self.powers - np.round(self.powers)) > _WHOLE)

    @property
    def reaches(self) -> Array:
        """Distances from each corner to the farthest other (n,), m."""
        return np.linalg.norm(self.corners[:, None] - self.corners, axis=2).max(axis=1)

    @property
    def clearances(self) -> Array:
        """Distances from each corner to its neighbours and to the other edges (n,), m."""
        least, count = np.minimum(self.lengths, np.roll(self.lengths, 1)), len(self.corners)
        for corner, place in enumerate(self.corners):
            others = (corner + np.arange(1, count - 1)) % count
            edges = self.corners[others], self.corners[(others + 1) % count]
            least[corner] = min(least[corner], distance_to_edges(edges, place[None])[0])
        return least

    @property
    def _leaving(self) -> Array:
        return np.roll(self.corners, -1, axis=0) - self.corners

    def on_edge(self, edge: int, shares: Array) -> tuple[Array, Array]:
        """Return points (K, 2) at shares of the way along an edge, and its outward normal (2,)."""
        along = self._leaving[edge]
        outwards = np.array([along[1], -along[0]]) / np.linalg.norm(along)
        return self.corners[edge] + shares[:, None] * along, outwards

    def nearest_edges(self, points: Array) -> Index:
        """Return the edges that points (K, 2) are nearest to (K,)."""
        return np.linalg.norm(points[:, None] - self._feet(points), axis=2).argmin(axis=1)

    def ear_of_edge(self, edge: int) -> int:
        """Return the ear along which an edge runs."""
        both = np.isin(self.ears, [edge, (edge + 1) % len(self.corners)]).sum(axis=1) == 2
        return int(np.flatnonzero(both)[0])

    def located(self, points: Array) -> tuple[Array, Index]:
        """Return points (K, 2), those outside moved to the nearest edge, and their ears (K,)."""
        ears, depths = self._deepest(points)
        outside = depths < 0
        points = points.copy()
        points[outside] = self._onto_edges(points[outside])
        ears[outside] = self._deepest(points[outside])[0]
        return points, ears

    def polar(self, corner: int, points: Array, ears: Index) -> tuple[Array, Array]:
        """Return distances and continuous angles (K,) of points in ears, seen from a corner."""
        centroid = self.corners[self.ears].mean(axis=1) - self.corners[corner]
        seen = points - self.corners[corner]
        turn = np.arctan2(seen[:, 1], seen[:, 0]) - np.arctan2(centroid[:, 1], centroid[:, 0])[ears]
        return np.linalg.norm(seen, axis=1), self.bearings[corner][ears] + _wrapped(turn)

    def _deepest(self, points: Array) -> tuple[Index, Array]:
        """Return the ear in which each point lies deepest, and how deep."""
        depths = np.full((len(points), len(self.ears)), np.inf)
        for start, end in ((0, 1), (1, 2), (2, 0)):
            a, b = self.corners[self.ears[:, start]], self.corners[self.ears[:, end]]
            height = cross(b - a, points[:, None] - a) / np.linalg.norm(b - a, axis=1)
            depths = np.minimum(depths, height)
        return depths.argmax(axis=1), depths.max(axis=1)

    def _onto_edges(self, points: Array) -> Array:
        return self._feet(points)[np.arange(len(points)), self.nearest_edges(points)]

    def _feet(self, points: Array) -> Array:
        """Return the places on all edges that are nearest to points: (K, n, 2)."""
        steps = self._leaving
        share = np.einsum("kei,ei->ke", points[:, None] - self.corners, steps)
        share = np.clip(share / np.sum(steps**2, axis=1), 0, 1)
        return self.corners + share[..., None] * steps


def plan_of(corners: Array) -> Plan:
    """Return the plan of a simple polygon (n, 2) given in either direction round."""
    corners = corners if signed_area(corners) > 0 else corners[::-1]
    corners = corners[np.abs(inner_angles(corners) - np.pi) > _SMALLEST_BEND]
    ears = _cut(corners)
    return Plan(corners=corners, ears=ears, bearings=_bearings(corners, ears))


def cross(first: Array, second: Array) -> Array:
    """Return the cross products of plane vectors (..., 2)."""
    return first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]


def inner_angles(corners: Array) -> Array:
    """Return the angles inside a counter-clockwise polygon (n, 2), rad: up to 2 pi."""
    ahead, back = np.roll(corners, -1, axis=0) - corners, np.roll(corners, 1, axis=0) - corners
    return np.arctan2(cross(ahead, back), np.sum(ahead * back, axis=1)) % (2 * np.pi)


def _wrapped(angles: Array) -> Array:
    return (angles + np.pi) % (2 * np.pi) - np.pi


def _cut(corners: Array) -> Index:
    """Cut off the roundest ear, again and again (Meisters 1975: there always is one)."""
    left, ears = list(range(len(corners))), []
    while len(left) > 3:
        triples = np.stack([np.roll(left, 1), left, np.roll(left, -1)], axis=1)
        roundness = [_roundness(corners, triple, left) for triple in triples]
        best = int(np.argmax(roundness))
        ears.append(triples[best])
        left.pop(best)
    return np.array([*ears, left], dtype=np.int64)


def _roundness(corners: Array, triple: Index, left: list[int]) -> float:
    """Return how round an ear is, 0 where none can be cut off."""
    a, b, c = corners[triple]
    area = float(cross(b - a, c - a))
    others = corners[np.setdiff1d(left, triple)]
    sides = ((a, b), (b, c), (c, a))
    inside = np.all([cross(end - start, others - start) >= 0 for start, end in sides], axis=0)
    return 0.0 if area <= 0 or inside.any() else area / max(sum((q - p) ** 2) for p, q in sides)


def _bearings(corners: Array, ears: Index) -> Array:
    """Follow the angles at which each corner sees the ears, from ear to ear across their sides."""
    found = np.zeros((len(corners), len(ears)))
    leaving = np.roll(corners, -1, axis=0) - corners
    centroids, doors = corners[ears].mean(axis=1), _doors(ears)
    for corner, place in enumerate(corners):
        start = int(np.flatnonzero((ears == corner).any(axis=1))[0])
        known = {start: _turn(leaving[corner], centroids[start] - place) % (2 * np.pi)}
        waiting = [start]
        while waiting:
            here = waiting.pop()
            for there, ends in doors[here]:
                if there not in known:
                    door = corners[ends].mean(axis=0) - place
                    steps = (centroids[here] - place, door, centroids[there] - place)
                    known[there] = known[here] + _turn(*steps[:2]) + _turn(*steps[1:])
                    waiting.append(there)
        found[corner] = [known[ear] for ear in range(len(ears))]
    return found


def _turn(first: Array, second: Array) -> float:
    """Return the angle from one vector to another, within half a turn."""
    return float(np.arctan2(cross(first, second), np.sum(first * second)))


def _doors(ears: Index) -> list[list[tuple[int, list[int]]]]:
    """Return for each ear its neighbours and the corners at the ends of the common sides."""
    doors: list[list[tuple[int, list[int]]]] = [[] for _ in ears]
    for here, ear in enumerate(ears):
        for there, other in enumerate(ears):
            common = np.intersect1d(ear, other)
            if here != there and len(common) == 2:
                doors[here].append((there, common.tolist()))
    return doors

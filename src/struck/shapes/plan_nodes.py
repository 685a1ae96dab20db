"""Where functions over a plan are looked at: along its edges, inside, all over for integrals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.shapes.plan_elements import Triangulation
from struck.shapes.polygon import Plan, cross
from struck.solids.outline import contains, distance_to_edges, edges_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# Nodes crowd towards corners, where solutions rise with a broken power of the distance.
_CROWDED_ON_EDGES = 2.5
_TRIANGLES_ALONG, _TOUCHING = 2, 1e-9
_NODES_A_RADIAN = 0.6  # of the phase of a wave: half of it would do for an infinite line
_SPARE, _SPARE_AT_CORNERS = 7, 10


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Nodes:
    """Places in a plan.

    Parameters
    ----------
    points : array (K, 2)
        m.
    ears : array (K,)
        Ears of the plan that hold them.
    weights : array (K,)
        For integrals, m or m^2.
    normals : array (K, 2)
        Pointing out of the plan; zero inside.
    """

    points: Array
    ears: Index
    weights: Array
    normals: Array

    @classmethod
    def joined(cls, parts: list[Nodes]) -> Nodes:
        """Put nodes together."""
        return cls(
            points=np.vstack([part.points for part in parts]),
            ears=np.concatenate([part.ears for part in parts]),
            weights=np.concatenate([part.weights for part in parts]),
            normals=np.vstack([part.normals for part in parts]),
        )


def along_edges(plan: Plan, counts: Array, crowded: float = _CROWDED_ON_EDGES) -> Nodes:
    """Return nodes on all edges, so many on each (n,), for integrals along them.

    Gauss-Legendre points drawn towards the corners by Kress' substitution (Kress 1990).
    """
    parts = []
    for edge, (length, count) in enumerate(zip(plan.lengths, counts.tolist(), strict=True)):
        share, weights = _gauss(int(np.ceil(count)))
        here, there = share**crowded, (1 - share) ** crowded
        stretch = crowded * (share * (1 - share)) ** (crowded - 1) / (here + there) ** 2
        points, outwards = plan.on_edge(edge, here / (here + there))
        parts.append(
            Nodes(
                points=points,
                ears=np.full(len(points), plan.ear_of_edge(edge)),
                weights=length * weights * stretch,
                normals=np.tile(outwards, (len(points), 1)),
            )
        )
    return Nodes.joined(parts)


def all_over(plan: Plan, wavenumber: float) -> Nodes:
    """Return nodes for integrals over the plan of products of two solutions, 1/m `wavenumber`.

    Gauss-Legendre points in triangles, laid out as rays from one vertex (Duffy 1982): from the
    plan's corner, where there is one, and crowding towards it.
    """
    extent = float(np.ptp(plan.corners, axis=0).max())
    filling = Triangulation.of(plan.corners, extent / _TRIANGLES_ALONG).halved()
    corners = filling.points[filling.triangles]
    gaps = np.linalg.norm(corners[:, :, None] - plan.corners, axis=3).min(axis=2)
    tips = gaps.argmin(axis=1)
    turned = np.stack(
        [np.roll(each, -tip, axis=0) for each, tip in zip(corners, tips, strict=True)]
    )
    touching = gaps.min(axis=1) < _TOUCHING * extent
    phase = _NODES_A_RADIAN * wavenumber * filling.longest
    parts = [
        _rays(turned[touching], int(_SPARE_AT_CORNERS + phase), 2),
        _rays(turned[~touching], int(_SPARE + phase), 1),
    ]
    points, weights = (np.concatenate(each) for each in zip(*parts, strict=True))
    points, ears = plan.located(points)
    return Nodes(points=points, ears=ears, weights=weights, normals=np.zeros_like(points))


def _rays(triangles: Array, count: int, crowded: int) -> tuple[Array, Array]:
    """Return points and weights of products of rules in triangles (T, 3, 2), from their tips."""
    share, weights = _gauss(count)
    out = share**crowded
    growth = out * crowded * share ** (crowded - 1) * weights
    tips, first, second = np.moveaxis(triangles, 1, 0)
    ends = (first[:, None] - tips[:, None]) + share[:, None] * (second - first)[:, None]
    points = tips[:, None, None] + out[:, None, None] * ends[:, None]
    areas = cross(first - tips, second - tips)[:, None, None]
    return points.reshape(-1, 2), (areas * growth[:, None] * weights).ravel()


def scattered(plan: Plan, count: int) -> Nodes:
    """Return `count` places inside, at random with a fixed seed."""
    draw = np.random.default_rng(0)
    first, second, third = np.moveaxis(plan.corners[plan.ears], 1, 0)
    areas = cross(second - first, third - first) / 2
    ears = draw.choice(len(areas), count, p=areas / areas.sum())
    u, v = draw.random((2, count))
    u, v = np.where(u + v > 1, 1 - u, u)[:, None], np.where(u + v > 1, 1 - v, v)[:, None]
    points = first[ears] + u * (second - first)[ears] + v * (third - first)[ears]
    weights = np.full(count, areas.sum() / count)
    return Nodes(points=points, ears=ears, weights=weights, normals=np.zeros_like(points))


# Sources recede from a corner by this share of the way from it, and stand off so many spacings.
_RECEDING, _SOURCES_A_DISTANCE = 0.5, 4


def around(plan: Plan, farthest: float, share: float, widest: float) -> Array:
    """Return points (C, 2) outside a plan, about as dense as they are far from its edges.

    Parameters
    ----------
    plan : Plan
    farthest : float
        Distance from the edges far from all corners, m.
    share : float
        Distance near a corner, as a share of its clearance.
    widest : float
        Largest spacing, m.
    """

    def distances(points: Array) -> Array:
        ways = np.linalg.norm(points[:, None] - plan.corners, axis=2)
        return np.minimum(farthest, (share * plan.clearances + _RECEDING * ways).min(axis=1))

    points, apart = [np.zeros((0, 2))], [np.zeros(0)]
    for corner, bend in enumerate(np.pi - plan.angles):
        fine, _ = plan.on_edge(corner, np.linspace(0, 1, _FINE))
        spacings = np.minimum(distances(fine) / _SOURCES_A_DISTANCE, widest)
        at, outwards = plan.on_edge(corner, _spread(plan.lengths[corner] / spacings))
        points.append(at + distances(at)[:, None] * outwards)
        apart.append(distances(at))
        if bend > 0:
            radius = distances(fine[:1])
            turns = -bend * _spread(np.full(_FINE, bend * radius / spacings[0]))
            points.append(fine[0] + radius * _rotated(outwards, turns))
            apart.append(np.repeat(radius, len(turns)))
    candidates, edges = np.vstack(points), edges_of((plan.corners,))
    clear = distance_to_edges(edges, candidates) > _CLEAR * np.concatenate(apart)
    return candidates[clear & ~contains(edges, candidates)]


_FINE, _CLEAR = 400, 0.8


def _spread(densities: Array) -> Array:
    """Return shares of a way, given how many points the whole would have if dense as here."""
    steps = (densities[1:] + densities[:-1]) / 2 / (len(densities) - 1)
    passed = np.concatenate([[0.0], np.cumsum(steps)])
    parts = int(np.ceil(passed[-1]))
    middles = (np.arange(parts) + 0.5) / parts * passed[-1]
    return np.interp(middles, passed, np.linspace(0, 1, len(densities)))


def _rotated(vector: Array, angles: Array) -> Array:
    x, y = vector
    turned = [np.cos(angles) * x - np.sin(angles) * y, np.sin(angles) * x + np.cos(angles) * y]
    return np.stack(turned, axis=1)


def _gauss(count: int) -> tuple[Array, Array]:
    """Return the points and weights of a Gauss-Legendre rule on 0 to 1."""
    points, weights = np.polynomial.legendre.leggauss(count)
    return (points + 1) / 2, weights / 2

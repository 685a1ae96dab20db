"""Reference elements: nodes, polynomials and quadrature, as data.

Every element is isoparametric: the same polynomials carry geometry and displacement
(Zienkiewicz, Taylor & Zhu 2013, chapters 5 and 6). Node order is VTK's.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations, product
from types import MappingProxyType

import numpy as np

from struck.model.arrays import Array, Index


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Quadrature:
    """Points (q, 3) and weights (q,) that integrate over a reference element."""

    points: Array
    weights: Array


@dataclass(frozen=True, kw_only=True, eq=False)
class Element:
    """A reference element: its nodes, its polynomials and the quadrature it needs."""

    corners: Array  # (c, 3)
    edges: tuple[tuple[int, int], ...]  # corners whose midpoint is a further node; none if linear
    sides: tuple[tuple[int, ...], ...]  # corners of each face, counter-clockwise from outside
    exponents: Index  # (n, 3), of the monomials that span the polynomials
    stiffness_rule: Quadrature  # of curved elements
    mass_rule: Quadrature  # also measures the volume
    straight_rule: Quadrature  # stiffness of straight-sided elements

    @cached_property
    def nodes(self) -> Array:
        """Reference coordinates of all nodes (n, 3)."""
        midside_nodes = [(self.corners[a] + self.corners[b]) / 2 for a, b in self.edges]
        return np.vstack([self.corners, *midside_nodes])

    @cached_property
    def _coefficients(self) -> Array:
        return np.asarray(np.linalg.inv(_monomials(self.nodes, self.exponents)), np.float64)

    def values(self, points: Array) -> Array:
        """Return the shape functions at reference `points` (q, 3): (q, n)."""
        return _monomials(points, self.exponents) @ self._coefficients

    def gradients(self, points: Array) -> Array:
        """Return their gradients in reference coordinates: (q, n, 3)."""
        slopes = [_differentiate(points, self.exponents, axis) for axis in range(3)]
        return np.stack([slope @ self._coefficients for slope in slopes], axis=-1)


def _monomials(points: Array, exponents: Index) -> Array:
    return np.prod(points[:, None, :] ** exponents, axis=2)


def _differentiate(points: Array, exponents: Index, axis: int) -> Array:
    lower_exponents = exponents.copy()
    lower_exponents[:, axis] = np.maximum(lower_exponents[:, axis] - 1, 0)
    return exponents[:, axis] * _monomials(points, lower_exponents)


def _tetrahedron_rule(*orbits: tuple[float, tuple[float, ...]]) -> Quadrature:
    """Rule from orbits of barycentric coordinates, weights summing to 1."""
    points, weights = [], []
    for weight, first in orbits:
        orbit = sorted(set(permutations(first)))
        points += [row[1:] for row in orbit]
        weights += [weight / 6] * len(orbit)
    return Quadrature(points=np.array(points), weights=np.array(weights))


def _gauss(count: int, low: float, high: float) -> tuple[Array, Array]:
    points, weights = np.polynomial.legendre.leggauss(count)
    return (low + high + (high - low) * points) / 2, weights * (high - low) / 2


def _hexahedron_rule(count: int) -> Quadrature:
    points, weights = _gauss(count, 0.0, 1.0)
    return Quadrature(
        points=np.array(list(product(points, repeat=3))),
        weights=np.array([float(np.prod(w)) for w in product(weights, repeat=3)]),
    )


def _blend(first_rule: Quadrature, second_rule: Quadrature, weight: float) -> Quadrature:
    """Return the weighted mean of two rules, `weight` that of the second."""
    return Quadrature(
        points=np.vstack([first_rule.points, second_rule.points]),
        weights=np.concatenate([(1 - weight) * first_rule.weights, weight * second_rule.weights]),
    )


def _wedge_rule(triangle: tuple[tuple[float, float, float], ...], count: int) -> Quadrature:
    """Product of a triangle's rule (weight, orbit point, orbit point) and Gauss points."""
    flat = [(w, x, y) for w, a, b in triangle for x, y in {(a, b), (b, 1 - a - b), (1 - a - b, a)}]
    heights, factors = _gauss(count, 0.0, 1.0)
    pairs = list(product(flat, zip(heights, factors, strict=True)))
    return Quadrature(
        points=np.array([(x, y, z) for (_, x, y), (z, _) in pairs]),
        weights=np.array([w * f / 2 for (w, _, _), (_, f) in pairs]),
    )


def _up_to(degree: int) -> Index:
    return np.array([e for e in product(range(degree + 1), repeat=3) if sum(e) <= degree])


def _wedge(*, is_quadratic: bool) -> Index:
    flat = _up_to(2 if is_quadratic else 1)
    prism = [(i, j, k) for i, j, z in flat if z == 0 for k in (0, 1)]
    return np.array(prism + ([(0, 0, 2), (1, 0, 2), (0, 1, 2)] if is_quadratic else []))


# Walkington's rule of degree 5 with positive weights, and the rule of degree 2.
TET_14 = _tetrahedron_rule(
    (0.11268792571801585, (0.0673422422100982, *(0.3108859192633006,) * 3)),
    (0.07349304311636195, (0.7217942490673264, *(0.0927352503108912,) * 3)),
    (0.04254602077708147, (*(0.0455037041256497,) * 2, *(0.4544962958743503,) * 2)),
)
_TET_4 = _tetrahedron_rule((0.25, (0.5854101966249685, *(0.1381966011250105,) * 3)))
# Keast's rule of degree 6 with positive weights, for cubic displacements.
TET_24 = _tetrahedron_rule(
    (0.0399227502581679, (0.3561913862225449, *(0.2146028712591517,) * 3)),
    (0.0100772110553207, (0.8779781243961660, *(0.0406739585346113,) * 3)),
    (0.0553571815436544, (0.0329863295731731, *(0.3223378901422757,) * 3)),
    (
        0.0482142857142857,
        (0.0636610018750175, 0.0636610018750175, 0.2696723314583159, 0.6030056647916491),
    ),
)
# Dunavant's triangle rule of degree 4.
_TRIANGLE_6 = (
    (0.223381589678011, 0.445948490915965, 0.108103018168070),
    (0.109951743655322, 0.091576213509771, 0.816847572980459),
)
# With 3 x 3 x 3 points curved walls are too stiff in shear, by 1 % and more on shells; with
# 2 x 2 x 2 alone some deformations cost nothing (Zienkiewicz, Taylor & Zhu 2013, section 9.4).
_CUBE_27 = _hexahedron_rule(3)
_CUBE_35 = _blend(_hexahedron_rule(2), _CUBE_27, 0.01)
_WEDGE_18 = _wedge_rule(_TRIANGLE_6, 3)


def _linear_and_quadratic(
    corners: Array,
    sides: tuple[tuple[int, ...], ...],
    edges: tuple[tuple[int, int], ...],
    exponents: tuple[Index, Index],
    *,
    stiffness: Quadrature,
    straight: Quadrature,
    mass: Quadrature,
) -> Iterator[Element]:
    """Yield the linear and the quadratic element of one form."""
    for powers, midside_edges in zip(exponents, ((), edges), strict=True):
        yield Element(
            corners=corners,
            edges=midside_edges,
            sides=sides,
            exponents=powers,
            stiffness_rule=stiffness,
            straight_rule=straight,
            mass_rule=mass,
        )


_TET4, _TET10 = _linear_and_quadratic(
    np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], dtype=float),
    ((0, 2, 1), (0, 1, 3), (1, 2, 3), (0, 3, 2)),
    ((0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)),
    (_up_to(1), _up_to(2)),
    stiffness=TET_14,
    straight=_TET_4,
    mass=TET_14,
)
_HEX8, _HEX20 = _linear_and_quadratic(
    np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], dtype=float),
    ((0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
    (
        *((0, 1), (1, 2), (2, 3), (3, 0)),
        *((4, 5), (5, 6), (6, 7), (7, 4)),
        *((0, 4), (1, 5), (2, 6), (3, 7)),
    ),
    (
        np.array(list(product((0, 1), repeat=3))),
        np.array([each for each in product(range(3), repeat=3) if each.count(2) <= 1]),
    ),
    stiffness=_CUBE_35,
    straight=_CUBE_35,
    mass=_CUBE_27,
)
_WEDGE6, _WEDGE15 = _linear_and_quadratic(
    np.array([(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (0, 1))], dtype=float),
    ((0, 2, 1), (3, 4, 5), (0, 1, 4, 3), (1, 2, 5, 4), (2, 0, 3, 5)),
    ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    (_wedge(is_quadratic=False), _wedge(is_quadratic=True)),
    stiffness=_WEDGE_18,
    straight=_WEDGE_18,
    mass=_WEDGE_18,
)

ELEMENTS: Mapping[str, Element] = MappingProxyType(
    {
        "tet4": _TET4,
        "tet10": _TET10,
        "hex8": _HEX8,
        "hex20": _HEX20,
        "wedge6": _WEDGE6,
        "wedge15": _WEDGE15,
    }
)
QUADRATIC_KINDS: Mapping[str, str] = MappingProxyType(
    {"tet4": "tet10", "hex8": "hex20", "wedge6": "wedge15"}
)

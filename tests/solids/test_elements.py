"""Reference elements: polynomials and quadrature against closed forms."""

from __future__ import annotations

from itertools import product
from math import factorial

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.solids.elements import ELEMENTS, QUADRATIC_KINDS, Element, Quadrature

Array = NDArray[np.float64]
KINDS = sorted(ELEMENTS)
VOLUMES = {"tet": 1 / 6, "hex": 1.0, "wed": 1 / 2}


def inside(kind: str, count: int = 7) -> Array:
    """Return random points of the reference element."""
    points = np.random.default_rng(3).dirichlet(np.ones(4), count)[:, :3]
    if kind.startswith("tet"):
        return points
    points[:, 2] = np.random.default_rng(4).uniform(0, 1, count)
    return points


def integral(kind: str, i: int, j: int, k: int) -> float:
    """Return the integral of x^i y^j z^k over the reference element."""
    if kind.startswith("tet"):
        return factorial(i) * factorial(j) * factorial(k) / factorial(i + j + k + 3)
    if kind.startswith("hex"):
        return 1 / ((i + 1) * (j + 1) * (k + 1))
    return factorial(i) * factorial(j) / factorial(i + j + 2) / (k + 1)


@pytest.mark.parametrize("kind", KINDS)
def test_each_function_is_one_at_its_node_and_zero_at_the_others(kind: str) -> None:
    element = ELEMENTS[kind]
    count = int("".join(c for c in kind if c.isdigit()))
    assert element.nodes.shape == (count, 3)
    assert element.values(element.nodes) == pytest.approx(np.eye(count), abs=1e-13)


@pytest.mark.parametrize("kind", KINDS)
def test_functions_reproduce_position_and_constants(kind: str) -> None:
    element, points = ELEMENTS[kind], inside(kind)
    assert element.values(points).sum(axis=1) == pytest.approx(np.ones(len(points)), rel=1e-13)
    assert element.values(points) @ element.nodes == pytest.approx(points, abs=1e-13)
    slopes = np.einsum("qnr,nd->qdr", element.gradients(points), element.nodes)
    assert slopes == pytest.approx(np.broadcast_to(np.eye(3), slopes.shape), abs=1e-12)


@pytest.mark.parametrize("kind", sorted(QUADRATIC_KINDS.values()))
def test_quadratic_elements_hold_every_quadratic(kind: str) -> None:
    element, points = ELEMENTS[kind], inside(kind)
    for i, j, k in product(range(3), repeat=3):
        if i + j + k <= 2:
            monomial = np.prod(element.nodes ** [i, j, k], axis=1)
            found = element.values(points) @ monomial
            assert found == pytest.approx(np.prod(points ** [i, j, k], axis=1), abs=1e-13)


@pytest.mark.parametrize("kind", KINDS)
def test_gradients_are_the_slopes_of_the_values(kind: str) -> None:
    element, points, step = ELEMENTS[kind], inside(kind), 1e-5
    for axis, aside in enumerate(step * np.eye(3)):
        rise = element.values(points + aside) - element.values(points - aside)
        assert element.gradients(points)[:, :, axis] == pytest.approx(rise / (2 * step), abs=1e-9)


def test_hex20_is_the_serendipity_element() -> None:
    """Its formulas as every book prints them, on the cube from -1 to 1."""
    element, points = ELEMENTS["hex20"], inside("hex")
    at, nodes = 2 * points[:, None] - 1, 2 * element.nodes - 1
    factors = 1 + at * nodes
    corners = factors.prod(axis=2) * ((at * nodes).sum(axis=2) - 2) / 8
    flat = np.abs(nodes) < 0.5
    middles = np.where(flat, 1 - at**2, factors).prod(axis=2) / 4
    expected = np.where(flat.any(axis=1), middles, corners)
    assert element.values(points) == pytest.approx(expected, abs=1e-13)


@pytest.mark.parametrize("kind", KINDS)
def test_sides_look_outward_and_close(kind: str) -> None:
    element = ELEMENTS[kind]
    centre = element.corners.mean(axis=0)
    whole = np.zeros(3)
    for side in element.sides:
        loop = element.corners[list(side)]
        area = sum(np.cross(a, b) for a, b in zip(loop, np.roll(loop, -1, axis=0), strict=True))
        assert area @ (loop.mean(axis=0) - centre) > 0
        whole += area
    assert whole == pytest.approx(np.zeros(3), abs=1e-15)


@pytest.mark.parametrize("kind", sorted(QUADRATIC_KINDS.values()))
def test_edges_are_those_of_the_sides(kind: str) -> None:
    element = ELEMENTS[kind]
    around = {
        frozenset(pair)
        for side in element.sides
        for pair in zip(side, (*side[1:], side[0]), strict=True)
    }
    assert {frozenset(edge) for edge in element.edges} == around
    assert len(element.edges) == len(around)


def degree(kind: str, rule: Quadrature) -> int:
    """Return the highest total degree of polynomials that a rule integrates exactly."""
    for total in range(20):
        for i, j in product(range(total + 1), repeat=2):
            k = total - i - j
            if k < 0:
                continue
            found = rule.weights @ np.prod(rule.points ** [i, j, k], axis=1)
            if abs(found / integral(kind, i, j, k) - 1) > 1e-11:
                return total - 1
    return total


# Straight elements: stiffness of tetrahedra is quadratic; mass of degree 4 on all of them.
@pytest.mark.parametrize(
    ("kind", "straight", "curved", "mass"),
    [("tet10", 2, 5, 5), ("hex20", 3, 3, 5), ("wedge15", 4, 4, 4)],
)
def test_rules_are_exact_to_their_degree(kind: str, straight: int, curved: int, mass: int) -> None:
    element: Element = ELEMENTS[kind]
    rules = (element.straight_rule, element.stiffness_rule, element.mass_rule)
    assert [degree(kind, rule) for rule in rules] == [straight, curved, mass]
    for rule in rules:
        assert rule.weights.min() > 0
        assert rule.weights.sum() == pytest.approx(VOLUMES[kind[:3]], rel=1e-13)
        assert (rule.points > 0).all()
        assert (rule.points < 1).all()

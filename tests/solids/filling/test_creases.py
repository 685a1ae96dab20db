"""Boundary nodes end on the true surface, at quadratic order, and no element folds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from struck.solids.filling.filling import curve_elements, flatness, shapes
from struck.solids.lattice import Cells, cells_in
from struck.solids.volume_mesh import VolumeMesh
from tests.physics.bodies import distorted, grid

RADIUS, TUBE = 0.05, 0.018


def ball(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points, axis=1) - RADIUS


def onto_ball(_surface: float, points: np.ndarray) -> np.ndarray:
    return points * RADIUS / np.linalg.norm(points, axis=1, keepdims=True)


def around(points: np.ndarray) -> np.ndarray:
    """Return the nearest points of the circle in the middle of a torus."""
    flat = points * [1.0, 1.0, 0.0]
    return flat * RADIUS / np.linalg.norm(flat, axis=1, keepdims=True)


def torus(points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(points - around(points), axis=1) - TUBE


def onto_torus(_surface: float, points: np.ndarray) -> np.ndarray:
    middle = around(points)
    way = points - middle
    return middle + way * TUBE / np.linalg.norm(way, axis=1, keepdims=True)


SHAPES = {
    "ball": (ball, onto_ball, 4 / 3 * np.pi * RADIUS**3, RADIUS),
    "torus": (torus, onto_torus, 2 * np.pi**2 * RADIUS * TUBE**2, RADIUS + TUBE),
}


def cells_of(name: str, spacing: float) -> Cells:
    depths, _, _, reach = SHAPES[name]
    # Off the lattice's own symmetry.
    bounds = np.array([[-reach] * 3, [reach] * 3]) * [1.0, 1.01, 1.02]
    return cells_in(depths, bounds, spacing)


@pytest.mark.parametrize("name", list(SHAPES))
def test_boundary_nodes_lie_on_the_surface(name: str) -> None:
    depths, onto, _, _ = SHAPES[name]
    mesh, short = curve_elements(cells_of(name, 0.012), onto)
    assert short == 0
    assert mesh.kind == "tet10"
    assert np.abs(depths(mesh.surface()[0].points)).max() < 1e-15
    assert flatness(mesh).min() > 0.02


@pytest.mark.parametrize("name", list(SHAPES))
def test_volume_converges_faster_than_with_straight_sides(name: str) -> None:
    _, onto, exact, _ = SHAPES[name]
    errors, straight = [], []
    for spacing in (0.016, 0.008):
        cells = cells_of(name, spacing)
        mesh, _ = curve_elements(cells, onto)
        linear = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4")
        errors.append(abs(mesh.volume() / exact - 1))
        straight.append(abs(linear.volume() / exact - 1))
    assert np.log2(straight[0] / straight[1]) == pytest.approx(2, abs=0.6)
    assert np.log2(errors[0] / errors[1]) > 2.9
    assert errors[1] < straight[1] / 30


@pytest.mark.parametrize("seed", range(3))
def test_no_element_folds_wherever_nodes_are_sent(seed: int) -> None:
    random = np.random.default_rng(seed)

    def astray(_surface: float, points: np.ndarray) -> np.ndarray:
        return points + random.normal(scale=0.006, size=points.shape)

    cells = cells_of("ball", 0.012)
    mesh, short = curve_elements(cells, astray)
    assert 0 < short < len(mesh.nodes)
    assert flatness(mesh).min() >= 0.02
    assert mesh.volume() == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.2)


def test_nodes_that_need_not_move_stay() -> None:
    cells = cells_of("ball", 0.012)
    mesh, short = curve_elements(cells, lambda _surface, points: points)
    assert short == 0
    assert mesh.straight().all()
    assert np.array_equal(mesh.nodes[: len(cells.points)], cells.points)


@pytest.mark.parametrize("kind", ["tet4", "hex8", "wedge6"])
def test_flatness_is_least_over_mean_determinant(kind: str) -> None:
    mesh = distorted(grid(kind, (3, 3, 3)), 0.2).promoted()
    nodes = mesh.nodes + np.random.default_rng(0).normal(scale=0.01, size=mesh.nodes.shape)
    mesh = replace(mesh, nodes=nodes)
    points = np.vstack([mesh.element.nodes, mesh.element.mass_rule.points])
    found = np.linalg.det(mesh.jacobians(points))
    expected = found.min(axis=1) / np.abs(found).mean(axis=1)
    assert flatness(mesh) == pytest.approx(expected, rel=1e-9)
    chosen = np.array([5, 2])
    assert flatness(mesh, chosen) == pytest.approx(expected[chosen], rel=1e-9)


def test_flatness_of_straight_and_of_folded_tetrahedra() -> None:
    mesh = grid("tet4", (2, 2, 2)).promoted()
    assert flatness(mesh) == pytest.approx(1.0)
    inside_out = replace(mesh, nodes=mesh.nodes * [1.0, 1.0, -1.0])
    assert flatness(inside_out) == pytest.approx(-1.0)
    # A mid-edge node past a quarter of its edge makes the determinant vanish at the corner.
    for share, expected in ((0.26, 1), (0.24, -1)):
        nodes = mesh.nodes.copy()
        first, second, middle = mesh.elements[0, [0, 1, 4]]
        nodes[middle] = nodes[first] + share * (nodes[second] - nodes[first])
        assert np.sign(flatness(replace(mesh, nodes=nodes))[0]) == expected


def test_shape_of_the_regular_tetrahedron_is_one_and_of_a_flat_one_nothing() -> None:
    corners = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
    flat = corners * [1, 1, 1e-6]
    nodes = np.vstack([corners, flat])
    elements = np.array([[0, 1, 2, 3], [1, 0, 2, 3], [4, 5, 6, 7]])
    found = shapes(VolumeMesh(nodes=nodes, elements=elements, kind="tet4"))
    assert np.sort(found[:2]) == pytest.approx([-1, 1], rel=1e-12)
    assert abs(found[2]) < 1e-5

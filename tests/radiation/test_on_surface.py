from __future__ import annotations

import igl
import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.special import eval_legendre

from struck.model.mesh import Mesh
from struck.radiation.on_surface import (
    COUNT,
    SurfaceHarmonics,
    laplacian,
    normal_velocities,
    sphere_impedance,
)
from tests.radiation.bodies import ball, bowl, box, radial


def harmonics(mesh: Mesh) -> SurfaceHarmonics:
    return SurfaceHarmonics.of(mesh, float(np.sqrt(mesh.areas.sum() / (4 * np.pi))))


def legendre(mesh: Mesh, order: int) -> np.ndarray:
    """Return normal velocities (F, 1) of one spherical order."""
    profile = eval_legendre(order, mesh.points[:, 2] / np.linalg.norm(mesh.points, axis=1))
    return normal_velocities(mesh, radial(mesh, profile))


def test_laplacian_is_the_one_of_libigl() -> None:
    mesh = bowl(0.06, 0.004, 16, 8)
    stiffness, masses = laplacian(mesh)
    points, faces = np.array(mesh.points), np.array(mesh.faces)
    expected = -igl.cotmatrix(points, faces).toarray()
    np.testing.assert_allclose(stiffness.toarray(), expected, atol=1e-9 * np.abs(expected).max())
    lumped = igl.massmatrix(points, faces, igl.MASSMATRIX_TYPE_BARYCENTRIC).diagonal()
    np.testing.assert_allclose(masses, lumped, rtol=1e-9)


# Solved directly, and by iteration. Linear elements make steep harmonics somewhat steeper.
@pytest.mark.parametrize(("subdivisions", "highest"), [(2, 2), (4, 7)])
def test_harmonics_of_a_sphere_are_the_spherical_ones(subdivisions: int, highest: int) -> None:
    orders = np.arange(highest + 1)
    expected = np.repeat(orders, 2 * orders + 1)
    computed = harmonics(ball(subdivisions=subdivisions)).orders[: len(expected)]
    np.testing.assert_allclose(computed, expected, rtol=0.03, atol=1e-6)


def test_harmonics_of_a_thin_plate_pass_around_its_edge() -> None:
    # Both sides alike: nothing flows over the edge. Opposite: 0 at the edge. Closed forms.
    width, depth = 0.3, 0.2
    surface = harmonics(box((width, depth, 1e-4), (48, 32, 1)))
    m, n = np.meshgrid(np.arange(6), np.arange(6))
    both = np.square(np.pi * m / width) + np.square(np.pi * n / depth)
    opposite = both[(m > 0) & (n > 0)]
    expected = np.sort(np.concatenate([both.ravel(), opposite]))[:20]
    radius = surface.radius
    computed = np.sort(surface.orders * (surface.orders + 1) / radius**2)[:20]
    np.testing.assert_allclose(computed, expected, rtol=0.02, atol=1e-6)


def test_harmonics_are_orthonormal() -> None:
    surface = harmonics(bowl(0.06, 0.004, 24, 14))
    overlaps = surface.functions.T @ (surface.masses[:, None] * surface.functions)
    np.testing.assert_allclose(overlaps, np.eye(COUNT), atol=1e-9)


def test_harmonics_and_remainder_are_the_whole() -> None:
    mesh = bowl(0.06, 0.004, 24, 14)
    velocities = np.random.default_rng(4).normal(size=(len(mesh.faces), 5))
    surface = harmonics(mesh)
    split = surface.split(velocities)
    at_vertices = np.zeros((len(mesh.points), 5))
    for corner in mesh.faces.T:
        np.add.at(at_vertices, corner, mesh.areas[:, None] / 3 * velocities)
    at_vertices /= surface.masses[:, None]
    powers = np.square(split.parts).sum(axis=0) + split.powers.sum(axis=0)
    np.testing.assert_allclose(powers, surface.masses @ at_vertices**2, rtol=1e-9)
    np.testing.assert_allclose(split.totals, mesh.areas @ velocities**2, rtol=1e-9)


def test_remainder_has_the_spectrum_of_a_full_decomposition() -> None:
    # A sheet in waves, whose two sides move oppositely: at its edge the velocity jumps.
    mesh = box((0.3, 0.2, 0.004), (18, 12, 1))
    waves = np.cos(np.pi * mesh.points[:, 0] / 0.06) * np.cos(np.pi * mesh.points[:, 1] / 0.05)
    velocities = normal_velocities(mesh, (np.eye(3)[2] * waves[:, None])[:, :, None])
    surface = harmonics(mesh)
    split = surface.split(velocities)
    roots = np.sqrt(surface.masses)
    eigenvalues, vectors = eigh(surface.stiffness.toarray() / np.outer(roots, roots))
    exact_orders = np.sqrt(surface.radius**2 * eigenvalues.clip(0) + 0.25) - 0.5
    corner_flows = np.zeros((len(mesh.points), 1))
    for corner in mesh.faces.T:
        np.add.at(corner_flows, corner, mesh.areas[:, None] / 3 * velocities)
    exact_parts = vectors.T @ (corner_flows / roots[:, None])
    for size in (4.0, 8.0, 12.0):
        exact = sphere_impedance(exact_orders, size).real @ np.square(exact_parts[:, 0])
        computed = sphere_impedance(surface.orders, size).real @ np.square(split.parts[:, 0])
        computed += sphere_impedance(split.orders[:, 0], size).real @ split.powers[:, 0]
        assert computed == pytest.approx(exact, rel=0.1)
        function = sphere_impedance(exact_orders, size)
        pressures = (vectors / roots[:, None]) @ (function[:, None] * exact_parts)
        weights = split.weights[:, :, 0] @ sphere_impedance(split.orders[:, 0], size)
        approximate = surface.functions @ (
            sphere_impedance(surface.orders, size) * split.parts[:, 0]
        ) + np.einsum("bv,b->v", split.basis[:, :, 0], weights)
        deviation = surface.masses @ np.abs(approximate - pressures[:, 0]) ** 2
        assert deviation < 0.15**2 * (surface.masses @ np.abs(pressures[:, 0]) ** 2)


@pytest.mark.parametrize("order", [0, 1, 2, 5])
def test_spherical_order_is_a_harmonic_and_nothing_else(order: int) -> None:
    mesh = ball()
    surface = harmonics(mesh)
    split = surface.split(legendre(mesh, order))
    powers = np.square(split.parts[:, 0])
    own = np.abs(surface.orders - order) < 0.1
    assert powers[~own].sum() < 1e-5 * powers[own].sum()
    assert powers[own].sum() == pytest.approx(mesh.areas.sum() / (2 * order + 1), rel=0.07)


def test_order_of_the_remainder_is_that_of_the_remainder_alone() -> None:
    mesh = ball()
    split = harmonics(mesh).split(5 * legendre(mesh, 1) + legendre(mesh, 16))
    mean_order = (split.orders * split.powers).sum() / split.powers.sum()
    assert mean_order == pytest.approx(16, rel=0.05)  # with order 1 in its mean it would be 13

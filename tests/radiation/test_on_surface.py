from __future__ import annotations

import igl
import numpy as np
import pytest
from scipy.special import eval_legendre

from struck.model.mesh import Mesh
from struck.radiation.on_surface import COUNT, SurfaceHarmonics, laplacian, normal_velocities
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


def test_harmonics_and_rest_make_the_whole() -> None:
    mesh = bowl(0.06, 0.004, 24, 14)
    velocities = np.random.default_rng(4).normal(size=(len(mesh.faces), 5))
    split = harmonics(mesh).split(velocities)
    powers = np.square(split.parts).sum(axis=0) + split.remainder_powers
    np.testing.assert_allclose(powers, mesh.areas @ velocities**2, rtol=1e-9)


@pytest.mark.parametrize("order", [0, 1, 2, 5])
def test_spherical_order_is_a_harmonic_and_nothing_else(order: int) -> None:
    mesh = ball()
    surface = harmonics(mesh)
    split = surface.split(legendre(mesh, order))
    powers = np.square(split.parts[:, 0])
    own = np.abs(surface.orders - order) < 0.1
    assert powers[~own].sum() < 1e-5 * powers[own].sum()
    assert powers[own].sum() == pytest.approx(mesh.areas.sum() / (2 * order + 1), rel=0.07)


def test_order_of_the_rest_is_that_of_the_rest_alone() -> None:
    mesh = ball()
    rest = harmonics(mesh).split(5 * legendre(mesh, 1) + legendre(mesh, 16)).remainder_orders
    assert rest[0] == pytest.approx(16, rel=0.05)  # with order 1 in its mean it would be 13

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.special import eval_legendre

from struck.radiation.spherical import sphere_efficiency, split_by_order

# Spheres, orders 0 to 2: Junger & Feit; Fahy; checked there against spherical Hankel functions.
KA = np.array([0.1, 0.5, 1, 2, 5])
EFFICIENCIES = np.array(
    [
        [0.0099009901, 0.2, 0.5, 0.8, 0.96153846],
        [2.4999375e-05, 0.015384615, 0.2, 0.8, 0.9936407],
        [1.2332007e-08, 0.0001879346, 0.011235955, 0.4295302, 1.0643008],
    ]
)


def test_efficiency_of_a_sphere_is_the_published_one() -> None:
    computed = sphere_efficiency(np.arange(3)[:, None], KA)
    np.testing.assert_allclose(computed, EFFICIENCIES, rtol=1e-6)


def test_efficiency_holds_from_tiny_to_huge() -> None:
    orders = np.concatenate([[0, 1, 1.5, 12, 13.7], np.linspace(20, 250, 47)])
    sizes = np.geomspace(1e-3, 100, 61)
    computed = sphere_efficiency(orders[:, None], sizes)
    assert np.all((computed >= 0) & (computed < 10))
    np.testing.assert_allclose(computed[:5, -1], 1, atol=0.02)  # the surface as a plane
    np.testing.assert_allclose(computed[0], sizes**2 / (1 + sizes**2), rtol=1e-9)
    assert computed[-1, 0] == 0  # below the smallest number, yet a number


@pytest.mark.parametrize("count", [8, 100, 500])
def test_orders_and_rest_make_the_whole(count: int) -> None:
    generator = np.random.default_rng(count)
    directions, velocities = generator.normal(size=(count, 3)), generator.normal(size=(count, 5))
    directions[: count // 2, 2] *= 20  # mostly along one axis, as on a tube
    weights = generator.dirichlet(np.ones(count))
    shares, rest = split_by_order(directions, weights, velocities)
    whole = weights @ velocities**2
    np.testing.assert_allclose(shares.sum(axis=0) + weights @ rest**2, whole, rtol=1e-9)
    assert np.all(shares.sum(axis=0) > 0.1 * whole)


def test_orders_explain_directions_and_nothing_else() -> None:
    # Six directions, many faces in each: all that depends on direction is a mean in each of them,
    # and six functions of the orders 0 to 2 (1; x, y, z; two of second order) make any of those.
    generator = np.random.default_rng(9)
    axes = np.repeat(np.vstack([np.eye(3), -np.eye(3)]), 40, axis=0)
    velocities = generator.normal(size=(240, 3))
    means = velocities.reshape(6, 40, 3).mean(axis=1)
    shares, _ = split_by_order(axes, np.full(240, 1 / 240), velocities)
    np.testing.assert_allclose(shares.sum(axis=0), np.mean(means**2, axis=0), rtol=1e-9)
    np.testing.assert_allclose(shares[3:], 0, atol=1e-12)


def test_velocity_falls_into_its_own_order() -> None:
    sphere = trimesh.creation.icosphere(subdivisions=4)
    directions, weights = np.array(sphere.triangles_center), sphere.area_faces / sphere.area
    velocities = np.stack([eval_legendre(n, directions[:, 2]) for n in range(13)], axis=1)
    powers, _ = split_by_order(directions, weights, velocities)
    np.testing.assert_allclose(np.diag(powers / (weights @ velocities**2)), 1, atol=0.005)

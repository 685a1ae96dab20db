from __future__ import annotations

import numpy as np
import pytest
from scipy.special import h1vp, hankel1

from struck.radiation.on_surface import sphere_impedance

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
    computed = sphere_impedance(np.arange(3)[:, None], KA).real
    np.testing.assert_allclose(computed, EFFICIENCIES, rtol=1e-6)


def test_efficiency_holds_from_tiny_to_huge() -> None:
    orders = np.concatenate([[0, 1, 1.5, 12, 13.7], np.linspace(20, 250, 47)])
    sizes = np.geomspace(1e-3, 100, 61)
    computed = sphere_impedance(orders[:, None], sizes).real
    assert np.all((computed >= 0) & (computed < 10))
    np.testing.assert_allclose(computed[:5, -1], 1, atol=0.02)  # the surface as a plane
    np.testing.assert_allclose(computed[0], sizes**2 / (1 + sizes**2), rtol=1e-9)
    assert computed[-1, 0] == 0  # below the smallest number, yet a number


def test_impedance_of_a_sphere_is_that_of_the_textbooks() -> None:
    pulsating = KA * (KA - 1j) / (1 + KA**2)
    oscillating = KA * (KA**3 - 1j * (2 + KA**2)) / (4 + KA**4)
    np.testing.assert_allclose(sphere_impedance(0, KA), pulsating, rtol=1e-12)
    np.testing.assert_allclose(sphere_impedance(1, KA), oscillating, rtol=1e-12)


@pytest.mark.parametrize("order", [0.7, 3, 8.2, 40])
def test_impedance_of_any_order_is_that_of_the_hankel_functions(order: float) -> None:
    sizes = np.geomspace(0.3 * order, 30 * order, 20)
    value, slope = hankel1(order + 0.5, sizes), h1vp(order + 0.5, sizes)
    expected = 1j * value / (slope - value / (2 * sizes))
    np.testing.assert_allclose(sphere_impedance(order, sizes), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("order", [0, 1, 7.5, 40, 250])
def test_small_sphere_moves_the_mass_of_its_air(order: float) -> None:
    # Without compression, p falls as r^-(n+1): Euler's equation at the surface is p (n+1) / a.
    mass = -1j * 1e-3 / (order + 1)
    np.testing.assert_allclose(sphere_impedance(order, 1e-3), mass, rtol=2e-3)

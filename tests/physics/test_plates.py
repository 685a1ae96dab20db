"""Free plates against Kirchhoff's theory and NAFEMS, in the limit of a thin plate."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck import Material
from struck.solids import Block, Revolution
from struck.solids.fem.vibration import vibration_modes
from tests.physics import reference

Array = NDArray[np.float64]
STEEL = Material(density=8000.0, youngs_modulus=200e9, poisson_ratio=0.3)


def parameter(frequencies: Array, side: float, thickness: float) -> Array:
    """Return omega a^2 sqrt(rho h / D)."""
    stiffness = STEEL.youngs_modulus * thickness**3 / 12 / (1 - STEEL.poisson_ratio**2)
    inertia = STEEL.density * thickness
    return 2 * np.pi * frequencies * side**2 * np.sqrt(inertia / stiffness)


def test_nafems_fv12_free_thin_square_plate() -> None:
    mesh = Block(size=(10.0, 10.0, 0.05), elements=(18, 18, 1)).volume_mesh()
    found = vibration_modes(mesh, STEEL, 7.9).frequencies[:6]
    assert found == pytest.approx(reference.FV12_KIRCHHOFF, rel=2e-3)
    # What NAFEMS prints are upper bounds: series of few terms.
    assert (found < np.array(reference.FV12_PUBLISHED) + 5e-4).all()


def test_free_square_plate() -> None:
    mesh = Block(size=(1.0, 1.0, 0.004), elements=(14, 14, 1)).volume_mesh()
    modes = vibration_modes(mesh, STEEL, 80.0)
    found = parameter(modes.frequencies, 1.0, 0.004)[: len(reference.SQUARE_PLATE)]
    assert found == pytest.approx(reference.SQUARE_PLATE, rel=2e-3)


@pytest.mark.prove
def test_free_circular_plate() -> None:
    profile = [(0.0, 0.0), (0.5, 0.0)]
    disc = Revolution(profile=profile, wall=0.003, smooth=False, elements=(48, 14, 1))
    modes = vibration_modes(disc.volume_mesh(), STEEL, 90.0)
    found = parameter(modes.frequencies, 0.5, 0.003)
    expected = [
        value for value, diameters in reference.CIRCULAR_PLATE for _ in range(2 if diameters else 1)
    ]
    assert found[: len(expected)] == pytest.approx(expected, rel=3e-3)

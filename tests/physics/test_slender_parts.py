"""A thin rod on a thick block, turned against the lattice, bends as a beam does."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import Manifold
from numpy.typing import NDArray
from scipy import optimize

import struck
from struck.model.mesh import Mesh
from tests.physics.everyday import meshed

SIDE, LENGTH, RADIUS = 0.06, 0.12, 0.0025


def hammer() -> Mesh:
    """Return a cube with a rod that stands on the middle of one side, m."""
    side, length, radius = (1000 * each for each in (SIDE, LENGTH, RADIUS))
    rod = Manifold.cylinder(length + side / 2, radius, radius, 32)
    return meshed((Manifold.cube([side] * 3, center=True) + rod).rotate([20, 30, 40]))


def beam(material: struck.Material, count: int) -> NDArray[np.float64]:
    """Return frequencies of a slender free beam with a rigid cube at its other end, Hz."""
    area, bending = np.pi * RADIUS**2, material.youngs_modulus * np.pi * RADIUS**4 / 4
    line = material.density * area
    mass = material.density * SIDE**3
    inertia = mass * SIDE**2 / 6

    def unbalance(wave: float) -> float:
        # Deflection a (cosh + cos) + b (sinh + sin) from the free end, its slopes at the root.
        x = wave * LENGTH
        c, s = np.array([np.cosh(x), np.cos(x)]), np.array([np.sinh(x), np.sin(x)])
        moved = np.array([c.sum(), s.sum()])
        slope = wave * np.array([s[0] - s[1], c.sum()])
        bent = wave**2 * np.array([c[0] - c[1], s[0] - s[1]])
        sheared = wave**3 * np.array([s.sum(), c[0] - c[1]])
        square = bending * wave**4 / line
        # The cube's middle lies half a side beyond the root.
        middle = moved + slope * SIDE / 2
        force = bending * sheared - mass * square * middle
        moment = -bending * bent - bending * sheared * SIDE / 2 + inertia * square * slope
        return float(np.linalg.det(np.stack([force, moment])) / np.cosh(x) ** 2)

    waves = np.arange(0.5, 12.0, 0.05) / LENGTH
    signs = np.sign([unbalance(wave) for wave in waves])
    turns = np.flatnonzero(signs[1:] != signs[:-1])[:count]
    roots = np.array([optimize.brentq(unbalance, waves[i], waves[i + 1]) for i in turns])
    return roots**2 * np.sqrt(bending / line) / (2 * np.pi)


@pytest.mark.parametrize("accuracy", ["preview", pytest.param("standard", marks=pytest.mark.prove)])
def test_a_rod_on_a_block_bends_as_a_beam(accuracy: str) -> None:
    steel = struck.Material.named("steel")
    model = struck.analyze(hammer(), steel, accuracy=accuracy, band=(20, 5000), cache=False)
    pairs = np.repeat(beam(steel, 3), 2)
    true = np.abs(model.natural_frequencies / pairs - 1)
    assert np.all(true < 0.03)

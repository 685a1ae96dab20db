"""A thin rod on a thick block, turned against the lattice, bends as a beam does."""

from __future__ import annotations

import numpy as np
import pytest
from manifold3d import Manifold
from numpy.typing import NDArray
from scipy import linalg, optimize

import struck
from struck.model.mesh import Mesh
from tests.physics.everyday import meshed

SIDE, LENGTH, RADIUS, SIDES = 0.06, 0.12, 0.0025, 32


def hammer() -> Mesh:
    """Return a cube with a rod that stands on the middle of one side, m."""
    side, length, radius = (1000 * each for each in (SIDE, LENGTH, RADIUS))
    rod = Manifold.cylinder(length + side / 2, radius, radius, SIDES)
    return meshed((Manifold.cube([side] * 3, center=True) + rod).rotate([20, 30, 40]))


def beam(material: struck.Material, count: int) -> NDArray[np.float64]:
    """Return frequencies of a Timoshenko beam whose root turns in an elastic, heavy cube, Hz."""
    young, nu, line = material.youngs_modulus, material.poisson_ratio, material.density
    shear = young / (2 * (1 + nu))
    turn = 2 * np.pi / SIDES  # of the rod's polygon
    area = SIDES / 2 * RADIUS**2 * np.sin(turn)
    bending = area * RADIUS**2 * (2 + np.cos(turn)) / 12
    sheared = 6 * (1 + nu) / (7 + 6 * nu) * shear * area
    # A rigid disc on an elastic half-space turns by moment over this (Johnson 1985, chapter 3).
    root = 8 * shear * RADIUS**3 / (3 * (1 - nu))
    mass = line * SIDE**3
    inertia = mass * SIDE**2 / 6

    def unbalance(frequency: float) -> float:
        square = (2 * np.pi * frequency) ** 2
        slopes = np.zeros((4, 4))  # of deflection, angle, moment and shear force along the beam
        slopes[0, 1:] = 1, 0, 1 / sheared
        slopes[1, 2] = 1 / (young * bending)
        slopes[2, 1:] = -line * bending * square, 0, -1
        slopes[3, 0] = -line * area * square
        moved, angle, moment, force = linalg.expm(slopes * LENGTH)[:, :2]  # from the free end
        angle = angle + moment / root
        middle = moved + angle * SIDE / 2
        left = force - mass * square * middle
        turned = moment - force * SIDE / 2 - inertia * square * angle
        return float(np.linalg.det([left, turned]))

    grid = np.geomspace(20.0, 6000.0, 1000)
    signs = np.sign([unbalance(frequency) for frequency in grid])
    found = np.flatnonzero(signs[1:] != signs[:-1])[:count]
    return np.array([optimize.brentq(unbalance, grid[i], grid[i + 1]) for i in found])


@pytest.mark.prove
@pytest.mark.parametrize("accuracy", ["preview", "standard"])
def test_a_rod_on_a_block_bends_as_a_beam(accuracy: str) -> None:
    steel = struck.Material.named("steel")
    model = struck.analyze(hammer(), steel, accuracy=accuracy, band=(20, 5000), cache=False)
    true = np.abs(model.natural_frequencies / np.repeat(beam(steel, 3), 2) - 1)
    assert model.errors is not None
    assert np.all(true < np.minimum(model.errors, 0.03))

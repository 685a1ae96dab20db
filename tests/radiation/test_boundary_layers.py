"""Losses in the boundary layers, against closed forms of textbooks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.model.material import AIR
from struck.model.mesh import Mesh
from struck.radiation import RadiatedPower
from struck.radiation.boundary_layers import BoundaryLayers
from struck.radiation.on_surface import laplacian
from tests.radiation.bodies import ball, radial, rod

CENTRE = np.zeros(3)


def surface_decay(mesh: Mesh, shapes: NDArray[np.float64], frequency: float) -> float:
    """Return the decay rate of one mode by its boundary layers, 1/s."""
    losses = RadiatedPower().radiation(mesh, shapes, np.array([frequency]), CENTRE)[1]
    return float(losses.surface[0])


@pytest.mark.parametrize("frequency", [30.0, 60.0])
def test_oscillating_sphere_has_the_drag_of_a_thin_layer(frequency: float) -> None:
    mesh = ball(radius=0.05, subdivisions=3)
    shapes = np.broadcast_to(np.eye(3)[2], mesh.points.shape)[:, :, None]
    # Landau & Lifshitz 1987, section 24, problem 5: the force 3 pi a^2 sqrt(2 eta rho omega) u on a
    # sphere that is large against the layer and small against the wavelength (ka < 0.06).
    rate = 2 * np.pi * frequency
    drag = 3 * np.pi * 0.05**2 * np.sqrt(2 * AIR.viscosity * AIR.density * rate)
    assert surface_decay(mesh, shapes, frequency) == pytest.approx(drag / 2, rel=0.02)


def test_wave_in_a_wide_tube_decays_as_kirchhoff_has_it() -> None:
    radius, length, frequency = 0.01, 1.0, 1000.0
    mesh = rod(radius, length, around=24, along=160)
    wave_number = 2 * np.pi * frequency / AIR.sound_speed
    pressures = np.exp(1j * wave_number * mesh.points[:, 2:])
    layers = BoundaryLayers.of(mesh, *laplacian(mesh))
    still = np.zeros((len(mesh.faces), 3, 1))
    lost = layers.powers(pressures, still, np.array([frequency]), AIR)[0]
    # Kirchhoff 1868: the amplitude falls by exp(-alpha z), the power by twice that, on the inside
    # of a tube; the ends of the rod are 1 % of its skin.
    prandtl = AIR.viscosity * AIR.heat_capacity / AIR.conductivity
    alpha = np.sqrt(np.pi * frequency * AIR.viscosity / AIR.density) / (radius * AIR.sound_speed)
    alpha *= 1 + (AIR.heat_ratio - 1) / np.sqrt(prandtl)
    carried = 0.5 * AIR.impedance * np.pi * radius**2  # of the pressure rho c
    assert lost == pytest.approx(2 * alpha * length * carried, rel=0.02)


def test_pulsating_sphere_loses_heat_alone() -> None:
    mesh, frequency = ball(radius=0.05, subdivisions=3), 2000.0
    shapes = radial(mesh, np.ones(len(mesh.points)))
    size = 2 * np.pi * frequency / AIR.sound_speed * 0.05
    # The pressure of a pulsating sphere, in a wall that absorbs as a plane one (Landau & Lifshitz
    # 1987, section 79).
    diffusivity = AIR.conductivity / (AIR.density * AIR.heat_capacity)
    share = (AIR.heat_ratio - 1) * np.sqrt(np.pi * frequency * diffusivity) / AIR.sound_speed
    intensity = 0.5 * AIR.impedance * size**2 / (1 + size**2)
    expected = share * intensity * 4 * np.pi * 0.05**2
    assert surface_decay(mesh, shapes, frequency) == pytest.approx(expected, rel=0.02)


def test_skin_that_carries_its_air_along_has_no_friction() -> None:
    # The pressure i k x (over rho c) moves the air along x at unit velocity, as the wall here.
    mesh, frequency = rod(0.02, 0.3, around=16, along=20), np.array([300.0])
    layers = BoundaryLayers.of(mesh, *laplacian(mesh))
    air = replace(AIR, conductivity=1e-9)
    pressures = 2j * np.pi * frequency / air.sound_speed * mesh.points[:, :1]
    velocities = np.broadcast_to(np.eye(3)[0][:, None], (len(mesh.faces), 3, 1))
    together = layers.powers(pressures, velocities, frequency, air)
    wall_alone = layers.powers(0 * pressures, velocities, frequency, air)
    air_alone = layers.powers(pressures, 0 * velocities, frequency, air)
    np.testing.assert_allclose(air_alone, wall_alone, rtol=1e-3)
    assert together[0] < 1e-3 * wall_alone[0]

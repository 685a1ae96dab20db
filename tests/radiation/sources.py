"""Point sources inside a body: sound around it that is known exactly, in place of a solver's."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from struck.model.damping import InternalFriction
from struck.model.gains import ShapeGains
from struck.model.material import AIR, Material
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.radiation import by_name
from struck.radiation.directivity import RadiatingGains
from tests.radiation.bodies import ball

Array = NDArray[np.float64]
RADIUS = 0.06
HOLDER: Mesh = ball(RADIUS / 2, 1)  # of all sources
METAL = Material(
    name="metal",
    density=8000.0,
    youngs_modulus=1e11,
    poisson_ratio=0.3,
    damping=InternalFriction(loss_tangent=1e-3),
)


@dataclass(frozen=True, kw_only=True)
class Sources:
    """Modes, each some point sources in phase or against it."""

    positions: Array  # (S, 3), m
    strengths: Array  # (S, M), pressure at 1 m
    wave_numbers: Array  # (M,), 1/m
    modes: NDArray[np.int64]  # (M,), numbers in the body
    mesh: Mesh = HOLDER

    @property
    def errors(self) -> Array:
        """Relative errors of the pressure (M,): none."""
        return np.zeros(len(self.modes))

    def pressure(self, points: Array, modes: NDArray[np.int64]) -> NDArray[np.complex128]:
        distances = np.linalg.norm(points[:, None] - self.positions, axis=2)
        waves = np.exp(-1j * distances[:, :, None] * self.wave_numbers[modes])
        return np.einsum("psm,sm,ps->pm", waves, self.strengths[:, modes], 1 / distances)

    def chosen(self, modes: NDArray[np.int64], size: float, factor: float) -> Sources:
        some = [np.flatnonzero(self.modes == mode)[0] for mode in modes if mode in self.modes]
        return Sources(
            positions=self.positions * size,
            strengths=self.strengths[:, some] * factor * size,
            wave_numbers=self.wave_numbers[some] / size,
            modes=np.flatnonzero(np.isin(modes, self.modes)),
        )


def some_sources(frequencies: Array, *, count: int = 5, seed: int = 1) -> Sources:
    """Return modes of sources within half the radius of the ball."""
    chance = np.random.default_rng(seed)
    places = chance.normal(size=(count, 3))
    places *= (0.5 * RADIUS * chance.random(count) ** (1 / 3) / np.linalg.norm(places, axis=1))[
        :, None
    ]
    return Sources(
        positions=places,
        strengths=chance.normal(size=(count, len(frequencies))),
        wave_numbers=2 * np.pi * frequencies / AIR.sound_speed,
        modes=np.arange(len(frequencies)),
    )


@cache
def radiating_ball(
    *, count: int = 6, near: bool = False, subdivisions: int = 1
) -> tuple[ModalModel, Sources]:
    """Return a ball with a field of its modes, ka 0.4 to 5, and what it is the field of."""
    frequencies = np.geomspace(0.4, 5.0, count) * AIR.sound_speed / (2 * np.pi * RADIUS)
    parts = some_sources(frequencies)
    model = plain_ball(frequencies, subdivisions)
    gains = RadiatingGains.of(model.gains, frequencies, [parts], near=near)
    return replace(model, gains=gains), parts


def plain_ball(frequencies: Array, subdivisions: int = 1) -> ModalModel:
    surface: Mesh = ball(RADIUS, subdivisions)
    shapes = np.random.default_rng(2).normal(size=(len(surface.points), 3, len(frequencies)))
    decays = METAL.damping.decays(frequencies)
    return ModalModel(
        frequencies=np.sqrt(frequencies**2 - (decays / (2 * np.pi)) ** 2),
        natural_frequencies=frequencies,
        decays=decays,
        gains=ShapeGains.radiating(surface, shapes, frequencies, np.zeros(3), by_name("power")),
        material=METAL,
        mass=1.0,
        centre=np.zeros(3),
        geometry=surface,
        complete_to=float(frequencies[-1]),
    )

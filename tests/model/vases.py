"""A synthetic vase, round about the z axis, recorded as in 2007: 3 heights, 19 listeners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from struck.model.survey import Survey, from_spherical

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

RATE = 44100
HEIGHTS = np.array([[1.0], [0.5], [0.0]])
"""Rim, middle and foot."""
NODES = (3, 11)
"""Modes with a node at the rim."""
RADIUS = 0.2
"""Holds the vase and the listener inside, m."""
MODES = 25


def listeners() -> Array:
    """Return the paper's 19 places, m: two distances of 9 each, and one inside.

    Its text has the polar angles 0, pi/2 and pi, but says that points at 0 are the same for all
    azimuths and that there are 57 grid points; only angles above the table, 0, pi/4 and pi/2, give
    that number of different ones.
    """
    azimuths = np.array([0, np.pi / 2, np.pi, -np.pi / 2])
    around = [from_spherical(1.0, azimuths, polar) for polar in (np.pi / 4, np.pi / 2)]
    half = np.concatenate([[[0.0, 0.0, 1.0]], *around])
    return np.concatenate([0.5 * half, half, [[0.0, 0.0, 0.12]]])


@dataclass(frozen=True, kw_only=True, eq=False)
class Vase:
    """Modes that are shapes over the height times directions over the listeners.

    frequencies, decays (M,); waves, phases (M,): shapes are cos(pi waves (1 - h) - phases);
    amplitudes (6, M): of the harmonics up to order 2 that are even in y; inside (M,).
    """

    frequencies: Array
    decays: Array
    waves: Array
    phases: Array
    amplitudes: Complex
    inside: Complex

    @classmethod
    def drawn(cls, chance: Generator, *, free: bool = True) -> Vase:
        """Draw one: with a free rim, where all modes but `NODES` are strongest, or with any."""
        count = MODES
        waves = chance.integers(0, 3, count)
        phases = np.zeros(count) if free else chance.uniform(0, 2 * np.pi, count)
        waves[list(NODES)] = np.where(free, 1, waves[list(NODES)])
        phases[list(NODES)] = np.where(free, np.pi / 2, phases[list(NODES)])
        levels = 10 ** (chance.normal(0, 8, count) / 20)
        frequencies = np.sort(np.exp(chance.uniform(np.log(200), np.log(8000), count)))
        spread = chance.normal(size=(2, 6, count)) / np.array([1, 2, 2, 3, 3, 3])[:, None]
        inside = 2 * chance.normal(size=(2, count))
        return cls(
            frequencies=frequencies,
            decays=(1.5 + 2.5e-7 * frequencies**2) * np.exp(chance.normal(0, 0.4, count)),
            waves=waves.astype(float),
            phases=phases,
            amplitudes=levels * (spread[0] + 1j * spread[1]),
            inside=levels * (inside[0] + 1j * inside[1]),
        )

    def drives(self, heights: Array) -> Array:
        """Return the shapes at heights (K,): (K, M)."""
        return np.sqrt(2) * np.cos(np.pi * self.waves * (1 - heights[:, None]) - self.phases)

    def outputs(self, places: Array) -> Complex:
        """Return what arrives at places (L, 3): (L, M)."""
        distances = np.linalg.norm(places, axis=1)
        x, y, z = (places / distances[:, None]).T
        harmonics = np.stack(
            [
                np.ones_like(x),
                np.sqrt(3) * z,
                np.sqrt(3) * x,
                np.sqrt(5) / 2 * (3 * z**2 - 1),
                np.sqrt(15) * x * z,
                np.sqrt(15) / 2 * (x**2 - y**2),
            ]
        )
        around = harmonics.T @ self.amplitudes / distances[:, None]
        return np.where((distances < RADIUS)[:, None], self.inside, around)

    def gains(self, heights: Array, places: Array) -> Complex:
        """Return the gains of every height with every place (K, L, M)."""
        return self.drives(heights)[:, None] * self.outputs(places)[None]

    def survey(self, heights: Array, gains: Complex) -> Survey:
        """Return what was recorded, as gains (P, Q, M), of heights (P, 1)."""
        return Survey.full(heights, listeners(), gains, self.frequencies, symmetry="axial")

    def recorded(self, gains: Complex, level: float, chance: Generator) -> Complex:
        """Return gains (..., M) as one second of sound in white noise tells them.

        The noise lies `level` dB under the mean rms of the first 100 ms; frequencies and decays are
        taken as known.
        """
        times = np.arange(RATE) / RATE
        turns = np.exp((-self.decays + 2j * np.pi * self.frequencies)[:, None] * times)
        basis = np.concatenate([turns.imag, turns.real])
        flat = gains.reshape(-1, gains.shape[-1])
        sound = np.concatenate([flat.real, flat.imag], axis=1) @ basis
        loud = np.sqrt(np.square(sound[:, : RATE // 10]).mean(axis=1)).mean()
        sound += loud * 10 ** (-level / 20) * chance.standard_normal(sound.shape)
        found = np.linalg.solve(basis @ basis.T, basis @ sound.T).T
        count = len(self.frequencies)
        return (found[:, :count] + 1j * found[:, count:]).reshape(gains.shape)


def noisy(gains: Complex, level: float, chance: Generator) -> Complex:
    """Return gains with noise so far, dB, under their own root mean square."""
    strength = np.sqrt(np.square(np.abs(gains)).mean() / 2) * 10 ** (-level / 20)
    noise = chance.normal(size=(2, *gains.shape))
    return gains + strength * (noise[0] + 1j * noise[1])


def error(found: Complex, true: Complex) -> float:
    """Return the energy of the difference over that of the truth, dB."""
    return float(
        10 * np.log10(np.square(np.abs(found - true)).sum() / np.square(np.abs(true)).sum())
    )

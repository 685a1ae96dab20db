"""Multipoles: the sound around a body as outgoing spherical waves about its centre, mode by mode.

Time goes as exp(+i w t). A wave of degree l and order m is (1/r) g_l(kr) Y_lm with the real
harmonics of mean square 1 and g_l(x) = x exp(ix) h_l(x) / i^(l+1), h_l the spherical Hankel
function of the second kind: 1 far away, and relative to the arrival time r/c everywhere (Williams
1999, section 6.7).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from struck.errors import OptionError
from struck.model.arrays import Array, Complex, Index, checked, require_numbers
from struck.model.waves import degrees, real_harmonics

MAX_DEGREE = 24  # the largest degree of waves
FAR, CLOSE = 1.5, 1.2  # radii: waves are fitted at the first, and tried at both
_MAX_LOSS = 1e-4  # fraction of the mean square at `FAR` that waves of higher degrees may have
# Degrees of the samples, chosen so that aliases spare low degrees.
_ROUNDS = (16, MAX_DEGREE)
_TEST_DEGREE = 12  # degree of the places at which waves are tried

# From places (P, 3), m, and numbers of modes (K,): (P, K), Pa for unit modal velocity.
Pressure = Callable[[Array, Index], Complex]


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Multipoles:
    """Outgoing waves of M modes about a centre, of as many degrees as each needs.

    Parameters
    ----------
    wave_numbers : array (M,)
        1/m.
    degrees : array of int (M,)
        The highest degree P of each mode, at most `MAX_DEGREE`.
    amplitudes : array (T,), complex
        Of each wave far away at 1 m, Pa for a modal velocity of 1 kg^1/2 m/s: (P + 1)^2 of each
        mode, by degree, then by order from -l to l; mode after mode.
    radius : float
        Of the ball about the centre that holds the body, m.
    errors : array (M, 2)
        Errors of the waves at `FAR` and at `CLOSE` radii, over the root mean square there; they
        fall with the distance. NaN for modes that are estimated, the same in all directions.

    Raises
    ------
    OptionError
        On arrays that do not belong together.
    """

    wave_numbers: Array
    degrees: Index
    amplitudes: Complex
    radius: float
    errors: Array

    def __post_init__(self) -> None:
        count = np.shape(self.wave_numbers)[:1]
        require_numbers("wave_numbers", self.wave_numbers, count, least=0)
        require_numbers("errors", self.errors, (*count, 2), gaps=True, least=0)
        if (
            self.degrees.shape != count
            or not np.isin(self.degrees, np.arange(MAX_DEGREE + 1)).all()
        ):
            raise OptionError(
                f"degrees of {self.degrees.shape} modes up to {np.max(self.degrees, initial=0)}: "
                f"give one of 0 to {MAX_DEGREE} for each of {count[0]} modes"
            )
        require_numbers("amplitudes", self.amplitudes, (int(np.square(self.degrees + 1).sum()),))
        if not 0 < self.radius < np.inf or not (self.wave_numbers > 0).all():
            raise OptionError(
                f"a radius of {self.radius} m, wave numbers from {np.min(self.wave_numbers)} 1/m: "
                "both must exceed 0"
            )

    @classmethod
    def of(
        cls, waves: Sequence[Complex], wave_numbers: Array, *, radius: float, errors: Array
    ) -> Multipoles:
        """Make multipoles of the amplitudes ((P + 1)^2,) of each mode."""
        return cls(
            wave_numbers=wave_numbers,
            degrees=np.array([round(len(amplitudes) ** 0.5) - 1 for amplitudes in waves], np.int64),
            amplitudes=np.concatenate([np.zeros(0, np.complex128), *waves]),
            radius=radius,
            errors=errors,
        )

    @classmethod
    def fit(
        cls, pressure: Pressure, *, centre: Array, radius: float, wave_numbers: Array
    ) -> Multipoles:
        """Find the waves of modes whose sound around the body is known.

        Each mode gets the least degree that misses at most 1 % of the root mean square at `FAR`
        radii, so no lower one than its own order about an axis. At least 2 (P + 1)^2 samples lie
        where products of harmonics are summed exactly (Gauss & Legendre), so that high degrees,
        loud nearby, do not disturb low ones, which alone are heard far away.

        Parameters
        ----------
        pressure : callable
            From places (P, 3), m, and numbers of modes (K,) to (P, K), Pa for unit modal velocity;
            asked at 578 to 1,250 places, then at 676.
        centre : array (3,)
            m.
        radius : float
            Of the ball about it that holds the body, m.
        wave_numbers : array (M,)
            1/m.
        """
        count = len(wave_numbers)
        waves: list[Complex] = [np.zeros(0, np.complex128)] * count
        left = np.arange(count)
        for degree in _ROUNDS:
            places, weights = sphere_rule(degree)
            pressures = pressure(centre + FAR * radius * places, left)
            amplitudes, squares = _project(
                pressures, places, weights, wave_numbers[left] * FAR * radius
            )
            needed_degrees = _find_degrees(squares)
            is_done = (needed_degrees <= degree - 2) | (degree == MAX_DEGREE)
            for column in np.flatnonzero(is_done):
                waves[left[column]] = (
                    FAR * radius * amplitudes[: (needed_degrees[column] + 1) ** 2, column]
                )
            left = left[~is_done]
            if not len(left):
                break
        multipoles = cls.of(waves, wave_numbers, radius=radius, errors=np.zeros((count, 2)))
        return replace(multipoles, errors=_errors(multipoles, pressure, centre))

    @property
    def count(self) -> int:
        """Number of modes, M."""
        return len(self.wave_numbers)

    @property
    def levels(self) -> Array:
        """Root mean square over far directions, referred to 1 m (M,): the measure of power."""
        return np.sqrt(np.square(np.abs(self._table)).sum(axis=0))

    @cached_property
    def _table(self) -> Complex:
        """Amplitudes (B, M), 0 for degrees that a mode does not have."""
        table = np.zeros(((int(self.degrees.max(initial=0)) + 1) ** 2, self.count), np.complex128)
        table.T[np.arange(len(table)) < np.square(self.degrees + 1)[:, None]] = self.amplitudes
        return table

    def at(self, places: Array) -> Complex:
        """Return the pressure at places (L, 3) from the centre, relative to the arrival: (L, M)."""
        distances = np.linalg.norm(places, axis=1)
        max_degree = int(self.degrees.max(initial=0))
        harmonics = real_harmonics(places / distances[:, None], max_degree)
        first = np.arange(max_degree + 1) ** 2
        parts = np.add.reduceat(harmonics[:, :, None] * self._table, first, axis=1)
        laws = outgoing_waves(max_degree, np.multiply.outer(distances, self.wave_numbers))
        return np.einsum("lpm,plm->lm", parts, laws) / distances[:, None]

    def chosen(self, modes: Index, size: float, factor: float | Array) -> Multipoles:
        """Return some modes of a body `size` times as large, whose shapes are `factor` times so.

        There may be one factor for each (K,). Wave numbers fall as 1 / size: then all scales.
        """
        waves, factors = self.waves, np.broadcast_to(factor, len(modes)) * size
        return Multipoles.of(
            [waves[mode] * scale for mode, scale in zip(modes, factors, strict=True)],
            self.wave_numbers[modes] / size,
            radius=self.radius * size,
            errors=self.errors[modes],
        )

    @classmethod
    def join(
        cls, parts: Sequence[tuple[Index, Multipoles]], outputs: Complex, wave_numbers: Array
    ) -> Multipoles:
        """Return the field of all M modes of a body, joined from fields of some of them.

        Modes in no part have the estimates `outputs` (M,) at 1 m in all directions.
        """
        waves = list(outputs[:, None])
        errors = np.full((len(outputs), 2), np.nan)
        for modes, part in parts:
            errors[modes] = part.errors
            for mode, amplitudes in zip(modes, part.waves, strict=True):
                waves[mode] = amplitudes
        radius = max(part.radius for _, part in parts)
        return cls.of(waves, wave_numbers, radius=radius, errors=errors)

    @property
    def waves(self) -> list[Complex]:
        """Amplitudes ((P + 1)^2,) of each mode."""
        ends = np.cumsum(np.square(self.degrees + 1))
        return np.split(self.amplitudes, ends[:-1]) if self.count else []


def _errors(waves: Multipoles, pressure: Pressure, centre: Array) -> Array:
    """Return how far waves are from the sound itself at `FAR` and `CLOSE` radii (M, 2)."""
    directions, weights = sphere_rule(_TEST_DEGREE)
    errors = np.empty((waves.count, 2))
    for side, distance in enumerate((FAR * waves.radius, CLOSE * waves.radius)):
        pressures = pressure(centre + distance * directions, np.arange(waves.count))
        pressures = pressures * np.exp(1j * waves.wave_numbers * distance)
        squared_errors = np.square(np.abs(waves.at(distance * directions) - pressures))
        mean_squares = np.maximum(weights @ np.square(np.abs(pressures)), np.finfo(float).tiny)
        errors[:, side] = np.sqrt(weights @ squared_errors / mean_squares)
    return errors


def outgoing_waves(max_degree: int, arguments: Array) -> Complex:
    """Return g_l(x) of degrees 0 to `max_degree` at x = kr (...): (max_degree + 1, ...)."""
    # h_l grows with l at a given x, so that the recurrence is stable upward.
    laws = np.ones((max_degree + 1, *arguments.shape), np.complex128)
    reciprocals = -1j / arguments
    if max_degree:
        laws[1] += reciprocals
    for degree in range(1, max_degree):
        laws[degree + 1] = laws[degree - 1] + (2 * degree + 1) * reciprocals * laws[degree]
    return laws


def sphere_rule(degree: int) -> tuple[Array, Array]:
    """Return directions (P, 3) and weights (P,), of sum 1, exact for harmonics to 2 degree + 1."""
    heights, height_weights = np.polynomial.legendre.leggauss(degree + 1)
    azimuths = 2 * np.pi * (np.arange(2 * degree + 2) + 0.5) / (2 * degree + 2)
    flat = np.sqrt(1 - heights**2)[:, None]
    rows = np.broadcast_arrays(flat * np.cos(azimuths), flat * np.sin(azimuths), heights[:, None])
    weights = np.repeat(height_weights / 2, len(azimuths)) / len(azimuths)
    return np.stack(rows, axis=-1).reshape(-1, 3), weights


def _project(
    pressures: Complex, directions: Array, weights: Array, arguments: Array
) -> tuple[Complex, Array]:
    """Return amplitudes (B, M) over the distance, and mean squares by degree and of the remainder.

    `pressures` (P, M) are those in directions (P, 3) at one distance, where kr is `arguments` (M,).
    The last of the mean squares (degree + 2, M) is that of the remainder.
    """
    degree = round((len(weights) / 2) ** 0.5) - 1
    degree_of, _ = degrees(degree)
    parts = (real_harmonics(directions, degree) * weights[:, None]).T @ pressures
    sums = np.add.reduceat(np.square(np.abs(parts)), np.arange(degree + 1) ** 2, axis=0)
    remainder = np.maximum(weights @ np.square(np.abs(pressures)) - sums.sum(axis=0), 0.0)
    waves = parts * np.exp(1j * arguments) / outgoing_waves(degree, arguments)[degree_of]
    return waves, np.vstack([sums, remainder])


def _find_degrees(squares: Array) -> Index:
    """Return the least degree (M,) above which at most `_MAX_LOSS` of mean squares is left."""
    power_above = np.cumsum(squares[::-1], axis=0)[::-1][1:]  # beyond degree 0, 1, ...
    is_enough = power_above <= _MAX_LOSS * squares.sum(axis=0)
    return np.where(is_enough.any(axis=0), is_enough.argmax(axis=0), MAX_DEGREE)

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

HIGHEST = 24  # the largest degree of waves
FAR, CLOSE = 1.5, 1.2  # radii: waves are fitted at the first, and tried at both
_LOST = 1e-4  # share of the mean square at `FAR` that waves of higher degrees may have
_ROUNDS = (16, HIGHEST)  # degrees of the samples, so that what they miss folds onto none of the low
_TRIED = 12  # degree of the places at which waves are tried

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
        The highest degree P of each mode, at most `HIGHEST`.
    amplitudes : array (T,), complex
        Of each wave far away at 1 m, Pa for a modal velocity of 1 kg^1/2 m/s: (P + 1)^2 of each
        mode, by degree, then by order from -l to l; mode after mode.
    radius : float
        Of the ball about the centre that holds the body, m.
    errors : array (M, 2)
        What the waves miss at `FAR` and at `CLOSE` radii, over the root mean square there; falling
        with the distance. NaN for modes that are estimated, the same in all directions.

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
        if self.degrees.shape != count or not np.isin(self.degrees, np.arange(HIGHEST + 1)).all():
            raise OptionError(
                f"degrees of {self.degrees.shape} modes up to {np.max(self.degrees, initial=0)}: "
                f"give one of 0 to {HIGHEST} for each of {count[0]} modes"
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
            degrees=np.array([round(len(each) ** 0.5) - 1 for each in waves], np.int64),
            amplitudes=np.concatenate([np.zeros(0, np.complex128), *waves]),
            radius=radius,
            errors=errors,
        )

    @classmethod
    def fitted(
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
            heard = pressure(centre + FAR * radius * places, left)
            found, squares = _projected(heard, places, weights, wave_numbers[left] * FAR * radius)
            needed = _needed(squares)
            done = (needed <= degree - 2) | (degree == HIGHEST)
            for column in np.flatnonzero(done):
                waves[left[column]] = FAR * radius * found[: (needed[column] + 1) ** 2, column]
            left = left[~done]
            if not len(left):
                break
        fitted = cls.of(waves, wave_numbers, radius=radius, errors=np.zeros((count, 2)))
        return replace(fitted, errors=_errors(fitted, pressure, centre))

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
        highest = int(self.degrees.max(initial=0))
        harmonics = real_harmonics(places / distances[:, None], highest)
        first = np.arange(highest + 1) ** 2
        parts = np.add.reduceat(harmonics[:, :, None] * self._table, first, axis=1)
        laws = outgoing(highest, np.multiply.outer(distances, self.wave_numbers))
        return np.einsum("lpm,plm->lm", parts, laws) / distances[:, None]

    def chosen(self, modes: Index, size: float, factor: float | Array) -> Multipoles:
        """Return some modes of a body `size` times as large, whose shapes are `factor` times so.

        There may be one factor for each (K,). Wave numbers fall as 1 / size: then all scales.
        """
        waves, factors = self.waves, np.broadcast_to(factor, len(modes)) * size
        return Multipoles.of(
            [waves[mode] * each for mode, each in zip(modes, factors, strict=True)],
            self.wave_numbers[modes] / size,
            radius=self.radius * size,
            errors=self.errors[modes],
        )

    @classmethod
    def joined(
        cls, parts: Sequence[tuple[Index, Multipoles]], outputs: Complex, wave_numbers: Array
    ) -> Multipoles:
        """Return the field of all M modes of a body, joined from fields of some of them.

        Of modes in no part the estimates `outputs` (M,) at 1 m are heard, alike on all sides.
        """
        waves = list(outputs[:, None])
        errors = np.full((len(outputs), 2), np.nan)
        for modes, part in parts:
            errors[modes] = part.errors
            for mode, own in zip(modes, part.waves, strict=True):
                waves[mode] = own
        radius = max(part.radius for _, part in parts)
        return cls.of(waves, wave_numbers, radius=radius, errors=errors)

    @property
    def waves(self) -> list[Complex]:
        """Amplitudes ((P + 1)^2,) of each mode."""
        ends = np.cumsum(np.square(self.degrees + 1))
        return np.split(self.amplitudes, ends[:-1]) if self.count else []


def _errors(waves: Multipoles, pressure: Pressure, centre: Array) -> Array:
    """Return how far waves are from the sound itself at `FAR` and `CLOSE` radii (M, 2)."""
    directions, weights = sphere_rule(_TRIED)
    errors = np.empty((waves.count, 2))
    for side, distance in enumerate((FAR * waves.radius, CLOSE * waves.radius)):
        heard = pressure(centre + distance * directions, np.arange(waves.count))
        heard = heard * np.exp(1j * waves.wave_numbers * distance)
        missed = np.square(np.abs(waves.at(distance * directions) - heard))
        whole = np.maximum(weights @ np.square(np.abs(heard)), np.finfo(float).tiny)
        errors[:, side] = np.sqrt(weights @ missed / whole)
    return errors


def outgoing(highest: int, arguments: Array) -> Complex:
    """Return g_l(x) of degrees 0 to `highest` at x = kr (...): (highest + 1, ...)."""
    # h_l grows with l at a given x, so that the recurrence is stable upward.
    laws = np.ones((highest + 1, *arguments.shape), np.complex128)
    turns = -1j / arguments
    if highest:
        laws[1] += turns
    for degree in range(1, highest):
        laws[degree + 1] = laws[degree - 1] + (2 * degree + 1) * turns * laws[degree]
    return laws


def sphere_rule(degree: int) -> tuple[Array, Array]:
    """Return directions (P, 3) and weights (P,), of sum 1, exact for harmonics to 2 degree + 1."""
    heights, shares = np.polynomial.legendre.leggauss(degree + 1)
    around = 2 * np.pi * (np.arange(2 * degree + 2) + 0.5) / (2 * degree + 2)
    flat = np.sqrt(1 - heights**2)[:, None]
    rows = np.broadcast_arrays(flat * np.cos(around), flat * np.sin(around), heights[:, None])
    weights = np.repeat(shares / 2, len(around)) / len(around)
    return np.stack(rows, axis=-1).reshape(-1, 3), weights


def _projected(
    heard: Complex, directions: Array, weights: Array, arguments: Array
) -> tuple[Complex, Array]:
    """Return amplitudes (B, M) over the distance, and mean squares by degree and of the rest.

    Of sound heard (P, M) in directions (P, 3) at one distance, where kr is `arguments` (M,). The
    mean squares (degrees + 1, M) are there, the last of what harmonics leave.
    """
    degree = round((len(weights) / 2) ** 0.5) - 1
    degree_of, _ = degrees(degree)
    parts = (real_harmonics(directions, degree) * weights[:, None]).T @ heard
    sums = np.add.reduceat(np.square(np.abs(parts)), np.arange(degree + 1) ** 2, axis=0)
    rest = np.maximum(weights @ np.square(np.abs(heard)) - sums.sum(axis=0), 0.0)
    waves = parts * np.exp(1j * arguments) / outgoing(degree, arguments)[degree_of]
    return waves, np.vstack([sums, rest])


def _needed(squares: Array) -> Index:
    """Return the least degree (M,) above which at most `_LOST` of mean squares is left."""
    above = np.cumsum(squares[::-1], axis=0)[::-1][1:]  # beyond degree 0, 1, ...
    enough = above <= _LOST * squares.sum(axis=0)
    return np.where(enough.any(axis=0), enough.argmax(axis=0), HIGHEST)

"""Reverberation: the late sound of a room, noise that dies away at the same rate everywhere."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError, require_choice
from struck.model.arrays import (
    Array,
    Complex,
    Single,
    checked,
    numbers,
    require_number,
    require_sample_rate,
)
from struck.model.damping import in_hertz
from struck.model.material import AIR

EAR_SPACING = 0.175  # m: twice the radius 8.75 cm of the sphere that models a head
_LONGEST = 120.0  # s: no hall of people reverberates as long
# Reverberation time times absorption area over volume: 0.161 s/m.
SABINE = 24 * math.log(10) / AIR.sound_speed
_AMPLITUDE = 3 * math.log(10)  # exponent by which an amplitude falls by 60 dB


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Reverberation:
    """A diffuse sound field: equal from all directions, with an exponential decay.

    Parameters
    ----------
    seconds : float or mapping of float or str to float
        Reverberation time T60, s; or one for each centre frequency of a band, Hz (or "1 kHz", or a
        note). Between two centres the bands are cross-faded over the logarithm of the frequency;
        the lowest and the highest reach to the ends of the spectrum.
    volume : float, optional
        Volume of the room, m^3, from which the level follows.
    level : float, optional
        Instead of the volume: energy of the whole decay relative to that of the direct sound at 1 m
        from the source, dB.
    seed : int, default 0
        Seed of the noise.

    Raises
    ------
    OptionError
        If a time, a band or the volume is not positive, or volume and level are both given or both
        missing.

    Notes
    -----
    A source that radiates equally to all sides, of mean square pressure p^2 at 1 m, fills a room
    of absorption area A with a mean square pressure 16 pi p^2 / A; direct sound and reverberation
    are equal at the critical distance sqrt(A / (16 pi)). With A from Sabine's formula the decay
    after an impulse starts at an energy of 4 pi c / V a second, whatever the reverberation time
    (H. Kuttruff, Room Acoustics, 5th ed., Spon Press, 2009, chapter 5).

    Examples
    --------
    >>> hall = struck.Reverberation(seconds={"250 Hz": 2.0, "4 kHz": 1.0}, volume=2000.0)
    >>> hall.bands().tolist()
    [[250.0, 2.0], [4000.0, 1.0]]
    >>> hall.critical_distances().round(1)
    array([1.8, 2.5])
    """

    seconds: float | Mapping[float | str, float]
    volume: float | None = None
    level: float | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if (self.volume is None) == (self.level is None):
            raise OptionError(
                f"volume is {self.volume} and level is {self.level}: give one of them"
            )
        if self.volume is not None and not 0 < self.volume < math.inf:
            raise OptionError(f"a volume of {self.volume} m^3 is no room's: give a positive one")
        if self.level is not None and not math.isfinite(self.level):
            raise OptionError(f"level is {self.level}: give decibels, as -20")
        bands = self.bands()
        if not len(bands):
            raise OptionError("seconds names no band: give a time for one at least, as {1000: 0.6}")
        hint = "give one above 0, and finite"
        for name, column, maximum in zip(("Hz", "s"), bands.T, (1e6, _LONGEST), strict=True):
            for value in column:
                require_number(f"reverberation in {name}", value, 0, maximum, above=True, hint=hint)
        require_number("seed", self.seed, 0, 2.0**63)

    def bands(self) -> Array:
        """Return centre frequency and reverberation time of each band.

        A single time is at 1 kHz.

        Returns
        -------
        array (bands, 2)
            Centre frequencies, ascending, Hz, and T60, s.
        """
        times = self.seconds if isinstance(self.seconds, Mapping) else {1000.0: self.seconds}
        table = numbers(
            "seconds", list(zip(in_hertz("seconds", times), times.values(), strict=True))
        )
        table = table.reshape(-1, 2)
        return table[np.argsort(table[:, 0], kind="stable")]

    def absorption_areas(self) -> Array:
        """Compute the absorption area of each band.

        It follows from the volume by Sabine's formula, otherwise from the level.

        Returns
        -------
        array (bands,)
            Absorption areas, m^2.
        """
        if self.volume is not None:
            return SABINE * self.volume / self.bands()[:, 1]
        level = self.level or 0.0  # one of both is given
        return np.full(len(self.bands()), 16 * math.pi / 10 ** (level / 10))

    def critical_distances(self) -> Array:
        """Compute the distances at which direct sound and reverberation are equally loud.

        Kuttruff 2009, chapter 5, for an omnidirectional source.

        Returns
        -------
        array (bands,)
            Distances, m.
        """
        return np.sqrt(self.absorption_areas() / (16 * math.pi))

    @checked
    def tail(
        self,
        sample_rate: float,
        channels: int = 2,
        *,
        start: float = 0.0,
        ear_spacing: float = EAR_SPACING,
    ) -> Single:
        """Compute the response of the room to an impulse that is 1 at 1 m from the source.

        Parameters
        ----------
        sample_rate : float
            Sample rate, Hz.
        channels : int, default 2
            1, or 2 for both ears, each with the level of the single one.
        start : float, default 0.0
            Time of the first sample after the emission of the impulse, s: the mixing time, at which
            the image sources end. Earlier samples are left out, later ones do not change.
        ear_spacing : float, default 0.175
            Distance of the ears, m, which are coherent as two points in a diffuse field, sin(k d) /
            (k d) (R. K. Cook et al., J. Acoust. Soc. Am. 27(6), 1072-1077, 1955).

        Returns
        -------
        array (channels, n), float32
            Response until 60 dB of decay after the longest reverberation time; empty if that is
            before `start`.

        Raises
        ------
        OptionError
            If an argument is out of range.
        """
        _require(sample_rate, channels, start, ear_spacing)
        count = max(0, math.ceil((self.bands()[:, 1].max() - start) * sample_rate))
        if count == 0:
            return np.zeros((channels, 0), np.float32)
        white = np.random.default_rng(int(self.seed)).standard_normal((channels, count))
        noise = _coherent(np.fft.rfft(white), sample_rate, ear_spacing)
        times = start + np.arange(count) / sample_rate
        return self._decaying(noise, sample_rate, times).astype(np.float32)

    def _decaying(self, spectra: Complex, sample_rate: float, times: Array) -> Array:
        """Multiply each band of white noise by the decay of the band, and sum the bands."""
        total = np.zeros((len(spectra), len(times)))
        frequencies = np.fft.rfftfreq(len(times), 1 / sample_rate)
        centres, seconds = self.bands().T
        energies = 16 * math.pi / self.absorption_areas() * 2 * _AMPLITUDE / seconds  # a second
        shares = band_shares(frequencies, centres)
        for energy, time, weights in zip(energies, seconds, shares, strict=True):
            envelope = math.sqrt(energy / sample_rate) * np.exp(-_AMPLITUDE * times / time)
            total += envelope * np.fft.irfft(spectra * weights, len(times))
        return total


def band_shares(frequencies: ArrayLike, centres: Array) -> Array:
    """Return the share of each band in each frequency (bands, F): 1 at its centre, 1 in sum.

    Neighbouring bands (centres in Hz, rising) fade into one another as cos^2 over log frequency.
    """
    lowest_centre = centres[0]
    place = np.log(np.clip(frequencies, lowest_centre, centres[-1]) / lowest_centre)
    triangles = [
        np.interp(place, np.log(centres / lowest_centre), unit) for unit in np.eye(len(centres))
    ]
    return np.sin(np.pi / 2 * np.array(triangles)) ** 2


def statistical_time(
    volume: float, areas: Array, absorptions: Array, formula: str = "eyring"
) -> Array:
    """Return the reverberation time of a room by Eyring's or Sabine's formula, s (bands,).

    From its volume, m^3, the areas of its walls, m^2, and absorbed shares of the energy (walls,
    bands). Infinite where nothing is absorbed; 0 by Eyring's formula where all is. Air absorbs
    nothing; Sabine's holds where little is absorbed (Kuttruff 2009, chapter 5).
    """
    mean = areas @ absorptions / areas.sum()
    require_choice("formula", formula, ("eyring", "sabine"))
    with np.errstate(divide="ignore"):
        loss = mean if formula == "sabine" else -np.log1p(-mean)
        return SABINE * volume / (areas.sum() * loss)


def _coherent(spectra: Complex, sample_rate: float, spacing: float) -> Complex:
    """Mix two independent noises into two as coherent as in a diffuse field."""
    if len(spectra) == 1:
        return spectra
    frequencies = np.linspace(0, sample_rate / 2, spectra.shape[1])
    coherence = np.sinc(2 * frequencies * spacing / AIR.sound_speed)  # sin(k d) / (k d)
    common = np.sqrt((1 + coherence) / 2) * spectra[0]
    opposite = np.sqrt((1 - coherence) / 2) * spectra[1]
    return np.stack([common + opposite, common - opposite])


def _require(sample_rate: float, channels: int, start: float, ear_spacing: float) -> None:
    require_sample_rate(sample_rate)
    if channels not in {1, 2}:
        raise OptionError(f"{channels} channels: a tail has 1, or 2 for both ears")
    if not 0 <= start < math.inf:
        raise OptionError(f"a tail that starts at {start} s: give 0 or later")
    if not 0 < ear_spacing < math.inf:
        raise OptionError(f"ears {ear_spacing} m apart: give a positive spacing, as {EAR_SPACING}")

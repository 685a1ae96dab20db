"""Residual of a recording: its attack and decaying noise, which modes do not explain."""

from __future__ import annotations

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.model.arrays import Array

FADE = 0.01  # the attack goes over into the noise within this time, s
_GONE, _LONGEST = math.log(1000), 10.0  # noise lasts until -60 dB, at most s
_FINEST = 48_000  # largest denominator of a ratio of sample rates
_RATES = (1_000, 1_000_000)  # lowest and highest sample rate, Hz


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Residual:
    """Attack and noise bands of a recorded hit, for a strike of the strength that was recorded.

    Parameters
    ----------
    attack : array (n,), float32
        The first moments, less the modes, in the unit of the gains at 1 m; fades out at its end.
    sample_rate : int
        Hz.
    lead : float
        From the beginning of the attack until the modes set in, s.
    edges : array (B + 1,)
        Of the bands, ascending, Hz.
    levels : array (B,)
        Root mean square of the noise in each band at the end of the attack; 0 for none.
    decays : array (B,)
        Their amplitude decay rates, 1/s, above 0.

    Raises
    ------
    OptionError
        When arrays do not fit each other, or numbers lie outside their bounds.
    """

    attack: NDArray[np.float32]
    sample_rate: int
    lead: float
    edges: Array
    levels: Array
    decays: Array

    def __post_init__(self) -> None:
        bands = len(self.levels)
        if self.edges.shape != (bands + 1,) or self.decays.shape != (bands,):
            raise OptionError(
                f"a residual has {len(self.edges)} edges, {bands} levels and {len(self.decays)} "
                "decays: give B + 1, B and B"
            )
        ordered = np.all(np.diff(self.edges) > 0) and np.all(self.edges >= 0)
        if not (ordered and np.all(self.levels >= 0) and np.all(self.decays > 0)):
            raise OptionError(
                "a residual has bands in disorder, levels below 0 or decays that are not above 0: "
                "fit the recording again"
            )
        last = len(self.attack) / max(self.sample_rate, 1)
        if not (_RATES[0] <= self.sample_rate <= _RATES[1] and 0 <= self.lead <= last):
            raise OptionError(
                f"a residual at {self.sample_rate} Hz leads by {self.lead} s: give {_RATES[0]} to "
                f"{_RATES[1]} Hz, and no more than its {last:.4g} s"
            )

    def samples(self, sample_rate: int, seed: int = 0) -> Array:
        """Return the samples of the residual (n,), which begins `lead` before the modes.

        Parameters
        ----------
        sample_rate : int
            Hz.
        seed : int
            Of the noise.
        """
        attack = _resampled(self.attack.astype(np.float64), self.sample_rate, sample_rate)
        noise = self._noise(sample_rate, seed)
        if not noise.size:
            return attack
        start = max(0, len(attack) - round(FADE * sample_rate))
        rising = np.sin(np.linspace(0, np.pi / 2, len(attack) - start)) ** 2
        noise[: len(rising)] *= rising[: len(noise)]
        whole = np.zeros(max(len(attack), start + len(noise)))
        whole[: len(attack)] = attack
        whole[start : start + len(noise)] += noise
        return whole

    def _noise(self, sample_rate: int, seed: int) -> Array:
        """Return the sum of all bands: each the same white noise, cut out and made to decay."""
        heard = np.flatnonzero((self.levels > 0) & (self.edges[:-1] < sample_rate / 2))
        if not heard.size:
            return np.zeros(0)
        seconds = min(_GONE / float(self.decays[heard].min()), _LONGEST)
        times = np.arange(max(1, round(seconds * sample_rate))) / sample_rate
        spectrum = np.fft.rfft(np.random.default_rng(seed).standard_normal(len(times)))
        frequencies = np.fft.rfftfreq(len(times), 1 / sample_rate)
        total = np.zeros(len(times))
        for band in heard:
            low, high = self.edges[band : band + 2]
            inside = (frequencies >= low) & (frequencies < high)
            noise = np.fft.irfft(spectrum * inside, len(times))
            size = float(np.sqrt(np.mean(noise**2)))
            if size:
                total += self.levels[band] / size * noise * np.exp(-self.decays[band] * times)
        return total


def _resampled(samples: Array, now: int, wanted: int) -> Array:
    if now == wanted or not samples.size:
        return samples.copy()
    from scipy.signal import resample_poly

    ratio = Fraction(wanted, now).limit_denominator(_FINEST)
    return np.asarray(resample_poly(samples, ratio.numerator, ratio.denominator), np.float64)

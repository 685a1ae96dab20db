"""Residual of a recording: its attack and decaying noise, which modes do not explain."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from struck.errors import OptionError, rounded
from struck.model.arrays import Array, brief
from struck.model.damping import Damping

FADE = 0.01  # cross-fade from the attack to the noise, s
_GONE, _LONGEST = math.log(1000), 10.0  # noise lasts until -60 dB, at most s
_SLOWEST = 1e-3  # decay of noise, 1/s
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

    __repr__ = brief
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
        is_ordered = np.all(np.diff(self.edges) > 0) and np.all(self.edges >= 0)
        if not (is_ordered and np.all(self.levels >= 0) and np.all(self.decays > 0)):
            raise OptionError(
                "a residual has bands in disorder, levels below 0 or decays that are not above 0: "
                "fit the recording again"
            )
        last = len(self.attack) / max(self.sample_rate, 1)
        if not (_RATES[0] <= self.sample_rate <= _RATES[1] and 0 <= self.lead <= last):
            raise OptionError(
                f"a residual at {self.sample_rate} Hz leads by {self.lead} s: give {_RATES[0]} to "
                f"{_RATES[1]} Hz, and no more than its {rounded(last, 4)} s"
            )

    def damped(self, damping: Damping) -> Residual:
        """Return a copy whose noise decays by another law; its attack stays.

        Parameters
        ----------
        damping : Damping
            The new law.

        Returns
        -------
        Residual
            The copy.
        """
        decays = damping.decays(np.sqrt(self.edges[1:] * np.maximum(self.edges[:-1], 1.0)))
        return replace(self, decays=np.maximum(decays, _SLOWEST))

    @property
    def size(self) -> int:
        """Size of the residual in a file, bytes."""
        return sum(array.nbytes for array in (self.attack, self.edges, self.levels, self.decays))

    def samples(self, sample_rate: int, seed: int = 0) -> Array:
        """Compute the residual sound.

        Parameters
        ----------
        sample_rate : int
            Sample rate, Hz.
        seed : int, default 0
            Seed of the noise.

        Returns
        -------
        array (n,)
            Read-only samples, from `lead` before the onset of the modes.
        """
        return _sound(self, sample_rate, seed)


@lru_cache(maxsize=8)  # strikes of one model mostly have one seed
def _sound(residual: Residual, sample_rate: int, seed: int) -> Array:
    attack = residual.attack.astype(np.float64)
    attack = _resampled(attack, residual.sample_rate, sample_rate)
    noise = _noise(residual, sample_rate, seed)
    start = max(0, len(attack) - round(FADE * sample_rate))
    rising = np.sin(np.linspace(0, np.pi / 2, len(attack) - start)) ** 2
    noise[: len(rising)] *= rising[: len(noise)]
    samples = np.zeros(max(len(attack), start + len(noise)))
    samples[: len(attack)] = attack
    samples[start : start + len(noise)] += noise
    samples.setflags(write=False)
    return samples


def _noise(residual: Residual, sample_rate: int, seed: int) -> Array:
    """Return the sum of all bands: each the same white noise, cut out and made to decay."""
    audible_bands = np.flatnonzero((residual.levels > 0) & (residual.edges[:-1] < sample_rate / 2))
    lengths = np.minimum(_GONE / residual.decays, _LONGEST) * sample_rate
    lengths = np.array([next_fast_len(1 + round(length), real=True) for length in lengths])
    noise_sum = np.zeros(lengths[audible_bands].max(initial=0))
    white = np.random.default_rng(seed).standard_normal(len(noise_sum))
    for band in audible_bands:
        length, (low, high) = lengths[band], residual.edges[band : band + 2]
        frequencies = np.fft.rfftfreq(length, 1 / sample_rate)
        in_band = (frequencies >= low) & (frequencies < high)
        noise = np.fft.irfft(np.fft.rfft(white[:length]) * in_band, length)
        falling = np.exp(-residual.decays[band] * np.arange(length) / sample_rate)
        size = float(np.sqrt((noise * falling) @ (noise * falling) / (falling @ falling)))
        if size:
            noise_sum[:length] += residual.levels[band] / size * noise * falling
    return noise_sum


def _resampled(samples: Array, old_rate: int, new_rate: int) -> Array:
    if old_rate == new_rate or not samples.size:
        return samples.copy()
    from scipy.signal import resample_poly

    ratio = Fraction(new_rate, old_rate).limit_denominator(_FINEST)
    return np.asarray(resample_poly(samples, ratio.numerator, ratio.denominator), np.float64)

"""Stretches of a take in which the object rings freely."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from struck.model.exponentials import Ringing, Spectrum, samples
from struck.recordings.noise import Noise

Array = NDArray[np.float64]

_SHORTEST = 1024
_ALIVE = 10.0
"""A mode is over after so many times its decay time: 87 dB down."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segment:
    """Channels of one length that ring freely from their first sample on.

    Parameters
    ----------
    samples : array (C, n)
        Recorded samples.
    sample_rate : float
        Hz.
    noise : Noise
        Of the same channels.
    rows : slice
        Where the gains of these channels stand among those of all segments.
    spectra : tuple of Spectrum
        Transforms of all samples, of the first half, of the first quarter ...
    before : array (C, m)
        Ambient sound of the same channels, before anything was struck; m may be 0.
    """

    samples: Array
    sample_rate: float
    noise: Noise
    rows: slice
    spectra: tuple[Spectrum, ...]
    before: Array

    @classmethod
    def of(
        cls,
        samples: Array,
        sample_rate: float,
        noise: Noise,
        first_row: int = 0,
        before: Array | None = None,
    ) -> Segment:
        """Transform samples (C, n)."""
        length = samples.shape[1]
        halvings = max(0, int(np.log2(max(length / _SHORTEST, 1))))
        # No large prime factors: transforms take an eighth of the time.
        whole = fft.prev_fast_len(length >> halvings) << halvings
        return cls(
            samples=samples,
            sample_rate=sample_rate,
            noise=noise,
            rows=slice(first_row, first_row + len(samples)),
            spectra=tuple(
                Spectrum.of(samples, whole >> each, sample_rate) for each in range(halvings + 1)
            ),
            before=samples[:, :0] if before is None else before,
        )

    @property
    def duration(self) -> float:
        """Length, s."""
        return self.samples.shape[1] / self.sample_rate

    def levels(self, slowest: Array) -> NDArray[np.int64]:
        """Return which is the shortest transform in which a mode of these decays, 1/s, is over."""
        durations = np.array([each.length for each in self.spectra]) / self.sample_rate
        long_enough = durations[:, None] >= _ALIVE / slowest
        return np.maximum(long_enough.sum(axis=0) - 1, 0)

    def model(self, ringing: Ringing) -> Array:
        """Return what these modes sound like here, (C, n)."""
        gains = ringing.gains[self.rows]
        return samples(ringing.poles, gains, self.samples.shape[1], self.sample_rate)

    def residual(self, ringing: Ringing) -> Array:
        """Return the samples without these modes, (C, n)."""
        return self.samples - self.model(ringing) if ringing.count else self.samples

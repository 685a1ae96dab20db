"""The windowed Fourier transform of 2007 (eq. 3 and 4): each bin as a signal of its own."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

WINDOW = 0.046
"""Length of a window, s."""
OVERLAP = 4
"""Windows that cover a sample."""


@dataclass(frozen=True, kw_only=True, eq=False)
class WindowedTransform:
    """Blackman-Harris windows that look forward from their start.

    Parameters
    ----------
    length : int
        Samples of a window, a power of 2.
    sample_rate : float
        Hz.
    """

    length: int
    sample_rate: float

    @classmethod
    def at(cls, sample_rate: float) -> WindowedTransform:
        """Take the power of 2 next to 46 ms: 2048 samples at 44.1 kHz."""
        return cls(length=2 ** round(np.log2(WINDOW * sample_rate)), sample_rate=sample_rate)

    @property
    def hop(self) -> int:
        """Samples from a window to the next."""
        return self.length // OVERLAP

    @property
    def bin_width(self) -> float:
        """Spacing of bins, Hz (eq. 5)."""
        return self.sample_rate / self.length

    @property
    def step(self) -> float:
        """Time from a window to the next, s."""
        return self.hop / self.sample_rate

    @cached_property
    def window(self) -> Array:
        """Weights (length,)."""
        from scipy.signal.windows import blackmanharris

        return blackmanharris(self.length, sym=False)

    def of(self, samples: Array) -> Complex:
        """Transform samples (n,), n at least one window: (windows, bins below half the rate).

        The exponent counts time from the first sample on, not from each window's start: only so
        does a mode in bin k turn at its distance from that bin, f - F_k.
        """
        starts = np.lib.stride_tricks.sliding_window_view(samples, self.length)[:: self.hop]
        spectra = np.fft.fft(starts * self.window, axis=1)[:, : self.length // 2]
        turns = np.outer(np.arange(len(starts)) * self.hop, np.arange(self.length // 2))
        return spectra * np.exp(-2j * np.pi * (turns % self.length) / self.length)

    def answers(self, exponents: Complex) -> Complex:
        """Return B of eq. 6, what a window makes of exp(exponent t): (..., ) as the exponents."""
        times = np.arange(self.length) / self.sample_rate
        return np.asarray(np.exp(exponents[..., None] * times) @ self.window, np.complex128)

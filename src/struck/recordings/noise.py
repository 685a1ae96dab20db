"""Stationary noise of a take as a density over frequency, and the spectra it is measured by."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike
from scipy import fft
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d

from struck.model.arrays import AnyComplex, Array


def blackman_harris(size: int) -> Array:
    """Return the periodic four-term Blackman-Harris window: side lobes below -92 dB."""
    from scipy.signal.windows import blackmanharris

    return blackmanharris(size, sym=False)


def frames(samples: Array, window: Array, step: int, max_count: int | None = None) -> AnyComplex:
    """Return spectra (C, frames, size / 2), complex64, of windowed frames of samples (C, n).

    Phases count from the first sample, so that a mode exp(s t) changes from frame to frame by
    exp((s - 2 pi i k rate / size) step / rate).
    """
    size = len(window)
    count = (samples.shape[1] - size) // step + 1
    count = min(count, max_count) if max_count is not None else count
    # The phases come round again after a few frames.
    period = size // math.gcd(step, size)
    phase_indices = (np.arange(period)[:, None] * step * np.arange(size // 2)) % size
    back = np.exp((-2j * np.pi / size) * np.arange(size)).astype(np.complex64)[phase_indices]
    back = back[np.arange(count) % period]
    return np.stack([_transforms(channel, window, step, count) * back for channel in samples])


def _transforms(channel: Array, window: Array, step: int, count: int) -> AnyComplex:
    pieces = np.lib.stride_tricks.sliding_window_view(channel, len(window))[::step][:count]
    return fft.rfft((pieces * window).astype(np.float32), axis=1)[:, : len(window) // 2]


WINDOW = 0.046  # windows of which spectra are averaged, s
_QUIET_TIME = 0.1  # s
_LONGEST = 10.0  # used of ambient sound, its end, s


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Noise:
    """Density of stationary noise: the variance of white noise that is as loud there.

    A discrete Fourier transform of N samples so has the mean square N times the density.
    """

    frequencies: Array  # (F,), ascending, Hz
    densities: Array  # (C, F), squared unit of the samples

    @classmethod
    def white(cls, variances: ArrayLike) -> Noise:
        """Return white noise of these variances, one for each channel."""
        column = np.reshape(np.asarray(variances, float), (-1, 1))
        return cls(frequencies=np.array([0.0, 1.0]), densities=np.repeat(column, 2, axis=1))

    @classmethod
    def heard_in(cls, samples: Array, sample_rate: float, floor: float = 0.0) -> Noise:
        """Measure the noise of ambient samples (C, n); `floor` is the least density."""
        samples = samples[:, -round(_LONGEST * sample_rate) :]
        size = _window_size(sample_rate, samples.shape[1])
        window = blackman_harris(size)
        pieces = frames(samples, window, size // 4)
        powers = (np.abs(pieces) ** 2).mean(axis=1) / (window**2).sum()
        return cls(
            frequencies=np.arange(powers.shape[1]) * (sample_rate / size),
            densities=np.maximum(_smooth_between_lines(powers), floor),
        )

    @classmethod
    def quietest(cls, samples: Array, sample_rate: float, floor: float = 0.0) -> Noise:
        """Estimate the noise of a whole take (C, n) from its quietest tenth of a second.

        Spectral lines are taken for modes, not for noise.
        """
        size = round(_QUIET_TIME * sample_rate)
        blocks = samples[:, : samples.shape[1] // size * size].reshape(len(samples), -1, size)
        quietest = np.diff(blocks, axis=2).var(axis=2).argmin(axis=1)
        quiet_blocks = np.stack(
            [block[place] for block, place in zip(blocks, quietest, strict=True)]
        )
        noise = cls.heard_in(quiet_blocks, sample_rate, floor)
        broad = median_filter(noise.densities, (1, 31), mode="nearest")
        return replace(noise, densities=np.maximum(broad, floor))

    @classmethod
    def joined(cls, parts: Sequence[Noise]) -> Noise:
        """Return the noise of all channels, one part after the other."""
        frequencies = np.unique(np.concatenate([noise.frequencies for noise in parts]))
        return cls(
            frequencies=frequencies, densities=np.vstack([noise.at(frequencies) for noise in parts])
        )

    def at(self, frequencies: ArrayLike) -> Array:
        """Return densities at frequencies in Hz, (C, ...)."""
        points = np.asarray(frequencies, float)
        return np.stack(
            [np.interp(points, self.frequencies, density) for density in self.densities]
        )

    def raised(self, residual: Array, sample_rate: float, breadth: float = 100.0) -> Noise:
        """Return a copy nowhere below the power of a residual (C, n) averaged over a breadth, Hz.

        A model error is not noise, but modes below it cannot be distinguished from it.
        """
        length = fft.prev_fast_len(residual.shape[1])
        powers = np.abs(np.fft.rfft(residual[:, :length], axis=1)) ** 2 / length
        bins = max(1, round(breadth * length / sample_rate))
        grid = np.arange(0, sample_rate / 2, breadth / 4)
        smooth_powers = np.stack(
            [
                np.interp(
                    grid, np.arange(len(channel_powers)) * (sample_rate / length), channel_powers
                )
                for channel_powers in uniform_filter1d(powers, bins, axis=1)
            ]
        )
        frequencies = np.union1d(self.frequencies, grid)
        left = np.stack(
            [np.interp(frequencies, grid, channel_powers) for channel_powers in smooth_powers]
        )
        return Noise(frequencies=frequencies, densities=np.maximum(self.at(frequencies), left))

    def energy(self, length: int) -> Array:
        """Return the expected energy of this many samples (C,)."""
        grid = np.linspace(self.frequencies[0], self.frequencies[-1], 2048)
        return length * self.at(grid).mean(axis=1)


def _window_size(sample_rate: float, length: int) -> int:
    target_size = min(WINDOW * sample_rate, length)
    return 2 ** int(np.log2(target_size) + 0.5 if target_size < length else np.log2(length))


def _smooth_between_lines(powers: Array) -> Array:
    """Average over neighbouring bins, but keep tones: bins 6 dB over the local median."""
    broad = median_filter(powers, (1, 31), mode="nearest")
    is_tone = powers > 4 * broad
    smooth_powers = uniform_filter1d(np.where(is_tone, broad, powers), 9, axis=1, mode="nearest")
    return np.maximum(smooth_powers, maximum_filter1d(np.where(is_tone, powers, 0.0), 3, axis=1))

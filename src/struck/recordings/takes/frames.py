"""Windowed transforms whose frames look forward, so that exponentials stay exponentials."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import fft

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]

# Harris 1978, table 1: minimum four-term Blackman-Harris window, side lobes below -92 dB.
_TERMS = (0.35875, -0.48829, 0.14128, -0.01168)


def blackman_harris(size: int) -> Array:
    """Return the periodic four-term Blackman-Harris window."""
    turns = 2 * np.pi * np.arange(size) / size
    return np.sum([term * np.cos(index * turns) for index, term in enumerate(_TERMS)], axis=0)


def frames(samples: Array, window: Array, step: int, most: int | None = None) -> Complex:
    """Return the transforms of windowed frames, the phase counted from the first sample.

    Parameters
    ----------
    samples : array (C, n)
        At least as long as the window.
    window : array (size,)
        Its size is even.
    step : int
        From one frame to the next, samples.
    most : int, optional
        Not more frames than these.

    Returns
    -------
    array (C, frames, size / 2), complex64
        A mode exp(s t) changes from frame to frame by exp((s - 2 pi i k rate / size) step / rate).
    """
    size = len(window)
    count = (samples.shape[1] - size) // step + 1
    count = min(count, most) if most is not None else count
    # The phases come round again after a few frames.
    period = size // math.gcd(step, size)
    turned = (np.arange(period)[:, None] * step * np.arange(size // 2)) % size
    back = np.exp((-2j * np.pi / size) * turned).astype(np.complex64)[np.arange(count) % period]
    parts = [_transforms(each, window, step, count) * back for each in samples]
    return np.stack(parts)


def _transforms(channel: Array, window: Array, step: int, count: int) -> Complex:
    pieces = np.lib.stride_tricks.sliding_window_view(channel, len(window))[::step][:count]
    single = (pieces * window).astype(np.float32)
    return fft.rfft(single, axis=1)[:, : len(window) // 2]

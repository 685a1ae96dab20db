"""Weak modes that stand alone, by matched filters.

Against white noise nothing detects a mode of known decay better than the correlation with its
exponential. For all frequencies at once that is one Fourier transform a decay rate.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from struck.recordings.noise import Noise
from struck.recordings.poles.candidates import Candidates
from struck.recordings.takes.segment import Segment

Array = NDArray[np.float64]

DECAYS = (0.7, 2.0, 6.0, 18.0, 54.0, 160.0, 480.0)
"""Tried decay rates, 1/s; between two of them a twelfth of the energy is lost at most."""
_BREADTH = 30.0
"""What is left is averaged over so many Hz."""
_LOWEST, _HIGHEST = 30.0, 0.47


def matched(segments: Sequence[Segment], left: Sequence[Array], least: float) -> Candidates:
    """Search what is left of all segments for modes by their energy.

    Parameters
    ----------
    segments : sequence of Segment
        All channels and hits, at one sample rate.
    left : sequence of arrays (C, n)
        Their samples, less the modes found so far.
    least : float
        Energy over noise, summed over channels, that counts; where more than noise is left over a
        breadth of bins, over that.

    Returns
    -------
    Candidates
    """
    rate = segments[0].sample_rate
    noises = [
        segment.noise.raised(samples, rate, _BREADTH)
        for segment, samples in zip(segments, left, strict=True)
    ]
    found = []
    for decay in DECAYS:
        size = fft.next_fast_len(2 * max(_count(decay, each, rate) for each in left), real=True)
        frequencies = np.arange(size // 2 + 1) * (rate / size)
        energies = np.zeros(len(frequencies))
        for noise, samples in zip(noises, left, strict=True):
            energies += _energies(noise, samples, decay, frequencies)
        peaks = _peaks(energies, least)
        heard = (frequencies[peaks] > _LOWEST) & (frequencies[peaks] < _HIGHEST * rate)
        peaks = peaks[heard & (decay < np.pi * frequencies[peaks])]
        poles = -decay + 2j * np.pi * frequencies[peaks]
        found.append(Candidates(poles=poles, energies=energies[peaks]))
    longest = max(each.shape[1] for each in left)
    return Candidates.joined(found).distinct(rate / longest, share=1.0)


def _count(decay: float, samples: Array, sample_rate: float) -> int:
    return min(samples.shape[1], int(8 / decay * sample_rate))


def _energies(
    noise: Noise, samples: Array, decay: float, frequencies: NDArray[np.floating]
) -> Array:
    """Return energies along one exponential, over noise or what is left, summed over channels."""
    size, rate = 2 * (len(frequencies) - 1), 2 * frequencies[-1]
    shape = np.exp(-decay / rate * np.arange(_count(decay, samples, rate)))
    floor = noise.at(frequencies) * (shape**2).sum()
    total = np.zeros(len(frequencies))
    for channel, density in zip(samples, floor, strict=True):
        transform = fft.rfft(channel[: len(shape)] * shape, size)
        total += (transform.real**2 + transform.imag**2) / density
    return total


def _peaks(values: Array, least: float) -> NDArray[np.int64]:
    middle = values[1:-1]
    return 1 + np.flatnonzero((middle > least) & (middle >= values[:-2]) & (middle > values[2:]))

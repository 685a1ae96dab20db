"""The loops of the block transform over samples and frequencies, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.synth.compiling import jitted

Single = NDArray[np.float32]
Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

FORCES_AT_ONCE = 8
"""Samples of a force that are convolved together."""
REACH = 3
"""Frequencies of the grid below the bin of a mode that it touches; above it there is one more."""


@jitted
def fold(straight: Array, turned: Array, spectra: Complex) -> None:
    """Turn sums of x W and y W on the grid into the spectrum of the real samples Im[...].

    Parameters
    ----------
    straight, turned : array (2 C (H + 7) + 16,)
        For each class the sums at the frequencies -3 to H + 3, real and imaginary parts
        alternating; H is half the length of the transform.
    spectra : array (C, H + 1)
        The spectrum at 0 to H, what lies outside folded back.
    """
    highest = spectra.shape[1] - 1
    spectra[:] = 0.0
    for c in range(spectra.shape[0]):
        for k in range(-REACH, highest + REACH + 1):
            i = 2 * (c * (highest + 1 + 2 * REACH) + REACH + k)
            real, imaginary = straight[i] - turned[i + 1], straight[i + 1] + turned[i]
            value = 0.5 * complex(imaginary, -real)
            if 0 <= k <= highest:
                spectra[c, k] += value
            if k <= 0:
                spectra[c, -k] += value.conjugate()
            if k >= highest:
                spectra[c, 2 * highest - k] += value.conjugate()


@jitted
def unfold(spectra: Complex, straight: Single, turned: Single) -> None:
    """Write the conjugate of a force's spectrum on the grid that `gather` reads.

    Parameters
    ----------
    spectra : array (C, H + 1)
        At the frequencies 0 to H.
    straight, turned : array (2 C (H + 7) + 16,)
        The grid as (real, -imaginary) and as (imaginary, real).
    """
    highest = spectra.shape[1] - 1
    for c in range(spectra.shape[0]):
        for k in range(-REACH, highest + REACH + 1):
            i = 2 * (c * (highest + 1 + 2 * REACH) + REACH + k)
            inside = 0 <= k <= highest
            mirrored = -k if k < 0 else 2 * highest - k
            value = spectra[c, k].conjugate() if inside else spectra[c, mirrored]
            straight[i], straight[i + 1] = value.real, -value.imag
            turned[i], turned[i + 1] = value.imag, value.real


@jitted
def reverse(force: Array, openings: Array, backwards: Array) -> None:
    """Write the force backwards in time, F[B - t] at t = 1 to B, times the opening of each class.

    Parameters
    ----------
    force : array (B,)
    openings : array (C, B + 1)
    backwards : array (C, M)
        The result; outside t = 1 to B it stays as it is.
    """
    block = force.size
    for c in range(openings.shape[0]):
        for t in range(1, block + 1):
            backwards[c, t] = force[block - t] * openings[c, t]


@jitted
def close(samples: Array, openings: Array, into: Array) -> None:
    """Add the samples of all classes, each times its opening.

    Parameters
    ----------
    samples : array (L, C, M)
    openings : array (C, B + 1)
    into : array (L, B)
    """
    for output in range(into.shape[0]):
        for c in range(openings.shape[0]):
            for t in range(into.shape[1]):
                into[output, t] += samples[output, c, t] * openings[c, t]


@jitted
def convolve(force: Array, answer: Array, past: Array, into: Array) -> None:
    """Add the answer to a force within the block.

    Parameters
    ----------
    force, answer, into : array (B,)
    past : array (B + 8,)
        Room for the answer; its first eight samples are zero: nothing is heard before the force.
    """
    block = force.size
    for t in range(block):
        past[8 + t] = answer[t]
    whole = block - block % 8
    for first in range(0, whole, 8):
        f0, f1, f2, f3 = force[first], force[first + 1], force[first + 2], force[first + 3]
        f4, f5, f6, f7 = force[first + 4], force[first + 5], force[first + 6], force[first + 7]
        for t in range(block - first):
            early = f0 * past[t + 8] + f1 * past[t + 7] + f2 * past[t + 6] + f3 * past[t + 5]
            late = f4 * past[t + 4] + f5 * past[t + 3] + f6 * past[t + 2] + f7 * past[t + 1]
            into[first + t] += early + late
    for first in range(whole, block):
        for t in range(first, block):
            into[t] += force[first] * answer[t - first]

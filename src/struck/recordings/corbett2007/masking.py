"""Modes that nobody hears: below the threshold in quiet, or drowned by a stronger neighbour."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LOUDEST = 90.0
"""Level given to the strongest amplitude, dB SPL."""
HEARD = 0.2
"""Time over which hearing collects energy, s."""
_DEPTH = 10.0  # of the masked level under the masker, dB
_DOWNWARD, _UPWARD = 27.0, 15.0  # slopes below and above a masker, dB per Bark


def audible(frequencies: Array, decays: Array, amplitudes: Array) -> NDArray[np.bool_]:
    """Tell which modes (M,) are heard beside the others.

    A mode's level is that of its mean power over 200 ms. It is heard where it exceeds the threshold
    in quiet, and the masked level of each stronger one that is heard: 10 dB under that one's level,
    less 27 dB per Bark downwards and 15 dB per Bark upwards.

    Parameters
    ----------
    frequencies, decays, amplitudes : array (M,)
        Hz, 1/s, and any unit: the largest amplitude counts as 90 dB SPL.

    Notes
    -----
    The form is that of mode pruning by masking in additive synthesis (triangular spread over the
    Bark scale); the constants are common ones, since the paper gives none.
    """
    heard = np.zeros(len(frequencies), np.bool_)
    levels = _levels(decays, amplitudes)
    places = bark(frequencies)
    loud = levels > quiet(frequencies)
    for mode in np.argsort(-levels, kind="stable"):
        above = places[mode] - places[heard]
        slopes = np.where(above > 0, _UPWARD * above, -_DOWNWARD * above)
        masked = np.max(levels[heard] - _DEPTH - slopes, initial=-np.inf)
        heard[mode] = loud[mode] and levels[mode] >= masked
    return heard


def bark(frequencies: Array) -> Array:
    """Return critical-band rates, Bark (Zwicker & Terhardt 1980)."""
    return 13 * np.arctan(7.6e-4 * frequencies) + 3.5 * np.arctan((frequencies / 7500) ** 2)


def quiet(frequencies: Array) -> Array:
    """Return the threshold in quiet, dB SPL (Terhardt 1979); below 20 Hz that of 20 Hz."""
    kilo = np.maximum(frequencies, 20.0) / 1000
    return 3.64 * kilo**-0.8 - 6.5 * np.exp(-0.6 * (kilo - 3.3) ** 2) + 1e-3 * kilo**4


def _levels(decays: Array, amplitudes: Array) -> Array:
    """Return levels of the mean power over 200 ms, dB SPL."""
    if not len(amplitudes):
        return np.zeros(0)
    exponents = 2 * np.maximum(decays, 1e-3) * HEARD
    tiny = np.finfo(np.float64).tiny
    powers = np.square(amplitudes) * -np.expm1(-exponents) / exponents
    relative = np.maximum(powers, tiny) / max(float(np.square(amplitudes).max()), tiny)
    return LOUDEST + 10 * np.log10(relative)

"""Hearing: bands of the ear, threshold in quiet, equal loudness and spread of excitation.

Arrays in, arrays out. Levels are dB re 20 micropascal; intensities are mean-square pressures over
the square of that, so that a level is 10 log10 of an intensity.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError
from struck.model.arrays import Array

REFERENCE_PRESSURE = 2e-5  # 0 dB of sound pressure level, Pa
INTEGRATION = 0.2  # For how long the ear adds up energy, s (Fastl & Zwicker 2007, section 4.4)
# The share by which an excitation must grow to be heard growing: 1 dB (Fastl & Zwicker 2007)
JUST_NOTICED = 10**0.1 - 1

# ISO 226:2003, table 1: frequency (Hz), exponent of loudness, its level of transfer (dB, relative
# to 1 kHz) and the threshold of hearing (dB).
_ISO_226 = np.array([
    (20, 25, 31.5, 40, 50, 63, 80, 100, 125, 160, 200, 250, 315, 400, 500, 630, 800, 1000, 1250,
     1600, 2000, 2500, 3150, 4000, 5000, 6300, 8000, 10000, 12500),
    (0.532, 0.506, 0.480, 0.455, 0.432, 0.409, 0.387, 0.367, 0.349, 0.330, 0.315, 0.301, 0.288,
     0.276, 0.267, 0.259, 0.253, 0.250, 0.246, 0.244, 0.243, 0.243, 0.243, 0.242, 0.242, 0.245,
     0.254, 0.271, 0.301),
    (-31.6, -27.2, -23.0, -19.1, -15.9, -13.0, -10.3, -8.1, -6.2, -4.5, -3.1, -2.0, -1.1, -0.4,
     0.0, 0.3, 0.5, 0.0, -2.7, -4.1, -1.0, 1.7, 2.5, 1.2, -2.1, -7.1, -11.2, -10.7, -3.1),
    (78.5, 68.7, 59.5, 51.1, 44.0, 37.5, 31.5, 26.5, 22.1, 17.9, 14.4, 11.4, 8.6, 6.2, 4.4, 3.0,
     2.2, 2.4, 3.5, 1.7, -1.3, -4.2, -6.0, -5.4, -1.5, 6.0, 12.6, 13.9, 12.3),
])  # fmt: skip


def decibels(intensities: ArrayLike) -> Array:
    """Return levels of intensities, dB; -3000 for silence."""
    return 10 * np.log10(np.maximum(np.asarray(intensities, float), 1e-300))


def erb(frequencies: ArrayLike) -> Array:
    """Return the equivalent rectangular bandwidth of the ear's filters, Hz."""
    # Glasberg & Moore 1990, eq. 3: 24.7 (4.37 f + 1) with f in kHz.
    return 24.7 * (4.37e-3 * np.asarray(frequencies, float) + 1)


def erb_number(frequencies: ArrayLike) -> Array:
    """Return how many equivalent rectangular bandwidths lie below frequencies in Hz."""
    # Glasberg & Moore 1990, eq. 4.
    return 21.4 * np.log10(4.37e-3 * np.asarray(frequencies, float) + 1)


def frequency_of(numbers: ArrayLike) -> Array:
    """Return the frequencies of ERB numbers, Hz: the inverse of `erb_number`."""
    return (10 ** (np.asarray(numbers, float) / 21.4) - 1) / 4.37e-3


def bark(frequencies: ArrayLike) -> Array:
    """Return critical-band rates (Zwicker & Terhardt 1980, eq. 1)."""
    kilohertz = np.asarray(frequencies, float) / 1000
    return 13 * np.arctan(0.76 * kilohertz) + 3.5 * np.arctan(np.square(kilohertz / 7.5))


def threshold_in_quiet(frequencies: ArrayLike) -> Array:
    """Return the level of the softest audible tones, dB (Terhardt 1979, eq. 1)."""
    kilohertz = _check_positive(frequencies) / 1000
    dip = 6.5 * np.exp(-0.6 * np.square(kilohertz - 3.3))
    return 3.64 * kilohertz**-0.8 - dip + 1e-3 * kilohertz**4


def equal_loudness(frequencies: ArrayLike, phon: float = 40.0) -> Array:
    """Return the levels of tones as loud as one of `phon` dB at 1 kHz, dB (ISO 226:2003, eq. 1)."""
    if not 20 <= phon <= 80:
        raise OptionError(f"phon is {phon}: ISO 226 holds for 20 to 80")
    tones = _check_positive(frequencies)
    _, exponents, transfers, thresholds = _ISO_226
    loudness = 4.47e-3 * (10 ** (0.025 * phon) - 1.15)
    loudness = loudness + (0.4 * 10 ** ((thresholds + transfers) / 10 - 9)) ** exponents
    return _interpolate_rows(tones, 10 / exponents * np.log10(loudness) - transfers + 94)


def sensitivity(frequencies: ArrayLike, phon: float = 40.0) -> Array:
    """Return the ear's sensitivity S(f), 1 at its best and toward 0 elsewhere (1998, section 5)."""
    # The pressure of the softest among the tones of one loudness, as a share of the tone's own.
    contour = equal_loudness(frequencies, phon)
    return np.minimum(10 ** ((equal_loudness(_ISO_226[0], phon).min() - contour) / 20), 1.0)


def integrated(decays: ArrayLike) -> Array:
    """Return the mean of exp(-2 d t) over the ear's integration time, for decay rates d, 1/s."""
    exponents = 2 * np.asarray(decays, float) * INTEGRATION
    return np.where(exponents > 1e-9, -np.expm1(-exponents) / np.maximum(exponents, 1e-9), 1.0)


def spreading(frequencies: ArrayLike, centres: ArrayLike) -> Array:
    """Return the share of the intensity of tones (M,) that passes the ear's filters (B, M)."""
    # Rounded exponentials (1 + p g) exp(-p g), g = |f - centre| / centre, p = 4 centre / ERB:
    # Patterson et al. 1982; Glasberg & Moore 1990, at moderate levels, where they are symmetric.
    middles = _check_positive(centres)[:, None]
    steps = 4 * np.abs(_check_positive(frequencies)[None] - middles) / erb(middles)
    return (1 + steps) * np.exp(-steps)


def _check_positive(frequencies: ArrayLike) -> Array:
    tones = np.asarray(frequencies, float)
    if not np.all(tones > 0):
        raise OptionError(f"the lowest frequency is {np.min(tones)} Hz: tones must exceed 0 Hz")
    return tones


def _interpolate_rows(frequencies: Array, levels: Array) -> Array:
    """Return levels at any frequencies, Hz, from levels at the rows of the ISO 226 table."""
    rows = _ISO_226[0]
    clipped_frequencies = np.clip(frequencies, rows[0], rows[-1])
    # Beyond 20 Hz and 12.5 kHz the contour runs parallel to the threshold in quiet.
    extension = threshold_in_quiet(frequencies) - threshold_in_quiet(clipped_frequencies)
    return np.interp(np.log(clipped_frequencies), np.log(rows), levels) + extension

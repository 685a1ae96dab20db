"""How strongly each contact drives what rings, roughly: enough to choose the best contact by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from struck.errors import RecordingError
from struck.files.sound import Sound

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

MOST = 64
"""Lines that are looked at."""
_DEEPEST = 50.0  # dB under the strongest line
_LONGEST = 1.0  # s


def rough_gains(takes: Sequence[Sequence[Sound]], lead_in: float) -> Complex:
    """Return the strength of spectral lines at each contact (P, M).

    Parameters
    ----------
    takes : sequence (P,) of sequences of Sound
        Hits of each contact, heard by the same listener; their first channel counts.
    lead_in : float
        Before each hit, s.

    Returns
    -------
    array (P, M)
        Root mean squares over hits, at the local maxima of the spectrum of all contacts. Phases are
        not known and 0: `Plan.after` asks for powers alone.

    Raises
    ------
    RecordingError
        When nothing rings.
    """
    rates = {sound.sample_rate for hits in takes for sound in hits}
    if len(rates) != 1:
        raise RecordingError(f"takes have rates of {sorted(rates)} Hz: record all at one rate")
    first = round(lead_in * rates.pop())
    shortest = min(sound.samples.shape[1] for hits in takes for sound in hits) - first
    powers = np.array([_mean_power(hits, first, shortest) for hits in takes])
    loudest = powers.max(axis=0)
    lines = _maxima(loudest)
    if not len(lines):
        raise RecordingError("no line stands out of the spectra of the takes: strike harder")
    return np.sqrt(powers[:, lines]).astype(np.complex128)


def _mean_power(hits: Sequence[Sound], first: int, length: int) -> Array:
    """Return the power spectrum of what rings after the hit, mean over hits."""
    count = max(2, min(length, round(_LONGEST * hits[0].sample_rate)))
    window = np.hanning(count)
    rung = [sound.samples[0, first : first + count].astype(np.float64) for sound in hits]
    return np.mean([np.square(np.abs(np.fft.rfft(window * each))) for each in rung], axis=0)


def _maxima(power: Array) -> NDArray[np.int64]:
    """Return the strongest local maxima over two bins to each side: a window's main lobe."""
    padded = np.pad(power, 2, constant_values=np.inf)
    around = np.lib.stride_tricks.sliding_window_view(padded, 5)
    deep = power > power[2:-2].max(initial=0.0) * 10 ** (-_DEEPEST / 10)
    lines = np.flatnonzero((power >= around.max(axis=1)) & deep & (power > 0))
    return lines[np.argsort(-power[lines], kind="stable")][:MOST]

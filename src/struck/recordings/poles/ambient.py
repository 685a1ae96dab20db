"""Tones of the surroundings: they sound before the hit as they do after it, and never decay."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from struck.model.exponentials import Ringing, correlations
from struck.recordings.takes.segment import Segment

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_STEADY = 3.0
"""A tone decays by less than this many nepers in a segment."""
_SAME = 0.25
_CERTAIN = 6.0


def ambient(segments: Sequence[Segment], ringing: Ringing) -> Mask:
    """Return which modes are tones that the lead-ins hold too, at the same level.

    Parameters
    ----------
    segments : sequence of Segment
        With what was heard before the hits.
    ringing : Ringing
        M modes.

    Returns
    -------
    array (M,), bool
        Never those that decay within a segment, or that the lead-ins are too short or too noisy
        to show.
    """
    duration = max(segment.duration for segment in segments)
    steady = ringing.decays * duration < _STEADY
    tones = ringing.of(steady)
    heard, expected, channels = np.zeros(tones.count), np.zeros(tones.count), 0
    for segment in segments:
        if segment.before.shape[1]:
            there, here = _energies(segment, tones)
            heard, expected = heard + there, expected + here
            channels += len(segment.before)
    steady[steady] = (expected > _CERTAIN * max(channels, 1)) & (heard > _SAME * expected)
    return steady


def _energies(segment: Segment, ringing: Ringing) -> tuple[Array, Array]:
    """Return energies over noise of the tones in the lead-in: measured, and if they sound there."""
    length = segment.before.shape[1]
    window = np.hanning(length)
    sums = correlations(1j * ringing.poles.imag, segment.before * window, segment.sample_rate)
    floor = segment.noise.densities.min(axis=1)[:, None] * (window**2).sum()
    gains = np.abs(ringing.gains[segment.rows]) * window.sum() / 2
    return (np.abs(sums) ** 2 / floor).sum(axis=0), (gains**2 / floor).sum(axis=0)

"""What a fit leaves of the loudest hit, as attack and noise bands."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from struck.fitting.gathering import Gathered
from struck.model.residual import FADE, Residual
from struck.perception.auditory_scale import erb_number, frequency_of
from struck.recordings.gain_table import Recorded
from struck.recordings.poles.fitted import Fitted

Array = NDArray[np.float64]

ATTACK = 0.05
"""How long an attack is kept, s."""
AUDIBLE = -20.0
"""Level of what is left from which noise bands help; below it they would only add noise, dB."""
_BREADTH = 2.0
"""Of the bands, in ERB."""
_LOWEST = 40.0
_FRAME = 0.01
_OVER_NOISE = 4.0
_FEWEST = 4
_SLOWEST, _FASTEST = 1.0, 500.0


def remainder(fitted: Fitted, recorded: Recorded, gathered: Gathered) -> Residual:
    """Return what a fit leaves of its loudest hit, as heard from 1 m."""
    row = loudest(fitted)
    rate = recorded.takes[fitted.rows[row].take].sample_rate
    original, left, lead = _left(fitted, recorded, gathered, row)
    length = min(round(ATTACK * rate), len(left))
    attack = left[:length].copy()
    fade = min(round(FADE * rate), length)
    attack[length - fade :] *= np.cos(np.linspace(0, np.pi / 2, fade)) ** 2
    edges = _edges(rate)
    levels, decays = np.zeros(len(edges) - 1), np.full(len(edges) - 1, _FASTEST)
    if 10 * np.log10(np.sum(left**2) / np.sum(original**2)) > AUDIBLE:
        floor = fitted.noise_in(row, edges)
        levels, decays = _bands(left[length - fade :], rate, edges, floor)
    distance = recorded.distance(fitted.rows[row].take, fitted.rows[row].channel)
    return Residual(
        attack=(distance * attack).astype(np.float32),
        sample_rate=rate,
        lead=lead,
        edges=edges,
        levels=distance * levels,
        decays=decays,
    )


def _left(
    fitted: Fitted, recorded: Recorded, gathered: Gathered, row: int
) -> tuple[Array, Array, float]:
    """Return a hit from its onset on, what is left of it, and when its modes set in, s."""
    what = fitted.rows[row]
    take = recorded.takes[what.take]
    segment, _ = fitted.heard_in(row)
    first = round(what.onset * take.sample_rate)
    last = round(what.time * take.sample_rate) + len(segment)
    original = take.samples[what.channel, first:last]
    sets_in = round((gathered.arrivals[row] + gathered.lead) * take.sample_rate) - first
    lead = int(np.clip(sets_in, 0, round(ATTACK / 2 * take.sample_rate)))
    left = original.copy()
    left[lead:] -= fitted.ringing(row, (first + lead) / take.sample_rate, len(left) - lead)
    return original, left, lead / take.sample_rate


def loudest(fitted: Fitted) -> int:
    """Return the row of most energy."""
    return int(np.argmax([(fitted.heard_in(row)[0] ** 2).sum() for row in range(len(fitted.rows))]))


def _edges(sample_rate: int) -> Array:
    low, high = erb_number([_LOWEST, 0.45 * sample_rate])
    return frequency_of(np.linspace(low, high, 1 + max(1, round((high - low) / _BREADTH))))


def _bands(left: Array, sample_rate: int, edges: Array, floor: Array) -> tuple[Array, Array]:
    """Return levels at the beginning and decays of the noise in each band."""
    spectrum = np.fft.rfft(left)
    frequencies = np.fft.rfftfreq(len(left), 1 / sample_rate)
    size = round(_FRAME * sample_rate)
    count = len(left) // size
    found = [(0.0, _FASTEST)] * (len(edges) - 1)
    for band, (low, high) in enumerate(pairwise(edges)):
        inside = (frequencies >= low) & (frequencies < high)
        noise = np.fft.irfft(spectrum * inside, len(left))
        powers = (noise[: count * size].reshape(count, size) ** 2).mean(axis=1)
        found[band] = _decaying(powers, _FRAME, floor[band])
    levels, decays = np.array(found).T
    return levels, decays


def _decaying(powers: Array, step: float, floor: float) -> tuple[float, float]:
    """Return level and amplitude decay rate of powers that fall into the floor."""
    below = np.flatnonzero(powers < _OVER_NOISE * floor)
    count = int(below[0]) if below.size else len(powers)
    if count < _FEWEST:
        return 0.0, _FASTEST
    times = (np.arange(count) + 0.5) * step
    slope, offset = np.polyfit(times, 0.5 * np.log(powers[:count]), 1)
    return float(np.exp(offset)), float(np.clip(-slope, _SLOWEST, _FASTEST))

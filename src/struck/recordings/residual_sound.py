"""What a fit leaves of the loudest hit, as attack and noise bands."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from struck.errors import OptionError, RecordingError
from struck.model.arrays import Array, Mask
from struck.model.residual import FADE, Residual
from struck.perception.auditory_scale import erb_number, frequency_of
from struck.recordings.gain_table import Gathered
from struck.recordings.onsets import find_hits
from struck.recordings.poles.search import Fitted
from struck.recordings.takes import Recorded, Recording, Take, take_of

# A room answers a hit with thousands of modes of its own, each about as short-lived as its
# reverberation. Modes of the object that last clearly longer cannot be mistaken for them.

TRUSTED = 0.6  # of the room's decay rate: slower modes are the object's
_FROM, _TO = -5.0, -25.0  # of the decay curve, dB (ISO 3382-1: T20)
_EARLY = 0.02  # after the clap, in which it has to be that far above the noise, s
_MEDIAN = 0.4549  # of squared Gaussian noise over its mean


def may_be_of_room(decays: Array, seconds: float) -> Mask:
    """Return which modes with decays (M,), 1/s, a room with this T60 in s might have."""
    return decays > TRUSTED * np.log(1000) / seconds


def reverberation(room: float | Recording) -> float:
    """Return T60 in s of a room: the time itself, or that of a recorded clap in the empty room."""
    if isinstance(room, int | float):
        if not 0.01 <= room <= 30:
            raise OptionError(f"room is {room}: give its reverberation time, 0.01 to 30 s")
        return float(room)
    return _clapped(take_of(room, "the clap"))


def _clapped(take: Take) -> float:
    """Return T60 by backward integration (Schroeder 1965) of the loudest channel's first hit."""
    hits = find_hits(take)
    if not hits:
        raise RecordingError(f"no clap was found in {take.name}: clap once in the empty room")
    loudest = take.samples[int((take.samples**2).sum(axis=1).argmax())]
    energy = loudest[hits[0].onset : hits[0].end] ** 2
    noise = float(np.median(energy[-len(energy) // 10 :])) / _MEDIAN
    early = energy[: round(_EARLY * take.sample_rate)].mean()
    energy = energy - noise
    curve = np.cumsum(energy[::-1])[::-1]
    levels = 10 * np.log10(np.maximum(curve / curve[0], 1e-12))
    first, last = np.argmax(levels < _FROM), np.argmax(levels < _TO)
    if not 0 < first < last or early < noise * 10 ** (-_TO / 10):
        raise RecordingError(
            f"the clap in {take.name} does not fall by {-_TO:g} dB before the noise: clap louder"
        )
    times = np.arange(first, last) / take.sample_rate
    slope = np.polyfit(times, levels[first:last], 1)[0]
    return float(-60 / slope)


ATTACK = 0.05  # s
AUDIBLE = -20.0  # residual over sound from which noise bands help, dB
_BREADTH = 2.0  # of a band, ERB
_LOWEST = 40.0  # Hz
_FRAME = 0.01  # s
_OVER_NOISE = 4.0
_FEWEST = 4
_SLOWEST, _FASTEST = 1.0, 500.0  # 1/s


def remainder(fitted: Fitted, recorded: Recorded, gathered: Gathered) -> Residual:
    """Return attack and noise that a fit leaves of its loudest hit, as heard from 1 m."""
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
    """Return a hit from its onset on, its residual, and when its modes set in, s."""
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
    """Return the number of the row with the most energy."""
    return int(np.argmax([(fitted.heard_in(row)[0] ** 2).sum() for row in range(len(fitted.rows))]))


def _edges(sample_rate: int) -> Array:
    low, high = erb_number([_LOWEST, 0.45 * sample_rate])
    return frequency_of(np.linspace(low, high, 1 + max(1, round((high - low) / _BREADTH))))


def _bands(left: Array, sample_rate: int, edges: Array, floor: Array) -> tuple[Array, Array]:
    """Return initial levels and decays of the residual noise in bands."""
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
    """Return level and amplitude decay rate of powers that fall into a noise floor."""
    below = np.flatnonzero(powers < _OVER_NOISE * floor)
    count = int(below[0]) if below.size else len(powers)
    if count < _FEWEST:
        return 0.0, _FASTEST
    times = (np.arange(count) + 0.5) * step
    slope, offset = np.polyfit(times, 0.5 * np.log(powers[:count]), 1)
    return float(np.exp(offset)), float(np.clip(-slope, _SLOWEST, _FASTEST))

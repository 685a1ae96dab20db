"""Residual of the loudest hit after a fit, as attack and noise bands."""

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
    return _reverberation_time(take_of(room, "the clap"))


def _reverberation_time(take: Take) -> float:
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
    return float(-60 / np.polyfit(times, levels[first:last], 1)[0])


ATTACK = 0.05  # s
HEARD = 0.5  # the first part of a hit, in which bands are compared, s
SOFTEST = -50.0  # of bands that count, re the loudest one, dB
SHORT = 6.0  # by which one of them falls short where a model needs its residual, dB
_NOTICED = 10 ** (1 / 10)  # ratio of energies from which a band gets noise
_LOWEST = 40.0  # Hz
_FRAME = 0.01  # s
_OVER_NOISE = 4.0
_FEWEST = 4
_SLOWEST, _FASTEST = 1.0, 500.0  # 1/s


def band_energies(samples: Array, sample_rate: float, edges: Array) -> Array:
    """Return the energies of the first half second in bands (B,) between edges (B + 1,), Hz."""
    heard = np.append(samples[: round(HEARD * sample_rate)], 0.0)
    fade = min(round(FADE * sample_rate), len(heard))
    heard[len(heard) - fade :] *= np.cos(np.linspace(0, np.pi / 2, fade)) ** 2
    powers = np.abs(np.fft.rfft(heard, 2 * len(heard))) ** 2 / len(heard)
    places = np.fft.rfftfreq(2 * len(heard), 1 / sample_rate)
    return np.diff(np.append(0, np.cumsum(powers))[np.searchsorted(places, edges)])


def ear_bands(sample_rate: float) -> Array:
    """Return the edges of bands of the ear, one ERB wide each, from 40 Hz on (B + 1,), Hz."""
    low, high = erb_number([_LOWEST, 0.45 * sample_rate])
    return frequency_of(np.linspace(low, high, 1 + max(1, round(high - low))))


def remainder(fitted: Fitted, recorded: Recorded, gathered: Gathered) -> tuple[Residual, float]:
    """Return attack and noise that a fit leaves of its loudest hit, as heard from 1 m.

    With them: by how many dB a band of the ear that counts is short without them, at most.
    """
    row = loudest(fitted)
    rate = recorded.takes[fitted.rows[row].take].sample_rate
    original, left, lead = _hit_and_residual(fitted, recorded, gathered, row)
    length = min(round(ATTACK * rate), len(left))
    fade = min(round(FADE * rate), length)
    attack = left[:length].copy()
    attack[length - fade :] *= np.cos(np.linspace(0, np.pi / 2, fade)) ** 2
    edges = ear_bands(rate)
    floor = fitted.noise_in(row, edges)
    modes = original - left
    own, of_modes = _clear_of(floor, original, rate, edges), band_energies(modes, rate, edges)
    counts = own > own.max() * 10 ** (SOFTEST / 10)
    heard = slice(length - fade, round(HEARD * rate))  # noise goes on where the attack fades out
    later = _clear_of(floor, original[heard], rate, edges)
    covered = band_energies(modes[heard], rate, edges)
    missing = np.where(counts & (later > _NOTICED * covered), later - covered, 0.0)
    slowest = max(_SLOWEST, float(fitted.decays.min(initial=_FASTEST)))
    decays = np.maximum(_decays(left[heard.start :], rate, edges, floor), slowest)
    times = np.arange(max(1, len(original[heard]))) / rate
    rising = np.sin(np.pi / 2 * np.minimum(times / FADE, 1)) ** 4
    unit = np.exp(-2 * np.outer(decays, times)) @ rising
    distance = recorded.distance(fitted.rows[row].take, fitted.rows[row].channel)
    residual = Residual(
        attack=(distance * attack).astype(np.float32),
        sample_rate=rate,
        lead=lead,
        edges=edges,
        levels=distance * np.sqrt(missing / np.maximum(unit, 1e-300)),
        decays=decays,
    )
    short = 10 * np.log10(own[counts] / np.maximum(of_modes[counts], 1e-12 * own[counts]))
    return residual, float(short.max(initial=0.0))


def _clear_of(floor: Array, samples: Array, sample_rate: float, edges: Array) -> Array:
    """Return energies in bands (B,) less the noise's; 0 where noise could account for all of it."""
    energies = band_energies(samples, sample_rate, edges)
    noise = floor * min(len(samples), round(HEARD * sample_rate))
    return np.where(energies > _OVER_NOISE * noise, energies - noise, 0.0)


def _hit_and_residual(
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


def one_strike(fitted: Fitted) -> float:
    """Return the share of the energy of a take's hits that one strike, the loudest, explains."""
    best = fitted.rows[loudest(fitted)]
    whole = explained = 0.0
    for row, what in enumerate(fitted.rows):
        if what.take == best.take:
            sound, model = fitted.heard_in(row)
            energy = float((sound**2).sum())
            whole += energy
            explained += (what.hit == best.hit) * (energy - float(((sound - model) ** 2).sum()))
    return max(explained / whole, 0.0) if whole else 0.0


def _decays(left: Array, sample_rate: int, edges: Array, floor: Array) -> Array:
    """Return amplitude decay rates of the residual noise in bands, 1/s."""
    spectrum = np.fft.rfft(left)
    frequencies = np.fft.rfftfreq(len(left), 1 / sample_rate)
    size = round(_FRAME * sample_rate)
    count = len(left) // size
    found = np.full(len(edges) - 1, _FASTEST)
    for band, (low, high) in enumerate(pairwise(edges)):
        inside = (frequencies >= low) & (frequencies < high)
        noise = np.fft.irfft(spectrum * inside, len(left))
        powers = (noise[: count * size].reshape(count, size) ** 2).mean(axis=1)
        found[band] = _decaying(powers, _FRAME, floor[band])
    return found


def _decaying(powers: Array, step: float, floor: float) -> float:
    """Return the amplitude decay rate of powers that fall into a noise floor."""
    below = np.flatnonzero(powers < _OVER_NOISE * floor)
    count = int(below[0]) if below.size else len(powers)
    if count < _FEWEST:
        return _FASTEST
    times = (np.arange(count) + 0.5) * step
    heard = np.maximum(powers[:count], 1e-300)
    weights = (heard / heard.max()) ** 0.25  # what is loud counts
    slope = np.polyfit(times, 0.5 * np.log(heard), 1, w=weights)[0]
    return float(np.clip(-slope, _SLOWEST, _FASTEST))

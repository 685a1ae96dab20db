"""Residual of the loudest hit after a fit, as attack and noise bands."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from struck.errors import OptionError, RecordingError
from struck.model.arrays import Array, Mask
from struck.model.residual import FADE, Residual
from struck.perception.auditory_scale import erb_number, frequency_of
from struck.recordings.gain_table import GainTable
from struck.recordings.onsets import find_hits
from struck.recordings.poles.search import PoleFit
from struck.recordings.takes import Recording, RecordingSet, Take, take_of

# A room responds to a hit with thousands of room modes, each about as short-lived as its
# reverberation. Modes of the object that last clearly longer cannot be mistaken for them.

TRUSTED_DECAY_RATIO = 0.6  # of the room's decay rate: slower modes are the object's
_START_LEVEL, _END_LEVEL = -5.0, -25.0  # of the decay curve, dB (ISO 3382-1: T20)
_CLAP_TIME = 0.02  # after the clap, in which it has to be that far above the noise, s
_MEDIAN_RATIO = 0.4549  # of squared Gaussian noise over its mean


def may_be_of_room(decays: Array, seconds: float) -> Mask:
    """Return which modes with decays (M,), 1/s, a room with this T60 in s might have."""
    return decays > TRUSTED_DECAY_RATIO * np.log(1000) / seconds


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
    loudest_channel = take.samples[int((take.samples**2).sum(axis=1).argmax())]
    energy = loudest_channel[hits[0].onset : hits[0].end] ** 2
    noise = float(np.median(energy[-len(energy) // 10 :])) / _MEDIAN_RATIO
    early_energy = energy[: round(_CLAP_TIME * take.sample_rate)].mean()
    energy = energy - noise
    curve = np.cumsum(energy[::-1])[::-1]
    levels = 10 * np.log10(np.maximum(curve / curve[0], 1e-12))
    first, last = np.argmax(levels < _START_LEVEL), np.argmax(levels < _END_LEVEL)
    if not 0 < first < last or early_energy < noise * 10 ** (-_END_LEVEL / 10):
        raise RecordingError(
            f"the clap in {take.name} does not fall by {-_END_LEVEL:g} dB before the noise: "
            "clap louder"
        )
    times = np.arange(first, last) / take.sample_rate
    return float(-60 / np.polyfit(times, levels[first:last], 1)[0])


ATTACK = 0.05  # s
COMPARED_TIME = 0.5  # the first part of a hit, in which bands are compared, s
MIN_BAND_LEVEL = -50.0  # of bands that count, re the loudest one, dB
MAX_DEFICIT = 6.0  # by which one of them falls short where a model needs its residual, dB
_NOTICEABLE_RATIO = 10 ** (1 / 10)  # ratio of energies from which a band gets noise
_MIN_FREQUENCY = 40.0  # Hz
_FRAME = 0.01  # s
_OVER_NOISE = 4.0
_MIN_FRAMES = 4
_MIN_DECAY, _MAX_DECAY = 1.0, 500.0  # 1/s


def band_energies(samples: Array, sample_rate: float, edges: Array) -> Array:
    """Return the energies of the first half second in bands (B,) between edges (B + 1,), Hz."""
    excerpt = np.append(samples[: round(COMPARED_TIME * sample_rate)], 0.0)
    fade = min(round(FADE * sample_rate), len(excerpt))
    excerpt[len(excerpt) - fade :] *= np.cos(np.linspace(0, np.pi / 2, fade)) ** 2
    powers = np.abs(np.fft.rfft(excerpt, 2 * len(excerpt))) ** 2 / len(excerpt)
    places = np.fft.rfftfreq(2 * len(excerpt), 1 / sample_rate)
    return np.diff(np.append(0, np.cumsum(powers))[np.searchsorted(places, edges)])


def ear_bands(sample_rate: float) -> Array:
    """Return the edges of bands of the ear, one ERB wide each, from 40 Hz on (B + 1,), Hz."""
    low, high = erb_number([_MIN_FREQUENCY, 0.45 * sample_rate])
    return frequency_of(np.linspace(low, high, 1 + max(1, round(high - low))))


def remainder(
    fit: PoleFit, recording_set: RecordingSet, gain_table: GainTable
) -> tuple[Residual, float]:
    """Return attack and noise that a fit leaves of its loudest hit, as heard from 1 m.

    With them: by how many dB a band of the ear that counts is short without them, at most.
    """
    row = loudest_row(fit)
    rate = recording_set.takes[fit.rows[row].take].sample_rate
    original, left, lead = _hit_and_residual(fit, recording_set, gain_table, row)
    length = min(round(ATTACK * rate), len(left))
    fade = min(round(FADE * rate), length)
    attack = left[:length].copy()
    attack[length - fade :] *= np.cos(np.linspace(0, np.pi / 2, fade)) ** 2
    edges = ear_bands(rate)
    floor = fit.noise_in(row, edges)
    modes = original - left
    hit_energies, mode_energies = (
        _clear_of(floor, original, rate, edges),
        band_energies(modes, rate, edges),
    )
    is_counted = hit_energies > hit_energies.max() * 10 ** (MIN_BAND_LEVEL / 10)
    compared_range = slice(
        length - fade, round(COMPARED_TIME * rate)
    )  # noise follows as the attack fades out
    later_energies = _clear_of(floor, original[compared_range], rate, edges)
    covered_energies = band_energies(modes[compared_range], rate, edges)
    missing_energies = np.where(
        is_counted & (later_energies > _NOTICEABLE_RATIO * covered_energies),
        later_energies - covered_energies,
        0.0,
    )
    min_decay = max(_MIN_DECAY, float(fit.decays.min(initial=_MAX_DECAY)))
    decays = np.maximum(_band_decays(left[compared_range.start :], rate, edges, floor), min_decay)
    times = np.arange(max(1, len(original[compared_range]))) / rate
    rising = np.sin(np.pi / 2 * np.minimum(times / FADE, 1)) ** 4
    unit = np.exp(-2 * np.outer(decays, times)) @ rising
    distance = recording_set.distance(fit.rows[row].take, fit.rows[row].channel)
    residual = Residual(
        attack=(distance * attack).astype(np.float32),
        sample_rate=rate,
        lead=lead,
        edges=edges,
        levels=distance * np.sqrt(missing_energies / np.maximum(unit, 1e-300)),
        decays=decays,
    )
    deficits = 10 * np.log10(
        hit_energies[is_counted]
        / np.maximum(mode_energies[is_counted], 1e-12 * hit_energies[is_counted])
    )
    return residual, float(deficits.max(initial=0.0))


def _clear_of(floor: Array, samples: Array, sample_rate: float, edges: Array) -> Array:
    """Return energies in bands (B,) less the noise's; 0 where noise could account for all of it."""
    energies = band_energies(samples, sample_rate, edges)
    noise = floor * min(len(samples), round(COMPARED_TIME * sample_rate))
    return np.where(energies > _OVER_NOISE * noise, energies - noise, 0.0)


def _hit_and_residual(
    fit: PoleFit, recording_set: RecordingSet, gain_table: GainTable, row: int
) -> tuple[Array, Array, float]:
    """Return a hit from its onset on, its residual, and when its modes set in, s."""
    entry = fit.rows[row]
    take = recording_set.takes[entry.take]
    segment, _ = fit.samples_and_model(row)
    first = round(entry.onset * take.sample_rate)
    last = round(entry.time * take.sample_rate) + len(segment)
    original = take.samples[entry.channel, first:last]
    sets_in = round((gain_table.arrivals[row] + gain_table.lead) * take.sample_rate) - first
    lead = int(np.clip(sets_in, 0, round(ATTACK / 2 * take.sample_rate)))
    left = original.copy()
    left[lead:] -= fit.ringing(row, (first + lead) / take.sample_rate, len(left) - lead)
    return original, left, lead / take.sample_rate


def loudest_row(fit: PoleFit) -> int:
    """Return the number of the row with the most energy."""
    return int(
        np.argmax([(fit.samples_and_model(row)[0] ** 2).sum() for row in range(len(fit.rows))])
    )


def one_strike(fit: PoleFit) -> float:
    """Return the share of the energy of a take's hits that one strike, the loudest, explains."""
    best_row = fit.rows[loudest_row(fit)]
    total_energy = explained_energy = 0.0
    for row, entry in enumerate(fit.rows):
        if entry.take == best_row.take:
            sound, model = fit.samples_and_model(row)
            energy = float((sound**2).sum())
            total_energy += energy
            explained_energy += (entry.hit == best_row.hit) * (
                energy - float(((sound - model) ** 2).sum())
            )
    return max(explained_energy / total_energy, 0.0) if total_energy else 0.0


def _band_decays(left: Array, sample_rate: int, edges: Array, floor: Array) -> Array:
    """Return amplitude decay rates of the residual noise in bands, 1/s."""
    spectrum = np.fft.rfft(left)
    frequencies = np.fft.rfftfreq(len(left), 1 / sample_rate)
    size = round(_FRAME * sample_rate)
    count = len(left) // size
    rates = np.full(len(edges) - 1, _MAX_DECAY)
    for band, (low, high) in enumerate(pairwise(edges)):
        is_in_band = (frequencies >= low) & (frequencies < high)
        noise = np.fft.irfft(spectrum * is_in_band, len(left))
        powers = (noise[: count * size].reshape(count, size) ** 2).mean(axis=1)
        rates[band] = _fit_decay(powers, _FRAME, floor[band])
    return rates


def _fit_decay(powers: Array, step: float, floor: float) -> float:
    """Return the amplitude decay rate of powers that fall into a noise floor."""
    noisy_frames = np.flatnonzero(powers < _OVER_NOISE * floor)
    count = int(noisy_frames[0]) if noisy_frames.size else len(powers)
    if count < _MIN_FRAMES:
        return _MAX_DECAY
    times = (np.arange(count) + 0.5) * step
    positive_powers = np.maximum(powers[:count], 1e-300)
    weights = (positive_powers / positive_powers.max()) ** 0.25  # loud frames have more weight
    slope = np.polyfit(times, 0.5 * np.log(positive_powers), 1, w=weights)[0]
    return float(np.clip(-slope, _MIN_DECAY, _MAX_DECAY))

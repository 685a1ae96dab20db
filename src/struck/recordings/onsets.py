"""Hits in a take: their onsets, and the moment from which the body rings freely.

A hit is a rise of many frequency bands at once, also where the tail of the last hit is louder as a
whole: bands in which that tail is over show it. The moment itself is the steepest rise nearby.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve, solve_toeplitz
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d

from struck.errors import counted, rounded
from struck.model.arrays import Array, Index, Mask
from struck.perception.auditory_scale import erb_number
from struck.recordings.disturbances import note_processing
from struck.recordings.noise import blackman_harris, frames
from struck.recordings.takes import Take, copied_channels, force_channels

# window and its steps, s; windows transformed at a time
_WINDOW, _STEP, _CHUNK = 0.023, 0.0029, 4096
_RISE, _LAG = 2.5, 4  # mean over bands, dB, and from how many windows before
_MEDIAN_TIME = 0.5  # a rise is compared with the median within this time, s
_DEPTH = 60.0  # dynamic range below the loudest moment, dB
# least distance of hits, search for the steepest rise, block, s
_MIN_HIT_DISTANCE, _REACH, _BLOCK = 0.06, 0.015, 0.001
_STEEP = 2.0  # least power ratio of the steepest rise
_ORDER, _PAST_TIME = 32, 50  # of linear prediction, and its training, ms
_CLOSE = 0.01  # from a hit to its loudest moment, s
_ARRIVAL_FRACTION = 1e-4  # share of a hit's energy before its arrival
# A second contact: ms after a hit, least rise of the prediction's errors, and their least
# and most share of the blow's; ms in which the prediction is learned, its order, most equations.
_TOUCH_RANGE, _MIN_TOUCH_RISE, _TOUCH_RATIOS = (6, 30), 10.0, (0.02, 4.0)
_TRAINING_RANGE, _MEMORY, _ROWS = (30, 150), 128, 5000
# s; a fainter hit that sounds at once is the rest of one before
_EDGE, _MIN_HIT_RATIO = 0.01, 10 ** (-26 / 10)
# s from which bands have to fall after a hit that the take begins with, and by how much in power
_LASTING, _FALLS = 0.3, 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Hit:
    """One strike: four sample numbers of a take."""

    onset: int  # the sound begins to rise
    arrival: int  # nearly all of the sound follows, the blow included
    start: int  # the rise is over: free ringing from here on
    end: int  # the next hit begins, or the take ends
    again: int | None = None  # the tool touches once more, soon after its blow


def find_hits(take: Take) -> list[Hit]:
    """Return the hits of a take in order of time; none where it only swells."""
    onsets = list(_find_steepest(take, _rises(take)))
    ends = [*onsets, take.samples.shape[1]][1:]
    hits = [hit_at(take, onset, end) for onset, end in zip(onsets, ends, strict=True)]
    if not hits or hits[0].onset >= _EDGE * take.sample_rate:
        return hits
    length = round(_MEDIAN_TIME / 10 * take.sample_rate)
    loudness = [float((take.samples[:, h.start : h.start + length] ** 2).sum()) for h in hits]
    is_begun = loudness[0] >= _MIN_HIT_RATIO * max(loudness) and _decays(take, hits[0])
    return hits if is_begun else hits[1:]


def _decays(take: Take, hit: Hit) -> bool:
    """Return whether the bands of most energy fall until the next hit; yes if that is soon."""
    size, step = _window_and_step(take)
    if hit.end - hit.start < max(_LASTING * take.sample_rate, 10 * size):
        return True
    sound = take.samples[:, hit.start : hit.end]
    powers = np.sum([_band_powers(channel, size, step, take) for channel in sound], axis=0)
    tenth = len(powers) // 10
    early_powers, late_powers = powers[:tenth].mean(axis=0), powers[-tenth:].mean(axis=0)
    return bool(early_powers[early_powers > _FALLS * late_powers].sum() > early_powers.sum() / 2)


def hit_at(take: Take, onset: int, end: int) -> Hit:
    """Return the hit with a known onset that is over at sample `end`, maybe at once."""
    size = max(1, round(_BLOCK * take.sample_rate))
    energy = (take.samples**2).sum(axis=0)
    start = _find_rise_end(energy, onset, end, size)
    arrival = min(_find_arrival(energy, onset, end, size), start)
    second_contact, end_of_contact = _find_second_contact(take, onset, end, size)
    return Hit(
        onset=onset,
        arrival=arrival,
        start=max(start, end_of_contact),
        end=end,
        again=second_contact,
    )


def _find_second_contact(take: Take, onset: int, end: int, size: int) -> tuple[int | None, int]:
    """Return the sample of a second contact soon after a hit, if any, and from where it is over.

    A body that rings freely is predicted by its past, a sum of decaying sines; a push is not.
    """
    sound = take.samples[:, onset : onset + _TRAINING_RANGE[1] * size]
    surprise = _prediction_errors(
        take.samples[int((sound**2).sum(axis=1).argmax())], onset, end, size
    )
    blocks = surprise[: len(surprise) // size * size].reshape(-1, size).sum(axis=1)
    places = np.arange(_TOUCH_RANGE[0], min(_TOUCH_RANGE[1], len(blocks) - 1))
    mean_before_touch = np.array([blocks[max(2, place - 4) : place].mean() for place in places])
    pairs = (blocks[places] + blocks[places + 1]) / 2
    min_touch, max_touch = np.multiply(_TOUCH_RATIOS, blocks[: _TOUCH_RANGE[0]].max(initial=0.0))
    # What is louder is the blow itself, before which something faint was taken for its beginning.
    is_touch = (pairs > min_touch) & (pairs < max_touch)
    rises = np.where(is_touch, pairs / np.maximum(mean_before_touch, 1e-300), 0.0)
    if rises.max(initial=0.0) < _MIN_TOUCH_RISE:
        return None, onset
    first = int(places[rises.argmax()])
    is_quiet = blocks[first + 2 :] < 0.1 * blocks[first : first + 2].max()
    end_block = first + 3 + (int(is_quiet.argmax()) if is_quiet.any() else len(is_quiet))
    return onset + first * size, onset + end_block * size


def _prediction_errors(channel: Array, onset: int, end: int, size: int) -> Array:
    """Return squared errors (n,) of predicting a hit as it rings later; none if short."""
    start = max(0, onset - _MEMORY)
    samples = channel[start : min(end, onset + _TRAINING_RANGE[1] * size)]
    if len(samples) < onset - start + _TRAINING_RANGE[0] * size + 5 * _MEMORY or not np.ptp(
        samples
    ):
        return np.zeros(0)
    windows = np.lib.stride_tricks.sliding_window_view(samples, _MEMORY + 1)
    late_windows = windows[onset - start + _TRAINING_RANGE[0] * size - _MEMORY :]
    late_windows = late_windows[:: max(1, len(late_windows) // _ROWS)]
    # Weighted, so that the soft end counts as much as the loud beginning.
    late_windows = (
        late_windows
        / (np.linalg.norm(late_windows, axis=1) + 1e-9 * np.abs(samples).max())[:, None]
    )
    square = late_windows[:, :-1].T @ late_windows[:, :-1]
    square[np.diag_indices(_MEMORY)] += 1e-9 * square.trace()
    weights = solve(square, late_windows[:, :-1].T @ late_windows[:, -1], assume_a="pos")
    early_windows = windows[: onset - start + (_TOUCH_RANGE[1] + 10) * size]
    errors = np.square(early_windows[:, -1] - early_windows[:, :-1] @ weights)
    return np.r_[np.zeros(_MEMORY - (onset - start)), errors]


def _find_arrival(energy: Array, onset: int, end: int, size: int) -> int:
    """Return the sample until which a negligible share of the hit has sounded."""
    tail = float(energy[max(0, onset - 4 * size) : onset].mean()) if onset else 0.0
    cumulative_energy = np.cumsum(energy[onset:end] - tail)
    # Within a millisecond the last hit's tail and the noise may fluctuate by several times that.
    min_energy = max(_ARRIVAL_FRACTION * float(cumulative_energy.max(initial=0.0)), 4 * size * tail)
    return (
        onset + int(np.argmax(cumulative_energy > min_energy)) if len(cumulative_energy) else onset
    )


def _find_rise_end(energy: Array, onset: int, end: int, size: int) -> int:
    """Return the sample by which the power has risen to half of its maximum, and the push is over.

    That is a little after the loudest moment: blow and recoil of what is struck are over as well.
    """
    last = min(end, onset + round(_CLOSE / _BLOCK) * size)
    if last <= onset:
        return onset
    following = uniform_filter1d(energy[onset:last], size, origin=-(size // 2), mode="constant")
    rise_end = int(np.argmax(following >= 0.5 * following.max(initial=0.0)))
    loudest_sample = int(uniform_filter1d(energy[onset:last], max(1, size // 2)).argmax())
    return min(onset + max(rise_end, loudest_sample) + size, end)


def _rises(take: Take) -> Index:
    """Return samples around which many auditory bands rise together."""
    size, step = _window_and_step(take)
    powers = sum(_band_powers(np.pad(channel, size), size, step, take) for channel in take.samples)
    # Four times the quietest moments: so noise that sets in with the take is no rise.
    quiet_powers = 4 * np.quantile(powers, 0.1, axis=0)
    levels = 10 * np.log10(powers + np.maximum(quiet_powers, 10 ** (-_DEPTH / 10) * np.max(powers)))
    earlier_levels = maximum_filter1d(levels, 3, axis=0)[:-_LAG]
    flux = np.maximum(levels[_LAG:] - earlier_levels, 0).mean(axis=1)
    peaks = flux == maximum_filter1d(flux, 2 * round(_MIN_HIT_DISTANCE / _STEP) + 1)
    median_flux = median_filter(flux, round(_MEDIAN_TIME / _STEP) // 2 * 2 + 1)
    return (np.flatnonzero(peaks & (flux > median_flux + _RISE)) + _LAG) * step - size // 2


def _window_and_step(take: Take) -> tuple[int, int]:
    """Return the length of a window and the step to the next, samples."""
    size = 2 ** round(np.log2(_WINDOW * take.sample_rate))
    return size, max(1, round(_STEP * take.sample_rate))


def _band_powers(channel: Array, size: int, step: int, take: Take) -> Array:
    """Return band powers (frames, bands) of a channel over its loudest frame."""
    bands = erb_number(np.arange(size // 2) * (take.sample_rate / size)).astype(int)
    firsts = np.flatnonzero(np.diff(bands, prepend=-1))
    window = blackman_harris(size)
    parts = []
    for start in range(0, len(channel) - size + 1, _CHUNK * step):
        piece = channel[None, start : start + (_CHUNK - 1) * step + size]
        parts.append(np.add.reduceat(np.abs(frames(piece, window, step)[0]) ** 2, firsts, axis=1))
    powers = np.concatenate(parts)
    return powers / powers.sum(axis=1).max()


def _find_steepest(take: Take, candidates: Index) -> Iterator[int]:
    """Yield the sample of the steepest rise near each candidate, where there is one."""
    size = max(1, round(_BLOCK * take.sample_rate))
    reach = round(_REACH * take.sample_rate)
    min_distance = round(_MIN_HIT_DISTANCE / 2 * take.sample_rate)
    last = -min_distance - 1
    for candidate in candidates:
        first = max(0, candidate - reach)
        rise = _rise(take.samples, first, candidate + reach, size)
        steepest_sample = int(first + np.argmax(rise)) if rise.size else last
        if steepest_sample - last > min_distance and rise.max() > _STEEP:
            last = steepest_sample
            yield steepest_sample


def _rise(samples: Array, first: int, last: int, size: int) -> Array:
    """Return the energy of the next millisecond over that of the last four.

    The energy is that of the prediction error: a ringing tail is predicted, a hit is not.
    """
    margin = 4 * size
    start, end = max(0, first - margin), min(samples.shape[1], last + margin)
    energy = np.zeros(end - start)
    for channel in samples:
        past_samples = channel[max(0, start - _PAST_TIME * size) : start]
        surprise = _squared_errors(past_samples, channel[start:end])
        energy += surprise / max(float(surprise.mean()), 1e-300)
    later_energy = uniform_filter1d(energy, size, origin=-(size // 2), mode="constant")
    earlier_energy = uniform_filter1d(energy, margin, origin=margin // 2 - 1, mode="constant")
    rise = later_energy / (earlier_energy + 1e-6 * later_energy.max(initial=0.0) + 1e-300)
    return rise[first - start : last - start]


def _squared_errors(past_samples: Array, samples: Array) -> Array:
    """Return squared errors of linear prediction with coefficients of the past."""
    if len(past_samples) < 4 * _ORDER or not np.ptp(past_samples):
        return np.square(np.diff(samples, prepend=0.0))
    lags = np.correlate(past_samples, past_samples[: len(past_samples) - _ORDER], "valid")
    lags = lags[: _ORDER + 1] * np.r_[1 + 1e-6, np.ones(_ORDER)]
    weights = solve_toeplitz(lags[:-1], lags[1:])
    history = np.concatenate((past_samples[-_ORDER:], samples))
    return np.square(np.convolve(history, np.r_[1.0, -weights], "valid"))


# Findings: faults of a take.

LEAD_IN = 0.1  # least ambient sound before the first hit that shows the noise, s
MARGIN = 0.005  # between ambient sound and hit, s
# Least depth of a lead-in under the loudest block, dB; the same if it swells by more than the third
_MIN_DEPTH, _MIN_SWELLING_DEPTH, _SWELLS = 5.0, 30.0, 10.0
_BROAD = 0.03  # least share of the band that noise of such a level fills; of tones it is less
_FLAT, _TOPS = 4, 3  # samples of a flat top, and how many tops show clipping
_FULL_SCALE = 0.98
_STEPS, _SPIKE = 8 / 32768, 20  # of full scale below a top; samples at it
_CUT_FRACTION = 0.02  # of its peak: a take that begins louder was cut after its hit
_QUIET_LEVEL = -50.0  # peak, dB of full scale
_MAX_END_LEVEL = 20.0  # end over lead-in, dB
_MAX_NOISE_CHANGE = 6.0  # dB
_LEVEL_BLOCK = 0.05  # s
_MIN_FALL = 40.0  # dB
_SHORT_TIME, _PARTS = 0.25, 10  # s after a hit; parts of which the first and the last are compared
# Loops: samples of a window whose exact repetition is sought, number of windows, shortest loop, s.
_LOOP_WINDOW, _PLACES, _MIN_LOOP_TIME = 64, 32, 0.03
_QUANTUM = 2.0**-23  # 24 bits: a level below its rounding is not the sound of a room


def find_clipped(take: Take) -> Mask:
    """Return which samples (n,) are cut off: a flat top at full scale, or three below it."""
    is_clipped = np.zeros(take.samples.shape[1], bool)
    for channel in take.samples:
        for side in (channel, -channel):
            top = side.max()
            is_flat = np.convolve(side == top, np.ones(_FLAT), "valid") > _FLAT - 0.5
            run_count = np.count_nonzero(np.diff(is_flat.astype(int), prepend=0) == 1)
            # Tops of high tones are short, and soft ones flat by rounding; but where they are cut
            # off, more samples are at the top than just below it.
            flat = np.count_nonzero(side == top)
            is_cut = flat > np.count_nonzero((side > top - max(top / 100, _STEPS)) & (side < top))
            if (run_count and top >= _FULL_SCALE) or (
                is_cut and (flat > _SPIKE or run_count >= _TOPS)
            ):
                is_clipped |= side == top
    return is_clipped


def lead_in(take: Take, hits: Sequence[Hit]) -> Array:
    """Return the samples before the first hit, (channels, n); none where it is not quiet there.

    Ambient sound is noise or softer than a hit, and stays as loud as it is: else it was played.
    """
    first = hits[0].onset - round(MARGIN * take.sample_rate)
    samples = take.samples[:, : max(first, 0)]
    if samples.shape[1] < LEAD_IN * take.sample_rate:
        return samples[:, :0]
    levels = _levels(samples, take.sample_rate)
    max_level = float(_levels(take.samples, take.sample_rate).max())
    is_swelling = float(levels.max() - np.median(levels)) > _SWELLS
    is_loud = float(levels.max()) > max_level - (_MIN_SWELLING_DEPTH if is_swelling else _MIN_DEPTH)
    powers = (np.abs(np.fft.rfft(samples)) ** 2).sum(axis=0)
    is_broad = powers.mean() ** 2 > _BROAD * (powers**2).mean()
    return samples[:, :0] if is_loud and (is_swelling or not is_broad) else samples


def findings(take: Take, hits: Sequence[Hit]) -> Iterator[str]:
    """Yield the faults of a take, one sentence each."""
    yield from _forces(take)
    yield from _clipping(take)
    yield from note_processing(take)
    yield from _loops(take)
    yield from _note_short_take(take, hits)
    yield from _touches(take, hits)
    peak = 20 * np.log10(np.abs(take.samples).max())
    if peak < _QUIET_LEVEL:
        yield f"{take.name} is quiet: its peak is {peak:.0f} dB of full scale"
    if not lead_in(take, hits).shape[1]:
        start_level = float((np.abs(take.samples[:, 0]) / np.abs(take.samples).max()).max())
        cut = (
            f"begins within its sound, at {100 * start_level:.0f} % of its peak, so that the blow "
        )
        cut += "and all that had died away are missing, and "
        yield (
            f"{take.name} {cut if start_level > _CUT_FRACTION else ''}has no lead-in: its noise is "
            f"guessed from its quietest moment; leave {LEAD_IN} s or more of silence before the hit"
        )
        return
    yield from _ending(take, lead_in(take, hits))


def _ending(take: Take, ambient_samples: Array) -> Iterator[str]:
    """Yield faults that a take's end shows next to its lead-in: cut short, or gain control."""
    # The level of rounding errors of 24 bits under the peak, dB.
    rounding_level = float(20 * np.log10(np.abs(take.samples).max() * _QUANTUM / np.sqrt(12)))
    levels = np.maximum(_levels(take.samples, take.sample_rate), rounding_level)
    ambient_level = float(10 * np.log10((ambient_samples**2).mean() + 1e-30))
    end, so = float(levels[-3:].mean()), "so slow decays are less certain; record longer"
    if ambient_level <= rounding_level:  # digital silence: it tells nothing of the noise
        level_fall = float(levels.max()) - end
        if level_fall < _MIN_FALL:
            fall = f"it has fallen by {level_fall:.0f} dB when it ends"
            yield f"{take.name} is cut short: {fall}, {so}"
    elif end - ambient_level > _MAX_END_LEVEL:
        rise = end - ambient_level
        yield f"{take.name} is cut short: it ends {rise:.0f} dB over its lead-in, {so}"
    elif (
        abs(end - ambient_level) > _MAX_NOISE_CHANGE
        and levels.min() - ambient_level < -_MAX_NOISE_CHANGE
    ):
        yield (
            f"the noise of {take.name} changes by {levels.min() - ambient_level:.0f} dB: turn "
            "automatic gain and noise suppression off, for decays are wrong with them"
        )


def _touches(take: Take, hits: Sequence[Hit]) -> Iterator[str]:
    """Yield a remark on hits after which the tool touches once more."""
    delays = [1000 * (hit.again - hit.onset) / take.sample_rate for hit in hits if hit.again]
    if delays:
        yield (
            f"{take.name} is touched again {min(delays):.0f} ms after a hit, in {len(delays)} of "
            f"{counted(len(hits), 'hit')}: it is fitted from when that is over, without modes that "
            "are gone by then; let the tool bounce off"
        )


def _note_short_take(take: Take, hits: Sequence[Hit]) -> Iterator[str]:
    """Yield a remark for a take that ends, or is struck again, while the body still sounds."""
    longest = max(hits, key=lambda hit: hit.end - hit.onset)
    seconds = (longest.end - longest.onset) / take.sample_rate
    size = max(1, round(seconds / _PARTS * take.sample_rate))
    energies = [
        float((take.samples[:, first : first + size] ** 2).sum())
        for first in (longest.start, longest.end - size)
    ]
    if seconds < _SHORT_TIME and energies[1] > 10 ** (-_MIN_FALL / 10) * energies[0]:
        yield (
            f"{take.name} holds {rounded(seconds, 2)} s after a hit at most: tones nearer than "
            f"{1 / seconds:.0f} Hz count as one, and the decay of longer modes is uncertain; "
            "record a second or more"
        )


def _loops(take: Take) -> Iterator[str]:
    """Yield where a take repeats itself sample by sample, which no body and no noise does."""
    rate, last = take.sample_rate, take.samples.shape[1] - 2 * _LOOP_WINDOW
    loudest_channel = take.samples[int((take.samples**2).sum(axis=1).argmax())]
    for start in np.linspace(0, max(last, 0), _PLACES).astype(int):
        window = loudest_channel[start : start + _LOOP_WINDOW]
        if len(np.unique(window)) < _LOOP_WINDOW // 4:
            continue
        positions = np.arange(start + 1, len(loudest_channel) - _LOOP_WINDOW)
        for place, value in enumerate(window):
            positions = positions[loudest_channel[positions + place] == value]
        for repetition in positions[:1]:
            lag = int(repetition) - int(start)
            differences = np.flatnonzero(
                loudest_channel[repetition:] != loudest_channel[start : len(loudest_channel) - lag]
            )
            length = differences[0] if len(differences) else len(loudest_channel) - repetition
            if length > _MIN_LOOP_TIME * rate:
                yield (
                    f"{take.name} repeats {lag / rate:.3f} s of itself from "
                    f"{repetition / rate:.2f} s on, sample by sample: a loop, not a body that "
                    "rings; its decays are those of a machine, so cut it off before"
                )
                return


def _forces(take: Take) -> Iterator[str]:
    for channel in np.flatnonzero(force_channels(take)):
        yield (
            f"channel {channel + 1} of {take.name} holds the force of the blows, short and of one "
            "sign, and no sound: it is left out"
        )
    for channel in np.flatnonzero(copied_channels(take)):
        yield f"channel {channel + 1} of {take.name} is one before it again: it is left out"


def _clipping(take: Take) -> Iterator[str]:
    count = np.count_nonzero(find_clipped(take))
    if count:
        yield (
            f"{take.name} is clipped for {1e3 * count / take.sample_rate:.1f} ms: the sound after "
            "it is fitted; turn the gain down"
        )


def _levels(samples: Array, sample_rate: int) -> Array:
    """Return the mean power of short blocks of samples, dB relative to full scale."""
    size = max(1, round(_LEVEL_BLOCK * sample_rate))
    count = samples.shape[1] // size
    blocks = samples[:, : count * size].reshape(len(samples), count, size)
    return 10 * np.log10((blocks**2).mean(axis=(0, 2)) + 1e-30)

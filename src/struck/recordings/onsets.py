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
from struck.recordings.disturbances import processed
from struck.recordings.noise import blackman_harris, frames
from struck.recordings.takes import Take, copied_channels, force_channels

# window and its steps, s; windows transformed at a time
_WINDOW, _STEP, _CHUNK = 0.023, 0.0029, 4096
_RISE, _LAG = 2.5, 4  # mean over bands, dB, and from how many windows before
_USUAL = 0.5  # a rise is compared with the median within this time, s
_DEPTH = 60.0  # dynamic range below the loudest moment, dB
# least distance of hits, search for the steepest rise, block, s
_APART, _REACH, _BLOCK = 0.06, 0.015, 0.001
_STEEP = 2.0  # least power ratio of the steepest rise
_ORDER, _PAST = 32, 50  # of linear prediction, and its training, ms
_CLOSE = 0.01  # from a hit to its loudest moment, s
_ARRIVED = 1e-4  # share of a hit's energy before its arrival
# A second contact: ms after a hit, least rise of the prediction's errors, and their least
# and most share of the blow's; ms in which the prediction is learned, its order, most equations.
_TOUCHED, _CLEARLY, _TOUCHES = (6, 30), 10.0, (0.02, 4.0)
_LEARNED, _MEMORY, _ROWS = (30, 150), 128, 5000
# s; a fainter hit that sounds at once is the rest of one before
_EDGE, _FAINT = 0.01, 10 ** (-26 / 10)
# s from which bands have to fall after a hit that the take begins with, and by how much in power
_LASTING, _FALLS = 0.3, 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Hit:
    """One strike: four sample numbers of a take."""

    onset: int  # the sound begins to rise
    arrival: int  # nearly all is heard from here on, the blow included
    start: int  # the rise is over: free ringing from here on
    end: int  # the next hit begins, or the take ends
    again: int | None = None  # the tool touches once more, soon after its blow


def find_hits(take: Take) -> list[Hit]:
    """Return the hits of a take in order of time; none where it only swells."""
    onsets = list(_steepest(take, _rises(take)))
    ends = [*onsets, take.samples.shape[1]][1:]
    hits = [hit_at(take, onset, end) for onset, end in zip(onsets, ends, strict=True)]
    if not hits or hits[0].onset >= _EDGE * take.sample_rate:
        return hits
    length = round(_USUAL / 10 * take.sample_rate)
    loudness = [float((take.samples[:, h.start : h.start + length] ** 2).sum()) for h in hits]
    begun = loudness[0] >= _FAINT * max(loudness) and _decays(take, hits[0])
    return hits if begun else hits[1:]


def _decays(take: Take, hit: Hit) -> bool:
    """Return whether the bands of most energy fall until the next hit; yes if that is soon."""
    size, step = _window_and_step(take)
    if hit.end - hit.start < max(_LASTING * take.sample_rate, 10 * size):
        return True
    sound = take.samples[:, hit.start : hit.end]
    powers = np.sum([_band_powers(channel, size, step, take) for channel in sound], axis=0)
    tenth = len(powers) // 10
    early, late = powers[:tenth].mean(axis=0), powers[-tenth:].mean(axis=0)
    return bool(early[early > _FALLS * late].sum() > early.sum() / 2)


def hit_at(take: Take, onset: int, end: int) -> Hit:
    """Return the hit with a known onset that is over at sample `end`, maybe at once."""
    size = max(1, round(_BLOCK * take.sample_rate))
    energy = (take.samples**2).sum(axis=0)
    start = _risen(energy, onset, end, size)
    arrival = min(_arrived(energy, onset, end, size), start)
    again, over = _touched_again(take, onset, end, size)
    return Hit(onset=onset, arrival=arrival, start=max(start, over), end=end, again=again)


def _touched_again(take: Take, onset: int, end: int, size: int) -> tuple[int | None, int]:
    """Return the sample of a second contact soon after a hit, if any, and from where it is over.

    A body that rings freely is predicted by its past, a sum of decaying sines; a push is not.
    """
    sound = take.samples[:, onset : onset + _LEARNED[1] * size]
    surprise = _surprise(take.samples[int((sound**2).sum(axis=1).argmax())], onset, end, size)
    blocks = surprise[: len(surprise) // size * size].reshape(-1, size).sum(axis=1)
    places = np.arange(_TOUCHED[0], min(_TOUCHED[1], len(blocks) - 1))
    before = np.array([blocks[max(2, place - 4) : place].mean() for place in places])
    pairs = (blocks[places] + blocks[places + 1]) / 2
    least, most = np.multiply(_TOUCHES, blocks[: _TOUCHED[0]].max(initial=0.0))
    # What is louder is the blow itself, before which something faint was taken for its beginning.
    loud = (pairs > least) & (pairs < most)
    rises = np.where(loud, pairs / np.maximum(before, 1e-300), 0.0)
    if rises.max(initial=0.0) < _CLEARLY:
        return None, onset
    first = int(places[rises.argmax()])
    after = blocks[first + 2 :] < 0.1 * blocks[first : first + 2].max()
    over = first + 3 + (int(after.argmax()) if after.any() else len(after))
    return onset + first * size, onset + over * size


def _surprise(channel: Array, onset: int, end: int, size: int) -> Array:
    """Return squared errors (n,) of predicting a hit as it rings later; none if short."""
    begin = max(0, onset - _MEMORY)
    heard = channel[begin : min(end, onset + _LEARNED[1] * size)]
    if len(heard) < onset - begin + _LEARNED[0] * size + 5 * _MEMORY or not np.ptp(heard):
        return np.zeros(0)
    past = np.lib.stride_tricks.sliding_window_view(heard, _MEMORY + 1)
    late = past[onset - begin + _LEARNED[0] * size - _MEMORY :]
    late = late[:: max(1, len(late) // _ROWS)]
    # Weighted, so that the soft end counts as much as the loud beginning.
    late = late / (np.linalg.norm(late, axis=1) + 1e-9 * np.abs(heard).max())[:, None]
    square = late[:, :-1].T @ late[:, :-1]
    square[np.diag_indices(_MEMORY)] += 1e-9 * square.trace()
    weights = solve(square, late[:, :-1].T @ late[:, -1], assume_a="pos")
    soon = past[: onset - begin + (_TOUCHED[1] + 10) * size]
    errors = np.square(soon[:, -1] - soon[:, :-1] @ weights)
    return np.r_[np.zeros(_MEMORY - (onset - begin)), errors]


def _arrived(energy: Array, onset: int, end: int, size: int) -> int:
    """Return the sample until which a negligible share of the hit has sounded."""
    tail = float(energy[max(0, onset - 4 * size) : onset].mean()) if onset else 0.0
    heard = np.cumsum(energy[onset:end] - tail)
    # Within a millisecond the last hit's tail and the noise may fluctuate by several times that.
    least = max(_ARRIVED * float(heard.max(initial=0.0)), 4 * size * tail)
    return onset + int(np.argmax(heard > least)) if len(heard) else onset


def _risen(energy: Array, onset: int, end: int, size: int) -> int:
    """Return the sample by which the power has risen to half of its maximum, and the push is over.

    That is a little after the loudest moment: blow and recoil of what is struck are over as well.
    """
    last = min(end, onset + round(_CLOSE / _BLOCK) * size)
    if last <= onset:
        return onset
    following = uniform_filter1d(energy[onset:last], size, origin=-(size // 2), mode="constant")
    risen = int(np.argmax(following >= 0.5 * following.max(initial=0.0)))
    loudest = int(uniform_filter1d(energy[onset:last], max(1, size // 2)).argmax())
    return min(onset + max(risen, loudest) + size, end)


def _rises(take: Take) -> Index:
    """Return samples around which many auditory bands rise together."""
    size, step = _window_and_step(take)
    powers = sum(_band_powers(np.pad(channel, size), size, step, take) for channel in take.samples)
    # Four times the quietest moments: so noise that sets in with the take is no rise.
    quiet = 4 * np.quantile(powers, 0.1, axis=0)
    levels = 10 * np.log10(powers + np.maximum(quiet, 10 ** (-_DEPTH / 10) * np.max(powers)))
    before = maximum_filter1d(levels, 3, axis=0)[:-_LAG]
    flux = np.maximum(levels[_LAG:] - before, 0).mean(axis=1)
    peaks = flux == maximum_filter1d(flux, 2 * round(_APART / _STEP) + 1)
    usual = median_filter(flux, round(_USUAL / _STEP) // 2 * 2 + 1)
    return (np.flatnonzero(peaks & (flux > usual + _RISE)) + _LAG) * step - size // 2


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


def _steepest(take: Take, around: Index) -> Iterator[int]:
    """Yield the sample of the steepest rise near each candidate, where there is one."""
    size = max(1, round(_BLOCK * take.sample_rate))
    reach = round(_REACH * take.sample_rate)
    apart = round(_APART / 2 * take.sample_rate)
    last = -apart - 1
    for middle in around:
        first = max(0, middle - reach)
        rise = _rise(take.samples, first, middle + reach, size)
        best = int(first + np.argmax(rise)) if rise.size else last
        if best - last > apart and rise.max() > _STEEP:
            last = best
            yield best


def _rise(samples: Array, first: int, last: int, size: int) -> Array:
    """Return the energy of the next millisecond over that of the last four.

    Of what the past does not predict: a ringing tail is predicted, a hit is not.
    """
    margin = 4 * size
    start, stop = max(0, first - margin), min(samples.shape[1], last + margin)
    energy = np.zeros(stop - start)
    for channel in samples:
        past = channel[max(0, start - _PAST * size) : start]
        surprise = _unpredicted(past, channel[start:stop])
        energy += surprise / max(float(surprise.mean()), 1e-300)
    after = uniform_filter1d(energy, size, origin=-(size // 2), mode="constant")
    before = uniform_filter1d(energy, margin, origin=margin // 2 - 1, mode="constant")
    rise = after / (before + 1e-6 * after.max(initial=0.0) + 1e-300)
    return rise[first - start : last - start]


def _unpredicted(past: Array, now: Array) -> Array:
    """Return squared errors of linear prediction with coefficients of the past."""
    if len(past) < 4 * _ORDER or not np.ptp(past):
        return np.square(np.diff(now, prepend=0.0))
    lags = np.correlate(past, past[: len(past) - _ORDER], "valid")
    lags = lags[: _ORDER + 1] * np.r_[1 + 1e-6, np.ones(_ORDER)]
    weights = solve_toeplitz(lags[:-1], lags[1:])
    whole = np.concatenate((past[-_ORDER:], now))
    return np.square(np.convolve(whole, np.r_[1.0, -weights], "valid"))


# Findings: what is wrong with a take.

LEAD_IN = 0.1  # least ambient sound before the first hit that shows the noise, s
MARGIN = 0.005  # between ambient sound and hit, s
# dB under the loudest block that a lead-in lies at least, and one that swells by more than so much
_BELOW, _FAR_BELOW, _SWELLS = 5.0, 30.0, 10.0
_BROAD = 0.03  # least share of the band that noise of such a level fills; of tones it is less
_FLAT, _TOPS = 4, 3  # samples of a flat top, and how many tops show clipping
_FULL_SCALE = 0.98
_STEPS, _SPIKE = 8 / 32768, 20  # of full scale below a top; samples at it
_BEGUN = 0.02  # of its peak: a take that begins louder was cut after its hit
_QUIET = -50.0  # peak, dB of full scale
_AUDIBLE = 20.0  # end over lead-in, dB
_CHANGED = 6.0  # dB
_LEVEL_BLOCK = 0.05  # s
_FALLEN = 40.0  # dB
_SOON, _PARTS = 0.25, 10  # s after a hit; parts of which the first and the last are compared
# Loops: samples of a window whose exact repetition is sought, number of windows, shortest loop, s.
_ALIKE, _PLACES, _REPEATED = 64, 32, 0.03
_QUANTUM = 2.0**-23  # 24 bits: what is softer than its rounding is no sound of a room


def clipped(take: Take) -> Mask:
    """Return which samples (n,) are cut off: a flat top at full scale, or three below it."""
    found = np.zeros(take.samples.shape[1], bool)
    for channel in take.samples:
        for side in (channel, -channel):
            top = side.max()
            inside = np.convolve(side == top, np.ones(_FLAT), "valid") > _FLAT - 0.5
            runs = np.count_nonzero(np.diff(inside.astype(int), prepend=0) == 1)
            # Tops of high tones are short, and soft ones flat by rounding; but where they are cut
            # off, more samples are at the top than just below it.
            flat = np.count_nonzero(side == top)
            cut = flat > np.count_nonzero((side > top - max(top / 100, _STEPS)) & (side < top))
            if (runs and top >= _FULL_SCALE) or (cut and (flat > _SPIKE or runs >= _TOPS)):
                found |= side == top
    return found


def lead_in(take: Take, hits: Sequence[Hit]) -> Array:
    """Return the samples before the first hit, (channels, n); none where it is not quiet there.

    Ambient sound is noise or softer than a hit, and stays as loud as it is: else it was played.
    """
    first = hits[0].onset - round(MARGIN * take.sample_rate)
    before = take.samples[:, : max(first, 0)]
    if before.shape[1] < LEAD_IN * take.sample_rate:
        return before[:, :0]
    levels = _levels(before, take.sample_rate)
    loudest = float(_levels(take.samples, take.sample_rate).max())
    swells = float(levels.max() - np.median(levels)) > _SWELLS
    loud = float(levels.max()) > loudest - (_FAR_BELOW if swells else _BELOW)
    powers = (np.abs(np.fft.rfft(before)) ** 2).sum(axis=0)
    broad = powers.mean() ** 2 > _BROAD * (powers**2).mean()
    return before[:, :0] if loud and (swells or not broad) else before


def findings(take: Take, hits: Sequence[Hit]) -> Iterator[str]:
    """Yield the faults of a take, one sentence each."""
    yield from _forces(take)
    yield from _clipping(take)
    yield from processed(take)
    yield from _loops(take)
    yield from _short(take, hits)
    yield from _touches(take, hits)
    peak = 20 * np.log10(np.abs(take.samples).max())
    if peak < _QUIET:
        yield f"{take.name} is quiet: its peak is {peak:.0f} dB of full scale"
    if not lead_in(take, hits).shape[1]:
        begun = float((np.abs(take.samples[:, 0]) / np.abs(take.samples).max()).max())
        cut = f"begins within its sound, at {100 * begun:.0f} % of its peak, so that the blow and "
        cut += "all that had died away are missing, and "
        yield (
            f"{take.name} {cut if begun > _BEGUN else ''}has no lead-in: its noise is guessed from "
            f"its quietest moment; leave {LEAD_IN} s or more of silence before the hit"
        )
        return
    yield from _ending(take, lead_in(take, hits))


def _ending(take: Take, before: Array) -> Iterator[str]:
    """Yield faults that a take's end shows next to its lead-in: cut short, or gain control."""
    # The level of rounding errors of 24 bits under the peak, dB.
    softest = float(20 * np.log10(np.abs(take.samples).max() * _QUANTUM / np.sqrt(12)))
    levels = np.maximum(_levels(take.samples, take.sample_rate), softest)
    quiet = float(10 * np.log10((before**2).mean() + 1e-30))
    end, so = float(levels[-3:].mean()), "so slow decays are less certain; record longer"
    if quiet <= softest:  # digital silence: it tells nothing of the noise
        fallen = float(levels.max()) - end
        if fallen < _FALLEN:
            yield f"{take.name} is cut short: it has fallen by {fallen:.0f} dB when it ends, {so}"
    elif end - quiet > _AUDIBLE:
        yield f"{take.name} is cut short: it ends {end - quiet:.0f} dB over its lead-in, {so}"
    elif abs(end - quiet) > _CHANGED and levels.min() - quiet < -_CHANGED:
        yield (
            f"the noise of {take.name} changes by {levels.min() - quiet:.0f} dB: turn automatic "
            "gain and noise suppression off, for decays are wrong with them"
        )


def _touches(take: Take, hits: Sequence[Hit]) -> Iterator[str]:
    """Yield a remark on hits after which the tool touches once more."""
    later = [1000 * (hit.again - hit.onset) / take.sample_rate for hit in hits if hit.again]
    if later:
        yield (
            f"{take.name} is touched again {min(later):.0f} ms after a hit, in {len(later)} of "
            f"{counted(len(hits), 'hit')}: it is fitted from when that is over, without modes that "
            "are gone by then; let the tool bounce off"
        )


def _short(take: Take, hits: Sequence[Hit]) -> Iterator[str]:
    """Yield a remark for a take that ends, or is struck again, while the body still sounds."""
    longest = max(hits, key=lambda hit: hit.end - hit.onset)
    seconds = (longest.end - longest.onset) / take.sample_rate
    size = max(1, round(seconds / _PARTS * take.sample_rate))
    energies = [
        float((take.samples[:, first : first + size] ** 2).sum())
        for first in (longest.start, longest.end - size)
    ]
    if seconds < _SOON and energies[1] > 10 ** (-_FALLEN / 10) * energies[0]:
        yield (
            f"{take.name} holds {rounded(seconds, 2)} s after a hit at most: tones nearer than "
            f"{1 / seconds:.0f} Hz count as one, and what rings for longer is hardly known; record "
            "a second or more"
        )


def _loops(take: Take) -> Iterator[str]:
    """Yield where a take repeats itself sample by sample, which no body and no noise does."""
    rate, last = take.sample_rate, take.samples.shape[1] - 2 * _ALIKE
    loudest = take.samples[int((take.samples**2).sum(axis=1).argmax())]
    for start in np.linspace(0, max(last, 0), _PLACES).astype(int):
        window = loudest[start : start + _ALIKE]
        if len(np.unique(window)) < _ALIKE // 4:
            continue
        later = np.arange(start + 1, len(loudest) - _ALIKE)
        for place, value in enumerate(window):
            later = later[loudest[later + place] == value]
        for again in later[:1]:
            lag = int(again) - int(start)
            differs = np.flatnonzero(loudest[again:] != loudest[start : len(loudest) - lag])
            length = differs[0] if len(differs) else len(loudest) - again
            if length > _REPEATED * rate:
                yield (
                    f"{take.name} repeats {lag / rate:.3f} s of itself from {again / rate:.2f} s "
                    "on, sample by sample: a loop, not a body that rings; its decays are those of "
                    "a machine, so cut it off before"
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
    count = np.count_nonzero(clipped(take))
    if count:
        yield (
            f"{take.name} is clipped for {1e3 * count / take.sample_rate:.1f} ms: what follows is "
            "fitted; turn the gain down"
        )


def _levels(samples: Array, sample_rate: int) -> Array:
    """Return the mean power of short blocks of samples, dB relative to full scale."""
    size = max(1, round(_LEVEL_BLOCK * sample_rate))
    count = samples.shape[1] // size
    blocks = samples[:, : count * size].reshape(len(samples), count, size)
    return 10 * np.log10((blocks**2).mean(axis=(0, 2)) + 1e-30)

"""Selection of modes: unique ones are kept, close pairs split, redundant ones dropped."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from struck.model.arrays import AnyComplex, Array, Index, Mask
from struck.model.exponentials import Exponentials, correlations
from struck.perception.auditory_scale import erb_number
from struck.recordings.poles.candidates import Candidates, loudest_per_band
from struck.recordings.poles.normal_equations import SLOWEST, add_unique, damped
from struck.recordings.poles.refinement import (
    Attempt,
    blocks_around,
    overlap,
    overlapping,
    overlaps,
    refine,
    settled,
    with_best_gains,
)
from struck.recordings.poles.uncertainty import (
    met,
    pole_statistics,
    significance,
    standard_errors,
)
from struck.recordings.poles.verdict import crowding
from struck.recordings.segments import Segment

_STEADY = 3.0  # nepers that a tone decays by in a segment at most
_SAME = 0.25  # of the expected energy is in the lead-in
_CERTAIN = 6.0  # expected energy over noise


def ambient(segments: Sequence[Segment], ringing: Exponentials) -> Mask:
    """Return which modes (M,) are steady tones that the lead-ins hold at the same level, too.

    Never those that decay within a segment, or that the lead-ins are too short or noisy to show.
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


def _energies(segment: Segment, ringing: Exponentials) -> tuple[Array, Array]:
    """Return energies over noise of tones in the lead-in: as measured, and as expected there."""
    length = segment.before.shape[1]
    window = np.hanning(length)
    sums = correlations(1j * ringing.poles.imag, segment.before * window, segment.sample_rate)
    floor = segment.noise.densities.min(axis=1)[:, None] * (window**2).sum()
    gains = np.abs(ringing.gains[segment.rows]) * window.sum() / 2
    return (np.abs(sums) ** 2 / floor).sum(axis=0), (gains**2 / floor).sum(axis=0)


_COLLINEAR = 1e-3  # least share
LOWEST, _HIGHEST = 15.0, 0.49  # frequencies, Hz and of the sample rate
_TOUCHING = 0.05  # squared correlation
_SHARE = 2  # at most one in this many goes at once for the budget
_PER_BAND = 4  # candidates
# A hit that soft, re the loudest, counts half. Bands count by their energy to the power of one less
# this exponent: with 0.3 as loudness would have it, strikes are rendered less exactly.
_SOFT, _EVEN = 1e-3, 0.15


def energies(segments: Sequence[Segment], ringing: Exponentials) -> tuple[Array, Array]:
    """Return the energy over noise that each mode alone explains, and its share of the mode's."""
    duration = max(segment.duration for segment in segments)
    energy, share = np.zeros(ringing.count), np.zeros(ringing.count)
    if not ringing.count:
        return energy, share
    groups = overlapping(ringing.poles, duration)
    blocks = blocks_around(segments, ringing.poles, groups, data=False)
    poles, gains = map(np.ascontiguousarray, (ringing.poles, ringing.gains))
    add_unique(blocks, poles, gains, energy, share)
    return energy, share


def strongest_per_band(segments: Sequence[Segment], found: Candidates, most: int) -> Candidates:
    """Return the candidates of most energy, a few in each auditory band (ERB) at most."""
    frequencies = np.asarray(found.poles.imag / (2 * np.pi), float)
    # The noise's density over its mean turns ratios into energies.
    parts = [each.noise.at(frequencies) / each.noise.energy(1)[:, None] for each in segments]
    loudness = found.energies * np.concatenate(parts).mean(axis=0)
    kept = loudest_per_band(loudness, frequencies, _PER_BAND)
    kept = kept[np.argsort(-loudness[kept])][:most]
    return Candidates(poles=found.poles[kept], energies=found.energies[kept])


def prune(
    segments: Sequence[Segment], ringing: Exponentials, *, budget: int | None = None
) -> Exponentials:
    """Drop modes that noise or other modes could explain, and the weakest beyond a budget."""
    least = significance(len(ringing.gains))
    duration = max(segment.duration for segment in segments)
    sums: list[AnyComplex] = []
    while ringing.count:
        energy, share = energies(segments, ringing)
        touching = overlaps(ringing.poles, duration) > _TOUCHING
        bad = (energy < least) | (share < _COLLINEAR) | _impossible(ringing, segments, touching)
        excess = ringing.count - budget if budget is not None else 0
        if excess > 0:
            rank = _worth(segments, ringing, share)
            bad[np.argsort(rank)[: max(1, min(excess, ringing.count // _SHARE))]] = True
        if not bad.any():
            break
        kept = ~_apart(bad, energy, touching)
        sums = [each[:, kept] for each in sums] or [
            correlations(ringing.poles[kept], each.samples, each.sample_rate) for each in segments
        ]
        ringing = with_best_gains(segments, ringing.of(kept), sums)
    return ringing


def _worth(segments: Sequence[Segment], ringing: Exponentials, share: Array) -> Array:
    """Return the weight of each mode (M,) under a budget, by the share of it that is its own.

    Its energy in each hit and channel over all that rings there, so that a mode that many takes
    need is worth more than a loud one of one take; a little more where its band of the ear is soft.
    """
    longest = max(segment.duration for segment in segments)
    lasting = 1 / np.maximum(ringing.decays, 1 / longest)
    energies = np.square(np.abs(ringing.gains)) * lasting * share
    totals = energies.sum(axis=1)
    worth = (energies / (totals + _SOFT * totals.max())[:, None]).sum(axis=0)
    numbers = erb_number(ringing.frequencies)
    band = (np.abs(numbers[:, None] - numbers) < 0.5) @ worth
    return np.asarray(worth / np.maximum(band, 1e-300) ** _EVEN)


def _impossible(ringing: Exponentials, segments: Sequence[Segment], touching: Mask) -> Mask:
    highest = _HIGHEST * max(segment.sample_rate for segment in segments)
    outside = (ringing.frequencies < LOWEST) | (ringing.frequencies > highest)
    # A tone that never decays may be of the surroundings; one beside others makes up for a body
    # that changed from hit to hit.
    steady = ringing.decays < 1.01 * SLOWEST
    return outside | (steady & (touching.sum(axis=1) > 1))


def _apart(bad: Mask, energy: Array, touching: Mask) -> Mask:
    """Return the weakest of bad modes that touch: its neighbour may do without it."""
    chosen = np.zeros(len(bad), bool)
    for mode in np.flatnonzero(bad)[np.argsort(energy[bad])]:
        chosen[mode] = not (touching[mode] & chosen).any()
    return chosen


# Beating pairs of nearly symmetric objects: two poles around their centroid s sound as a exp(s t)
# plus c t^2 exp(s t) / 2, to second order: the term in between is gone when s is fitted. So what
# one pole leaves over is correlated with the second derivative of its line, and the ratio c / a
# tells how far apart the two are, and whether in frequency or in decay.

_SUSPECT, _PROVEN = 1e-3, 1e-5  # chance that noise makes a pair, before and after a trial
_STEPS = 12
_COMPANY = 6  # modes that are fitted anew in a trial
_CLOSE_TO_SPLIT, _CLOSE = 0.05, 0.02  # squared correlations of company, to split and to weed


def split(
    segments: Sequence[Segment], ringing: Exponentials, fastest: float = np.inf
) -> Exponentials:
    """Split the modes that are pairs, where noise cannot be the reason; fast ones (1/s) stay."""
    for mode, distance in _suspects(segments, ringing, fastest):
        ringing = _split_up(segments, ringing, mode, distance / 2)
    return ringing


def _split_up(
    segments: Sequence[Segment], ringing: Exponentials, mode: int, half: complex
) -> Exponentials:
    """Split one mode, its neighbours giving way, if that explains more than noise would."""
    group = _company(segments, ringing, mode, _CLOSE_TO_SPLIT)
    blocks = blocks_around(segments, ringing.poles, [group])
    before = settled(blocks, ringing, ringing.poles[group], 0)
    start = np.append(ringing.poles[group], ringing.poles[mode] - half)
    start[np.flatnonzero(group == mode)] += half
    after = settled(blocks, ringing, damped(start), _STEPS)
    if before.cost - after.cost < before.misfit * significance(len(ringing.gains) + 1, _PROVEN):
        return ringing
    return _refitted(ringing.joined(after.poles[-1:]), np.append(group, ringing.count), after)


def _company(segments: Sequence[Segment], ringing: Exponentials, mode: int, least: float) -> Index:
    """Return the modes that overlap most with one, itself included."""
    duration = max(segment.duration for segment in segments)
    close = overlap(ringing.poles[mode], ringing.poles, duration)
    group = np.argsort(-close)[:_COMPANY]
    return group[close[group] > least]


def _refitted(ringing: Exponentials, group: Index, attempt: Attempt) -> Exponentials:
    """Return a copy with the poles and gains of a group replaced."""
    poles, gains = ringing.poles.copy(), ringing.gains.copy()
    poles[group], gains[:, group] = attempt.poles, attempt.gains
    return Exponentials(poles=poles, gains=gains)


def _suspects(
    segments: Sequence[Segment], ringing: Exponentials, fastest: float
) -> Iterator[tuple[int, complex]]:
    """Yield modes whose residual looks like a pair, with the distance of its poles."""
    found = pole_statistics(segments, ringing)
    widths = ringing.decays
    distances = np.sqrt(8 * found.crossed / np.maximum(found.whole, 1e-300))
    lengths = np.clip(np.abs(distances), 0.2 * widths, 3 * widths)
    distances *= lengths / np.maximum(np.abs(distances), 1e-30)
    least = significance(len(ringing.gains), _SUSPECT)
    suspicious = (found.energies > least) & (widths < fastest)
    for mode in found.order[suspicious[found.order]]:
        yield int(mode), complex(distances[mode])


# The energy that a mode alone explains counts all others as they are. Beside a strong mode that
# misleads: its pole has moved to make room, and would do without its neighbour where it stood
# before.

_WEAK = 0.1  # of the amplitude of a mode that it overlaps with
# A mode with less than this share of its own, and this much louder than any sample, only cancels.
_ALIKE, _LOUD = 0.03, 2.0


def weed(segments: Sequence[Segment], ringing: Exponentials) -> Exponentials:
    """Drop weak modes that their neighbours replace with a residual no larger than the noise."""
    duration = max(segment.duration for segment in segments)
    ringing = _uncrowded(segments, ringing)
    for pole in ringing.poles[np.argsort(np.abs(ringing.gains).max(axis=0))]:
        mode = int(np.argmin(np.abs(ringing.poles - pole)))
        close = overlap(pole, ringing.poles, duration)
        sizes = np.abs(ringing.gains).max(axis=0)
        if ringing.poles[mode] == pole and (sizes[mode] < _WEAK * sizes[close > _CLOSE]).any():
            ringing = _without(segments, ringing, mode)
    return ringing


def _uncrowded(segments: Sequence[Segment], ringing: Exponentials) -> Exponentials:
    """Drop modes so alike that gains beyond all that was heard only cancel each other."""
    peaks = np.concatenate([np.abs(each.samples).max(axis=1) for each in segments])
    while True:
        _, shares = energies(segments, ringing)
        loud = (np.abs(ringing.gains) > _LOUD * peaks[:, None]).any(axis=0)
        alike = np.flatnonzero(loud & (shares < _ALIKE))
        if not alike.size:
            return ringing
        mode = int(alike[np.argmin(shares[alike])])
        ringing = _without(segments, ringing, mode, needed=False)


def _without(
    segments: Sequence[Segment], ringing: Exponentials, mode: int, *, needed: bool = True
) -> Exponentials:
    """Drop a mode, a `needed` one only if its refined neighbours lose no more than noise."""
    group = _company(segments, ringing, mode, _CLOSE)
    blocks = blocks_around(segments, ringing.poles, [group])
    rest = group[group != mode]
    fewer = settled(blocks, ringing, ringing.poles[rest], _STEPS)
    if needed:
        whole = settled(blocks, ringing, ringing.poles[group], _STEPS)
        least = whole.misfit * significance(len(ringing.gains) + 1, _PROVEN)
        if fewer.cost - whole.cost > least:
            return ringing
    return _refitted(ringing, rest, fewer).of(np.arange(ringing.count) != mode)


# A room, a coder or a swaying gain answers each mode with a crowd of others that no model of few
# modes explains. In a crowd every mode of a fit has neighbours as strong; a mode of the object is
# louder than the residual in its own band while it lasts.

_SEPARATE = 4.0  # widths between modes that are tried at once: a crowd is not fitted as a whole
_TRIALS, _AT_ONCE = 6, 256  # of so many modes at most: most are of a crowd where more are near
_STANDS_OUT = 1e-9  # chance that what is left in its band makes a mode
_FAINT = 10**1.9  # energy over what is left at which a mode's decay is known to 16 %
_KNOWN = 10**1.6  # the same to 22 %
_SURE = 10**5.0  # the same to 0.5 %: none of a crowd
_MOST, _OFTEN = 0.5, 0.2  # of the modes are faint, and of their bands hold more than noise: a crowd
LASTING = 0.6  # of the decay of a crowd: slower modes are none of it
_CLEARLY = 1.5  # times what faint modes usually have, over the skirts of louder ones
_ANSWER = 5.0  # largest energy of what a room makes of a mode, over the mode's own
_OVER_NOISE = 2.0  # what is left over the noise: more than noise


def standing_out(
    segments: Sequence[Segment], ringing: Exponentials, found: Candidates
) -> Exponentials:
    """Join modes with candidates that stand out of the residual in their bands, a few at a time."""
    least = significance(len(ringing.gains), _STANDS_OUT)
    for _ in range(_TRIALS):
        if not found.poles.size:
            break
        tried = _separate(segments, found)
        trial = refine(segments, ringing.joined(found.poles[tried]), sweeps=1, steps=0)
        heard = _lasting(segments, trial) / met(segments, trial)[1]
        kept = heard.sum(axis=0) > least
        kept[: ringing.count] = True
        if kept.sum() == ringing.count:
            break
        more = refine(segments, trial.of(kept), sweeps=1, steps=0)
        if crowding(segments, ringing, more):
            break
        ringing = more
        rest = np.delete(np.arange(len(found.poles)), tried)
        found = Candidates(poles=found.poles[rest], energies=found.energies[rest])
    return ringing


def crowd(segments: Sequence[Segment], ringing: Exponentials) -> Mask:
    """Return which modes (M,) are a crowd: they hardly stand out of a residual over the noise.

    Where most are faint, they have themselves made that residual small. Then slower modes than they
    are none of the crowd, and others only those that the skirts of louder modes hide.
    """
    errors = standard_errors(segments, ringing).decays
    # Nothing tells the decay of what outlasts all segments any better than this.
    told = np.maximum(ringing.decays, 1 / max(segment.duration for segment in segments))
    energies = 2 * (told / np.maximum(errors, 1e-300)) ** 2
    over = raised(segments, ringing)
    faint, known = energies < _FAINT, energies > _KNOWN
    weak = ringing.decays[faint & over]
    if not weak.size or over.mean() < _OFTEN or faint.mean() < _MOST:
        return over & ~known
    slow = ringing.decays < LASTING * np.median(weak)
    free = (known & slow) | (energies > _SURE)
    energy, skirts = _skirts(ringing)
    ratios = (energy / np.maximum(skirts[:, free].sum(axis=1), 1e-300))[faint & ~free]
    usual = min(float(np.median(ratios)), _ANSWER) if ratios.size else _ANSWER
    return hidden(ringing, free, _CLEARLY * usual)


def _skirts(ringing: Exponentials) -> tuple[Array, Array]:
    """Return energies of modes (M,), and of each the part that is alike to others (M, M)."""
    energy = (np.abs(ringing.gains) ** 2).sum(axis=0) / ringing.decays
    return energy, overlaps(ringing.poles, np.inf) * energy


def hidden(ringing: Exponentials, free: Mask, least: float) -> Mask:
    """Return which modes (M,) the skirts of louder modes hide, no free ones among them.

    What a room makes of a mode goes off with the distance from it as the mode's own line does: a
    mode counts that has so often the energy at least of all skirts together where it stands.
    """
    energy, skirts = _skirts(ringing)
    level, seen = skirts[:, free].sum(axis=1), free.copy()
    for mode in np.argsort(-energy):
        if not seen[mode] and energy[mode] > least * level[mode]:
            seen[mode] = True
            level += skirts[:, mode]
    return ~seen


def raised(segments: Sequence[Segment], ringing: Exponentials) -> Mask:
    """Return in the bands of which modes (M,) more than noise is left."""
    usual = np.concatenate([each.noise.at(ringing.frequencies) for each in segments])
    return np.any(met(segments, ringing)[0] > _OVER_NOISE * usual, axis=0)


def _lasting(segments: Sequence[Segment], ringing: Exponentials) -> Array:
    """Return energies (C, M) along modes, in the unit of the noise's density."""
    duration = max(segment.duration for segment in segments)
    lasting = -np.expm1(-2 * ringing.decays * duration) / (2 * ringing.decays)
    return np.abs(ringing.gains) ** 2 * lasting * segments[0].sample_rate / 4


def _separate(segments: Sequence[Segment], found: Candidates) -> Index:
    """Return the strongest of candidates in each band."""
    duration = max(segment.duration for segment in segments)
    frequencies = found.poles.imag / (2 * np.pi)
    reach = _SEPARATE * np.maximum(-found.poles.real / np.pi, 1 / duration)
    free = np.ones(len(frequencies), bool)
    chosen = []
    for mode in np.argsort(-found.energies):
        if free[mode] and len(chosen) < _AT_ONCE:
            chosen.append(mode)
            free &= np.abs(frequencies - frequencies[mode]) > np.maximum(reach, reach[mode])
    return np.array(chosen, np.int64)

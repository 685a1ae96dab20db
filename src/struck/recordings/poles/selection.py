"""Selection of modes: unique ones are kept, close pairs split, redundant ones dropped."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from struck.model.arrays import AnyComplex, Array, Index, Mask
from struck.model.exponentials import Exponentials, correlations
from struck.perception.auditory_scale import erb_number
from struck.recordings.poles.candidates import Candidates, loudest_per_band
from struck.recordings.poles.normal_equations import MIN_DECAY, add_unique, with_bounded_decays
from struck.recordings.poles.refinement import (
    Attempt,
    blocks_around,
    find_groups,
    overlap,
    overlaps,
    refine,
    refine_attempt,
    with_best_gains,
)
from struck.recordings.poles.uncertainty import (
    densities_at_modes,
    pole_statistics,
    significance,
    standard_errors,
)
from struck.recordings.poles.verdict import is_diverging
from struck.recordings.segments import Segment

_MAX_STEADY_DECAY = 3.0  # nepers that a tone decays by in a segment at most
_MIN_AMBIENT_FRACTION = 0.25  # of the expected energy is in the lead-in
_MIN_EXPECTED_ENERGY = 6.0  # expected energy over noise


def find_ambient(segments: Sequence[Segment], ringing: Exponentials) -> Mask:
    """Return which modes (M,) are steady tones that the lead-ins hold at the same level, too.

    Never those that decay within a segment, or that the lead-ins are too short or noisy to show.
    """
    duration = max(segment.duration for segment in segments)
    is_steady = ringing.decays * duration < _MAX_STEADY_DECAY
    tones = ringing.of(is_steady)
    lead_in_energies, expected_energies, channels = np.zeros(tones.count), np.zeros(tones.count), 0
    for segment in segments:
        if segment.before.shape[1]:
            measured_part, expected_part = _energies(segment, tones)
            lead_in_energies, expected_energies = (
                lead_in_energies + measured_part,
                expected_energies + expected_part,
            )
            channels += len(segment.before)
    is_steady[is_steady] = (expected_energies > _MIN_EXPECTED_ENERGY * max(channels, 1)) & (
        lead_in_energies > _MIN_AMBIENT_FRACTION * expected_energies
    )
    return is_steady


def _energies(segment: Segment, ringing: Exponentials) -> tuple[Array, Array]:
    """Return energies over noise of tones in the lead-in: as measured, and as expected there."""
    length = segment.before.shape[1]
    window = np.hanning(length)
    sums = correlations(1j * ringing.poles.imag, segment.before * window, segment.sample_rate)
    floor = segment.noise.densities.min(axis=1)[:, None] * (window**2).sum()
    gains = np.abs(ringing.gains[segment.rows]) * window.sum() / 2
    return (np.abs(sums) ** 2 / floor).sum(axis=0), (gains**2 / floor).sum(axis=0)


_COLLINEAR = 1e-3  # least share
MIN_FREQUENCY, _MAX_RATE_FRACTION = 15.0, 0.49  # frequencies, Hz and of the sample rate
_TOUCHING_CORRELATION = 0.05  # squared correlation
_DROP_DIVISOR = 2  # at most one in this many goes at once for the budget
_PER_BAND = 4  # candidates
# A hit that soft, re the loudest, counts half. Bands count by their energy to the power of one less
# this exponent: with 0.3 as loudness would have it, strikes are rendered less exactly.
_SOFT_RATIO, _BAND_EXPONENT = 1e-3, 0.15


def energies(segments: Sequence[Segment], ringing: Exponentials) -> tuple[Array, Array]:
    """Return the energy over noise that each mode alone explains, and its share of the mode's."""
    duration = max(segment.duration for segment in segments)
    energy, fractions = np.zeros(ringing.count), np.zeros(ringing.count)
    if not ringing.count:
        return energy, fractions
    groups = find_groups(ringing.poles, duration)
    blocks = blocks_around(segments, ringing.poles, groups, data=False)
    poles, gains = map(np.ascontiguousarray, (ringing.poles, ringing.gains))
    add_unique(blocks, poles, gains, energy, fractions)
    return energy, fractions


def strongest_per_band(
    segments: Sequence[Segment], candidates: Candidates, max_count: int
) -> Candidates:
    """Return the candidates of most energy, a few in each auditory band (ERB) at most."""
    frequencies = np.asarray(candidates.poles.imag / (2 * np.pi), float)
    # The noise's density over its mean turns ratios into energies.
    parts = [
        segment.noise.at(frequencies) / segment.noise.energy(1)[:, None] for segment in segments
    ]
    loudness = candidates.energies * np.concatenate(parts).mean(axis=0)
    indices = loudest_per_band(loudness, frequencies, _PER_BAND)
    indices = indices[np.argsort(-loudness[indices])][:max_count]
    return Candidates(poles=candidates.poles[indices], energies=candidates.energies[indices])


def prune(
    segments: Sequence[Segment], ringing: Exponentials, *, budget: int | None = None
) -> Exponentials:
    """Drop modes that noise or other modes could explain, and the weakest beyond a budget."""
    min_energy = significance(len(ringing.gains))
    duration = max(segment.duration for segment in segments)
    sums: list[AnyComplex] = []
    while ringing.count:
        energy, fractions = energies(segments, ringing)
        touching = overlaps(ringing.poles, duration) > _TOUCHING_CORRELATION
        is_redundant = (
            (energy < min_energy)
            | (fractions < _COLLINEAR)
            | _find_impossible(ringing, segments, touching)
        )
        surplus = ringing.count - budget if budget is not None else 0
        if surplus > 0:
            rank = _budget_weights(segments, ringing, fractions)
            is_redundant[
                np.argsort(rank)[: max(1, min(surplus, ringing.count // _DROP_DIVISOR))]
            ] = True
        if not is_redundant.any():
            break
        is_remaining = ~_select_weakest(is_redundant, energy, touching)
        sums = [segment_sums[:, is_remaining] for segment_sums in sums] or [
            correlations(ringing.poles[is_remaining], segment.samples, segment.sample_rate)
            for segment in segments
        ]
        ringing = with_best_gains(segments, ringing.of(is_remaining), sums)
    return ringing


def _budget_weights(segments: Sequence[Segment], ringing: Exponentials, fractions: Array) -> Array:
    """Return the weight of each mode (M,) under a budget, by the share of it that is its own.

    Its energy in each hit and channel over all that rings there, so that a mode that many takes
    need is worth more than a loud one of one take; a little more where its band of the ear is soft.
    """
    longest = max(segment.duration for segment in segments)
    durations = 1 / np.maximum(ringing.decays, 1 / longest)
    energies = np.square(np.abs(ringing.gains)) * durations * fractions
    total_energies = energies.sum(axis=1)
    weights = (energies / (total_energies + _SOFT_RATIO * total_energies.max())[:, None]).sum(
        axis=0
    )
    numbers = erb_number(ringing.frequencies)
    band = (np.abs(numbers[:, None] - numbers) < 0.5) @ weights
    return np.asarray(weights / np.maximum(band, 1e-300) ** _BAND_EXPONENT)


def _find_impossible(ringing: Exponentials, segments: Sequence[Segment], touching: Mask) -> Mask:
    max_frequency = _MAX_RATE_FRACTION * max(segment.sample_rate for segment in segments)
    is_outside = (ringing.frequencies < MIN_FREQUENCY) | (ringing.frequencies > max_frequency)
    # A tone that never decays may be of the surroundings; one with neighbours compensates a body
    # that changed from hit to hit.
    is_steady = ringing.decays < 1.01 * MIN_DECAY
    return is_outside | (is_steady & (touching.sum(axis=1) > 1))


def _select_weakest(is_redundant: Mask, energy: Array, touching: Mask) -> Mask:
    """Return the weakest of bad modes that touch: its neighbour may do without it."""
    is_chosen = np.zeros(len(is_redundant), bool)
    for mode in np.flatnonzero(is_redundant)[np.argsort(energy[is_redundant])]:
        is_chosen[mode] = not (touching[mode] & is_chosen).any()
    return is_chosen


# Beating pairs of nearly symmetric objects: two poles around their centroid s sound as a exp(s t)
# plus c t^2 exp(s t) / 2, to second order: the term in between vanishes when s is fitted. So the
# residual of one pole is correlated with the second derivative of its line, and the ratio c / a
# gives the distance of the two, in frequency or in decay.

_SUSPECT_CHANCE = 1e-3  # probability that noise makes a pair, before a trial
_PAIR_CHANCE = 1e-5  # the same after a trial
_STEPS = 12
_MAX_NEIGHBOURS = 6  # modes that are refitted in a trial
# squared correlation of the neighbours that are refitted with a split mode
_SPLIT_CORRELATION = 0.05
_DROP_CORRELATION = 0.02  # the same with a dropped mode


def split_pairs(
    segments: Sequence[Segment], ringing: Exponentials, max_decay: float = np.inf
) -> Exponentials:
    """Split the modes that are pairs, where noise cannot be the reason; fast ones (1/s) stay."""
    for mode, distance in _suspects(segments, ringing, max_decay):
        ringing = _split_up(segments, ringing, mode, distance / 2)
    return ringing


def _split_up(
    segments: Sequence[Segment], ringing: Exponentials, mode: int, half: complex
) -> Exponentials:
    """Split one mode and refit its neighbours, if that explains more than noise would."""
    group = _neighbours_of(segments, ringing, mode, _SPLIT_CORRELATION)
    blocks = blocks_around(segments, ringing.poles, [group])
    old_attempt = refine_attempt(blocks, ringing, ringing.poles[group], 0)
    start = np.append(ringing.poles[group], ringing.poles[mode] - half)
    start[np.flatnonzero(group == mode)] += half
    new_attempt = refine_attempt(blocks, ringing, with_bounded_decays(start), _STEPS)
    if old_attempt.cost - new_attempt.cost < old_attempt.misfit * significance(
        len(ringing.gains) + 1, _PAIR_CHANCE
    ):
        return ringing
    return _with_group(
        ringing.joined(new_attempt.poles[-1:]), np.append(group, ringing.count), new_attempt
    )


def _neighbours_of(
    segments: Sequence[Segment], ringing: Exponentials, mode: int, min_overlap: float
) -> Index:
    """Return the modes that overlap most with one, itself included."""
    duration = max(segment.duration for segment in segments)
    close = overlap(ringing.poles[mode], ringing.poles, duration)
    group = np.argsort(-close)[:_MAX_NEIGHBOURS]
    return group[close[group] > min_overlap]


def _with_group(ringing: Exponentials, group: Index, attempt: Attempt) -> Exponentials:
    """Return a copy with the poles and gains of a group replaced."""
    poles, gains = ringing.poles.copy(), ringing.gains.copy()
    poles[group], gains[:, group] = attempt.poles, attempt.gains
    return Exponentials(poles=poles, gains=gains)


def _suspects(
    segments: Sequence[Segment], ringing: Exponentials, max_decay: float
) -> Iterator[tuple[int, complex]]:
    """Yield modes whose residual looks like a pair, with the distance of its poles."""
    statistics = pole_statistics(segments, ringing)
    widths = ringing.decays
    distances = np.sqrt(8 * statistics.crossed / np.maximum(statistics.whole, 1e-300))
    lengths = np.clip(np.abs(distances), 0.2 * widths, 3 * widths)
    distances *= lengths / np.maximum(np.abs(distances), 1e-30)
    min_energy = significance(len(ringing.gains), _SUSPECT_CHANCE)
    is_suspect = (statistics.energies > min_energy) & (widths < max_decay)
    for mode in statistics.order[is_suspect[statistics.order]]:
        yield int(mode), complex(distances[mode])


# The energy that a mode alone explains counts all others as they are. Next to a strong mode that
# misleads: the pole of that mode has moved, and would not need its neighbour at its former place.

_WEAK_RATIO = 0.1  # of the amplitude of a mode that it overlaps with
# A mode with a smaller unique fraction of its energy, and a larger ratio of its gain to the peak of
# the samples, only cancels others.
_MIN_UNIQUE_FRACTION, _MAX_GAIN_RATIO = 0.03, 2.0


def drop_redundant(segments: Sequence[Segment], ringing: Exponentials) -> Exponentials:
    """Drop weak modes that their neighbours replace with a residual no larger than the noise."""
    duration = max(segment.duration for segment in segments)
    ringing = _drop_cancelling(segments, ringing)
    for pole in ringing.poles[np.argsort(np.abs(ringing.gains).max(axis=0))]:
        mode = int(np.argmin(np.abs(ringing.poles - pole)))
        close = overlap(pole, ringing.poles, duration)
        sizes = np.abs(ringing.gains).max(axis=0)
        if (
            ringing.poles[mode] == pole
            and (sizes[mode] < _WEAK_RATIO * sizes[close > _DROP_CORRELATION]).any()
        ):
            ringing = _drop_mode(segments, ringing, mode)
    return ringing


def _drop_cancelling(segments: Sequence[Segment], ringing: Exponentials) -> Exponentials:
    """Drop modes so similar that their gains, far above the samples, only cancel each other."""
    peaks = np.concatenate([np.abs(segment.samples).max(axis=1) for segment in segments])
    while True:
        _, shares = energies(segments, ringing)
        is_loud = (np.abs(ringing.gains) > _MAX_GAIN_RATIO * peaks[:, None]).any(axis=0)
        cancelling_modes = np.flatnonzero(is_loud & (shares < _MIN_UNIQUE_FRACTION))
        if not cancelling_modes.size:
            return ringing
        mode = int(cancelling_modes[np.argmin(shares[cancelling_modes])])
        ringing = _drop_mode(segments, ringing, mode, is_needed=False)


def _drop_mode(
    segments: Sequence[Segment], ringing: Exponentials, mode: int, *, is_needed: bool = True
) -> Exponentials:
    """Drop a mode, one that `is_needed` only if its refined neighbours lose no more than noise."""
    group = _neighbours_of(segments, ringing, mode, _DROP_CORRELATION)
    blocks = blocks_around(segments, ringing.poles, [group])
    remaining_modes = group[group != mode]
    reduced_attempt = refine_attempt(blocks, ringing, ringing.poles[remaining_modes], _STEPS)
    if is_needed:
        full_attempt = refine_attempt(blocks, ringing, ringing.poles[group], _STEPS)
        min_gain = full_attempt.misfit * significance(len(ringing.gains) + 1, _PAIR_CHANCE)
        if reduced_attempt.cost - full_attempt.cost > min_gain:
            return ringing
    return _with_group(ringing, remaining_modes, reduced_attempt).of(
        np.arange(ringing.count) != mode
    )


# A room, a coder or a fluctuating gain adds sound to each mode that no model of few modes explains
# and that many spurious modes fit. They have neighbours as strong as themselves; a mode of
# the object is louder than the residual in its band while it lasts.

# Half-power bandwidths between candidates of one trial.
_MIN_SEPARATION = 4.0
_TRIALS = 6
_MAX_CANDIDATES = 256  # candidates of a trial at most
_SIGNIFICANCE_CHANCE = 1e-9  # probability that the residual in its band makes a mode
_FAINT_ENERGY = 10**1.9  # energy over the residual at which a mode's decay is known to 16 %
_KNOWN_ENERGY = 10**1.6  # the same to 22 %
_SURE_ENERGY = 10**5.0  # the same to 0.5 %: not spurious
_FAINT_FRACTION = 0.5  # of the modes are faint if many are spurious
_UNEXPLAINED_FRACTION = 0.2  # of their bands hold more than noise if many are spurious
SLOW_DECAY_RATIO = 0.6  # of the median decay of faint modes: slower modes are not spurious
_CLEAR_RATIO = 1.5  # times the median of faint modes, of energy over the skirts of louder ones
_MAX_RESPONSE_RATIO = 5.0  # largest energy of a room's response to a mode, over that of the mode
_MIN_NOISE_RATIO = 2.0  # residual over noise from which it is not noise alone


def add_significant(
    segments: Sequence[Segment], ringing: Exponentials, candidates: Candidates
) -> Exponentials:
    """Join modes with candidates that stand out of the residual in their bands, a few at a time."""
    min_ratio = significance(len(ringing.gains), _SIGNIFICANCE_CHANCE)
    for _ in range(_TRIALS):
        if not candidates.poles.size:
            break
        trial_numbers = _select_separate(segments, candidates)
        trial = refine(segments, ringing.joined(candidates.poles[trial_numbers]), sweeps=1, steps=0)
        energy_ratios = _mode_energies(segments, trial) / densities_at_modes(segments, trial)[1]
        is_significant = energy_ratios.sum(axis=0) > min_ratio
        is_significant[: ringing.count] = True
        if is_significant.sum() == ringing.count:
            break
        extended_modes = refine(segments, trial.of(is_significant), sweeps=1, steps=0)
        if is_diverging(segments, ringing, extended_modes):
            break
        ringing = extended_modes
        remaining_numbers = np.delete(np.arange(len(candidates.poles)), trial_numbers)
        candidates = Candidates(
            poles=candidates.poles[remaining_numbers],
            energies=candidates.energies[remaining_numbers],
        )
    return ringing


def find_spurious(segments: Sequence[Segment], ringing: Exponentials) -> Mask:
    """Return which modes (M,) are spurious: not clear of a residual over the noise.

    If most are faint, they have themselves made that residual small. Then modes that decay slower
    than these are not spurious, and of the others only those that the skirts of louder modes mask.
    """
    errors = standard_errors(segments, ringing).decays
    # The decay of a mode that outlasts all segments is not known any better than this.
    decay_scales = np.maximum(ringing.decays, 1 / max(segment.duration for segment in segments))
    energies = 2 * (decay_scales / np.maximum(errors, 1e-300)) ** 2
    is_over_noise = find_unexplained_bands(segments, ringing)
    is_faint, is_known = energies < _FAINT_ENERGY, energies > _KNOWN_ENERGY
    weak_decays = ringing.decays[is_faint & is_over_noise]
    if (
        not weak_decays.size
        or is_over_noise.mean() < _UNEXPLAINED_FRACTION
        or is_faint.mean() < _FAINT_FRACTION
    ):
        return is_over_noise & ~is_known
    is_slow = ringing.decays < SLOW_DECAY_RATIO * np.median(weak_decays)
    is_free = (is_known & is_slow) | (energies > _SURE_ENERGY)
    energy, skirts = _skirts(ringing)
    ratios = (energy / np.maximum(skirts[:, is_free].sum(axis=1), 1e-300))[is_faint & ~is_free]
    typical_ratio = (
        min(float(np.median(ratios)), _MAX_RESPONSE_RATIO) if ratios.size else _MAX_RESPONSE_RATIO
    )
    return find_masked(ringing, is_free, _CLEAR_RATIO * typical_ratio)


def _skirts(ringing: Exponentials) -> tuple[Array, Array]:
    """Return energies of modes (M,), and the part of each that is correlated with others (M, M)."""
    energy = (np.abs(ringing.gains) ** 2).sum(axis=0) / ringing.decays
    return energy, overlaps(ringing.poles, np.inf) * energy


def find_masked(ringing: Exponentials, is_free: Mask, min_ratio: float) -> Mask:
    """Return which modes (M,) the skirts of louder modes mask, free ones excluded.

    A room's response to a mode falls with the distance in frequency as the mode's line does: a mode
    is unmasked if its energy exceeds `min_ratio` times that of the skirts of free and louder
    unmasked modes at its frequency.
    """
    energy, skirts = _skirts(ringing)
    level, is_unmasked = skirts[:, is_free].sum(axis=1), is_free.copy()
    for mode in np.argsort(-energy):
        if not is_unmasked[mode] and energy[mode] > min_ratio * level[mode]:
            is_unmasked[mode] = True
            level += skirts[:, mode]
    return ~is_unmasked


def find_unexplained_bands(segments: Sequence[Segment], ringing: Exponentials) -> Mask:
    """Return in the bands of which modes (M,) the residual exceeds the noise."""
    noise_densities = np.concatenate(
        [segment.noise.at(ringing.frequencies) for segment in segments]
    )
    return np.any(
        densities_at_modes(segments, ringing)[0] > _MIN_NOISE_RATIO * noise_densities, axis=0
    )


def _mode_energies(segments: Sequence[Segment], ringing: Exponentials) -> Array:
    """Return energies (C, M) along modes, in the unit of the noise's density."""
    duration = max(segment.duration for segment in segments)
    durations = -np.expm1(-2 * ringing.decays * duration) / (2 * ringing.decays)
    return np.abs(ringing.gains) ** 2 * durations * segments[0].sample_rate / 4


def _select_separate(segments: Sequence[Segment], candidates: Candidates) -> Index:
    """Return the strongest of candidates in each band."""
    duration = max(segment.duration for segment in segments)
    frequencies = candidates.poles.imag / (2 * np.pi)
    reach = _MIN_SEPARATION * np.maximum(-candidates.poles.real / np.pi, 1 / duration)
    is_free = np.ones(len(frequencies), bool)
    chosen = []
    for mode in np.argsort(-candidates.energies):
        if is_free[mode] and len(chosen) < _MAX_CANDIDATES:
            chosen.append(mode)
            is_free &= np.abs(frequencies - frequencies[mode]) > np.maximum(reach, reach[mode])
    return np.array(chosen, np.int64)

"""Verdict on a fit: whether a body rings at all, which hits are real, which modes the blow's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.sparse.csgraph import connected_components

from struck.model.arrays import Array, Mask
from struck.model.exponentials import Exponentials, best_gains, correlations, samples
from struck.recordings.onsets import Hit, lead_in
from struck.recordings.poles.uncertainty import densities_at_modes, significance, standard_errors
from struck.recordings.segments import Row, Segment
from struck.recordings.takes import Take

MODAL_MARGIN = 8.0  # least signal over the misfit of a modal sound, dB
MANY_MODES, _LARGE_BUDGET = 256, 64  # modes
_MIN_COMMON_FRACTION = 0.08  # fraction of energy that takes of one object have in common at least
_MIN_GROWTH = 1.25  # growth by one pass, from which on modes may be spurious
_MIN_DECAY, _MAX_NAMED_TAKES = 0.02, 8  # 1/s; takes that a note names
_STEADY_FRACTION = 0.5  # share of the energy
_STEADY_DECAY = 0.05  # 1/s: it would ring for more than two minutes
_LATE_TIME, _LEVEL_BLOCK = 0.1, 0.05  # s
_MAX_SWELLING = 6.0  # dB
_MAX_LEVEL_RANGE = 0.5  # dB
_CONSTANT_REASON = "it is as loud from beginning to end, as hum is: nothing was struck"


@dataclass(frozen=True, slots=True, kw_only=True)
class ModalVerdict:
    """Whether a sound is modal, that of a struck object, and if not, why not."""

    modal: bool  # decaying modes explain it
    reason: str  # why not, in one sentence; empty where it is
    signal_to_residual: float  # energy of the segments over their residual, dB
    # the same without the residual's part that is noise as in a lead-in; may be infinite
    signal_to_misfit: float
    takes: tuple[float, ...] = ()  # signal to misfit of each take, dB


def judge(
    segments: Sequence[Segment],
    rows: Sequence[Row],
    ringing: Exponentials,
    outside_energies: Sequence[float] = (),
    *,
    is_steady: bool = False,
) -> ModalVerdict:
    """Return whether fitted modes make these segments modal.

    Only the noise of a lead-in is subtracted from the misfit: noise guessed from a quiet moment may
    be sound that the modes do not explain. `outside_energies`, of each take outside of all
    segments, count as unexplained.
    """
    signal = np.concatenate([(segment.samples**2).sum(axis=1) for segment in segments])
    left = np.concatenate([(segment.residual(ringing) ** 2).sum(axis=1) for segment in segments])
    noise = np.concatenate([_lead_in_noise(segment) for segment in segments])
    owners = np.array([row.take for row in rows])
    for take, energy in enumerate(outside_energies):
        first = np.argmax(owners == take)
        signal[first] += energy
        left[first] += energy
    misfits = tuple(
        _decibels(signal[mask].sum(), (left - noise)[mask].sum())
        for mask in (owners == take for take in np.unique(owners))
    )
    misfit = _decibels(signal.sum(), (left - noise).sum())
    reason = _reason(segments, ringing, misfit) or (_CONSTANT_REASON if is_steady else "")
    return ModalVerdict(
        modal=not reason,
        reason=reason,
        signal_to_residual=_decibels(signal.sum(), left.sum()),
        signal_to_misfit=misfit,
        takes=misfits,
    )


def is_hopeless(segments: Sequence[Segment], ringing: Exponentials, budget: int | None) -> bool:
    """Return whether modes explain so little that no search of further ones is worth its time.

    Where a large budget is used up that is half of what a modal sound takes, in decibels; else less
    than all of that with several hundreds of modes: each pass over a cymbal finds as many more.
    """
    min_margin = MODAL_MARGIN / 2 if budget else MODAL_MARGIN
    has_many = ringing.count >= (max(budget, _LARGE_BUDGET) if budget else MANY_MODES)
    return has_many and signal_to_misfit(segments, ringing) < min_margin


def is_diverging(
    segments: Sequence[Segment], old_modes: Exponentials, new_modes: Exponentials
) -> bool:
    """Return whether hundreds of modes grow by a larger share than their residual falls."""
    growth = new_modes.count / old_modes.count if old_modes.count else 0.0
    is_fast = growth > _MIN_GROWTH and new_modes.count >= MANY_MODES
    return is_fast and growth * residual_energy(segments, new_modes) > residual_energy(
        segments, old_modes
    )


def residual_energy(segments: Sequence[Segment], ringing: Exponentials) -> float:
    """Return the energy of the residual of modes in all segments."""
    return sum(float((segment.residual(ringing) ** 2).sum()) for segment in segments)


def signal_to_misfit(segments: Sequence[Segment], ringing: Exponentials) -> float:
    """Return the energy of segments over the misfit of modes, without the noise of lead-ins, dB."""
    signal = sum(float((segment.samples**2).sum()) for segment in segments)
    noise = sum(float(_lead_in_noise(segment).sum()) for segment in segments)
    return _decibels(signal, residual_energy(segments, ringing) - noise)


def _lead_in_noise(segment: Segment) -> Array:
    """Return the energy of the noise (C,) as far as a lead-in has shown it."""
    energy = segment.noise.energy(segment.samples.shape[1])
    return energy if segment.before.shape[1] else np.zeros_like(energy)


def _reason(segments: Sequence[Segment], ringing: Exponentials, misfit: float) -> str:
    if not ringing.count:
        return "nothing rings that stands out of the noise"
    if _steady_fraction(segments, ringing) > _STEADY_FRACTION:
        return "most of it is a steady tone that does not decay: nothing was struck"
    if misfit < MODAL_MARGIN:
        return (
            f"what {ringing.count} decaying modes leave is only {misfit:.1f} dB below the sound, "
            f"and {MODAL_MARGIN:g} dB are needed: it is noise-like, as of a cymbal, or moves in "
            "pitch, as speech does, or needs more modes"
        )
    if _level_rise(segments) > _MAX_SWELLING:
        return "it grows louder after its beginning: nothing was struck there"
    return ""


def _steady_fraction(segments: Sequence[Segment], ringing: Exponentials) -> float:
    """Return the share of energy in modes that are sure to decay too slowly."""
    errors = standard_errors(segments, ringing).decays
    steady_modes = ringing.of(ringing.decays + errors < _STEADY_DECAY)
    if not steady_modes.count:
        return 0.0
    total_energy = sum(float((segment.samples**2).sum()) for segment in segments)
    return (
        sum(float((segment.model(steady_modes) ** 2).sum()) for segment in segments) / total_energy
    )


def _level_rise(segments: Sequence[Segment]) -> float:
    """Return how far the level of the loudest segment rises after its beginning, dB."""
    segment = max(segments, key=lambda segment: float((segment.samples**2).sum()))
    size = max(1, round(_LEVEL_BLOCK * segment.sample_rate))
    count = segment.samples.shape[1] // size
    if count < 2 * _LATE_TIME / _LEVEL_BLOCK:
        return 0.0
    blocks = (segment.samples[:, : count * size].reshape(-1, count, size) ** 2).sum(axis=(0, 2))
    late_block = round(_LATE_TIME / _LEVEL_BLOCK)
    return _decibels(float(blocks[late_block:].max()), float(blocks[:late_block].max()))


def _decibels(numerator: float, denominator: float) -> float:
    return float(10 * np.log10(numerator / denominator)) if denominator > 0 else np.inf


# The blow itself is not a sum of decaying tones, yet a budget of modes models the whole sound.
# Modes that model the blow add up to the sound during the contact and to zero afterwards, although
# each alone would still ring. A mode of the object continues: its gain refitted from any moment
# after the blow is the gain decayed until then.

_LONGEST_PUSH, _SHORTEST_PUSH = 0.02, 5e-4  # s, of blows: a soft mallet, and a hard tool
_SMOOTHING_TIME = 5e-4  # s
_MAX_GAIN_CHANGE = 0.5  # of what a gain has decayed to
_LATER_FACTOR = 5  # end of the later sound, in push durations
_MIN_RINGING_RATIO = 2.0  # its energy over that of the noise, from twice the push on
_CLEAR_RATIO = 16.0  # times the significant energy, from which a changed gain contradicts a mode
_STRAY_FRACTION = 0.1  # of the modes may be contradicted for other reasons than the blow
_TIME_RATIO = 1.5  # from one moment of comparison to the next, a factor
_WINDOW = 2 * _LONGEST_PUSH  # s that are compared
_MIN_BLOW_DECAY = np.log(100) / (2 * _LONGEST_PUSH)  # 1/s: falls by 40 dB in twice the longest push
# Relative to the half-power bandwidth, or to the resolution of the longest segment.
_MAX_RELATIVE_ERROR = 0.3


def find_blow_modes(
    segments: Sequence[Segment], ringing: Exponentials, *, is_released: bool = False
) -> Mask:
    """Return which modes (M,) are of the hits' blow, not of the object.

    The push is over after twice the time to the loudest moment, as that of a half-sine is; all are
    of the blow if only noise follows. If segments begin after the contact (`is_released`), no modes
    cancel during the push; modes that fall by 40 dB in twice the push are of the blow.
    """
    push_times = []
    later_energy = noise_energy = 0.0
    for segment in segments:
        rate = segment.sample_rate
        energy = (segment.samples[:, : round(_LONGEST_PUSH / 2 * rate)] ** 2).sum(axis=0)
        peak = int(uniform_filter1d(energy, max(1, round(_SMOOTHING_TIME * rate))).argmax())
        push_end = max(2 * peak, round(_SHORTEST_PUSH * rate))
        push_times.append(push_end / rate)
        samples = segment.samples[:, 2 * push_end : _LATER_FACTOR * push_end]
        later_energy += float((samples**2).sum())
        noise_energy += float(segment.noise.energy(samples.shape[1]).sum())
    if later_energy < _MIN_RINGING_RATIO * noise_energy:
        return np.ones(ringing.count, bool)
    if is_released:
        return ringing.decays * 2 * max(push_times) > np.log(100)
    return _find_cancelled(segments, ringing, push_times) | _find_contradicted(segments, ringing)


def _find_cancelled(
    segments: Sequence[Segment], ringing: Exponentials, push_times: Sequence[float]
) -> Mask:
    """Return which modes (M,) change their gains where they are fitted again after the push, s."""
    change, gain_energies = np.zeros(ringing.count), np.full(ringing.count, 1e-300)
    for segment, push in zip(segments, push_times, strict=True):
        push_end = round(push * segment.sample_rate)
        expected_gains = ringing.gains[segment.rows] * np.exp(ringing.poles * push)
        refitted = best_gains(ringing.poles, segment.samples[:, push_end:], segment.sample_rate)
        change += (np.abs(refitted - expected_gains) ** 2).sum(axis=0)
        gain_energies += (np.abs(expected_gains) ** 2).sum(axis=0)
    return change > _MAX_GAIN_CHANGE**2 * gain_energies


def _find_contradicted(segments: Sequence[Segment], ringing: Exponentials) -> Mask:
    """Return which modes (M,) later samples contradict, and which die within the blow.

    Modes that outlast the longest blow are not tried. A mode is contradicted at a moment if its
    gain changes by half where all gains are fitted again, and either it should stand clear of the
    noise there or less than half of it is left in its band, by more than noise takes away by
    chance. The blow lasts twice the time after which at most a tenth of the modes are contradicted
    for the first time, the shortest push at least; modes below the noise by then died within it.
    """
    is_fast = ringing.decays > _MIN_BLOW_DECAY
    slow_modes, fast_modes = ringing.of(~is_fast), ringing.of(is_fast)
    is_of_blow = np.zeros(ringing.count, bool)
    if not fast_modes.count:
        return is_of_blow
    min_energy = significance(len(ringing.gains))
    floor = densities_at_modes(segments, ringing)[1][:, is_fast]
    steps = np.log(_LONGEST_PUSH / _SHORTEST_PUSH) / np.log(_TIME_RATIO)
    times = _SHORTEST_PUSH * _TIME_RATIO ** np.arange(int(steps) + 1)
    first, energies = np.full(fast_modes.count, np.inf), np.zeros((len(times), fast_modes.count))
    for number, time in enumerate(times):
        expected_squares, lone_squares, change, missing, energies[number] = _compare_gains(
            segments, slow_modes, fast_modes, floor, time
        )
        max_change = _MAX_GAIN_CHANGE**2 * expected_squares
        is_gone = (lone_squares < max_change) & (missing > min_energy)
        is_wrong = (change > max_change) & (
            is_gone | (energies[number] > _CLEAR_RATIO * min_energy)
        )
        first[is_wrong] = np.minimum(first[is_wrong], time)
    is_contradicted = np.isfinite(first)
    blow_end = 2 * float(
        np.quantile(np.where(is_contradicted, first, times[0] / 2), 1 - _STRAY_FRACTION)
    )
    last = min(int(np.searchsorted(times, 0.999 * blow_end)), len(times) - 1)
    is_of_blow[is_fast] = is_contradicted | (energies[last] <= min_energy)
    return is_of_blow


def _compare_gains(
    segments: Sequence[Segment],
    slow_modes: Exponentials,
    fast_modes: Exponentials,
    floor: Array,
    time: float,
) -> Array:
    """Return sums over rows, weighted by the noise `floor` (C, M), from a `time`, s, on (5, M).

    They are squares of the expected gains of the `fast_modes`, of those of each fitted alone, and
    of the changes where all are fitted together; then energies over noise of what each alone lacks,
    and of what is expected. The sound of the `slow_modes` is subtracted first.
    """
    sums = np.zeros((5, fast_modes.count))
    for segment in segments:
        rate, start = segment.sample_rate, round(time * segment.sample_rate)
        samples_in_window = segment.samples[:, start : start + round(_WINDOW * rate)]
        length = samples_in_window.shape[1]
        if not length:
            continue
        slow_gains = slow_modes.gains[segment.rows] * np.exp(slow_modes.poles * start / rate)
        left = samples_in_window - samples(slow_modes.poles, slow_gains, length, rate)
        expected_gains = fast_modes.gains[segment.rows] * np.exp(fast_modes.poles * start / rate)
        products = correlations(fast_modes.poles, left, rate)
        change = np.abs(best_gains(fast_modes.poles, left, rate, products) - expected_gains)
        losses = -2 * fast_modes.decays / rate
        powers = np.expm1(losses * length) / np.expm1(losses)
        lone_sizes, sizes = 2 * np.abs(products) / powers, np.abs(expected_gains)
        squares = np.square([sizes, lone_sizes, change, np.maximum(sizes - lone_sizes, 0.0), sizes])
        squares[3:] *= powers / 4
        sums += (squares / np.maximum(floor[segment.rows], 1e-300)).sum(axis=1)
    return sums


def find_vague(
    segments: Sequence[Segment], frequencies: Array, decays: Array, errors: tuple[Array, Array]
) -> Mask:
    """Return which modes (M,) are known to 30 % at best.

    `errors` are those of their frequencies, Hz, and decay rates, 1/s. A decay is known as well as
    its half-power bandwidth d / pi, which no take shows finer than 1 Hz over its length in s.
    """
    min_width = np.pi / max(segment.duration for segment in segments)
    is_unsure = errors[1] >= _MAX_RELATIVE_ERROR * np.maximum(decays, min_width)
    return is_unsure | (errors[0] >= _MAX_RELATIVE_ERROR * frequencies)


def is_constant(take: Take) -> bool:
    """Return whether a take is as loud all the time, by blocks of whole periods of 50 and 60 Hz."""
    size = round(_LATE_TIME * take.sample_rate)
    count = take.samples.shape[1] // size
    if count < 5:
        return False
    blocks = (take.samples[:, : count * size].reshape(-1, count, size) ** 2).sum(axis=(0, 2))
    return _decibels(float(blocks.max()), float(blocks.min())) < _MAX_LEVEL_RANGE


def energy_before_hits(take: Take, hits: Sequence[Hit]) -> float:
    """Return the energy of a take before its first hit, unless that is the quiet of a lead-in."""
    if not hits or lead_in(take, hits).shape[1]:
        return 0.0
    return float((take.samples[:, : hits[0].onset] ** 2).sum())


def notes_on_other_objects(rows: Sequence[Row], exponentials: Exponentials) -> Iterator[str]:
    """Yield a note on takes whose energy is in other modes than that of the first takes."""
    takes = np.array([row.take for row in rows])
    energies = np.abs(exponentials.gains) ** 2 / np.maximum(exponentials.decays, _MIN_DECAY)
    energy_profiles = np.array([energies[takes == take].sum(axis=0) for take in np.unique(takes)])
    energy_profiles /= np.maximum(energy_profiles.sum(axis=1, keepdims=True), 1e-300)
    shared = np.array([np.minimum(one, energy_profiles).sum(axis=1) for one in energy_profiles])
    _, group = connected_components(shared > _MIN_COMMON_FRACTION)
    others = np.flatnonzero(group != group[0])
    if others.size:
        numbers = ", ".join(
            str(number + 1) for number in np.unique(takes)[others][:_MAX_NAMED_TAKES]
        )
        max_percentage = 100 * shared[np.ix_(group == group[0], others)].max()
        yield (
            f"at most {max_percentage:.1f} % of the sound is common to take 1 and take {numbers}: "
            "they may be of two objects; fit each separately"
        )


# Further hits of a take. A splice, a gust of noise or the end of a note rises in many bands, too. A
# hit adds energy; one that adds little is tested: separate gains must reduce the residual by more
# than they cost (Schwarz 1978).

_POWER_WINDOW = 0.02  # s before and after a hit
_MIN_POWER_RATIO = 2.0  # least power ratio of a hit that needs no proof


def find_doubtful(take: Take, hits: Sequence[Hit]) -> list[Hit]:
    """Return the hits after the first that do not double the power."""
    size = round(_POWER_WINDOW * take.sample_rate)
    energy = (take.samples**2).sum(axis=0)
    return [
        hit
        for hit in hits[1:]
        if energy[hit.start : hit.start + size].sum()
        < _MIN_POWER_RATIO * energy[max(hit.onset - size, 0) : hit.onset].sum()
    ]


def is_proven(hit_residuals: Sequence[Array], other_residuals: Sequence[Array], modes: int) -> bool:
    """Return whether residuals (C, n) with a hit are less than without by more than its gains cost.

    By the Bayesian information criterion, of two real gains for each mode and channel, and as many
    values as a residual of its bandwidth has that are independent.
    """
    other_energy, hit_energy = (
        sum(float((residual**2).sum()) for residual in left)
        for left in (other_residuals, hit_residuals)
    )
    values = sum(map(_count_independent, other_residuals))
    cost = 2 * modes * len(hit_residuals) * np.log(max(values, 2.0))
    return values * np.log(max(other_energy, 1e-300) / max(hit_energy, 1e-300)) > cost


def _count_independent(left: Array) -> float:
    """Return the number of independent values: twice the bandwidth times the duration."""
    powers = (np.abs(np.fft.rfft(left)) ** 2).sum(axis=0)
    # The squared powers of white noise have twice the squared mean power.
    return float(left.size * 2 * powers.mean() ** 2 / max((powers**2).mean(), 1e-300))

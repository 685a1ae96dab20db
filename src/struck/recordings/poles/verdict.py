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
from struck.recordings.poles.uncertainty import met, significance, standard_errors
from struck.recordings.segments import Row, Segment
from struck.recordings.takes import Take

MODAL_MARGIN = 8.0  # least signal over the misfit of a modal sound, dB
CROWDED, _LARGE = 256, 64  # modes
_SHARED = 0.08  # of their energy that takes of one object have in common at least
_FAST = 1.25  # growth by one look, from which on it may be of a crowd
_SLOWEST, _FEW = 0.02, 8  # 1/s; takes that a note names
_STEADY = 0.5  # share of the energy
_SLOW = 0.05  # 1/s: it would ring for more than two minutes
_LATE, _EARLY = 0.1, 0.05  # s
_SWELLS = 6.0  # dB
_STILL = 0.5  # dB
_CONSTANT = "it is as loud from beginning to end, as hum is: nothing was struck"


@dataclass(frozen=True, slots=True, kw_only=True)
class ModalVerdict:
    """Whether a sound is modal, that of a struck object, and if not, why not."""

    modal: bool  # decaying modes explain it
    reason: str  # why not, in one sentence; empty where it is
    signal_to_residual: float  # energy of the segments over their residual, dB
    # the same without the share of the residual that is noise heard in a lead-in; may be infinite
    signal_to_misfit: float
    takes: tuple[float, ...] = ()  # signal to misfit of each take, dB


def judge(
    segments: Sequence[Segment],
    rows: Sequence[Row],
    ringing: Exponentials,
    outside: Sequence[float] = (),
    *,
    steady: bool = False,
) -> ModalVerdict:
    """Return whether fitted modes make these segments modal.

    Only noise that a lead-in has shown is forgiven: what was guessed from a quiet moment may be
    what the modes fail to explain, as is the energy of each take `outside` of all segments.
    """
    signal = np.concatenate([(each.samples**2).sum(axis=1) for each in segments])
    left = np.concatenate([(each.residual(ringing) ** 2).sum(axis=1) for each in segments])
    noise = np.concatenate([_heard_noise(each) for each in segments])
    owners = np.array([row.take for row in rows])
    for take, energy in enumerate(outside):
        first = np.argmax(owners == take)
        signal[first] += energy
        left[first] += energy
    misfits = tuple(
        _decibels(signal[own].sum(), (left - noise)[own].sum())
        for own in (owners == take for take in np.unique(owners))
    )
    misfit = _decibels(signal.sum(), (left - noise).sum())
    reason = _reason(segments, ringing, misfit) or (_CONSTANT if steady else "")
    return ModalVerdict(
        modal=not reason,
        reason=reason,
        signal_to_residual=_decibels(signal.sum(), left.sum()),
        signal_to_misfit=misfit,
        takes=misfits,
    )


def hopeless(segments: Sequence[Segment], ringing: Exponentials, budget: int | None) -> bool:
    """Return whether modes explain so little that no search of further ones is worth its time.

    Where a large budget is used up that is half of what a modal sound takes, in decibels; else less
    than all of that with several hundreds of modes: each look at a cymbal finds as many more.
    """
    least = MODAL_MARGIN / 2 if budget else MODAL_MARGIN
    many = ringing.count >= (max(budget, _LARGE) if budget else CROWDED)
    return many and explained(segments, ringing) < least


def crowding(segments: Sequence[Segment], before: Exponentials, after: Exponentials) -> bool:
    """Return whether hundreds of modes grow by a larger share than their residual falls."""
    growth = after.count / before.count if before.count else 0.0
    fast = growth > _FAST and after.count >= CROWDED
    return fast and growth * left_over(segments, after) > left_over(segments, before)


def left_over(segments: Sequence[Segment], ringing: Exponentials) -> float:
    """Return the energy of the residual of modes in all segments."""
    return sum(float((each.residual(ringing) ** 2).sum()) for each in segments)


def explained(segments: Sequence[Segment], ringing: Exponentials) -> float:
    """Return the energy of segments over the misfit of modes, without the noise of lead-ins, dB."""
    signal = sum(float((each.samples**2).sum()) for each in segments)
    noise = sum(float(_heard_noise(each).sum()) for each in segments)
    return _decibels(signal, left_over(segments, ringing) - noise)


def _heard_noise(segment: Segment) -> Array:
    """Return the energy of the noise (C,) as far as a lead-in has shown it."""
    energy = segment.noise.energy(segment.samples.shape[1])
    return energy if segment.before.shape[1] else np.zeros_like(energy)


def _reason(segments: Sequence[Segment], ringing: Exponentials, misfit: float) -> str:
    if not ringing.count:
        return "nothing rings that stands out of the noise"
    if _steady(segments, ringing) > _STEADY:
        return "most of it is a steady tone that does not decay: nothing was struck"
    if misfit < MODAL_MARGIN:
        return (
            f"what {ringing.count} decaying modes leave is only {misfit:.1f} dB below the sound, "
            f"and {MODAL_MARGIN:g} dB are needed: it is noise-like, as of a cymbal, or moves in "
            "pitch, as speech does, or wants more modes"
        )
    if _swelling(segments) > _SWELLS:
        return "it grows louder after its beginning: nothing was struck there"
    return ""


def _steady(segments: Sequence[Segment], ringing: Exponentials) -> float:
    """Return the share of energy in modes that are sure to decay too slowly."""
    errors = standard_errors(segments, ringing).decays
    steady = ringing.of(ringing.decays + errors < _SLOW)
    if not steady.count:
        return 0.0
    whole = sum(float((each.samples**2).sum()) for each in segments)
    return sum(float((each.model(steady) ** 2).sum()) for each in segments) / whole


def _swelling(segments: Sequence[Segment]) -> float:
    """Return how far the level of the loudest segment rises after its beginning, dB."""
    segment = max(segments, key=lambda each: float((each.samples**2).sum()))
    size = max(1, round(_EARLY * segment.sample_rate))
    count = segment.samples.shape[1] // size
    if count < 2 * _LATE / _EARLY:
        return 0.0
    blocks = (segment.samples[:, : count * size].reshape(-1, count, size) ** 2).sum(axis=(0, 2))
    late = round(_LATE / _EARLY)
    return _decibels(float(blocks[late:].max()), float(blocks[:late].max()))


def _decibels(above: float, below: float) -> float:
    return float(10 * np.log10(above / below)) if below > 0 else np.inf


# The blow itself is no sum of decaying tones, yet a budget of modes stands for the whole sound.
# Those that stand for the blow add up to what is heard until the object is let go, and to nothing
# afterwards, although each alone would still ring. A mode of the object is heard on: gains fitted
# again from any moment after the blow are what they have decayed to.

_LONGEST_PUSH, _SHORTEST_PUSH = 0.02, 5e-4  # s, of blows: a soft mallet, and a hard tool
_SMOOTHED = 5e-4  # s
_CHANGED = 0.5  # of what a gain has decayed to
_AFTER, _RINGS = 5, 2.0  # times the push; energy from twice to so often over the noise's
_CLEAR = 16.0  # times what noise has by chance: enough to see by its gain that a mode is none
_STRAY = 0.1  # of the modes may be contradicted for other reasons than the blow
_LATER = 1.5  # from one moment of comparison to the next, a factor
_WINDOW = 2 * _LONGEST_PUSH  # s that are compared
_LASTING = np.log(100) / (2 * _LONGEST_PUSH)  # 1/s: falls by 40 dB in twice the longest push
_UNKNOWN = 0.3  # of its half-power bandwidth, or of the resolution of the longest segment


def of_blow(segments: Sequence[Segment], ringing: Exponentials, *, released: bool = False) -> Mask:
    """Return which modes (M,) are of the hits' blow, not of the object.

    The push is over after twice the time to the loudest moment, as that of a half-sine is; all are
    of the blow if only noise follows. In segments that begin when the object is `released` no modes
    cancel for a push, and those are of the blow that fall by 40 dB in twice the push.
    """
    pushes = []
    after = noise = 0.0
    for segment in segments:
        rate = segment.sample_rate
        energy = (segment.samples[:, : round(_LONGEST_PUSH / 2 * rate)] ** 2).sum(axis=0)
        loudest = int(uniform_filter1d(energy, max(1, round(_SMOOTHED * rate))).argmax())
        later = max(2 * loudest, round(_SHORTEST_PUSH * rate))
        pushes.append(later / rate)
        heard = segment.samples[:, 2 * later : _AFTER * later]
        after += float((heard**2).sum())
        noise += float(segment.noise.energy(heard.shape[1]).sum())
    if after < _RINGS * noise:
        return np.ones(ringing.count, bool)
    if released:
        return ringing.decays * 2 * max(pushes) > np.log(100)
    return _cancelled(segments, ringing, pushes) | _within_blow(segments, ringing)


def _cancelled(segments: Sequence[Segment], ringing: Exponentials, pushes: Sequence[float]) -> Mask:
    """Return which modes (M,) change their gains where they are fitted again after the push, s."""
    change, total = np.zeros(ringing.count), np.full(ringing.count, 1e-300)
    for segment, push in zip(segments, pushes, strict=True):
        later = round(push * segment.sample_rate)
        decayed = ringing.gains[segment.rows] * np.exp(ringing.poles * push)
        refitted = best_gains(ringing.poles, segment.samples[:, later:], segment.sample_rate)
        change += (np.abs(refitted - decayed) ** 2).sum(axis=0)
        total += (np.abs(decayed) ** 2).sum(axis=0)
    return change > _CHANGED**2 * total


def _within_blow(segments: Sequence[Segment], ringing: Exponentials) -> Mask:
    """Return which modes (M,) later samples contradict, and which die within the blow.

    Modes that outlast the longest blow are not tried. A mode is contradicted at a moment if its
    gain changes by half where all gains are fitted again, and either it should stand clear of the
    noise there or less than half of it is left in its band, by more than noise takes away by
    chance. The blow lasts twice the time after which at most a tenth of the modes are contradicted
    for the first time, the shortest push at least; modes below the noise by then died within it.
    """
    tried = ringing.decays > _LASTING
    slow, fast = ringing.of(~tried), ringing.of(tried)
    blow = np.zeros(ringing.count, bool)
    if not fast.count:
        return blow
    least = significance(len(ringing.gains))
    floor = met(segments, ringing)[1][:, tried]
    steps = np.log(_LONGEST_PUSH / _SHORTEST_PUSH) / np.log(_LATER)
    times = _SHORTEST_PUSH * _LATER ** np.arange(int(steps) + 1)
    first, energies = np.full(fast.count, np.inf), np.zeros((len(times), fast.count))
    for number, time in enumerate(times):
        expected, alone, change, missing, energies[number] = _compared(
            segments, slow, fast, floor, time
        )
        limit = _CHANGED**2 * expected
        gone = (alone < limit) & (missing > least)
        wrong = (change > limit) & (gone | (energies[number] > _CLEAR * least))
        first[wrong] = np.minimum(first[wrong], time)
    contradicted = np.isfinite(first)
    over = 2 * float(np.quantile(np.where(contradicted, first, times[0] / 2), 1 - _STRAY))
    last = min(int(np.searchsorted(times, 0.999 * over)), len(times) - 1)
    blow[tried] = contradicted | (energies[last] <= least)
    return blow


def _compared(
    segments: Sequence[Segment], slow: Exponentials, fast: Exponentials, floor: Array, time: float
) -> Array:
    """Return sums over rows, weighted by the noise `floor` (C, M), from a `time`, s, on (5, M).

    They are squares of the expected gains of the `fast` modes, of those of each fitted alone, and
    of the changes where all are fitted together; then energies over noise of what each alone lacks,
    and of what is expected. The sound of the `slow` modes is subtracted first.
    """
    sums = np.zeros((5, fast.count))
    for segment in segments:
        rate, begin = segment.sample_rate, round(time * segment.sample_rate)
        heard = segment.samples[:, begin : begin + round(_WINDOW * rate)]
        length = heard.shape[1]
        if not length:
            continue
        lasting = slow.gains[segment.rows] * np.exp(slow.poles * begin / rate)
        left = heard - samples(slow.poles, lasting, length, rate)
        expected = fast.gains[segment.rows] * np.exp(fast.poles * begin / rate)
        products = correlations(fast.poles, left, rate)
        change = np.abs(best_gains(fast.poles, left, rate, products) - expected)
        losses = -2 * fast.decays / rate
        powers = np.expm1(losses * length) / np.expm1(losses)
        alone, sizes = 2 * np.abs(products) / powers, np.abs(expected)
        squares = np.square([sizes, alone, change, np.maximum(sizes - alone, 0.0), sizes])
        squares[3:] *= powers / 4
        sums += (squares / np.maximum(floor[segment.rows], 1e-300)).sum(axis=1)
    return sums


def vague(
    segments: Sequence[Segment], frequencies: Array, decays: Array, errors: tuple[Array, Array]
) -> Mask:
    """Return which modes (M,) are known to 30 % at best.

    `errors` are those of their frequencies, Hz, and decay rates, 1/s. A decay is known as well as
    its half-power bandwidth d / pi, which no take shows finer than 1 Hz over its length in s.
    """
    finest = np.pi / max(segment.duration for segment in segments)
    unsure = errors[1] >= _UNKNOWN * np.maximum(decays, finest)
    return unsure | (errors[0] >= _UNKNOWN * frequencies)


def constant(take: Take) -> bool:
    """Return whether a take is as loud all the time, by blocks of whole periods of 50 and 60 Hz."""
    size = round(_LATE * take.sample_rate)
    count = take.samples.shape[1] // size
    if count < 5:
        return False
    blocks = (take.samples[:, : count * size].reshape(-1, count, size) ** 2).sum(axis=(0, 2))
    return _decibels(float(blocks.max()), float(blocks.min())) < _STILL


def unexplained(take: Take, hits: Sequence[Hit]) -> float:
    """Return the energy of a take before its first hit, unless that is the quiet of a lead-in."""
    if not hits or lead_in(take, hits).shape[1]:
        return 0.0
    return float((take.samples[:, : hits[0].onset] ** 2).sum())


def of_other_objects(rows: Sequence[Row], heard: Exponentials) -> Iterator[str]:
    """Yield the takes that share hardly any of their energy's modes with the first ones."""
    takes = np.array([row.take for row in rows])
    energies = np.abs(heard.gains) ** 2 / np.maximum(heard.decays, _SLOWEST)
    own = np.array([energies[takes == take].sum(axis=0) for take in np.unique(takes)])
    own /= np.maximum(own.sum(axis=1, keepdims=True), 1e-300)
    shared = np.array([np.minimum(one, own).sum(axis=1) for one in own])
    _, group = connected_components(shared > _SHARED)
    others = np.flatnonzero(group != group[0])
    if others.size:
        numbers = ", ".join(str(each + 1) for each in np.unique(takes)[others][:_FEW])
        most = 100 * shared[np.ix_(group == group[0], others)].max()
        yield (
            f"at most {most:.1f} % of the sound is common to take 1 and take {numbers}: they may "
            "be of two objects; fit each by itself"
        )


# Further hits of a take. A splice, a gust of noise or the end of a note rises in many bands, too. A
# hit brings energy of its own; one that brings little has to prove itself: with gains of its own
# the fit must leave less than these cost (Schwarz 1978).

_NEAR = 0.02  # s before and after a hit
_ADDED = 2.0  # least power ratio of a hit that needs no proof


def doubtful(take: Take, hits: Sequence[Hit]) -> list[Hit]:
    """Return the hits after the first that do not double the power."""
    size = round(_NEAR * take.sample_rate)
    energy = (take.samples**2).sum(axis=0)
    return [
        hit
        for hit in hits[1:]
        if energy[hit.start : hit.start + size].sum()
        < _ADDED * energy[max(hit.onset - size, 0) : hit.onset].sum()
    ]


def proven(with_it: Sequence[Array], without: Sequence[Array], modes: int) -> bool:
    """Return whether residuals (C, n) with a hit are less than without by more than its gains cost.

    By the Bayesian information criterion, of two real gains for each mode and channel, and as many
    values as a residual of its bandwidth has that are independent.
    """
    before, after = (sum(float((each**2).sum()) for each in left) for left in (without, with_it))
    values = sum(map(_independent, without))
    cost = 2 * modes * len(with_it) * np.log(max(values, 2.0))
    return values * np.log(max(before, 1e-300) / max(after, 1e-300)) > cost


def _independent(left: Array) -> float:
    """Return the number of independent values: twice the bandwidth times the duration."""
    powers = (np.abs(np.fft.rfft(left)) ** 2).sum(axis=0)
    # Of white noise the squares of powers have twice the squared mean.
    return float(left.size * 2 * powers.mean() ** 2 / max((powers**2).mean(), 1e-300))

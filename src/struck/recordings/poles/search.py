"""Search for all modes that takes share: several passes, each on the residual of the last one."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from struck.core.machine import in_few_threads
from struck.errors import OptionError, counted, require_choice, rounded
from struck.model.arrays import AnyComplex, Array, Index, Mask, brief, checked
from struck.model.exponentials import Exponentials, samples
from struck.model.provenance import Progress, silent
from struck.recordings.corbett2007 import by_corbett2007
from struck.recordings.disturbances import of_hum, without_hum
from struck.recordings.gain_control import UNKNOWN, GainControl, gain_control
from struck.recordings.onsets import Hit, find_hits, findings, hit_at
from struck.recordings.poles.candidates import Candidates, Resolution, broad, candidates, matched
from struck.recordings.poles.refinement import overlap, refine, with_best_gains
from struck.recordings.poles.selection import (
    LASTING,
    LOWEST,
    ambient,
    crowd,
    energies,
    hidden,
    prune,
    raised,
    split,
    standing_out,
    strongest_per_band,
    weed,
)
from struck.recordings.poles.uncertainty import between_takes, significance, standard_errors
from struck.recordings.poles.verdict import (
    CROWDED,
    MODAL_MARGIN,
    ModalVerdict,
    constant,
    crowding,
    doubtful,
    explained,
    hopeless,
    judge,
    left_over,
    of_blow,
    of_other_objects,
    proven,
    unexplained,
    vague,
)
from struck.recordings.segments import SHORTEST, Row, Segment, cut, joined
from struck.recordings.takes import Take, left_out, require_one_rate, without_force

_CLEAR = 40.0  # least energy of a measured mode over that of the noise in a bin
_NAMED = 16  # tones
CLEAR = 10 * np.log10(2 * _CLEAR)  # the same over the noise's energy in a sample, dB


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fitted:
    """Modes fitted to recordings.

    Parameters
    ----------
    frequencies : array (M,)
        Ringing frequencies, ascending, Hz.
    decays : array (M,)
        Amplitude decay rates, 1/s.
    gains : array (rows, M), complex
        A row sounds as Im[g exp((-d + 2 pi i f) t)] from its time on, in the unit of the samples,
        without what still rings of earlier hits.
    frequency_errors, decay_errors : array (M,)
        Standard errors, Hz and 1/s.
    gain_errors : array (rows, M)
        Standard errors of the gains' sizes.
    rows : tuple of Row
        What each row of gains belongs to, in order of takes, hits and channels.
    segments : tuple of Segment
        What was fitted.
    heard : Exponentials
        All that rings in the segments: earlier hits and tones of the surroundings too.
    order : array (rows,)
        Which row of `heard` each row is.
    verdict : ModalVerdict
        Whether it is the sound of a struck object.
    blow, vague : array (M,), bool
        Which modes stand for the blow instead of the object, and which are known to 30 % at best.
    notes : tuple of str
        What a person should know: what is wrong with the takes, and what was left out.
    controls : tuple of GainControl or None
        Automatic gain of each take, which was undone.
    """

    __repr__ = brief
    frequencies: Array
    decays: Array
    gains: AnyComplex
    frequency_errors: Array
    decay_errors: Array
    gain_errors: Array
    rows: tuple[Row, ...]
    segments: tuple[Segment, ...]
    heard: Exponentials
    order: Index
    verdict: ModalVerdict
    blow: Mask
    vague: Mask
    notes: tuple[str, ...] = ()
    controls: tuple[GainControl | None, ...] = ()

    def of(self, modes: Index | Mask) -> Fitted:
        """Return the modes of these numbers (M,), in this order, or where a mask (M,) is true."""
        names = ("frequencies", "decays", "frequency_errors", "decay_errors", "blow", "vague")
        return replace(
            self,
            **{name: getattr(self, name)[modes] for name in names},
            gains=self.gains[:, modes],
            gain_errors=self.gain_errors[:, modes],
        )

    def heard_in(self, row: int) -> tuple[Array, Array]:
        """Return samples (n,) of one row from its time on: as recorded, and as fitted."""
        segment, channel = self._segment(row)
        original = segment.samples[channel]
        return original, self.ringing(row, self.rows[row].time, len(original))

    def ringing(self, row: int, time: float, length: int) -> Array:
        """Return `length` fitted samples of a row (n,) from a time, s, on; before its onset too."""
        segment, _ = self._segment(row)
        poles, gains = self.heard.poles, self.heard.gains[self.order[row]]
        shifted = gains * np.exp(poles * (time - self.rows[row].time))
        return samples(poles, shifted[None], length, segment.sample_rate)[0]

    def noise_in(self, row: int, edges: Array) -> Array:
        """Return the power of the noise of one row in bands (B,) between edges (B + 1,), Hz."""
        segment, channel = self._segment(row)
        middles = np.sqrt(edges[1:] * edges[:-1])
        return segment.noise.at(middles)[channel] * 2 * np.diff(edges) / segment.sample_rate

    def _segment(self, row: int) -> tuple[Segment, int]:
        place = int(self.order[row])
        segment = next(each for each in self.segments if place < each.rows.stop)
        return segment, place - segment.rows.start


def fitted_of(
    segments: list[Segment],
    rows: list[Row],
    heard: Exponentials,
    verdict: ModalVerdict,
    notes: list[str],
    *,
    hum: Array,
    measured: bool = False,
) -> Fitted:
    """Return a fit with its errors, without tones of the surroundings and earlier hits.

    Where modes are to be `measured`, weak ones are left out, too.
    """
    surrounding = ambient(segments, heard) | of_hum(hum, heard)
    errors = standard_errors(segments, heard)
    weak = _weak(segments, heard) & ~surrounding if measured else np.zeros_like(surrounding)
    lines = np.unique(np.concatenate((heard.frequencies[surrounding], hum[:, 0])).round(1))
    if lines.size:
        tones = ", ".join(f"{each:.1f}" for each in lines[:_NAMED])
        notes = [*notes, f"tones of the surroundings, left out of the model: {tones} Hz"]
    if weak.any():
        lost = ", ".join(f"{each:.1f}" for each in heard.frequencies[weak])
        notes = [*notes, f"too weak to be measured, left out of the model: {lost} Hz"]
    blow = of_blow(segments, heard, released=measured)
    # What was to be measured is the object alone.
    kept = ~(surrounding | weak | (blow & measured))
    endless = np.count_nonzero((errors.decays > heard.decays) & kept & ~blow)
    if endless:
        count = counted(endless, "mode")
        notes = [*notes, f"{count} ringing for longer than the takes can tell: record longer"]
    own = heard.of(kept)
    apart = between_takes(segments, np.array([row.take for row in rows]), heard)
    notes = [*notes, *_differing(apart[0][kept & ~blow & (apart[0] > errors.frequencies)])]
    notes = [*notes, *of_other_objects(rows, own)]
    order = np.array(sorted(range(len(rows)), key=lambda row: (rows[row].take, rows[row].hit, row)))
    ordered = [rows[row] for row in order]
    known = (
        np.hypot(errors.frequencies, apart[0])[kept],
        np.hypot(errors.decays, apart[1])[kept],
    )
    return Fitted(
        frequencies=own.frequencies,
        decays=own.decays,
        gains=_without_earlier(own.gains[order], own.poles, ordered),
        frequency_errors=known[0],
        decay_errors=known[1],
        gain_errors=errors.gains[order][:, kept],
        rows=tuple(ordered),
        segments=tuple(segments),
        heard=heard,
        order=order,
        verdict=verdict,
        blow=blow[kept],
        vague=vague(segments, own.frequencies, own.decays, known),
        notes=tuple(notes),
    )


def _differing(apart: Array) -> Iterator[str]:
    """Yield that frequencies of modes differ from take to take, by so much (K,), Hz."""
    if apart.size:
        yield (
            f"the frequency of {counted(len(apart), 'mode')} differs from take to take by "
            f"{rounded(np.median(apart), 2)} Hz in the median, more than noise explains: errors "
            "hold that; was the object held or supported alike?"
        )


def _weak(segments: list[Segment], heard: Exponentials) -> Mask:
    """Return which modes are too weak to be measured.

    At an energy E over noise a decay rate is known to sqrt(2 / E) of itself at best: 22 %. Whether
    it is one mode or two nobody can tell.
    """
    alone, share = energies(segments, heard)
    return alone < _CLEAR * share


def _without_earlier(gains: AnyComplex, poles: AnyComplex, rows: list[Row]) -> AnyComplex:
    """Subtract from each hit's gains the ringing that is left of the hit before."""
    own = gains.copy()
    last: dict[tuple[int, int], int] = {}
    for row, what in enumerate(rows):
        earlier = last.get((what.take, what.channel))
        if earlier is not None:
            own[row] -= gains[earlier] * np.exp(poles * (what.time - rows[earlier].time))
        last[what.take, what.channel] = row
    return own


_SAME_PEAK = 1e-3  # of the peak
_NUMBER = re.compile(r"-?\d+(\.\d+)?")


def notes_on(takes: Sequence[Take], hits: Sequence[Sequence[Hit]]) -> Iterator[str]:
    """Yield findings on takes; of alike ones the first, and how many more takes share it.

    Files are named without their folders, which are nobody's business.
    """
    alike: dict[str, list[str]] = {}
    for take, own in zip(takes, hits, strict=True):
        for note in findings(take, own):
            kind = _NUMBER.sub("#", note.replace(take.name, ""))
            alike.setdefault(kind, []).append(note.replace(take.name, Path(take.name).name))
    yield from _normalised(takes, hits)
    for notes in alike.values():
        more = len(notes) - 1
        yield f"{notes[0]}; so {counted(more, 'more take')}" if more else notes[0]


def _normalised(takes: Sequence[Take], hits: Sequence[Sequence[Hit]]) -> Iterator[str]:
    """Yield that hits have one and the same peak, as no person strikes."""
    parts = [
        part
        for take, own in zip(takes, hits, strict=True)
        for part in np.split(take.samples, [hit.onset for hit in own[1:]], axis=1)
    ]
    peaks = np.array([np.abs(part).max(initial=0.0) for part in parts])
    if len(peaks) > 2 and np.ptp(peaks) < _SAME_PEAK * peaks.max():
        yield (
            f"all {len(peaks)} hits have the peak {20 * np.log10(peaks.max()):.1f} dB: they were "
            "normalised one by one, and how loud each contact is cannot be told; use them as they "
            "were recorded"
        )


def _unlike(takes: Sequence[Take], verdict: ModalVerdict) -> Iterator[str]:
    """Yield which takes the modes of all do not explain, although they do as a whole."""
    for take, ratio in zip(takes, verdict.takes, strict=True):
        if verdict.modal and ratio < MODAL_MARGIN:
            yield (
                f"{Path(take.name).name} is explained to {ratio:.1f} dB only: is it of another "
                "object, or was it held otherwise? Leave it out, or fit it alone"
            )


Kept = Callable[[str, Callable[[], Exponentials]], Exponentials]
Look = Callable[[Sequence[Array]], Candidates]

# Window, s; fastest decay, 1/s; frames; poles of a bin. The first twice: the second look finds
# what stood under the strongest modes, before shorter windows could take it for something else.
_WINDOWS = (
    (0.186, 15.0, 300, 20),
    (0.186, 15.0, 300, 20),
    (0.046, 100.0, 250, 8),
    (0.012, 900.0, 150, 8),
)
_ROUNDS = 4
_BINS = 12  # that are searched in an auditory band under a budget
_LIKELY = 1e-6  # chance that noise makes a candidate
_SPARE = 1.6  # of the budget until modes are refined
_STEP = 0.85  # of the modes stay in a round of pruning
_FAINT, _SURROUNDINGS = 10 ** (-35 / 20), 40.0  # of the amplitude within so many Hz
_BEATING = 15.0  # 1/s
_FADED = 2.0  # nepers that a crowd fades by until what it hid is looked for
_SOON, _SHORT = 0.02, 0.08  # s at least, and share of the takes at most, that this lasts
_ALIKE = 0.5  # least squared correlation of one mode that is found twice


def computed(_name: str, compute: Callable[[], Exponentials]) -> Exponentials:
    """Return the result of a stage without keeping it."""
    return compute()


def search(
    segments: Sequence[Segment],
    *,
    budget: int | None = None,
    progress: Progress = silent,
    kept: Kept = computed,
) -> Exponentials:
    """Find the modes of all segments together, by frequency.

    With a budget, those that explain most; else all that stand out from noise and from what the
    model cannot explain. `kept` is given the name of a stage and its computation, and returns its
    result.
    """
    ringing = Exponentials.silence(sum(len(segment.samples) for segment in segments))
    looks = list(_looks(segments, budget))
    for number, look in enumerate(looks):
        progress("looking for modes", number / len(looks))
        before = ringing
        ringing = kept(f"look {number}", partial(_looked, segments, before, look, budget))
        if not budget and crowding(segments, before, ringing):
            ringing = before
            break
        if number > len(_WINDOWS) and np.array_equal(before.poles, ringing.poles):
            break
        if (not budget or number + 1 == len(_WINDOWS)) and hopeless(segments, ringing, budget):
            return _proven(segments, _within(segments, ringing, budget), budget)
    progress("refining the modes", 0.0)
    ringing = kept("pairs", lambda: _paired(segments, refine(segments, ringing, sweeps=2), budget))
    progress("refining the modes", 0.4)
    few = partial(_within, segments, ringing, budget)
    ringing = kept("budget", lambda: refine(segments, few(), sweeps=4, steps=4))
    progress("refining the modes", 0.8)
    ringing = _proven(segments, ringing, budget)
    return _once_more(segments, ringing, looks[-1], budget) if budget else ringing


def _once_more(
    segments: Sequence[Segment], ringing: Exponentials, look: Look, budget: int
) -> Exponentials:
    """Search for modes once more in the residual, which may replace modes that were dropped."""
    more = _within(segments, _looked(segments, ringing, look, budget), budget)
    again = _proven(segments, refine(segments, more, sweeps=4, steps=4), budget)
    return min(ringing, again, key=partial(left_over, segments))


def _looked(
    segments: Sequence[Segment], ringing: Exponentials, look: Look, budget: int | None
) -> Exponentials:
    """Search the residual for modes once, and fit them together with the known ones."""
    left = [segment.residual(ringing) for segment in segments]
    if not budget:
        more = standing_out(segments, ringing, look(left))
        return _settled(segments, more, None) if more.count > ringing.count else ringing
    spare = round(_SPARE * budget)
    found = strongest_per_band(segments, look(left), spare)
    return _settled(segments, ringing.joined(found.poles), spare) if found.poles.size else ringing


def _proven(segments: Sequence[Segment], ringing: Exponentials, budget: int | None) -> Exponentials:
    """Keep the modes that stand out, with the best gains of all at once.

    Where many are a crowd, they go and the others stay as they are: refitted to it they would move.
    """
    if not budget and 3 * np.count_nonzero(false := crowd(segments, ringing)) > ringing.count:
        return _outlasting(segments, ringing, false)
    noisy = segments if budget else _noisier(segments, ringing)
    proven = weed(noisy, prune(noisy, ringing))
    if proven.count < ringing.count:
        proven = weed(noisy, refine(segments, proven, sweeps=2, steps=4))
    proven = with_best_gains(segments, proven.of(proven.frequencies > LOWEST)).by_frequency()
    if not budget and (false := crowd(segments, proven)).any():
        return with_best_gains(segments, proven.of(~false))
    return proven


def _outlasting(segments: Sequence[Segment], ringing: Exponentials, false: Mask) -> Exponentials:
    """Drop a crowd of modes, and search again from when it has faded, where it soon does.

    The poles found there take the place of like ones, and what skirts of louder modes hide goes.
    """
    decay = float(np.median(ringing.decays[false]))
    own = ringing.of(~false & (ringing.frequencies > LOWEST))
    soon = _SOON < (wait := _FADED / decay) < _SHORT * min(each.duration for each in segments)
    if not soon or ringing.count > CROWDED or explained(segments, ringing) < MODAL_MARGIN:
        return with_best_gains(segments, own).by_frequency()
    late = search([each.later(wait) for each in segments])
    other = overlap(own.poles[:, None], late.poles, np.inf).max(axis=1, initial=0.0) < _ALIKE
    own = with_best_gains(segments, late.joined(own.poles[other]))
    answers = hidden(own, own.decays < LASTING * decay, 1.0) & raised(segments, own)
    return with_best_gains(segments, own.of(~answers)).by_frequency()


def _looks(segments: Sequence[Segment], budget: int | None) -> Iterator[Look]:
    """Yield the search passes, one after the other."""
    longest = max(segment.samples.shape[1] for segment in segments)
    # A budget ignores faint modes: noise is raised to a level far below each band's sound.
    loud = [each.noisier(_FAINT * each.samples, _SURROUNDINGS) for each in segments if budget]
    loud = loud or segments
    for window, fastest, frames, orders in _WINDOWS:
        size = 2 ** round(np.log2(min(window * segments[0].sample_rate, longest / 4)))
        resolution = Resolution(window=size, fastest=fastest, frames=frames, orders=orders)
        yield partial(candidates, loud, resolution=resolution, per_band=_BINS if budget else None)
    yield partial(broad, loud)
    channels = sum(len(segment.samples) for segment in segments)
    for _ in range(1 if budget else _ROUNDS):
        yield partial(matched, loud, least=significance(channels, _LIKELY))


def _settled(segments: Sequence[Segment], ringing: Exponentials, most: int | None) -> Exponentials:
    """Fit old and new modes together and drop modes that explain no energy."""
    ringing = refine(segments, ringing, sweeps=1, steps=0)
    if most is not None:
        ringing = prune(segments, ringing, budget=most)
    ringing = refine(segments, ringing, sweeps=2)
    ringing = prune(_noisier(segments, ringing), ringing, budget=most)
    return refine(segments, ringing, sweeps=1)


def _paired(segments: Sequence[Segment], ringing: Exponentials, budget: int | None) -> Exponentials:
    """Split modes into close pairs, twice; under a budget once, and into slowly beating pairs."""
    for _ in range(1 if budget else 2):
        more = split(segments, ringing, fastest=_BEATING if budget else np.inf)
        if more.count == ringing.count:
            break
        more = refine(segments, refine(segments, more, sweeps=1, steps=0), sweeps=2)
        ringing = prune(segments, more)
    return ringing


def _within(segments: Sequence[Segment], ringing: Exponentials, budget: int | None) -> Exponentials:
    """Drop the weakest modes a few at a time down to a budget, refitting the others each time."""
    while budget and ringing.count > budget:
        fewer = max(budget, int(_STEP * ringing.count))
        ringing = refine(segments, prune(segments, ringing, budget=fewer), sweeps=2)
    return ringing


def _noisier(segments: Sequence[Segment], ringing: Exponentials) -> list[Segment]:
    """Raise the noise to the residual where that is more."""
    return [each.noisier(each.residual(ringing)) for each in segments]


METHODS = ("shared", "corbett2007")


@in_few_threads
@checked
def fit_poles(
    takes: Take | Sequence[Take],
    *,
    method: str = "shared",
    budget: int | None = 64,
    onsets: Sequence[Sequence[float]] | None = None,
    attack: bool | None = None,
    progress: Progress = silent,
    kept: Kept = computed,
) -> Fitted:
    """Fit one set of modes to all channels and hits of all takes.

    Parameters
    ----------
    takes : Take or sequence of Take
        Of the same object, at one sample rate.
    method : str
        "shared": all poles of all channels and hits in one fit; "corbett2007": the paper's own, a
        fit of each and a merge.
    budget : int or None
        Not more modes than these, those that explain most; None for all that are clear of noise.
    onsets : sequence of sequences of float, optional
        Times of the hits in each take, s; found unless given.
    attack : bool, optional
        Whether the modes stand for the whole sound, from the blow itself on, or only for what rings
        freely after it. The whole under a budget, unless given.
    progress : Progress
        Told the stage and the fraction done.
    kept : callable
        Given a name and what computes a stage of the work, returns its result: where one is kept,
        a fit that was stopped goes on from there.

    Returns
    -------
    Fitted
        Where the sound is not that of a struck object, its verdict says so.

    Raises
    ------
    RecordingError
        When takes differ in sample rate, or one of them holds no hit.
    OptionError
        When there is no take, the budget is below 1, onsets are none of the takes', or the method
        is unknown.
    """
    require_choice("method", method, METHODS)
    takes = [takes] if isinstance(takes, Take) else list(takes)
    if not takes or (budget is not None and budget < 1):
        raise OptionError(f"{len(takes)} takes, budget {budget}: give at least 1 of each")
    require_one_rate(takes)
    calm, tones = zip(*(without_hum(without_force(take)) for take in takes), strict=True)
    microphones, hits, controls = _undone(calm, onsets)
    hum = np.concatenate(tones)
    doubts = [
        doubtful(*each) if onsets is None else [] for each in zip(microphones, hits, strict=True)
    ]
    whole = budget is not None if attack is None else attack

    def fit(hits: Sequence[Sequence[Hit]], stage: str = "") -> Fitted:
        segments, rows = joined(cut(microphones, hits, attack=whole))

        def each(name: str, compute: Callable[[], Exponentials]) -> Exponentials:
            return kept(f"{name}{stage}", compute)

        if method == "shared":
            ringing = search(segments, budget=budget, progress=progress, kept=each)
        else:
            ringing = each(method, lambda: by_corbett2007(segments, budget))
        outside = [] if onsets is not None else list(map(unexplained, microphones, hits))
        steady = onsets is None and all(map(constant, microphones))
        verdict = judge(segments, rows, ringing, outside, steady=steady)
        notes = [*notes_on(takes, hits), *_unlike(takes, verdict)]
        measured = method == "shared" and budget is None
        return fitted_of(segments, rows, ringing, verdict, notes, hum=hum, measured=measured)

    fitted = _by_evidence(fit, hits, doubts) if any(doubts) else fit(hits)
    fitted = _controlled(fitted, controls, takes)
    fitted = replace(fitted, rows=_numbered(fitted.rows, takes))
    if method == "shared":
        return fitted
    # The method of 2007 does not minimise the residual that errors come from.
    unknown = np.full(len(fitted.frequencies), np.nan)
    return replace(fitted, frequency_errors=unknown, decay_errors=unknown)


def _undone(
    takes: Sequence[Take], onsets: Sequence[Sequence[float]] | None
) -> tuple[list[Take], list[list[Hit]], list[GainControl | None]]:
    """Return takes without automatic gain, their hits, and the gains that were undone."""
    takes, hits = list(takes), _hits(takes, onsets)
    controls = [gain_control(*each) for each in zip(takes, hits, strict=True)]
    for place, control in enumerate(controls):
        if control is not None:
            takes[place] = control.undone(takes[place])
            found = _hits(takes[place : place + 1], onsets and onsets[place : place + 1])
            hits[place] = control.settled(found[0], takes[place].sample_rate)
    return takes, hits, controls


def _controlled(
    fitted: Fitted, controls: Sequence[GainControl | None], takes: Sequence[Take]
) -> Fitted:
    """Add the gains' uncertainty to the errors of decays; refuse takes with too much of it."""
    fitted = replace(fitted, controls=tuple(controls))
    of_gain = [each.decay_errors(fitted.decays) for each in controls if each is not None]
    if not of_gain:
        return fitted
    notes = [
        f"the gain of {take.name} was controlled automatically, by {control.depth:.0f} dB: it is "
        "undone by what the noise tells of it, and decays are less certain; turn it off"
        for take, control in zip(takes, controls, strict=True)
        if control is not None
    ]
    own, unknown = ~fitted.blow, np.max(of_gain, axis=0)
    share = float(np.median((unknown / fitted.decays)[own])) if own.any() else 0.0
    verdict = fitted.verdict
    if share > UNKNOWN:
        reason = (
            "its gain was controlled automatically, and the noise tells decays to "
            f"{100 * share:.0f} % only, of {100 * UNKNOWN:g} % that are needed: turn it off"
        )
        verdict = replace(verdict, modal=False, reason=reason)
    errors = fitted.frequency_errors, np.hypot(fitted.decay_errors, unknown)
    return replace(
        fitted,
        decay_errors=errors[1],
        vague=vague(fitted.segments, fitted.frequencies, fitted.decays, errors),
        notes=(*fitted.notes, *notes),
        verdict=verdict,
    )


def _by_evidence(
    fit: Callable[[Sequence[Sequence[Hit]], str], Fitted],
    hits: list[list[Hit]],
    doubts: list[list[Hit]],
) -> Fitted:
    """Fit with the sure hits and with each doubtful hit that explains more than its gains cost."""
    every = fit(hits, "")
    if not every.verdict.modal:  # with fewer hits it explains no more
        return every
    sure = [
        _ended([hit for hit in own if hit not in unsure], own[-1].end)
        for own, unsure in zip(hits, doubts, strict=True)
    ]
    without = fit(sure, ", sure hits")
    kept = [
        [hit for hit in own if hit not in unsure or _is_proven(every, without, number, hit)]
        for number, (own, unsure) in enumerate(zip(hits, doubts, strict=True))
    ]
    if kept == hits:
        return every
    kept = [_ended(own, every[-1].end) for own, every in zip(kept, hits, strict=True)]
    return without if kept == sure else fit(kept, ", proven hits")


def _ended(hits: list[Hit], end: int) -> list[Hit]:
    """Return hits that last until the next of them, the last one until sample `end`."""
    ends = [*(hit.onset for hit in hits[1:]), end]
    return [replace(hit, end=end) for hit, end in zip(hits, ends, strict=True)]


def _is_proven(every: Fitted, without: Fitted, take: int, hit: Hit) -> bool:
    """Return whether a doubtful hit of a take explains energy that the sure hits leave."""
    rate = every.segments[0].sample_rate
    left, other = [], []
    for row, what in enumerate(every.rows):
        if what.take != take or not hit.onset <= what.time * rate <= hit.end:
            continue
        sound, model = every.heard_in(row)
        before = [
            number
            for number, each in enumerate(without.rows)
            if (each.take, each.channel) == (take, what.channel) and each.time <= what.time
        ]
        if before:
            left.append(sound - model)
            other.append(sound - without.ringing(before[-1], what.time, len(sound)))
    return bool(left) and proven(left, other, len(every.heard.poles))


def _numbered(rows: Sequence[Row], takes: Sequence[Take]) -> tuple[Row, ...]:
    """Count the rows' channels as in the takes, where force sensors count, too."""
    channels = [np.flatnonzero(~left_out(take)) for take in takes]
    return tuple(replace(row, channel=int(channels[row.take][row.channel])) for row in rows)


def _hits(takes: Sequence[Take], onsets: Sequence[Sequence[float]] | None) -> list[list[Hit]]:
    if onsets is None:
        return list(map(_found, takes))
    if np.ndim(onsets) == 0 or any(np.ndim(own) == 0 for own in onsets):
        raise OptionError(f"onsets are {onsets!r}: give a sequence of times for each take, s")
    if len(onsets) != len(takes):
        raise OptionError(f"onsets of {len(onsets)} takes, and {len(takes)} takes: give one each")
    return [list(_given(take, sorted(own))) for take, own in zip(takes, onsets, strict=True)]


def _found(take: Take) -> list[Hit]:
    """Return the hits of a take, without a faint one that its end leaves no time to ring.

    The hit before ends where that one began: a coder or a cut may have made it.
    """
    hits = find_hits(take)
    late = [hit for hit in doubtful(take, hits)[-1:] if hit is hits[-1]]
    if late and hits[-1].end - hits[-1].start < SHORTEST * take.sample_rate:
        return hits[:-1]
    return hits


def _given(take: Take, times: list[float]) -> Iterator[Hit]:
    wrong = [time for time in times if not 0 <= time < take.duration]
    if wrong:
        raise OptionError(
            f"onset {wrong[0]} s lies outside {take.name}, 0 to {take.duration:.3f} s"
        )
    samples = [round(time * take.sample_rate) for time in times]
    if len(set(samples)) < len(samples):
        raise OptionError(f"onsets {times} of {take.name} name one moment twice: name each once")
    for first, last in zip(samples, [*samples, take.samples.shape[1]][1:], strict=True):
        yield hit_at(take, first, last)

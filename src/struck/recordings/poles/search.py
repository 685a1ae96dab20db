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
from struck.recordings.disturbances import find_hum, without_hum
from struck.recordings.gain_control import MAX_DECAY_ERROR, GainControl, gain_control
from struck.recordings.onsets import Hit, find_hits, findings, hit_at
from struck.recordings.poles.candidates import (
    Candidates,
    Resolution,
    find_broad,
    find_candidates,
    match_filters,
)
from struck.recordings.poles.refinement import overlap, refine, with_best_gains
from struck.recordings.poles.selection import (
    MIN_FREQUENCY,
    SLOW_DECAY_RATIO,
    add_significant,
    drop_redundant,
    energies,
    find_ambient,
    find_masked,
    find_spurious,
    find_unexplained_bands,
    prune,
    split_pairs,
    strongest_per_band,
)
from struck.recordings.poles.uncertainty import between_takes, significance, standard_errors
from struck.recordings.poles.verdict import (
    MANY_MODES,
    MODAL_MARGIN,
    ModalVerdict,
    energy_before_hits,
    find_blow_modes,
    find_doubtful,
    find_vague,
    is_constant,
    is_diverging,
    is_hopeless,
    is_proven,
    judge,
    notes_on_other_objects,
    residual_energy,
    signal_to_misfit,
)
from struck.recordings.segments import MIN_DURATION, Row, Segment, cut_takes, join_stretches
from struck.recordings.takes import Take, left_out, require_one_rate, without_force

_MIN_ENERGY = 40.0  # least energy of a measured mode over that of the noise in a bin
_MAX_TONES = 16  # tones
CLEAR = 10 * np.log10(2 * _MIN_ENERGY)  # the same over the noise's energy in a sample, dB


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoleFit:
    """Modes fitted to recordings.

    Parameters
    ----------
    frequencies : array (M,)
        Ringing frequencies, ascending, Hz.
    decays : array (M,)
        Amplitude decay rates, 1/s.
    gains : array (rows, M), complex
        A row is Im[g exp((-d + 2 pi i f) t)] from its time on, in the unit of the samples, without
        the decay of earlier hits.
    frequency_errors : array (M,)
        Standard errors of the frequencies, Hz.
    decay_errors : array (M,)
        Standard errors of the decay rates, 1/s.
    gain_errors : array (rows, M)
        Standard errors of the magnitudes of the gains.
    rows : tuple of Row
        Take, hit and channel of each row of gains, in this order.
    segments : tuple of Segment
        Segments that were fitted.
    exponentials : Exponentials
        All modes in the segments, including earlier hits and tones of the surroundings.
    order : array (rows,) of int
        Row of `exponentials` of each row.
    verdict : ModalVerdict
        Whether it is the sound of a struck object.
    blow : array (M,) of bool
        Modes that represent the strike instead of the object.
    vague : array (M,) of bool
        Modes that are known to 30 % at best.
    notes : tuple of str, default ()
        Remarks on the takes, and on modes that were left out.
    controls : tuple of GainControl or None, default ()
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
    exponentials: Exponentials
    order: Index
    verdict: ModalVerdict
    blow: Mask
    vague: Mask
    notes: tuple[str, ...] = ()
    controls: tuple[GainControl | None, ...] = ()

    def of(self, modes: Index | Mask) -> PoleFit:
        """Select modes.

        Parameters
        ----------
        modes : array (K,) of int, or (M,) of bool
            Numbers of the modes, in the requested order, or a mask.

        Returns
        -------
        PoleFit
            The selected modes.
        """
        names = ("frequencies", "decays", "frequency_errors", "decay_errors", "blow", "vague")
        return replace(
            self,
            **{name: getattr(self, name)[modes] for name in names},
            gains=self.gains[:, modes],
            gain_errors=self.gain_errors[:, modes],
        )

    def samples_and_model(self, row: int) -> tuple[Array, Array]:
        """Return the recorded and the fitted samples of a row.

        Parameters
        ----------
        row : int
            Number of the row of `gains`.

        Returns
        -------
        tuple of array (n,), array (n,)
            Samples from the time of the row on, as recorded and as fitted.
        """
        segment, channel = self._segment(row)
        original = segment.samples[channel]
        return original, self.ringing(row, self.rows[row].time, len(original))

    def ringing(self, row: int, time: float, length: int) -> Array:
        """Compute fitted samples of a row, also before its onset.

        Parameters
        ----------
        row : int
            Number of the row of `gains`.
        time : float
            Time of the first sample, s.
        length : int
            Number of samples.

        Returns
        -------
        array (n,)
            Samples.
        """
        segment, _ = self._segment(row)
        poles, gains = self.exponentials.poles, self.exponentials.gains[self.order[row]]
        shifted_gains = gains * np.exp(poles * (time - self.rows[row].time))
        return samples(poles, shifted_gains[None], length, segment.sample_rate)[0]

    def noise_in(self, row: int, edges: Array) -> Array:
        """Compute the power of the noise of a row in bands.

        Parameters
        ----------
        row : int
            Number of the row of `gains`.
        edges : array (B + 1,)
            Edges of the bands, Hz.

        Returns
        -------
        array (B,)
            Power in each band.
        """
        segment, channel = self._segment(row)
        middles = np.sqrt(edges[1:] * edges[:-1])
        return segment.noise.at(middles)[channel] * 2 * np.diff(edges) / segment.sample_rate

    def _segment(self, row: int) -> tuple[Segment, int]:
        place = int(self.order[row])
        segment = next(each for each in self.segments if place < each.rows.stop)
        return segment, place - segment.rows.start


def make_pole_fit(
    segments: list[Segment],
    rows: list[Row],
    exponentials: Exponentials,
    verdict: ModalVerdict,
    notes: list[str],
    *,
    hum: Array,
    measured: bool = False,
) -> PoleFit:
    """Return a fit with its errors, without tones of the surroundings and earlier hits.

    If modes are to be `measured`, weak ones are left out, too.
    """
    is_ambient = find_ambient(segments, exponentials) | find_hum(hum, exponentials)
    errors = standard_errors(segments, exponentials)
    is_weak = (
        _find_weak(segments, exponentials) & ~is_ambient if measured else np.zeros_like(is_ambient)
    )
    lines = np.unique(np.concatenate((exponentials.frequencies[is_ambient], hum[:, 0])).round(1))
    if lines.size:
        tones = ", ".join(f"{frequency:.1f}" for frequency in lines[:_MAX_TONES])
        notes = [*notes, f"tones of the surroundings, left out of the model: {tones} Hz"]
    if is_weak.any():
        weak_tones = ", ".join(
            f"{frequency:.1f}" for frequency in exponentials.frequencies[is_weak]
        )
        notes = [*notes, f"too weak to be measured, left out of the model: {weak_tones} Hz"]
    is_of_blow = find_blow_modes(segments, exponentials, is_released=measured)
    # A measurement is of the object alone.
    is_object_mode = ~(is_ambient | is_weak | (is_of_blow & measured))
    endless_count = np.count_nonzero(
        (errors.decays > exponentials.decays) & is_object_mode & ~is_of_blow
    )
    if endless_count:
        count = counted(endless_count, "mode")
        notes = [
            *notes,
            f"{count} ringing for too long to be measured in these takes: record longer",
        ]
    object_modes = exponentials.of(is_object_mode)
    take_deviations = between_takes(segments, np.array([row.take for row in rows]), exponentials)
    notes = [
        *notes,
        *_note_differing(
            take_deviations[0][
                is_object_mode & ~is_of_blow & (take_deviations[0] > errors.frequencies)
            ]
        ),
    ]
    notes = [*notes, *notes_on_other_objects(rows, object_modes)]
    order = np.array(sorted(range(len(rows)), key=lambda row: (rows[row].take, rows[row].hit, row)))
    sorted_rows = [rows[row] for row in order]
    pole_errors = (
        np.hypot(errors.frequencies, take_deviations[0])[is_object_mode],
        np.hypot(errors.decays, take_deviations[1])[is_object_mode],
    )
    return PoleFit(
        frequencies=object_modes.frequencies,
        decays=object_modes.decays,
        gains=_subtract_earlier(object_modes.gains[order], object_modes.poles, sorted_rows),
        frequency_errors=pole_errors[0],
        decay_errors=pole_errors[1],
        gain_errors=errors.gains[order][:, is_object_mode],
        rows=tuple(sorted_rows),
        segments=tuple(segments),
        exponentials=exponentials,
        order=order,
        verdict=verdict,
        blow=is_of_blow[is_object_mode],
        vague=find_vague(segments, object_modes.frequencies, object_modes.decays, pole_errors),
        notes=tuple(notes),
    )


def _note_differing(deviations: Array) -> Iterator[str]:
    """Yield a note that frequencies of modes differ from take to take, by deviations (K,), Hz."""
    if deviations.size:
        yield (
            f"the frequency of {counted(len(deviations), 'mode')} differs from take to take by "
            f"{rounded(np.median(deviations), 2)} Hz in the median, more than noise explains, "
            "which is part of the errors; was the object held or supported in the same way?"
        )


def _find_weak(segments: list[Segment], exponentials: Exponentials) -> Mask:
    """Return which modes are too weak to be measured.

    At an energy E over noise a decay rate is known to sqrt(2 / E) of itself at best: 22 %. Whether
    it is one mode or two cannot be decided.
    """
    unique_energies, fractions = energies(segments, exponentials)
    return unique_energies < _MIN_ENERGY * fractions


def _subtract_earlier(gains: AnyComplex, poles: AnyComplex, rows: list[Row]) -> AnyComplex:
    """Subtract from each hit's gains the ringing that is left of the hit before."""
    gain_differences = gains.copy()
    last: dict[tuple[int, int], int] = {}
    for row, entry in enumerate(rows):
        earlier_row = last.get((entry.take, entry.channel))
        if earlier_row is not None:
            gain_differences[row] -= gains[earlier_row] * np.exp(
                poles * (entry.time - rows[earlier_row].time)
            )
        last[entry.take, entry.channel] = row
    return gain_differences


_SAME_PEAK = 1e-3  # of the peak
_NUMBER = re.compile(r"-?\d+(\.\d+)?")


def notes_on(takes: Sequence[Take], hits: Sequence[Sequence[Hit]]) -> Iterator[str]:
    """Yield findings on takes: the first of each kind, and the number of other takes with the same.

    Files are named without their folders, which are private.
    """
    notes_by_kind: dict[str, list[str]] = {}
    for take, take_hits in zip(takes, hits, strict=True):
        for note in findings(take, take_hits):
            kind = _NUMBER.sub("#", note.replace(take.name, ""))
            notes_by_kind.setdefault(kind, []).append(note.replace(take.name, Path(take.name).name))
    yield from _note_normalised(takes, hits)
    for notes in notes_by_kind.values():
        count = len(notes) - 1
        yield f"{notes[0]}; so {counted(count, 'more take')}" if count else notes[0]


def _note_normalised(takes: Sequence[Take], hits: Sequence[Sequence[Hit]]) -> Iterator[str]:
    """Yield that hits have one and the same peak, as no person strikes."""
    parts = [
        part
        for take, take_hits in zip(takes, hits, strict=True)
        for part in np.split(take.samples, [hit.onset for hit in take_hits[1:]], axis=1)
    ]
    peaks = np.array([np.abs(part).max(initial=0.0) for part in parts])
    if len(peaks) > 2 and np.ptp(peaks) < _SAME_PEAK * peaks.max():
        yield (
            f"all {len(peaks)} hits have the peak {20 * np.log10(peaks.max()):.1f} dB: they were "
            "normalised one by one, and the levels of the contacts are lost; use the recordings "
            "before normalisation"
        )


def _note_unexplained(takes: Sequence[Take], verdict: ModalVerdict) -> Iterator[str]:
    """Yield notes on takes that the modes do not explain, although they explain all together."""
    for take, ratio in zip(takes, verdict.takes, strict=True):
        if verdict.modal and ratio < MODAL_MARGIN:
            yield (
                f"{Path(take.name).name} is explained to {ratio:.1f} dB only: is it of another "
                "object, or was it held otherwise? Leave it out, or fit it alone"
            )


StageRunner = Callable[[str, Callable[[], Exponentials]], Exponentials]
SearchPass = Callable[[Sequence[Array]], Candidates]

# Window, s; fastest decay, 1/s; frames; poles of a bin. The first twice: the second pass finds
# modes under the strongest ones, before shorter windows could mistake them.
_WINDOWS = (
    (0.186, 15.0, 300, 20),
    (0.186, 15.0, 300, 20),
    (0.046, 100.0, 250, 8),
    (0.012, 900.0, 150, 8),
)
_ROUNDS = 4
_BINS = 12  # that are searched in an auditory band under a budget
_CANDIDATE_CHANCE = 1e-6  # chance that noise makes a candidate
_SPARE_RATIO = 1.6  # of the budget until modes are refined
_STEP = 0.85  # of the modes stay in a round of pruning
_FAINT_RATIO, _SURROUNDINGS = 10 ** (-35 / 20), 40.0  # of the amplitude, within this distance in Hz
_MAX_BEATING_DECAY = 15.0  # 1/s
_FADING_DEPTH = 2.0  # nepers by which spurious modes fade before the search for masked modes
_MIN_DELAY = 0.02  # s, least delay of the second search
_MAX_DELAY_FRACTION = 0.08  # largest fraction of the shortest segment that the delay takes
_MIN_CORRELATION = 0.5  # least squared correlation of one mode that is detected twice


def run_uncached(_name: str, compute: Callable[[], Exponentials]) -> Exponentials:
    """Return the result of a stage without keeping it."""
    return compute()


def search(
    segments: Sequence[Segment],
    *,
    budget: int | None = None,
    progress: Progress = silent,
    run_stage: StageRunner = run_uncached,
) -> Exponentials:
    """Find the modes of all segments together, by frequency.

    With a budget, those that explain most; else all that stand out of noise and the residual.
    `run_stage` takes the name of a stage and its computation, and returns its result.
    """
    ringing = Exponentials.silence(sum(len(segment.samples) for segment in segments))
    passes = list(_make_passes(segments, budget))
    for number, search_pass in enumerate(passes):
        progress("looking for modes", number / len(passes))
        previous_modes = ringing
        ringing = run_stage(
            f"look {number}", partial(_run_pass, segments, previous_modes, search_pass, budget)
        )
        if not budget and is_diverging(segments, previous_modes, ringing):
            ringing = previous_modes
            break
        if number > len(_WINDOWS) and np.array_equal(previous_modes.poles, ringing.poles):
            break
        if (not budget or number + 1 == len(_WINDOWS)) and is_hopeless(segments, ringing, budget):
            return _keep_significant(segments, _reduce_to_budget(segments, ringing, budget), budget)
    progress("refining the modes", 0.0)
    ringing = run_stage(
        "pairs", lambda: _split_pairs(segments, refine(segments, ringing, sweeps=2), budget)
    )
    progress("refining the modes", 0.4)
    select_modes = partial(_reduce_to_budget, segments, ringing, budget)
    ringing = run_stage("budget", lambda: refine(segments, select_modes(), sweeps=4, steps=4))
    progress("refining the modes", 0.8)
    ringing = _keep_significant(segments, ringing, budget)
    return _search_again(segments, ringing, passes[-1], budget) if budget else ringing


def _search_again(
    segments: Sequence[Segment], ringing: Exponentials, search_pass: SearchPass, budget: int
) -> Exponentials:
    """Search for modes once more in the residual, which may replace modes that were dropped."""
    candidate = _reduce_to_budget(
        segments, _run_pass(segments, ringing, search_pass, budget), budget
    )
    refined_modes = _keep_significant(
        segments, refine(segments, candidate, sweeps=4, steps=4), budget
    )
    return min(ringing, refined_modes, key=partial(residual_energy, segments))


def _run_pass(
    segments: Sequence[Segment], ringing: Exponentials, search_pass: SearchPass, budget: int | None
) -> Exponentials:
    """Search the residual for modes once, and fit them together with the known ones."""
    left = [segment.residual(ringing) for segment in segments]
    if not budget:
        extended_modes = add_significant(segments, ringing, search_pass(left))
        return (
            _refit_all(segments, extended_modes, None)
            if extended_modes.count > ringing.count
            else ringing
        )
    spare_count = round(_SPARE_RATIO * budget)
    new_candidates = strongest_per_band(segments, search_pass(left), spare_count)
    return (
        _refit_all(segments, ringing.joined(new_candidates.poles), spare_count)
        if new_candidates.poles.size
        else ringing
    )


def _keep_significant(
    segments: Sequence[Segment], ringing: Exponentials, budget: int | None
) -> Exponentials:
    """Keep the modes that stand out, with the best gains of all at once.

    If many are spurious, they are dropped and the others are not refitted: they would change.
    """
    if (
        not budget
        and 3 * np.count_nonzero(is_spurious := find_spurious(segments, ringing)) > ringing.count
    ):
        return _search_after_fading(segments, ringing, is_spurious)
    noisy_segments = segments if budget else _raise_noise(segments, ringing)
    significant_modes = drop_redundant(noisy_segments, prune(noisy_segments, ringing))
    if significant_modes.count < ringing.count:
        significant_modes = drop_redundant(
            noisy_segments, refine(segments, significant_modes, sweeps=2, steps=4)
        )
    significant_modes = with_best_gains(
        segments, significant_modes.of(significant_modes.frequencies > MIN_FREQUENCY)
    ).by_frequency()
    if not budget and (is_spurious := find_spurious(segments, significant_modes)).any():
        return with_best_gains(segments, significant_modes.of(~is_spurious))
    return significant_modes


def _search_after_fading(
    segments: Sequence[Segment], ringing: Exponentials, is_spurious: Mask
) -> Exponentials:
    """Drop spurious modes, and search again from when they have faded, if that is soon.

    Poles of the second search replace similar ones; modes masked by louder ones are dropped.
    """
    decay = float(np.median(ringing.decays[is_spurious]))
    remaining_modes = ringing.of(~is_spurious & (ringing.frequencies > MIN_FREQUENCY))
    is_soon = (
        _MIN_DELAY
        < (delay := _FADING_DEPTH / decay)
        < _MAX_DELAY_FRACTION * min(segment.duration for segment in segments)
    )
    if (
        not is_soon
        or ringing.count > MANY_MODES
        or signal_to_misfit(segments, ringing) < MODAL_MARGIN
    ):
        return with_best_gains(segments, remaining_modes).by_frequency()
    late_modes = search([segment.later(delay) for segment in segments])
    is_unmatched = (
        overlap(remaining_modes.poles[:, None], late_modes.poles, np.inf).max(axis=1, initial=0.0)
        < _MIN_CORRELATION
    )
    remaining_modes = with_best_gains(
        segments, late_modes.joined(remaining_modes.poles[is_unmatched])
    )
    is_masked = find_masked(
        remaining_modes, remaining_modes.decays < SLOW_DECAY_RATIO * decay, 1.0
    ) & find_unexplained_bands(segments, remaining_modes)
    return with_best_gains(segments, remaining_modes.of(~is_masked)).by_frequency()


def _make_passes(segments: Sequence[Segment], budget: int | None) -> Iterator[SearchPass]:
    """Yield the search passes, one after the other."""
    longest = max(segment.samples.shape[1] for segment in segments)
    # A budget ignores faint modes: noise is raised to a level far below each band's sound.
    noisy_segments = [
        segment.noisier(_FAINT_RATIO * segment.samples, _SURROUNDINGS)
        for segment in segments
        if budget
    ]
    noisy_segments = noisy_segments or segments
    for window, fastest, frames, orders in _WINDOWS:
        size = 2 ** round(np.log2(min(window * segments[0].sample_rate, longest / 4)))
        resolution = Resolution(window=size, fastest=fastest, frames=frames, orders=orders)
        yield partial(
            find_candidates,
            noisy_segments,
            resolution=resolution,
            per_band=_BINS if budget else None,
        )
    yield partial(find_broad, noisy_segments)
    channels = sum(len(segment.samples) for segment in segments)
    for _ in range(1 if budget else _ROUNDS):
        yield partial(
            match_filters, noisy_segments, min_energy=significance(channels, _CANDIDATE_CHANCE)
        )


def _refit_all(
    segments: Sequence[Segment], ringing: Exponentials, max_count: int | None
) -> Exponentials:
    """Fit old and new modes together and drop modes that explain no energy."""
    ringing = refine(segments, ringing, sweeps=1, steps=0)
    if max_count is not None:
        ringing = prune(segments, ringing, budget=max_count)
    ringing = refine(segments, ringing, sweeps=2)
    ringing = prune(_raise_noise(segments, ringing), ringing, budget=max_count)
    return refine(segments, ringing, sweeps=1)


def _split_pairs(
    segments: Sequence[Segment], ringing: Exponentials, budget: int | None
) -> Exponentials:
    """Split modes into close pairs, twice; under a budget once, and into slowly beating pairs."""
    for _ in range(1 if budget else 2):
        extended_modes = split_pairs(
            segments, ringing, max_decay=_MAX_BEATING_DECAY if budget else np.inf
        )
        if extended_modes.count == ringing.count:
            break
        extended_modes = refine(
            segments, refine(segments, extended_modes, sweeps=1, steps=0), sweeps=2
        )
        ringing = prune(segments, extended_modes)
    return ringing


def _reduce_to_budget(
    segments: Sequence[Segment], ringing: Exponentials, budget: int | None
) -> Exponentials:
    """Drop the weakest modes a few at a time down to a budget, refitting the others each time."""
    while budget and ringing.count > budget:
        new_count = max(budget, int(_STEP * ringing.count))
        ringing = refine(segments, prune(segments, ringing, budget=new_count), sweeps=2)
    return ringing


def _raise_noise(segments: Sequence[Segment], ringing: Exponentials) -> list[Segment]:
    """Raise the noise to the residual where that is more."""
    return [segment.noisier(segment.residual(ringing)) for segment in segments]


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
    run_stage: StageRunner = run_uncached,
) -> PoleFit:
    """Fit one set of modes to all channels and hits of all takes.

    Parameters
    ----------
    takes : Take or sequence of Take
        Recordings of one object, at one sample rate.
    method : {"shared", "corbett2007"}, default "shared"
        "shared": all poles of all channels and hits in one fit. "corbett2007": a fit of each, and a
        merge, as in the paper.
    budget : int or None, default 64
        Maximum number of modes, those that explain most. None: all that are clear of noise.
    onsets : sequence of sequences of float, optional
        Times of the hits in each take, s. Default: detected.
    attack : bool, optional
        Whether the modes represent the whole sound, attack included, or only the free decay.
        Default: the whole sound if there is a budget.
    progress : callable, optional
        Called as ``progress(stage, fraction)``. Default: silent.
    run_stage : callable, optional
        Called with a name and a function that computes a stage; returns its result, from a cache if
        possible. Default: no cache.

    Returns
    -------
    PoleFit
        The modes. The verdict states whether the sound is that of a struck object.

    Raises
    ------
    RecordingError
        If takes differ in sample rate, or one has no hit.
    OptionError
        If there is no take, the budget is below 1, onsets do not fit the takes, or the method is
        unknown.
    """
    require_choice("method", method, METHODS)
    takes = [takes] if isinstance(takes, Take) else list(takes)
    if not takes or (budget is not None and budget < 1):
        raise OptionError(f"{len(takes)} takes, budget {budget}: give at least 1 of each")
    require_one_rate(takes)
    calm_takes, tones = zip(*(without_hum(without_force(take)) for take in takes), strict=True)
    microphones, hits, controls = _undo_gain_control(calm_takes, onsets)
    hum = np.concatenate(tones)
    doubts = [
        find_doubtful(*pair) if onsets is None else []
        for pair in zip(microphones, hits, strict=True)
    ]
    has_attack = budget is not None if attack is None else attack

    def fit(hits: Sequence[Sequence[Hit]], stage: str = "") -> PoleFit:
        segments, rows = join_stretches(cut_takes(microphones, hits, attack=has_attack))

        def run_named_stage(name: str, compute: Callable[[], Exponentials]) -> Exponentials:
            return run_stage(f"{name}{stage}", compute)

        if method == "shared":
            ringing = search(segments, budget=budget, progress=progress, run_stage=run_named_stage)
        else:
            ringing = run_named_stage(method, lambda: by_corbett2007(segments, budget))
        outside_energies = (
            [] if onsets is not None else list(map(energy_before_hits, microphones, hits))
        )
        is_steady = onsets is None and all(map(is_constant, microphones))
        verdict = judge(segments, rows, ringing, outside_energies, is_steady=is_steady)
        notes = [*notes_on(takes, hits), *_note_unexplained(takes, verdict)]
        is_measurement = method == "shared" and budget is None
        return make_pole_fit(
            segments, rows, ringing, verdict, notes, hum=hum, measured=is_measurement
        )

    result = _fit_proven_hits(fit, hits, doubts) if any(doubts) else fit(hits)
    result = _add_gain_errors(result, controls, takes)
    result = replace(result, rows=_count_channels(result.rows, takes))
    if method == "shared":
        return result
    # The method of 2007 does not minimise the residual that errors come from.
    missing_errors = np.full(len(result.frequencies), np.nan)
    return replace(result, frequency_errors=missing_errors, decay_errors=missing_errors)


def _undo_gain_control(
    takes: Sequence[Take], onsets: Sequence[Sequence[float]] | None
) -> tuple[list[Take], list[list[Hit]], list[GainControl | None]]:
    """Return takes without automatic gain, their hits, and the gains that were undone."""
    takes, hits = list(takes), _hits(takes, onsets)
    controls = [gain_control(*pair) for pair in zip(takes, hits, strict=True)]
    for place, control in enumerate(controls):
        if control is not None:
            takes[place] = control.undone(takes[place])
            new_hits = _hits(takes[place : place + 1], onsets and onsets[place : place + 1])
            hits[place] = control.settled(new_hits[0], takes[place].sample_rate)
    return takes, hits, controls


def _add_gain_errors(
    fit: PoleFit, controls: Sequence[GainControl | None], takes: Sequence[Take]
) -> PoleFit:
    """Add the gains' uncertainty to the errors of decays; refuse takes with too much of it."""
    fit = replace(fit, controls=tuple(controls))
    of_gain = [control.decay_errors(fit.decays) for control in controls if control is not None]
    if not of_gain:
        return fit
    notes = [
        f"the gain of {take.name} was controlled automatically, by {control.depth:.0f} dB: it is "
        "undone by means of the noise, and decays are less certain; turn it off"
        for take, control in zip(takes, controls, strict=True)
        if control is not None
    ]
    is_object_mode, gain_errors = ~fit.blow, np.max(of_gain, axis=0)
    relative_error = (
        float(np.median((gain_errors / fit.decays)[is_object_mode]))
        if is_object_mode.any()
        else 0.0
    )
    verdict = fit.verdict
    if relative_error > MAX_DECAY_ERROR:
        reason = (
            "its gain was controlled automatically, and the noise determines decays to "
            f"{100 * relative_error:.0f} % only, of {100 * MAX_DECAY_ERROR:g} % that are needed: "
            "turn it off"
        )
        verdict = replace(verdict, modal=False, reason=reason)
    errors = fit.frequency_errors, np.hypot(fit.decay_errors, gain_errors)
    return replace(
        fit,
        decay_errors=errors[1],
        vague=find_vague(fit.segments, fit.frequencies, fit.decays, errors),
        notes=(*fit.notes, *notes),
        verdict=verdict,
    )


def _fit_proven_hits(
    fit: Callable[[Sequence[Sequence[Hit]], str], PoleFit],
    hits: list[list[Hit]],
    doubts: list[list[Hit]],
) -> PoleFit:
    """Fit with the sure hits and with each doubtful hit that explains more than its gains cost."""
    full_fit = fit(hits, "")
    if not full_fit.verdict.modal:  # with fewer hits it explains no more
        return full_fit
    sure_hits = [
        _end_at_next([hit for hit in take_hits if hit not in doubtful_hits], take_hits[-1].end)
        for take_hits, doubtful_hits in zip(hits, doubts, strict=True)
    ]
    sure_fit = fit(sure_hits, ", sure hits")
    accepted_hits = [
        [
            hit
            for hit in take_hits
            if hit not in doubtful_hits or _is_proven(full_fit, sure_fit, number, hit)
        ]
        for number, (take_hits, doubtful_hits) in enumerate(zip(hits, doubts, strict=True))
    ]
    if accepted_hits == hits:
        return full_fit
    accepted_hits = [
        _end_at_next(take_hits, all_hits[-1].end)
        for take_hits, all_hits in zip(accepted_hits, hits, strict=True)
    ]
    return sure_fit if accepted_hits == sure_hits else fit(accepted_hits, ", proven hits")


def _end_at_next(hits: list[Hit], end: int) -> list[Hit]:
    """Return hits that last until the next of them, the last one until sample `end`."""
    ends = [*(hit.onset for hit in hits[1:]), end]
    return [replace(hit, end=end) for hit, end in zip(hits, ends, strict=True)]


def _is_proven(full_fit: PoleFit, sure_fit: PoleFit, take: int, hit: Hit) -> bool:
    """Return whether a doubtful hit of a take explains energy that the sure hits leave."""
    rate = full_fit.segments[0].sample_rate
    left, sure_residuals = [], []
    for row, entry in enumerate(full_fit.rows):
        if entry.take != take or not hit.onset <= entry.time * rate <= hit.end:
            continue
        sound, model = full_fit.samples_and_model(row)
        earlier_rows = [
            number
            for number, sure_row in enumerate(sure_fit.rows)
            if (sure_row.take, sure_row.channel) == (take, entry.channel)
            and sure_row.time <= entry.time
        ]
        if earlier_rows:
            left.append(sound - model)
            sure_residuals.append(
                sound - sure_fit.ringing(earlier_rows[-1], entry.time, len(sound))
            )
    return bool(left) and is_proven(left, sure_residuals, len(full_fit.exponentials.poles))


def _count_channels(rows: Sequence[Row], takes: Sequence[Take]) -> tuple[Row, ...]:
    """Count the rows' channels as in the takes, where force sensors count, too."""
    channels = [np.flatnonzero(~left_out(take)) for take in takes]
    return tuple(replace(row, channel=int(channels[row.take][row.channel])) for row in rows)


def _hits(takes: Sequence[Take], onsets: Sequence[Sequence[float]] | None) -> list[list[Hit]]:
    if onsets is None:
        return list(map(_find_clear_hits, takes))
    if np.ndim(onsets) == 0 or any(np.ndim(take_onsets) == 0 for take_onsets in onsets):
        raise OptionError(f"onsets are {onsets!r}: give a sequence of times for each take, s")
    if len(onsets) != len(takes):
        raise OptionError(f"onsets of {len(onsets)} takes, and {len(takes)} takes: give one each")
    return [
        list(_hits_at(take, sorted(take_onsets)))
        for take, take_onsets in zip(takes, onsets, strict=True)
    ]


def _find_clear_hits(take: Take) -> list[Hit]:
    """Return the hits of a take, without a faint one that its end leaves no time to ring.

    The hit before ends where that one began: a coder or a cut may have made it.
    """
    hits = find_hits(take)
    late_hits = [hit for hit in find_doubtful(take, hits)[-1:] if hit is hits[-1]]
    if late_hits and hits[-1].end - hits[-1].start < MIN_DURATION * take.sample_rate:
        return hits[:-1]
    return hits


def _hits_at(take: Take, times: list[float]) -> Iterator[Hit]:
    invalid_times = [time for time in times if not 0 <= time < take.duration]
    if invalid_times:
        raise OptionError(
            f"onset {invalid_times[0]} s lies outside {take.name}, 0 to {take.duration:.3f} s"
        )
    samples = [round(time * take.sample_rate) for time in times]
    if len(set(samples)) < len(samples):
        raise OptionError(f"onsets {times} of {take.name} name one moment twice: name each once")
    for first, last in zip(samples, [*samples, take.samples.shape[1]][1:], strict=True):
        yield hit_at(take, first, last)

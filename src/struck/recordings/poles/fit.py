"""Fitting: takes of one object in, the modes that all of them share out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.progress import Progress, silent
from struck.recordings.poles.ambient import ambient
from struck.recordings.poles.search import search
from struck.recordings.poles.uncertainty import standard_errors
from struck.recordings.poles.verdict import LEAST, MODES, Verdict, judged
from struck.recordings.takes.checks import findings
from struck.recordings.takes.cutting import Row, cut, joined
from struck.recordings.takes.onsets import Hit, find_hits, hit_at
from struck.recordings.takes.ringing import Ringing
from struck.recordings.takes.segment import Segment
from struck.recordings.takes.take import Take, require_one_rate

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]


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
    rows : tuple of Row
        What each row of gains belongs to, in order of takes, hits and channels.
    segments : tuple of Segment
        What was fitted.
    heard : Ringing
        The modes with their gains in the segments, what rings of earlier hits included.
    verdict : Verdict
        Whether it is the sound of a struck object.
    notes : tuple of str
        What a person should know: what is wrong with the takes, and what was left out.
    """

    frequencies: Array
    decays: Array
    gains: Complex
    frequency_errors: Array
    decay_errors: Array
    rows: tuple[Row, ...]
    segments: tuple[Segment, ...]
    heard: Ringing
    verdict: Verdict
    notes: tuple[str, ...] = ()


def fit_poles(
    takes: Take | Sequence[Take],
    *,
    budget: int | None = 64,
    onsets: Sequence[Sequence[float]] | None = None,
    progress: Progress = silent,
) -> Fitted:
    """Fit one set of modes to all channels and hits of all takes.

    Parameters
    ----------
    takes : Take or sequence of Take
        Of the same object, at one sample rate.
    budget : int or None
        Not more modes than these, those that explain most; None for all that stand out.
    onsets : sequence of sequences of float, optional
        Times of the hits in each take, s; found unless given.
    progress : Progress
        Told the stage and the fraction done.

    Returns
    -------
    Fitted
        Where the sound is not that of a struck object, its verdict says so.

    Raises
    ------
    RecordingError
        When takes differ in sample rate, or one of them holds no hit.
    OptionError
        When there is no take, the budget is below 1, or onsets are none of the takes'.
    """
    takes = [takes] if isinstance(takes, Take) else list(takes)
    if not takes or (budget is not None and budget < 1):
        raise OptionError(f"{len(takes)} takes, budget {budget}: give at least 1 of each")
    require_one_rate(takes)
    hits = _hits(takes, onsets)
    segments, rows = joined(cut(takes, hits))
    ringing = search(segments, budget=budget, progress=progress)
    verdict = _verdict(segments, ringing, budget)
    notes = [note for take, own in zip(takes, hits, strict=True) for note in findings(take, own)]
    return _fitted(segments, rows, ringing, verdict, notes)


def _hits(takes: list[Take], onsets: Sequence[Sequence[float]] | None) -> list[list[Hit]]:
    if onsets is None:
        return [find_hits(take) for take in takes]
    if len(onsets) != len(takes):
        raise OptionError(f"onsets of {len(onsets)} takes, and {len(takes)} takes: give one each")
    return [list(_given(take, sorted(own))) for take, own in zip(takes, onsets, strict=True)]


def _given(take: Take, times: list[float]) -> Iterator[Hit]:
    wrong = [time for time in times if not 0 <= time < take.duration]
    if wrong:
        raise OptionError(
            f"onset {wrong[0]} s lies outside {take.name}, 0 to {take.duration:.3f} s"
        )
    samples = [round(time * take.sample_rate) for time in times]
    for first, last in zip(samples, [*samples, take.samples.shape[1]][1:], strict=True):
        yield hit_at(take, first, last)


def _verdict(segments: list[Segment], ringing: Ringing, budget: int | None) -> Verdict:
    """Judge a fit; a poor one of few modes only after another try with more."""
    verdict = judged(segments, ringing)
    if budget is not None and budget < MODES and verdict.signal_to_misfit < LEAST:
        richer = judged(segments, search(segments, budget=MODES))
        return verdict if richer.modal else richer
    return verdict


def _fitted(
    segments: list[Segment], rows: list[Row], heard: Ringing, verdict: Verdict, notes: list[str]
) -> Fitted:
    surrounding = ambient(segments, heard)
    frequency_errors, decay_errors = standard_errors(segments, heard)
    if surrounding.any():
        tones = ", ".join(f"{each:.1f}" for each in heard.frequencies[surrounding])
        notes = [*notes, f"tones of the surroundings, left out of the model: {tones} Hz"]
    own = heard.of(~surrounding)
    order = sorted(range(len(rows)), key=lambda row: (rows[row].take, rows[row].hit, row))
    ordered = [rows[row] for row in order]
    return Fitted(
        frequencies=own.frequencies,
        decays=own.decays,
        gains=_without_earlier(own.gains[order], own.poles, ordered),
        frequency_errors=frequency_errors[~surrounding],
        decay_errors=decay_errors[~surrounding],
        rows=tuple(ordered),
        segments=tuple(segments),
        heard=heard,
        verdict=verdict,
        notes=tuple(notes),
    )


def _without_earlier(gains: Complex, poles: Complex, rows: list[Row]) -> Complex:
    """Take off each hit's gains what the hit before has left ringing."""
    own = gains.copy()
    last: dict[tuple[int, int], int] = {}
    for row, what in enumerate(rows):
        earlier = last.get((what.take, what.channel))
        if earlier is not None:
            own[row] -= gains[earlier] * np.exp(poles * (what.time - rows[earlier].time))
        last[what.take, what.channel] = row
    return own

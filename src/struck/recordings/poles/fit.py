"""Fitting: takes of one object in, the modes that all of them share out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from struck.errors import OptionError
from struck.model.exponentials import Ringing
from struck.progress import Progress, silent
from struck.recordings.onsets import Hit, find_hits, hit_at
from struck.recordings.poles.by_corbett2007 import by_corbett2007
from struck.recordings.poles.fitted import Fitted, fitted_of
from struck.recordings.poles.notes import notes_on
from struck.recordings.poles.search import Kept, computed, search
from struck.recordings.poles.verdict import LEAST, MODES, Verdict, judged
from struck.recordings.segments import Row, cut, joined
from struck.recordings.takes.force import force_channels, without_force
from struck.recordings.takes.segment import Segment
from struck.recordings.takes.take import Take, require_one_rate

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]

METHODS = ("shared", "corbett2007")


@threadpool_limits.wrap(limits=1, user_api="blas")  # many small products: threads only wait
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
    if method not in METHODS:
        raise OptionError(f"method is {method!r}: give one of {', '.join(METHODS)}")
    takes = [takes] if isinstance(takes, Take) else list(takes)
    if not takes or (budget is not None and budget < 1):
        raise OptionError(f"{len(takes)} takes, budget {budget}: give at least 1 of each")
    require_one_rate(takes)
    microphones = [without_force(take) for take in takes]
    hits = _hits(microphones, onsets)
    whole = budget is not None if attack is None else attack
    segments, rows = joined(cut(microphones, hits, attack=whole))
    if method == "shared":
        ringing = search(segments, budget=budget, progress=progress, kept=kept)
        verdict = _verdict(segments, ringing, budget)
    else:
        ringing = kept(method, lambda: by_corbett2007(segments, budget))
        verdict = judged(segments, ringing)
    notes = list(notes_on(takes, hits))
    measured = method == "shared" and budget is None
    rows = _numbered(rows, takes)
    fitted = fitted_of(segments, rows, ringing, verdict, notes, measured=measured)
    return fitted if method == "shared" else _without_errors(fitted)


def _without_errors(fitted: Fitted) -> Fitted:
    """Return what the paper's method tells: those of least squares are none of its poles'."""
    unknown = np.full(len(fitted.frequencies), np.nan)
    return replace(fitted, frequency_errors=unknown, decay_errors=unknown)


def _numbered(rows: list[Row], takes: list[Take]) -> list[Row]:
    """Give channels their numbers in the takes, where force sensors count too."""
    channels = [np.flatnonzero(~force_channels(take)) for take in takes]
    return [replace(row, channel=int(channels[row.take][row.channel])) for row in rows]


def _hits(takes: list[Take], onsets: Sequence[Sequence[float]] | None) -> list[list[Hit]]:
    if onsets is None:
        return [find_hits(take) for take in takes]
    if np.ndim(onsets) == 0 or any(np.ndim(own) == 0 for own in onsets):
        raise OptionError(f"onsets are {onsets!r}: give a sequence of times for each take, s")
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
    if len(set(samples)) < len(samples):
        raise OptionError(f"onsets {times} of {take.name} name one moment twice: name each once")
    for first, last in zip(samples, [*samples, take.samples.shape[1]][1:], strict=True):
        yield hit_at(take, first, last)


def _verdict(segments: list[Segment], ringing: Ringing, budget: int | None) -> Verdict:
    """Judge a fit; a poor one of few modes only after another try with more."""
    verdict = judged(segments, ringing)
    if budget is not None and budget < MODES and verdict.signal_to_misfit < LEAST:
        richer = judged(segments, search(segments, budget=MODES))
        return verdict if richer.modal else richer
    return verdict

"""Finding all modes: candidates at several resolutions, each pass on what the last one left."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from struck.model.exponentials import Ringing
from struck.progress import Progress, silent
from struck.recordings.poles.candidates import Candidates, Resolution, candidates
from struck.recordings.poles.matched import matched
from struck.recordings.poles.refinement import refine, with_best_gains
from struck.recordings.poles.selection import prune, significance, strongest_per_band
from struck.recordings.poles.split import split
from struck.recordings.poles.weed import weeded
from struck.recordings.takes.segment import Segment

Array = NDArray[np.float64]
Kept = Callable[[str, Callable[[], Ringing]], Ringing]
Look = Callable[[Sequence[Segment], Sequence[Array]], Candidates]

_WINDOWS = (
    (0.186, 15.0, 300, 20),
    (0.186, 15.0, 300, 20),
    (0.046, 100.0, 250, 8),
    (0.012, 900.0, 150, 8),
)
"""Window, s; fastest decay, 1/s; frames; poles a bin. The first twice: the second look finds what
stood under the strongest modes, before shorter windows could take it for something else."""
_ROUNDS = 4
_LIKELY = 1e-6
_SPARE = 1.25
_STEP = 0.85
_FAINT, _SURROUNDINGS = 10 ** (-35 / 20), 40.0
"""Of the amplitude, within so many Hz."""
_BEATING = 15.0
"""1/s."""


def computed(_name: str, compute: Callable[[], Ringing]) -> Ringing:
    """Return the result of a stage, nothing being kept."""
    return compute()


def search(
    segments: Sequence[Segment],
    *,
    budget: int | None = None,
    progress: Progress = silent,
    kept: Kept = computed,
) -> Ringing:
    """Find what rings in all segments together.

    Parameters
    ----------
    segments : sequence of Segment
        All channels and hits, at one sample rate.
    budget : int, optional
        Not more modes than these, the ones that explain most. Without it: all that stand out from
        noise and from what the model cannot explain.
    progress : Progress
        Told the stage and the fraction done.
    kept : callable
        Given the name of a stage and what computes it, returns its result.

    Returns
    -------
    Ringing
        In ascending order of frequency.
    """
    ringing = Ringing.silence(sum(len(segment.samples) for segment in segments))
    looks = list(_looks(segments, 1 if budget else _ROUNDS))
    for number, look in enumerate(looks):
        progress("looking for modes", number / len(looks))
        before = ringing
        ringing = kept(f"look {number}", partial(_looked, segments, before, look, budget))
        if number >= len(_WINDOWS) and np.array_equal(before.poles, ringing.poles):
            break
    progress("refining", 0.0)
    ringing = kept("pairs", partial(_in_pairs, segments, ringing, budget))
    progress("refining", 0.4)
    ringing = kept("budget", partial(_refined, segments, ringing, budget))
    progress("refining", 0.8)
    return _proven(segments, ringing, budget)


def _looked(
    segments: Sequence[Segment], ringing: Ringing, look: Look, budget: int | None
) -> Ringing:
    """Look once, and fit what was found together with what was known."""
    spare = round(_SPARE * budget) if budget else None
    masked = _masked(segments) if budget else segments
    found = look(masked, [segment.residual(ringing) for segment in segments])
    if spare is not None:
        found = strongest_per_band(segments, found, spare)
    if not found.poles.size:
        return ringing
    return _settled(segments, ringing.joined(found.poles), spare)


def _in_pairs(segments: Sequence[Segment], ringing: Ringing, budget: int | None) -> Ringing:
    return _paired(segments, refine(segments, ringing, sweeps=2), budget)


def _refined(segments: Sequence[Segment], ringing: Ringing, budget: int | None) -> Ringing:
    return refine(segments, _within(segments, ringing, budget), sweeps=4, steps=4)


def _proven(segments: Sequence[Segment], ringing: Ringing, budget: int | None) -> Ringing:
    """Keep what stands out, with the best gains of all at once."""
    noisy = segments if budget else _noisier(segments, ringing)
    proven = weeded(noisy, prune(noisy, ringing))
    if proven.count < ringing.count:
        proven = weeded(noisy, refine(segments, proven, sweeps=2, steps=4))
    return with_best_gains(segments, proven).by_frequency()


def _looks(segments: Sequence[Segment], rounds: int) -> Iterator[Look]:
    """Yield the passes, one after the other."""
    longest = max(segment.samples.shape[1] for segment in segments)
    for window, fastest, frames, orders in _WINDOWS:
        size = 2 ** round(np.log2(min(window * segments[0].sample_rate, longest / 4)))
        resolution = Resolution(window=size, fastest=fastest, frames=frames, orders=orders)
        yield partial(candidates, resolution=resolution)
    channels = sum(len(segment.samples) for segment in segments)
    for _ in range(rounds):
        yield partial(matched, least=significance(channels, _LIKELY))


def _settled(segments: Sequence[Segment], ringing: Ringing, most: int | None) -> Ringing:
    """Fit old and new modes together and drop what is none."""
    ringing = refine(segments, ringing, sweeps=1, steps=0)
    if most is not None:
        ringing = prune(segments, ringing, budget=most)
    ringing = refine(segments, ringing, sweeps=2)
    ringing = prune(_noisier(segments, ringing), ringing, budget=most)
    return refine(segments, ringing, sweeps=1)


def _paired(segments: Sequence[Segment], ringing: Ringing, budget: int | None) -> Ringing:
    """Split pairs, and pairs within pairs; under a budget only those that beat slowly."""
    for _ in range(1 if budget else 2):
        more = split(segments, ringing, fastest=_BEATING if budget else np.inf)
        if more.count == ringing.count:
            break
        more = refine(segments, refine(segments, more, sweeps=1, steps=0), sweeps=2)
        ringing = prune(segments, more)
    return ringing


def _within(segments: Sequence[Segment], ringing: Ringing, budget: int | None) -> Ringing:
    """Drop a few of the weakest at a time, and let the others take over what they can."""
    while budget and ringing.count > budget:
        fewer = max(budget, int(_STEP * ringing.count))
        ringing = refine(segments, prune(segments, ringing, budget=fewer), sweeps=2)
    return ringing


def _masked(segments: Sequence[Segment]) -> list[Segment]:
    """Take for noise what lies far below its surroundings: under a budget it has no chance."""
    return [
        replace(
            each,
            noise=each.noise.raised(_FAINT * each.samples, each.sample_rate, _SURROUNDINGS),
        )
        for each in segments
    ]


def _noisier(segments: Sequence[Segment], ringing: Ringing) -> list[Segment]:
    """Take what is left over for noise where it is more."""
    return [
        replace(each, noise=each.noise.raised(each.residual(ringing), each.sample_rate))
        for each in segments
    ]

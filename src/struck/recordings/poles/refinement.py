"""One global fit: poles shared by all channels and hits, refined group by group.

Levenberg-Marquardt with the complex gains eliminated (variable projection). Modes far apart hardly
know of each other, so groups of overlapping modes take turns, each against the data without the
present estimate of all others (Gauss-Seidel).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from struck.model.exponentials import Ringing, best_gains, row_width, samples_in_rows
from struck.recordings.poles.blocks import blocks_around
from struck.recordings.poles.groups import overlapping, overlaps
from struck.recordings.poles.kernels.blocks import Blocks
from struck.recordings.poles.kernels.turns import take_turns
from struck.recordings.takes.segment import Segment

Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]

_WITNESSES, _EVERY = 4, 4
_WORSE = 1.05
"""A group that gets better may make the whole a little worse, for a while."""
_TOUCHING = 1e-3
"""Squared correlation from which a mode that moved calls its neighbour up again."""


def refine(segments: Sequence[Segment], ringing: Ringing, sweeps: int, steps: int = 2) -> Ringing:
    """Move the poles to the least squares of all segments together.

    Parameters
    ----------
    segments : sequence of Segment
        All channels and hits.
    ringing : Ringing
        Where to start.
    sweeps : int
        How often each group gets its turn.
    steps : int
        Steps of Levenberg and Marquardt in one turn; 0 fits the gains alone.

    Returns
    -------
    Ringing
    """
    duration = max(segment.duration for segment in segments)
    if not steps:
        return with_best_gains(segments, ringing)
    energy = left_over(segments, ringing)
    unsettled = np.ones(ringing.count, bool)
    for _ in range(sweeps):
        groups = [group for group in overlapping(ringing.poles, duration) if unsettled[group].any()]
        if not groups:
            break
        moved = _swept(segments, ringing, groups, steps)
        unsettled = _touched(ringing.poles, moved.poles, duration)
        now = left_over(segments, moved)
        if not now < _WORSE * energy:
            moved = with_best_gains(segments, moved)
            now = left_over(segments, moved)
        if not now < _WORSE * energy:
            break
        ringing, energy = moved, now
    return ringing


def _touched(before: Complex, after: Complex, duration: float) -> NDArray[np.bool_]:
    """Return which modes moved, or overlap with one that did."""
    changed = before != after
    return changed | (overlaps(after, duration)[:, changed] > _TOUCHING).any(axis=1)


def with_best_gains(segments: Sequence[Segment], ringing: Ringing) -> Ringing:
    """Return a copy whose gains are the least squares of all samples."""
    if not ringing.count:
        return ringing
    gains = [best_gains(ringing.poles, each.samples, each.sample_rate) for each in segments]
    return Ringing(poles=ringing.poles, gains=np.vstack(gains))


def left_over(segments: Sequence[Segment], ringing: Ringing) -> float:
    """Return the energy that a fit leaves of a few channels, each against its noise.

    Of every so many milliseconds: that is enough to tell whether it grows.
    """
    energy = 0.0
    for segment in segments:
        some = slice(None, None, -(-len(segment.samples) // _WITNESSES))
        gains, heard = ringing.gains[segment.rows][some], segment.samples[some]
        length = segment.samples.shape[1]
        model = samples_in_rows(ringing.poles, gains, length, segment.sample_rate, _EVERY)
        width = row_width(length)
        whole = length // width
        rows = heard[:, : whole * width].reshape(len(heard), whole, width)[:, ::_EVERY]
        left = ((rows - model[:, : rows.shape[1]]) ** 2).sum(axis=(1, 2))
        energy += float(left @ (1 / segment.noise.densities[some].mean(axis=1)))
    return energy


def _swept(
    segments: Sequence[Segment], ringing: Ringing, groups: Sequence[Index], steps: int
) -> Ringing:
    """Give each group its turn."""
    poles, gains = ringing.poles.copy(), ringing.gains.copy(order="C")
    blocks = blocks_around(segments, poles, groups)
    take_turns(blocks, poles, gains, poles[blocks.members], blocks.starts, steps, keep=True)
    return Ringing(poles=poles, gains=gains)


class Attempt(NamedTuple):
    """What other poles would explain in the place of a group's.

    Parameters
    ----------
    poles : array (M,), complex
        As they have settled.
    gains : array (C, M), complex
        Theirs.
    cost : float
        Energy left, in units of the noise's in one bin.
    misfit : float
        The same a bin and channel, noise being 1; 1 where chance may explain it.
    """

    poles: Complex
    gains: Complex
    cost: float
    misfit: float


def settled(blocks: Blocks, ringing: Ringing, start: Complex, steps: int) -> Attempt:
    """Refine other poles in the place of the only group of some blocks.

    Parameters
    ----------
    blocks : Blocks
        Around one group.
    ringing : Ringing
        All modes; those outside the group stay as they are.
    start : array, complex
        Poles to start with.
    steps : int
        Of Levenberg and Marquardt at most.
    """
    gains, places = np.ascontiguousarray(ringing.gains), np.array([0, len(start)])
    moved, own, costs, misfits = take_turns(
        blocks, ringing.poles, gains, start, places, steps, keep=False
    )
    return Attempt(poles=moved, gains=own, cost=float(costs[0]), misfit=float(misfits[0]))

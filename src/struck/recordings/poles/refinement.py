"""Global fit: poles shared by all channels and hits, refined group by group.

Levenberg-Marquardt with the complex gains eliminated (variable projection). Modes far apart hardly
know of each other, so groups of overlapping modes take turns, each against the data without the
present estimate of all others (Gauss-Seidel).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise, zip_longest
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from struck.model.arrays import AnyComplex, Array, Index
from struck.model.exponentials import (
    Exponentials,
    SegmentSpectrum,
    best_gains,
    row_width,
    samples_in_rows,
)
from struck.recordings.poles.normal_equations import take_turns
from struck.recordings.poles.projection import GroupBlocks
from struck.recordings.segments import Segment

_BINS = 16.0
_WIDTHS = 8.0  # bins and half widths d / 2 pi around a mode in which it is fitted


class _Part(NamedTuple):
    """Bins of some groups in one spectrum of one segment."""

    counts: Index
    turns: AnyComplex
    data: AnyComplex
    channels: int
    length: float


def blocks_around(
    segments: Sequence[Segment], poles: AnyComplex, groups: Sequence[Index], *, data: bool = True
) -> GroupBlocks:
    """Return the bins around the modes of each group, in spectra of all segments."""
    members, starts = np.concatenate(groups), _running([len(group) for group in groups])
    owners = np.repeat(np.arange(len(groups)), np.diff(starts))
    slowest = np.minimum.reduceat(-poles.real[members], starts[:-1])
    middles = np.add.reduceat(poles.imag[members], starts[:-1]) / (2 * np.pi * np.diff(starts))
    numbers = np.zeros((len(groups), len(segments)), np.int64)
    parts: list[_Part] = []
    weights: list[Array] = []
    first = 0
    for place, segment in enumerate(segments):
        levels = segment.levels(slowest)
        lengths = np.array([each.length for each in segment.spectra])
        weights.append(1 / (segment.noise.at(middles) * lengths[levels]))
        for level in np.unique(levels):
            these = np.flatnonzero(levels == level)
            part = _part(segment.spectra[level], poles, members, owners, these)
            parts.append(part if data else part._replace(data=part.data[:0]))
            numbers[these, place] = first + np.arange(len(these))
            first += len(these)
    counts = np.concatenate([part.counts for part in parts])
    channels = np.repeat([part.channels for part in parts], [len(part.counts) for part in parts])
    return GroupBlocks(
        members=members,
        starts=starts,
        numbers=numbers,
        firsts=_running(counts),
        offsets=_running(counts * channels),
        turns=np.concatenate([part.turns for part in parts]),
        data=np.concatenate([part.data.ravel() for part in parts]),
        lengths=np.repeat([part.length for part in parts], [len(part.counts) for part in parts]),
        weights=np.concatenate(weights),
        rows=_running([len(segment.samples) for segment in segments]),
        sample_rate=float(segments[0].sample_rate),
    )


def _part(
    spectrum: SegmentSpectrum, poles: AnyComplex, members: Index, owners: Index, groups: Index
) -> _Part:
    """Return the bins around the modes, members, of some groups, their owners."""
    numbers = np.full(owners[-1] + 1, -1)
    numbers[groups] = np.arange(len(groups))
    here = numbers[owners] >= 0
    poles, places = poles[members[here]], numbers[owners[here]]
    middles = poles.imag / (2 * np.pi * spectrum.spacing)
    reach = np.maximum(_BINS, _WIDTHS * -poles.real / (2 * np.pi * spectrum.spacing))
    last = len(spectrum.values) - 2
    low = np.clip(np.ceil(middles - reach), 1, last).astype(np.int64)
    high = np.clip(np.floor(middles + reach), 1, last).astype(np.int64)
    bins, counts = bins_around(low, high, places, len(groups))
    return _Part(
        counts=counts,
        turns=spectrum.turns[bins],
        data=spectrum.values[bins],
        channels=spectrum.values.shape[1],
        length=spectrum.length / spectrum.sample_rate,
    )


def bins_around(low: Index, high: Index, owners: Index, count: int) -> tuple[Index, Index]:
    """Return the bins from low to high (M,) of any mode of each owner, and their number (count,).

    Owners ascend.
    """
    order = np.lexsort((low, owners))
    shift = (high.max() + 1) * owners  # owners do not meet on one axis
    begins, ends = low[order] + shift, high[order] + shift + 1
    begins[1:] = np.maximum(begins[1:], np.maximum.accumulate(ends)[:-1])
    sizes = np.maximum(ends - begins, 0)
    bins = np.repeat(begins - shift - sizes.cumsum() + sizes, sizes) + np.arange(sizes.sum())
    return bins, np.bincount(owners, sizes, count).astype(np.int64)


def _running(counts: Sequence[int] | Index) -> Index:
    return np.concatenate(([0], np.cumsum(counts))).astype(np.int64)


_COUPLED = 0.01  # squared correlation
_MOST = 16  # modes of a group
_FEW = 6  # modes of groups that are joined


def overlap(left: AnyComplex, right: AnyComplex, duration: float) -> Array:
    """Return squared correlations of exponentials, 1 for equal poles: 4 d1 d2 / |conj(s1) + s2|^2.

    In a recording of this duration, s, even undamped modes overlap.
    """
    one, other = np.maximum(-left.real, 2 / duration), np.maximum(-right.real, 2 / duration)
    return 4 * one * other / ((one + other) ** 2 + (left.imag - right.imag) ** 2)


def overlaps(poles: AnyComplex, duration: float) -> Array:
    """Return the squared correlations of modes with each other, (M, M)."""
    return overlap(poles[:, None], poles, duration)


def overlapping(poles: AnyComplex, duration: float, coupled: float = _COUPLED) -> list[Index]:
    """Return groups of modes with squared correlations beyond `coupled`, by frequency.

    The threshold rises until groups are small enough to be fitted at once.
    """
    if not poles.size:
        return []
    labels = labelled(overlaps(poles, duration), coupled, _MOST)
    order = np.argsort(labels, kind="stable")
    sizes = np.bincount(labels)
    ends = np.cumsum(sizes).tolist()
    groups = [order[first:last] for first, last in pairwise([0, *ends])]
    middles = np.bincount(labels, poles.imag) / sizes
    ascending = [groups[label] for label in np.argsort(middles, kind="stable")]
    return list(_merged(ascending, np.asarray(-poles.real, float)))


def labelled(coupling: Array, threshold: float, most: int) -> Index:
    """Return the group number of each mode: modes coupled (M, M) beyond a threshold share one.

    Where more than `most` would belong together, their threshold is doubled.
    """
    left, right = np.divmod(np.flatnonzero(coupling > threshold), len(coupling))
    strengths, thresholds = coupling[left, right], np.full(len(coupling), threshold)
    while True:
        linked = strengths > thresholds[left]
        labels = _connected(left[linked], right[linked], len(coupling))
        crowded = np.bincount(labels)[labels] > most
        if not crowded.any():
            return np.cumsum(labels == np.arange(len(labels)))[labels] - 1
        thresholds[crowded] *= 2


def _connected(left: Index, right: Index, count: int) -> Index:
    """Return the lowest of all modes (count,) that each is linked with, left to right, in chains.

    With scipy's connected_components in its place a whole fit took 1.12 times as long.
    """
    lowest = np.arange(count)
    while True:
        before = lowest.copy()
        np.minimum.at(lowest, left, lowest[right])
        lowest = lowest[lowest]
        if np.array_equal(lowest, before):
            return lowest


def _merged(groups: list[Index], decays: Array) -> Iterator[Index]:
    """Yield groups, small neighbours of like decays joined: fewer and larger matrix products."""
    sizes = [len(group) for group in groups]
    starts = np.cumsum([0, *sizes[:-1]])
    lowest = np.minimum.reduceat(decays[np.concatenate(groups)], starts).tolist()
    highest = np.maximum.reduceat(decays[np.concatenate(groups)], starts).tolist()
    first, low, high = 0, lowest[0], highest[0]
    for place in range(1, len(groups)):
        low, high = min(low, lowest[place]), max(high, highest[place])
        if sum(sizes[first : place + 1]) > _FEW or high >= 3 * low:
            yield np.concatenate(groups[first:place])
            first, low, high = place, lowest[place], highest[place]
    yield np.concatenate(groups[first:])


_WITNESSES, _EVERY = 4, 4  # number of channels, and step between rows of samples, that are compared
_WORSE = 1.05  # largest growth of the residual by one sweep
_TOUCHING = 1e-3  # squared correlation from which a mode that moved calls its neighbour up again


def refine(
    segments: Sequence[Segment], ringing: Exponentials, sweeps: int, steps: int = 2
) -> Exponentials:
    """Move the poles to the least squares of all segments; 0 steps fit the gains alone.

    Each group gets a turn of some steps of Levenberg and Marquardt in every sweep.
    """
    duration = max(segment.duration for segment in segments)
    if not steps:
        return with_best_gains(segments, ringing)
    energy = residual_energy(segments, ringing)
    unsettled = np.ones(ringing.count, bool)
    for _ in range(sweeps):
        groups = [group for group in overlapping(ringing.poles, duration) if unsettled[group].any()]
        if not groups:
            break
        moved = _swept(segments, ringing, groups, steps)
        unsettled = _touched(ringing.poles, moved.poles, duration)
        now = residual_energy(segments, moved)
        if not now < _WORSE * energy:
            moved = with_best_gains(segments, moved)
            now = residual_energy(segments, moved)
        if not now < _WORSE * energy:
            break
        ringing, energy = moved, now
    return ringing


def _touched(before: AnyComplex, after: AnyComplex, duration: float) -> NDArray[np.bool_]:
    """Return which modes moved, or overlap with one that did."""
    changed = before != after
    return changed | (overlaps(after, duration)[:, changed] > _TOUCHING).any(axis=1)


def with_best_gains(
    segments: Sequence[Segment], ringing: Exponentials, sums: Sequence[AnyComplex | None] = ()
) -> Exponentials:
    """Return a copy whose gains are the least squares of all samples; sums as in `best_gains`."""
    if not ringing.count:
        return ringing
    known = zip_longest(segments, sums)
    gains = [best_gains(ringing.poles, at.samples, at.sample_rate, own) for at, own in known]
    return Exponentials(poles=ringing.poles, gains=np.vstack(gains))


def residual_energy(segments: Sequence[Segment], ringing: Exponentials) -> float:
    """Return the residual over the noise in some channels and samples: enough to see growth."""
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
    segments: Sequence[Segment], ringing: Exponentials, groups: Sequence[Index], steps: int
) -> Exponentials:
    """Refine the poles of each group once, in turn."""
    poles, gains = ringing.poles.copy(), ringing.gains.copy(order="C")
    blocks = blocks_around(segments, poles, groups)
    take_turns(blocks, poles, gains, poles[blocks.members], blocks.starts, steps, keep=True)
    return Exponentials(poles=poles, gains=gains)


class Attempt(NamedTuple):
    """Refined poles in the place of a group's, with their gains and residual."""

    poles: AnyComplex  # (M,)
    gains: AnyComplex  # (C, M)
    cost: float  # residual energy over the noise's in a bin
    misfit: float  # the same a bin and channel; 1 where chance may explain it


def settled(blocks: GroupBlocks, ringing: Exponentials, start: AnyComplex, steps: int) -> Attempt:
    """Refine other start poles in the place of the only group of some blocks."""
    gains, places = np.ascontiguousarray(ringing.gains), np.array([0, len(start)])
    moved, own, costs, misfits = take_turns(
        blocks, np.ascontiguousarray(ringing.poles), gains, start, places, steps, keep=False
    )
    return Attempt(poles=moved, gains=own, cost=float(costs[0]), misfit=float(misfits[0]))

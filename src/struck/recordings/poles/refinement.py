"""Global fit: poles shared by all channels and hits, refined group by group.

Levenberg-Marquardt with the complex gains eliminated (variable projection). Modes far apart
have little effect on each other, so groups of overlapping modes are refined in turn, each against
the data without the present estimate of all others (Gauss-Seidel).
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
    min_decays = np.minimum.reduceat(-poles.real[members], starts[:-1])
    centres = np.add.reduceat(poles.imag[members], starts[:-1]) / (2 * np.pi * np.diff(starts))
    numbers = np.zeros((len(groups), len(segments)), np.int64)
    parts: list[_Part] = []
    weights: list[Array] = []
    first = 0
    for place, segment in enumerate(segments):
        levels = segment.levels(min_decays)
        lengths = np.array([spectrum.length for spectrum in segment.spectra])
        weights.append(1 / (segment.noise.at(centres) * lengths[levels]))
        for level in np.unique(levels):
            group_numbers = np.flatnonzero(levels == level)
            part = _part(segment.spectra[level], poles, members, owners, group_numbers)
            parts.append(part if data else part._replace(data=part.data[:0]))
            numbers[group_numbers, place] = first + np.arange(len(group_numbers))
            first += len(group_numbers)
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
    is_member = numbers[owners] >= 0
    poles, places = poles[members[is_member]], numbers[owners[is_member]]
    centres = poles.imag / (2 * np.pi * spectrum.spacing)
    reach = np.maximum(_BINS, _WIDTHS * -poles.real / (2 * np.pi * spectrum.spacing))
    last = len(spectrum.values) - 2
    low = np.clip(np.ceil(centres - reach), 1, last).astype(np.int64)
    high = np.clip(np.floor(centres + reach), 1, last).astype(np.int64)
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


_MIN_CORRELATION = 0.01  # squared correlation
_MAX_GROUP_SIZE = 16  # modes of a group
_MAX_MERGED_SIZE = 6  # modes of groups that are joined


def overlap(left: AnyComplex, right: AnyComplex, duration: float) -> Array:
    """Return squared correlations of exponentials, 1 for equal poles: 4 d1 d2 / |conj(s1) + s2|^2.

    In a recording of this duration, s, even undamped modes overlap.
    """
    left_decays, right_decays = (
        np.maximum(-left.real, 2 / duration),
        np.maximum(-right.real, 2 / duration),
    )
    return (
        4
        * left_decays
        * right_decays
        / ((left_decays + right_decays) ** 2 + (left.imag - right.imag) ** 2)
    )


def overlaps(poles: AnyComplex, duration: float) -> Array:
    """Return the squared correlations of modes with each other, (M, M)."""
    return overlap(poles[:, None], poles, duration)


def find_groups(
    poles: AnyComplex, duration: float, threshold: float = _MIN_CORRELATION
) -> list[Index]:
    """Return groups of modes with squared correlations beyond `threshold`, by frequency.

    The threshold rises until groups are small enough to be fitted at once.
    """
    if not poles.size:
        return []
    labels = label_groups(overlaps(poles, duration), threshold, _MAX_GROUP_SIZE)
    order = np.argsort(labels, kind="stable")
    sizes = np.bincount(labels)
    ends = np.cumsum(sizes).tolist()
    groups = [order[first:last] for first, last in pairwise([0, *ends])]
    centres = np.bincount(labels, poles.imag) / sizes
    ascending = [groups[label] for label in np.argsort(centres, kind="stable")]
    return list(_merge_small(ascending, np.asarray(-poles.real, float)))


def label_groups(coupling: Array, threshold: float, max_count: int) -> Index:
    """Return the group number of each mode: modes coupled (M, M) beyond a threshold share one.

    If a group would have more than `max_count` modes, their threshold is doubled.
    """
    left, right = np.divmod(np.flatnonzero(coupling > threshold), len(coupling))
    strengths, thresholds = coupling[left, right], np.full(len(coupling), threshold)
    while True:
        is_linked = strengths > thresholds[left]
        labels = _label_connected(left[is_linked], right[is_linked], len(coupling))
        is_in_large_group = np.bincount(labels)[labels] > max_count
        if not is_in_large_group.any():
            return np.cumsum(labels == np.arange(len(labels)))[labels] - 1
        thresholds[is_in_large_group] *= 2


def _label_connected(left: Index, right: Index, count: int) -> Index:
    """Return the lowest of all modes (count,) that each is linked with, left to right, in chains.

    With scipy's connected_components in its place a whole fit took 1.12 times as long.
    """
    labels = np.arange(count)
    while True:
        previous_labels = labels.copy()
        np.minimum.at(labels, left, labels[right])
        labels = labels[labels]
        if np.array_equal(labels, previous_labels):
            return labels


def _merge_small(groups: list[Index], decays: Array) -> Iterator[Index]:
    """Yield groups, small neighbours of like decays joined: fewer and larger matrix products."""
    sizes = [len(group) for group in groups]
    starts = np.cumsum([0, *sizes[:-1]])
    min_decays = np.minimum.reduceat(decays[np.concatenate(groups)], starts).tolist()
    max_decays = np.maximum.reduceat(decays[np.concatenate(groups)], starts).tolist()
    first, low, high = 0, min_decays[0], max_decays[0]
    for place in range(1, len(groups)):
        low, high = min(low, min_decays[place]), max(high, max_decays[place])
        if sum(sizes[first : place + 1]) > _MAX_MERGED_SIZE or high >= 3 * low:
            yield np.concatenate(groups[first:place])
            first, low, high = place, min_decays[place], max_decays[place]
    yield np.concatenate(groups[first:])


_WITNESSES = 4  # number of channels that are compared
_ROW_STEP = 4  # step between rows of samples that are compared
_MAX_GROWTH = 1.05  # largest growth of the residual by one sweep
_MIN_OVERLAP = 1e-3  # squared correlation from which the neighbour of a changed mode is refined


def refine(
    segments: Sequence[Segment], ringing: Exponentials, sweeps: int, steps: int = 2
) -> Exponentials:
    """Refine the poles by least squares over all segments; 0 steps fit the gains alone.

    Each group gets a turn of some steps of Levenberg and Marquardt in every sweep.
    """
    duration = max(segment.duration for segment in segments)
    if not steps:
        return with_best_gains(segments, ringing)
    energy = residual_energy(segments, ringing)
    is_unsettled = np.ones(ringing.count, bool)
    for _ in range(sweeps):
        groups = [
            group for group in find_groups(ringing.poles, duration) if is_unsettled[group].any()
        ]
        if not groups:
            break
        candidate = _sweep(segments, ringing, groups, steps)
        is_unsettled = _find_touched(ringing.poles, candidate.poles, duration)
        new_energy = residual_energy(segments, candidate)
        if not new_energy < _MAX_GROWTH * energy:
            candidate = with_best_gains(segments, candidate)
            new_energy = residual_energy(segments, candidate)
        if not new_energy < _MAX_GROWTH * energy:
            break
        ringing, energy = candidate, new_energy
    return ringing


def _find_touched(
    old_poles: AnyComplex, new_poles: AnyComplex, duration: float
) -> NDArray[np.bool_]:
    """Return which modes moved, or overlap with one that did."""
    has_moved = old_poles != new_poles
    return has_moved | (overlaps(new_poles, duration)[:, has_moved] > _MIN_OVERLAP).any(axis=1)


def with_best_gains(
    segments: Sequence[Segment], ringing: Exponentials, sums: Sequence[AnyComplex | None] = ()
) -> Exponentials:
    """Return a copy whose gains are the least squares of all samples; sums as in `best_gains`."""
    if not ringing.count:
        return ringing
    pairs = zip_longest(segments, sums)
    gains = [
        best_gains(ringing.poles, segment.samples, segment.sample_rate, segment_sums)
        for segment, segment_sums in pairs
    ]
    return Exponentials(poles=ringing.poles, gains=np.vstack(gains))


def residual_energy(segments: Sequence[Segment], ringing: Exponentials) -> float:
    """Return the residual over the noise in some channels and samples: enough to see growth."""
    energy = 0.0
    for segment in segments:
        witnesses = slice(None, None, -(-len(segment.samples) // _WITNESSES))
        gains, samples = ringing.gains[segment.rows][witnesses], segment.samples[witnesses]
        length = segment.samples.shape[1]
        model = samples_in_rows(ringing.poles, gains, length, segment.sample_rate, _ROW_STEP)
        width = row_width(length)
        row_count = length // width
        rows = samples[:, : row_count * width].reshape(len(samples), row_count, width)[
            :, ::_ROW_STEP
        ]
        left = ((rows - model[:, : rows.shape[1]]) ** 2).sum(axis=(1, 2))
        energy += float(left @ (1 / segment.noise.densities[witnesses].mean(axis=1)))
    return energy


def _sweep(
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


def refine_attempt(
    blocks: GroupBlocks, ringing: Exponentials, start: AnyComplex, steps: int
) -> Attempt:
    """Refine other start poles in the place of the only group of some blocks."""
    gains, places = np.ascontiguousarray(ringing.gains), np.array([0, len(start)])
    new_poles, new_gains, costs, misfits = take_turns(
        blocks, np.ascontiguousarray(ringing.poles), gains, start, places, steps, keep=False
    )
    return Attempt(poles=new_poles, gains=new_gains, cost=float(costs[0]), misfit=float(misfits[0]))

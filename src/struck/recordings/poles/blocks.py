"""Choosing the bins that hold groups of modes, in the transforms of all segments."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from struck.model.exponentials import Spectrum
from struck.recordings.poles.kernels.blocks import Blocks
from struck.recordings.poles.kernels.choosing import bins_around
from struck.recordings.takes.segment import Segment

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]

_BINS = 16.0
_WIDTHS = 8.0
"""A mode is fitted within so many bins or half widths d / 2 pi of its frequency."""


class _Part(NamedTuple):
    """Bins of some groups in one transform of one segment."""

    groups: Index
    counts: Index
    turns: Complex
    data: Complex
    channels: int
    length: float


def blocks_around(segments: Sequence[Segment], poles: Complex, groups: Sequence[Index]) -> Blocks:
    """Choose and read the bins around the modes of each group."""
    members, starts = np.concatenate(groups), _running([len(group) for group in groups])
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
            parts.append(_part(segment.spectra[level], poles, members, starts, these))
            numbers[these, place] = first + np.arange(len(these))
            first += len(these)
    counts = np.concatenate([part.counts for part in parts])
    channels = np.repeat([part.channels for part in parts], [len(part.counts) for part in parts])
    return Blocks(
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
    spectrum: Spectrum, poles: Complex, members: Index, starts: Index, groups: Index
) -> _Part:
    middles = poles.imag / (2 * np.pi * spectrum.spacing)
    reach = np.maximum(_BINS, _WIDTHS * -poles.real / (2 * np.pi * spectrum.spacing))
    last = len(spectrum.values) - 2
    low = np.clip(np.ceil(middles - reach), 1, last).astype(np.int64)
    high = np.clip(np.floor(middles + reach), 1, last).astype(np.int64)
    bins, counts = bins_around(low, high, members, starts, groups)
    return _Part(
        groups=groups,
        counts=counts,
        turns=np.exp((-2j * np.pi / spectrum.length) * bins),
        data=spectrum.values[bins],
        channels=spectrum.values.shape[1],
        length=spectrum.length / spectrum.sample_rate,
    )


def _running(counts: Sequence[int] | Index) -> Index:
    return np.concatenate(([0], np.cumsum(counts))).astype(np.int64)

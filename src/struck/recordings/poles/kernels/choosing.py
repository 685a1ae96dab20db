"""Compiled: which bins lie around the modes of a group."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.recordings.poles.kernels.compiling import jitted, jitted_within

Index = NDArray[np.int64]
Scalar = Any
"""An element of an array."""


@jitted
def bins_around(
    low: Index, high: Index, members: Index, starts: Index, groups: Index
) -> tuple[Index, Index]:
    """Return the bins from low to high of any mode of each group, and how many each has."""
    most = 0
    for group in groups:
        for place in range(starts[group], starts[group + 1]):
            most += high[members[place]] + 1 - low[members[place]]
    bins, counts = np.empty(most, np.int64), np.empty(len(groups), np.int64)
    total = 0
    for number in range(len(groups)):
        some = members[starts[groups[number]] : starts[groups[number] + 1]]
        begun, following = total, 0
        for _ in range(len(some)):
            # The lowest of those that reach beyond the last bin.
            first, last = _next_run(low, high, some, following)
            for each in range(first, last):
                bins[total] = each
                total += 1
            following = max(following, last)
        counts[number] = total - begun
    return bins[:total], counts


@jitted_within
def _next_run(low: Index, high: Index, some: Index, following: Scalar) -> tuple[Scalar, Scalar]:
    """Return from where to where the next bins run, from `following` on; none where all are had."""
    first, last = -1, -1
    for mode in some:
        begin, end = max(low[mode], following), high[mode] + 1
        if begin < end and (first < 0 or begin < first or (begin == first and end > last)):
            first, last = begin, end
    return first, last

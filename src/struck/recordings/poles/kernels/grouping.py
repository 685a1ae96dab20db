"""Compiled: which modes are coupled, directly or by way of others."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.recordings.poles.kernels.compiling import jitted, jitted_within

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@jitted
def labelled(coupling: Array, threshold: float, most: int) -> Index:
    """Return a number for the group of each mode, from 0 on.

    Parameters
    ----------
    coupling : array (M, M)
        Of modes with each other.
    threshold : float
        Modes coupled more than this belong together.
    most : int
        Where more than these would, the threshold is doubled.
    """
    labels = np.full(len(coupling), -1)
    thresholds = np.full(len(coupling), threshold)
    queue, count, first = np.empty(len(coupling), np.int64), 0, 0
    while first < len(coupling):
        if labels[first] >= 0:
            first += 1
            continue
        size = _reached(coupling, first, thresholds[first], labels, queue)
        for place in range(size):
            if size > most:
                thresholds[queue[place]] *= 2
            else:
                labels[queue[place]] = count
        count += size <= most
    return labels


@jitted_within
def _reached(coupling: Array, first: int, threshold: float, labels: Index, queue: Index) -> int:
    """Write which modes a free one reaches, by way of others; return how many."""
    free = labels < 0
    queue[0], free[first] = first, False
    size, place = 1, 0
    while place < size:
        here = coupling[queue[place]]
        for other in range(len(coupling)):
            if free[other] and here[other] > threshold:
                queue[size], free[other] = other, False
                size += 1
        place += 1
    return size

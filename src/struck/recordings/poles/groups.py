"""Modes that overlap are fitted together, others apart."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from struck.recordings.poles.kernels.grouping import labelled

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]

_COUPLED = 0.01
_MOST = 16
_FEW = 6


def overlap(left: Complex, right: Complex, duration: float) -> Array:
    """Return the squared correlations of exponentials, 1 for equal poles.

    Parameters
    ----------
    left, right : arrays, complex
        Poles -d + 2 pi i f, 1/s, that broadcast with each other.
    duration : float
        Length of the recording, s: in it even undamped modes overlap.

    Returns
    -------
    array
        4 d1 d2 / |conj(s1) + s2|^2.
    """
    one, other = np.maximum(-left.real, 2 / duration), np.maximum(-right.real, 2 / duration)
    return 4 * one * other / ((one + other) ** 2 + (left.imag - right.imag) ** 2)


def overlaps(poles: Complex, duration: float) -> Array:
    """Return the squared correlations of modes with each other, (M, M), as `overlap` does."""
    return overlap(poles[:, None], poles, duration)


def overlapping(poles: Complex, duration: float, coupled: float = _COUPLED) -> list[Index]:
    """Return groups of modes that overlap, in ascending order of frequency.

    Parameters
    ----------
    poles : array (M,), complex
        -d + 2 pi i f, 1/s.
    duration : float
        Length of the recording, s.
    coupled : float
        Modes whose squared correlation exceeds this belong together, as far as groups stay small
        enough to be fitted at once.
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


def _merged(groups: list[Index], decays: Array) -> Iterator[Index]:
    """Join small neighbours that last about as long: fewer and larger products of matrices."""
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

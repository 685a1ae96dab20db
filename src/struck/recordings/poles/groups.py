"""Modes that overlap are fitted together, others apart."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]

_COUPLED = 0.01
_MOST = 16
_FEW = 6


def overlaps(poles: Complex, duration: float) -> Array:
    """Return the squared correlations of the modes' exponentials, (M, M).

    Parameters
    ----------
    poles : array (M,), complex
        -d + 2 pi i f, 1/s.
    duration : float
        Length of the recording, s: in it even undamped modes overlap.

    Returns
    -------
    array (M, M)
        4 d1 d2 / |conj(s1) + s2|^2: 1 for equal poles.
    """
    decays = np.maximum(-poles.real, 2 / duration)
    apart = np.subtract.outer(poles.imag, poles.imag)
    return 4 * np.outer(decays, decays) / (np.add.outer(decays, decays) ** 2 + apart**2)


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
    groups = _split(np.arange(len(poles)), overlaps(poles, duration), coupled)
    groups = sorted(groups, key=lambda group: float(poles[group].imag.mean()))
    return list(_merged(groups, np.asarray(-poles.real, float)))


def _split(group: Index, overlap: Array, threshold: float) -> Iterator[Index]:
    close = overlap[np.ix_(group, group)] > threshold
    count, labels = connected_components(close, directed=False)
    for label in range(count):
        part = group[labels == label]
        if len(part) <= _MOST:
            yield part
        else:
            yield from _split(part, overlap, 2 * threshold)


def _merged(groups: list[Index], decays: Array) -> Iterator[Index]:
    """Join small neighbours that last about as long: fewer and larger products of matrices."""
    held = groups[0]
    for group in groups[1:]:
        both = np.concatenate((held, group))
        if len(both) <= _FEW and np.ptp(np.log(decays[both])) < np.log(3):
            held = both
        else:
            yield held
            held = group
    yield held

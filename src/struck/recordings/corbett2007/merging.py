"""One set of modes for many recordings, as in 2007 (section 3.2): merge what sounds the same."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SharedModes:
    """Modes of one or several recordings.

    Parameters
    ----------
    frequencies : array (M,)
        Ringing, ascending, Hz.
    decays : array (M,)
        1/s.
    gains : array (recordings, M), complex
        g of Im[g exp((-d + 2 pi i f) t)]; 0 where a recording does not have the mode. The paper's
        own gain is the absolute value: its eq. 1 has no phase.
    """

    frequencies: Array
    decays: Array
    gains: Complex


def inaudible_difference(frequencies: ArrayLike) -> Array:
    """Return how far apart frequencies may be and still sound the same, Hz.

    4 Hz below 2 kHz, (f - 2 kHz) / 250 + 4 Hz above (2007, section 3.2; a fit to Shower & Biddulph
    1931).
    """
    return 4 + np.maximum(np.asarray(frequencies, float) - 2000, 0) / 250


def merged(recordings: Sequence[SharedModes]) -> SharedModes:
    """Give the modes of separate recordings common frequencies and decays.

    From the strongest mode on, each takes from every other recording the nearest one left that
    sounds the same, if there is any. They share their mean frequency and the decay of the
    strongest; modes of one recording are never merged.

    Parameters
    ----------
    recordings : sequence of SharedModes
        Each with any number of rows of gains.

    Returns
    -------
    SharedModes
        With the rows of all recordings, in order.
    """
    rows = np.cumsum([0, *(len(each.gains) for each in recordings)])
    owners = np.repeat(np.arange(len(recordings)), [len(each.decays) for each in recordings])
    frequencies = np.concatenate([each.frequencies for each in recordings])
    decays = np.concatenate([each.decays for each in recordings])
    gains = np.zeros((rows[-1], len(owners)), np.complex128)
    for number, each in enumerate(recordings):
        gains[rows[number] : rows[number + 1], owners == number] = each.gains
    groups = _groups(frequencies, owners, np.abs(gains).max(axis=0, initial=0.0))
    means = np.array([frequencies[group].mean() for group in groups])
    order = np.argsort(means, kind="stable")
    leaders = np.array([groups[place][0] for place in order], np.int64)
    common = [gains[:, groups[place]].sum(axis=1) for place in order]
    return SharedModes(
        frequencies=means[order],
        decays=decays[leaders],
        gains=np.array(common, np.complex128).reshape(len(order), len(gains)).T,
    )


def _groups(frequencies: Array, owners: Index, strengths: Array) -> list[Index]:
    """Return which modes belong together, the strongest of each group first."""
    left = np.ones(len(frequencies), np.bool_)
    groups: list[Index] = []
    for leader in np.argsort(-strengths, kind="stable"):
        if left[leader]:
            group = _group(int(leader), frequencies, owners, left)
            left[group] = False
            groups.append(group)
    return groups


def _group(leader: int, frequencies: Array, owners: Index, left: NDArray[np.bool_]) -> Index:
    """Return the leader and the nearest mode of each other recording that sounds the same."""
    distances = np.abs(frequencies - frequencies[leader])
    close = left & (distances < inaudible_difference(frequencies[leader]))
    others = np.flatnonzero(close & (owners != owners[leader]))
    others = others[np.argsort(distances[others], kind="stable")]
    _, first = np.unique(owners[others], return_index=True)
    return np.concatenate([[leader], others[first]]).astype(np.int64)

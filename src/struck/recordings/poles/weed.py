"""Weak modes beside strong ones that are not needed once the strong ones are fitted without them.

What a mode alone explains is told with all others as they are. Beside a strong mode that misleads:
its pole has moved to make room, and would do without its neighbour where it stood before.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from struck.model.exponentials import Ringing
from struck.recordings.poles.blocks import blocks_around
from struck.recordings.poles.groups import overlap
from struck.recordings.poles.refinement import settled
from struck.recordings.poles.selection import energies, significance
from struck.recordings.takes.segment import Segment

_WEAK = 0.1
"""Of the amplitude of a mode that it overlaps with."""
_ALIKE, _LOUD = 0.03, 2.0
"""A mode of which others can stand for all but this share of its energy, and so many times as loud
as the loudest sample, is there to cancel them."""
_COMPANY, _CLOSE = 6, 0.02
_STEPS = 12
_PROVEN = 1e-5


def weeded(segments: Sequence[Segment], ringing: Ringing) -> Ringing:
    """Drop weak modes whose neighbours explain as much alone, but for what noise would.

    Parameters
    ----------
    segments : sequence of Segment
        All channels and hits.
    ringing : Ringing
        Refined.

    Returns
    -------
    Ringing
        Neighbours of what went are refined, with new gains.
    """
    duration = max(segment.duration for segment in segments)
    ringing = _uncrowded(segments, ringing)
    for pole in ringing.poles[np.argsort(np.abs(ringing.gains).max(axis=0))]:
        mode = int(np.argmin(np.abs(ringing.poles - pole)))
        close = overlap(pole, ringing.poles, duration)
        if ringing.poles[mode] == pole and _is_weak(ringing, mode, close):
            ringing = _without(segments, ringing, mode)
    return ringing


def _uncrowded(segments: Sequence[Segment], ringing: Ringing) -> Ringing:
    """Drop modes so much alike that gains beyond all that was heard only cancel each other."""
    peaks = np.concatenate([np.abs(each.samples).max(axis=1) for each in segments])
    while True:
        _, shares = energies(segments, ringing)
        loud = (np.abs(ringing.gains) > _LOUD * peaks[:, None]).any(axis=0)
        alike = np.flatnonzero(loud & (shares < _ALIKE))
        if not alike.size:
            return ringing
        mode = int(alike[np.argmin(shares[alike])])
        ringing = _without(segments, ringing, mode, needed=False)


def _is_weak(ringing: Ringing, mode: int, close: NDArray[np.float64]) -> bool:
    sizes = np.abs(ringing.gains).max(axis=0)
    return bool((sizes[mode] < _WEAK * sizes[close > _CLOSE]).any())


def _without(
    segments: Sequence[Segment], ringing: Ringing, mode: int, *, needed: bool = True
) -> Ringing:
    """Drop a mode, `needed` only if its neighbours, refined without it, lose as little as noise."""
    duration = max(segment.duration for segment in segments)
    close = overlap(ringing.poles[mode], ringing.poles, duration)
    group = np.argsort(-close)[:_COMPANY]
    group = group[close[group] > _CLOSE]
    blocks = blocks_around(segments, ringing.poles, [group])
    rest = group[group != mode]
    fewer = settled(blocks, ringing, ringing.poles[rest], _STEPS)
    if needed:
        whole = settled(blocks, ringing, ringing.poles[group], _STEPS)
        least = whole.misfit * significance(len(ringing.gains) + 1, _PROVEN)
        if fewer.cost - whole.cost > least:
            return ringing
    poles, gains = ringing.poles.copy(), ringing.gains.copy()
    poles[rest], gains[:, rest] = fewer.poles, fewer.gains
    return Ringing(poles=poles, gains=gains).of(np.arange(len(poles)) != mode)

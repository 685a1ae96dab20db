"""Modes so close that they pass for one: the beating pairs of nearly symmetric objects.

Two poles around their centroid s sound as a exp(s t) plus c t^2 exp(s t) / 2, to second order: the
term in between is gone when s is fitted. So what one pole leaves over is correlated with the second
derivative of its line, and the ratio c / a tells how far apart the two are, and whether in
frequency or in decay.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.model.exponentials import Ringing
from struck.recordings.poles.blocks import blocks_around
from struck.recordings.poles.groups import overlap
from struck.recordings.poles.kernels.turns import damped
from struck.recordings.poles.refinement import settled
from struck.recordings.poles.selection import significance
from struck.recordings.poles.told import told_by
from struck.recordings.takes.segment import Segment

Index = NDArray[np.int64]

_SUSPECT, _PROVEN = 1e-3, 1e-5
_STEPS = 12
_COMPANY, _CLOSE = 6, 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class _Suspect:
    mode: int
    distance: complex


def split(segments: Sequence[Segment], ringing: Ringing, fastest: float = np.inf) -> Ringing:
    """Split the modes that are two, where noise cannot be the reason.

    Parameters
    ----------
    segments : sequence of Segment
        All channels and hits.
    ringing : Ringing
        Refined.
    fastest : float
        Modes that decay faster, 1/s, are left alone.

    Returns
    -------
    Ringing
        With one mode more for each pair.
    """
    duration = max(segment.duration for segment in segments)
    for suspect in _suspects(segments, ringing, fastest):
        close = overlap(ringing.poles[suspect.mode], ringing.poles, duration)
        group = np.argsort(-close)[:_COMPANY]
        group = group[close[group] > _CLOSE]
        ringing = _tried(segments, ringing, suspect, group)
    return ringing


def _tried(
    segments: Sequence[Segment], ringing: Ringing, suspect: _Suspect, group: Index
) -> Ringing:
    """Split one mode, its neighbours giving way, if that explains more than noise would."""
    blocks = blocks_around(segments, ringing.poles, [group])
    before = settled(blocks, ringing, ringing.poles[group], 0)
    half = suspect.distance / 2
    start = np.append(ringing.poles[group], ringing.poles[suspect.mode] - half)
    start[np.flatnonzero(group == suspect.mode)] += half
    after = settled(blocks, ringing, damped(start), _STEPS)
    if before.cost - after.cost < before.misfit * significance(len(ringing.gains) + 1, _PROVEN):
        return ringing
    split_up = ringing.joined(after.poles[-1:])
    both = np.append(group, ringing.count)
    split_up.poles[both], split_up.gains[:, both] = after.poles, after.gains
    return split_up


def _suspects(segments: Sequence[Segment], ringing: Ringing, fastest: float) -> Iterator[_Suspect]:
    """Yield modes whose residual looks like a pair."""
    told = told_by(segments, ringing)
    widths = ringing.decays
    distances = np.sqrt(8 * told.crossed / np.maximum(told.whole, 1e-300))
    lengths = np.clip(np.abs(distances), 0.2 * widths, 3 * widths)
    distances *= lengths / np.maximum(np.abs(distances), 1e-30)
    least = significance(len(ringing.gains), _SUSPECT)
    suspicious = (told.energies > least) & (widths < fastest)
    for mode in told.order[suspicious[told.order]]:
        yield _Suspect(mode=int(mode), distance=complex(distances[mode]))

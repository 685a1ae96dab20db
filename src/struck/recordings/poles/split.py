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

from struck.recordings.poles.block import Block, Projection, misfit
from struck.recordings.poles.groups import overlapping, overlaps
from struck.recordings.poles.prune import significance
from struck.recordings.poles.refine import damped, settle
from struck.recordings.takes.ringing import Ringing
from struck.recordings.takes.segment import Segment

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
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
        close = overlaps(ringing.poles, duration)[suspect.mode]
        group = np.argsort(-close)[:_COMPANY]
        group = group[close[group] > _CLOSE]
        ringing = _tried(segments, ringing, suspect, group)
    return ringing


def _tried(
    segments: Sequence[Segment], ringing: Ringing, suspect: _Suspect, group: Index
) -> Ringing:
    """Split one mode, its neighbours giving way, if that explains more than noise would."""
    blocks = [Block.cleared(segment, ringing, group) for segment in segments]
    before = [Projection.of(block, ringing.poles[group]) for block in blocks]
    half = suspect.distance / 2
    start = np.append(ringing.poles[group], ringing.poles[suspect.mode] - half)
    start[np.flatnonzero(group == suspect.mode)] += half
    moved, after = settle(blocks, damped(start), _STEPS)
    won = sum(each.cost for each in before) - sum(each.cost for each in after)
    if won < misfit(before) * significance(len(ringing.gains) + 1, _PROVEN):
        return ringing
    split_up = ringing.joined(moved[-1:])
    split_up.poles[group] = moved[:-1]
    both = np.append(group, ringing.count)
    for block, each in zip(blocks, after, strict=True):
        split_up.gains[block.rows, both] = block.spectrum.gains(moved, each.residues.T)
    return split_up


def _suspects(segments: Sequence[Segment], ringing: Ringing, fastest: float) -> Iterator[_Suspect]:
    """Yield modes whose residual looks like a pair."""
    least = significance(len(ringing.gains), _SUSPECT)
    for group in overlapping(ringing.poles, max(segment.duration for segment in segments)):
        blocks = [Block.cleared(segment, ringing, group) for segment in segments]
        projections = [Projection.of(block, ringing.poles[group]) for block in blocks]
        energy, crossed, whole = map(sum, zip(*map(_curvatures, projections), strict=True))
        widths = ringing.decays[group]
        distances = np.sqrt(8 * crossed / np.maximum(whole, 1e-300))
        lengths = np.clip(np.abs(distances), 0.2 * widths, 3 * widths)
        distances *= lengths / np.maximum(np.abs(distances), 1e-30)
        for place in np.flatnonzero(energy > least * misfit(projections)):
            if widths[place] < fastest:
                yield _Suspect(mode=int(group[place]), distance=complex(distances[place]))


def _curvatures(projection: Projection) -> tuple[Array, Complex, Array]:
    """Return energies (M,) along the second derivatives and what is needed for their ratios."""
    lines, rate = projection.lines, projection.block.spectrum.sample_rate
    first = (lines * lines - lines) / rate
    shapes = (2 * lines - 1) * first / rate
    basis, _ = np.linalg.qr(np.hstack((projection.basis, first)))
    shapes -= basis @ (basis.conj().T @ shapes)
    sizes = np.maximum((np.abs(shapes) ** 2).sum(axis=0), 1e-300)
    along = shapes.conj().T @ projection.left
    weighted = projection.residues.conj() * projection.block.weights
    energies = np.abs(along) ** 2 @ projection.block.weights / sizes
    crossed = (weighted * along).sum(axis=1) / sizes
    return energies, crossed, (weighted * projection.residues).sum(axis=1).real

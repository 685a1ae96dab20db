"""Which modes to keep: those that explain what no other does."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import gamma

from struck.model.arrays import Array, Index, Mask
from struck.model.exponentials import Exponentials, correlations
from struck.perception.auditory_scale import erb_number
from struck.recordings.poles.candidates import Candidates
from struck.recordings.poles.normal_equations import SLOWEST, add_unique, damped
from struck.recordings.poles.refinement import (
    blocks_around,
    overlap,
    overlapping,
    overlaps,
    refine,
    settled,
)
from struck.recordings.poles.uncertainty import told_by
from struck.recordings.segments import Segment

# Tones of the surroundings: they sound before the hit as they do after it, and never decay.

_STEADY = 3.0
"""A tone decays by less than this many nepers in a segment."""
_SAME = 0.25
_CERTAIN = 6.0


def ambient(segments: Sequence[Segment], ringing: Exponentials) -> Mask:
    """Return which modes are tones that the lead-ins hold too, at the same level.

    Parameters
    ----------
    segments : sequence of Segment
        With what was heard before the hits.
    ringing : Ringing
        M modes.

    Returns
    -------
    array (M,), bool
        Never those that decay within a segment, or that the lead-ins are too short or too noisy
        to show.
    """
    duration = max(segment.duration for segment in segments)
    steady = ringing.decays * duration < _STEADY
    tones = ringing.of(steady)
    heard, expected, channels = np.zeros(tones.count), np.zeros(tones.count), 0
    for segment in segments:
        if segment.before.shape[1]:
            there, here = _energies(segment, tones)
            heard, expected = heard + there, expected + here
            channels += len(segment.before)
    steady[steady] = (expected > _CERTAIN * max(channels, 1)) & (heard > _SAME * expected)
    return steady


def _energies(segment: Segment, ringing: Exponentials) -> tuple[Array, Array]:
    """Return energies over noise of the tones in the lead-in: measured, and if they sound there."""
    length = segment.before.shape[1]
    window = np.hanning(length)
    sums = correlations(1j * ringing.poles.imag, segment.before * window, segment.sample_rate)
    floor = segment.noise.densities.min(axis=1)[:, None] * (window**2).sum()
    gains = np.abs(ringing.gains[segment.rows]) * window.sum() / 2
    return (np.abs(sums) ** 2 / floor).sum(axis=0), (gains**2 / floor).sum(axis=0)


CHANCE = 2e-9
"""That noise alone explains a mode: 16 dB of energy in one channel."""
_COLLINEAR = 1e-3
_LOWEST, _HIGHEST = 15.0, 0.49
"""Frequencies, Hz and of the sample rate."""
_TOUCHING = 0.05
_SHARE = 2
_PER_BAND = 4


@cache
def significance(channels: int, chance: float = CHANCE) -> float:
    """Return the energy over noise that noise in so many channels exceeds by this chance.

    The energy of complex noise along one direction is exponentially distributed, its sum over
    channels a gamma distribution.
    """
    return float(gamma.isf(chance, channels))


def energies(segments: Sequence[Segment], ringing: Exponentials) -> tuple[Array, Array]:
    """Return what each mode alone explains over noise, and its share of the mode's energy."""
    duration = max(segment.duration for segment in segments)
    energy, share = np.zeros(ringing.count), np.zeros(ringing.count)
    if not ringing.count:
        return energy, share
    blocks = blocks_around(segments, ringing.poles, overlapping(ringing.poles, duration))
    add_unique(blocks, ringing.poles, np.ascontiguousarray(ringing.gains), energy, share)
    return energy, share


def strongest_per_band(segments: Sequence[Segment], found: Candidates, most: int) -> Candidates:
    """Return the candidates of most energy, at most a few in each band of hearing (ERB)."""
    frequencies = np.asarray(found.poles.imag / (2 * np.pi), float)
    order = np.argsort(-found.energies * _colour(segments, frequencies))
    bands = erb_number(frequencies[order]).astype(int)
    kept = [
        mode
        for place, mode in enumerate(order)
        if np.count_nonzero(bands[:place] == bands[place]) < _PER_BAND
    ]
    return Candidates(poles=found.poles[kept[:most]], energies=found.energies[kept[:most]])


def _colour(segments: Sequence[Segment], frequencies: Array) -> Array:
    """Return the noise's density at frequencies over its mean: it turns ratios into energies."""
    parts = [
        segment.noise.at(frequencies) / (segment.noise.energy(1)[:, None]) for segment in segments
    ]
    return np.concatenate(parts).mean(axis=0)


def prune(
    segments: Sequence[Segment],
    ringing: Exponentials,
    *,
    budget: int | None = None,
    least: float | None = None,
) -> Exponentials:
    """Drop modes that noise, or other modes, could stand for.

    Parameters
    ----------
    segments : sequence of Segment
        With the noise to compare with.
    ringing : Ringing
        Fitted modes.
    budget : int, optional
        Not more modes than these: the weakest go first.
    least : float, optional
        Energy over noise that a mode must explain alone; `significance` unless given.

    Returns
    -------
    Ringing
        The gains fitted anew.
    """
    least = significance(len(ringing.gains)) if least is None else least
    while ringing.count:
        energy, share = energies(segments, ringing)
        bad = (energy < least) | (share < _COLLINEAR) | _impossible(ringing, segments)
        excess = ringing.count - budget if budget is not None else 0
        if excess > 0:
            rank = energy * _colour(segments, ringing.frequencies)
            bad[np.argsort(rank)[: max(1, min(excess, ringing.count // _SHARE))]] = True
        if not bad.any():
            break
        ringing = ringing.of(~_apart(bad, energy, ringing, segments))
        ringing = refine(segments, ringing, sweeps=2, steps=0)
    return ringing


def _impossible(ringing: Exponentials, segments: Sequence[Segment]) -> Mask:
    highest = _HIGHEST * max(segment.sample_rate for segment in segments)
    outside = (ringing.frequencies < _LOWEST) | (ringing.frequencies > highest)
    # A tone that never decays may be of the surroundings; one beside others makes up for a body
    # that changed from hit to hit.
    steady = ringing.decays < 1.01 * SLOWEST
    close = overlaps(ringing.poles, max(segment.duration for segment in segments))
    return outside | (steady & ((close > _TOUCHING).sum(axis=1) > 1))


def _apart(bad: Mask, energy: Array, ringing: Exponentials, segments: Sequence[Segment]) -> Mask:
    """Choose among bad modes the weakest of each that touch: its neighbour may do without it."""
    duration = max(segment.duration for segment in segments)
    touching = overlaps(ringing.poles, duration) > _TOUCHING
    chosen = np.zeros(ringing.count, bool)
    for mode in np.flatnonzero(bad)[np.argsort(energy[bad])]:
        chosen[mode] = not (touching[mode] & chosen).any()
    return chosen


# Modes so close that they pass for one: the beating pairs of nearly symmetric objects.
#
# Two poles around their centroid s sound as a exp(s t) plus c t^2 exp(s t) / 2, to second order:
# the term in between is gone when s is fitted. So what one pole leaves over is correlated with the
# second derivative of its line, and the ratio c / a tells how far apart the two are, and whether in
# frequency or in decay.

_SUSPECT, _SPLIT_PROVEN = 1e-3, 1e-5
_STEPS = 12
_SPLIT_COMPANY, _SPLIT_CLOSE = 6, 0.05


@dataclass(frozen=True, slots=True, kw_only=True)
class _Suspect:
    mode: int
    distance: complex


def split(
    segments: Sequence[Segment], ringing: Exponentials, fastest: float = np.inf
) -> Exponentials:
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
        group = np.argsort(-close)[:_SPLIT_COMPANY]
        group = group[close[group] > _SPLIT_CLOSE]
        ringing = _tried(segments, ringing, suspect, group)
    return ringing


def _tried(
    segments: Sequence[Segment], ringing: Exponentials, suspect: _Suspect, group: Index
) -> Exponentials:
    """Split one mode, its neighbours giving way, if that explains more than noise would."""
    blocks = blocks_around(segments, ringing.poles, [group])
    before = settled(blocks, ringing, ringing.poles[group], 0)
    half = suspect.distance / 2
    start = np.append(ringing.poles[group], ringing.poles[suspect.mode] - half)
    start[np.flatnonzero(group == suspect.mode)] += half
    after = settled(blocks, ringing, damped(start), _STEPS)
    if before.cost - after.cost < before.misfit * significance(
        len(ringing.gains) + 1, _SPLIT_PROVEN
    ):
        return ringing
    split_up = ringing.joined(after.poles[-1:])
    both = np.append(group, ringing.count)
    split_up.poles[both], split_up.gains[:, both] = after.poles, after.gains
    return split_up


def _suspects(
    segments: Sequence[Segment], ringing: Exponentials, fastest: float
) -> Iterator[_Suspect]:
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


# Weak modes beside strong ones that are not needed once the strong ones are fitted without them.
#
# What a mode alone explains is told with all others as they are. Beside a strong mode that
# misleads: its pole has moved to make room, and would do without its neighbour where it stood
# before.

_WEAK = 0.1
"""Of the amplitude of a mode that it overlaps with."""
_ALIKE, _LOUD = 0.03, 2.0
"""A mode of which others can stand for all but this share of its energy, and so many times as loud
as the loudest sample, is there to cancel them."""
_COMPANY, _CLOSE = 6, 0.02
_PROVEN = 1e-5


def weeded(segments: Sequence[Segment], ringing: Exponentials) -> Exponentials:
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


def _uncrowded(segments: Sequence[Segment], ringing: Exponentials) -> Exponentials:
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


def _is_weak(ringing: Exponentials, mode: int, close: NDArray[np.float64]) -> bool:
    sizes = np.abs(ringing.gains).max(axis=0)
    return bool((sizes[mode] < _WEAK * sizes[close > _CLOSE]).any())


def _without(
    segments: Sequence[Segment], ringing: Exponentials, mode: int, *, needed: bool = True
) -> Exponentials:
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
    return Exponentials(poles=poles, gains=gains).of(np.arange(len(poles)) != mode)

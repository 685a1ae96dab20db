"""Which modes to keep: those that explain what no other does."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import gamma

from struck.model.exponentials import Ringing
from struck.perception.auditory_scale import erb_number
from struck.recordings.poles.blocks import blocks_around
from struck.recordings.poles.candidates import Candidates
from struck.recordings.poles.groups import overlapping, overlaps
from struck.recordings.poles.kernels.turns import SLOWEST
from struck.recordings.poles.normal_equations import add_unique
from struck.recordings.poles.refinement import refine
from struck.recordings.takes.segment import Segment

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

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


def energies(segments: Sequence[Segment], ringing: Ringing) -> tuple[Array, Array]:
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
    ringing: Ringing,
    *,
    budget: int | None = None,
    least: float | None = None,
) -> Ringing:
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


def _impossible(ringing: Ringing, segments: Sequence[Segment]) -> Mask:
    highest = _HIGHEST * max(segment.sample_rate for segment in segments)
    outside = (ringing.frequencies < _LOWEST) | (ringing.frequencies > highest)
    # A tone that never decays may be of the surroundings; one beside others makes up for a body
    # that changed from hit to hit.
    steady = ringing.decays < 1.01 * SLOWEST
    close = overlaps(ringing.poles, max(segment.duration for segment in segments))
    return outside | (steady & ((close > _TOUCHING).sum(axis=1) > 1))


def _apart(bad: Mask, energy: Array, ringing: Ringing, segments: Sequence[Segment]) -> Mask:
    """Choose among bad modes the weakest of each that touch: its neighbour may do without it."""
    duration = max(segment.duration for segment in segments)
    touching = overlaps(ringing.poles, duration) > _TOUCHING
    chosen = np.zeros(ringing.count, bool)
    for mode in np.flatnonzero(bad)[np.argsort(energy[bad])]:
        chosen[mode] = not (touching[mode] & chosen).any()
    return chosen

"""One global fit: poles shared by all channels and hits, refined group by group.

Levenberg-Marquardt with the complex gains eliminated (variable projection). Modes far apart hardly
know of each other, so groups of overlapping modes take turns, each against the data without the
present estimate of all others (Gauss-Seidel).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from struck.recordings.poles.block import Block, Projection
from struck.recordings.poles.groups import overlapping, overlaps
from struck.recordings.takes.ringing import Ringing, best_gains, samples
from struck.recordings.takes.segment import Segment

Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]

SLOWEST = 0.02
"""Least decay rate, 1/s."""
FASTEST = 1500.0
"""Largest decay rate, 1/s."""
LEAST_Q = 2.0
"""Least pi f / d."""
_SETTLED = 1e-3
"""A group rests when a step promises to lower its cost by no more than this, noise being 1."""
_TRIES = 4
_WITNESSES = 4
_WORSE = 1.05
"""A group that gets better may make the whole a little worse, for a while."""
_TOUCHING = 1e-3
"""Squared correlation from which a mode that moved calls its neighbour up again."""


def refine(segments: Sequence[Segment], ringing: Ringing, sweeps: int, steps: int = 2) -> Ringing:
    """Move the poles to the least squares of all segments together.

    Parameters
    ----------
    segments : sequence of Segment
        All channels and hits.
    ringing : Ringing
        Where to start.
    sweeps : int
        How often each group gets its turn.
    steps : int
        Steps of Levenberg and Marquardt in one turn; 0 fits the gains alone.

    Returns
    -------
    Ringing
    """
    duration = max(segment.duration for segment in segments)
    if not steps:
        return with_best_gains(segments, ringing)
    energy = left_over(segments, ringing)
    unsettled = np.ones(ringing.count, bool)
    for _ in range(sweeps):
        groups = [
            group for group in overlapping(ringing.poles, duration) if unsettled[group].any()
        ]
        if not groups:
            break
        moved = _swept(segments, ringing, groups, steps)
        unsettled = _touched(ringing.poles, moved.poles, duration)
        now = left_over(segments, moved)
        if not now < _WORSE * energy:
            moved = with_best_gains(segments, moved)
            now = left_over(segments, moved)
        if not now < _WORSE * energy:
            break
        ringing, energy = moved, now
    return ringing


def _touched(before: Complex, after: Complex, duration: float) -> NDArray[np.bool_]:
    """Return which modes moved, or overlap with one that did."""
    changed = before != after
    return changed | (overlaps(after, duration)[:, changed] > _TOUCHING).any(axis=1)


def with_best_gains(segments: Sequence[Segment], ringing: Ringing) -> Ringing:
    """Return a copy whose gains are the least squares of all samples."""
    if not ringing.count:
        return ringing
    gains = [best_gains(ringing.poles, each.samples, each.sample_rate) for each in segments]
    return Ringing(poles=ringing.poles, gains=np.vstack(gains))


def left_over(segments: Sequence[Segment], ringing: Ringing) -> float:
    """Return the energy that a fit leaves of a few channels, each against its noise."""
    energy = 0.0
    for segment in segments:
        some = slice(None, None, -(-len(segment.samples) // _WITNESSES))
        gains = ringing.gains[segment.rows][some]
        model = samples(ringing.poles, gains, segment.samples.shape[1], segment.sample_rate)
        left = ((segment.samples[some] - model) ** 2).sum(axis=1)
        energy += float(left @ (1 / segment.noise.densities[some].mean(axis=1)))
    return energy


def _swept(
    segments: Sequence[Segment], ringing: Ringing, groups: Sequence[Index], steps: int
) -> Ringing:
    """Give each group its turn."""
    poles, gains = ringing.poles.copy(), ringing.gains.copy()
    for group in groups:
        now = Ringing(poles=poles, gains=gains)
        blocks = [Block.cleared(segment, now, group) for segment in segments]
        poles[group], projections = settle(blocks, poles[group], steps)
        for block, each in zip(blocks, projections, strict=True):
            gains[block.rows, group] = block.spectrum.gains(poles[group], each.residues.T)
    return Ringing(poles=poles, gains=gains)


def settle(blocks: list[Block], poles: Complex, steps: int) -> tuple[Complex, list[Projection]]:
    """Refine the poles of one group."""
    here, cost = _projected(blocks, poles)
    damping = 1e-3
    for _ in range(steps):
        matrix, slope = normal_equations(here)
        for _ in range(_TRIES):
            scale = np.diag(matrix).real * damping
            step = np.linalg.solve(matrix + np.diag(scale), slope)
            if not (slope.conj() @ step).real > _SETTLED:
                return poles, here
            moved = _limited(poles, step)
            there, lower = _projected(blocks, moved)
            if lower < cost:
                break
            damping *= 8
        else:
            return poles, here
        poles, here, cost = moved, there, lower
        damping = max(damping / 5, 1e-9)
    return poles, here


def _projected(blocks: list[Block], poles: Complex) -> tuple[list[Projection], float]:
    projections = [Projection.of(block, poles) for block in blocks]
    return projections, sum(each.cost for each in projections)


def normal_equations(projections: list[Projection]) -> tuple[Complex, Complex]:
    """Return matrix (M, M) and right side (M,) of all segments together."""
    matrices, slopes = zip(*(each.normal_equations() for each in projections), strict=True)
    return np.sum(matrices, axis=0), np.sum(slopes, axis=0)


def _limited(poles: Complex, step: Complex) -> Complex:
    """Step by half a decay rate at most, twice that in angular frequency, and stay damped."""
    most = np.maximum(-0.5 * poles.real, 2.0)
    real = np.clip(step.real, -most, most)
    imaginary = np.clip(step.imag, -2 * most, 2 * most)
    return damped(poles + real + 1j * imaginary)


def damped(poles: Complex) -> Complex:
    """Return poles whose decay rates are within the bounds of what can be told from a click."""
    fastest = np.minimum(FASTEST, np.maximum(np.abs(poles.imag) / (2 * LEAST_Q), 2 * SLOWEST))
    return -np.clip(-poles.real, SLOWEST, fastest) + 1j * poles.imag

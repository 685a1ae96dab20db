"""Compiled: the turns that groups take, steps of Levenberg and Marquardt."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.recordings.poles.kernels.blocks import Blocks
from struck.recordings.poles.kernels.clearing import cleared
from struck.recordings.poles.kernels.compiling import jitted, jitted_within
from struck.recordings.poles.kernels.vectors import inner, solve_damped
from struck.recordings.poles.projection import (
    Projection,
    empty_projection,
    misfit,
    normal_equations,
    project,
    span,
)

Array = NDArray[np.float64]
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


@jitted
def damped(poles: Complex) -> Complex:
    """Return poles whose decay rates are within the bounds of what can be told from a click."""
    bounded = np.empty_like(poles)
    for m in range(len(poles)):
        fastest = min(FASTEST, max(abs(poles[m].imag) / (2 * LEAST_Q), 2 * SLOWEST))
        decay = min(max(-poles[m].real, SLOWEST), fastest)
        bounded[m] = complex(-decay, poles[m].imag)
    return bounded


@jitted_within
def _stepped(poles: Complex, step: Complex) -> Complex:
    """Step by half a decay rate at most, twice that in angular frequency, and stay damped."""
    moved = np.empty_like(poles)
    for m in range(len(poles)):
        most = max(-0.5 * poles[m].real, 2.0)
        real = min(max(step[m].real, -most), most)
        imaginary = min(max(step[m].imag, -2 * most), 2 * most)
        moved[m] = poles[m] + complex(real, imaginary)
    return damped(moved)


@jitted_within
def settle(
    blocks: Blocks, group: int, data: Complex, poles: Complex, steps: int
) -> tuple[Complex, Projection, float]:
    """Refine the poles of one group by steps of Levenberg and Marquardt.

    Returns
    -------
    tuple
        The poles, what they explain and the energy left.
    """
    here = empty_projection(blocks, group, len(poles))
    there = empty_projection(blocks, group, len(poles))
    matrix, side = np.zeros((0, 0), np.complex128), np.zeros(0, np.complex128)
    moved, cost, damping, taken, tries = poles, np.inf, 5e-3, 0, 0
    while tries < _TRIES:
        lower = project(blocks, group, data, moved, there)
        if not lower >= cost:
            poles, cost = moved, lower
            here, there = there, here
            if taken == steps:
                break
            matrix, side = normal_equations(blocks, group, here)
            damping, taken, tries = max(damping / 5, 1e-9), taken + 1, 0
        else:
            damping, tries = damping * 8, tries + 1
        step = solve_damped(matrix, damping, side)
        if not inner(side, step).real > _SETTLED:
            break
        moved = _stepped(poles, step)
    return poles, here, cost


@jitted_within
def _write_gains(
    blocks: Blocks, group: int, poles: Complex, projection: Projection, gains: Complex
) -> None:
    for segment in range(blocks.numbers.shape[1]):
        length = blocks.lengths[blocks.numbers[group, segment]]
        for m in range(len(poles)):
            over = 1 / span(poles[m], length)
            for row in range(blocks.rows[segment], blocks.rows[segment + 1]):
                gains[row, m] = projection.residues[m, row] * over


@jitted
def take_turns(
    blocks: Blocks,
    poles: Complex,
    gains: Complex,
    start: Complex,
    starts: Index,
    steps: int,
    keep: bool,  # noqa: FBT001 - compiled code takes no keywords
) -> tuple[Complex, Complex, Array, Array]:
    """Refine poles in the place of each group's, against the data without all other modes.

    Parameters
    ----------
    blocks : Blocks
        Around the groups.
    poles, gains : arrays (M,) and (C, M), complex
        All modes.
    start : array (N,), complex
        Poles to start with, group by group.
    starts : array (G + 1,), int
        Where those of each group begin.
    steps : int
        Of Levenberg and Marquardt at most.
    keep : bool
        Whether each group's new poles, as many as it had, replace the old before the next one's
        turn.

    Returns
    -------
    tuple
        Poles (N,) and gains (C, N), and of each group the energy left, in units of the noise's in
        one bin, and the same a bin and channel, 1 where chance may explain it.
    """
    count = len(starts) - 1
    moved, own = np.empty_like(start), np.empty((len(gains), len(start)), np.complex128)
    costs, misfits = np.empty(count), np.empty(count)
    for group in range(count):
        first, last = starts[group], starts[group + 1]
        data = cleared(blocks, group, poles, gains)
        found, projection, cost = settle(blocks, group, data, start[first:last], steps)
        costs[group], misfits[group] = cost, misfit(projection, cost)
        _write_gains(blocks, group, found, projection, own[:, first:last])
        for m in range(last - first):
            moved[first + m] = found[m]
            if keep:
                mode = blocks.members[first + m]
                poles[mode] = found[m]
                for row in range(len(gains)):
                    gains[row, mode] = own[row, first + m]
    return moved, own, costs, misfits

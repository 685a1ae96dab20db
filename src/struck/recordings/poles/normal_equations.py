"""Levenberg-Marquardt steps of the poles of each group, and the energy that each mode explains."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from struck.core import entry
from struck.model.arrays import AnyComplex, Array, Index
from struck.recordings.poles.projection import (
    GroupBlocks,
    Projection,
    inverse_spreads,
    lines_of,
    misfit,
    orthonormalised,
    project,
    slopes_of,
    solve_damped,
    span,
    subtract_others,
    without,
)

# As in poles.c.
MIN_DECAY = 0.02  # least decay rate, 1/s
MAX_DECAY = 1500.0  # largest decay rate, 1/s
LEAST_Q = 0.25  # least pi f / d
_MIN_STEP_GAIN = 1e-3  # least gain of a step in units of the noise's cost
_MAX_FAILURES = 4  # steps without success


def take_turns(
    blocks: GroupBlocks,
    poles: AnyComplex,
    gains: AnyComplex,
    start: AnyComplex,
    starts: Index,
    steps: int,
    *,
    keep: bool,
) -> tuple[AnyComplex, AnyComplex, Array, Array]:
    """Refine poles instead of each group's, against the data without all other modes.

    With `keep`, each group's new poles, as many as it had, replace the old in poles (M,) and gains
    (C, M) before the next group's turn. Returns poles (N,) and gains (C, N), and of each group the
    residual energy over the noise's in a bin, and the same a bin and channel, 1 where chance may
    explain it.
    """
    count = len(starts) - 1
    new_poles, new_gains = np.array(start), np.empty((len(gains), len(start)), complex)
    costs, misfits = np.empty(count), np.empty(count)
    loop = entry("poles_take_turns")
    if loop is not None:
        arguments, space = blocks.for_core(starts, len(poles))
        loop(
            *arguments,
            poles,
            gains,
            starts,
            steps,
            keep,
            new_poles,
            new_gains,
            costs,
            misfits,
            space,
        )
        return new_poles, new_gains, costs, misfits
    for group in range(count):
        group_range = slice(starts[group], starts[group + 1])
        data = subtract_others(blocks, group, poles, gains)
        new_poles[group_range], fits, costs[group] = _refine_group(
            blocks, group, data, start[group_range], steps
        )
        misfits[group] = misfit(fits, float(costs[group]))
        for block, fit in zip(blocks.blocks(group), fits, strict=True):
            new_gains[block.rows, group_range] = fit.residues.T / span(
                new_poles[group_range], block.length
            )
        if keep:
            modes = blocks.members[group_range]
            poles[modes], gains[:, modes] = new_poles[group_range], new_gains[:, group_range]
    return new_poles, new_gains, costs, misfits


def _refine_group(
    blocks: GroupBlocks, group: int, data: Sequence[AnyComplex], poles: AnyComplex, steps: int
) -> tuple[AnyComplex, list[Projection], float]:
    """Refine one group's poles by Levenberg and Marquardt; return them, their fit and residual."""
    candidate, cost, damping, step_count, failures = poles, np.nan, 5e-3, 0, 0
    fits: list[Projection] = []
    matrix = side = np.zeros(0, complex)
    while failures < _MAX_FAILURES:
        trial, trial_cost = project(blocks, group, data, candidate)
        if not trial_cost >= cost:
            poles, fits, cost = candidate, trial, trial_cost
            if step_count == steps:
                break
            matrix, side = normal_equations(blocks, group, fits)
            damping, step_count, failures = max(damping / 5, 1e-9), step_count + 1, 0
        else:
            damping, failures = damping * 8, failures + 1
        step = solve_damped(matrix, damping, side)
        if not np.vdot(side, step).real > _MIN_STEP_GAIN:
            break
        candidate = _apply_step(poles, step)
    return poles, fits, cost


def normal_equations(
    blocks: GroupBlocks, group: int, projections: Sequence[Projection]
) -> tuple[AnyComplex, AnyComplex]:
    """Return matrix (M, M) and right side (M,) for steps of the poles, gains eliminated.

    Variable projection with Kaufman's derivative: the slopes of the lines, less what the lines
    themselves explain of them, times the residues. Summed over the channels this is an elementwise
    product, so their number costs next to nothing.
    """
    modes = len(projections[0].triangle)
    matrix, side = np.zeros((modes, modes), complex), np.zeros(modes, complex)
    for block, fit in zip(blocks.blocks(group), projections, strict=True):
        slopes = without(slopes_of(fit.lines, blocks.sample_rate), fit.basis)
        weighted = fit.residues.conj() * block.weights
        matrix += (slopes.conj() @ slopes.T) * (weighted @ fit.residues.T)
        side += (weighted * (slopes.conj() @ fit.left.T)).sum(axis=1)
    return matrix, side


def with_bounded_decays(poles: AnyComplex) -> AnyComplex:
    """Return poles with decay rates bounded: slower than a click, faster than an endless tone."""
    max_decays = np.minimum(
        MAX_DECAY, np.maximum(np.abs(poles.imag) / (2 * LEAST_Q), 2 * MIN_DECAY)
    )
    return -np.minimum(np.maximum(-poles.real, MIN_DECAY), max_decays) + 1j * poles.imag


def _apply_step(poles: AnyComplex, step: AnyComplex) -> AnyComplex:
    """Step by half a decay rate at most, twice that in angular frequency, and stay damped."""
    max_change = np.maximum(-0.5 * poles.real, 2.0)
    real = np.clip(step.real, -max_change, max_change)
    return with_bounded_decays(
        poles + real + 1j * np.clip(step.imag, -2 * max_change, 2 * max_change)
    )


def add_unique(
    blocks: GroupBlocks, poles: AnyComplex, gains: AnyComplex, energies: Array, shares: Array
) -> None:
    """Add the energies (M,) that only one mode explains, and write their shares of its energy.

    The energy is what the fit would lose without the mode, all others of its group refitted,
    over the noise's in a bin, summed over channels; the share is 1 for a mode without overlap, the
    largest of all segments.
    """
    loop = entry("poles_add_unique")
    if loop is not None:
        arguments, space = blocks.for_core(blocks.starts, len(poles))
        loop(*arguments, poles, gains, energies, shares, space)
        return
    for group in range(len(blocks.starts) - 1):
        members = blocks.members[blocks.starts[group] : blocks.starts[group + 1]]
        for block in blocks.blocks(group):
            lines = lines_of(poles[members], block.turns, blocks.sample_rate)
            spreads = inverse_spreads(orthonormalised(lines)[1])
            sizes = np.abs(gains[block.rows][:, members] * span(poles[members], block.length)) ** 2
            energies[members] += block.weights @ sizes / spreads
            fractions = 1 / (spreads * (np.abs(lines) ** 2).sum(axis=1))
            shares[members] = np.maximum(shares[members], fractions)

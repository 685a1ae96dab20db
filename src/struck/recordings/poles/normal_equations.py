"""Compiled Levenberg-Marquardt steps of the poles of each group, and statistics of the fit."""

from __future__ import annotations

import numpy as np

from struck.model.arrays import AnyComplex, Array, Index
from struck.recordings.poles.projection import (
    GroupBlocks,
    Projection,
    chosen,
    cleared,
    empty_projection,
    energy,
    inner,
    inverse_spreads,
    jitted,
    jitted_within,
    misfit,
    orthonormalise,
    project,
    rows_of,
    solve_damped,
    span,
    take_off_all,
    turns_of,
    write_lines,
)

SLOWEST = 0.02  # least decay rate, 1/s
FASTEST = 1500.0  # largest decay rate, 1/s
LEAST_Q = 2.0  # least pi f / d
_SETTLED = 1e-3  # least gain of a step in units of the noise's cost
_TRIES = 4  # steps without success


@jitted_within
def write_slopes(
    lines: AnyComplex, basis: AnyComplex, sample_rate: float, slopes: AnyComplex
) -> None:
    """Write the lines' derivatives by the poles, less their projection on the lines."""
    for m in range(len(lines)):
        for k in range(lines.shape[1]):
            slopes[m, k] = (lines[m, k] * lines[m, k] - lines[m, k]) * (1 / sample_rate)
        take_off_all(slopes[m], basis)


@jitted_within
def normal_equations(
    blocks: GroupBlocks, group: int, projection: Projection
) -> tuple[AnyComplex, AnyComplex]:
    """Return matrix (M, M) and right side (M,) for steps of the poles, gains eliminated.

    Variable projection with Kaufman's derivative: the slopes of the lines, less what the lines
    themselves explain of them, times the residues. Summed over the channels this is an elementwise
    product, so their number costs next to nothing.
    """
    modes, line, datum = len(projection.residues), 0, 0
    matrix = np.zeros((modes, modes), np.complex128)
    side = np.zeros(modes, np.complex128)
    for segment in range(blocks.numbers.shape[1]):
        bins = len(turns_of(blocks, blocks.numbers[group, segment]))
        first, last = blocks.rows[segment], blocks.rows[segment + 1]
        slopes = np.empty((modes, bins), np.complex128)
        lines = rows_of(projection.lines, line, modes, bins)
        basis = rows_of(projection.basis, line, modes, bins)
        left = rows_of(projection.left, datum, last - first, bins)
        write_slopes(lines, basis, blocks.sample_rate, slopes)
        weights = blocks.weights[first:last, group]
        _add_equations(slopes, left, projection.residues[:, first:last], weights, matrix, side)
        line += modes * bins
        datum += left.size
    return matrix, side


@jitted_within
def _add_equations(
    slopes: AnyComplex,
    left: AnyComplex,
    residues: AnyComplex,
    weights: Array,
    matrix: AnyComplex,
    side: AnyComplex,
) -> None:
    for i in range(len(slopes)):
        for c in range(len(left)):
            side[i] += np.conj(residues[i, c]) * weights[c] * inner(slopes[i], left[c])
        for j in range(i + 1):
            shared = 0.0j
            for c in range(len(left)):
                shared += np.conj(residues[i, c]) * weights[c] * residues[j, c]
            part = inner(slopes[i], slopes[j]) * shared
            matrix[i, j] += part
            if i != j:
                matrix[j, i] += np.conj(part)


@jitted
def damped(poles: AnyComplex) -> AnyComplex:
    """Return poles with decay rates bounded by what can be told from a click and from a tone."""
    bounded = np.empty_like(poles)
    for m in range(len(poles)):
        fastest = min(FASTEST, max(abs(poles[m].imag) / (2 * LEAST_Q), 2 * SLOWEST))
        decay = min(max(-poles[m].real, SLOWEST), fastest)
        bounded[m] = complex(-decay, poles[m].imag)
    return bounded


@jitted_within
def _stepped(poles: AnyComplex, step: AnyComplex) -> AnyComplex:
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
    blocks: GroupBlocks, group: int, data: AnyComplex, poles: AnyComplex, steps: int
) -> tuple[AnyComplex, Projection, float]:
    """Refine one group's poles by Levenberg and Marquardt; return them, their fit and residual."""
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
    blocks: GroupBlocks, group: int, poles: AnyComplex, projection: Projection, gains: AnyComplex
) -> None:
    for segment in range(blocks.numbers.shape[1]):
        length = blocks.lengths[blocks.numbers[group, segment]]
        for m in range(len(poles)):
            over = 1 / span(poles[m], length)
            for row in range(blocks.rows[segment], blocks.rows[segment + 1]):
                gains[row, m] = projection.residues[m, row] * over


@jitted
def take_turns(
    blocks: GroupBlocks,
    poles: AnyComplex,
    gains: AnyComplex,
    start: AnyComplex,
    starts: Index,
    steps: int,
    keep: bool,  # noqa: FBT001 - compiled code takes no keywords
) -> tuple[AnyComplex, AnyComplex, Array, Array]:
    """Refine poles in the place of each group's, against the data without all other modes.

    With `keep`, each group's new poles, as many as it had, replace the old in poles (M,) and gains
    (C, M) before the next group's turn. Returns poles (N,) and gains (C, N), and of each group the
    residual energy over the noise's in a bin, and the same a bin and channel, 1 where chance may
    explain it.
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


@jitted
def add_unique(
    blocks: GroupBlocks, poles: AnyComplex, gains: AnyComplex, energies: Array, shares: Array
) -> None:
    """Add the energies (M,) that only one mode explains, and write their shares of its energy.

    The energy is what the fit would lose without the mode, all others of its group fitted anew,
    over the noise's in a bin, summed over channels; the share is 1 for a mode without overlap, the
    largest of all segments.
    """
    for group in range(len(blocks.starts) - 1):
        members = blocks.members[blocks.starts[group] : blocks.starts[group + 1]]
        triangle = np.empty((len(members), len(members)), np.complex128)
        for segment in range(blocks.numbers.shape[1]):
            number = blocks.numbers[group, segment]
            turns = turns_of(blocks, number)
            lines = np.empty((len(members), len(turns)), np.complex128)
            write_lines(turns, chosen(poles, members), blocks.sample_rate, lines)
            orthonormalise(lines, np.empty_like(lines), triangle)
            spreads = inverse_spreads(triangle)
            for m in range(len(members)):
                mode = members[m]
                size = abs(span(poles[mode], blocks.lengths[number])) ** 2
                for row in range(blocks.rows[segment], blocks.rows[segment + 1]):
                    own = size * abs(gains[row, mode]) ** 2 * blocks.weights[row, group]
                    energies[mode] += own / spreads[m]
                shares[mode] = max(shares[mode], 1 / (spreads[m] * energy(lines[m])))

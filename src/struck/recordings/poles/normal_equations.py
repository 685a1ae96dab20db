"""Compiled: what the bins of each group tell of its modes once they are fitted."""

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
    normal_equations,
    orthonormalise,
    project,
    rows_of,
    solve_damped,
    span,
    take_off_all,
    turns_of,
    write_lines,
)

# Compiled: the turns that groups take, steps of Levenberg and Marquardt.

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
def damped(poles: AnyComplex) -> AnyComplex:
    """Return poles whose decay rates are within the bounds of what can be told from a click."""
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


_REGULAR = 1e-13


@jitted
def add_unique(
    blocks: GroupBlocks, poles: AnyComplex, gains: AnyComplex, energies: Array, shares: Array
) -> None:
    """Add the energies that only one mode explains, and write their shares of its whole energy.

    Parameters
    ----------
    blocks : Blocks
        Groups of all modes.
    poles, gains : arrays (M,) and (C, M)
        All modes.
    energies : array (M,)
        What the fit would lose without the mode, all others of its group fitted anew, in units of
        the noise's energy in a bin, summed over channels.
    shares : array (M,)
        1 for a mode that no other overlaps; the largest of all segments.
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


@jitted
def tell(
    blocks: GroupBlocks,
    poles: AnyComplex,
    gains: AnyComplex,
    variances: Array,
    sizes: Array,
    energies: Array,
    crossed: AnyComplex,
    whole: Array,
) -> None:
    """Write what the bins tell of all modes.

    Parameters
    ----------
    blocks : Blocks
        Groups of all modes.
    poles, gains : arrays (M,) and (C, M)
        All modes.
    variances : array (M,)
        Of the poles.
    sizes : array (C, M)
        Variances of the gains' sizes.
    energies : array (M,)
        What is left along the second derivatives of the lines, in units of what chance or the
        model leave over in a bin; zeros to begin with.
    crossed, whole : arrays (M,), complex and float
        Products of that with the modes, and of the modes with themselves; zeros to begin with.
    """
    for group in range(len(blocks.starts) - 1):
        members = blocks.members[blocks.starts[group] : blocks.starts[group + 1]]
        data = cleared(blocks, group, poles, gains)
        projection = empty_projection(blocks, group, len(members))
        cost = project(blocks, group, data, chosen(poles, members), projection)
        over = misfit(projection, cost)
        information, _ = normal_equations(blocks, group, projection)
        own = _inverse_diagonal(information)
        _write_gain_variances(blocks, group, over, poles, projection, sizes)
        _add_curvatures(blocks, group, projection, energies, crossed, whole)
        for m in range(len(members)):
            variances[members[m]] = over * own[m]
            energies[members[m]] /= over


@jitted_within
def _inverse_diagonal(matrix: AnyComplex) -> Array:
    """Return the diagonal of the inverse of a Hermitian matrix, scaled to a diagonal of ones."""
    count = len(matrix)
    scale, diagonal = np.empty(count), np.empty(count)
    for i in range(count):
        scale[i] = 1 / np.sqrt(max(matrix[i, i].real, 1e-300))
    scaled = np.empty_like(matrix)
    for i in range(count):
        for j in range(count):
            scaled[i, j] = matrix[i, j] * (scale[i] * scale[j])
    for i in range(count):
        unit = np.zeros(count, np.complex128)
        unit[i] = 1
        diagonal[i] = solve_damped(scaled, _REGULAR, unit)[i].real * scale[i] ** 2
    return diagonal


@jitted_within
def _write_gain_variances(
    blocks: GroupBlocks,
    group: int,
    over: float,
    poles: AnyComplex,
    projection: Projection,
    sizes: Array,
) -> None:
    members = blocks.members[blocks.starts[group] : blocks.starts[group + 1]]
    for segment in range(blocks.numbers.shape[1]):
        spreads = inverse_spreads(projection.triangles[segment])
        length = blocks.lengths[blocks.numbers[group, segment]]
        for m in range(len(members)):
            factor = over * spreads[m] / abs(span(poles[members[m]], length)) ** 2
            for row in range(blocks.rows[segment], blocks.rows[segment + 1]):
                sizes[row, members[m]] = factor / blocks.weights[row, group]


@jitted_within
def _add_curvatures(
    blocks: GroupBlocks,
    group: int,
    projection: Projection,
    energies: Array,
    crossed: AnyComplex,
    whole: Array,
) -> None:
    members = blocks.members[blocks.starts[group] : blocks.starts[group + 1]]
    line, datum = 0, 0
    for segment in range(blocks.numbers.shape[1]):
        bins = len(turns_of(blocks, blocks.numbers[group, segment]))
        first, last = blocks.rows[segment], blocks.rows[segment + 1]
        lines = rows_of(projection.lines, line, len(members), bins)
        basis = rows_of(projection.basis, line, len(members), bins)
        left = rows_of(projection.left, datum, last - first, bins)
        shapes = _second_derivatives(lines, basis, blocks.sample_rate)
        for m in range(len(members)):
            over = 1 / max(energy(shapes[m]), 1e-300)
            for c in range(len(left)):
                along = inner(shapes[m], left[c])
                weight = blocks.weights[first + c, group]
                residue = projection.residues[m, first + c]
                energies[members[m]] += abs(along) ** 2 * weight * over
                crossed[members[m]] += np.conj(residue) * along * (weight * over)
                whole[members[m]] += abs(residue) ** 2 * weight
        line += lines.size
        datum += left.size


@jitted_within
def _second_derivatives(lines: AnyComplex, basis: AnyComplex, sample_rate: float) -> AnyComplex:
    """Return (M, K), less what the lines and their first derivatives explain."""
    count, bins = lines.shape
    known, shapes = np.empty((2 * count, bins), np.complex128), np.empty_like(lines)
    for m in range(count):
        for k in range(bins):
            first = (lines[m, k] * lines[m, k] - lines[m, k]) * (1 / sample_rate)
            known[m, k], known[count + m, k] = basis[m, k], first
            shapes[m, k] = (2 * lines[m, k] - 1) * first * (1 / sample_rate)
    directions = np.empty_like(known)
    orthonormalise(known, directions, np.empty((2 * count, 2 * count), np.complex128))
    for m in range(count):
        take_off_all(shapes[m], directions)
    return shapes

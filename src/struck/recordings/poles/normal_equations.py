"""Compiled: what the bins of each group tell of its modes once they are fitted."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.recordings.poles.kernels.blocks import Blocks
from struck.recordings.poles.kernels.clearing import cleared
from struck.recordings.poles.kernels.compiling import jitted, jitted_within
from struck.recordings.poles.kernels.vectors import (
    chosen,
    energy,
    inner,
    inverse_spreads,
    orthonormalise,
    solve_damped,
    take_off_all,
)
from struck.recordings.poles.projection import (
    Projection,
    empty_projection,
    misfit,
    normal_equations,
    project,
    rows_of,
    span,
    turns_of,
    write_lines,
)

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]

_REGULAR = 1e-13


@jitted
def add_unique(
    blocks: Blocks, poles: Complex, gains: Complex, energies: Array, shares: Array
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
    blocks: Blocks,
    poles: Complex,
    gains: Complex,
    variances: Array,
    sizes: Array,
    energies: Array,
    crossed: Complex,
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
def _inverse_diagonal(matrix: Complex) -> Array:
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
    blocks: Blocks, group: int, over: float, poles: Complex, projection: Projection, sizes: Array
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
    blocks: Blocks,
    group: int,
    projection: Projection,
    energies: Array,
    crossed: Complex,
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
def _second_derivatives(lines: Complex, basis: Complex, sample_rate: float) -> Complex:
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

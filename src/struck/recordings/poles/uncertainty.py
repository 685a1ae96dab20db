"""Standard errors of fitted frequencies, decays and gains, and signs of unresolved pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from struck.model.arrays import AnyComplex, Array, Index
from struck.model.exponentials import Exponentials
from struck.recordings.poles.normal_equations import normal_equations
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
)
from struck.recordings.poles.refinement import blocks_around, overlapping
from struck.recordings.segments import Segment


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoleStatistics:
    """Cramer-Rao variances of M poles and of gains in C channels, signs of unresolved pairs."""

    order: Index  # (M,), modes group by group
    variances: Array  # (M,), of the poles, 1/s^2
    sizes: Array  # (C, M), variances of the gains' sizes
    energies: Array  # (M,), of the residual along the modes' second derivatives, over chance
    crossed: AnyComplex  # (M,), products of that residual with the modes
    whole: Array  # (M,), of the modes with themselves


def pole_statistics(segments: Sequence[Segment], ringing: Exponentials) -> PoleStatistics:
    """Return the statistics of fitted modes from the bins of all segments."""
    count, gains = ringing.count, np.ascontiguousarray(ringing.gains)
    found = PoleStatistics(
        order=np.zeros(count, np.int64),
        variances=np.zeros(count),
        sizes=np.zeros(gains.shape),
        energies=np.zeros(count),
        crossed=np.zeros(count, complex),
        whole=np.zeros(count),
    )
    if count:
        duration = max(segment.duration for segment in segments)
        blocks = blocks_around(segments, ringing.poles, overlapping(ringing.poles, duration))
        found.order[:] = blocks.members
        sums = found.energies, found.crossed, found.whole
        write_statistics(blocks, ringing.poles, gains, found.variances, found.sizes, *sums)
    return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StandardErrors:
    """Standard errors of a fit."""

    frequencies: Array  # (M,), Hz
    decays: Array  # (M,), 1/s
    gains: Array  # (C, M), of the sizes, unit of the samples


def standard_errors(segments: Sequence[Segment], ringing: Exponentials) -> StandardErrors:
    """Return the Cramer-Rao bounds of a fit, from all channels and hits together.

    The inverse of the Fisher information of the poles of a group, its complex gains eliminated; for
    exponentials in noise it is the same for the angular frequency as for the decay rate. Where a
    fit leaves more than the noise, the residual takes the noise's place. Gains are bounded with the
    poles as they are.
    """
    found = pole_statistics(segments, ringing)
    errors = np.sqrt(found.variances / 2)
    return StandardErrors(
        frequencies=errors / (2 * np.pi), decays=errors, gains=np.sqrt(found.sizes)
    )


# The compiled part.

_REGULAR = 1e-13


@jitted
def write_statistics(
    blocks: GroupBlocks,
    poles: AnyComplex,
    gains: AnyComplex,
    variances: Array,
    sizes: Array,
    energies: Array,
    crossed: AnyComplex,
    whole: Array,
) -> None:
    """Write the fields of `PoleStatistics` of all modes; the last three begin as zeros."""
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
    """Return the lines' second derivatives (M, K) less their fit by lines and first derivatives."""
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

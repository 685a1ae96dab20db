"""Compiled: the bins of a group split into what its modes explain and the rest.

A mode that rings from the first of N samples on has the transform r / (1 - z / u) at
u = exp(2 pi i k / N), exactly: z = exp(s / rate) and r = g (1 - z^N) / 2i. Its conjugate belongs to
it, for samples are real.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from struck.recordings.poles.kernels.blocks import Blocks
from struck.recordings.poles.kernels.compiling import jitted_within
from struck.recordings.poles.kernels.vectors import (
    energy,
    inner,
    orthonormalise,
    solve_triangle,
    take_off,
    take_off_all,
)

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Scalar = Any
"""An element of an array."""

_CHANCE = 3.0
"""Standard deviations of the mean energy that a bin of noise leaves."""


class Projection(NamedTuple):
    """What M modes explain of the blocks of a group; one array holds those of all S segments.

    Parameters
    ----------
    lines, basis : arrays, complex
        Transforms (M, K) of the modes, r left out, and their orthonormal factors, block by block.
    triangles : array (S, M, M), complex
        The other factors.
    residues : array (M, C), complex
        Least-squares factors r of the lines.
    left : array, complex
        What they leave of the data, (C, K) of each block.
    """

    lines: Complex
    basis: Complex
    triangles: Complex
    residues: Complex
    left: Complex


@jitted_within
def empty_projection(blocks: Blocks, group: int, modes: int) -> Projection:
    """Return room for the projection of a group."""
    bins, data, segments = 0, 0, blocks.numbers.shape[1]
    for number in blocks.numbers[group]:
        bins += blocks.firsts[number + 1] - blocks.firsts[number]
        data += blocks.offsets[number + 1] - blocks.offsets[number]
    return Projection(
        np.empty(modes * bins, np.complex128),
        np.empty(modes * bins, np.complex128),
        np.empty((segments, modes, modes), np.complex128),
        np.empty((modes, blocks.rows[-1]), np.complex128),
        np.empty(data, np.complex128),
    )


@jitted_within
def rows_of(array: Complex, first: int, rows: int, length: int) -> Complex:
    """Return a view (rows, length) of an array from one place on."""
    return array[first : first + rows * length].reshape((rows, length))


@jitted_within
def turns_of(blocks: Blocks, number: int) -> Complex:
    """Return exp(-2 pi i k / N) of the bins of a block."""
    return blocks.turns[blocks.firsts[number] : blocks.firsts[number + 1]]


@jitted_within
def span(pole: Scalar, length: Scalar) -> complex:
    """Return (1 - z^N) / 2i: from gains to residues."""
    return (1 - np.exp(pole * length)) / 2j


@jitted_within
def write_line(turns: Complex, ratio: Scalar, line: Complex) -> None:
    """Write 1 / (1 - z / u)."""
    for k in range(len(turns)):
        real = 1 - (turns[k].real * ratio.real - turns[k].imag * ratio.imag)
        imaginary = turns[k].real * ratio.imag + turns[k].imag * ratio.real
        over = 1 / (real * real + imaginary * imaginary)
        line[k] = complex(real * over, imaginary * over)


@jitted_within
def write_lines(turns: Complex, poles: Complex, sample_rate: float, lines: Complex) -> None:
    """Write the lines of modes (M, K)."""
    for m in range(len(poles)):
        write_line(turns, np.exp(poles[m] / sample_rate), lines[m])


@jitted_within
def project(
    blocks: Blocks, group: int, data: Complex, poles: Complex, projection: Projection
) -> float:
    """Fit the lines of some poles to the cleared data of a group; return the energy left.

    It is in units of the noise's in one bin.
    """
    modes, line, datum, cost = len(poles), 0, 0, 0.0
    for segment in range(blocks.numbers.shape[1]):
        turns = turns_of(blocks, blocks.numbers[group, segment])
        first, last = blocks.rows[segment], blocks.rows[segment + 1]
        lines = rows_of(projection.lines, line, modes, len(turns))
        basis = rows_of(projection.basis, line, modes, len(turns))
        left = rows_of(projection.left, datum, last - first, len(turns))
        whole = rows_of(data, datum, last - first, len(turns))
        write_lines(turns, poles, blocks.sample_rate, lines)
        orthonormalise(lines, basis, projection.triangles[segment])
        residues = projection.residues[:, first:last]
        for c in range(len(left)):
            for k in range(len(turns)):
                left[c, k] = whole[c, k]
            for m in range(modes):
                residues[m, c] = inner(basis[m], left[c])
                take_off(left[c], residues[m, c], basis[m])
            cost += blocks.weights[first + c, group] * energy(left[c])
        solve_triangle(projection.triangles[segment], residues)
        line += modes * len(turns)
        datum += left.size
    return cost


@jitted_within
def write_slopes(lines: Complex, basis: Complex, sample_rate: float, slopes: Complex) -> None:
    """Write what the lines' derivatives to the poles hold that the lines do not explain."""
    for m in range(len(lines)):
        for k in range(lines.shape[1]):
            slopes[m, k] = (lines[m, k] * lines[m, k] - lines[m, k]) * (1 / sample_rate)
        take_off_all(slopes[m], basis)


@jitted_within
def normal_equations(blocks: Blocks, group: int, projection: Projection) -> tuple[Complex, Complex]:
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
    slopes: Complex,
    left: Complex,
    residues: Complex,
    weights: Array,
    matrix: Complex,
    side: Complex,
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


@jitted_within
def misfit(projection: Projection, cost: float) -> float:
    """Return the energy left a bin and channel, noise being 1; 1 where chance may explain it."""
    unknowns = projection.residues.size + len(projection.residues)
    values = max(len(projection.left) - unknowns, 1)
    left = cost / values
    return left if left > 1 + _CHANCE / np.sqrt(values) else 1.0

"""Variable projection: the bins of a group of modes split into their fit and a residual.

A mode that rings from the first of N samples on has the transform r / (1 - z / u) at u = exp(2 pi i
k / N), exactly: z = exp(s / rate) and r = g (1 - z^N) / 2i. Its conjugate belongs to it, for
samples are real. The core does this; here it is in plain NumPy, which checks the core in the tests
and replaces it where it is missing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular

from struck.model.arrays import AnyComplex, Array, Index


class BinBlock(NamedTuple):
    """The bins of one group in one segment."""

    turns: AnyComplex  # (K,), exp(-2 pi i k / N)
    data: AnyComplex  # (C, K), spectra of the segment's channels
    length: float  # N / sample rate, s
    weights: Array  # (C,), one over the noise's energy in a bin
    rows: slice  # of the segment's gains


class GroupBlocks(NamedTuple):
    """Blocks of all groups and segments: bins of the shortest spectrum in which the modes end."""

    members: Index  # modes of all groups, group by group
    starts: Index  # (G + 1,), where each group begins in members
    numbers: Index  # (G, S), of the blocks
    firsts: Index  # (G S + 1,), where the bins of each block begin
    offsets: Index  # (G S + 1,), where its data begin
    turns: AnyComplex  # (K,), exp(-2 pi i k / N) of all bins
    data: AnyComplex  # spectra there, (bins, channels) of each block
    lengths: Array  # (G S,), N / sample rate of the blocks, s
    weights: Array  # (C, G), one over the noise's energy in a bin
    rows: Index  # (S + 1,), where the gains of each segment begin
    sample_rate: float  # Hz

    def blocks(self, group: int) -> Iterator[BinBlock]:
        """Yield the spectral bins of a group of modes, a block for each segment of recordings."""
        for segment, number in enumerate(self.numbers[group]):
            rows = slice(self.rows[segment], self.rows[segment + 1])
            turns = self.turns[self.firsts[number] : self.firsts[number + 1]]
            data = self.data[self.offsets[number] : self.offsets[number + 1]]
            yield BinBlock(
                turns=turns,
                data=data.reshape(len(turns), -1).T,
                length=float(self.lengths[number]),
                weights=self.weights[rows, group],
                rows=rows,
            )

    def for_core(self, starts: Index, count: int) -> tuple[tuple[Any, ...], Array]:
        """Return the first arguments of a compiled loop, and its work space.

        Groups begin at `starts` (G + 1,) among the modes to be fitted, and `count` are known.
        """
        modes = int(np.diff(starts).max())
        groups, segments = self.numbers.shape
        bins = int(np.diff(self.firsts)[self.numbers].sum(axis=1).max())
        data = int(np.diff(self.offsets)[self.numbers].sum(axis=1).max())
        # The sum of what the entries of poles.c and uncertainty.c take at once.
        size = 10 * data + (20 * modes + 4) * bins + (4 * segments + 16) * modes**2
        size += 4 * modes * int(self.rows[-1]) + 16 * modes + 2 * count
        return (groups, segments, *self, count), np.empty(size)


_MIN_NORM_RATIO = 0.1  # share left from which no second turn is needed
_MIN_INDEPENDENT_FRACTION = 1e-14  # least independent share of a vector
_MIN_DIVISOR = 1e-300  # least divisor


def orthonormalised(vectors: AnyComplex) -> tuple[AnyComplex, AnyComplex]:
    """Return the QR factors of vectors (M, K), never singular: basis (M, K) and triangle (M, M).

    By Gram and Schmidt; a vector that nearly cancels is orthogonalised twice, which is enough
    (Daniel, Gragg, Kaufman and Stewart 1976).
    """
    basis, triangle = vectors.copy(), np.zeros((len(vectors), len(vectors)), complex)
    for j in range(len(basis)):
        vector = basis[j]
        full_norm = norm = float(np.linalg.norm(vector))
        for _ in range(2):
            previous_norm = norm
            parts = basis[:j].conj() @ vector
            triangle[:j, j] += parts
            vector -= parts @ basis[:j]
            norm = float(np.linalg.norm(vector))
            if norm > _MIN_NORM_RATIO * previous_norm:
                break
        triangle[j, j] = max(norm, _MIN_INDEPENDENT_FRACTION * full_norm, _MIN_DIVISOR)
        vector /= triangle[j, j].real
    return basis, triangle


def without(vectors: AnyComplex, basis: AnyComplex) -> AnyComplex:
    """Return vectors (N, K) less their projection on orthonormal ones (M, K)."""
    return vectors - (vectors @ basis.conj().T) @ basis


def inverse_spreads(triangle: AnyComplex) -> Array:
    """Return the diagonal of the inverse Gram matrix, from the factor of QR."""
    inverse_triangle = solve_triangular(triangle, np.eye(len(triangle)), check_finite=False)
    return (np.abs(inverse_triangle) ** 2).sum(axis=1)


def solve_damped(matrix: AnyComplex, damping: float, sides: AnyComplex) -> AnyComplex:
    """Solve a Hermitian system with its diagonal raised by a share, by Cholesky's L L^H."""
    size = len(matrix)
    factor, damped_matrix = np.zeros_like(matrix), matrix * (1 + damping * np.eye(size))
    for j in range(size):
        column = damped_matrix[j:, j] - factor[j:, :j] @ factor[j, :j].conj()
        factor[j, j] = np.sqrt(max(column[0].real, _MIN_DIVISOR))
        factor[j + 1 :, j] = column[1:] / factor[j, j].real
    solution = solve_triangular(factor, sides, lower=True, check_finite=False)
    return solve_triangular(factor, solution, lower=True, trans=2, check_finite=False)


class Projection(NamedTuple):
    """Least-squares fit of M modes to the K bins of one block."""

    lines: AnyComplex  # (M, K), spectra of the modes without r
    basis: AnyComplex  # (M, K), their orthonormal factors
    triangle: AnyComplex  # (M, M), their triangular factor
    residues: AnyComplex  # (M, C), least-squares factors r of the lines
    left: AnyComplex  # (C, K), residual of the data


def span(poles: AnyComplex, length: float) -> AnyComplex:
    """Return (1 - z^N) / 2i, the ratio of residue to gain."""
    return (1 - np.exp(poles * length)) / 2j


def lines_of(poles: AnyComplex, turns: AnyComplex, sample_rate: float) -> AnyComplex:
    """Return 1 / (1 - z / u) of modes (M, K)."""
    return 1 / (1 - np.exp(poles / sample_rate)[:, None] * turns)


def slopes_of(lines: AnyComplex, sample_rate: float) -> AnyComplex:
    """Return the lines' derivatives by the poles (M, K)."""
    return (lines * lines - lines) / sample_rate


def project(
    blocks: GroupBlocks, group: int, data: Sequence[AnyComplex], poles: AnyComplex
) -> tuple[list[Projection], float]:
    """Fit the lines of poles to a group's data; return the residual over a bin's noise."""
    projections, cost = [], 0.0
    for block, bins in zip(blocks.blocks(group), data, strict=True):
        lines = lines_of(poles, block.turns, blocks.sample_rate)
        basis, triangle = orthonormalised(lines)
        coefficients = basis.conj() @ bins.T
        left = without(bins - coefficients.T @ basis, basis)
        residues = solve_triangular(triangle, coefficients, check_finite=False)
        projections.append(Projection(lines, basis, triangle, residues, left))
        cost += float(block.weights @ (np.abs(left) ** 2).sum(axis=1))
    return projections, cost


_CHANCE = 3.0  # standard deviations of the mean energy that a bin of noise leaves


def misfit(projections: Sequence[Projection], cost: float) -> float:
    """Return the residual of a bin and channel, noise being 1; 1 where chance may explain it."""
    unknowns = sum(projection.residues.size for projection in projections) + len(
        projections[0].triangle
    )
    values = max(sum(projection.left.size for projection in projections) - unknowns, 1)
    left = cost / values
    return left if left > 1 + _CHANCE / np.sqrt(values) else 1.0


def subtract_others(
    blocks: GroupBlocks, group: int, poles: AnyComplex, gains: AnyComplex
) -> list[AnyComplex]:
    """Return the data of a group (C, K) of each block, without all other modes.

    The spectra of the conjugate poles at positive frequencies are subtracted for all modes.
    """
    parts, others = [], np.ones(len(poles), bool)
    others[blocks.members[blocks.starts[group] : blocks.starts[group + 1]]] = False
    for block in blocks.blocks(group):
        residues = gains[block.rows] * span(poles, block.length)
        direct_lines = lines_of(poles[others], block.turns, blocks.sample_rate)
        conjugate_lines = lines_of(poles.conj(), block.turns, blocks.sample_rate)
        parts.append(
            block.data - residues[:, others] @ direct_lines - residues.conj() @ conjugate_lines
        )
    return parts

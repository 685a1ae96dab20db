"""Eigenpairs K x = lambda M x below a bound: block Lanczos on sparse factors, or LAPACK.

Shift-and-invert with full reorthogonalisation (Grimes, Lewis & Simon 1994); the known rigid
motions are taken out beforehand, so no step is spent on them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from scipy import sparse
from scipy.linalg.blas import dgemm as gemm

from struck.errors import SolverError
from struck.model.arrays import Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Eigenpairs:
    """Eigenvalues (M,), ascending, and M-orthonormal vectors (n, M)."""

    values: Array
    vectors: Array


class Mass:
    """M = m (x) I3: one scalar matrix serves the three directions."""

    def __init__(self, between_nodes: sparse.csr_matrix) -> None:
        self._between_nodes = between_nodes

    def __matmul__(self, block: Array) -> Array:
        rows, columns = block.shape
        side_by_side = block.reshape(rows // 3, 3 * columns)
        return np.asarray(self._between_nodes @ side_by_side).reshape(rows, columns)


def rigid_motions(points: Array) -> Array:
    """Return three translations and three rotations of the nodes (3N, 6)."""
    x, y, z = (points - points.mean(axis=0)).T
    zero = np.zeros_like(x)
    rotations = [(zero, -z, y), (z, zero, -x), (-y, x, zero)]
    shifts = [tuple(zero + step for step in row) for row in np.eye(3)]
    return np.stack([np.stack(motion, axis=1).ravel() for motion in (*shifts, *rotations)], axis=1)


def solve_dense(stiffness: Array, mass: Array, max_value: float, skipped_count: int) -> Eigenpairs:
    """Return all eigenpairs up to `max_value`, at least one, without the lowest `skipped_count`."""
    values, vectors = scipy.linalg.eigh(stiffness, mass)
    count = max(int(np.count_nonzero(values[skipped_count:] <= max_value)), 1)
    chosen = slice(skipped_count, skipped_count + count)
    return Eigenpairs(values=values[chosen], vectors=vectors[:, chosen])


def block_lanczos(
    solve: Callable[[Array], Array],
    mass: Mass,
    shift: float,
    count: int,
    excluded_vectors: Array,
    progress: Callable[[float], None] = lambda _: None,
    *,
    below: int = 0,
    min_value: float = -np.inf,
    precision: float = 1e-7,
) -> Eigenpairs:
    """Return the `count` eigenpairs next above a shift and the next `below` it."""
    # `solve` solves (K - shift M) x = b for blocks (n, b); `excluded_vectors` (n, k): rigid
    # motions. Eigenvalues under `min_value` are a sign of larger ones still missing, so half as
    # many steps more are made.
    # `precision` bounds residuals over eigenvalues, of the inverted problem and of this one.
    progress(0.0)
    request = _Request(shift=shift, below=below, above=count, precision=precision)
    basis = _Basis(
        len(excluded_vectors), excluded_vectors.shape[1] + 4 * request.count + 12 * _WIDTH
    )
    block, weighted = _start_block(basis, mass, excluded_vectors)
    previous, coupling = block[:, :0], np.zeros((block.shape[1], 0))
    tridiagonal, check_size, patience = _Tridiagonal(), request.count + request.count // 2, 0
    while True:
        basis.append(block)
        step = _subtract(solve(weighted), previous, coupling.T)
        diagonal = weighted.T @ step
        # Rounding lets the earlier blocks back in.
        step, previous = basis.orthogonalise(_subtract(step, block, diagonal), mass), block
        block, weighted, coupling = _orthonormal(step, mass @ step)
        tridiagonal.append(diagonal, coupling)
        is_exhausted = (
            not block.shape[1]
            or tridiagonal.size >= len(excluded_vectors) - excluded_vectors.shape[1]
        )
        if not is_exhausted and tridiagonal.size < check_size:
            continue
        ritz_pairs = request.select(tridiagonal)
        progress(ritz_pairs.fraction)
        if ritz_pairs.fraction == 1:
            patience = patience or 3 * tridiagonal.size // 2
            if ritz_pairs.values[0] > min_value or is_exhausted or tridiagonal.size > patience:
                return ritz_pairs.unfold(basis, block, excluded_vectors.shape[1])
        if is_exhausted:
            raise SolverError(_TOO_FEW_MESSAGE.format(tridiagonal.size, request.count))
        check_size = tridiagonal.size + 1 + _WIDTH * (tridiagonal.size // 256)


_TOO_FEW_MESSAGE = "only {} of {} modes exist on this mesh: lower the band's end"
_WIDTH = 8  # right-hand sides solved at a time: fewer cost as much, more need more steps


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _RitzPairs:
    """Fraction of the requested pairs that has converged; their values and basis coefficients."""

    fraction: float
    values: Array
    rotation: Array

    def unfold(self, basis: _Basis, block: Array, first: int) -> Eigenpairs:
        """Return the pairs as combinations of the basis from `first` on and the last block."""
        basis.append(block)
        return Eigenpairs(values=self.values, vectors=basis.combine(first, self.rotation))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Request:
    """Numbers of eigenvalues requested on either side of a shift."""

    shift: float
    below: int
    above: int
    precision: float

    @property
    def count(self) -> int:
        return self.below + self.above

    def select(self, tridiagonal: _Tridiagonal) -> _RitzPairs:
        """Choose among the Ritz pairs, the eigenvalues ascending."""
        inverted_values, rotation = tridiagonal.solve()
        # Towards the shift from below, inverted eigenvalues fall from 0; above it, from infinity.
        lower_indices = np.arange(min(self.below, tridiagonal.size))[::-1]
        upper_indices = np.arange(tridiagonal.size)[::-1][: self.above]
        chosen = np.concatenate([lower_indices, upper_indices])
        sides = np.concatenate([-np.ones(len(lower_indices)), np.ones(len(upper_indices))])
        inverted_values, rotation = inverted_values[chosen], rotation[:, chosen]
        with np.errstate(divide="ignore"):
            values = self.shift + 1 / inverted_values
        last = tridiagonal.coupling[-1]
        residual_parts = last @ rotation[tridiagonal.size - last.shape[1] :]
        # What is far smaller than the shift would else be known to fewer digits.
        scale = np.clip(np.abs(values * inverted_values), 1e-6, 1) * np.abs(inverted_values)
        is_converged = (np.linalg.norm(residual_parts, axis=0) <= self.precision * scale) & (
            sides * inverted_values > 0
        )
        # One more step of inverse iteration, which costs nothing (Ericsson & Ruhe 1980).
        refined = np.vstack([rotation, residual_parts / inverted_values])
        return _RitzPairs(fraction=is_converged.sum() / self.count, values=values, rotation=refined)


def _start_block(basis: _Basis, mass: Mass, excluded_vectors: Array) -> tuple[Array, Array]:
    """Put known vectors into the basis; return a random block orthogonal to it, and M times it."""
    if excluded_vectors.shape[1]:
        basis.append(_orthonormal(excluded_vectors, mass @ excluded_vectors)[0])
    start = np.random.default_rng(0).standard_normal((len(excluded_vectors), _WIDTH))
    start = basis.orthogonalise(start, mass)
    return _orthonormal(start, mass @ start)[:2]


def _subtract(block: Array, vectors: Array, weights: Array) -> Array:
    """Return block (n, b) less vectors @ weights, in the block's place where it lies row by row."""
    if not weights.size:
        return block
    by_columns = vectors.flags.f_contiguous
    vectors = vectors if by_columns else vectors.T
    return gemm(-1, weights.T, vectors, 1, block.T, trans_b=by_columns, overwrite_c=True).T


class _Basis:
    """M-orthonormal vectors, one a row, grown in place."""

    def __init__(self, length: int, capacity: int) -> None:
        self._rows = np.empty((capacity, length))
        self._count = 0

    @property
    def vectors(self) -> Array:
        """The Lanczos vectors computed so far (k, n)."""
        return self._rows[: self._count]

    def append(self, block: Array) -> None:
        """Add the columns of a block (n, b) to the Lanczos vectors."""
        end = self._count + block.shape[1]
        if end > len(self._rows):
            rows = np.empty((max(end, 3 * len(self._rows) // 2), self._rows.shape[1]))
            rows[: self._count] = self.vectors
            self._rows = rows
        self._rows[self._count : end] = block.T
        self._count = end

    def orthogonalise(self, block: Array, mass: Mass) -> Array:
        """Return a block (n, b) made M-orthogonal to all vectors, in its own place."""
        return _subtract(block, self.vectors.T, self.vectors @ (mass @ block))

    def combine(self, first: int, weights: Array) -> Array:
        """Return combinations (n, m) of the vectors from `first` on."""
        return self.vectors[first : first + len(weights)].T @ weights


class _Tridiagonal:
    """The inverted problem seen in the basis: block tridiagonal and symmetric."""

    def __init__(self) -> None:
        self.diagonal: list[Array] = []
        self.coupling: list[Array] = []

    @property
    def size(self) -> int:
        return sum(len(block) for block in self.diagonal)

    def append(self, diagonal: Array, coupling: Array) -> None:
        self.diagonal.append((diagonal + diagonal.T) / 2)
        self.coupling.append(coupling)

    def solve(self) -> tuple[Array, Array]:
        """Return all eigenvalues, ascending, and the vectors to them."""
        return scipy.linalg.eigh(self._matrix(), driver="evd")

    def _matrix(self) -> Array:
        matrix, start = np.zeros((self.size, self.size)), 0
        for block, next_coupling in zip(self.diagonal, self.coupling, strict=True):
            stop = start + len(block)
            matrix[start:stop, start:stop] = block
            end = stop + len(next_coupling)
            if end <= self.size:
                matrix[stop:end, start:stop] = next_coupling
                matrix[start:stop, stop:end] = next_coupling.T
            start = stop
        return matrix


def _orthonormal(block: Array, weighted: Array) -> tuple[Array, Array, Array]:
    """Return a block made M-orthonormal, M times it, and the old block's parts in it."""
    # Eigenvectors of the Gram matrix; dependent columns are dropped.
    gram = block.T @ weighted
    squares, rotation = np.linalg.eigh((gram + gram.T) / 2)
    is_independent = squares > squares[-1] * 1e-14 * len(squares)
    root = np.sqrt(squares[is_independent])
    scale = rotation[:, is_independent] / root
    return block @ scale, weighted @ scale, (rotation[:, is_independent] * root).T

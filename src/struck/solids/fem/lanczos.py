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
    turns = [(zero, -z, y), (z, zero, -x), (-y, x, zero)]
    shifts = [tuple(zero + step for step in row) for row in np.eye(3)]
    return np.stack([np.stack(motion, axis=1).ravel() for motion in (*shifts, *turns)], axis=1)


def dense(stiffness: Array, mass: Array, highest: float, skipped: int) -> Eigenpairs:
    """Return all eigenpairs up to `highest`, at least one, without the `skipped` lowest."""
    values, vectors = scipy.linalg.eigh(stiffness, mass)
    count = max(int(np.count_nonzero(values[skipped:] <= highest)), 1)
    chosen = slice(skipped, skipped + count)
    return Eigenpairs(values=values[chosen], vectors=vectors[:, chosen])


def block_lanczos(
    solve: Callable[[Array], Array],
    mass: Mass,
    shift: float,
    count: int,
    known: Array,
    progress: Callable[[float], None] = lambda _: None,
    *,
    below: int = 0,
    least: float = -np.inf,
    precision: float = 1e-7,
) -> Eigenpairs:
    """Return the `count` eigenpairs next above a shift and the next `below` it."""
    # `solve` solves (K - shift M) x = b for blocks (n, b); `known` (n, k): rigid motions, left out.
    # Eigenvalues under `least` hint at larger ones still missing: half as many steps more are made.
    # `precision` bounds residuals over eigenvalues, of the inverted problem and of this one.
    progress(0.0)
    wanted = _Request(shift=shift, below=below, above=count, precision=precision)
    basis = _Basis(len(known), known.shape[1] + 4 * wanted.count + 12 * _WIDTH)
    block, weighted = _started(basis, mass, known)
    previous, coupling = block[:, :0], np.zeros((block.shape[1], 0))
    projected, check, patience = _Tridiagonal(), wanted.count + wanted.count // 2, 0
    while True:
        basis.append(block)
        step = _less(solve(weighted), previous, coupling.T)
        diagonal = weighted.T @ step
        # Rounding lets the earlier blocks back in.
        step, previous = basis.removed(_less(step, block, diagonal), mass), block
        block, weighted, coupling = _orthonormal(step, mass @ step)
        projected.append(diagonal, coupling)
        exhausted = not block.shape[1] or projected.size >= len(known) - known.shape[1]
        if not exhausted and projected.size < check:
            continue
        found = wanted.among(projected)
        progress(found.share)
        if found.share == 1:
            patience = patience or 3 * projected.size // 2
            if found.values[0] > least or exhausted or projected.size > patience:
                return found.unfolded(basis, block, known.shape[1])
        if exhausted:
            raise SolverError(_TOO_FEW.format(projected.size, wanted.count))
        check = projected.size + 1 + _WIDTH * (projected.size // 256)


_TOO_FEW = "only {} of {} modes exist on this mesh: lower the band's end"
_WIDTH = 8  # right-hand sides solved at a time: fewer cost as much, more need more steps


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Found:
    """Which share of the wanted pairs is there; their values and combinations of the basis."""

    share: float
    values: Array
    rotation: Array

    def unfolded(self, basis: _Basis, block: Array, first: int) -> Eigenpairs:
        """Return the pairs as combinations of the basis from `first` on and the last block."""
        basis.append(block)
        return Eigenpairs(values=self.values, vectors=basis.combined(first, self.rotation))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Request:
    """Numbers of eigenvalues wanted on either side of a shift."""

    shift: float
    below: int
    above: int
    precision: float

    @property
    def count(self) -> int:
        return self.below + self.above

    def among(self, projected: _Tridiagonal) -> _Found:
        """Choose among the Ritz pairs, the eigenvalues ascending."""
        inverted, rotation = projected.solved()
        # Towards the shift from below, inverted eigenvalues fall from 0; above it, from infinity.
        under = np.arange(min(self.below, projected.size))[::-1]
        over = np.arange(projected.size)[::-1][: self.above]
        chosen = np.concatenate([under, over])
        sides = np.concatenate([-np.ones(len(under)), np.ones(len(over))])
        inverted, rotation = inverted[chosen], rotation[:, chosen]
        with np.errstate(divide="ignore"):
            values = self.shift + 1 / inverted
        last = projected.coupling[-1]
        outside = last @ rotation[projected.size - last.shape[1] :]
        # What is far smaller than the shift would else be known to fewer digits.
        scale = np.clip(np.abs(values * inverted), 1e-6, 1) * np.abs(inverted)
        good = (np.linalg.norm(outside, axis=0) <= self.precision * scale) & (sides * inverted > 0)
        # One more step of inverse iteration, which costs nothing (Ericsson & Ruhe 1980).
        refined = np.vstack([rotation, outside / inverted])
        return _Found(share=good.sum() / self.count, values=values, rotation=refined)


def _started(basis: _Basis, mass: Mass, known: Array) -> tuple[Array, Array]:
    """Put known vectors into the basis; return a random block orthogonal to it, and M times it."""
    if known.shape[1]:
        basis.append(_orthonormal(known, mass @ known)[0])
    start = np.random.default_rng(0).standard_normal((len(known), _WIDTH))
    start = basis.removed(start, mass)
    return _orthonormal(start, mass @ start)[:2]


def _less(block: Array, vectors: Array, weights: Array) -> Array:
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
        self._used = 0

    @property
    def vectors(self) -> Array:
        """The Lanczos vectors computed so far (k, n)."""
        return self._rows[: self._used]

    def append(self, block: Array) -> None:
        """Add the columns of a block (n, b) to the Lanczos vectors."""
        stop = self._used + block.shape[1]
        if stop > len(self._rows):
            rows = np.empty((max(stop, 3 * len(self._rows) // 2), self._rows.shape[1]))
            rows[: self._used] = self.vectors
            self._rows = rows
        self._rows[self._used : stop] = block.T
        self._used = stop

    def removed(self, block: Array, mass: Mass) -> Array:
        """Return a block (n, b) made M-orthogonal to all vectors, in its own place."""
        return _less(block, self.vectors.T, self.vectors @ (mass @ block))

    def combined(self, first: int, weights: Array) -> Array:
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

    def solved(self) -> tuple[Array, Array]:
        """Return all eigenvalues, ascending, and the vectors to them."""
        return scipy.linalg.eigh(self._matrix(), driver="evd")

    def _matrix(self) -> Array:
        matrix, start = np.zeros((self.size, self.size)), 0
        for block, below in zip(self.diagonal, self.coupling, strict=True):
            stop = start + len(block)
            matrix[start:stop, start:stop] = block
            end = stop + len(below)
            if end <= self.size:
                matrix[stop:end, start:stop] = below
                matrix[start:stop, stop:end] = below.T
            start = stop
        return matrix


def _orthonormal(block: Array, weighted: Array) -> tuple[Array, Array, Array]:
    """Return a block made M-orthonormal, M times it, and the old block's parts in it."""
    # Eigenvectors of the Gram matrix; dependent columns are dropped.
    gram = block.T @ weighted
    squares, turn = np.linalg.eigh((gram + gram.T) / 2)
    kept = squares > squares[-1] * 1e-14 * len(squares)
    root = np.sqrt(squares[kept])
    scale = turn[:, kept] / root
    return block @ scale, weighted @ scale, (turn[:, kept] * root).T

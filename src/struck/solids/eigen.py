"""Eigenpairs K x = lambda M x below a bound: block Lanczos on sparse factors, or LAPACK.

Shift-and-invert with full reorthogonalisation (Grimes, Lewis & Simon 1994); the known rigid
motions are taken out beforehand, so no step is spent on them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy import sparse

from struck.errors import SolverError

Array = NDArray[np.float64]


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
    precision: float = 1e-7,
) -> Eigenpairs:
    """Return the `count` eigenpairs next above a negative `shift`.

    Parameters
    ----------
    solve : callable
        Solves (K - shift M) x = b for blocks (n, b).
    mass : Mass
    shift : float
        Below all wanted eigenvalues.
    count : int
    known : array (n, k)
        Directions to stay orthogonal to: the rigid motions, or none.
    progress : callable
        Told the fraction of eigenpairs found.
    precision : float
        Largest residual of the inverted problem, relative to its eigenvalue.

    Raises
    ------
    SolverError
        When the search space is exhausted first.
    """
    progress(0.0)
    width = _block_width(count)
    basis = _Basis(len(known), known.shape[1] + 5 * count + 10 * width)
    block, weighted = _started(basis, mass, known, width)
    projected = _Tridiagonal()
    previous, coupling = block[:, :0], np.zeros((block.shape[1], 0))
    while True:
        basis.append(block)
        step = solve(weighted) - previous @ coupling.T
        diagonal = weighted.T @ step
        step -= block @ diagonal
        # Rounding lets the earlier blocks back in.
        basis.remove_from(step, mass)
        previous = block
        block, weighted = _orthonormal(step, mass @ step)
        coupling = weighted.T @ step
        projected.append(diagonal, coupling)
        exhausted = not block.shape[1] or projected.size >= len(known) - known.shape[1]
        if exhausted or projected.size >= 2 * count:
            found, inverted, rotation = projected.solved(precision)
            progress(min(found / count, 1.0))
            if found >= count:
                vectors = basis.combined(known.shape[1], rotation[:, :count])
                return Eigenpairs(values=shift + 1 / inverted[:count], vectors=vectors)
        if exhausted:
            raise SolverError(
                f"only {projected.size} of {count} modes exist on this mesh: lower the band's end"
            )


def _started(basis: _Basis, mass: Mass, known: Array, width: int) -> tuple[Array, Array]:
    """Put what is known into the basis; return a random block beside it and M times it."""
    if known.shape[1]:
        basis.append(_orthonormal(known, mass @ known)[0])
    start = np.random.default_rng(0).standard_normal((len(known), width))
    basis.remove_from(start, mass)
    return _orthonormal(start, mass @ start)


def _block_width(count: int) -> int:
    # Factors are solved eight right-hand sides at a time: fewer cost as much.
    return 8 if count <= 128 else 16


class _Basis:
    """M-orthonormal vectors, one a row, grown in place."""

    def __init__(self, length: int, capacity: int) -> None:
        self._rows = np.empty((capacity, length))
        self._used = 0

    @property
    def vectors(self) -> Array:
        """The vectors so far (k, n)."""
        return self._rows[: self._used]

    def append(self, block: Array) -> None:
        """Add the columns of a block (n, b)."""
        stop = self._used + block.shape[1]
        if stop > len(self._rows):
            rows = np.empty((max(stop, 3 * len(self._rows) // 2), self._rows.shape[1]))
            rows[: self._used] = self.vectors
            self._rows = rows
        self._rows[self._used : stop] = block.T
        self._used = stop

    def remove_from(self, block: Array, mass: Mass) -> None:
        """Make a block (n, b) M-orthogonal to all vectors, in place."""
        parts = (mass @ block).T @ self.vectors.T
        block -= (parts @ self.vectors).T

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

    def solved(self, precision: float) -> tuple[int, Array, Array]:
        """Return how many pairs have converged from the largest on, with all of them."""
        values, rotation = scipy.linalg.eigh(self._matrix())
        values, rotation = values[::-1], rotation[:, ::-1]
        last = self.coupling[-1]
        residuals = np.linalg.norm(last @ rotation[-last.shape[1] :], axis=0)
        good = residuals <= precision * np.abs(values)
        return (len(values) if good.all() else int(np.argmin(good))), values, rotation

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


def _orthonormal(block: Array, weighted: Array) -> tuple[Array, Array]:
    """M-orthonormalise a block by the eigenvectors of its Gram matrix; drop dependent columns."""
    gram = block.T @ weighted
    squares, turn = np.linalg.eigh((gram + gram.T) / 2)
    kept = squares > squares[-1] * 1e-14 * len(squares)
    scale = turn[:, kept] / np.sqrt(squares[kept])
    return block @ scale, weighted @ scale

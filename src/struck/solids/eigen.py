"""Eigenpairs K x = lambda M x below a bound: block Lanczos on sparse factors, or LAPACK.

Shift-and-invert with full reorthogonalisation (Grimes, Lewis & Simon 1994); the known rigid
motions are taken out beforehand, so no step is spent on them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.linalg
import scipy.sparse as sparse
from numpy.typing import NDArray

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
    shifts = [np.broadcast_to(row, (len(x), 3)).T for row in np.eye(3)]
    return np.stack([np.stack(m, axis=1).ravel() for m in (*shifts, *turns)], axis=1)


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
    width = _block_width(count)
    basis = _Basis(len(known), known.shape[1] + 2 * count + 8 * width)
    if known.shape[1]:
        basis.append(*_orthonormal(known, mass @ known))
    start = np.random.default_rng(0).standard_normal((len(known), width))
    block = basis.append(*_orthonormal(*_cleaned(start, basis, mass)))
    projected = _Tridiagonal()
    while True:
        step = solve(basis.weighted(block))
        projected.diagonal.append(basis.remove(step, block))
        fresh, weighted = _orthonormal(step, mass @ step)
        projected.coupling.append(weighted.T @ step)
        if projected.size >= count:
            found, inverted, rotation = projected.solved(precision)
            progress(min(found / count, 1.0))
            if found >= count:
                return _ritz(basis, known.shape[1], inverted[:count], rotation[:, :count], shift)
        if projected.size >= len(known) - known.shape[1] or not fresh.shape[1]:
            raise SolverError(
                f"only {projected.size} of {count} modes exist on this mesh: lower the band's end"
            )
        block = basis.append(fresh, weighted)


def _block_width(count: int) -> int:
    return 4 if count <= 12 else 8 if count <= 64 else 16


class _Basis:
    """M-orthonormal columns Q with M Q beside them, grown in place."""

    def __init__(self, rows: int, columns: int) -> None:
        self._vectors = np.empty((rows, columns), order="F")
        self._weighted = np.empty((rows, columns), order="F")
        self._used = 0

    def append(self, vectors: Array, weighted: Array) -> slice:
        """Add columns and return where they stand."""
        chosen = slice(self._used, self._used + vectors.shape[1])
        if chosen.stop > self._vectors.shape[1]:
            self._grow(chosen.stop)
        self._vectors[:, chosen], self._weighted[:, chosen] = vectors, weighted
        self._used = chosen.stop
        return chosen

    def weighted(self, chosen: slice) -> Array:
        """Return M Q of some columns."""
        return self._weighted[:, chosen]

    def remove(self, block: Array, latest: slice) -> Array:
        """Make `block` orthogonal to all columns, in place; return its part along `latest`.

        Twice is enough (Parlett 1998, section 6.9).
        """
        along = np.zeros((latest.stop - latest.start, block.shape[1]))
        for _ in range(2):
            parts = self._weighted[:, : self._used].T @ block
            block -= self._vectors[:, : self._used] @ parts
            along += parts[latest]
        return (along + along.T) / 2 if along.shape[0] == along.shape[1] else along

    def combined(self, first: int, weights: Array) -> Array:
        """Return combinations of the columns from `first` on."""
        return self._vectors[:, first : first + len(weights)] @ weights

    def _grow(self, least: int) -> None:
        columns = max(least, int(1.5 * self._vectors.shape[1]))
        for name in ("_vectors", "_weighted"):
            old = getattr(self, name)
            new = np.empty((len(old), columns), order="F")
            new[:, : self._used] = old[:, : self._used]
            setattr(self, name, new)


class _Tridiagonal:
    """The inverted problem seen in the basis: block tridiagonal and symmetric."""

    def __init__(self) -> None:
        self.diagonal: list[Array] = []
        self.coupling: list[Array] = []

    @property
    def size(self) -> int:
        return sum(len(block) for block in self.diagonal)

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


def _cleaned(block: Array, basis: _Basis, mass: Mass) -> tuple[Array, Array]:
    basis.remove(block, slice(0, 0))
    return block, mass @ block


def _orthonormal(block: Array, weighted: Array) -> tuple[Array, Array]:
    """M-orthonormalise a block by the eigenvectors of its Gram matrix; drop dependent columns."""
    gram = block.T @ weighted
    squares, turn = np.linalg.eigh((gram + gram.T) / 2)
    kept = squares > squares[-1] * 1e-14 * len(squares)
    scale = turn[:, kept] / np.sqrt(squares[kept])
    return block @ scale, weighted @ scale


def _ritz(basis: _Basis, first: int, inverted: Array, rotation: Array, shift: float) -> Eigenpairs:
    return Eigenpairs(values=shift + 1 / inverted, vectors=basis.combined(first, rotation))

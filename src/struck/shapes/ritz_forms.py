"""Deflections of rectangular plates as sums of products of polynomials."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray
from scipy.special import eval_jacobi

Array = NDArray[np.float64]
Index = NDArray[np.int64]

# Values held at once while many places are read.
_AT_ONCE = 2**22


def edge_polynomials(count: int, ends: tuple[int, int], u: Array, order: int = 0) -> Array:
    """Return orthonormal polynomials on [-1, 1] that vanish at the ends, or derivatives of them.

    They are (1 + u)^a (1 - u)^b P_n^(2b, 2a)(u), with P_n the polynomials of Jacobi: of all
    polynomials with zeros of orders a and b at the ends, these are orthonormal.

    Parameters
    ----------
    count : int
        How many, from n = 0.
    ends : pair of int
        Orders a and b of the zeros at u = -1 and u = 1.
    u : array (K,)
    order : int
        Of the derivative: 0, 1 or 2.

    Returns
    -------
    array (K, count)
    """
    a, b = ends
    factor = np.polynomial.Polynomial([1.0, 1.0]) ** a * np.polynomial.Polynomial([1.0, -1.0]) ** b
    total = np.zeros((len(u), count))
    for taken, binomial in enumerate(((1,), (1, 1), (1, 2, 1))[order]):
        weights = factor.deriv(order - taken)(u) if order > taken else factor(u)
        total += binomial * weights[:, None] * _jacobi(count, (2 * b, 2 * a), u, taken)
    return total / _norms(count, ends)


def _jacobi(count: int, powers: tuple[int, int], u: Array, order: int) -> Array:
    """Return derivatives of Jacobi's polynomials at u (K, count)."""
    numbers, (alpha, beta) = np.arange(count), powers
    factors = np.ones(count)
    for taken in range(order):
        factors = factors * (numbers + alpha + beta + 1 + taken) / 2
    lower = np.maximum(numbers - order, 0)
    values = eval_jacobi(lower, alpha + order, beta + order, u[:, None])
    return np.where(numbers >= order, factors * values, 0.0)


def _norms(count: int, ends: tuple[int, int]) -> Array:
    a, b = ends
    u, weights = leggauss(count + a + b + 1)
    factor = (1 + u) ** a * (1 - u) ** b
    values = factor[:, None] * _jacobi(count, (2 * b, 2 * a), u, 0)
    return np.sqrt(weights @ np.square(values))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RitzForms:
    """Sums of products of `edge_polynomials` along x and y, with a mean square of 1.

    Parameters
    ----------
    length, width : float
        m.
    ends : array (2, 2)
        Orders of the zeros at both ends, along x and along y.
    stride : array (2,)
        2 where only even or only odd polynomials occur in a mode, 1 elsewhere; along x and y.
    starts : array (M, 2)
        Numbers of the first polynomials of each mode.
    coefficients : array (M, I, J)
    """

    length: float
    width: float
    ends: Index
    stride: Index
    starts: Index
    coefficients: Array

    @property
    def dimensions(self) -> int:
        """Two: x and y."""
        return 2

    def values(self, places: Array) -> Array:
        """Return the deflections at x and y in m (K, 2): (K, M)."""
        shares = np.clip(np.asarray(places)[:, :2] / (self.length, self.width), 0.0, 1.0)
        along, across = (self._polynomials(2 * shares[:, axis] - 1, axis) for axis in (0, 1))
        values = np.empty((len(shares), len(self.starts)))
        for start in np.unique(self.starts, axis=0):
            modes = np.flatnonzero((self.starts == start).all(axis=1))
            x, y = (
                functions[:, first::stride]
                for functions, first, stride in zip(
                    (along, across), start, self.stride, strict=True
                )
            )
            values[:, modes] = _products(x, y, self.coefficients[modes])
        return 2 * values

    def _polynomials(self, u: Array, axis: int) -> Array:
        """Return all polynomials along an axis (K, N), each place once."""
        distinct, back = np.unique(u, return_inverse=True)
        count = int(self.stride[axis]) * self.coefficients.shape[1 + axis]
        ends = (int(self.ends[axis, 0]), int(self.ends[axis, 1]))
        return edge_polynomials(count, ends, distinct)[back]

    def chosen(self, modes: Index) -> Self:
        """Return the deflections of some modes, in that order."""
        return replace(self, starts=self.starts[modes], coefficients=self.coefficients[modes])


def _products(x: Array, y: Array, coefficients: Array) -> Array:
    """Return sums over i and j of x_i c_mij y_j: (K, M)."""
    modes, rows, columns = coefficients.shape
    flat = coefficients.transpose(1, 0, 2).reshape(rows, modes * columns)
    step = max(1, _AT_ONCE // flat.shape[1])
    parts = []
    for first in range(0, len(x), step):
        some = slice(first, first + step)
        mixed = (x[some, :rows] @ flat).reshape(-1, modes, columns)
        parts.append(np.einsum("kmj,kj->km", mixed, y[some, :columns]))
    return np.concatenate(parts)

"""Bending of rectangular plates by Rayleigh and Ritz, with orthonormal polynomials."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.polynomial.legendre import leggauss
from numpy.typing import NDArray

from struck.errors import SolverError
from struck.shapes.ritz_forms import edge_polynomials

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Ends = tuple[int, int]

# Rigid motions keep this share of the least that is not zero, by rounding.
_ZERO = 1e-6


@dataclass(frozen=True, kw_only=True, eq=False)
class Axis:
    """Integrals over one axis, [-1, 1], of products of its polynomials' derivatives.

    Parameters
    ----------
    ends : pair of int
        Zeros of the polynomials there: 0 free, 1 supported, 2 clamped.
    count : int
        Polynomials.
    scale : float
        du / dx, 1/m.
    """

    ends: Ends
    count: int
    scale: float

    @cached_property
    def _derivatives(self) -> tuple[Array, Array, Array, Array]:
        u, weights = leggauss(self.count + sum(self.ends) + 1)
        roots = np.sqrt(weights)[:, None]
        functions = [
            edge_polynomials(self.count, self.ends, u, order) * self.scale**order * roots
            for order in range(3)
        ]
        return functions[0], functions[1], functions[2], u

    @cached_property
    def slopes(self) -> Array:
        """Of first derivatives with first derivatives, 1/m^2."""
        _, first, _, _ = self._derivatives
        return first.T @ first

    @cached_property
    def curvatures(self) -> Array:
        """Of second derivatives with second derivatives, 1/m^4."""
        _, _, second, _ = self._derivatives
        return second.T @ second

    @cached_property
    def mixed(self) -> Array:
        """Of functions with second derivatives, 1/m^2."""
        values, _, second, _ = self._derivatives
        return values.T @ second

    @property
    def stride(self) -> int:
        """2 where equal ends make even and odd functions strangers, else 1."""
        return 2 if self.ends[0] == self.ends[1] else 1

    def rigid(self) -> int:
        """Return how many of 1 and x vanish at the ends as they must."""
        return {(0, 0): 2, (0, 1): 1, (1, 0): 1}.get(self.ends, 0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Plate:
    """Modes of a plate whose bending stiffness equals its mass per area.

    Parameters
    ----------
    squared : array (M,)
        Squares of the angular frequencies, 1/m^4, ascending, without rigid motions.
    slopes : array (M,)
        Their derivatives by Poisson's ratio.
    starts : array (M, 2)
    stride : array (2,)
    coefficients : array (M, I, J)
        As of `RitzForms`, the sum of their squares 1.
    """

    squared: Array
    slopes: Array
    starts: Index
    stride: Index
    coefficients: Array


def bend(along: Axis, across: Axis, poisson_ratio: float) -> Plate:
    """Return all modes that the polynomials can form.

    Raises
    ------
    SolverError
        When rigid motions do not stand apart.
    """
    stride = np.array([along.stride, across.stride])
    blocks = [
        _Block.of(along, across, poisson_ratio, start)
        for start in itertools.product(range(stride[0]), range(stride[1]))
    ]
    squared = np.concatenate([block.squared for block in blocks])
    order = np.argsort(squared, kind="stable")[_rigid_motions(along, across) :]
    _require_apart(squared, len(squared) - len(order))
    shape = np.max([block.vectors.shape[1:] for block in blocks], axis=0)
    padded = [
        np.pad(
            block.vectors, ((0, 0), *((0, m - n) for m, n in zip(shape, block.shape, strict=True)))
        )
        for block in blocks
    ]
    starts = np.concatenate([np.tile(block.start, (len(block.squared), 1)) for block in blocks])
    return Plate(
        squared=squared[order],
        slopes=np.concatenate([block.slopes for block in blocks])[order],
        starts=starts[order],
        stride=stride,
        coefficients=np.concatenate(padded)[order],
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Block:
    """Modes of one symmetry."""

    start: tuple[int, int]
    squared: Array
    slopes: Array
    vectors: Array

    @property
    def shape(self) -> tuple[int, ...]:
        return self.vectors.shape[1:]

    @classmethod
    def of(cls, x: Axis, y: Axis, poisson_ratio: float, start: tuple[int, int]) -> _Block:
        some = tuple(
            slice(first, None, axis.stride) for first, axis in zip(start, (x, y), strict=True)
        )

        def product(left: Array, right: Array) -> Array:
            both = np.kron(left[some[0], some[0]], right[some[1], some[1]])
            return np.asarray(both, np.float64)

        ones = np.eye(x.count), np.eye(y.count)
        twist = product(x.slopes, y.slopes)
        across = product(x.mixed, y.mixed.T) + product(x.mixed.T, y.mixed)
        pure = product(x.curvatures, ones[1]) + product(ones[0], y.curvatures) + 2 * twist
        crossed = across - 2 * twist
        squared, vectors = _solved(pure + poisson_ratio * crossed, min(x.scale, y.scale))
        slopes = np.einsum("im,ij,jm->m", vectors, crossed, vectors, optimize=True)
        rows = len(range(x.count)[some[0]])
        return cls(
            start=start,
            squared=squared,
            slopes=slopes,
            vectors=vectors.T.reshape(len(squared), rows, -1),
        )


def _solved(stiffness: Array, scale: float) -> tuple[Array, Array]:
    """Return eigenvalues, ascending, and vectors of length one.

    Solved for their inverses, with all functions equally stiff: then the lowest do not drown in
    the rounding of the highest, which are larger by the eighth power of the degree.
    """
    shift = scale**4
    shifted = stiffness + shift * np.eye(len(stiffness))
    weights = 1 / np.sqrt(np.diag(shifted))
    inverses, vectors = scipy.linalg.eigh(
        np.diag(weights**2), shifted * np.multiply.outer(weights, weights)
    )
    vectors = vectors[:, ::-1] * weights[:, None]
    squared = np.asarray(1 / inverses[::-1] - shift, np.float64)
    return squared, np.asarray(vectors / np.linalg.norm(vectors, axis=0), np.float64)


def _rigid_motions(along: Axis, across: Axis) -> int:
    """Return how many motions bend nothing: of 1, x and y those that the edges allow."""
    x, y = along.rigid(), across.rigid()
    if x == 2 and y == 2:
        return 3
    return int((x, y) in {(2, 1), (1, 2)})


def _require_apart(squared: Array, rigid: int) -> None:
    lowest = np.sort(squared)[: rigid + 1]
    if rigid and not np.abs(lowest[:-1]).max() < _ZERO * lowest[-1]:
        raise SolverError(
            f"a rigid motion of the plate came out at {math.sqrt(abs(lowest[-2])):.3g} 1/m^2, "
            f"its lowest mode at {math.sqrt(abs(lowest[-1])):.3g}: the plate is too slender for "
            "this method; take a Bar"
        )

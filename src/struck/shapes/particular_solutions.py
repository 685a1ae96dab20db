"""Eigenvalues of a membrane held along a polygon, by the method of particular solutions.

Solutions of the Helmholtz equation that nearly vanish along the boundary while they do not inside
belong to nearly an eigenvalue (Fox, Henrici & Moler 1967); the smallest singular values of an
orthonormal basis on the boundary find them stably (Betcke & Trefethen 2005).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import cast

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from struck.shapes.fourier_bessel import Basis, Sight
from struck.shapes.plan_nodes import all_over, along_edges, scattered

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# Directions of the basis that are smaller than this are noise: leaving them out keeps
# coefficients near 1 (Barnett & Betcke 2008, section 4).
_DEPENDENT = 1e-13
_INSIDE = 200  # places
_STEADY = 1e-13  # relative step at which an eigenvalue stands still
_IDLE = 0.1  # share of the tension: smaller steps would not lower it
_ROUNDS = 12
_UNSURE = 100.0  # times the square of a relative step: how unsure a value still is


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """An eigenvalue with its function.

    Parameters
    ----------
    value : float
        1/m^2.
    wavenumber : float
        With which the function solves the Helmholtz equation: the root of the value, but for
        rounding and the last, small step, 1/m.
    coefficients : array (F,)
        The function in the basis, with a mean square of 1.
    error : float
        The distance to a true eigenvalue is at most this share of it.
    """

    value: float
    wavenumber: float
    coefficients: Array
    error: float


class Trial:
    """Particular solutions, looked at along the boundary and inside."""

    def __init__(self, basis: Basis) -> None:
        self._basis = basis
        self._edges = along_edges(basis.plan, self._counts)
        self._on_edges = basis.sight(self._edges.points, self._edges.ears)
        inside = scattered(basis.plan, _INSIDE)
        self._inside = basis.sight(inside.points, inside.ears)

    @property
    def _counts(self) -> Array:
        """How many nodes edges need (n,): for steep functions, for waves and for near sources."""
        plan = self._basis.plan
        near = np.bincount(plan.nearest_edges(self._basis.sources), minlength=len(plan.corners))
        waves = self._basis.highest * plan.lengths
        return 40 + 0.7 * self._basis.steepest + 1.5 * waves + 3.5 * near

    @cached_property
    def _everywhere(self) -> tuple[Sight, Array]:
        nodes = all_over(self._basis.plan, self._basis.highest)
        return self._basis.sight(nodes.points, nodes.ears), nodes.weights

    @cached_property
    def _between(self) -> Sight:
        nodes = along_edges(self._basis.plan, 1.7 * self._counts, 1.5)
        return self._basis.sight(nodes.points, nodes.ears)

    def smallest(self, value: float, count: int) -> tuple[Array, Array]:
        """Return the smallest tensions (count,) at a trial value, and the functions (F, count).

        A tension is the root of the mean square along the boundary, over that over boundary and
        inside together.
        """
        wavenumber = np.sqrt(value)
        rim, inner = self._on_edges.columns(wavenumber), self._inside.columns(wavenumber)
        rows = np.vstack([rim / np.sqrt(len(rim)), inner / np.sqrt(len(inner))])
        scale = np.linalg.norm(rows, axis=0)
        factors = scipy.linalg.qr(rows / scale, mode="economic", pivoting=True, check_finite=False)
        orthonormal, triangle, order = cast("tuple[Array, Array, Index]", factors)
        diagonal = np.abs(np.diag(triangle))
        rank = int(np.count_nonzero(diagonal > _DEPENDENT * diagonal[0]))
        small = scipy.linalg.qr(orthonormal[: len(rim), :rank], mode="r", check_finite=False)[0]
        _, tensions, turned = scipy.linalg.svd(small[:rank], check_finite=False)
        chosen = turned[::-1][:count].T
        functions = np.zeros((len(scale), chosen.shape[1]))
        solved = scipy.linalg.solve_triangular(triangle[:rank, :rank], chosen)
        functions[order[:rank]] = solved / scale[order[:rank], None]
        return tensions[::-1][:count], functions

    def improved(self, value: float, functions: Array) -> tuple[Array, Array]:
        """Return better eigenvalues (m,), ascending, and functions (F, m) with mean squares of 1.

        Green's second identity between a trial function u and the eigenfunction gives the
        eigenvalue's distance, - integral of u du/dn / integral of u^2, to second order.
        """
        wavenumber = np.sqrt(value)
        values = self._on_edges.sums(wavenumber, functions)
        slopes = self._on_edges.slopes(wavenumber, self._edges.normals) @ functions
        flux = values.T @ (self._edges.weights[:, None] * slopes)
        steps, turned = scipy.linalg.eigh(-(flux + flux.T) / 2, self._products(value, functions))
        return value + steps, functions @ turned * np.sqrt(self._basis.plan.area)

    def _products(self, value: float, functions: Array) -> Array:
        """Return the integrals of products of functions over the plan."""
        sight, weights = self._everywhere
        values = sight.sums(np.sqrt(value), functions)
        return values.T @ (weights[:, None] * values)

    def error(self, value: float, functions: Array) -> Array:
        """Return bounds of the relative distances to true eigenvalues (m,), for mean squares of 1.

        An eigenvalue lies within |u|max / rms(u) of a trial value, relative to itself, the
        largest along the boundary (Moler & Payne 1968); here among about as many places again.
        """
        largest = np.abs(self._between.sums(np.sqrt(value), functions)).max(axis=0)
        return largest + np.finfo(np.float64).eps


def refined(trial: Trial, value: float, count: int, apart: float) -> list[Found]:
    """Return `count` neighbouring eigenvalues around a near value, with their functions.

    Those closer than `apart`, relatively, are refined as one: their functions stay orthogonal.
    """
    steps, values, functions = np.zeros(count), np.full(count, value), np.zeros((0, count))
    for _ in range(_ROUNDS):
        tensions, functions = trial.smallest(value, count)
        values, functions = trial.improved(value, functions)
        steps = np.abs(values / value - 1)
        groups = _parted(values, max(apart, _UNSURE * float(steps.max()) ** 2))
        if len(groups) > 1:
            parts = [refined(trial, float(each.mean()), len(each), apart) for each in groups]
            gaps = [after[0].value - before[-1].value for before, after in pairwise(parts)]
            if min(gaps) > apart * value:
                return [found for part in parts for found in part]
            apart = np.inf  # they ran into each other
        if abs(values.mean() / value - 1) <= max(_STEADY, _IDLE * tensions[0]):
            break
        value = float(values.mean())
    errors = trial.error(value, functions) + steps
    return [
        Found(
            value=float(each),
            wavenumber=float(np.sqrt(value)),
            coefficients=functions[:, i],
            error=float(errors[i]),
        )
        for i, each in enumerate(values)
    ]


def _parted(values: Array, apart: float) -> list[Array]:
    """Part ascending values where they lie clearly apart."""
    least = np.maximum(apart * values[1:], 0.3 * (values[-1] - values[0]))
    return np.split(values, np.flatnonzero(np.diff(values) > least) + 1)

"""Eigenvalues of a membrane held along a polygon, by the method of particular solutions.

Fourier-Bessel functions J_nu(k r) sin(nu theta) about corners, nu a multiple of pi / angle, vanish
along both edges of their corner and have its singularity (Fox, Henrici & Moler 1967); fundamental
solutions Y_0(k r) about points outside make up what is smooth (Barnett & Betcke 2008). Sums of them
that nearly vanish along the boundary while they do not inside belong to nearly an eigenvalue; the
smallest singular values of an orthonormal basis on the boundary find them stably (Betcke &
Trefethen 2005).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import cast

import numpy as np
import scipy.linalg
from scipy.special import y1

from struck.errors import OptionError, rounded
from struck.model.arrays import Array, Index
from struck.shapes.bessel_series import (
    pair,
    series,
    series_slope,
    tabulate_irregular,
    tabulate_regular,
)
from struck.shapes.polygon import Polygon, area_nodes, edge_nodes, plan_of, random_nodes

_BATCH_SIZE = 2048


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Basis:
    """Solutions of the Helmholtz equation in a polygon that trial functions are summed of."""

    plan: Polygon
    centres: Index  # (S,), corners with Fourier-Bessel functions
    counts: Index  # (S,), numbers of functions about each
    sources: Array  # (C, 2), centres of fundamental solutions, m
    highest: float  # largest wavenumber, 1/m

    @property
    def size(self) -> int:
        """Number of basis functions, F."""
        return int(self.counts.sum()) + len(self.sources)

    @property
    def steepest(self) -> float:
        """Largest excess of the orders over the orders of the waves."""
        plan = self.plan
        orders = self.counts * plan.powers[self.centres]
        return float(np.max(orders - self.highest * plan.reaches[self.centres], initial=0.0))

    def at(self, points: Array, ears: Index) -> BasisAtPoints:
        """Return the functions at points (K, 2) in ears (K,) of the plan, for any wavenumber."""
        fans = []
        for centre, count in zip(self.centres.tolist(), self.counts.tolist(), strict=True):
            radii, angles = self.plan.polar(centre, points, ears)
            reach, power = float(self.plan.reaches[centre]), float(self.plan.powers[centre])
            factors = (radii / reach) ** power * np.exp(1j * power * angles)
            # By repeated products: errors stay far below those of the sines of large numbers.
            waves = np.cumprod(np.repeat(factors[:, None], count, axis=1), axis=1)
            fans.append(
                _Fan(
                    vectors=points - self.plan.corners[centre],
                    radii=radii,
                    sines=np.ascontiguousarray(waves.imag, dtype=np.float64),
                    cosines=np.ascontiguousarray(waves.real, dtype=np.float64),
                    orders=power * np.arange(1, count + 1, dtype=np.float64),
                    table=tabulate_regular(power, count, int(self.highest * reach) + 2),
                )
            )
        return BasisAtPoints(fans=tuple(fans), vectors=points[:, None] - self.sources)


class BasisAtPoints:
    """The functions of a basis at some points, for any wavenumber."""

    def __init__(self, fans: tuple[_Fan, ...], vectors: Array) -> None:
        self._fans = fans
        self._vectors = vectors
        self._distances = np.linalg.norm(vectors, axis=2)
        self._logarithms = np.log(self._distances / 2)

    def columns(self, wavenumber: float) -> Array:
        """Return the functions at the points: (K, F)."""
        parts = [fan.columns(wavenumber) for fan in self._fans]
        if self._distances.shape[1]:
            parts.append(self._fundamental_columns(wavenumber))
        return np.hstack(parts)

    def sums(self, wavenumber: float, coefficients: Array) -> Array:
        """Return sums of the functions with coefficients (F, m) at the points: (K, m)."""
        return self.columns(wavenumber) @ coefficients

    def slopes(self, wavenumber: float, directions: Array) -> Array:
        """Return the functions' slopes along directions (K, 2): (K, F), 1/m."""
        parts = [fan.slopes(wavenumber, directions) for fan in self._fans]
        if self._distances.shape[1]:
            towards = np.einsum("ksi,ki->ks", self._vectors, directions) / self._distances
            parts.append(-wavenumber * y1(wavenumber * self._distances) * towards)
        return np.hstack(parts)

    def _fundamental_columns(self, wavenumber: float) -> Array:
        arguments = wavenumber * self._distances
        bessel_pairs = pair(arguments, tabulate_irregular(int(arguments.max()) + 1))
        return (
            2 / np.pi * (self._logarithms + np.log(wavenumber)) * bessel_pairs[0] + bessel_pairs[1]
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fan:
    """Fourier-Bessel functions about one corner at some points: (r / reach)^nu sin(nu theta)."""

    vectors: Array
    radii: Array
    sines: Array
    cosines: Array
    orders: Array
    table: Array

    def columns(self, wavenumber: float) -> Array:
        return self.sines * series(wavenumber * self.radii, self.table)

    def slopes(self, wavenumber: float, directions: Array) -> Array:
        radial_units = self.vectors / self.radii[:, None]
        radial_parts = np.sum(radial_units * directions, axis=1)[:, None]
        tangential_parts = (
            radial_units[:, 0] * directions[:, 1] - radial_units[:, 1] * directions[:, 0]
        )[:, None]
        value = series(wavenumber * self.radii, self.table)
        rise = wavenumber * series_slope(wavenumber * self.radii, self.table)
        swirl = self.orders / self.radii[:, None] * value
        sine_slopes = swirl * self.sines + rise * self.sines
        return radial_parts * sine_slopes + tangential_parts * swirl * self.cosines


_MAX_PHASE = 1e4  # radians of a wave along the plan


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PolygonForms:
    """Mode shapes of a membrane held along a polygon: sums of Helmholtz solutions."""

    corners: Array  # (n, 2), counter-clockwise, m
    centres: Index  # (S,), corners with Fourier-Bessel functions
    counts: Index  # (S,), numbers of functions about each
    sources: Array  # (C, 2), centres of fundamental solutions outside, m
    wavenumbers: Array  # (M,), 1/m
    coefficients: Array  # (M, F), of all functions
    dimensions = 2  # coordinates of a place: x and y

    def __post_init__(self) -> None:
        expected_shape = (len(self.wavenumbers), int(self.counts.sum()) + len(self.sources))
        places = np.concatenate([self.corners, self.sources])
        waves = self.wavenumbers.max(initial=0.0) * np.ptp(places, axis=0).max()
        if (
            self.coefficients.shape != expected_shape
            or not waves <= _MAX_PHASE
            or self.counts.min() < 0
        ):
            raise OptionError(
                f"{self.coefficients.shape} coefficients of {expected_shape} are given, or the "
                f"shapes have {rounded(waves, 3)} radians along the plan and at most "
                f"{_MAX_PHASE:g} fit: "
                "compute the membrane again"
            )

    def values(self, places: Array) -> Array:
        """Return the shapes at places (K, 2), m; outside places count as on the nearest edge."""
        basis = Basis(
            plan=plan_of(self.corners),
            centres=self.centres,
            counts=self.counts,
            sources=self.sources,
            highest=float(self.wavenumbers.max(initial=0.0)),
        )
        places = np.asarray(places, dtype=np.float64)
        values = np.empty((len(places), len(self.wavenumbers)))
        for start in range(0, len(places), _BATCH_SIZE):
            part = slice(start, start + _BATCH_SIZE)
            at_points = basis.at(*basis.plan.locate(places[part]))
            for mode, wavenumber in enumerate(self.wavenumbers.tolist()):
                values[part, mode] = at_points.sums(wavenumber, self.coefficients[[mode]].T)[:, 0]
        return values

    def chosen(self, modes: Index) -> PolygonForms:
        """Return the shapes of some modes, in that order."""
        return replace(
            self, wavenumbers=self.wavenumbers[modes], coefficients=self.coefficients[modes]
        )


# Directions of the basis that are smaller than this are noise: leaving them out keeps
# coefficients near 1 (Barnett & Betcke 2008, section 4).
_DEPENDENT = 1e-13
_INNER_COUNT = 200  # places
_CONVERGED_STEP = 1e-13  # relative step at which an eigenvalue stands still
# Fraction of the tension over the waves' phase: smaller steps would not lower it.
_IDLE_FRACTION = 0.5
_ROUNDS = 12
_UNCERTAINTY = 100.0  # times the square of a relative step: how unsure a value still is


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Eigenfunction:
    """An eigenvalue of the membrane with its eigenfunction."""

    value: float  # 1/m^2
    wavenumber: float  # of the function, 1/m: root of the value, up to rounding and the last step
    coefficients: Array  # (F,), the function in the basis, with a mean square of 1
    error: float  # bound of the distance to a true eigenvalue, relative


class Trial:
    """Trial functions of a basis along the boundary and inside."""

    def __init__(self, basis: Basis) -> None:
        self._basis = basis
        self._edges = edge_nodes(basis.plan, self._counts)
        self._on_edges = basis.at(self._edges.points, self._edges.ears)
        inner_nodes = random_nodes(basis.plan, _INNER_COUNT)
        self._at_inner = basis.at(inner_nodes.points, inner_nodes.ears)

    @property
    def _counts(self) -> Array:
        """Numbers of nodes on the edges (n,): for steep functions, waves and near sources."""
        plan = self._basis.plan
        source_counts = np.bincount(
            plan.find_nearest_edges(self._basis.sources), minlength=len(plan.corners)
        )
        waves = self._basis.highest * plan.lengths
        return 40 + 0.7 * self._basis.steepest + 1.5 * waves + 3.5 * source_counts

    def phase(self, value: float) -> float:
        """Return the phase of a value's waves along the root of the area, radians."""
        return float(np.sqrt(value * self._basis.plan.area))

    @cached_property
    def _area_samples(self) -> tuple[BasisAtPoints, Array]:
        nodes = area_nodes(self._basis.plan, self._basis.highest)
        return self._basis.at(nodes.points, nodes.ears), nodes.weights

    @cached_property
    def _at_checkpoints(self) -> BasisAtPoints:
        nodes = edge_nodes(self._basis.plan, 1.7 * self._counts, 1.5)
        return self._basis.at(nodes.points, nodes.ears)

    def find_smallest(self, value: float, count: int) -> tuple[Array, Array]:
        """Return the smallest tensions (count,) at a trial value, and their functions (F, count).

        A tension is the root of the mean square along the boundary, over that over boundary and
        inside together.
        """
        wavenumber = np.sqrt(value)
        rim, inner = self._on_edges.columns(wavenumber), self._at_inner.columns(wavenumber)
        rows = np.vstack([rim / np.sqrt(len(rim)), inner / np.sqrt(len(inner))])
        scale = np.linalg.norm(rows, axis=0)
        factors = scipy.linalg.qr(rows / scale, mode="economic", pivoting=True, check_finite=False)
        orthonormal, triangle, order = cast("tuple[Array, Array, Index]", factors)
        diagonal = np.abs(np.diag(triangle))
        rank = int(np.count_nonzero(diagonal > _DEPENDENT * diagonal[0]))
        small = scipy.linalg.qr(orthonormal[: len(rim), :rank], mode="r", check_finite=False)[0]
        _, tensions, right_vectors = scipy.linalg.svd(small[:rank], check_finite=False)
        chosen = right_vectors[::-1][:count].T
        functions = np.zeros((len(scale), chosen.shape[1]))
        solutions = scipy.linalg.solve_triangular(triangle[:rank, :rank], chosen)
        functions[order[:rank]] = solutions / scale[order[:rank], None]
        return tensions[::-1][:count], functions

    def improve(self, value: float, functions: Array) -> tuple[Array, Array]:
        """Return better eigenvalues (m,), ascending, and functions (F, m) with mean squares of 1.

        Green's second identity between a trial function u and the eigenfunction gives the
        eigenvalue's distance, - integral of u du/dn / integral of u^2, to second order.
        """
        wavenumber = np.sqrt(value)
        values = self._on_edges.sums(wavenumber, functions)
        slopes = self._on_edges.slopes(wavenumber, self._edges.normals) @ functions
        flux = values.T @ (self._edges.weights[:, None] * slopes)
        steps, rotation = scipy.linalg.eigh(-(flux + flux.T) / 2, self._products(value, functions))
        return value + steps, functions @ rotation * np.sqrt(self._basis.plan.area)

    def _products(self, value: float, functions: Array) -> Array:
        """Return the integrals of products of two basis functions over the area of a membrane."""
        at_points, weights = self._area_samples
        values = at_points.sums(np.sqrt(value), functions)
        return values.T @ (weights[:, None] * values)

    def error(self, value: float, functions: Array) -> Array:
        """Return bounds of relative distances to true eigenvalues (m,), for mean squares of 1.

        An eigenvalue lies within |u|max / rms(u) of a trial value, relative to itself, the largest
        along the boundary (Moler & Payne 1968); here among about as many places again.
        """
        max_values = np.abs(self._at_checkpoints.sums(np.sqrt(value), functions)).max(axis=0)
        return max_values + np.finfo(np.float64).eps


def refine(trial: Trial, value: float, count: int, min_gap: float) -> list[Eigenfunction]:
    """Return `count` neighbouring eigenvalues around a near value, with their functions.

    Those closer than `min_gap`, relatively, are refined as one: their functions stay orthogonal.
    """
    steps, values, functions = np.zeros(count), np.full(count, value), np.zeros((0, count))
    for _ in range(_ROUNDS):
        tensions, functions = trial.find_smallest(value, count)
        idle_step = _IDLE_FRACTION * tensions[0] / trial.phase(value)
        values, functions = trial.improve(value, functions)
        steps = np.abs(values / value - 1)
        groups = _split_groups(values, max(min_gap, _UNCERTAINTY * float(steps.max()) ** 2))
        if len(groups) > 1:
            parts = [refine(trial, float(group.mean()), len(group), min_gap) for group in groups]
            gaps = [right[0].value - left[-1].value for left, right in pairwise(parts)]
            if min(gaps) > min_gap * value:
                return [mode for part in parts for mode in part]
            min_gap = np.inf  # they ran into each other
        if abs(values.mean() / value - 1) <= max(_CONVERGED_STEP, idle_step):
            break
        value = float(values.mean())
    errors = trial.error(value, functions) + steps
    return [
        Eigenfunction(
            value=float(group),
            wavenumber=float(np.sqrt(value)),
            coefficients=functions[:, i],
            error=float(errors[i]),
        )
        for i, group in enumerate(values)
    ]


def _split_groups(values: Array, min_gap: float) -> list[Array]:
    """Split ascending values at clear gaps."""
    min_gaps = np.maximum(min_gap * values[1:], 0.3 * (values[-1] - values[0]))
    return np.split(values, np.flatnonzero(np.diff(values) > min_gaps) + 1)

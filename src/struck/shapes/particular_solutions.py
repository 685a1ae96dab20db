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
from struck.shapes.bessel_series import irregular, pair, regular, series, series_slope
from struck.shapes.polygon import Polygon, all_over, along_edges, plan_of, scattered

_PLACES_AT_ONCE = 2048


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
            turn = (radii / reach) ** power * np.exp(1j * power * angles)
            # By repeated products: errors stay far below those of the sines of large numbers.
            waves = np.cumprod(np.repeat(turn[:, None], count, axis=1), axis=1)
            fans.append(
                _Fan(
                    apart=points - self.plan.corners[centre],
                    radii=radii,
                    sines=np.ascontiguousarray(waves.imag, dtype=np.float64),
                    cosines=np.ascontiguousarray(waves.real, dtype=np.float64),
                    orders=power * np.arange(1, count + 1, dtype=np.float64),
                    table=regular(power, count, int(self.highest * reach) + 2),
                )
            )
        return BasisAtPoints(fans=tuple(fans), apart=points[:, None] - self.sources)


class BasisAtPoints:
    """The functions of a basis at some points, for any wavenumber."""

    def __init__(self, fans: tuple[_Fan, ...], apart: Array) -> None:
        self._fans = fans
        self._apart = apart
        self._distances = np.linalg.norm(apart, axis=2)
        self._logarithms = np.log(self._distances / 2)

    def columns(self, wavenumber: float) -> Array:
        """Return the functions at the points: (K, F)."""
        parts = [fan.columns(wavenumber) for fan in self._fans]
        if self._distances.shape[1]:
            parts.append(self._irregular(wavenumber))
        return np.hstack(parts)

    def sums(self, wavenumber: float, coefficients: Array) -> Array:
        """Return sums of the functions with coefficients (F, m) at the points: (K, m)."""
        return self.columns(wavenumber) @ coefficients

    def slopes(self, wavenumber: float, directions: Array) -> Array:
        """Return the functions' slopes along directions (K, 2): (K, F), 1/m."""
        parts = [fan.slopes(wavenumber, directions) for fan in self._fans]
        if self._distances.shape[1]:
            towards = np.einsum("ksi,ki->ks", self._apart, directions) / self._distances
            parts.append(-wavenumber * y1(wavenumber * self._distances) * towards)
        return np.hstack(parts)

    def _irregular(self, wavenumber: float) -> Array:
        arguments = wavenumber * self._distances
        even = pair(arguments, irregular(int(arguments.max()) + 1))
        return 2 / np.pi * (self._logarithms + np.log(wavenumber)) * even[0] + even[1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fan:
    """Fourier-Bessel functions about one corner at some points: (r / reach)^nu sin(nu theta)."""

    apart: Array
    radii: Array
    sines: Array
    cosines: Array
    orders: Array
    table: Array

    def columns(self, wavenumber: float) -> Array:
        return self.sines * series(wavenumber * self.radii, self.table)

    def slopes(self, wavenumber: float, directions: Array) -> Array:
        outward = self.apart / self.radii[:, None]
        along = np.sum(outward * directions, axis=1)[:, None]
        around = (outward[:, 0] * directions[:, 1] - outward[:, 1] * directions[:, 0])[:, None]
        value = series(wavenumber * self.radii, self.table)
        rise = wavenumber * series_slope(wavenumber * self.radii, self.table)
        swirl = self.orders / self.radii[:, None] * value
        radial = swirl * self.sines + rise * self.sines
        return along * radial + around * swirl * self.cosines


_MOST_WAVES = 1e4  # radians of a wave along the plan


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
        wanted = (len(self.wavenumbers), int(self.counts.sum()) + len(self.sources))
        places = np.concatenate([self.corners, self.sources])
        waves = self.wavenumbers.max(initial=0.0) * np.ptp(places, axis=0).max()
        if self.coefficients.shape != wanted or not waves <= _MOST_WAVES or self.counts.min() < 0:
            raise OptionError(
                f"{self.coefficients.shape} coefficients of {wanted} are given, or the shapes have "
                f"{rounded(waves, 3)} radians along the plan and at most {_MOST_WAVES:g} fit: "
                "compute the membrane anew"
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
        found = np.empty((len(places), len(self.wavenumbers)))
        for start in range(0, len(places), _PLACES_AT_ONCE):
            part = slice(start, start + _PLACES_AT_ONCE)
            at_points = basis.at(*basis.plan.located(places[part]))
            for mode, wavenumber in enumerate(self.wavenumbers.tolist()):
                found[part, mode] = at_points.sums(wavenumber, self.coefficients[[mode]].T)[:, 0]
        return found

    def chosen(self, modes: Index) -> PolygonForms:
        """Return the shapes of some modes, in that order."""
        return replace(
            self, wavenumbers=self.wavenumbers[modes], coefficients=self.coefficients[modes]
        )


# Directions of the basis that are smaller than this are noise: leaving them out keeps
# coefficients near 1 (Barnett & Betcke 2008, section 4).
_DEPENDENT = 1e-13
_INSIDE = 200  # places
_STEADY = 1e-13  # relative step at which an eigenvalue stands still
_IDLE = 0.5  # share of the tension over the waves' phase: smaller steps would not lower it
_ROUNDS = 12
_UNSURE = 100.0  # times the square of a relative step: how unsure a value still is


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Found:
    """An eigenvalue of the membrane with its eigenfunction."""

    value: float  # 1/m^2
    wavenumber: float  # of the function, 1/m: root of the value, but for rounding and the last step
    coefficients: Array  # (F,), the function in the basis, with a mean square of 1
    error: float  # bound of the distance to a true eigenvalue, relative


class Trial:
    """Trial functions of a basis along the boundary and inside."""

    def __init__(self, basis: Basis) -> None:
        self._basis = basis
        self._edges = along_edges(basis.plan, self._counts)
        self._on_edges = basis.at(self._edges.points, self._edges.ears)
        inside = scattered(basis.plan, _INSIDE)
        self._inside = basis.at(inside.points, inside.ears)

    @property
    def _counts(self) -> Array:
        """Numbers of nodes on the edges (n,): for steep functions, waves and near sources."""
        plan = self._basis.plan
        near = np.bincount(plan.nearest_edges(self._basis.sources), minlength=len(plan.corners))
        waves = self._basis.highest * plan.lengths
        return 40 + 0.7 * self._basis.steepest + 1.5 * waves + 3.5 * near

    def phase(self, value: float) -> float:
        """Return the phase of a value's waves along the root of the area, radians."""
        return float(np.sqrt(value * self._basis.plan.area))

    @cached_property
    def _everywhere(self) -> tuple[BasisAtPoints, Array]:
        nodes = all_over(self._basis.plan, self._basis.highest)
        return self._basis.at(nodes.points, nodes.ears), nodes.weights

    @cached_property
    def _between(self) -> BasisAtPoints:
        nodes = along_edges(self._basis.plan, 1.7 * self._counts, 1.5)
        return self._basis.at(nodes.points, nodes.ears)

    def smallest(self, value: float, count: int) -> tuple[Array, Array]:
        """Return the smallest tensions (count,) at a trial value, and their functions (F, count).

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
        """Return the integrals of products of two basis functions over the area of a membrane."""
        at_points, weights = self._everywhere
        values = at_points.sums(np.sqrt(value), functions)
        return values.T @ (weights[:, None] * values)

    def error(self, value: float, functions: Array) -> Array:
        """Return bounds of relative distances to true eigenvalues (m,), for mean squares of 1.

        An eigenvalue lies within |u|max / rms(u) of a trial value, relative to itself, the largest
        along the boundary (Moler & Payne 1968); here among about as many places again.
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
        idle = _IDLE * tensions[0] / trial.phase(value)
        values, functions = trial.improved(value, functions)
        steps = np.abs(values / value - 1)
        groups = _parted(values, max(apart, _UNSURE * float(steps.max()) ** 2))
        if len(groups) > 1:
            parts = [refined(trial, float(each.mean()), len(each), apart) for each in groups]
            gaps = [after[0].value - before[-1].value for before, after in pairwise(parts)]
            if min(gaps) > apart * value:
                return [found for part in parts for found in part]
            apart = np.inf  # they ran into each other
        if abs(values.mean() / value - 1) <= max(_STEADY, idle):
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

"""Rectangular plates with any mix of free, supported and clamped edges, by Rayleigh and Ritz."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
import scipy.linalg
from numpy.polynomial.legendre import leggauss
from scipy.special import eval_jacobi

from struck.errors import OptionError, SolverError, require_choice, rounded
from struck.model.arrays import Array, Index, checked
from struck.model.material import Material
from struck.shapes.shape import (
    Counterpart,
    Shape,
    Vibration,
    plate_overestimate,
    require_clamped_or_free,
    thinness,
)
from struck.shapes.skins import Rectangle, Sheet
from struck.solids import Block
from struck.solids.resolution import require_length

# Values held at once while many places are read.
_BATCH_VALUES = 2**22


def edge_polynomials(count: int, ends: tuple[int, int], u: Array, order: int = 0) -> Array:
    """Return orthonormal polynomials (K, count) with zeros at -1 and 1, or their derivatives.

    They are (1 + u)^a (1 - u)^b P_n^(2b, 2a)(u), n from 0 on, with P_n Jacobi's polynomials and
    `ends` the orders a and b of the zeros; `order` is that of the derivative.
    """
    a, b = ends
    factor = np.polynomial.Polynomial([1.0, 1.0]) ** a * np.polynomial.Polynomial([1.0, -1.0]) ** b
    values = np.zeros((len(u), count))
    for inner_order, binomial in enumerate(((1,), (1, 1), (1, 2, 1))[order]):
        weights = factor.deriv(order - inner_order)(u) if order > inner_order else factor(u)
        values += binomial * weights[:, None] * _jacobi(count, (2 * b, 2 * a), u, inner_order)
    return values / _norms(count, ends)


def _jacobi(count: int, powers: tuple[int, int], u: Array, order: int) -> Array:
    """Return derivatives of Jacobi's polynomials at u: (K, count)."""
    numbers, (alpha, beta) = np.arange(count), powers
    factors = np.ones(count)
    for step in range(order):
        factors = factors * (numbers + alpha + beta + 1 + step) / 2
    lower = np.maximum(numbers - order, 0)
    values = eval_jacobi(lower, alpha + order, beta + order, u[:, None])
    return np.where(numbers >= order, factors * values, 0.0)


def _norms(count: int, ends: tuple[int, int]) -> Array:
    a, b = ends
    u, weights = leggauss(count + a + b + 1)
    factor = (1 + u) ** a * (1 - u) ** b
    return np.sqrt(weights @ np.square(factor[:, None] * _jacobi(count, (2 * b, 2 * a), u, 0)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RitzForms:
    """Sums of products of `edge_polynomials` along x and y, with a mean square of 1."""

    length: float  # m
    width: float  # m
    ends: Index  # (2, 2), orders of the zeros at both ends, along x and along y
    stride: Index  # (2,), 2 where a mode has only even or only odd polynomials, else 1
    starts: Index  # (M, 2), first polynomials of each mode
    coefficients: Array  # (M, I, J)
    dimensions = 2  # coordinates of a place: x and y

    def __post_init__(self) -> None:
        max_entry = max(
            np.max(entries, initial=0) for entries in (self.ends, self.stride, self.starts)
        )
        if max_entry > 2:
            raise OptionError(
                f"ends, strides and starts of a plate's forms go up to {max_entry}, and at most "
                "to 2 in one that was computed: compute the plate again"
            )

    def values(self, places: Array) -> Array:
        """Return the deflections at x and y in m (K, 2): (K, M)."""
        positions = np.clip(np.asarray(places)[:, :2] / (self.length, self.width), 0.0, 1.0)
        x_values, y_values = (
            self._polynomials(2 * positions[:, axis] - 1, axis) for axis in (0, 1)
        )
        values = np.empty((len(positions), len(self.starts)))
        for start in np.unique(self.starts, axis=0):
            modes = np.flatnonzero((self.starts == start).all(axis=1))
            x = x_values[:, start[0] :: self.stride[0]]
            y = y_values[:, start[1] :: self.stride[1]]
            values[:, modes] = _products(x, y, self.coefficients[modes])
        return 2 * values

    def _polynomials(self, u: Array, axis: int) -> Array:
        """Return all polynomials along an axis (K, N), each place once."""
        unique_places, back = np.unique(u, return_inverse=True)
        count = int(self.stride[axis]) * self.coefficients.shape[1 + axis]
        ends = (int(self.ends[axis, 0]), int(self.ends[axis, 1]))
        return edge_polynomials(count, ends, unique_places)[back]

    def chosen(self, modes: Index) -> Self:
        """Return the deflections of some modes, in that order."""
        return replace(self, starts=self.starts[modes], coefficients=self.coefficients[modes])


def _products(x: Array, y: Array, coefficients: Array) -> Array:
    """Return sums over i and j of x_i c_mij y_j: (K, M)."""
    modes, rows, columns = coefficients.shape
    flat = coefficients.transpose(1, 0, 2).reshape(rows, modes * columns)
    step = max(1, _BATCH_VALUES // flat.shape[1])
    parts = []
    for first in range(0, len(x), step):
        block = slice(first, first + step)
        mixed = (x[block, :rows] @ flat).reshape(-1, modes, columns)
        parts.append(np.einsum("kmj,kj->km", mixed, y[block, :columns]))
    return np.concatenate(parts)


# Rigid motions keep this fraction of the least that is not zero, by rounding.
_ZERO = 1e-6
# Number of the functions 1, x and y that do not bend the plate, by how many of 1 and x the ends
# allow along both axes.
_RIGID_MOTIONS = {(2, 2): 3, (2, 1): 1, (1, 2): 1}


@dataclass(frozen=True, kw_only=True, eq=False)
class PolynomialAxis:
    """Integrals over one axis, [-1, 1], of products of its polynomials' derivatives."""

    ends: tuple[int, int]  # zeros of the polynomials there: 0 free, 1 supported, 2 clamped
    count: int  # number of polynomials
    length: float  # m

    @cached_property
    def _derivatives(self) -> list[Array]:
        """Functions and their first and second derivatives at Gauss points, times root weights."""
        u, weights = leggauss(self.count + sum(self.ends) + 1)
        roots, scale = np.sqrt(weights)[:, None], 2 / self.length
        return [
            edge_polynomials(self.count, self.ends, u, order) * scale**order * roots
            for order in range(3)
        ]

    @cached_property
    def slopes(self) -> Array:
        """Products of first derivatives, 1/m^2."""
        return self._derivatives[1].T @ self._derivatives[1]

    @cached_property
    def curvatures(self) -> Array:
        """Products of second derivatives, 1/m^4."""
        return self._derivatives[2].T @ self._derivatives[2]

    @cached_property
    def mixed(self) -> Array:
        """Products of functions with second derivatives, 1/m^2."""
        return self._derivatives[0].T @ self._derivatives[2]

    @property
    def stride(self) -> int:
        """Number 2 where equal ends make even and odd functions orthogonal, else 1."""
        return 2 if self.ends[0] == self.ends[1] else 1

    @property
    def rigid(self) -> int:
        """How many of 1 and x vanish at the ends as they must."""
        return {(0, 0): 2, (0, 1): 1, (1, 0): 1}.get(self.ends, 0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlateModes:
    """Modes of a plate whose bending stiffness equals its mass per area."""

    squared: Array  # (M,), squared angular frequencies, 1/m^4, ascending, without rigid motions
    slopes: Array  # (M,), their derivatives by Poisson's ratio
    forms: RitzForms


def bend(x_axis: PolynomialAxis, y_axis: PolynomialAxis, poisson_ratio: float) -> PlateModes:
    """Return all modes of the polynomials; SolverError if rigid motions are not separated."""
    stride = np.array([x_axis.stride, y_axis.stride])
    blocks = [
        _Block.of(x_axis, y_axis, poisson_ratio, start)
        for start in itertools.product(range(stride[0]), range(stride[1]))
    ]
    eigenvalues = np.concatenate([block.squared for block in blocks])
    rigid_count = _RIGID_MOTIONS.get((x_axis.rigid, y_axis.rigid), 0)
    order = np.argsort(eigenvalues, kind="stable")[rigid_count:]
    _require_gap(eigenvalues, rigid_count)
    first_indices = np.concatenate(
        [np.tile(block.start, (len(block.squared), 1)) for block in blocks]
    )
    coefficients = np.zeros(
        (len(eigenvalues), *np.max([b.vectors.shape[1:] for b in blocks], axis=0))
    )
    ends = np.cumsum([len(block.squared) for block in blocks])
    for block, end in zip(blocks, ends, strict=True):
        modes, rows, columns = block.vectors.shape
        coefficients[end - modes : end, :rows, :columns] = block.vectors
    return PlateModes(
        squared=eigenvalues[order],
        slopes=np.concatenate([block.slopes for block in blocks])[order],
        forms=RitzForms(
            length=x_axis.length,
            width=y_axis.length,
            ends=np.array([x_axis.ends, y_axis.ends]),
            stride=stride,
            starts=first_indices[order],
            coefficients=coefficients[order],
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Block:
    """Modes of one symmetry."""

    start: tuple[int, int]
    squared: Array
    slopes: Array
    vectors: Array

    @classmethod
    def of(
        cls, x: PolynomialAxis, y: PolynomialAxis, poisson_ratio: float, start: tuple[int, int]
    ) -> _Block:
        selections = tuple(
            slice(first, None, axis.stride) for first, axis in zip(start, (x, y), strict=True)
        )

        def product(left: Array, right: Array) -> Array:
            kron_product = np.kron(
                left[selections[0], selections[0]], right[selections[1], selections[1]]
            )
            return np.asarray(kron_product, np.float64)

        ones = np.eye(x.count), np.eye(y.count)
        twist = product(x.slopes, y.slopes)
        cross_terms = product(x.mixed, y.mixed.T) + product(x.mixed.T, y.mixed)
        pure = product(x.curvatures, ones[1]) + product(ones[0], y.curvatures) + 2 * twist
        poisson_part = cross_terms - 2 * twist
        eigenvalues, vectors = _solve(
            pure + poisson_ratio * poisson_part, 2 / max(x.length, y.length)
        )
        slopes = np.einsum("im,ij,jm->m", vectors, poisson_part, vectors, optimize=True)
        rows = len(range(x.count)[selections[0]])
        return cls(
            start=start,
            squared=eigenvalues,
            slopes=slopes,
            vectors=vectors.T.reshape(len(eigenvalues), rows, -1),
        )


def _solve(stiffness: Array, scale: float) -> tuple[Array, Array]:
    """Return eigenvalues, ascending, and vectors of length one."""
    shift = scale**4
    shifted_stiffness = stiffness + shift * np.eye(len(stiffness))
    weights = 1 / np.sqrt(np.diag(shifted_stiffness))
    inverses, vectors = scipy.linalg.eigh(
        np.diag(weights**2), shifted_stiffness * np.multiply.outer(weights, weights)
    )
    vectors = vectors[:, ::-1] * weights[:, None]
    eigenvalues = np.asarray(1 / inverses[::-1] - shift, np.float64)
    return eigenvalues, np.asarray(vectors / np.linalg.norm(vectors, axis=0), np.float64)


def _require_gap(eigenvalues: Array, rigid_count: int) -> None:
    low_values = np.sort(eigenvalues)[: rigid_count + 1]
    if rigid_count and not np.abs(low_values[:-1]).max() < _ZERO * low_values[-1]:
        raise SolverError(
            f"a rigid motion of the plate came out at {rounded(math.sqrt(abs(low_values[-2])), 3)} "
            f"1/m^2, its lowest mode at {rounded(math.sqrt(abs(low_values[-1])), 3)}: the plate "
            "is too slender for this method; take a Bar"
        )


EDGES = {"free": 0, "supported": 1, "clamped": 2}
# Polynomials in addition to those by half waves; and those per half wave, of which pi / 2 would do
# far from the edges, where evanescent waves need more.
_EXTRA_COUNT, _COUNT_PER_HALF_WAVE = 12, 1.75
# How much finer the second resolution is, whose frequencies are given, and how close the first
# must come to it.
_REFINEMENT, _CONVERGED_CHANGE, _ROUNDS = 1.15, 1e-5, 4
_MAX_FUNCTIONS = 5000
_ROUNDING = 1e-11
# What is still to come at corners where edges differ, over what the last step brought.
_REMAINING = 3.0


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class RectangularPlate(Shape):
    """A thin plate from x = 0 to length and y = 0 to width that resists bending.

    Parameters
    ----------
    length : float
        Length along x, m.
    width : float
        Width along y, m.
    thickness : float
        Thickness along z, m.
    edges : str or tuple of four str, default "free"
        "free", "supported" (held, and free to rotate) or "clamped": for all edges, or those at x =
        0, x = length, y = 0 and y = width.

    Raises
    ------
    OptionError
        If lengths are not positive, or edges are unknown.

    Notes
    -----
    Kirchhoff's theory, D (del^2)^2 w = density thickness (2 pi f)^2 w with
    D = E thickness^3 / (12 (1 - nu^2)), by Rayleigh and Ritz (Leissa 1969, appendix): products of
    polynomials that are held as the edges are, orthonormal over the plate, so that frequencies come
    down to those of the theory faster than any power of their number. `errors` is what they still
    moved from one number to a higher one; a model's hold what the theory overstates, too.

    Places: "middle" (also "top"), "quarter" of both lengths, "edge" 1 % off x = length, "corner"
    1 % off both far edges.

    Examples
    --------
    >>> plate = RectangularPlate(length=0.3, width=0.3, thickness=0.003, edges="clamped")
    >>> steel = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.3)
    >>> plate.vibration(steel, 1000.0).frequencies.round(1)
    array([291.6, 594.7, 594.7, 876.9])
    """

    length: float
    width: float
    thickness: float
    edges: str | tuple[str, str, str, str] = "free"

    def __post_init__(self) -> None:
        for name in ("length", "width", "thickness"):
            require_length(f"{name} of the plate", getattr(self, name))
        if len(self.around) != len(EDGES) + 1:
            raise OptionError(f"edges are {self.edges!r}: give one or four of {', '.join(EDGES)}")
        for edge in self.around:
            require_choice("edges", edge, EDGES, more=", or four of them")

    @property
    def around(self) -> tuple[str, ...]:
        """Supports of the plate at x = 0, x = length, y = 0 and y = width."""
        return (self.edges,) * 4 if isinstance(self.edges, str) else tuple(self.edges)

    @property
    def supported(self) -> bool:
        """Whether an edge of the plate is held."""
        return set(self.around) != {"free"}

    @property
    def geometry(self) -> Sheet:
        """Surface of the plate, and places on it by name."""
        return Sheet(Rectangle(self.length, self.width), self.thickness)

    def vibration(self, material: Material, highest: float) -> Vibration:
        """Compute all modes up to a frequency, without rigid motions of a free plate.

        Parameters
        ----------
        material : Material
            Material of the body.
        highest : float
            Upper limit of the frequencies, Hz.

        Returns
        -------
        Vibration
            Frequencies and shapes of the modes.

        Raises
        ------
        OptionError
            When they are too many: about 5,000 with equal edges on opposite sides, 1,000 without.
        """
        unit, nu = self._unit(material), material.poisson_ratio
        wavenumber = math.sqrt(highest / unit)
        plate, errors, degrees = self._converge(wavenumber, nu)
        in_band = np.flatnonzero(plate.squared <= wavenumber**4)
        overestimates = plate_overestimate(plate.squared[in_band] ** 0.25 * self.thickness, nu)
        return Vibration(
            frequencies=unit * np.sqrt(plate.squared[in_band]),
            forms=plate.forms.chosen(in_band),
            poisson_slopes=nu / (1 - nu**2) + plate.slopes[in_band] / (2 * plate.squared[in_band]),
            errors=errors[in_band],
            overstated=overestimates,
            half_wave=math.pi
            / max(plate.squared[in_band].max(initial=0.0) ** 0.25, math.pi / self.extent),
            method=f"rectangular plate, {', '.join(self.around)}: Kirchhoff's theory by Ritz",
            references=("leissa1969",),
            details={"polynomials": degrees}
            | thinness(self.thickness, min(self.length, self.width) / 2, overestimates),
        )

    def solid(self) -> Counterpart:
        """Return the solid block that the plate idealises.

        Returns
        -------
        Counterpart
            The solid in the coordinates of the plate.

        Raises
        ------
        OptionError
            On supported edges.
        """
        require_clamped_or_free("plate", self.around)
        sides = zip((0, 0, 1, 1), (0.0, self.length, 0.0, self.width), self.around, strict=True)
        return Counterpart(
            solid=Block(size=(self.length, self.width, self.thickness)),
            of="RectangularPlate",
            offset=(self.length / 2, self.width / 2, 0.0),
            ends=tuple((axis, place) for axis, place, edge in sides if edge == "clamped"),
        )

    def _unit(self, material: Material) -> float:
        """Return sqrt(D / (density thickness)) / (2 pi), Hz m^2."""
        inertia = 12 * (1 - material.poisson_ratio**2) * material.density
        return math.sqrt(material.youngs_modulus / inertia) * self.thickness / (2 * math.pi)

    def _converge(self, wavenumber: float, nu: float) -> tuple[PlateModes, Array, list[int]]:
        """Return modes that more polynomials change little, their errors, and the numbers used."""
        axes = self._axes(wavenumber, 1.0)
        plate = bend(*axes, nu)
        errors = np.full(len(plate.squared), np.inf)
        for round_number in range(1, _ROUNDS):
            previous, axes = plate, self._axes(wavenumber, _REFINEMENT**round_number)
            plate = bend(*axes, nu)
            errors = _estimate_errors(previous.squared, plate.squared)
            if errors[plate.squared <= wavenumber**4].max(initial=0.0) < _CONVERGED_CHANGE:
                break
        return plate, errors, [axis.count for axis in axes]

    def _axes(self, wavenumber: float, factor: float) -> tuple[PolynomialAxis, PolynomialAxis]:
        edge_orders = [EDGES[edge] for edge in self.around]
        pairs = ((self.length, edge_orders[:2]), (self.width, edge_orders[2:]))
        x_axis, y_axis = (
            PolynomialAxis(
                ends=(ends[0], ends[1]),
                count=round(
                    factor * (_EXTRA_COUNT + _COUNT_PER_HALF_WAVE * wavenumber * length / math.pi)
                ),
                length=length,
            )
            for length, ends in pairs
        )
        _require_solvable(x_axis, y_axis)
        return x_axis, y_axis


def _estimate_errors(coarse_values: Array, fine_values: Array) -> Array:
    """Return how far frequencies came down from one resolution to the next, relative."""
    errors = np.full(len(fine_values), np.inf)
    count = min(len(coarse_values), len(fine_values))
    changes = np.abs(coarse_values[:count] / fine_values[:count] - 1) / 2
    errors[:count] = _REMAINING * changes + _ROUNDING
    return errors


def _require_solvable(x_axis: PolynomialAxis, y_axis: PolynomialAxis) -> None:
    functions = x_axis.count * y_axis.count // (x_axis.stride * y_axis.stride)
    if functions > _MAX_FUNCTIONS:
        raise OptionError(
            f"the band needs {x_axis.count} x {y_axis.count} polynomials, {functions} of one "
            f"symmetry: at most {_MAX_FUNCTIONS} are solved for; end the band lower, or check the "
            "lengths (m)"
        )

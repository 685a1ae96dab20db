"""Beams and stiff strings in Legendre polynomials (Galerkin): no formula of waves is used.

Deflection w and turning t are polynomials over the whole length; supports are constraints on
their coefficients, and what is free takes care of itself.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.linalg import block_diag, eigh, null_space

from struck import Material

Array = NDArray[np.float64]
FIXED = {"free": "", "clamped": "wt", "hinged": "w", "sliding": "t"}


@dataclass(frozen=True, kw_only=True)
class Timoshenko:
    """A bar of rectangular section, m, with the shear coefficient of Cowper 1966."""

    length: float
    width: float
    thickness: float
    material: Material
    degree: int

    def modes(self, ends: tuple[str, str]) -> tuple[Array, Callable[[Array], Array]]:
        """Return frequencies of elastic modes, Hz, and deflections of unit mean energy at x."""
        stiffness, mass = self._matrices()
        allowed = self._allowed(ends)
        reduced = (allowed.T @ matrix @ allowed for matrix in (stiffness, mass))
        squares, shapes = eigh(*reduced)
        elastic = squares > 1e-6 * self._scale
        deflections = (allowed @ shapes[:, elastic])[: self.degree + 1]
        total = self.material.density * self.width * self.thickness * self.length

        def at(x: Array) -> Array:
            values = legendre.legvander(2 * x / self.length - 1, self.degree)
            return values @ deflections * np.sqrt(total)

        return np.sqrt(squares[elastic]) / (2 * np.pi), at

    @property
    def _scale(self) -> float:
        """Return about the lowest squared angular frequency, 1/s^2."""
        speed = self.material.youngs_modulus / self.material.density
        return speed * self.thickness**2 / self.length**4

    def _matrices(self) -> tuple[Array, Array]:
        nu, density = self.material.poisson_ratio, self.material.density
        area, moment = self.width * self.thickness, self.width * self.thickness**3 / 12
        shear = 10 * (1 + nu) / (12 + 11 * nu) * self.material.shear_modulus * area
        bending = self.material.youngs_modulus * moment
        square, slope, mixed = _integrals(self.degree, self.length)
        stiffness = np.block(
            [[shear * slope, -shear * mixed], [-shear * mixed.T, bending * slope + shear * square]]
        )
        return stiffness, block_diag(density * area * square, density * moment * square)

    def _allowed(self, ends: tuple[str, str]) -> Array:
        """Return a basis of the coefficients of w and t that the supports allow."""
        parts = []
        for unknown in "wt":
            rows = [
                legendre.legvander(np.array([place]), self.degree)[0]
                for place, end in zip((-1.0, 1.0), ends, strict=True)
                if unknown in FIXED[end]
            ]
            parts.append(null_space(np.array(rows)) if rows else np.eye(self.degree + 1))
        return block_diag(*parts)


def _integrals(degree: int, length: float) -> tuple[Array, Array, Array]:
    """Return integrals over x of u u, u' u' and u' u of all pairs of polynomials."""
    square = np.diag(length / (2 * np.arange(degree + 1) + 1))
    derivative = _derivatives(degree) * 2 / length
    return square, derivative @ square @ derivative.T, derivative @ square


def _derivatives(degree: int) -> Array:
    """Return the coefficients of the derivatives of all polynomials, one a row."""
    number = np.arange(degree + 1)
    lower = number[None, :] < number[:, None]
    odd = (number[None, :] + number[:, None]) % 2 == 1
    return np.where(lower & odd, 2.0 * number[None, :] + 1, 0.0)


def stiff_string(
    length: float, line_density: float, tension: float, bending: float, degree: int
) -> Array:
    """Return the frequencies of a taut bar by Euler and Bernoulli between hinges, Hz."""
    square, slope, _ = _integrals(degree, length)
    derivative = _derivatives(degree) * 2 / length
    twice = derivative @ derivative
    stiffness = tension * slope + bending * twice @ square @ twice.T
    ends = legendre.legvander(np.array([-1.0, 1.0]), degree)
    allowed = null_space(ends)
    reduced = (allowed.T @ matrix @ allowed for matrix in (stiffness, line_density * square))
    return np.sqrt(eigh(*reduced, eigvals_only=True)) / (2 * np.pi)

"""Beams by Timoshenko's theory, in closed form: what slender bodies tend to.

With shear and rotary inertia, deflection w and turning of the section t are sums of
exponentials exp(k x) whose k are the roots of the characteristic equation (Timoshenko 1921;
shear coefficients of Cowper 1966); a frequency makes the determinant of the end conditions
vanish.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from struck import Material

Array = NDArray[np.complex128]


@dataclass(frozen=True, kw_only=True)
class Bar:
    """A rectangular bar bending in the plane of its thickness; m."""

    length: float
    width: float
    thickness: float
    material: Material

    @property
    def area(self) -> float:
        return self.width * self.thickness

    @property
    def second_moment(self) -> float:
        return self.width * self.thickness**3 / 12

    def euler_bernoulli(self, beta: float) -> float:
        """Return the frequency of a root beta L without shear and rotary inertia, Hz."""
        bending = self.material.youngs_modulus * self.second_moment
        speed = np.sqrt(bending / (self.material.density * self.area))
        return (beta / self.length) ** 2 * speed / (2 * np.pi)

    def timoshenko(self, beta: float, *, clamped: bool) -> float:
        """Return the frequency that belongs to the root beta L, Hz; free at both ends or at one."""
        high = self.euler_bernoulli(beta)
        ends = self._clamped_free if clamped else self._free_free
        for low in np.linspace(0.999, 0.8, 200) * high:
            if ends(low) * ends(high) < 0:
                return brentq(ends, low, high, rtol=1e-13)
        raise AssertionError(f"no root below {high} Hz")

    def _waves(self, frequency: float) -> tuple[Array, Array, Array]:
        """Return the wave numbers k and, for w = exp(k x), the turning t / w and force Q / w."""
        nu = self.material.poisson_ratio
        shear = 10 * (1 + nu) / (12 + 11 * nu) * self.material.shear_modulus * self.area
        bending = self.material.youngs_modulus * self.second_moment
        heavy = self.material.density * self.area * (2 * np.pi * frequency) ** 2
        turning = self.material.density * self.second_moment * (2 * np.pi * frequency) ** 2
        # shear (w'' - t') + heavy w = 0;  bending t'' + shear (w' - t) + turning t = 0
        squares = np.roots(
            [
                bending * shear,
                bending * heavy + shear * turning,
                heavy * turning - shear * heavy,
            ]
        ).astype(complex)
        k = np.sqrt(np.concatenate([squares, squares]))
        k[2:] *= -1
        t = k + heavy / (shear * k)
        return k, t, shear * (k - t)

    def _free_free(self, frequency: float) -> float:
        k, t, force = self._waves(frequency)
        end = np.exp(k * self.length)
        return _determinant([k * t, force, k * t * end, force * end])

    def _clamped_free(self, frequency: float) -> float:
        k, t, force = self._waves(frequency)
        end = np.exp(k * self.length)
        return _determinant([np.ones(4), t, k * t * end, force * end])


def _determinant(rows: list[Array]) -> float:
    """Return the determinant in the real basis cosh, cos, sinh, sin, of rows of unit size."""
    matrix = np.array(rows)
    even, odd = matrix[:, :2] + matrix[:, 2:], matrix[:, :2] - matrix[:, 2:]
    basis = np.hstack([even, odd])
    # Columns of imaginary k are real or imaginary as a whole.
    real = np.where(np.abs(basis.real).sum(0) > np.abs(basis.imag).sum(0), basis.real, basis.imag)
    real /= np.linalg.norm(real, axis=1, keepdims=True)
    return float(np.linalg.det(real))


Theory = Callable[[float], float]

"""Exact frequencies of free elastic spheres, solid and hollow.

Tractions of the spherical waves on a sphere, without common factors: Eringen & Suhubi 1975,
Elastodynamics II, section 8.13. A mode is a combination of waves without traction.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import spherical_jn, spherical_yn

Array = NDArray[np.float64]
Wave = Callable[[int, Array], Array]


def torsional(n: int, highest: float, *, bore: float = 0.0) -> list[float]:
    """Return the roots omega R / c_s below `highest`; `bore` is the inner over the outer radius."""

    def rows(y: Array) -> list[list[Array]]:
        return [
            [(n - 1) * f(n, k) - k * f(n + 1, k) for f in _waves(bore)] for k in _radii(y, bore)
        ]

    return _roots(rows, highest)


def spheroidal(n: int, poisson_ratio: float, highest: float, *, bore: float = 0.0) -> list[float]:
    """Return the roots omega R / c_s below `highest` for n of at least 1."""
    slowness = np.sqrt((1 - 2 * poisson_ratio) / (2 - 2 * poisson_ratio))

    def rows(omega: Array) -> list[list[Array]]:
        tractions = []
        for y in _radii(omega, bore):
            pairs = [_tractions(f, n, slowness * y, y) for f in _waves(bore)]
            tractions += [[row for pair in pairs for row in pair[i]] for i in (0, 1)]
        return tractions

    return _roots(rows, highest)


def _tractions(f: Wave, n: int, x: Array, y: Array) -> tuple[tuple[Array, Array], ...]:
    """Return the normal and the shear traction of a pressure and a shear wave."""
    normal = (
        (n * n - n - y * y / 2) * f(n, x) + 2 * x * f(n + 1, x),
        n * (n + 1) * ((n - 1) * f(n, y) - y * f(n + 1, y)),
    )
    shear = (
        (n - 1) * f(n, x) - x * f(n + 1, x),
        (n * n - 1 - y * y / 2) * f(n, y) + y * f(n + 1, y),
    )
    return normal, shear


def _waves(bore: float) -> tuple[Wave, ...]:
    return (spherical_jn, spherical_yn) if bore else (spherical_jn,)


def _radii(omega: Array, bore: float) -> tuple[Array, ...]:
    return (omega, omega * bore) if bore else (omega,)


def _roots(rows: Callable[[Array], list[list[Array]]], highest: float) -> list[float]:
    def determinants(omegas: Array) -> Array:
        matrices = np.moveaxis(np.array(rows(omegas)), -1, 0)
        return np.linalg.det(matrices / np.linalg.norm(matrices, axis=1, keepdims=True))

    def determinant(omega: float) -> float:
        return float(determinants(np.array([omega]))[0])

    grid = np.linspace(0.3, highest, 400)
    values = determinants(grid)
    changes = np.flatnonzero(values[:-1] * values[1:] < 0)
    return [brentq(determinant, grid[i], grid[i + 1], xtol=1e-13, rtol=1e-14) for i in changes]

"""Disks and rings by Ritz's method, one number of nodal diameters at a time: no Bessel functions.

Lengths are over the radius, frequencies over those of a wave or plate for which they are 1.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray
from scipy.linalg import eigh
from scipy.special import eval_jacobi

Array = NDArray[np.float64]

# How often an edge makes the deflection vanish.
HOLDS = {"free": 0, "supported": 1, "clamped": 2}


def plate(edge: str, order: int, poisson_ratio: float, count: int) -> Array:
    """Return lambda of a circular plate, ascending, from `count` functions.

    The energy of bending is that of Kirchhoff's theory (Timoshenko and Woinowsky-Krieger, "Theory
    of Plates and Shells", 1959, section 9.3), integrated by Gauss's rule.
    """
    r, weights = gauss(0.0, 1.0, 2 * count + order + 8)
    w, first, second = disk_functions(order, HOLDS[edge], count, r)
    around = first / r - order**2 * w / r**2
    twist = order * (first / r - w / r**2)
    mixed = second * weights @ around.T
    energy = (second + around) * weights @ (second + around).T
    energy -= (1 - poisson_ratio) * (mixed + mixed.T - 2 * twist * weights @ twist.T)
    rigid = 2 if edge == "free" and order < 2 else 0
    return np.sqrt(np.sqrt(ratios(energy, w * weights @ w.T)[rigid // 2 :]))


def membrane(order: int, count: int) -> Array:
    """Return x of a circular membrane, ascending, from `count` functions."""
    r, weights = gauss(0.0, 1.0, 2 * count + order + 8)
    w, first, _ = disk_functions(order, 1, count, r)
    return np.sqrt(waves(order, r, weights, w, first))


def ring(order: int, hole: float, count: int) -> Array:
    """Return x of a ring under tension, ascending, from `count` functions."""
    r, weights = gauss(hole, 1.0, 2 * count + 12)
    t = (2 * r - 1 - hole) / (1 - hole)
    w = legendre.legvander(t, count + 1).T
    w = w[2:] - w[:-2]  # vanish at both ends
    first = np.array([legendre.legval(t, legendre.legder(row)) for row in np.eye(count + 2)])
    return np.sqrt(waves(order, r, weights, w, (first[2:] - first[:-2]) * 2 / (1 - hole)))


def waves(order: int, r: Array, weights: Array, w: Array, first: Array) -> Array:
    """Return Rayleigh's quotients of a membrane."""
    energy = first * weights @ first.T + order**2 * (w * weights / r**2) @ w.T
    return ratios(energy, w * weights @ w.T)


def ratios(energy: Array, inertia: Array) -> Array:
    """Return the eigenvalues, ascending; the lowest to as many digits as the highest."""
    shifted = energy + 10 * inertia
    scale = 1 / np.sqrt(np.diag(shifted))
    inverse = eigh(inertia * np.outer(scale, scale), shifted * np.outer(scale, scale))[0]
    return np.maximum(1 / inverse[::-1] - 10, 0)


def disk_functions(order: int, holds: int, count: int, r: Array) -> tuple[Array, Array, Array]:
    """Return r^m (1 - r^2)^holds times polynomials of r^2, and two derivatives (count, N)."""
    n = np.arange(count)[:, None]
    a, b = 2 * holds, order
    s = 2 * r**2 - 1
    p = eval_jacobi(n, a, b, s)
    ds = (n + a + b + 1) / 2 * eval_jacobi(np.maximum(n - 1, 0), a + 1, b + 1, s) * (n > 0)
    grown = (n + a + b + 1) * (n + a + b + 2) / 4
    dds = grown * eval_jacobi(np.maximum(n - 2, 0), a + 2, b + 2, s) * (n > 1)
    q, dq, ddq = p, ds * 4 * r, dds * 16 * r**2 + ds * 4
    f, df, ddf = envelope(order, holds, r)
    return f * q, df * q + f * dq, ddf * q + 2 * df * dq + f * ddq


def envelope(order: int, holds: int, r: Array) -> tuple[Array, Array, Array]:
    """Return r^m (1 - r^2)^holds and its first two derivatives."""
    f, df, ddf = (np.zeros_like(r) for _ in range(3))
    for power, factor in {0: [(0, 1)], 1: [(0, 1), (2, -1)], 2: [(0, 1), (2, -2), (4, 1)]}[holds]:
        n = order + power
        f += factor * r**n
        df += factor * n * r ** max(n - 1, 0)
        ddf += factor * n * (n - 1) * r ** max(n - 2, 0)
    return f, df, ddf


def gauss(low: float, high: float, count: int) -> tuple[Array, Array]:
    """Return places between two radii and weights, r dr included."""
    t, weights = legendre.leggauss(count)
    r = (low + high) / 2 + (high - low) / 2 * t
    return r, weights * (high - low) / 2 * r

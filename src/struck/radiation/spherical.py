"""Spherical waves: the air's answer to a sphere that moves by one spherical order."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import jv, yv

from struck.model.arrays import Array, Complex


def sphere_impedance(order: ArrayLike, ka: ArrayLike) -> Complex:
    """Return pressure over normal velocity on a sphere, in rho c (Williams 1999, chapter 6).

    For a velocity that is one spherical harmonic of real order n >= 0, it is i h_n(x) / h_n'(x) at
    x = ka, with the spherical Hankel function of the first kind: time goes as exp(-i omega t). The
    real part is the radiation efficiency, the imaginary part is negative: mass.
    """
    value, slope = _hankel_and_slope(order, ka)
    mass = -1j * np.asarray(ka, float) / (np.asarray(order, float) + 1)  # for small ka
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        impedance = 1j * value / slope
    return np.where(np.isfinite(impedance), impedance, mass)  # beyond the largest number


def sphere_efficiency(order: ArrayLike, ka: ArrayLike) -> Array:
    """Return the radiation efficiency of a spherical order n >= 0 (Williams 1999, chapter 6).

    A sphere whose normal velocity is a harmonic of one order n radiates sigma rho c S <v^2>, with
    <v^2> the mean square over surface and time, and sigma = 1 / |x h_n'(x)|^2 at x = ka.
    """
    slope = _hankel_and_slope(order, ka)[1]
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        efficiency = 1 / np.square(np.asarray(ka, float) * np.abs(slope))
    return np.where(np.isfinite(efficiency), efficiency, 0.0)  # |h'| beyond the largest number


def _hankel_and_slope(order: ArrayLike, ka: ArrayLike) -> tuple[Complex, Complex]:
    degree, x = np.asarray(order, float), np.asarray(ka, float)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        value = _hankel(degree, x)
        return value, _hankel(degree - 1, x) - (degree + 1) / x * value


def _hankel(order: Array, x: Array) -> Complex:
    """Return the spherical Hankel function of the first kind of a real order."""
    return np.sqrt(np.pi / (2 * x)) * (jv(order + 0.5, x) + 1j * yv(order + 0.5, x))

"""Waves that leave a body, sorted by direction: what listener parts are made of."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import sph_harm_y

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]

ORDER = 4
"""The highest degree of waves fitted to recordings."""


def degrees(order: int) -> tuple[Index, Index]:
    """Return degree l and angular order m of each of the (order + 1)^2 harmonics.

    They go by degree, and from -l to l within it; below 0 stand the sines of the azimuth.
    """
    pairs = [(degree, m) for degree in range(order + 1) for m in range(-degree, degree + 1)]
    degree, angular = np.array(pairs).T
    return degree, angular


def real_harmonics(places: Array, order: int) -> Array:
    """Return solid harmonics r^l Y_lm at places (n, 3), real, of mean square 1 on a unit sphere.

    Returns
    -------
    array (n, (order + 1)^2)
        In the sequence of `degrees`; spherical harmonics where places are unit vectors.
    """
    degree, angular = degrees(order)
    x, y, z = places.T[:, :, None]
    flat = np.hypot(x, y)
    values = sph_harm_y(degree, np.abs(angular), np.arctan2(flat, z), np.arctan2(y, x))
    parts = np.where(angular < 0, values.imag, values.real)
    scale = np.sqrt(4 * np.pi * (1 + (angular != 0)))
    return scale * np.hypot(flat, z) ** degree * parts


def near_field(order: int) -> Complex:
    """Return how outgoing waves of each degree differ from a monopole near the source.

    h_l(x) / h_0(x) for time going as exp(+i omega t) is a polynomial in 1/x; the phase i^l is left
    out, so that it tends to 1 far away (Williams 1999, section 6.4).

    Returns
    -------
    array (order + 1, order + 1)
        Coefficient of x^-k of the degree l at [k, l].
    """
    coefficients = np.zeros((order + 1, order + 1), np.complex128)
    for degree in range(order + 1):
        for power in range(degree + 1):
            ways = math.comb(degree + power, power) * math.perm(degree, power)
            coefficients[power, degree] = ways * (-0.5j) ** power
    return coefficients

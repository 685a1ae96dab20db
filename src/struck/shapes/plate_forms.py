"""Forms of circular plates, and how their frequencies depend on Poisson's ratio."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from struck.shapes.plate_roots import bending_moment, edge_slopes
from struck.shapes.round_forms import RoundForms

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def plate_forms(
    edge: str, radius: float, waves: tuple[Index, Index], roots: Array, poisson_ratio: float
) -> tuple[RoundForms, Array]:
    """Return the forms, and the slopes of ln lambda^2 over Poisson's ratio.

    Parameters
    ----------
    edge : str
        "free", "supported" or "clamped".
    radius : float
        m.
    waves : pair of arrays (M,)
        Nodal diameters, and 1 for sines.
    roots : array (M,)
        lambda.
    poisson_ratio : float
    """
    orders, sines = waves
    m = orders.astype(float)
    wave, wave_slope, growing_slope = edge_slopes(m, roots)
    growing = -wave
    if edge == "free":
        ones = np.ones_like(roots)
        balance = bending_moment(m, -(roots**2), wave, wave_slope, poisson_ratio)
        growing = -balance / bending_moment(m, roots**2, ones, growing_slope, poisson_ratio)
    square = _mean_square(m, roots, (wave, wave_slope, growing_slope), growing)
    size = np.where(orders > 0, math.sqrt(2), 1.0) / np.sqrt(square)
    forms = RoundForms(
        radius=radius,
        orders=orders,
        sines=sines,
        wavenumbers=roots,
        regular=size,
        singular=np.zeros(len(roots)),
        growing=size * growing,
    )
    deflection, slope = wave + growing, wave_slope + growing * growing_slope
    return forms, _twisting(m, deflection, slope) / (square * roots**4)


def _mean_square(m: Array, roots: Array, edge: tuple[Array, Array, Array], growing: Array) -> Array:
    """Return 2 times the integral of w^2 r from 0 to 1, by Lommel's integrals."""
    wave, wave_slope, growing_slope = edge
    turns = (m / roots) ** 2
    waves = (wave_slope / roots) ** 2 + (1 - turns) * wave**2
    both = (wave * growing_slope - wave_slope) / roots**2
    growths = 1 + turns - (growing_slope / roots) ** 2
    return waves + 2 * growing * both + growing**2 * growths


def _twisting(m: Array, deflection: Array, slope: Array) -> Array:
    """Return the integral over the plate of what 1 - nu multiplies in the energy of bending.

    That is 2 w_rr (w_r / r + w_tt / r^2) - 2 [(w_t / r)_r]^2, a divergence, so that the edge alone
    counts. Where the integral of w^2 is 1, it is the slope of lambda^4 over nu (Rayleigh).
    """
    return slope**2 - 2 * m**2 * slope * deflection + m**2 * deflection**2

"""Bessel functions of many orders as local Chebyshev series: quick, and exact to rounding."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy.special import j0, y0

Array = NDArray[np.float64]
# Over cells one wide: functions whose waves are 2 pi long keep all their digits. An odd number.
_TERMS = 13


@lru_cache(maxsize=64)
def regular(step: float, count: int, cells: int) -> Array:
    """Tabulate Bessel functions freed from their power of x, J_nu(x) Gamma(nu + 1) (2 / x)^nu.

    These are 0F1(; nu + 1; -x^2 / 4): 1 at x = 0, at most 1 beyond, smooth for every order.

    Parameters
    ----------
    step : float
        The orders are nu = step * (1, 2, ...).
    count : int
        How many.
    cells : int
        The table reaches from 0 to x = cells.

    Returns
    -------
    array (cells, _TERMS, count)
        Chebyshev coefficients in 2 (x - cell) - 1.

    Notes
    -----
    Miller's recurrence downwards from a high order, normalised by Neumann's series for
    (x / 2)^nu (Watson 1944, section 5.2; Olver et al. 2010, sections 10.23 and 10.74).
    """
    from struck.shapes.bessel_kernels import fill

    orders, samples = step * np.arange(1, count + 1, dtype=np.float64), _samples(cells)
    values = np.empty((len(samples), count))
    fill(orders, samples, values)
    return _fitted(values.reshape(cells, _TERMS, count))


@lru_cache(maxsize=16)
def irregular(cells: int) -> Array:
    """Tabulate J_0 and what is left of Y_0 without its logarithm: (cells, _TERMS, 2).

    Y_0(x) = (2 / pi) ln(x / 2) J_0(x) + an entire function (Olver et al. 2010, 10.8.2).
    """
    samples = _samples(cells)
    entire = y0(samples) - 2 / np.pi * np.log(samples / 2) * j0(samples)
    return _fitted(np.stack([j0(samples), entire], axis=-1).reshape(cells, _TERMS, 2))


def _samples(cells: int) -> Array:
    """Return Chebyshev points of all cells, ascending."""
    return (np.arange(cells)[:, None] + 0.5 + chebyshev.chebpts1(_TERMS) / 2).ravel()


def _fitted(values: Array) -> Array:
    """Return Chebyshev coefficients from values at the points of each cell, both along axis 1."""
    series = np.linalg.inv(chebyshev.chebvander(chebyshev.chebpts1(_TERMS), _TERMS - 1))
    table = np.ascontiguousarray(np.einsum("dp,cpk->cdk", series, values))
    table.flags.writeable = False
    return table

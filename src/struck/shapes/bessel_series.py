"""Bessel functions of many orders as local Chebyshev series: 13 products each, exact to rounding.

scipy.special.jv takes a hundred times as long.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import chebyshev
from scipy.special import j0, y0

from struck.core import entry
from struck.errors import OptionError
from struck.model.arrays import Array, Index

# Over cells one wide: functions whose waves are 2 pi long keep all their digits. As many as in
# core/bessel_series.c.
_TERMS = 13
# Orders above the argument from which the recurrence starts downwards: by then J is below 1e-20.
_RUN_UP = 30
# Arguments at a time, so that the arrays of the recurrence fit the processor's cache.
_BATCH_SIZE = 256


@lru_cache(maxsize=64)
def tabulate_regular(step: float, count: int, cells: int) -> Array:
    """Return a Chebyshev table (cells, _TERMS, count) of Bessel functions without their power of x.

    J_nu(x) Gamma(nu + 1) (2 / x)^nu = 0F1(; nu + 1; -x^2 / 4) for nu = step (1, 2, ...), from x = 0
    to `cells`: 1 at x = 0, at most 1 beyond, smooth for every order.
    """
    orders, samples = step * np.arange(1, count + 1, dtype=np.float64), _samples(cells)
    values = np.empty((len(samples), count))
    fill(orders, samples, values)
    return _fit_series(values.reshape(cells, _TERMS, count))


@lru_cache(maxsize=16)
def tabulate_irregular(cells: int) -> Array:
    """Return a Chebyshev table (cells, _TERMS, 2) of J_0 and of Y_0 without its logarithm.

    Y_0(x) = (2 / pi) ln(x / 2) J_0(x) + an entire function (Olver et al. 2010, 10.8.2).
    """
    samples = _samples(cells)
    entire_part = y0(samples) - 2 / np.pi * np.log(samples / 2) * j0(samples)
    return _fit_series(np.stack([j0(samples), entire_part], axis=-1).reshape(cells, _TERMS, 2))


def _samples(cells: int) -> Array:
    """Return Chebyshev points of all cells, ascending."""
    return (np.arange(cells)[:, None] + 0.5 + chebyshev.chebpts1(_TERMS) / 2).ravel()


def _fit_series(values: Array) -> Array:
    """Return Chebyshev coefficients from values at the points of each cell, both along axis 1."""
    series = np.linalg.inv(chebyshev.chebvander(chebyshev.chebpts1(_TERMS), _TERMS - 1))
    table = np.ascontiguousarray(np.einsum("dp,cpk->cdk", series, values))
    table.flags.writeable = False
    return table


def fill(orders: Array, arguments: Array, values: Array) -> None:
    """Write J_nu(x) Gamma(nu + 1) (2 / x)^nu for arguments (K,) and orders (n,) into (K, n).

    By the recurrence in nu downwards (Miller), scaled by Neumann's sum (Olver et al. 2010,
    10.23.15).
    scipy.special.hyp0f1 is infinite from 170 orders on, and 7e-13 off at 100; jv loses its power of
    x to underflow.
    """
    steps = np.floor(orders).astype(int)
    for start in range(0, len(arguments), _BATCH_SIZE):
        part = slice(start, start + _BATCH_SIZE)
        max_order = float(max(orders.max(), arguments[part].max()))
        top = int(max_order) + _RUN_UP + int(3 * max_order ** (1 / 3))
        quarter = arguments[part, None] ** 2 / 4
        _recur(orders - steps, steps, quarter, top + top % 2, values[part])


def _recur(base_orders: Array, steps: Index, quarter: Array, top: int, values: Array) -> None:
    """Write the series of orders `lowest + steps` (n,) at (x / 2)^2 (K, 1) into values (K, n)."""
    next_terms, terms, products = np.zeros_like(values), np.ones_like(values), np.empty_like(values)
    sums = np.ones_like(values)
    for n in range(top - 1, -1, -1):
        np.multiply(quarter, 1 / ((base_orders + n + 1) * (base_orders + n + 2)), out=products)
        np.multiply(products, next_terms, out=products)
        np.subtract(terms, products, out=next_terms)
        next_terms, terms = terms, next_terms
        reached = steps == n
        if reached.any():
            values[:, reached] = terms[:, reached]
        if n % 2 == 0:  # Neumann's sum from its end: each term contains the next one's weight
            k = n // 2
            weight = (base_orders + k) / (base_orders + n) if n else 1.0
            np.multiply(quarter, weight / ((k + 1) * (base_orders + n + 1)), out=products)
            np.multiply(sums, products, out=sums)
            np.add(sums, terms, out=sums)
    values /= sums


def series(arguments: Array, table: Array) -> Array:
    """Sum Chebyshev series, one cell (13, n) per unit of argument, at arguments (K,): (K, n)."""
    kernel, sums = entry("bessel_series_sum"), _room(arguments, table)
    if kernel is None:
        at, terms = _locate_cells(arguments, table)
        sums[:] = chebyshev.chebval(at, terms, tensor=False)
    else:
        kernel(*sums.shape, arguments, table, sums)
    return sums


def series_slope(arguments: Array, table: Array) -> Array:
    """Sum the derivatives of Chebyshev series at arguments (K,): (K, n)."""
    kernel, slopes = entry("bessel_series_slope"), _room(arguments, table)
    if kernel is None:
        at, terms = _locate_cells(arguments, table)
        slopes[:] = 2 * chebyshev.chebval(at, chebyshev.chebder(terms), tensor=False)
    else:
        kernel(*slopes.shape, arguments, table, slopes)
    return slopes


def pair(arguments: Array, table: Array) -> Array:
    """Sum two Chebyshev series (cells, 13, 2) at arguments (K, C): (2, K, C)."""
    return np.moveaxis(series(arguments.ravel(), table).reshape(*arguments.shape, 2), -1, 0)


def _room(arguments: Array, table: Array) -> Array:
    """Return an array for sums (K, n) at arguments (K,), which must lie in the table's cells."""
    low, high = arguments.min(initial=0.0), arguments.max(initial=0.0)
    if not 0 <= low <= high < len(table):  # NaN is refused as well
        raise OptionError(f"arguments from {low} to {high} for a table of {len(table)} cells")
    return np.empty((len(arguments), table.shape[2]))


def _locate_cells(arguments: Array, table: Array) -> tuple[Array, Array]:
    """Return places from -1 to 1 in the arguments' cells (K, 1) and their terms (13, K, n)."""
    cells = arguments.astype(np.int64)
    return (2 * (arguments - cells) - 1)[:, None], np.moveaxis(table[cells], 1, 0)

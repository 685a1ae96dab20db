"""Bessel functions of many orders as local Chebyshev series: 13 products each, exact to rounding.

scipy.special.jv takes a hundred times as long. Apart from `bessel`, as numba takes its time to
import.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numba import njit
from numpy.polynomial import chebyshev
from scipy.special import j0, y0

from struck.model.arrays import Array

# Over cells one wide: functions whose waves are 2 pi long keep all their digits. An odd number.
_TERMS = 13
# Orders above the argument from which the recurrence starts downwards: by then J is below 1e-20.
_RUN_UP = 30


@lru_cache(maxsize=64)
def regular(step: float, count: int, cells: int) -> Array:
    """Return a Chebyshev table (cells, _TERMS, count) of Bessel functions without their power of x.

    J_nu(x) Gamma(nu + 1) (2 / x)^nu = 0F1(; nu + 1; -x^2 / 4) for nu = step (1, 2, ...), from x = 0
    to `cells`: 1 at x = 0, at most 1 beyond, smooth for every order.
    """
    orders, samples = step * np.arange(1, count + 1, dtype=np.float64), _samples(cells)
    values = np.empty((len(samples), count))
    fill(orders, samples, values)
    return _fitted(values.reshape(cells, _TERMS, count))


@lru_cache(maxsize=16)
def irregular(cells: int) -> Array:
    """Return a Chebyshev table (cells, _TERMS, 2) of J_0 and of Y_0 without its logarithm.

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


@njit(cache=True, nogil=True, error_model="numpy")
def fill(orders: Array, arguments: Array, values: Array) -> None:
    """Write J_nu(x) Gamma(nu + 1) (2 / x)^nu for arguments (K,) and orders (n,) into (K, n)."""
    highest = max(orders.max(), arguments.max())
    work = np.empty(int(highest) + 2 * _RUN_UP + int(3 * highest ** (1 / 3)))
    for i in range(len(arguments)):
        for j in range(len(orders)):
            values[i, j] = _by_recurrence(orders[j], arguments[i], work)


@njit(cache=True, nogil=True, error_model="numpy")
def _by_recurrence(order: float, x: float, work: Array) -> float:
    steps = math.floor(order)
    lowest, quarter = order - steps, x * x / 4
    top = int(max(order, x)) + _RUN_UP + int(3 * x ** (1 / 3))
    above, here = 0.0, 1.0
    work[top] = here
    for n in range(top, 0, -1):
        above, here = here, here - quarter / ((lowest + n) * (lowest + n + 1)) * above
        work[n - 1] = here
        if abs(here) > 1e200:
            above, here = above * 1e-200, here * 1e-200
            for m in range(n - 1, top + 1):
                work[m] *= 1e-200
    return work[steps] / _neumann_sum(lowest, quarter, top, work)


@njit(cache=True, nogil=True, error_model="numpy")
def _neumann_sum(lowest: float, quarter: float, top: int, work: Array) -> float:
    """Return the sum by which the values of the recurrence must be divided."""
    total, weight = work[0], quarter / (lowest + 1)
    for k in range(1, top // 2 + 1):
        total += weight * work[2 * k]
        ratio = (lowest + 2 * k + 2) * (lowest + k) / ((lowest + 2 * k) * (k + 1))
        weight *= ratio * quarter / ((lowest + 2 * k + 1) * (lowest + 2 * k + 2))
    return total


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def series(arguments: Array, table: Array) -> Array:
    """Sum Chebyshev series, one cell (13, n) a unit of argument, at arguments (K,): (K, n).

    By Clenshaw's recurrence (Clenshaw 1955), two terms a turn so that no array changes its name.
    """
    terms, count = table.shape[1:]
    sums = np.empty((len(arguments), count))
    other = np.empty(count)
    for i in range(len(arguments)):
        cell = int(arguments[i])
        at = 2 * (arguments[i] - cell) - 1
        one, here = sums[i], table[cell]
        for j in range(count):
            one[j], other[j] = here[terms - 1, j], 0.0
        for degree in range(terms - 2, 1, -2):
            for j in range(count):
                other[j] = 2 * at * one[j] - other[j] + here[degree, j]
            for j in range(count):
                one[j] = 2 * at * other[j] - one[j] + here[degree - 1, j]
        for j in range(count):
            other[j] = 2 * at * one[j] - other[j] + here[1, j]
        for j in range(count):
            one[j] = at * other[j] - one[j] + here[0, j]
    return sums


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def series_slope(arguments: Array, table: Array) -> Array:
    """Sum the derivatives of Chebyshev series at arguments (K,): (K, n)."""
    terms, count = table.shape[1:]
    sums = np.empty((len(arguments), count))
    for i in range(len(arguments)):
        cell = int(arguments[i])
        at = 2 * (arguments[i] - cell) - 1
        for j in range(count):
            one, two, slope, older = 0.0, 0.0, 0.0, 0.0
            for degree in range(terms - 1, 0, -1):
                slope, older = 2 * one + 2 * at * slope - older, slope
                one, two = 2 * at * one - two + table[cell, degree, j], one
            sums[i, j] = 2 * (one + at * slope - older)
    return sums


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def pair(arguments: Array, table: Array) -> Array:
    """Sum two Chebyshev series (cells, terms, 2) at arguments (K, C): (2, K, C)."""
    rows, columns = arguments.shape
    sums = np.empty((2, rows, columns))
    for i in range(rows):
        for j in range(columns):
            cell = int(arguments[i, j])
            at = 2 * (arguments[i, j] - cell) - 1
            one, two, three, four = 0.0, 0.0, 0.0, 0.0
            for degree in range(table.shape[1] - 1, 0, -1):
                one, two = 2 * at * one - two + table[cell, degree, 0], one
                three, four = 2 * at * three - four + table[cell, degree, 1], three
            sums[0, i, j] = at * one - two + table[cell, 0, 0]
            sums[1, i, j] = at * three - four + table[cell, 0, 1]
    return sums

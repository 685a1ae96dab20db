"""Bessel functions of whole order, many at once, as the edges of round bodies need them."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.polynomial import chebyshev
from numpy.typing import NDArray
from scipy import special
from scipy.special import j0, y0

from struck.errors import SolverError
from struck.model.arrays import Array, Index

# The loops over orders and places of Bessel functions, compiled when they are first used.

# Orders above the argument from which the recurrence starts downwards: by then J is below 1e-20.
_RUN_UP = 30


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


# Bessel functions of many orders as local Chebyshev series: quick, and exact to rounding.

# Over cells one wide: functions whose waves are 2 pi long keep all their digits. An odd number.
_TERMS = 13


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


_SMALL = 1e-30
_UNHEARD = 1e-18


class AtEdge(NamedTuple):
    """Values J_m(x), J_{m+1}(x) and I_{m+1}(x) / I_m(x)."""

    wave: Array
    following: Array
    growth: Array


def at_edge(orders: Array, x: Array) -> AtEdge:
    """Return J and I at the edge of a disk, for whole orders (N,) of at most about 1.1 x.

    scipy.special.jv and ive take 6 times as long. Both recurrences run downwards, where they are
    stable, from orders at which J_m vanishes (Miller; Abramowitz and Stegun 9.12, 9.1.46).
    """
    top = np.maximum(orders, x)
    starts = (top + 12 * np.cbrt(top) + 24).astype(np.int64)
    ranks = np.argsort(-starts, kind="stable")
    found = np.empty((3, len(x)))
    found[:, ranks] = _downwards(orders[ranks], x[ranks], starts[ranks])
    return AtEdge(*found)


def _downwards(orders: Array, x: Array, starts: NDArray[np.int64]) -> Array:
    """Return J_m, J_{m+1} and I_{m+1} / I_m (3, N), given in the order of falling starts."""
    highest = int(starts[0]) if len(starts) else -1
    running = len(x) - np.searchsorted(starts[::-1], np.arange(highest + 1))
    owners = _owners(orders, highest)
    now, above = np.full(len(x), _SMALL), np.zeros(len(x))
    growth, total = np.zeros(len(x)), np.zeros(len(x))
    found = np.empty((3, len(x)))
    for order in range(highest, -1, -1):
        n = running[order]
        own = owners[order]
        found[0, own], found[1, own], found[2, own] = now[own], above[own], growth[own]
        if order % 2 == 0:
            total[:n] += now[:n] if order else now[:n] / 2
        ratio = 2 * order / x[:n]
        now[:n], above[:n] = ratio * now[:n] - above[:n], now[:n].copy()
        growth[:n] = 1 / (growth[:n] + ratio) if order else 0
    found[:2] /= 2 * total
    return found


def _owners(orders: Array, highest: int) -> list[NDArray[np.int64]]:
    """Return the indices of the arguments with each order up to `highest`."""
    ranked = np.argsort(orders, kind="stable")
    bounds = np.searchsorted(orders[ranked], np.arange(highest + 1))
    return np.split(ranked, bounds[1:])


def ring_parts(orders: Array, inner: Array) -> tuple[Array, Array, Array]:
    """Return factors of J_m and Y_m in forms that vanish at the argument `inner`, and their size.

    The squares of the factors sum to 1. The size is (J_m^2 + Y_m^2)^(1/2) there, infinite where Y_m
    exceeds all numbers; its factor is 0 then, as it contributes at most J_m(inner).
    """
    first, second = special.jv(orders, inner), special.yv(orders, inner)
    size = np.hypot(first, second)
    dull = np.abs(first) < _UNHEARD
    regular = np.where(dull, -1.0, second / np.where(dull, 1.0, size))
    return regular, np.where(dull, 0.0, -first / size), size


# Roots of equations in Bessel functions, each from an interval that holds no other.

# Of orders and arguments of one shape.
Function = Callable[[Array, Array], Array]

ROUNDING = 2 * float(np.finfo(float).eps)
_TINY = float(np.finfo(float).tiny)
_STEPS = 120
# Phases, over pi, past the k-th root of a membrane, after which its next cannot be missed.
_PAST_A_ZERO = 0.4


def enclosed(
    function: Function, places: Array, highest: float, precision: float = ROUNDING
) -> Array:
    """Return the roots (rows, K) of ``function(m, x)`` between successive places (rows, K + 1).

    Row m holds order m = 0, 1, ...; one root lies between any two finite, ascending places, and
    perhaps one between the last of them and `highest`. Infinity where there is none.
    """
    orders = np.broadcast_to(np.arange(len(places), dtype=float)[:, None], places.shape)[:, 1:]
    low, high = places[:, :-1], np.minimum(places[:, 1:], highest)
    rows, columns = np.nonzero(low < high)
    order, ends = orders[rows, columns], (low[rows, columns], high[rows, columns])
    levels = function(order, ends[0]), function(order, ends[1])
    changes = np.sign(levels[0]) * np.sign(levels[1]) <= 0
    order = order[changes]
    roots = np.full(low.shape, np.inf)
    roots[rows[changes], columns[changes]] = narrowed(
        lambda x: function(order, x),
        (ends[0][changes], ends[1][changes]),
        (levels[0][changes], levels[1][changes]),
        precision,
    )
    return roots


def narrowed(
    function: Callable[[Array], Array],
    ends: tuple[Array, Array],
    levels: tuple[Array, Array],
    precision: float = ROUNDING,
) -> Array:
    """Return a root in each of many intervals at whose ends the function differs in sign.

    Inverse quadratic interpolation where it may be trusted, else halves (T. R. Chandrupatla,
    Advances in Engineering Software 28, 145, 1997), until each interval has shrunk.
    """
    (near, far), (at_near, at_far) = ends, levels
    share = np.full(near.shape, 0.5)
    for _ in range(_STEPS):
        middle = near + share * (far - near)
        level = function(middle)
        same = np.sign(level) == np.sign(at_near)
        old, at_old = np.where(same, near, far), np.where(same, at_near, at_far)
        far, at_far = np.where(same, far, near), np.where(same, at_far, at_near)
        near, at_near = middle, level
        best = np.where(np.abs(at_near) < np.abs(at_far), near, far)
        least = precision * np.abs(best) / np.maximum(np.abs(far - near), _TINY)
        if np.all((least > 0.5) | (at_near == 0) | (at_far == 0)):
            return best
        share = _interpolated((near, far, old), (at_near, at_far, at_old))
        share = np.clip(share, np.minimum(least, 0.5), np.maximum(1 - least, 0.5))
    raise SolverError(
        f"a root near {near.flat[0]} was not found in {_STEPS} steps: please report it with the "
        "body's dimensions"
    )


def _interpolated(places: tuple[Array, Array, Array], values: tuple[Array, Array, Array]) -> Array:
    """Return the share of the way from the first to the second place at which zero is expected."""
    (a, b, c), (fa, fb, fc) = places, values
    with np.errstate(all="ignore"):
        xi, phi = (a - b) / (c - b), (fa - fb) / (fc - fb)
        trusted = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
        quadratic = (c - a) / (b - a) * fa / (fc - fa) * fb / (fc - fb)
        inverse = fa / (fb - fa) * fc / (fb - fc) + quadratic
    return np.where(trusted & np.isfinite(inverse), inverse, 0.5)


def membrane_roots(highest: float, ratio: float = 0.0) -> Array:
    """Return the roots x(m, k) up to `highest` of a round membrane (rows, K), infinity beyond.

    They are the zeros of J_m(x) for a disk, and of J_m(b x) Y_m(x) - J_m(x) Y_m(b x) for a ring
    whose hole has `ratio` = b times its radius; `highest` bounds radius times wavenumber.
    """
    orders = np.arange(int(highest) + 1, dtype=float)
    places = separators(orders, highest, _PAST_A_ZERO, ratio)
    roots = enclosed(lambda m, x: membrane_edge(m, x, ratio), places, highest)
    require_counts(roots, zeros_below(orders, highest, ratio))
    return roots


def membrane_edge(orders: Array, x: Array, ratio: float) -> Array:
    """Return forms at the outer edge, for wavenumber x / radius, that vanish at the inner one."""
    if ratio == 0:
        return at_edge(orders, x).wave
    regular, singular, _ = ring_parts(orders, ratio * x)
    return regular * special.jv(orders, x) + singular * special.yv(orders, x)


def zeros_below(orders: Array, highest: float, ratio: float = 0.0) -> Index:
    """Return how many roots a round membrane has up to `highest`, by order from 0 on.

    Roots of successive orders interlace, x(m, k) < x(m + 1, k) < x(m, k + 1), and those of order
    1/2 are k pi / (1 - b) (Watson 1944, sections 15.22 and 15.24; for rings by Sturm's comparison).
    So an order has as many roots as the one before, or one less, as the sign at `highest` decides:
    a Sturm sequence.
    """
    start = -1 if ratio else 1
    signs = start * np.sign(membrane_edge(orders, np.full(len(orders), highest), ratio))
    counts = np.empty(len(orders), np.int64)
    count = int(highest * (1 - ratio) / np.pi) + 1
    for order, sign in enumerate(signs):
        # One less if the sign is that after one less; at a root itself, it counts.
        count = max(count - (sign == 1 - 2 * ((count - 1) % 2)), 0)
        counts[order] = count
    return counts


def require_counts(roots: Array, counts: Index) -> None:
    """Refuse roots that are not as many as theory demands, by order."""
    found = np.isfinite(roots).sum(axis=1)
    wrong = np.flatnonzero(found != counts)
    if len(wrong):
        raise SolverError(
            f"{found[wrong[0]]} roots of order {wrong[0]} were found where {counts[wrong[0]]} must "
            "lie: please report it with the body's dimensions"
        )


def separators(orders: Array, highest: float, past: float, ratio: float = 0.0) -> Array:
    """Return places (orders, K) where waves reach phases (k + past) pi, infinity past `highest`.

    Roots of a membrane lie near phases of k pi, or (k - 1/4) pi where the wave turns before it
    meets the hole or the centre (Wentzel, Kramers and Brillouin): intervals between these places
    hold one root each, to be confirmed by signs and counts.
    """
    steps = np.arange(int(highest * (1 - ratio) / np.pi) + 2, dtype=np.float64)
    targets: Array = np.tile(np.pi * (steps + past), (len(orders), 1))
    after = _phase(orders, np.full(len(orders), highest), ratio)[:, None] - targets
    rows, columns = np.nonzero(after > 0)
    order, target = orders[rows], targets[rows, columns]
    ends = np.maximum(order, 1e-9), np.full(len(order), highest)
    places = np.full(targets.shape, np.inf)
    places[rows, columns] = narrowed(
        lambda x: _phase(order, x, ratio) - target, ends, (-target, after[rows, columns]), 1e-6
    )
    return places


def _phase(orders: Array, x: Array, ratio: float) -> Array:
    """Return the phase that a wave with m periods around gathers from the hole to the edge."""
    return _phase_within(orders, x) - _phase_within(orders, ratio * x)


def _phase_within(orders: Array, x: Array) -> Array:
    beyond = np.maximum(x, orders)
    turn = np.divide(orders, beyond, out=np.ones_like(beyond), where=beyond > 0)
    phase: Array = np.sqrt(beyond**2 - orders**2) - orders * np.arccos(turn)
    return phase

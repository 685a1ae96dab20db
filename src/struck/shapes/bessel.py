"""Bessel functions of whole order at the edges of round bodies: values, and roots, none missed."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import special
from scipy.optimize import elementwise

from struck.errors import SolverError
from struck.model.arrays import Array, Index

_SMALL = 1e-30
_NOISE_LEVEL = 1e-18


def edge_values(orders: Array, x: Array) -> tuple[Array, Array, Array]:
    """Return J_m, J_{m+1} and I_{m+1} / I_m at x (N,), 6 times as fast as scipy.special.

    Orders m are whole, up to about 1.1 x. Both recurrences run downwards, where they are stable,
    from orders at which J_m vanishes (Miller's algorithm; Abramowitz and Stegun 9.12, 9.1.46).
    """
    top = np.maximum(orders, x)
    start_orders = (top + 12 * np.cbrt(top) + 24).astype(np.int64)
    ranks = np.argsort(-start_orders, kind="stable")
    values = np.empty((3, len(x)))
    values[:, ranks] = _recur_downwards(orders[ranks], x[ranks], start_orders[ranks])
    return values[0], values[1], values[2]


def _recur_downwards(orders: Array, x: Array, start_orders: NDArray[np.int64]) -> Array:
    """Return J_m, J_{m+1} and I_{m+1} / I_m (3, N), given in the order of falling starts."""
    max_order = int(start_orders[0]) if len(start_orders) else -1
    running = len(x) - np.searchsorted(start_orders[::-1], np.arange(max_order + 1))
    owners = _owners(orders, max_order)
    terms, next_terms = np.full(len(x), _SMALL), np.zeros(len(x))
    growth, sums = np.zeros(len(x)), np.zeros(len(x))
    values = np.empty((3, len(x)))
    for order in range(max_order, -1, -1):
        n = running[order]
        rows = owners[order]
        values[0, rows], values[1, rows], values[2, rows] = (
            terms[rows],
            next_terms[rows],
            growth[rows],
        )
        if order % 2 == 0:
            sums[:n] += terms[:n] if order else terms[:n] / 2
        ratio = 2 * order / x[:n]
        terms[:n], next_terms[:n] = ratio * terms[:n] - next_terms[:n], terms[:n].copy()
        growth[:n] = 1 / (growth[:n] + ratio) if order else 0
    values[:2] /= 2 * sums
    return values


def _owners(orders: Array, max_order: int) -> list[NDArray[np.int64]]:
    """Return the indices of the arguments with each order up to `max_order`."""
    ranks = np.argsort(orders, kind="stable")
    return np.split(ranks, np.searchsorted(orders[ranks], np.arange(max_order + 1))[1:])


def ring_parts(orders: Array, inner: Array) -> tuple[Array, Array, Array]:
    """Return factors of J_m and Y_m in forms that vanish at the argument `inner`, and their size.

    The squares of the factors sum to 1. The size is (J_m^2 + Y_m^2)^(1/2) there, infinite where Y_m
    exceeds all numbers. The factor of Y_m is 0 where its part, at most J_m(inner), is noise.
    """
    first_kind, second_kind = special.jv(orders, inner), special.yv(orders, inner)
    size = np.hypot(first_kind, second_kind)
    is_noise = np.abs(first_kind) < _NOISE_LEVEL
    regular = np.where(is_noise, -1.0, second_kind / np.where(is_noise, 1.0, size))
    return regular, np.where(is_noise, 0.0, -first_kind / size), size


# Roots of equations in Bessel functions, each from an interval that holds no other.

Function = Callable[..., Array]  # of arrays of one shape

ROUNDING = 2 * float(np.finfo(float).eps)
# Phases, over pi, past the k-th root of a membrane, after which its next cannot be missed.
_PAST_A_ZERO = 0.4


def find_enclosed_roots(
    function: Function, places: Array, max_argument: float, precision: float = ROUNDING
) -> Array:
    """Return the roots (rows, K) of ``function(m, x)`` between successive places (rows, K + 1).

    Row m holds order m = 0, 1, ...; one root lies between any two finite, ascending places, and
    perhaps one between the last of them and `max_argument`. Infinity where a root does not exist.
    """
    orders = np.broadcast_to(np.arange(len(places), dtype=float)[:, None], places.shape)[:, 1:]
    low, high = places[:, :-1], np.minimum(places[:, 1:], max_argument)
    rows, columns = np.nonzero(low < high)
    order, ends = orders[rows, columns], (low[rows, columns], high[rows, columns])
    changes = np.sign(function(order, ends[0])) * np.sign(function(order, ends[1])) <= 0
    roots = np.full(low.shape, np.inf)
    roots[rows[changes], columns[changes]] = _find_root(
        lambda x, m: function(m, x),
        (ends[0][changes], ends[1][changes]),
        (order[changes],),
        precision,
    )
    return roots


def _find_root(
    function: Function, ends: tuple[Array, Array], others: tuple[Array, ...], precision: float
) -> Array:
    """Return the root of ``function(x, *others)`` between each pair of ends (N,)."""
    if not len(ends[0]):
        return np.empty(0)
    solution = elementwise.find_root(
        function,
        ends,
        args=others,
        tolerances={"xatol": 0.0, "xrtol": precision, "fatol": 0.0, "frtol": 0.0},
    )
    if not np.all(solution.success):
        position = solution.x[~solution.success][0]
        raise SolverError(
            f"a root near {position} was not found: please report it with the body's dimensions"
        )
    return solution.x


def membrane_roots(max_argument: float, ratio: float = 0.0) -> Array:
    """Return the roots x(m, k) up to `max_argument` of a round membrane (rows, K), infinity beyond.

    They are the zeros of J_m(x) for a disk, and of J_m(b x) Y_m(x) - J_m(x) Y_m(b x) for a ring
    whose hole has `ratio` = b times its radius; `max_argument` bounds radius times wavenumber.
    """
    orders = np.arange(int(max_argument) + 1, dtype=float)
    places = separators(orders, max_argument, _PAST_A_ZERO, ratio)
    roots = find_enclosed_roots(lambda m, x: membrane_edge(m, x, ratio), places, max_argument)
    require_counts(roots, zeros_below(orders, max_argument, ratio))
    return roots


def membrane_edge(orders: Array, x: Array, ratio: float) -> Array:
    """Return forms at the outer edge, for wavenumber x / radius, that vanish at the inner one."""
    if ratio == 0:
        return edge_values(orders, x)[0]
    regular, singular, _ = ring_parts(orders, ratio * x)
    return regular * special.jv(orders, x) + singular * special.yv(orders, x)


def zeros_below(orders: Array, max_argument: float, ratio: float = 0.0) -> Index:
    """Return how many roots a round membrane has up to `max_argument`, by order from 0 on.

    Roots of successive orders interlace, x(m, k) < x(m + 1, k) < x(m, k + 1), and those of order
    1/2 are k pi / (1 - b) (Watson 1944, sections 15.22 and 15.24; for rings by Sturm's comparison).
    So an order has as many roots as the one before, or one less, as the sign at `max_argument`
    decides: a Sturm sequence.
    """
    start = -1 if ratio else 1
    signs = start * np.sign(membrane_edge(orders, np.full(len(orders), max_argument), ratio))
    counts = np.empty(len(orders), np.int64)
    count = int(max_argument * (1 - ratio) / np.pi) + 1
    for order, sign in enumerate(signs):
        # One less if the sign is that after one less; at a root itself, it counts.
        count = max(count - (sign == 1 - 2 * ((count - 1) % 2)), 0)
        counts[order] = count
    return counts


def require_counts(roots: Array, counts: Index) -> None:
    """Refuse roots that are not as many as theory demands, by order."""
    root_counts = np.isfinite(roots).sum(axis=1)
    wrong_orders = np.flatnonzero(root_counts != counts)
    if len(wrong_orders):
        raise SolverError(
            f"{root_counts[wrong_orders[0]]} roots of order {wrong_orders[0]} were found where "
            f"{counts[wrong_orders[0]]} must "
            "lie: please report it with the body's dimensions"
        )


def separators(
    orders: Array, max_argument: float, phase_offset: float, ratio: float = 0.0
) -> Array:
    """Return places (orders, K) with phases (k + phase_offset) pi, infinity past `max_argument`.

    Roots of a membrane lie near phases of k pi, or (k - 1/4) pi where the wave turns before it
    meets the hole or the centre (Wentzel, Kramers and Brillouin): intervals between these places
    hold one root each, to be confirmed by signs and counts.
    """
    steps = np.arange(int(max_argument * (1 - ratio) / np.pi) + 2, dtype=np.float64)
    target_phases: Array = np.tile(np.pi * (steps + phase_offset), (len(orders), 1))
    is_reached = _phase(np.full(len(orders), max_argument), orders, ratio)[:, None] > target_phases
    rows, columns = np.nonzero(is_reached)
    order = orders[rows]
    ends = np.maximum(order, 1e-9), np.full(len(order), max_argument)
    places = np.full(target_phases.shape, np.inf)
    places[rows, columns] = _find_root(
        lambda x, m, target: _phase(x, m, ratio) - target,
        ends,
        (order, target_phases[rows, columns]),
        1e-6,
    )
    return places


def _phase(x: Array, orders: Array, ratio: float) -> Array:
    """Return the phase that a wave with m periods around gathers from the hole to the edge."""
    return _phase_within(orders, x) - _phase_within(orders, ratio * x)


def _phase_within(orders: Array, x: Array) -> Array:
    arguments = np.maximum(x, orders)
    ratios = np.divide(orders, arguments, out=np.ones_like(arguments), where=arguments > 0)
    phase: Array = np.sqrt(arguments**2 - orders**2) - orders * np.arccos(ratios)
    return phase

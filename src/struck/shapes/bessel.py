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
_UNHEARD = 1e-18


def at_edge(orders: Array, x: Array) -> tuple[Array, Array, Array]:
    """Return J_m, J_{m+1} and I_{m+1} / I_m at x (N,), 6 times as fast as scipy.special.

    Orders m are whole, up to about 1.1 x. Both recurrences run downwards, where they are stable,
    from orders at which J_m vanishes (Miller's algorithm; Abramowitz and Stegun 9.12, 9.1.46).
    """
    top = np.maximum(orders, x)
    starts = (top + 12 * np.cbrt(top) + 24).astype(np.int64)
    ranks = np.argsort(-starts, kind="stable")
    found = np.empty((3, len(x)))
    found[:, ranks] = _downwards(orders[ranks], x[ranks], starts[ranks])
    return found[0], found[1], found[2]


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
    return np.split(ranked, np.searchsorted(orders[ranked], np.arange(highest + 1))[1:])


def ring_parts(orders: Array, inner: Array) -> tuple[Array, Array, Array]:
    """Return factors of J_m and Y_m in forms that vanish at the argument `inner`, and their size.

    The squares of the factors sum to 1. The size is (J_m^2 + Y_m^2)^(1/2) there, infinite where Y_m
    exceeds all numbers. The factor of Y_m is 0 where its part, at most J_m(inner), is noise.
    """
    first, second = special.jv(orders, inner), special.yv(orders, inner)
    size = np.hypot(first, second)
    dull = np.abs(first) < _UNHEARD
    regular = np.where(dull, -1.0, second / np.where(dull, 1.0, size))
    return regular, np.where(dull, 0.0, -first / size), size


# Roots of equations in Bessel functions, each from an interval that holds no other.

Function = Callable[..., Array]  # of arrays of one shape

ROUNDING = 2 * float(np.finfo(float).eps)
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
    changes = np.sign(function(order, ends[0])) * np.sign(function(order, ends[1])) <= 0
    roots = np.full(low.shape, np.inf)
    roots[rows[changes], columns[changes]] = _root(
        lambda x, m: function(m, x),
        (ends[0][changes], ends[1][changes]),
        (order[changes],),
        precision,
    )
    return roots


def _root(
    function: Function, ends: tuple[Array, Array], others: tuple[Array, ...], precision: float
) -> Array:
    """Return the root of ``function(x, *others)`` between each pair of ends (N,)."""
    if not len(ends[0]):
        return np.empty(0)
    found = elementwise.find_root(
        function,
        ends,
        args=others,
        tolerances={"xatol": 0.0, "xrtol": precision, "fatol": 0.0, "frtol": 0.0},
    )
    if not np.all(found.success):
        lost = found.x[~found.success][0]
        raise SolverError(
            f"a root near {lost} was not found: please report it with the body's dimensions"
        )
    return found.x


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
        return at_edge(orders, x)[0]
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
    after = _phase(np.full(len(orders), highest), orders, ratio)[:, None] > targets
    rows, columns = np.nonzero(after)
    order = orders[rows]
    ends = np.maximum(order, 1e-9), np.full(len(order), highest)
    places = np.full(targets.shape, np.inf)
    places[rows, columns] = _root(
        lambda x, m, target: _phase(x, m, ratio) - target,
        ends,
        (order, targets[rows, columns]),
        1e-6,
    )
    return places


def _phase(x: Array, orders: Array, ratio: float) -> Array:
    """Return the phase that a wave with m periods around gathers from the hole to the edge."""
    return _phase_within(orders, x) - _phase_within(orders, ratio * x)


def _phase_within(orders: Array, x: Array) -> Array:
    beyond = np.maximum(x, orders)
    turn = np.divide(orders, beyond, out=np.ones_like(beyond), where=beyond > 0)
    phase: Array = np.sqrt(beyond**2 - orders**2) - orders * np.arccos(turn)
    return phase

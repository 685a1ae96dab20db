"""Roots of equations in Bessel functions, each from an interval that holds no other."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy import special

from struck.errors import SolverError
from struck.shapes.bessel import at_edge, ring_parts

Array = NDArray[np.float64]
Index = NDArray[np.int64]
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
    """Return the roots of ``function(m, x)`` in x between successive places, up to `highest`.

    Parameters
    ----------
    function : callable
    places : array (rows, K + 1)
        Of order m = 0, 1, ... in each row, ascending; one root lies between any two that are
        finite. Behind infinity there are none.
    highest : float
        Where the search ends; between it and the last place before it there may be one.
    precision : float
        Relative.

    Returns
    -------
    array (rows, K)
        Infinity where there is no root, or none up to `highest`.
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

    Parameters
    ----------
    function : callable
        Of places (N,), one in each interval.
    ends, levels : pairs of arrays (N,)
        The intervals, and the function there.
    precision : float
        Largest width of an interval at the end, over its place; half of it, in fact.

    Raises
    ------
    SolverError
        When an interval does not shrink.
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
    """Return every root up to `highest` of a round membrane that is held at its edges.

    They are the zeros of J_m(x) for a disk, and of J_m(b x) Y_m(x) - J_m(x) Y_m(b x) for a ring
    whose hole has b times its radius.

    Parameters
    ----------
    highest : float
        Largest radius times wavenumber.
    ratio : float
        b, from 0 (a disk) to below 1.

    Returns
    -------
    array (rows, K)
        x(m, k) ascending in each row, infinity beyond `highest`.

    Raises
    ------
    SolverError
        When roots are not as many as theory demands.
    """
    orders = np.arange(int(highest) + 1, dtype=float)
    places = separators(orders, highest, _PAST_A_ZERO, ratio)
    roots = enclosed(lambda m, x: membrane_edge(m, x, ratio), places, highest)
    require_counts(roots, zeros_below(orders, highest, ratio))
    return roots


def membrane_edge(orders: Array, x: Array, ratio: float) -> Array:
    """Return the form of wavenumber x / radius at the outer edge, of those 0 at the inner."""
    if ratio == 0:
        return at_edge(orders, x).wave
    regular, singular, _ = ring_parts(orders, ratio * x)
    return regular * special.jv(orders, x) + singular * special.yv(orders, x)


def zeros_below(orders: Array, highest: float, ratio: float = 0.0) -> Index:
    """Return how many roots a round membrane has up to `highest`, by order from 0 on.

    Those of successive orders interlace, x(m, k) < x(m + 1, k) < x(m, k + 1), and those of order
    1/2 are k pi / (1 - b) (Watson, "Theory of Bessel Functions", 2nd ed., 1944, sections 15.22 and
    15.24; for rings by Sturm's comparison of successive orders). So an order has as many roots as
    the one before, or one less, as the sign at `highest` tells: a Sturm sequence.
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
    """Refuse roots that are not as many as theory demands, by order.

    Raises
    ------
    SolverError
        Where they are not.
    """
    found = np.isfinite(roots).sum(axis=1)
    wrong = np.flatnonzero(found != counts)
    if len(wrong):
        raise SolverError(
            f"{found[wrong[0]]} roots of order {wrong[0]} were found where {counts[wrong[0]]} must "
            "lie: please report it with the body's dimensions"
        )


def separators(orders: Array, highest: float, past: float, ratio: float = 0.0) -> Array:
    """Return places up to `highest` at which waves reach phases of (k + past) pi, k = 0, 1, ...

    Roots of a membrane lie near phases of k pi, or (k - 1/4) pi where the wave turns before it
    meets the hole or the centre (Wentzel, Kramers and Brillouin). Whoever takes these places for
    ends of intervals has to see the sign change in each, and to count.

    Returns
    -------
    array (orders, K)
        Infinity beyond `highest`.
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

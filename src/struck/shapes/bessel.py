"""Bessel functions of whole order, many at once, as the edges of round bodies need them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

Array = NDArray[np.float64]

_SMALL = 1e-30
_UNHEARD = 1e-18


class AtEdge(NamedTuple):
    """J_m(x), J_{m+1}(x) and I_{m+1}(x) / I_m(x)."""

    wave: Array
    following: Array
    growth: Array


def at_edge(orders: Array, x: Array) -> AtEdge:
    """Return the Bessel functions of a disk's edge, for whole orders of at most about 1.1 x.

    Both recurrences run downwards, where they are stable, from orders at which J_m vanishes
    (Miller's algorithm; Abramowitz and Stegun 9.12, 9.1.46).

    Parameters
    ----------
    orders, x : array (N,)
        m from 0 on; positive arguments.
    """
    top = np.maximum(orders, x)
    starts = (top + 12 * np.cbrt(top) + 24).astype(np.int64)
    ranks = np.argsort(-starts, kind="stable")
    found = np.empty((3, len(x)))
    found[:, ranks] = _downwards(orders[ranks], x[ranks], starts[ranks])
    return AtEdge(*found)


def _downwards(orders: Array, x: Array, starts: NDArray[np.int64]) -> Array:
    """Return J_m, J_{m+1} and I_{m+1} / I_m, given in the order of falling starts."""
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
    """Return which elements want each order up to `highest`."""
    ranked = np.argsort(orders, kind="stable")
    bounds = np.searchsorted(orders[ranked], np.arange(highest + 1))
    return np.split(ranked, bounds[1:])


def ring_parts(orders: Array, inner: Array) -> tuple[Array, Array, Array]:
    """Return what J_m and Y_m contribute to a form that vanishes where their argument is `inner`.

    Parameters
    ----------
    orders, inner : array (N,)

    Returns
    -------
    regular, singular, size : arrays (N,)
        The sum of squares of the first two is 1. The third is (J_m^2 + Y_m^2)^(1/2) there,
        infinite where Y_m exceeds all numbers. The second is 0 where nobody can tell: the whole
        contribution of Y_m is at most J_m(inner).
    """
    first, second = special.jv(orders, inner), special.yv(orders, inner)
    size = np.hypot(first, second)
    dull = np.abs(first) < _UNHEARD
    regular = np.where(dull, -1.0, second / np.where(dull, 1.0, size))
    return regular, np.where(dull, 0.0, -first / size), size

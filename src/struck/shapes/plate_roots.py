"""Roots of the characteristic equations of circular plates, none missed."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.shapes.bessel import at_edge
from struck.shapes.roots import Function, enclosed, require_counts, separators, zeros_below

Array = NDArray[np.float64]
Index = NDArray[np.int64]
EDGES = ("free", "supported", "clamped")

# Waves along a free rim have at least 0.98 of the number of those around it (Konenkov 1960).
_RIM_WAVE = 0.9
# Phases, over pi, past the k-th root, after which the next cannot be missed.
_PAST_CLAMPED, _PAST_SUPPORTED = 0.4, 1.2
_COARSE = 1e-7


def plate_roots(edge: str, highest: float, poisson_ratio: float) -> Array:
    """Return every root up to `highest` of a circular plate.

    Parameters
    ----------
    edge : str
        "free", "supported" or "clamped".
    highest : float
        Largest radius times wavenumber.
    poisson_ratio : float

    Returns
    -------
    array (M, K)
        lambda of m nodal diameters in ascending order, infinity beyond `highest` (of a free plate
        with m below 2 behind one more infinity: its motions as a rigid one are left out).

    Raises
    ------
    SolverError
        When roots are not as many as theory demands.

    Notes
    -----
    The ratio of a load on the edge to its displacement falls, or rises, with lambda between its
    poles, by Green's identity, however the edge is held otherwise. So the roots of plates that
    differ by one constraint alternate strictly. Seen from the zeros j(m, k) of J_m, which belong
    to an edge with w = 0 and no Laplacian of w:

    - clamped: one root between j(m, k) and j(m, k + 1);
    - supported: one root between j(m, k) and j(m, k + 1), and one below j(m, 1);
    - free: one root between successive roots of the supported plate, and, with two or more nodal
      diameters, one below them all.

    With signs at `highest` this tells how many there are below.
    """
    orders = np.arange(int(highest / _RIM_WAVE) + 2, dtype=float)
    held = zeros_below(orders, highest)
    if edge == "clamped":
        places = separators(orders, highest, _PAST_CLAMPED)
        roots = enclosed(clamped_edge, places, highest)
        require_counts(roots, _counts(clamped_edge, highest, held - 1, 1))
        return roots

    def hinge(m: Array, x: Array) -> Array:
        return supported_edge(m, x, poisson_ratio)

    def rim(m: Array, x: Array) -> Array:
        return free_edge(m, x, poisson_ratio)

    precision = {"precision": _COARSE} if edge == "free" else {}
    places = _below_supported(orders, highest, poisson_ratio)
    hinged = enclosed(hinge, places, highest, **precision)
    held = _counts(hinge, highest, held, -1)
    require_counts(hinged, held)
    if edge == "supported":
        return hinged
    roots = enclosed(rim, _below_free(hinged), highest)
    rigid = np.where(orders < 2, 1, 0)
    require_counts(roots, _counts(rim, highest, held - rigid, np.where(orders < 2, -1, 1)))
    return roots


def _counts(edge: Function, highest: float, least: Index, start: int | Index) -> Index:
    """Return how many roots lie up to `highest`: `least` or one more, as the sign there tells.

    `start` is the sign before the first root.
    """
    orders = np.arange(len(least), dtype=float)
    signs = np.sign(edge(orders, np.full(len(least), highest))) * start
    return np.maximum(least + (signs != np.where(least % 2, -1, 1)), 0)


def _below_supported(orders: Array, highest: float, poisson_ratio: float) -> Array:
    """Return places below the first root and between successive ones of supported plates.

    By the series of both quotients of Bessel functions, the first root exceeds m, and for m = 0
    (1 + nu)^(1/4).
    """
    first = orders.copy()
    first[0] = (1 + poisson_ratio) ** 0.25
    return np.column_stack([first, separators(orders, highest, _PAST_SUPPORTED)])


def _below_free(supported: Array) -> Array:
    first = _RIM_WAVE * np.arange(len(supported))
    first[:2] = np.inf
    return np.column_stack([first, supported, np.full(len(supported), np.inf)])


def clamped_edge(orders: Array, x: Array) -> Array:
    """Return J_m I_{m+1} / I_m + J_{m+1}: zero where w and dw/dr can vanish on the edge."""
    wave, following, growth = at_edge(orders, x)
    return wave * growth + following


def supported_edge(orders: Array, x: Array, poisson_ratio: float) -> Array:
    """Return what is zero where w and the bending moment can vanish on the edge."""
    wave, following, growth = at_edge(orders, x)
    return following + wave * (growth - 2 * x / (1 - poisson_ratio))


def free_edge(orders: Array, x: Array, poisson_ratio: float) -> Array:
    """Return what is zero where moment and Kirchhoff's shear force can vanish on the edge."""
    wave, wave_slope, growing_slope = edge_slopes(orders, x)
    moment = bending_moment(orders, -(x**2), wave, wave_slope, poisson_ratio)
    growing_moment = bending_moment(orders, x**2, np.ones_like(x), growing_slope, poisson_ratio)
    twist = (1 - poisson_ratio) * orders**2
    shear = -(x**2) * wave_slope - twist * (wave_slope - wave)
    growing_shear = x**2 * growing_slope - twist * (growing_slope - 1)
    return moment * growing_shear - growing_moment * shear


def edge_slopes(orders: Array, x: Array) -> tuple[Array, Array, Array]:
    """Return J_m(x r), its d/dr, and d/dr of I_m(x r) / I_m(x), at r = 1."""
    wave, following, growth = at_edge(orders, x)
    return wave, orders * wave - x * following, orders + x * growth


def bending_moment(
    orders: Array, curvature: Array, value: Array, slope: Array, poisson_ratio: float
) -> Array:
    """Return -M_r R^2 / D at r = 1 of a form whose Laplacian is `curvature` times itself."""
    return curvature * value - (1 - poisson_ratio) * (slope - orders**2 * value)

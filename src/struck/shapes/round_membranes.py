"""What disks and rings under tension have in common."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from struck.model.material import Material
from struck.shapes.bessel import at_edge, ring_parts
from struck.shapes.plans import require_countable
from struck.shapes.roots import membrane_roots
from struck.shapes.round_forms import RoundForms, with_pairs
from struck.shapes.shape import Vibration

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_ROUNDING = 1e-13


def round_membrane(
    material: Material,
    highest: float,
    *,
    radius: float,
    hole: float,
    thickness: float,
    tension: float,
) -> Vibration:
    """Return every mode up to `highest` Hz of a membrane held at its edges.

    Parameters
    ----------
    material : Material
    highest : float
        Hz.
    radius, hole, thickness : float
        m; no hole: 0.
    tension : float
        N/m.

    Raises
    ------
    OptionError
        When they are more than 100,000.
    """
    speed = math.sqrt(tension / (material.density * thickness))
    ratio, wavenumber = hole / radius, 2 * math.pi * highest / speed
    require_countable("membrane", math.pi * (radius**2 - hole**2), wavenumber, highest)
    orders, sines, roots = with_pairs(membrane_roots(radius * wavenumber, ratio))
    return Vibration(
        frequencies=speed / (2 * math.pi * radius) * roots,
        forms=_forms(radius, ratio, (orders, sines), roots),
        poisson_slopes=np.zeros(len(roots)),
        # Phases of narrow rings are small differences of large ones.
        errors=np.full(len(roots), _ROUNDING + 20 * np.finfo(float).eps / (1 - ratio)),
        half_wave=math.pi * radius / float(roots.max(initial=math.pi)),
        method="round membrane: zeros of Bessel functions, counted by a Sturm sequence",
        references=("morse1948",),
        details={"speed of waves": speed},
    )


def _forms(radius: float, ratio: float, waves: tuple[Index, Index], roots: Array) -> RoundForms:
    orders, sines = waves
    parts = _disk(orders, roots) if ratio == 0 else _ring(orders, roots, ratio)
    around = np.where(orders > 0, math.sqrt(2), 1.0)
    return RoundForms(
        radius=radius,
        ratio=ratio,
        orders=orders,
        sines=sines,
        wavenumbers=roots,
        regular=around * parts[0],
        singular=around * parts[1],
        growing=np.zeros(len(roots)),
    )


def _disk(orders: Index, roots: Array) -> tuple[Array, Array]:
    """Return the factors of J_m and Y_m: the mean square of J_m is J_{m+1}(x)^2."""
    _, following, _ = at_edge(orders.astype(float), roots)
    return 1 / np.abs(following), np.zeros(len(roots))


def _ring(orders: Index, roots: Array, ratio: float) -> tuple[Array, Array]:
    """Return the factors of J_m and Y_m, by Lommel's integral and Wronski's determinant."""
    m = orders.astype(float)
    regular, singular, inner = ring_parts(m, ratio * roots)
    _, _, outer = ring_parts(m, roots)
    square = 4 / (math.pi * roots) ** 2 * (outer**-2.0 - inner**-2.0) / (1 - ratio**2)
    return regular / np.sqrt(square), singular / np.sqrt(square)

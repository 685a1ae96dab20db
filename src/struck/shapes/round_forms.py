"""Forms of round bodies: Bessel functions of the radius times waves around."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import special

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Radial = Callable[[Array], Array]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RoundForms:
    """Functions of a disk or ring: [a J_m(x r) + b Y_m(x r) + c I_m(x r) / I_m(x)] cos or sin.

    r is the distance from the centre over the radius; the angle is that from the x axis, times m.

    Parameters
    ----------
    radius : float
        m.
    ratio : float
        Radius of the hole over that of the body; 0 for none.
    orders : array (M,)
        Nodal diameters m.
    sines : array (M,)
        1 where the wave around is a sine, 0 where it is a cosine.
    wavenumbers : array (M,)
        x, times the radius.
    regular, singular, growing : array (M,)
        a, b and c.
    """

    radius: float
    ratio: float = 0.0
    orders: Index
    sines: Index
    wavenumbers: Array
    regular: Array
    singular: Array
    growing: Array

    @property
    def dimensions(self) -> int:
        """Coordinates of a place: x and y."""
        return 2

    def values(self, places: Array) -> Array:
        """Return the forms at places (K, 2), m: (K, M). Beyond the edge: as on it."""
        x, y = np.asarray(places, dtype=np.float64)[:, :2].T
        distance = np.clip(np.hypot(x, y) / self.radius, self.ratio, 1.0)
        return self._radial(distance) * self._around(np.arctan2(y, x))

    def chosen(self, modes: Index) -> Self:
        """Return the forms of some modes, in that order."""
        names = ("orders", "sines", "wavenumbers", "regular", "singular", "growing")
        return replace(self, **{name: getattr(self, name)[modes] for name in names})

    def _around(self, angles: Array) -> Array:
        orders, back = np.unique(self.orders, return_inverse=True)
        turns = angles[:, None] * orders
        waves = np.concatenate([np.cos(turns), np.sin(turns)], axis=1)
        return waves[:, back + len(orders) * self.sines]

    def _radial(self, distances: Array) -> Array:
        """Return the factors that depend on the distance (K, M), for each pair of modes once."""
        _, first, back = np.unique(
            self.orders + 1j * self.wavenumbers, return_index=True, return_inverse=True
        )
        pairs = self.chosen(first)
        count = _enough(float(self.wavenumbers.max(initial=0.0)), self.ratio)
        radial = np.empty((len(distances), len(pairs.orders)))
        for part, more in ((pairs.singular == 0, 0), (pairs.singular != 0, self._more())):
            function = partial(_exact, pairs.chosen(np.flatnonzero(part)))
            radial[:, part] = _carried(function, distances, count + more, self.ratio)
        return radial[:, back]

    def _more(self) -> int:
        """Return how many more points Y_m needs, which is singular at the centre."""
        return int(20 / np.arctanh(np.sqrt(self.ratio))) if self.ratio else 0


def _exact(forms: RoundForms, distances: Array) -> Array:
    """Return the factors that depend on the distance (K, M)."""
    at = distances[:, None] * forms.wavenumbers
    total = forms.regular * special.jv(forms.orders, at)
    ring, plate = np.flatnonzero(forms.singular), np.flatnonzero(forms.growing)
    total[:, ring] += forms.singular[ring] * special.yv(forms.orders[ring], at[:, ring])
    total[:, plate] += forms.growing[plate] * _growing(
        forms.orders[plate], forms.wavenumbers[plate], distances
    )
    return total


def _growing(orders: Index, wavenumbers: Array, distances: Array) -> Array:
    """Return I_m(x r) / I_m(x) without overflow."""
    r = distances[:, None]
    scaled = special.ive(orders, wavenumbers * r) / special.ive(orders, wavenumbers)
    return np.asarray(scaled * np.exp(wavenumbers * (r - 1)), dtype=np.float64)


def _enough(wavenumber: float, ratio: float) -> int:
    """Return how many of Chebyshev's points carry J_m and I_m to rounding.

    Waves need two points a wavelength and some more (Trefethen, "Approximation Theory and
    Approximation Practice", 2013, chapter 8).
    """
    half = wavenumber * (1 - ratio) / 2
    return int(half + 12 * np.cbrt(half)) + 25


def _carried(function: Radial, distances: Array, count: int, ratio: float) -> Array:
    """Return a function of the distance from `ratio` to 1, interpolated where that is quicker."""
    if len(distances) <= count:
        return function(distances)
    nodes = (1 + ratio) / 2 + (1 - ratio) / 2 * np.cos(np.linspace(0, np.pi, count))
    return _interpolation(nodes, distances) @ function(nodes)


def _interpolation(nodes: Array, places: Array) -> Array:
    """Return the matrix (K, N) from values at Chebyshev's points to those at other places.

    The barycentric formula: Berrut and Trefethen, SIAM Review 46, 501 (2004).
    """
    weights = (-1.0) ** np.arange(len(nodes))
    weights[[0, -1]] /= 2
    gaps = places[:, None] - nodes
    rows, columns = np.nonzero(gaps == 0)
    gaps[rows] = 1.0
    matrix = weights / gaps
    matrix[rows] = 0.0
    matrix[rows, columns] = 1.0
    return matrix / matrix.sum(axis=1, keepdims=True)


def with_pairs(roots: Array) -> tuple[Index, Index, Array]:
    """Return orders, 1 for sines, and roots of all modes (M,), ascending.

    Each of the roots (orders, K) that is finite is a mode that goes as a cosine around and, but for
    order 0, another that goes as a sine.
    """
    orders, columns = np.nonzero(np.isfinite(roots))
    turned = np.flatnonzero(orders > 0)
    every = np.append(np.arange(len(orders)), turned)
    sines = np.append(np.zeros_like(orders), np.ones_like(turned))
    found = roots[orders, columns][every]
    ascending = np.lexsort((sines, orders[every], found))
    return orders[every][ascending], sines[ascending], found[ascending]

"""Circular and annular membranes (1998, section 6), and the forms of round bodies."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Self

import numpy as np
from scipy import special
from scipy.interpolate import BarycentricInterpolator

from struck.errors import OptionError
from struck.model.arrays import Array, Index, checked
from struck.model.material import Material
from struck.shapes.bessel import edge_values, membrane_roots, ring_parts
from struck.shapes.shape import Shape, Vibration, require_countable, require_tension
from struck.shapes.skins import Disk, Sheet
from struck.solids.resolution import require_length

Radial = Callable[[Array], Array]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RoundForms:
    """Forms of a disk or ring: [a J_m(x r) + b Y_m(x r) + c I_m(x r) / I_m(x)] cos or sin."""

    radius: float  # m
    ratio: float = 0.0  # radius of the hole over that of the body; r is in radii of the body
    orders: Index  # (M,), nodal diameters m
    sines: Index  # (M,), 1 for a sine around, 0 for a cosine
    wavenumbers: Array  # (M,), x, times the radius
    regular: Array  # (M,), a
    singular: Array  # (M,), b
    growing: Array  # (M,), c
    dimensions = 2  # coordinates of a place: x and y

    def values(self, places: Array) -> Array:
        """Return the forms at places (K, 2), m: (K, M). Beyond the edge: as on it."""
        x, y = np.asarray(places, dtype=np.float64)[:, :2].T
        distance = np.clip(np.hypot(x, y) / self.radius, self.ratio, 1.0)
        return self._compute_radial(distance) * self._compute_angular(np.arctan2(y, x))

    def chosen(self, modes: Index) -> Self:
        """Return the forms of some modes, in that order."""
        names = ("orders", "sines", "wavenumbers", "regular", "singular", "growing")
        return replace(self, **{name: getattr(self, name)[modes] for name in names})

    def _compute_angular(self, angles: Array) -> Array:
        orders, back = np.unique(self.orders, return_inverse=True)
        phases = angles[:, None] * orders
        waves = np.concatenate([np.cos(phases), np.sin(phases)], axis=1)
        return waves[:, back + len(orders) * self.sines]

    def _compute_radial(self, distances: Array) -> Array:
        """Return the factors that depend on the distance (K, M), for each pair of modes once."""
        _, first, back = np.unique(
            self.orders + 1j * self.wavenumbers, return_index=True, return_inverse=True
        )
        pairs = self.chosen(first)
        count = _count_points(float(self.wavenumbers.max(initial=0.0)), self.ratio)
        factors = np.empty((len(distances), len(pairs.orders)))
        for part, extra_points in (
            (pairs.singular == 0, 0),
            (pairs.singular != 0, self._count_extra_points()),
        ):
            function = partial(_compute_factors, pairs.chosen(np.flatnonzero(part)))
            factors[:, part] = _interpolate(function, distances, count + extra_points, self.ratio)
        return factors[:, back]

    def _count_extra_points(self) -> int:
        """Return how many more points Y_m needs, which is singular at the centre."""
        return int(20 / np.arctanh(np.sqrt(self.ratio))) if self.ratio else 0


def _compute_factors(forms: RoundForms, distances: Array) -> Array:
    """Return the factors that depend on the distance (K, M)."""
    at = distances[:, None] * forms.wavenumbers
    factors = forms.regular * special.jv(forms.orders, at)
    ring, plate = np.flatnonzero(forms.singular), np.flatnonzero(forms.growing)
    factors[:, ring] += forms.singular[ring] * special.yv(forms.orders[ring], at[:, ring])
    factors[:, plate] += forms.growing[plate] * _growing(
        forms.orders[plate], forms.wavenumbers[plate], distances
    )
    return factors


def _growing(orders: Index, wavenumbers: Array, distances: Array) -> Array:
    """Return I_m(x r) / I_m(x) without overflow."""
    r = distances[:, None]
    ratios = special.ive(orders, wavenumbers * r) / special.ive(orders, wavenumbers)
    return np.asarray(ratios * np.exp(wavenumbers * (r - 1)), dtype=np.float64)


def _count_points(wavenumber: float, ratio: float) -> int:
    """Return how many Chebyshev points carry J_m and I_m to rounding.

    Two a wavelength and some more (Trefethen, "Approximation Theory and Approximation Practice",
    2013, chapter 8).
    """
    half = wavenumber * (1 - ratio) / 2
    return int(half + 12 * np.cbrt(half)) + 25


def _interpolate(function: Radial, distances: Array, count: int, ratio: float) -> Array:
    """Return a function of the distance from `ratio` to 1, interpolated where that is quicker."""
    if len(distances) <= count:
        return function(distances)
    # Chebyshev's points with their barycentric weights (Berrut and Trefethen, SIAM Review 46, 501).
    nodes = (1 + ratio) / 2 + (1 - ratio) / 2 * np.cos(np.linspace(0, np.pi, count))
    weights = (-1.0) ** np.arange(count)
    weights[[0, -1]] /= 2
    return BarycentricInterpolator(nodes, function(nodes), wi=weights)(distances)


def expand_pairs(roots: Array) -> tuple[Index, Index, Array]:
    """Return orders, 1 for sines, and roots of all modes (M,), ascending, from roots (orders, K).

    Each finite root is a mode that varies as a cosine around and, except for order 0, another that
    varies as a sine.
    """
    orders, columns = np.nonzero(np.isfinite(roots))
    sine_modes = np.flatnonzero(orders > 0)
    indices = np.append(np.arange(len(orders)), sine_modes)
    sines = np.append(np.zeros_like(orders), np.ones_like(sine_modes))
    mode_roots = roots[orders, columns][indices]
    ascending = np.lexsort((sines, orders[indices], mode_roots))
    return orders[indices][ascending], sines[ascending], mode_roots[ascending]


_ROUNDING = 1e-13


def _round_membrane(
    disk: Disk, thickness: float, tension: float, material: Material, max_frequency: float
) -> Vibration:
    """Return every mode up to a frequency, Hz, of a disk or ring held at its edges; N/m tension."""
    speed, radius = math.sqrt(tension / (material.density * thickness)), disk.radius
    ratio, wavenumber = disk.hole / radius, 2 * math.pi * max_frequency / speed
    require_countable("membrane", disk.area, wavenumber, max_frequency)
    orders, sines, roots = expand_pairs(membrane_roots(radius * wavenumber, ratio))
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
    scales = np.where(orders > 0, math.sqrt(2), 1.0)
    return RoundForms(
        radius=radius,
        ratio=ratio,
        orders=orders,
        sines=sines,
        wavenumbers=roots,
        regular=scales * parts[0],
        singular=scales * parts[1],
        growing=np.zeros(len(roots)),
    )


def _disk(orders: Index, roots: Array) -> tuple[Array, Array]:
    """Return the factors of J_m and Y_m: the mean square of J_m is J_{m+1}(x)^2."""
    _, following, _ = edge_values(orders.astype(float), roots)
    return 1 / np.abs(following), np.zeros(len(roots))


def _ring(orders: Index, roots: Array, ratio: float) -> tuple[Array, Array]:
    """Return the factors of J_m and Y_m, by Lommel's integral and Wronski's determinant."""
    m = orders.astype(float)
    regular, singular, inner = ring_parts(m, ratio * roots)
    _, _, outer = ring_parts(m, roots)
    square = 4 / (math.pi * roots) ** 2 * (outer**-2.0 - inner**-2.0) / (1 - ratio**2)
    return regular / np.sqrt(square), singular / np.sqrt(square)


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class AnnularMembrane(Shape):
    """A taut ring around the origin, held at its outer edge and at that of its round hole.

    Parameters
    ----------
    radius : float
        Outer radius, m.
    hole : float
        Radius of the hole, m; below `radius`.
    thickness : float
        Thickness, m.
    tension : float
        Tension, N/m, equal in all directions.

    Raises
    ------
    OptionError
        If lengths or the tension are not positive, or the hole is not smaller than the ring.

    Notes
    -----
    f_mk = c x_mk / (2 pi radius) with c^2 = tension / (density thickness) and the roots of
    J_m(b x) Y_m(x) = J_m(x) Y_m(b x), where b = hole / radius; with m > 0 nodal diameters each
    comes twice, as cosine and sine of m times the angle (Morse 1948, section 19).

    Places, at y = 0: "middle" of the ring (also "top"), "quarter" of its width from the outer edge,
    "edge" (also "rim") 1 % off it.

    Examples
    --------
    >>> ring = AnnularMembrane(radius=0.2, hole=0.05, thickness=0.0005, tension=2000.0)
    >>> skin = Material(density=1300.0, youngs_modulus=3.5e9, poisson_ratio=0.4)
    >>> ring.vibration(skin, 240.0).frequencies.round(2)
    array([180.88, 196.32, 196.32, 234.83, 234.83])
    """

    radius: float
    hole: float
    thickness: float
    tension: float

    tensioned: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name in ("radius", "hole", "thickness"):
            require_length(f"{name} of the membrane", getattr(self, name))
        if self.hole >= self.radius:
            raise OptionError(
                f"hole of the membrane has a radius of {self.hole} m: it must lie below that of "
                f"the membrane, {self.radius} m"
            )
        require_tension("membrane", self.tension)

    @property
    def geometry(self) -> Sheet:
        """Surface of the membrane, and places on it by name."""
        return Sheet(Disk(self.radius, self.hole), self.thickness)

    def vibration(self, material: Material, highest: float) -> Vibration:
        """Compute all modes up to a frequency.

        Parameters
        ----------
        material : Material
            Material of the body.
        highest : float
            Upper limit of the frequencies, Hz.

        Returns
        -------
        Vibration
            Frequencies and shapes of the modes.
        """
        disk = Disk(self.radius, self.hole)
        return _round_membrane(disk, self.thickness, self.tension, material, highest)


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class CircularMembrane(Shape):
    """A taut disk around the origin, held at its edge.

    Parameters
    ----------
    radius : float
        Radius, m.
    thickness : float
        Thickness, m.
    tension : float
        Tension, N/m, equal in all directions.

    Raises
    ------
    OptionError
        If lengths or the tension are not positive.

    Notes
    -----
    f_mk = c j_mk / (2 pi radius) with c^2 = tension / (density thickness) and the zeros j_mk of the
    Bessel function J_m; with m > 0 nodal diameters each comes twice, as cosine and sine of m times
    the angle (Morse 1948, section 19; 1998, section 6). `struck.radiation.add_air_mass` adds the
    load of air.

    Places, at y = 0: "middle" (also "top"), "quarter" of the diameter, "edge" (also "rim") 1 % off.

    Examples
    --------
    >>> drum = CircularMembrane(radius=0.16, thickness=0.0005, tension=2000.0)
    >>> skin = Material(density=1300.0, youngs_modulus=3.5e9, poisson_ratio=0.4)
    >>> drum.vibration(skin, 300.0).frequencies.round(2)
    array([132.69, 211.42, 211.42, 283.37, 283.37])
    """

    radius: float
    thickness: float
    tension: float

    tensioned: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_length("radius of the membrane", self.radius)
        require_length("thickness of the membrane", self.thickness)
        require_tension("membrane", self.tension)

    @property
    def geometry(self) -> Sheet:
        """Surface of the membrane, and places on it by name."""
        return Sheet(Disk(self.radius), self.thickness)

    def vibration(self, material: Material, highest: float) -> Vibration:
        """Compute all modes up to a frequency.

        Parameters
        ----------
        material : Material
            Material of the body.
        highest : float
            Upper limit of the frequencies, Hz.

        Returns
        -------
        Vibration
            Frequencies and shapes of the modes.
        """
        disk = Disk(self.radius)
        return _round_membrane(disk, self.thickness, self.tension, material, highest)

"""Solutions of the Helmholtz equation in a polygon, and mode shapes made of them.

Fourier-Bessel functions J_nu(k r) sin(nu theta) about corners, nu a multiple of pi / angle, vanish
along both edges of their corner and have its singularity (Fox, Henrici & Moler 1967); fundamental
solutions Y_0(k r) about points outside make up what is smooth (Barnett & Betcke 2008).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import y1

from struck.shapes.bessel_tables import irregular, regular
from struck.shapes.polygon import Plan, plan_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_PLACES_AT_ONCE = 2048


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Basis:
    """Which solutions are summed.

    Parameters
    ----------
    plan : Plan
    centres : array (S,)
        Corners with Fourier-Bessel functions.
    counts : array (S,)
        How many about each.
    sources : array (C, 2)
        Centres of fundamental solutions, m.
    highest : float
        Wavenumber up to which the functions are needed, 1/m.
    """

    plan: Plan
    centres: Index
    counts: Index
    sources: Array
    highest: float

    @property
    def size(self) -> int:
        """How many functions there are, F."""
        return int(self.counts.sum()) + len(self.sources)

    @property
    def steepest(self) -> float:
        """How far the orders exceed those of waves."""
        plan = self.plan
        orders = self.counts * plan.powers[self.centres]
        return float(np.max(orders - self.highest * plan.reaches[self.centres], initial=0.0))

    def sight(self, points: Array, ears: Index) -> Sight:
        """Return what the functions need to know of points (K, 2) in ears (K,) of the plan."""
        fans = []
        for centre, count in zip(self.centres.tolist(), self.counts.tolist(), strict=True):
            radii, angles = self.plan.polar(centre, points, ears)
            reach, power = float(self.plan.reaches[centre]), float(self.plan.powers[centre])
            turn = (radii / reach) ** power * np.exp(1j * power * angles)
            # By repeated products: errors stay far below those of the sines of large numbers.
            waves = np.cumprod(np.repeat(turn[:, None], count, axis=1), axis=1)
            fans.append(
                _Fan(
                    apart=points - self.plan.corners[centre],
                    radii=radii,
                    sines=np.ascontiguousarray(waves.imag, dtype=np.float64),
                    cosines=np.ascontiguousarray(waves.real, dtype=np.float64),
                    orders=power * np.arange(1, count + 1, dtype=np.float64),
                    table=regular(power, count, int(self.highest * reach) + 2),
                )
            )
        return Sight(fans=tuple(fans), apart=points[:, None] - self.sources)


class Sight:
    """The functions of a basis at some points, for any wavenumber."""

    def __init__(self, fans: tuple[_Fan, ...], apart: Array) -> None:
        self._fans = fans
        self._apart = apart
        self._distances = np.linalg.norm(apart, axis=2)
        self._logarithms = np.log(self._distances / 2)

    def columns(self, wavenumber: float) -> Array:
        """Return the functions at the points: (K, F)."""
        parts = [fan.columns(wavenumber) for fan in self._fans]
        if self._distances.shape[1]:
            parts.append(self._irregular(wavenumber))
        return np.hstack(parts)

    def sums(self, wavenumber: float, coefficients: Array) -> Array:
        """Return sums of the functions with coefficients (F, m) at the points: (K, m)."""
        total = np.zeros((len(self._distances), coefficients.shape[1]))
        start = 0
        for fan in self._fans:
            stop = start + len(fan.orders)
            total += fan.columns(wavenumber) @ coefficients[start:stop]
            start = stop
        if self._distances.shape[1]:
            total += self._irregular(wavenumber) @ coefficients[start:]
        return total

    def slopes(self, wavenumber: float, directions: Array) -> Array:
        """Return the functions' slopes along directions (K, 2): (K, F), 1/m."""
        parts = [fan.slopes(wavenumber, directions) for fan in self._fans]
        if self._distances.shape[1]:
            towards = np.einsum("ksi,ki->ks", self._apart, directions) / self._distances
            parts.append(-wavenumber * y1(wavenumber * self._distances) * towards)
        return np.hstack(parts)

    def _irregular(self, wavenumber: float) -> Array:
        from struck.shapes.bessel_kernels import pair

        arguments = wavenumber * self._distances
        even = pair(arguments, irregular(int(arguments.max()) + 1))
        return 2 / np.pi * (self._logarithms + np.log(wavenumber)) * even[0] + even[1]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fan:
    """Fourier-Bessel functions about one corner at some points: (r / reach)^nu sin(nu theta)."""

    apart: Array
    radii: Array
    sines: Array
    cosines: Array
    orders: Array
    table: Array

    def columns(self, wavenumber: float) -> Array:
        from struck.shapes.bessel_kernels import series

        return self.sines * series(wavenumber * self.radii, self.table)

    def slopes(self, wavenumber: float, directions: Array) -> Array:
        from struck.shapes.bessel_kernels import series, series_slope

        outward = self.apart / self.radii[:, None]
        along = np.sum(outward * directions, axis=1)[:, None]
        around = (outward[:, 0] * directions[:, 1] - outward[:, 1] * directions[:, 0])[:, None]
        value = series(wavenumber * self.radii, self.table)
        rise = wavenumber * series_slope(wavenumber * self.radii, self.table)
        swirl = self.orders / self.radii[:, None] * value
        radial = swirl * self.sines + rise * self.sines
        return along * radial + around * swirl * self.cosines


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PolygonForms:
    """Mode shapes of a membrane held along a polygon: sums of Helmholtz solutions.

    Parameters
    ----------
    corners : array (n, 2)
        Of the polygon, counter-clockwise, m.
    centres : array (S,)
        Corners with Fourier-Bessel functions.
    counts : array (S,)
        How many about each.
    sources : array (C, 2)
        Centres of fundamental solutions outside, m.
    wavenumbers : array (M,)
        1/m.
    coefficients : array (M, F)
        Of all functions.
    """

    corners: Array
    centres: Index
    counts: Index
    sources: Array
    wavenumbers: Array
    coefficients: Array

    @property
    def dimensions(self) -> int:
        """How many coordinates a place in the plan has: x and y."""
        return 2

    def values(self, places: Array) -> Array:
        """Return the shapes at places (K, 2), m; those outside count as on the nearest edge."""
        basis = Basis(
            plan=plan_of(self.corners),
            centres=self.centres,
            counts=self.counts,
            sources=self.sources,
            highest=float(self.wavenumbers.max(initial=0.0)),
        )
        places = np.asarray(places, dtype=np.float64)
        found = np.empty((len(places), len(self.wavenumbers)))
        for start in range(0, len(places), _PLACES_AT_ONCE):
            part = slice(start, start + _PLACES_AT_ONCE)
            sight = basis.sight(*basis.plan.located(places[part]))
            for mode, wavenumber in enumerate(self.wavenumbers.tolist()):
                found[part, mode] = sight.sums(wavenumber, self.coefficients[[mode]].T)[:, 0]
        return found

    def chosen(self, modes: Index) -> PolygonForms:
        """Return the shapes of some modes, in that order."""
        return replace(
            self,
            wavenumbers=self.wavenumbers[modes],
            coefficients=self.coefficients[modes],
        )

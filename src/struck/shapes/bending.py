"""Bending modes of a uniform beam: frequencies, shapes, and what shear has to do with them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from struck.shapes.beam import families
from struck.shapes.standing_waves import Beam, Waves, level, rising

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BendingForms:
    """Deflections along a bar: two standing waves each, even and odd about an origin.

    Parameters
    ----------
    length : float
        m.
    origin, span : float
        Of u, and how far it reaches from there, in lengths.
    first : array (M,)
        Wave numbers a of cos(a u) and sin(a u), in units of 1 / length.
    second : array (M,)
        Signed squares b^2 of those of cosh(b u) and sinh(b u), below 0 where that wave travels.
    amplitudes : array (M, 4)
        Of cos(a u), cosh(b u) / cosh(b span), sin(a u), and sinh(b u) / (b cosh(b span)).
    """

    length: float
    origin: float
    span: float
    first: Array
    second: Array
    amplitudes: Array

    @property
    def dimensions(self) -> int:
        """One: x."""
        return 1

    def values(self, places: Array) -> Array:
        """Return the deflections at x in m (K, 1): (K, M)."""
        u = np.clip(np.asarray(places)[:, :1] / self.length, 0.0, 1.0) - self.origin
        functions = (
            lambda some: np.cos(u * self.first[some]),
            lambda some: level(self.second[some], self.span, u),
            lambda some: np.sin(u * self.first[some]),
            lambda some: rising(self.second[some], self.span, u),
        )
        values = np.zeros((len(u), len(self.first)))
        for amplitudes, function in zip(self.amplitudes.T, functions, strict=True):
            # Even and odd modes need half of the functions each.
            some = np.flatnonzero(amplitudes)
            values[:, some] += amplitudes[some] * function(some)
        return values

    def chosen(self, modes: Index) -> Self:
        """Return the deflections of some modes, in that order."""
        return replace(
            self,
            first=self.first[modes],
            second=self.second[modes],
            amplitudes=self.amplitudes[modes],
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bending:
    """Modes of a beam.

    Parameters
    ----------
    squared : array (M,)
        Squared frequencies, ascending, in units of E I / (rho A L^4).
    forms : BendingForms
        Normalised to the kinetic energy of a rigid motion by 1, all along and turning included.
    shear_shares : array (M,)
        Potential energy of shear over all potential energy.
    """

    squared: Array
    forms: BendingForms
    shear_shares: Array


def bending(beam: Beam, ends: tuple[str, str], highest: float, length: float) -> Bending:
    """Return all elastic modes with squared frequencies up to `highest`.

    Parameters
    ----------
    beam : Beam
        At least as long as its radius of gyration.
    ends : pair of str
        Of `ENDS`, at x = 0 and at x = length.
    highest : float
        Squared frequency in units of E I / (rho A L^4).
    length : float
        m.
    """
    origin, kinds = families(ends)
    found = [family.frequencies(beam, highest) for family in kinds]
    squared = np.concatenate([one for one, _ in found])
    order = np.argsort(squared, kind="stable")
    waves = Waves.at(beam, squared[order], kinds[0].span)
    amplitudes = np.concatenate([one for _, one in found])[order]
    amplitudes, shares = _normalised(waves, amplitudes)
    forms = BendingForms(
        length=length,
        origin=origin,
        span=waves.span,
        first=waves.first,
        second=waves.second,
        amplitudes=_deflections(waves, amplitudes),
    )
    return Bending(squared=waves.squared, forms=forms, shear_shares=shares)


def _normalised(waves: Waves, amplitudes: Array) -> tuple[Array, Array]:
    """Return amplitudes of modes with unit kinetic energy, and their shares of shear energy."""
    even, odd = amplitudes[:, :2], amplitudes[:, 2:]
    first, second = (part[:, None] for part in waves.turnings)
    one, ratio = np.ones_like(first), waves.ratio[:, None]
    along, across = waves.products()

    def mean_square(at_even: Array, at_odd: Array) -> Array:
        return _quadratic(along, at_even) + _quadratic(across, at_odd)

    deflection = mean_square(even, odd * np.hstack([one, ratio]))
    turning = mean_square(odd * np.hstack([first, second]), even * np.hstack([-first, second]))
    force = mean_square(odd * np.hstack([one, -one]), even)
    beam, wave = waves.beam, waves.first**2
    energy = deflection + beam.rotary * wave * turning
    shares = beam.shear * waves.squared / wave * force / energy
    return amplitudes / np.sqrt(energy)[:, None], shares


def _quadratic(products: Array, amplitudes: Array) -> Array:
    return np.einsum("mi,mij,mj->m", amplitudes, products, amplitudes)


def _deflections(waves: Waves, amplitudes: Array) -> Array:
    """Return amplitudes of cos(a u), cosh(b u), sin(a u) and sinh(b u) / b."""
    scales = np.ones_like(amplitudes)
    scales[:, 3] = waves.ratio * waves.first
    return amplitudes * scales

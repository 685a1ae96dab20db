"""Strings: taut, and as stiff as they are."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Self

import numpy as np

from struck.model.arrays import Array, Index, checked, require_number
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.shapes.shape import Shape, Vibration, require_count
from struck.shapes.skins import Rod, sleeve
from struck.solids.resolution import require_length

_VERTEX_COUNT = 12
_ROUNDING = 1e-14


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StringForms:
    """Deflections of a string: sqrt(2) sin(n pi x / length)."""

    length: float  # m
    numbers: Index  # (M,), half waves n
    dimensions = 1  # coordinates of a place: x

    def values(self, places: Array) -> Array:
        """Return the deflections at x in m (K, 1): (K, M)."""
        x = np.clip(np.asarray(places)[:, :1] / self.length, 0.0, 1.0)
        return math.sqrt(2) * np.sin(np.pi * x * self.numbers)

    def chosen(self, modes: Index) -> Self:
        """Return the deflections of some modes, in that order."""
        return replace(self, numbers=self.numbers[modes])


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class String(Shape):
    """A round string along x, held at both ends, that moves along z.

    Parameters
    ----------
    length : float
        Length, m.
    radius : float
        Radius, m.
    tension : float
        Tension, N.
    stiff : bool, default False
        Whether it resists bending; its ends are hinged then.

    Raises
    ------
    OptionError
        If lengths or the tension are not positive.

    Notes
    -----
    f_n = n f_1 sqrt(1 + B n^2) with f_1 = sqrt(tension / (rho A)) / (2 length) and
    B = pi^2 E I / (tension length^2); B = 0 without stiffness, and the spectrum is harmonic (1998,
    section 6; Morse 1948, chapters III and IV; Fletcher 1964). The theory of Euler and Bernoulli
    for the bending.

    Places: "middle" (also "top"), "quarter" of the length, "end" 1 % off x = length.

    Examples
    --------
    >>> string = String(length=0.65, radius=0.0005, tension=70.0)
    >>> steel = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.29)
    >>> string.vibration(steel, 300.0).frequencies.round(2)
    array([ 81.96, 163.93, 245.89])
    """

    length: float
    radius: float
    tension: float
    stiff: bool = False

    tensioned: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_length("length of the string", self.length)
        require_length("radius of the string", self.radius)
        require_number(
            "tension of the string", self.tension, above=True, hint="it must exceed 0", unit=" N"
        )

    @property
    def geometry(self) -> Rod:
        """Surface of the string, and places on it by name."""
        return Rod(
            length=self.length,
            area=math.pi * self.radius**2,
            height=2 * self.radius,
            mantle=partial(_skin, self.radius),
        )

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
        fundamental = self._fundamental(material)
        inharmonicity = self._inharmonicity(material)
        # Stiffness only raises frequencies: no more modes than harmonics lie below.
        require_count("string", highest / fundamental, highest)
        numbers = np.arange(1, int(highest / fundamental) + 1)
        frequencies = fundamental * np.sqrt(1 + inharmonicity * numbers**2.0) * numbers
        in_band = frequencies <= highest
        count = np.count_nonzero(in_band)
        return Vibration(
            frequencies=frequencies[in_band],
            forms=StringForms(length=self.length, numbers=numbers[in_band]),
            # Slopes cannot tell what stiffness and tension each do: then another wire is refused.
            poisson_slopes=np.full(count, np.nan if self.stiff else 0.0),
            errors=np.full(count, _ROUNDING),
            half_wave=self.length / max(count, 1),
            method=f"{'stiff' if self.stiff else 'ideal'} string",
            references=("morse1948", *(("fletcher1964",) if self.stiff else ())),
            details={"inharmonicity": inharmonicity},
        )

    def _fundamental(self, material: Material) -> float:
        """Return the lowest frequency that tension alone makes, Hz."""
        area = math.pi * self.radius**2
        return math.sqrt(self.tension / (material.density * area)) / (2 * self.length)

    def _inharmonicity(self, material: Material) -> float:
        """Return the inharmonicity B of a stiff string."""
        if not self.stiff:
            return 0.0
        second_moment = math.pi / 4 * self.radius**4
        bending = math.pi**2 * material.youngs_modulus * second_moment
        return bending / (self.tension * self.length**2)


def _skin(radius: float, length: float, spacing: float) -> Mesh:
    return sleeve(length, radius, 0.0, spacing, vertex_count=_VERTEX_COUNT)

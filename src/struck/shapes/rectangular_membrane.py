"""Rectangular membranes (1998, section 2)."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np

from struck.model.arrays import Array, Index, checked
from struck.model.material import Material
from struck.shapes.shape import Shape, Vibration, require_countable, require_tension
from struck.shapes.skins import Rectangle, Sheet
from struck.solids.resolution import require_length

_ROUNDING = 1e-14


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SineForms:
    """Forms of a rectangle that is held all around: 2 sin(i pi x / length) sin(j pi y / width)."""

    length: float  # m
    width: float  # m
    along: Index  # (M,), half waves i
    across: Index  # (M,), half waves j
    dimensions = 2  # coordinates of a place: x and y

    def values(self, places: Array) -> Array:
        """Return the forms at places (K, 2), m: (K, M). Beyond an edge: as on it."""
        x, y = np.asarray(places, dtype=np.float64)[:, :2].T
        return 2 * _sines(x / self.length, self.along) * _sines(y / self.width, self.across)

    def chosen(self, modes: Index) -> Self:
        """Return the forms of some modes, in that order."""
        return replace(self, along=self.along[modes], across=self.across[modes])


def _sines(positions: Array, half_waves: Index) -> Array:
    """Return sin(n pi x) for each place and mode (K, M), computed once for each n."""
    numbers, back = np.unique(half_waves, return_inverse=True)
    return np.sin(np.pi * np.clip(positions, 0, 1)[:, None] * numbers)[:, back]


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class RectangularMembrane(Shape):
    """A taut rectangle, held at its edges x = 0, x = length, y = 0 and y = width.

    Parameters
    ----------
    length : float
        Length along x, m.
    width : float
        Width along y, m.
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
    f_ij = c / 2 [(i / length)^2 + (j / width)^2]^(1/2) with c^2 = tension / (density thickness)
    (1998, section 2; Morse 1948, section 18).

    Places: "middle" (also "top"), "quarter" of both lengths, "edge" 1 % off x = length, "corner"
    1 % off both far edges.

    Examples
    --------
    >>> drum = RectangularMembrane(length=0.3, width=0.3, thickness=0.0005, tension=2000.0)
    >>> skin = Material(density=1300.0, youngs_modulus=3.5e9, poisson_ratio=0.4)
    >>> drum.vibration(skin, 300.0).frequencies.round(2)
    array([130.74, 206.72, 206.72, 261.49, 292.35, 292.35])
    """

    length: float
    width: float
    thickness: float
    tension: float

    tensioned: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name in ("length", "width", "thickness"):
            require_length(f"{name} of the membrane", getattr(self, name))
        require_tension("membrane", self.tension)

    @property
    def geometry(self) -> Sheet:
        """Surface of the membrane, and places on it by name."""
        return Sheet(Rectangle(self.length, self.width), self.thickness)

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
        speed = math.sqrt(self.tension / (material.density * self.thickness))
        area, wavenumber = self.length * self.width, 2 * math.pi * highest / speed
        require_countable("membrane", area, wavenumber, highest)
        along, across, frequencies = self._grid(speed, highest)
        return Vibration(
            frequencies=frequencies,
            forms=SineForms(length=self.length, width=self.width, along=along, across=across),
            poisson_slopes=np.zeros(len(frequencies)),
            errors=np.full(len(frequencies), _ROUNDING),
            half_wave=float(
                min(self.length / along.max(initial=1), self.width / across.max(initial=1))
            ),
            method="rectangular membrane: products of sines",
            references=("morse1948",),
            details={"speed of waves": speed},
        )

    def _grid(self, speed: float, highest: float) -> tuple[Index, Index, Array]:
        """Return half waves along and across and frequencies, ascending, up to `highest`."""
        max_counts = [int(2 * side * highest / speed) for side in (self.length, self.width)]
        i, j = np.meshgrid(*(np.arange(1, n + 1) for n in max_counts), indexing="ij")
        frequencies = speed / 2 * np.sqrt((i / self.length) ** 2 + (j / self.width) ** 2)
        order = np.lexsort((j.ravel(), i.ravel(), frequencies.ravel()))
        order = order[frequencies.ravel()[order] <= highest]
        return i.ravel()[order], j.ravel()[order], frequencies.ravel()[order]

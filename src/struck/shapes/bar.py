"""Bars that bend: by Timoshenko's theory, or by that of Euler and Bernoulli."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, cast

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.shapes.beam import ENDS
from struck.shapes.bending import Bending, bending
from struck.shapes.counterpart import Counterpart, require_clamped_or_free
from struck.shapes.lengths import places_along
from struck.shapes.sections import RectangularSection, Section
from struck.shapes.shape import Shape, Vibration
from struck.shapes.standing_waves import Beam
from struck.solids.resolution import require_length

Array = NDArray[np.float64]

THEORIES = {
    "timoshenko": ("Timoshenko's theory", ("timoshenko1921", "cowper1966")),
    "euler-bernoulli": ("the theory of Euler and Bernoulli", ()),
}
# What rounding leaves: roots agree with those in forty digits to 2e-15, bare numbers among them.
_ROUNDING = 1e-14


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar(Shape):
    """A straight bar along x that bends along z.

    Parameters
    ----------
    length : float
        m; at least the section's radius of gyration (0.29 times the thickness of a rectangle).
    width, thickness : float, optional
        Of a rectangular section along y and z, m: both, or neither and a `section`.
    section : Section, optional
        `RectangularSection`, `RoundSection` (rods and tubes) or `GivenSection`.
    ends : str or pair of str
        "free", "clamped", "hinged" or "sliding" (held from turning, not from moving along z):
        one for both ends, or those at x = 0 and at x = length.
    theory : str
        "timoshenko" takes in that sections slip in shear and are heavy to turn;
        "euler-bernoulli" leaves both out, as 1998 does, and holds for slender bars alone.

    Raises
    ------
    OptionError
        On lengths that are not positive, a bar shorter than its radius of gyration, two sections
        or none, unknown ends or an unknown theory.

    Notes
    -----
    E I w'''' + rho A w.. = 0 (1998, eq. 14 with the clamped ends), or Timoshenko's (1921) pair for
    the deflection w and the turning t of sections, kappa by Cowper (1966):
    kappa G A (w' - t)' = rho A w.., E I t'' + kappa G A (w' - t) = rho I t... Both are solved
    exactly, beyond the critical frequency sqrt(kappa G A / (rho I)) too, where waves of shear
    travel. Rigid motions are left out.

    The forms are the deflections w. Their mean square over the mass falls short of 1 by the share
    of the kinetic energy that is in turning: each mode has, with it, the kinetic energy of a rigid
    motion by 1. One mode of a bar with two hinged ends, at the critical frequency, has no
    deflection at all.

    Examples
    --------
    >>> bar = Bar(length=0.3, width=0.03, thickness=0.005)
    >>> steel = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.29)
    >>> bar.vibration(steel, 5000.0).frequencies.round(1)
    array([ 288. ,  792.3, 1549. , 2551.3, 3794.2])
    """

    length: float
    width: float | None = None
    thickness: float | None = None
    section: Section | None = None
    ends: str | tuple[str, str] = "free"
    theory: str = "timoshenko"

    coordinates: ClassVar[tuple[str, ...]] = ("x (m)",)

    def __post_init__(self) -> None:
        require_length("length of the bar", self.length)
        self._require_one_section()
        if self._gyration > self.length:
            raise OptionError(
                f"length of the bar is {self.length} m: at least its radius of gyration, "
                f"{self._gyration:.4g} m; take a Block or Tube of struck.solids"
            )
        one = isinstance(self.ends, str)
        if (not one and len(self.ends) != 2) or not set(self.pair) <= set(ENDS):
            raise OptionError(f"ends are {self.ends!r}: give one or two of {', '.join(ENDS)}")
        if self.theory not in THEORIES:
            raise OptionError(f"theory is {self.theory!r}: give one of {', '.join(THEORIES)}")

    def _require_one_section(self) -> None:
        lengths = (self.width, self.thickness)
        if self.section is None:
            if None in lengths:
                raise OptionError(
                    f"width and thickness are {self.width} and {self.thickness}: give both in m, "
                    "or a section"
                )
        elif lengths != (None, None):
            raise OptionError(
                f"width, thickness and section are {self.width}, {self.thickness} and "
                f"{self.section}: give width and thickness, or a section"
            )

    @property
    def profile(self) -> Section:
        """Its section."""
        if self.section is not None:
            return self.section
        return RectangularSection(
            width=cast("float", self.width), thickness=cast("float", self.thickness)
        )

    @property
    def pair(self) -> tuple[str, str]:
        """What holds it at x = 0 and at x = length."""
        near, far = (self.ends, self.ends) if isinstance(self.ends, str) else self.ends
        return near, far

    @property
    def supported(self) -> bool:
        """Whether an end is held."""
        return self.pair != ("free", "free")

    @property
    def tensioned(self) -> bool:
        """False: its stiffness drives it back."""
        return False

    @property
    def volume(self) -> float:
        """m^3."""
        return self.profile.area * self.length

    @property
    def extent(self) -> float:
        """Length, m."""
        return self.length

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts on the top: "middle" (also "top"), "quarter", "end" 1 % off x = length."""
        return places_along(self.length, self.profile.height)

    def vibration(self, material: Material, highest: float) -> Vibration:
        """Return every bending mode along z up to `highest` Hz."""
        unit = self._unit(material)
        modes = bending(self._beam(material), self.pair, (highest / unit) ** 2, self.length)
        about, references = THEORIES[self.theory]
        return Vibration(
            frequencies=np.sqrt(modes.squared) * unit,
            forms=modes.forms,
            poisson_slopes=self._poisson_slopes(material, modes),
            errors=np.full(len(modes.squared), _ROUNDING),
            half_wave=self.length * float(np.pi / modes.forms.first.max(initial=np.pi)),
            method=f"bending of a bar, ends {' and '.join(self.pair)}, by {about}",
            references=references,
            details=self._details(material),
        )

    def skin(self, spacing: float) -> Mesh:
        """Return its closed surface with vertices about `spacing` m apart along x."""
        return self.profile.skin(self.length, spacing)

    def solid(self) -> Counterpart:
        """Return the block or tube it stands for, in this frame.

        Raises
        ------
        OptionError
            On hinged or sliding ends, or a given section.
        """
        require_clamped_or_free("bar", self.pair)
        solid, turn = self.profile.solid(self.length)
        held = zip(self.pair, (0.0, self.length), strict=True)
        return Counterpart(
            solid=solid,
            turn=turn,
            offset=(self.length / 2, 0.0, 0.0),
            ends=tuple((0, place) for end, place in held if end == "clamped"),
        )

    @property
    def _gyration(self) -> float:
        """Radius of gyration of the section, m."""
        return math.sqrt(self.profile.second_moment / self.profile.area)

    def _unit(self, material: Material) -> float:
        """Return sqrt(E I / (rho A)) / (2 pi length^2), Hz."""
        speed = math.sqrt(material.youngs_modulus / material.density)
        return speed * self._gyration / (2 * math.pi * self.length**2)

    def _beam(self, material: Material) -> Beam:
        if self.theory == "euler-bernoulli":
            return Beam(rotary=0.0, shear=0.0)
        rotary = (self._gyration / self.length) ** 2
        # E / (kappa G), for E = 2 (1 + nu) G.
        return Beam(rotary=rotary, shear=2 * self._shear_sum(material) * rotary)

    def _shear_sum(self, material: Material) -> float:
        """Return (1 + nu) / kappa."""
        constant, linear = self.profile.shear_terms
        return constant + linear * material.poisson_ratio

    def _poisson_slopes(self, material: Material, modes: Bending) -> Array:
        """Return d ln f / d nu: the energy's, as modes do not change to first order (Rayleigh)."""
        _, linear = self.profile.shear_terms
        return -modes.shear_shares / 2 * linear / self._shear_sum(material)

    def _details(self, material: Material) -> Mapping[str, object]:
        if self.theory == "euler-bernoulli":
            return {}
        beam = self._beam(material)
        return {
            "shear coefficient": (1 + material.poisson_ratio) / self._shear_sum(material),
            "critical frequency (Hz)": self._unit(material) / math.sqrt(beam.rotary * beam.shear),
        }

"""Bars that bend along z, by Timoshenko's theory or by that of Euler and Bernoulli.

Their sections are symmetric about y and z; shear coefficients are (1 + nu) / (p + q nu) (Cowper).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import cast

import numpy as np

from struck.errors import OptionError, require_choice, rounded
from struck.model.arrays import Array, checked, require_number
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.shapes.beam import ENDS, Beam, Bending, bending
from struck.shapes.shape import (
    ALONG_X,
    UPRIGHT,
    Counterpart,
    Shape,
    Turn,
    Vibration,
    require_clamped_or_free,
)
from struck.shapes.skins import Rod, rectangle, slab, sleeve
from struck.solids import Block, Tube
from struck.solids.resolution import require_length


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class RectangularSection:
    """A solid rectangle.

    Parameters
    ----------
    width : float
        Width along y, m.
    thickness : float
        Thickness along z, the direction of bending, m.

    Raises
    ------
    OptionError
        On lengths that are not positive.

    Notes
    -----
    Shear coefficient 10 (1 + nu) / (12 + 11 nu): Cowper 1966.

    Examples
    --------
    >>> from struck.shapes import Bar, RectangularSection
    >>> bar = Bar(length=0.3, section=RectangularSection(width=0.03, thickness=0.005))
    >>> struck.analyze(bar, "steel", progress=None).frequencies[:2].round()
    array([288., 792.])
    """

    width: float
    thickness: float

    def __post_init__(self) -> None:
        require_length("width of the section", self.width)
        require_length("thickness of the section", self.thickness)

    @property
    def area(self) -> float:
        """Area of the section, m^2."""
        return self.width * self.thickness

    @property
    def second_moment(self) -> float:
        """Second moment of area about y, m^4."""
        return self.width * self.thickness**3 / 12

    @property
    def height(self) -> float:
        """Thickness of the section along the bending, m."""
        return self.thickness

    @property
    def shear_terms(self) -> tuple[float, float]:
        """Terms p and q of Cowper's shear coefficient (1 + nu) / (p + q nu)."""
        return 1.2, 1.1

    def skin(self, length: float, spacing: float) -> Mesh:
        """Return the surface of a bar along x.

        Parameters
        ----------
        length : float
            Length of the bar, m.
        spacing : float
            Approximate edge of the triangles, m.

        Returns
        -------
        Mesh
            The surface.
        """
        plan = rectangle(length, self.width, spacing, corner=(0.0, -self.width / 2))
        return slab(*plan, self.thickness)

    def solid(self, length: float) -> tuple[Block, Turn]:
        """Return the solid of a bar.

        Parameters
        ----------
        length : float
            Length of the bar, m.

        Returns
        -------
        tuple of Block, rotation (3, 3)
            The solid, and the rotation that puts it along x.
        """
        return Block(size=(length, self.width, self.thickness)), UPRIGHT


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class RoundSection:
    """A disc, or the ring of a tube.

    Parameters
    ----------
    radius : float
        Outer radius, m.
    wall : float, optional
        Wall thickness of a tube, m. Default: a solid rod.

    Raises
    ------
    OptionError
        On lengths that are not positive, or a wall thicker than the radius.

    Notes
    -----
    With m = bore / radius the shear coefficient is 6 (1 + nu) (1 + m^2)^2 /
    ((7 + 6 nu) (1 + m^2)^2 + (20 + 12 nu) m^2): Cowper 1966.

    Examples
    --------
    >>> from struck.shapes import Bar, RoundSection
    >>> chime = Bar(length=0.5, section=RoundSection(radius=0.0125, wall=0.001))
    >>> struck.analyze(chime, "aluminium", progress=None).frequencies[:2].round()
    array([ 615., 1644.])
    """

    radius: float
    wall: float | None = None

    def __post_init__(self) -> None:
        require_length("radius of the section", self.radius)
        if self.wall is None:
            return
        require_length("wall of the section", self.wall)
        if self.wall > self.radius:
            raise OptionError(
                f"wall of the section is {self.wall} m: at most its radius, {self.radius} m, fits "
                "(and makes a solid rod)"
            )

    @property
    def bore(self) -> float:
        """Inner radius, m; 0 for a solid rod."""
        return 0.0 if self.wall is None else self.radius - self.wall

    @property
    def area(self) -> float:
        """Area of the section, m^2."""
        return math.pi * (self.radius - self.bore) * (self.radius + self.bore)

    @property
    def second_moment(self) -> float:
        """Second moment of area about y, m^4."""
        return self.area * (self.radius**2 + self.bore**2) / 4

    @property
    def height(self) -> float:
        """Outer diameter of the section, m."""
        return 2 * self.radius

    @property
    def shear_terms(self) -> tuple[float, float]:
        """Terms p and q of Cowper's shear coefficient (1 + nu) / (p + q nu)."""
        squared_ratio = (self.bore / self.radius) ** 2
        term = squared_ratio / (1 + squared_ratio) ** 2
        return (7 + 20 * term) / 6, (6 + 12 * term) / 6

    def skin(self, length: float, spacing: float) -> Mesh:
        """Return the surface of a bar along x.

        Parameters
        ----------
        length : float
            Length of the bar, m.
        spacing : float
            Approximate edge of the triangles, m.

        Returns
        -------
        Mesh
            The surface.
        """
        return sleeve(length, self.radius, self.bore, spacing)

    def solid(self, length: float) -> tuple[Tube, Turn]:
        """Return the solid of a bar.

        Parameters
        ----------
        length : float
            Length of the bar, m.

        Returns
        -------
        tuple of Tube, rotation (3, 3)
            The solid, and the rotation that puts it along x.
        """
        return Tube(length=length, radius=self.radius, wall=self.wall or self.radius), ALONG_X


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class GivenSection:
    """Any section, symmetric about y and z, by its constants.

    Parameters
    ----------
    area : float
        Area, m^2.
    second_moment : float
        Second moment of area about y, m^4.
    shear_coefficient : float
        Mean shear stress over shear modulus times mean shear angle; above 0, at most 1, for any
        Poisson's ratio.

    Raises
    ------
    OptionError
        On constants outside their bounds.

    Notes
    -----
    It looks like the rectangle with the same area and second moment.

    Examples
    --------
    >>> from struck.shapes import Bar, GivenSection
    >>> section = GivenSection(area=1.5e-4, second_moment=3.125e-10, shear_coefficient=0.85)
    >>> bar = Bar(length=0.3, section=section)
    >>> struck.analyze(bar, "steel", progress=None).frequencies[:2].round()
    array([288., 792.])
    """

    area: float
    second_moment: float
    shear_coefficient: float

    def __post_init__(self) -> None:
        for name, unit in (("area", "m^2"), ("second_moment", "m^4")):
            hint, value = "it must exceed 0, and 1e-36 is the least", getattr(self, name)
            label = f"{name} of the section"
            require_number(label, value, 1e-36, 1e24, hint=hint, unit=f" {unit}")
        if not 0 < self.shear_coefficient <= 1:
            raise OptionError(
                f"shear_coefficient is {self.shear_coefficient}: it must lie above 0 and at most "
                "at 1 (5/6 for a rectangle, 1/2 for a thin tube)"
            )

    @property
    def height(self) -> float:
        """Thickness of the rectangle with the same area and second moment, m."""
        return math.sqrt(12 * self.second_moment / self.area)

    @property
    def shear_terms(self) -> tuple[float, float]:
        """Terms p and q of a shear coefficient (1 + nu) / (p + q nu) that is constant."""
        return 1 / self.shear_coefficient, 1 / self.shear_coefficient

    def skin(self, length: float, spacing: float) -> Mesh:
        """Return the surface of an equivalent rectangular bar along x.

        Parameters
        ----------
        length : float
            Length of the bar, m.
        spacing : float
            Approximate edge of the triangles, m.

        Returns
        -------
        Mesh
            The surface.
        """
        equal_section = RectangularSection(width=self.area / self.height, thickness=self.height)
        return equal_section.skin(length, spacing)

    def solid(self, length: float) -> tuple[Block, Turn]:
        """Raise an error: constants alone do not define a solid.

        Parameters
        ----------
        length : float
            Length of the bar, m.

        Raises
        ------
        OptionError
            Always.
        """
        raise OptionError(
            f"a bar of {length} m with a GivenSection has no cross-section to mesh: give a "
            "RectangularSection or RoundSection, or take method='formula'"
        )


Section = RectangularSection | RoundSection | GivenSection

THEORIES = {
    "timoshenko": ("Timoshenko's theory", ("timoshenko1921", "cowper1966")),
    "euler-bernoulli": ("the theory of Euler and Bernoulli", ()),
}
# Roots agree with those in forty digits to 2e-15.
_ROUNDING = 1e-14
_MIN_SLENDERNESS = 5.0  # length over the wider side of the section from which a bar is slender


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Bar(Shape):
    """A straight bar along x that bends along z.

    Parameters
    ----------
    length : float
        Length, m; at least the radius of gyration of the section (0.29 times the thickness of a
        rectangle).
    width : float, optional
        Width of a rectangular section along y, m. Default: that of `section`.
    thickness : float, optional
        Thickness of a rectangular section along z, m. Default: that of `section`.
    section : Section, optional
        Instead of width and thickness: `RectangularSection`, `RoundSection` (rods and tubes) or
        `GivenSection`.
    ends : str or pair of str, default "free"
        "free", "clamped", "hinged" or "sliding" (cannot rotate, but moves along z): for both ends,
        or those at x = 0 and at x = length.
    theory : {"timoshenko", "euler-bernoulli"}, default "timoshenko"
        "timoshenko" includes shear and rotary inertia; "euler-bernoulli" omits both, as 1998 does,
        and holds only for slender bars.

    Raises
    ------
    OptionError
        If lengths are not positive, the bar is shorter than its radius of gyration, there are two
        sections or none, or the ends or the theory are unknown.

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

    Places: "middle" (also "top"), "quarter" of the length, "end" 1 % off x = length.

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

    def __post_init__(self) -> None:
        require_length("length of the bar", self.length)
        self._require_one_section()
        if self._gyration > self.length:
            raise OptionError(
                f"length of the bar is {self.length} m: at least its radius of gyration, "
                f"{rounded(self._gyration, 4)} m; take a Block or Tube of struck.solids"
            )
        if not isinstance(self.ends, str) and len(self.ends) != 2:
            raise OptionError(
                f"ends are {','.join(map(str, self.ends))}: give one or two of {', '.join(ENDS)}"
            )
        for end in self.pair:
            require_choice("ends", end, ENDS, more=", or two of them")
        require_choice("theory", self.theory, THEORIES)

    def _require_one_section(self) -> None:
        lengths = (self.width, self.thickness)
        if self.section is None:
            if None in lengths:
                raise OptionError(
                    f"width is {self.width} and thickness is {self.thickness}: give both in m, "
                    "or a section"
                )
        elif lengths != (None, None):
            raise OptionError(
                f"width, thickness and section are {self.width}, {self.thickness} and "
                f"{self.section}: give width and thickness, or a section"
            )

    @property
    def profile(self) -> Section:
        """Cross-section of the bar."""
        if self.section is not None:
            return self.section
        return RectangularSection(
            width=cast("float", self.width), thickness=cast("float", self.thickness)
        )

    @property
    def pair(self) -> tuple[str, str]:
        """Supports of the bar at x = 0 and at x = length."""
        start, end = (self.ends, self.ends) if isinstance(self.ends, str) else self.ends
        return start, end

    @property
    def supported(self) -> bool:
        """Whether an end of the bar is held."""
        return self.pair != ("free", "free")

    @property
    def geometry(self) -> Rod:
        """Surface of the bar, and places on it by name."""
        section = self.profile
        return Rod(
            length=self.length, area=section.area, height=section.height, mantle=section.skin
        )

    def vibration(self, material: Material, highest: float) -> Vibration:
        """Compute all bending modes along z up to a frequency.

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
        unit = self._unit(material)
        modes = bending(self._beam(material), self.pair, (highest / unit) ** 2, self.length)
        description, references = THEORIES[self.theory]
        return Vibration(
            frequencies=np.sqrt(modes.squared) * unit,
            forms=modes.forms,
            poisson_slopes=self._poisson_slopes(material, modes),
            errors=np.full(len(modes.squared), _ROUNDING),
            half_wave=self.length * float(np.pi / modes.forms.first.max(initial=np.pi)),
            method=f"bending of a bar, ends {' and '.join(self.pair)}, by {description}",
            references=references,
            details=self._details(material),
        )

    @property
    def playing_place(self) -> str | None:
        """Name of the place where it is struck by default: the end of a tube."""
        section = self.profile
        is_hollow = (
            isinstance(section, RoundSection) and (section.wall or math.inf) < section.radius
        )
        return "end" if is_hollow else None

    def solid(self) -> Counterpart:
        """Return the block or tube that the bar idealises, in this frame.

        Returns
        -------
        Counterpart
            The solid in the coordinates of the bar.

        Raises
        ------
        OptionError
            On hinged or sliding ends, or a given section.
        """
        require_clamped_or_free("bar", self.pair)
        solid, rotation = self.profile.solid(self.length)
        supports = zip(self.pair, (0.0, self.length), strict=True)
        return Counterpart(
            solid=solid,
            of="Bar",
            turn=rotation,
            offset=(self.length / 2, 0.0, 0.0),
            ends=tuple((0, place) for end, place in supports if end == "clamped"),
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
        """Return (1 + nu) / kappa of Timoshenko's shear correction kappa."""
        constant, linear = self.profile.shear_terms
        return constant + linear * material.poisson_ratio

    def _poisson_slopes(self, material: Material, modes: Bending) -> Array:
        """Return d ln f / d nu: the energy's, as modes do not change to first order (Rayleigh)."""
        _, linear = self.profile.shear_terms
        return -modes.shear_shares / 2 * linear / self._shear_sum(material)

    def _details(self, material: Material) -> Mapping[str, object]:
        section = self.profile
        details: dict[str, object] = {}
        slenderness = self.length / max(section.height, section.area / section.height)
        if slenderness < _MIN_SLENDERNESS:
            details["caution"] = (
                f"length is {rounded(slenderness, 2)} of the section's wider side, below "
                f"{_MIN_SLENDERNESS:g}: bars are taken as slender, and errors do not hold what "
                "that leaves out; with "
                "free or clamped ends finite elements, method='fem', take the whole body"
            )
        if self.theory == "euler-bernoulli":
            return details
        beam = self._beam(material)
        return details | {
            "shear coefficient": (1 + material.poisson_ratio) / self._shear_sum(material),
            "critical frequency (Hz)": self._unit(material) / math.sqrt(beam.rotary * beam.shear),
        }

"""Cross sections of bars: how heavy, how stiff in bending, how stiff in shear."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from struck.errors import OptionError
from struck.model.mesh import Mesh
from struck.shapes.counterpart import ALONG_X, UPRIGHT, Turn
from struck.shapes.skins import rectangle, slab
from struck.shapes.sleeves import sleeve
from struck.solids import Block, Tube
from struck.solids.resolution import require_length


class Section(Protocol):
    """A cross section, symmetric about y and z, that bends along z."""

    @property
    def area(self) -> float:
        """m^2."""
        ...

    @property
    def second_moment(self) -> float:
        """Second moment of area about y, m^4."""
        ...

    @property
    def height(self) -> float:
        """From bottom to top along z, m."""
        ...

    @property
    def shear_terms(self) -> tuple[float, float]:
        """Terms p and q of Cowper's shear coefficient (1 + nu) / (p + q nu)."""
        ...

    def skin(self, length: float, spacing: float) -> Mesh:
        """Return the closed surface of a bar along x from 0 to `length` m."""
        ...

    def solid(self, length: float) -> tuple[Block | Tube, Turn]:
        """Return the solid of a bar, and what turns it along x; OptionError where there is none."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class RectangularSection:
    """A solid rectangle.

    Parameters
    ----------
    width : float
        Along y, m.
    thickness : float
        Along z, the direction in which the bar bends, m.

    Raises
    ------
    OptionError
        On lengths that are not positive.

    Notes
    -----
    Shear coefficient 10 (1 + nu) / (12 + 11 nu): Cowper 1966.
    """

    width: float
    thickness: float

    def __post_init__(self) -> None:
        require_length("width of the section", self.width)
        require_length("thickness of the section", self.thickness)

    @property
    def area(self) -> float:
        """m^2."""
        return self.width * self.thickness

    @property
    def second_moment(self) -> float:
        """Second moment of area about y, m^4."""
        return self.width * self.thickness**3 / 12

    @property
    def height(self) -> float:
        """Thickness, m."""
        return self.thickness

    @property
    def shear_terms(self) -> tuple[float, float]:
        """Terms p and q of Cowper's shear coefficient (1 + nu) / (p + q nu)."""
        return 1.2, 1.1

    def skin(self, length: float, spacing: float) -> Mesh:
        """Return the closed surface of a bar along x from 0 to `length` m."""
        plan = rectangle(length, self.width, spacing, corner=(0.0, -self.width / 2))
        return slab(*plan, self.thickness)

    def solid(self, length: float) -> tuple[Block, Turn]:
        """Return the solid of a bar, and what turns it along x."""
        return Block(size=(length, self.width, self.thickness)), UPRIGHT


@dataclass(frozen=True, slots=True, kw_only=True)
class RoundSection:
    """A disc, or the ring of a tube.

    Parameters
    ----------
    radius : float
        Outer radius, m.
    wall : float, optional
        Thickness of a tube's wall, m; left out, or as thick as the radius: a solid rod.

    Raises
    ------
    OptionError
        On lengths that are not positive, or a wall thicker than the radius.

    Notes
    -----
    With m = bore / radius the shear coefficient is 6 (1 + nu) (1 + m^2)^2 /
    ((7 + 6 nu) (1 + m^2)^2 + (20 + 12 nu) m^2): Cowper 1966.
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
        """m^2."""
        return math.pi * (self.radius - self.bore) * (self.radius + self.bore)

    @property
    def second_moment(self) -> float:
        """Second moment of area about y, m^4."""
        return self.area * (self.radius**2 + self.bore**2) / 4

    @property
    def height(self) -> float:
        """Outer diameter, m."""
        return 2 * self.radius

    @property
    def shear_terms(self) -> tuple[float, float]:
        """Terms p and q of Cowper's shear coefficient (1 + nu) / (p + q nu)."""
        hollow = (self.bore / self.radius) ** 2
        share = hollow / (1 + hollow) ** 2
        return (7 + 20 * share) / 6, (6 + 12 * share) / 6

    def skin(self, length: float, spacing: float) -> Mesh:
        """Return the closed surface of a bar along x from 0 to `length` m."""
        return sleeve(length, self.radius, self.bore, spacing)

    def solid(self, length: float) -> tuple[Tube, Turn]:
        """Return the solid of a bar, and what turns it along x."""
        return Tube(length=length, radius=self.radius, wall=self.wall or self.radius), ALONG_X


@dataclass(frozen=True, slots=True, kw_only=True)
class GivenSection:
    """Any section, symmetric about y and z, by its constants.

    Parameters
    ----------
    area : float
        m^2.
    second_moment : float
        Second moment of area about y, m^4.
    shear_coefficient : float
        Mean shear stress over shear modulus times mean shear angle; above 0, at most 1. It is
        taken as it is, whatever Poisson's ratio.

    Raises
    ------
    OptionError
        On constants outside their bounds.

    Notes
    -----
    It looks like the rectangle with the same area and second moment.
    """

    area: float
    second_moment: float
    shear_coefficient: float

    def __post_init__(self) -> None:
        for name, unit in (("area", "m^2"), ("second_moment", "m^4")):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise OptionError(f"{name} of the section is {value} {unit}: it must exceed 0")
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
        """Return the closed surface of the rectangular bar that stands for it."""
        alike = RectangularSection(width=self.area / self.height, thickness=self.height)
        return alike.skin(length, spacing)

    def solid(self, length: float) -> tuple[Block, Turn]:
        """Refuse: constants alone are no body.

        Raises
        ------
        OptionError
            Always.
        """
        raise OptionError(
            f"a bar of {length} m with a GivenSection has no form of its own: give a "
            "RectangularSection or RoundSection, or take method='formula'"
        )

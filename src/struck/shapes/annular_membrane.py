"""Annular membranes: rings held at both edges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.shapes.disks import annulus, places_on_disk
from struck.shapes.plans import require_tension
from struck.shapes.round_membranes import round_membrane
from struck.shapes.shape import Shape, Vibration
from struck.shapes.skins import slab
from struck.solids.resolution import require_length

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class AnnularMembrane(Shape):
    """A taut ring around the origin, held at its outer edge and at that of its round hole.

    Parameters
    ----------
    radius : float
        Outer, m.
    hole : float
        Radius of the hole, m; below `radius`.
    thickness : float
        m.
    tension : float
        N/m, the same in all directions.

    Raises
    ------
    OptionError
        On lengths or a tension that are not positive, or a hole that leaves nothing.

    Notes
    -----
    f_mk = c x_mk / (2 pi radius) with c^2 = tension / (density thickness) and the roots of
    J_m(b x) Y_m(x) = J_m(x) Y_m(b x), where b = hole / radius; with m > 0 nodal diameters each
    comes twice, as cosine and sine of m times the angle (Morse 1948, section 19).

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

    coordinates: ClassVar[tuple[str, ...]] = ("x (m)", "y (m)")

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
    def supported(self) -> bool:
        """True: its edges are held."""
        return True

    @property
    def tensioned(self) -> bool:
        """True: tension drives it back."""
        return True

    @property
    def volume(self) -> float:
        """m^3."""
        return math.pi * (self.radius**2 - self.hole**2) * self.thickness

    @property
    def extent(self) -> float:
        """Outer diameter, m."""
        return 2 * self.radius

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts on the top, at y = 0.

        "middle" of the ring (also "top"), "quarter" of its width from the outer edge, "edge" (also
        "rim") 1 % off it.
        """
        return places_on_disk(self.radius, self.hole, self.thickness)

    def vibration(self, material: Material, highest: float) -> Vibration:
        """Return every mode up to `highest` Hz.

        Raises
        ------
        OptionError
            When they are more than 100,000.
        """
        return round_membrane(
            material,
            highest,
            radius=self.radius,
            hole=self.hole,
            thickness=self.thickness,
            tension=self.tension,
        )

    def skin(self, spacing: float) -> Mesh:
        """Return its closed surface with vertices about `spacing` m apart over the plan."""
        return slab(*annulus(self.radius, self.hole, spacing), self.thickness)

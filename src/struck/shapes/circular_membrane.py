"""Circular membranes: drums (1998, section 6)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.shapes.disks import disk, places_on_disk
from struck.shapes.plans import require_tension
from struck.shapes.round_membranes import round_membrane
from struck.shapes.shape import Shape, Vibration
from struck.shapes.skins import slab
from struck.solids.resolution import require_length

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class CircularMembrane(Shape):
    """A taut disk around the origin, held at its edge.

    Parameters
    ----------
    radius, thickness : float
        m.
    tension : float
        N/m, the same in all directions.

    Raises
    ------
    OptionError
        On lengths or a tension that are not positive.

    Notes
    -----
    f_mk = c j_mk / (2 pi radius) with c^2 = tension / (density thickness) and the zeros j_mk of the
    Bessel function J_m; with m > 0 nodal diameters each comes twice, as cosine and sine of m times
    the angle (Morse 1948, section 19; 1998, section 6, without its load of air).

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

    coordinates: ClassVar[tuple[str, ...]] = ("x (m)", "y (m)")

    def __post_init__(self) -> None:
        require_length("radius of the membrane", self.radius)
        require_length("thickness of the membrane", self.thickness)
        require_tension("membrane", self.tension)

    @property
    def supported(self) -> bool:
        """True: its edge is held."""
        return True

    @property
    def tensioned(self) -> bool:
        """True: tension drives it back."""
        return True

    @property
    def volume(self) -> float:
        """m^3."""
        return math.pi * self.radius**2 * self.thickness

    @property
    def extent(self) -> float:
        """Diameter, m."""
        return 2 * self.radius

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts on the top: "middle" (also "top"), "quarter" of the diameter, "edge" 1 % off.

        "edge" is also "rim".
        """
        return places_on_disk(self.radius, 0.0, self.thickness)

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
            hole=0.0,
            thickness=self.thickness,
            tension=self.tension,
        )

    def skin(self, spacing: float) -> Mesh:
        """Return its closed surface with vertices about `spacing` m apart over the plan."""
        return slab(*disk(self.radius, spacing), self.thickness)

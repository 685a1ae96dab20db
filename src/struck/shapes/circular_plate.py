"""Circular plates: free, supported or clamped around (1998, section 6)."""

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
from struck.shapes.counterpart import Counterpart, require_clamped_or_free
from struck.shapes.disks import disk, places_on_disk
from struck.shapes.plans import require_countable
from struck.shapes.plate_forms import plate_forms
from struck.shapes.plate_roots import EDGES, plate_roots
from struck.shapes.round_forms import with_pairs
from struck.shapes.shape import Shape, Vibration
from struck.shapes.skins import slab
from struck.solids import Tube
from struck.solids.resolution import require_length

Array = NDArray[np.float64]

_ROUNDING = 1e-12
# Thickness over radius beyond which a person is told what thin-plate theory leaves out.
_THIN = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class CircularPlate(Shape):
    """A thin disk around the origin that resists bending.

    Parameters
    ----------
    radius, thickness : float
        m.
    edge : str
        "free", "supported" (held, and free to turn) or "clamped".

    Raises
    ------
    OptionError
        On lengths that are not positive, or another edge.

    Notes
    -----
    Kirchhoff's theory: f = lambda^2 / (2 pi radius^2) [D / (density thickness)]^(1/2) with
    D = E thickness^3 / (12 (1 - nu^2)), and deflections of J_m(lambda r) and I_m(lambda r) times
    cosine and sine of m times the angle (Leissa 1969, chapter 2). Shear and rotation, which it
    leaves out, lower frequencies by about (lambda thickness / radius)^2 [1/24 + 1/(10 (1 - nu))]
    (Mindlin 1951).

    Examples
    --------
    >>> plate = CircularPlate(radius=0.1, thickness=0.001, edge="clamped")
    >>> steel = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.29)
    >>> plate.vibration(steel, 1000.0).frequencies.round(2)
    array([247.55, 515.18, 515.18, 845.13, 845.13, 963.73])
    """

    radius: float
    thickness: float
    edge: str = "free"

    coordinates: ClassVar[tuple[str, ...]] = ("x (m)", "y (m)")

    def __post_init__(self) -> None:
        require_length("radius of the plate", self.radius)
        require_length("thickness of the plate", self.thickness)
        if self.edge not in EDGES:
            raise OptionError(f"edge of the plate is {self.edge!r}: give one of {', '.join(EDGES)}")

    @property
    def supported(self) -> bool:
        """Whether its edge is held."""
        return self.edge != "free"

    @property
    def tensioned(self) -> bool:
        """False: its stiffness drives it back."""
        return False

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
        """Return every mode up to `highest` Hz, but for the motions of a free plate as a rigid one.

        Raises
        ------
        OptionError
            When they are more than 100,000.
        """
        nu, unit = material.poisson_ratio, self._unit(material)
        limit = math.sqrt(highest / unit)
        require_countable("plate", math.pi, limit, highest)
        orders, sines, roots = with_pairs(plate_roots(self.edge, limit, nu))
        forms, slopes = plate_forms(self.edge, self.radius, (orders, sines), roots, nu)
        return Vibration(
            frequencies=unit * roots**2,
            forms=forms,
            poisson_slopes=slopes + nu / (1 - nu**2),
            errors=np.full(len(roots), _ROUNDING),
            half_wave=math.pi * self.radius / float(roots.max(initial=math.pi)),
            method=f"circular plate, {self.edge}: Kirchhoff's theory, roots counted by their signs",
            references=("leissa1969", "mindlin1951"),
            details=self._details(roots, nu),
        )

    def skin(self, spacing: float) -> Mesh:
        """Return its closed surface with vertices about `spacing` m apart over the plan."""
        return slab(*disk(self.radius, spacing), self.thickness)

    def solid(self) -> Counterpart:
        """Return the disk it stands for.

        Raises
        ------
        OptionError
            On a supported edge.
        """
        require_clamped_or_free("plate", (self.edge,))
        disk = Tube(length=self.thickness, radius=self.radius, wall=self.radius)
        return Counterpart(solid=disk, rim=self.radius if self.supported else None)

    def _unit(self, material: Material) -> float:
        """Return the frequency at which lambda would be 1, Hz."""
        inertia = 12 * (1 - material.poisson_ratio**2) * material.density
        speed = math.sqrt(material.youngs_modulus / inertia)
        return speed * self.thickness / (2 * math.pi * self.radius**2)

    def _details(self, roots: Array, poisson_ratio: float) -> Mapping[str, object]:
        thinness = self.thickness / self.radius
        details: dict[str, object] = {"thickness over radius": thinness}
        if not len(roots):
            return details
        squares = (roots[[0, -1]] * thinness) ** 2
        low, high = np.sqrt(1 + squares * (1 / 12 + 1 / (5 * (1 - poisson_ratio)))) - 1
        details["lowest frequency overstated by"] = float(low)
        details["highest frequency overstated by"] = float(high)
        if thinness > _THIN:
            details["caution"] = (
                f"thickness is {thinness:.3g} of the radius, above {_THIN:g}: the theory of thin "
                f"plates leaves shear out and overstates the lowest frequency by about {low:.1%}, "
                f"the highest by about {high:.1%}; elements do not"
            )
        return details

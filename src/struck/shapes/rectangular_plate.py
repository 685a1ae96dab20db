"""Rectangular plates with any mix of free, supported and clamped edges."""

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
from struck.shapes.plans import INSET, places_on
from struck.shapes.ritz import Axis, Plate, bend
from struck.shapes.ritz_forms import RitzForms
from struck.shapes.shape import Shape, Vibration
from struck.shapes.skins import rectangle, slab
from struck.solids import Block
from struck.solids.resolution import require_length

Array = NDArray[np.float64]

EDGES = {"free": 0, "supported": 1, "clamped": 2}
# Polynomials beyond those that half waves ask for; and for a half wave, of which pi / 2 would do
# far from the edges, where evanescent waves want more.
_MORE, _A_HALF_WAVE = 12, 1.75
# How much finer the second resolution is, whose frequencies are given, and how close the first
# must come to it.
_FINER, _STILL, _ROUNDS = 1.15, 1e-5, 4
_MOST_FUNCTIONS = 5000
_ROUNDING = 1e-11
# What is still to come at corners where edges differ, over what the last step brought.
_REMAINING = 3.0


@dataclass(frozen=True, slots=True, kw_only=True)
class RectangularPlate(Shape):
    """A thin plate from x = 0 to length and y = 0 to width that resists bending.

    Parameters
    ----------
    length, width, thickness : float
        Along x, y and z, m.
    edges : str or tuple of four str
        "free", "supported" (held, and free to turn) or "clamped": one for all, or those at x = 0,
        x = length, y = 0 and y = width.

    Raises
    ------
    OptionError
        On lengths that are not positive, or other edges.

    Notes
    -----
    Kirchhoff's theory, D (del^2)^2 w = density thickness (2 pi f)^2 w with
    D = E thickness^3 / (12 (1 - nu^2)), by Rayleigh and Ritz (Leissa 1969, appendix): products of
    polynomials that are held as the edges are, orthonormal over the plate, so that frequencies come
    down to the true ones faster than any power of their number. `errors` is what they still moved
    from one number to a higher one.

    Examples
    --------
    >>> plate = RectangularPlate(length=0.3, width=0.3, thickness=0.003, edges="clamped")
    >>> steel = Material(density=7850.0, youngs_modulus=200e9, poisson_ratio=0.3)
    >>> plate.vibration(steel, 1000.0).frequencies.round(1)
    array([303. , 617.9, 617.9, 911.2])
    """

    length: float
    width: float
    thickness: float
    edges: str | tuple[str, str, str, str] = "free"

    coordinates: ClassVar[tuple[str, ...]] = ("x (m)", "y (m)")

    def __post_init__(self) -> None:
        for name in ("length", "width", "thickness"):
            require_length(f"{name} of the plate", getattr(self, name))
        if len(self.around) != len(EDGES) + 1 or not set(self.around) <= set(EDGES):
            raise OptionError(f"edges are {self.edges!r}: give one or four of {', '.join(EDGES)}")

    @property
    def around(self) -> tuple[str, ...]:
        """What holds it at x = 0, x = length, y = 0 and y = width."""
        return (self.edges,) * 4 if isinstance(self.edges, str) else tuple(self.edges)

    @property
    def supported(self) -> bool:
        """Whether an edge is held."""
        return set(self.around) != {"free"}

    @property
    def tensioned(self) -> bool:
        """False: its stiffness drives it back."""
        return False

    @property
    def volume(self) -> float:
        """m^3."""
        return self.length * self.width * self.thickness

    @property
    def extent(self) -> float:
        """Longest edge, m."""
        return max(self.length, self.width)

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts on the top.

        "middle" (also "top"), "quarter" of both lengths, "edge" 1 % off x = length, "corner" 1 %
        off both far edges.
        """
        shares = {"top": (0.5, 0.5), "middle": (0.5, 0.5), "quarter": (0.25, 0.25)}
        shares |= {"edge": (1 - INSET, 0.5), "corner": (1 - INSET, 1 - INSET)}
        plan = {name: (u * self.length, v * self.width) for name, (u, v) in shares.items()}
        return places_on(plan, self.thickness)

    def vibration(self, material: Material, highest: float) -> Vibration:
        """Return every mode up to `highest` Hz, but for the motions of the plate as a rigid one.

        Raises
        ------
        OptionError
            When they are too many: about 5,000 with equal edges on opposite sides, 1,000 without.
        """
        unit, nu = self._unit(material), material.poisson_ratio
        wavenumber = math.sqrt(highest / unit)
        plate, errors, degrees = self._settled(wavenumber, nu)
        some = np.flatnonzero(plate.squared <= wavenumber**4)
        return Vibration(
            frequencies=unit * np.sqrt(plate.squared[some]),
            forms=self._forms(plate).chosen(some),
            poisson_slopes=nu / (1 - nu**2) + plate.slopes[some] / (2 * plate.squared[some]),
            errors=errors[some],
            half_wave=math.pi
            / max(plate.squared[some].max(initial=0.0) ** 0.25, math.pi / self.extent),
            method=f"rectangular plate, {', '.join(self.around)}: Kirchhoff's theory by Ritz",
            references=("leissa1969",),
            details={"polynomials": degrees},
        )

    def skin(self, spacing: float) -> Mesh:
        """Return its closed surface with vertices about `spacing` m apart over the plan."""
        return slab(*rectangle(self.length, self.width, spacing), self.thickness)

    def solid(self) -> Counterpart:
        """Return the block it stands for.

        Raises
        ------
        OptionError
            On supported edges.
        """
        require_clamped_or_free("plate", self.around)
        sides = zip((0, 0, 1, 1), (0.0, self.length, 0.0, self.width), self.around, strict=True)
        return Counterpart(
            solid=Block(size=(self.length, self.width, self.thickness)),
            offset=(self.length / 2, self.width / 2, 0.0),
            ends=tuple((axis, place) for axis, place, edge in sides if edge == "clamped"),
        )

    def _unit(self, material: Material) -> float:
        """Return sqrt(D / (density thickness)) / (2 pi), Hz m^2."""
        inertia = 12 * (1 - material.poisson_ratio**2) * material.density
        return math.sqrt(material.youngs_modulus / inertia) * self.thickness / (2 * math.pi)

    def _settled(self, wavenumber: float, nu: float) -> tuple[Plate, Array, list[int]]:
        """Return modes that more polynomials hardly move, their errors, and how many there are."""
        axes = self._axes(wavenumber, 1.0)
        plate = bend(*axes, nu)
        errors = np.full(len(plate.squared), np.inf)
        for turn in range(1, _ROUNDS):
            before, axes = plate, self._axes(wavenumber, _FINER**turn)
            plate = bend(*axes, nu)
            errors = _moved(before.squared, plate.squared)
            if errors[plate.squared <= wavenumber**4].max(initial=0.0) < _STILL:
                break
        return plate, errors, [axis.count for axis in axes]

    def _axes(self, wavenumber: float, factor: float) -> tuple[Axis, Axis]:
        around = [EDGES[edge] for edge in self.around]
        pairs = ((self.length, around[:2]), (self.width, around[2:]))
        along, across = (
            Axis(
                ends=(ends[0], ends[1]),
                count=round(factor * (_MORE + _A_HALF_WAVE * wavenumber * length / math.pi)),
                scale=2 / length,
            )
            for length, ends in pairs
        )
        _require_solvable(along, across)
        return along, across

    def _forms(self, plate: Plate) -> RitzForms:
        ends = np.array([EDGES[edge] for edge in self.around]).reshape(2, 2)
        return RitzForms(
            length=self.length,
            width=self.width,
            ends=ends,
            stride=plate.stride,
            starts=plate.starts,
            coefficients=plate.coefficients,
        )


def _moved(before: Array, after: Array) -> Array:
    """Return how far frequencies came down from one resolution to the next, relative."""
    errors = np.full(len(after), np.inf)
    count = min(len(before), len(after))
    moved = np.abs(before[:count] / after[:count] - 1) / 2
    errors[:count] = _REMAINING * moved + _ROUNDING
    return errors


def _require_solvable(along: Axis, across: Axis) -> None:
    functions = along.count * across.count // (along.stride * across.stride)
    if functions > _MOST_FUNCTIONS:
        raise OptionError(
            f"the band asks for {along.count} x {across.count} polynomials, {functions} of one "
            f"symmetry: at most {_MOST_FUNCTIONS} are solved for; end the band lower, or check the "
            "lengths (m)"
        )

"""Membranes held along any polygon, the L-shape of 1998 among them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError, OptionError
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.shapes.plans import INSET, places_on, require_tension
from struck.shapes.polygon import Plan, plan_of
from struck.shapes.polygon_modes import Spectrum, expected, spectrum
from struck.shapes.shape import Shape, Vibration
from struck.shapes.skins import slab
from struck.solids.outline import (
    Pairs,
    as_points,
    check_loops,
    contains,
    distance_to_edges,
    edges_of,
)
from struck.solids.polygon_mesh import triangulated
from struck.solids.resolution import require_length

Array = NDArray[np.float64]
# A few minutes in simple polygons; each mode takes longer, the more there are.
_MOST_MODES = 1000
_GRID = 61  # points a side of the search for the deepest place


@dataclass(frozen=True, slots=True, kw_only=True)
class PolygonMembrane(Shape):
    """A membrane under tension, held along a polygon that does not cross itself.

    Parameters
    ----------
    corners : sequence of (x, y)
        In either direction round, m.
    thickness : float
        m.
    tension : float
        N/m, the same everywhere and in every direction.

    Raises
    ------
    OptionError
        On a thickness or tension that is not positive, fewer than three corners, repeated ones,
        edges that meet, numbers that are not finite.

    Notes
    -----
    Frequencies are sqrt(lambda tension / (density thickness)) / (2 pi), lambda the eigenvalues of
    the Laplacian in the polygon. The method of particular solutions finds them with a bound of
    each one's error (Betcke & Trefethen 2005; Moler & Payne 1968): Fourier-Bessel functions
    J_nu(k r) sin(nu theta) about the corners where eigenfunctions are not smooth and, where these
    do not suffice, fundamental solutions Y_0 about points outside (Barnett & Betcke 2008).

    That none is missing or doubled is proved by counts. There are at least as many eigenvalues as
    were found: each lies in the interval of a function's error, and functions whose values are
    nearer than 30 errors are refined as one orthonormal set. There are no more below a value just
    above the highest one found: so Crouzeix-Raviart elements tell, whose eigenvalues, corrected by
    their size, bound the true ones from below (Carstensen & Gedicke 2014; Liu 2015), counted by
    the inertia of their matrix. This holds but for rounding, and for bounds of errors that take
    the largest value on the boundary from samples; ``details`` of the vibration tell up to which
    frequency the proof reaches, 0 where it was too large to try.

    Examples
    --------
    >>> drum = PolygonMembrane.l_shape(side=0.2, thickness=0.00025, tension=3000.0)
    >>> film = Material(density=1390.0, youngs_modulus=4.5e9, poisson_ratio=0.38)
    >>> drum.vibration(film, 350.0).frequencies.round(2)
    array([229.56, 288.24, 328.5 ])
    """

    corners: Pairs
    thickness: float
    tension: float

    coordinates: ClassVar[tuple[str, ...]] = ("x (m)", "y (m)")

    def __post_init__(self) -> None:
        require_length("thickness of the membrane", self.thickness)
        require_tension("membrane", self.tension)
        object.__setattr__(self, "corners", as_points("the polygon", self.corners))
        try:
            check_loops((self._loop,))
        except MeshError as error:
            raise OptionError(str(error)) from error

    @classmethod
    def l_shape(cls, *, side: float, thickness: float, tension: float) -> PolygonMembrane:
        """Make the L-shape: three squares of a `side`, m, in the quadrant x, y > 0.

        Raises
        ------
        OptionError
            On numbers that are not positive and finite.
        """
        require_length("side of the L", side)
        turns = ((0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2))
        corners = tuple((side * x, side * y) for x, y in turns)
        return cls(corners=corners, thickness=thickness, tension=tension)

    @property
    def _loop(self) -> Array:
        return np.array(self.corners, dtype=np.float64)

    @property
    def _plan(self) -> Plan:
        return plan_of(self._loop)

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
        return self._plan.area * self.thickness

    @property
    def extent(self) -> float:
        """Longer side of the polygon's box, m."""
        return float(np.ptp(self._loop, axis=0).max())

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts on its top.

        "top" (also "middle"): the place farthest from all edges, the one nearest the middle of the
        box where several are; "edge" and "corner": 1 % of the extent off the middle of the longest
        edge and off the corner farthest from "top".
        """
        plan = self._plan
        top = _deepest(plan.corners)
        edge = int(np.argmax(plan.lengths))
        middle = (plan.corners[edge] + plan.corners[(edge + 1) % len(plan.corners)]) / 2
        corner = plan.corners[np.argmax(np.linalg.norm(plan.corners - top, axis=1))]
        near = {name: _inside(plan, at) for name, at in (("edge", middle), ("corner", corner))}
        plan_places = {"top": top, "middle": top, **near}
        flat = {name: (float(x), float(y)) for name, (x, y) in plan_places.items()}
        return places_on(flat, self.thickness)

    def vibration(self, material: Material, highest: float) -> Vibration:
        """Return every mode up to `highest` Hz.

        Raises
        ------
        OptionError
            When there are too many.
        SolverError
            When near modes cannot be told apart.
        """
        speed = float(np.sqrt(self.tension / (material.density * self.thickness)))
        bound = (2 * np.pi * highest / speed) ** 2
        count = expected(self._plan, bound)
        if count > _MOST_MODES:
            raise OptionError(
                f"about {count:.0f} modes lie below {highest:g} Hz, and {_MOST_MODES} can be had: "
                f"end the band at {highest * np.sqrt(_MOST_MODES / count):.3g} Hz or lower"
            )
        found = spectrum(self._loop, bound)
        wavenumbers = np.sqrt(found.values)
        shortest = np.append(np.sqrt(bound), wavenumbers)[-1]
        return Vibration(
            frequencies=wavenumbers * speed / (2 * np.pi),
            forms=found.forms,
            poisson_slopes=np.zeros(len(wavenumbers)),
            errors=found.errors,
            half_wave=float(np.pi / shortest),
            method="particular solutions, counted by nonconforming finite elements",
            references=(
                "betcke2005",
                "moler1968",
                "barnett2008",
                "carstensen2014",
                "liu2015",
            ),
            details=_details(found, speed),
        )

    def skin(self, spacing: float) -> Mesh:
        """Return its closed surface with vertices about `spacing` m apart over the plan."""
        points, triangles, _ = triangulated((self._plan.corners,), spacing)
        return slab(points, triangles, self.thickness)


def _details(found: Spectrum, speed: float) -> dict[str, object]:
    """Return what a person would ask for."""
    return {
        "functions a mode": int(found.forms.coefficients.shape[1]),
        "fundamental solutions among them": len(found.forms.sources),
        "proved complete up to (Hz)": float(np.sqrt(found.proved_to) * speed / (2 * np.pi)),
    }


def _deepest(corners: Array) -> Array:
    """Return the place farthest from the edges; of several, that nearest the box's middle."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    shares = np.stack(np.meshgrid(*[np.linspace(0, 1, _GRID)] * 2), axis=-1).reshape(-1, 2)
    points, edges = low + shares * (high - low), edges_of((corners,))
    points = points[contains(edges, points)]
    depths = distance_to_edges(edges, points)
    deep = points[depths > 0.98 * depths.max()]
    return deep[np.argmin(np.linalg.norm(deep - (low + high) / 2, axis=1))]


def _inside(plan: Plan, place: Array) -> Array:
    """Return a place near one on the boundary: the deepest of those at a small distance."""
    radius = INSET * float(np.ptp(plan.corners, axis=0).max())
    turns = np.linspace(0, 2 * np.pi, 120, endpoint=False)
    edges = edges_of((plan.corners,))
    while True:
        ring = place + radius * np.stack([np.cos(turns), np.sin(turns)], axis=1)
        ring = ring[contains(edges, ring)]
        if len(ring):
            return ring[np.argmax(distance_to_edges(edges, ring))]
        radius /= 2

"""What every closed-form body tells: how its plan vibrates, and what it looks like."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.model.arrays import Array
from struck.model.gains import Forms, TransverseShapes
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.modes import Modes
from struck.model.provenance import Provenance
from struck.solids import Block, Tube
from struck.solids.volume_mesh import VolumeMesh

# The solid that a closed-form body stands for, to compute it by finite elements instead.

Turn = tuple[tuple[float, ...], ...]
Held = Callable[[Array], NDArray[np.bool_]]

# Turns the axis of a tube, z, towards x.
ALONG_X: Turn = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
UPRIGHT: Turn = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
# Share of the body's extent within which a node counts as on its end.
_NEAR = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Counterpart:
    """A solid in the frame of a closed-form body: turned, then moved by `offset`.

    Parameters
    ----------
    solid : Block or Tube
    turn : matrix (3, 3)
        Of a rotation.
    offset : vector (3,)
        m.
    ends : tuple of (axis, m)
        Where the solid is held: at the planes across the axis (0 or 1) at these places.
    rim : float or None
        Where it is held, too: at this distance from the axis z, m.
    """

    solid: Block | Tube
    turn: Turn = UPRIGHT
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    ends: tuple[tuple[int, float], ...] = ()
    rim: float | None = None
    places: Mapping[str, Array] = field(default_factory=lambda: MappingProxyType({}))

    def volume_mesh(self, accuracy: str = "standard") -> VolumeMesh:
        """Return the solid's elements in this frame."""
        mesh = self.solid.volume_mesh(accuracy)
        return replace(mesh, nodes=mesh.nodes @ np.array(self.turn).T + np.array(self.offset))

    @property
    def fixed(self) -> Held | None:
        """Where it is held, as `struck.analyze` asks for it."""
        return self._held if self.ends or self.rim else None

    def _held(self, points: Array) -> NDArray[np.bool_]:
        near = _NEAR * float(np.ptp(points, axis=0).max())
        held = np.zeros(len(points), bool)
        for axis, place in self.ends:
            held |= np.abs(points[:, axis] - place) <= near
        if self.rim is not None:
            held |= np.hypot(points[:, 0], points[:, 1]) >= self.rim - near
        return held


def require_clamped_or_free(kind: str, ends: tuple[str, ...]) -> None:
    """Refuse supports that no surface of a solid can have.

    Raises
    ------
    OptionError
        Where an end is neither clamped nor free.
    """
    for end in ends:
        if end not in {"clamped", "free"}:
            raise OptionError(
                f"an end of the {kind} is {end!r}: elements can only be held ('clamped') or let "
                "go ('free'); take method='formula'"
            )


# Places along slender bodies.

# Places near an end stand off it by this share.
_INSET = 0.01


def places_along(length: float, height: float) -> Mapping[str, Array]:
    """Return contacts on the top of a body along x from 0 to `length`, its middle line at z = 0.

    "middle" (also "top"), "quarter" of the length, and "end" 1 % off the end at x = length.
    """
    shares = {"top": 0.5, "middle": 0.5, "quarter": 0.25, "end": 1 - _INSET}
    places = {name: np.array([share * length, 0.0, height / 2]) for name, share in shares.items()}
    for place in places.values():
        place.setflags(write=False)
    return MappingProxyType(places)


# What bodies with a plan in x and y share: places by name, and how many modes are too many.

# Places near an edge stand off it by this share.
INSET = 0.01
_MOST_PLAN_MODES = 100_000


def places_on(plan: Mapping[str, tuple[float, float]], thickness: float) -> Mapping[str, Array]:
    """Return contacts on the top face of a body whose middle plane is z = 0, by name, m (3,)."""
    places = {name: np.array([x, y, thickness / 2]) for name, (x, y) in plan.items()}
    for place in places.values():
        place.setflags(write=False)
    return MappingProxyType(places)


def require_tension(body: str, tension: float) -> None:
    """Raise OptionError unless `tension` is a positive, finite force over a length, N/m."""
    if not (math.isfinite(tension) and tension > 0):
        raise OptionError(f"tension of the {body} is {tension} N/m: it must exceed 0")


def require_countable(body: str, area: float, wavenumber: float, highest: float) -> None:
    """Refuse bands with more modes than a file can hold, by Weyl's law.

    Raises
    ------
    OptionError
        When about area wavenumber^2 / (4 pi) exceeds 100,000.
    """
    count = area * wavenumber**2 / (4 * math.pi)
    if not count <= _MOST_PLAN_MODES:
        raise OptionError(
            f"the {body} has about {count:.2g} modes up to {highest:g} Hz: "
            f"at most {_MOST_PLAN_MODES} "
            "are computed; end the band lower, or check the lengths (m)"
        )


BAND = (20.0, 20_000.0)
# Vertices across the shortest half wave: what a picture and the estimate of radiation need.
_ACROSS_A_HALF_WAVE = 4
# Vertices along one side of a plan at most and at least: beyond, files grow to hundreds of MB.
_MOST, _LEAST = 56, 12
# Modes of a model at most: their shapes at the vertices take gigabytes.
_MOST_MODES = 3000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Vibration:
    """How the plan of a body vibrates across itself, along z.

    Parameters
    ----------
    frequencies : array (M,)
        Natural, ascending, Hz: all up to the asked-for highest.
    forms : Forms
        Psi_n of 1998, eq. 3, each with a mean square of 1 over the mass.
    poisson_slopes : array (M,)
        d ln f / d(Poisson's ratio) at constant Young's modulus.
    errors : array (M,)
        Bounds or estimates of the relative error of each frequency.
    half_wave : float
        About the shortest distance between nodal lines, m.
    method : str
        What computed them, in a line.
    references : tuple of str
        Keys in ``references.toml``.
    details : mapping
        Figures that a person would ask for.
    """

    frequencies: Array
    forms: Forms
    poisson_slopes: Array
    errors: Array
    half_wave: float
    method: str
    references: tuple[str, ...] = ()
    details: Mapping[str, object] = field(default_factory=dict)


class Shape(ABC):
    """A body whose modes are known in closed form, or nearly so.

    Its plan lies in x (and y); it moves along z. Lengths in m.
    """

    __slots__ = ()
    coordinates: ClassVar[tuple[str, ...]]

    @property
    @abstractmethod
    def supported(self) -> bool:
        """Whether it is held somewhere, so that it cannot move as a rigid one."""
        ...

    @property
    @abstractmethod
    def tensioned(self) -> bool:
        """Whether tension, not the material's stiffness, drives it back."""
        ...

    @property
    @abstractmethod
    def volume(self) -> float:
        """m^3."""
        ...

    @property
    @abstractmethod
    def extent(self) -> float:
        """Longest edge of its plan, m."""
        ...

    @property
    @abstractmethod
    def places(self) -> Mapping[str, Array]:
        """Contacts by name on its top, m (3,)."""
        ...

    @abstractmethod
    def vibration(self, material: Material, highest: float) -> Vibration:
        """Return every mode up to `highest` Hz."""
        ...

    @abstractmethod
    def skin(self, spacing: float) -> Mesh:
        """Return its closed surface with vertices about `spacing` m apart over the plan."""
        ...

    def solid(self) -> Counterpart:
        """Return the solid it stands for.

        Raises
        ------
        OptionError
            Where no solid vibrates alike.
        """
        raise OptionError(
            f"{type(self).__name__} is held by its tension, which solid elements do not have: "
            "take method='formula'"
        )

    def modes(self, material: Material, band: tuple[float, float] = BAND) -> Modes:
        """Return the modes within the band with the surface.

        Raises
        ------
        OptionError
            When no mode lies within the band.
        """
        return modes_of(self, material, band)


def modes_of(shape: Shape, material: Material, band: tuple[float, float]) -> Modes:
    """Return the modes of a shape; see `Shape.modes`."""
    vibration = shape.vibration(material, band[1])
    if not np.any(vibration.frequencies >= band[0]):
        raise OptionError(_silent(shape, material, vibration, band))
    _require_few(vibration.frequencies, band[1])
    surface = shape.skin(_spacing(shape, vibration.half_wave))
    mass = shape.volume * material.density
    centre, gyration = _spread(surface)
    formula = TransverseShapes.of(vibration.forms, len(vibration.frequencies), mass)
    return Modes(
        frequencies=vibration.frequencies,
        surface=surface,
        shapes=formula.displacements(surface.points),
        formula=formula,
        mass=mass,
        centre=centre,
        inertia=mass * gyration,
        complete_to=band[1],
        poisson_slopes=vibration.poisson_slopes,
        errors=vibration.errors,
        supported=shape.supported,
        tensioned=shape.tensioned,
        provenance=Provenance(
            method=vibration.method,
            references=("doel1998", *vibration.references),
            details=vibration.details,
        ),
    )


def _require_few(frequencies: Array, highest: float) -> None:
    if len(frequencies) > _MOST_MODES:
        raise OptionError(
            f"the body has {len(frequencies)} modes up to {highest:g} Hz: a model takes at most "
            f"{_MOST_MODES}; end the band at {np.floor(frequencies[_MOST_MODES]):g} Hz"
        )


def _spacing(shape: Shape, half_wave: float) -> float:
    """Return how far apart vertices lie: as the shapes need, within what a file should hold."""
    wanted = half_wave / _ACROSS_A_HALF_WAVE
    return float(np.clip(wanted, shape.extent / _MOST, shape.extent / _LEAST))


def _silent(
    shape: Shape, material: Material, vibration: Vibration, band: tuple[float, float]
) -> str:
    low, high = band
    if len(vibration.frequencies):
        return (
            f"no mode lies between {low:g} and {high:g} Hz, though {len(vibration.frequencies)} "
            f"lie below, the highest at {vibration.frequencies[-1]:.4g} Hz: widen the band"
        )
    for factor in 2.0 ** np.arange(1, 12):
        found = shape.vibration(material, high * factor).frequencies
        if len(found):
            return f"the lowest mode is at {found[0]:.4g} Hz, above the band's end of {high:g} Hz"
    return f"no mode lies below {high * 2048:g} Hz: check the lengths (m) of the body"


def _spread(surface: Mesh) -> tuple[Array, Array]:
    """Return the centre (3,) and the inertia about it for unit mass (3, 3) of what it encloses."""
    corners = surface.points[surface.faces]  # with the origin, each face spans a tetrahedron
    volumes = np.einsum("fd,fd->f", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2]) / 6
    shares, sums = volumes / volumes.sum(), corners.sum(axis=1)
    centre = shares @ sums / 4
    squares = np.einsum("f,fcd,fce->de", shares, corners, corners)
    moments = (squares + np.einsum("f,fd,fe->de", shares, sums, sums)) / 20
    moments -= np.outer(centre, centre)
    return centre, np.trace(moments) * np.eye(3) - moments

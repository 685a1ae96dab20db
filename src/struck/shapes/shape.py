"""Bodies in closed form: their vibration, their surface, and the solids they idealise."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from struck.errors import NoModeError, OptionError, kind_of, rounded
from struck.model.arrays import Array, require_number
from struck.model.gains import Forms, TransverseShapes
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.modes import Modes
from struck.model.provenance import Progress, Provenance, silent
from struck.shapes.skins import Rod, Sheet
from struck.solids import Block, Tube
from struck.solids.volume_mesh import VolumeMesh

BAND = (20.0, 20_000.0)  # Hz
# Vertices across the shortest half wave, as a picture and the estimate of radiation need.
_ACROSS_A_HALF_WAVE = 4
# Vertices along one side of a plan at most and at least: beyond, files grow to hundreds of MB.
_MAX_VERTICES, _MIN_VERTICES = 56, 12
# Modes of a model at most: their shapes at the vertices take gigabytes.
_MAX_MODES = 3000
_MAX_PLAN_MODES = 100_000


# Thickness over half the shortest side above which a caution names the limits of the theory.
_THIN_RATIO = 0.1


def plate_overestimate(phases: Array, poisson_ratio: float) -> Array:
    """Return by how much a thin plate's frequencies lie too high, relative (Mindlin 1951).

    `phases` are wavenumbers times the thickness; the theory of thin plates leaves out shear and
    the inertia of rotation.
    """
    return np.sqrt(1 + phases**2 * (1 / 12 + 1 / (5 * (1 - poisson_ratio)))) - 1


def thinness(thickness: float, half: float, overestimates: Array) -> dict[str, object]:
    """Return details of a plate, with its radius or half side, m, and how much is overstated."""
    details: dict[str, object] = {"thickness over radius or half side": thickness / half}
    ends = dict(
        zip(
            ("lowest", "highest"),
            overestimates[[0, -1]] if len(overestimates) else (),
            strict=False,
        )
    )
    details |= {f"{end} frequency overstated by": float(ratio) for end, ratio in ends.items()}
    if thickness > _THIN_RATIO * half:
        notes = [f"the {end} frequency by about {ratio:.1%}" for end, ratio in ends.items()]
        details["caution"] = (
            f"thickness is {rounded(thickness / half, 3)} of the radius or half side, above "
            f"{_THIN_RATIO:g}: the theory of thin plates overstates "
            f"{', '.join(notes) or 'frequencies'}; "
            "with free or clamped edges finite elements, method='fem', do not"
        )
    return details


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Vibration:
    """Natural modes of a body that moves along z, over its plan."""

    frequencies: Array  # (M,), Hz, ascending: all up to the asked-for highest
    forms: Forms  # Psi_n of 1998, eq. 3, each with a mean square of 1 over the mass
    poisson_slopes: Array  # (M,), d ln f / d(Poisson's ratio) at constant Young's modulus
    errors: Array  # (M,), bounds or estimates of the relative errors of the theory's frequencies
    half_wave: float  # about the shortest distance between nodal lines, m
    method: str  # in a line
    overstated: Array | float = 0.0  # (M,), by how much the theory's frequencies lie too high
    references: tuple[str, ...] = ()  # keys in references.toml
    details: Mapping[str, object] = field(default_factory=dict)  # figures for the reader


class Shape(ABC):
    """A body whose modes are known in closed form, or nearly so.

    It lies in the plane of x (and y), and moves along z. Lengths are in m.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> isinstance(bar, struck.shapes.Shape), round(bar.volume, 9)
    (True, 4.5e-05)
    """

    __slots__ = ()
    # Whether tension, not the material's stiffness, drives it back.
    tensioned: ClassVar[bool] = False

    @property
    def supported(self) -> bool:
        """Whether the body is held at an edge, so that it cannot move as a rigid body."""
        return True

    @property
    @abstractmethod
    def geometry(self) -> Rod | Sheet:
        """Surface of the body, and places on it by name."""

    @property
    def volume(self) -> float:
        """Volume of the material, m^3."""
        return self.geometry.volume

    @property
    def extent(self) -> float:
        """Longest edge of its plan, m."""
        return self.geometry.extent

    @property
    def places(self) -> Mapping[str, Array]:
        """Contacts by name on its top, m (3,)."""
        return self.geometry.places

    @property
    def playing_place(self) -> str | None:
        """Name of the place where it is struck by default; None: where its low modes speak."""
        return None

    @abstractmethod
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

        Raises
        ------
        OptionError
            When they are more than the method takes, as more than 100,000.
        """

    def _vibration(self, material: Material, highest: float, progress: Progress) -> Vibration:
        """Return every mode as `vibration` does, while `progress` follows the work."""
        progress("computing the modes", 0.0)
        return self.vibration(material, highest)

    def skin(self, spacing: float) -> Mesh:
        """Return the closed surface of the body.

        Parameters
        ----------
        spacing : float
            Approximate distance of vertices over the plan, m.

        Returns
        -------
        Mesh
            The surface.
        """
        return self.geometry.skin(spacing)

    def solid(self) -> Counterpart:
        """Return the solid that the shape idealises, for finite elements.

        Returns
        -------
        Counterpart
            The solid in the coordinates of the shape.

        Raises
        ------
        OptionError
            If no solid vibrates in the same way.
        """
        raise OptionError(
            f"{kind_of(self)} is held by its tension, which solid elements do not have: take "
            "method='formula'"
        )

    def modes(
        self,
        material: Material,
        band: tuple[float, float] = BAND,
        *,
        none: bool = False,
        progress: Progress = silent,
    ) -> Modes:
        """Compute the modes within a band, and the surface.

        Parameters
        ----------
        material : Material
            Material of the body.
        band : (float, float), default (20, 20000)
            Lowest and highest frequency, Hz.
        none : bool, default False
            Allow a result without modes.
        progress : callable, optional
            Called as ``progress(stage, fraction)`` in long work. Default: silent.

        Returns
        -------
        Modes
            Undamped modes.

        Raises
        ------
        NoModeError
            If no mode is within the band.
        """
        vibration, notes = self._vibration(material, band[1], progress), ()
        if not np.any(vibration.frequencies >= band[0]):
            message = _describe_empty_band(self, material, vibration, band)
            if not none:
                raise NoModeError(message)
            notes = (f"{message}: what is heard is its recoil",)
        _require_few(vibration.frequencies, band[1])
        # As far apart as the mode shapes need, within what a file should hold.
        target_spacing = vibration.half_wave / _ACROSS_A_HALF_WAVE
        surface = self.skin(
            float(np.clip(target_spacing, self.extent / _MAX_VERTICES, self.extent / _MIN_VERTICES))
        )
        mass = self.volume * material.density
        centre, gyration = _mass_properties(surface)
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
            errors=vibration.errors + vibration.overstated,
            supported=self.supported,
            tensioned=self.tensioned,
            provenance=Provenance(
                method=vibration.method,
                references=("doel1998", *vibration.references),
                details=vibration.details,
                dropped=notes,
            ),
        )


def _require_few(frequencies: Array, max_frequency: float) -> None:
    if len(frequencies) > _MAX_MODES:
        raise OptionError(
            f"the body has {len(frequencies)} modes up to {rounded(max_frequency)} Hz: a model "
            f"takes at most {_MAX_MODES}; check the lengths (m), or end the band at "
            f"{rounded(np.floor(frequencies[_MAX_MODES]))} Hz"
        )


def _describe_empty_band(
    shape: Shape, material: Material, vibration: Vibration, band: tuple[float, float]
) -> str:
    """Return the message for a band without modes: where the nearest mode lies."""
    low, high = band
    if len(vibration.frequencies):
        return (
            f"no mode lies between {rounded(low)} and {rounded(high)} Hz, though "
            f"{len(vibration.frequencies)} lie below, the highest at "
            f"{rounded(vibration.frequencies[-1], 4)} Hz: widen the band"
        )
    for factor in 2.0 ** np.arange(1, 12):
        frequencies = shape.vibration(material, high * factor).frequencies
        if len(frequencies):
            lowest, end = rounded(frequencies[0], 4), rounded(high)
            return f"the lowest mode is at {lowest} Hz, above the band's end of {end} Hz"
    return f"no mode lies below {rounded(high * 2048)} Hz: check the lengths (m) of the body"


def _mass_properties(surface: Mesh) -> tuple[Array, Array]:
    """Return centre (3,) and inertia about it (3, 3) of the enclosed volume with unit mass."""
    corners = surface.points[surface.faces]  # with the origin, each face spans a tetrahedron
    volumes = np.einsum("fd,fd->f", np.cross(corners[:, 0], corners[:, 1]), corners[:, 2]) / 6
    weights, sums = volumes / volumes.sum(), corners.sum(axis=1)
    centre = weights @ sums / 4
    squares = np.einsum("f,fcd,fce->de", weights, corners, corners)
    moments = (squares + np.einsum("f,fd,fe->de", weights, sums, sums)) / 20
    moments -= np.outer(centre, centre)
    return centre, np.trace(moments) * np.eye(3) - moments


def require_tension(body: str, tension: float) -> None:
    """Raise OptionError unless `tension` is a positive, finite force over a length, N/m."""
    name, hint = f"tension of the {body}", "it must exceed 0, and 1e-12 N/m is the least"
    require_number(name, tension, 1e-12, hint=hint, unit=" N/m")


def require_countable(body: str, area: float, wavenumber: float, max_frequency: float) -> None:
    """Refuse bands with over 100,000 modes by Weyl's law: about area wavenumber^2 / (4 pi)."""
    # A product in place of a square, which does not become infinite but raises.
    require_count(body, area * wavenumber * wavenumber / (4 * math.pi), max_frequency)


def require_count(body: str, count: float, max_frequency: float) -> None:
    """Refuse bands with over 100,000 modes before any is computed."""
    if not count <= _MAX_PLAN_MODES:
        raise OptionError(
            f"the {body} has about {rounded(count, 2)} modes up to {rounded(max_frequency)} Hz: at "
            f"most {_MAX_PLAN_MODES} are computed; end the band lower, or check the lengths (m)"
        )


Turn = tuple[tuple[float, ...], ...]
Held = Callable[[Array], NDArray[np.bool_]]

# Turns the axis of a tube, z, towards x.
ALONG_X: Turn = ((0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (-1.0, 0.0, 0.0))
UPRIGHT: Turn = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
# Fraction of the body's extent within which a node counts as on its end.
_END_TOLERANCE = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class Counterpart:
    """A solid in the frame of a closed-form body: turned, then moved by `offset`."""

    solid: Block | Tube
    of: str  # the closed-form body's class, for messages
    turn: Turn = UPRIGHT  # matrix (3, 3) of a rotation
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m
    # Held at the planes across an axis (0 or 1) at these places, m.
    ends: tuple[tuple[int, float], ...] = ()
    rim: float | None = None  # held from this distance from the axis z on, m
    places: Mapping[str, Array] = field(default_factory=lambda: MappingProxyType({}))
    playing_place: str | None = None

    def volume_mesh(self, accuracy: str = "standard", finer: float = 1.0) -> VolumeMesh:
        """Return the solid's elements in this frame."""
        mesh = self.solid.volume_mesh(accuracy, finer)
        return replace(mesh, nodes=mesh.nodes @ np.array(self.turn).T + np.array(self.offset))

    @property
    def volume(self) -> float:
        """Exact volume, m^3."""
        return self.solid.volume

    @property
    def fixed(self) -> Held | None:
        """Function that returns which points are held, for `struck.analyze`, or None."""
        return self._held if self.ends or self.rim else None

    def _held(self, points: Array) -> NDArray[np.bool_]:
        tolerance = _END_TOLERANCE * float(np.ptp(points, axis=0).max())
        is_held = np.zeros(len(points), bool)
        for axis, place in self.ends:
            is_held |= np.abs(points[:, axis] - place) <= tolerance
        if self.rim is not None:
            is_held |= np.hypot(points[:, 0], points[:, 1]) >= self.rim - tolerance
        return is_held


def require_clamped_or_free(kind: str, ends: tuple[str, ...]) -> None:
    """Refuse supports that no surface of a solid can have."""
    for end in ends:
        if end not in {"clamped", "free"}:
            raise OptionError(
                f"an end of the {kind} is {end!r}: elements can only be held ('clamped') or let "
                "go ('free'); take method='formula'"
            )

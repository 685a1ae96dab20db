"""Gains: how strongly each mode answers a contact, and how loudly it reaches a listener."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from struck.errors import ContactError, OptionError
from struck.model.air_losses import AirLosses, group_means
from struck.model.arrays import Array, Complex, Index, Single, brief, require_numbers
from struck.model.material import Air
from struck.model.mesh import Mesh, Surface, barycentric, in_space
from struck.model.provenance import Progress


class Forms(Protocol):
    """Mode shapes over the plan of a body as functions Psi_n (1998, eq. 3) of mean square 1."""

    @property
    def dimensions(self) -> int:
        """Number of coordinates of a place in the plan, D."""
        ...

    def values(self, places: Array) -> Array:
        """Return the functions at places in the plan, m (K, D): (K, M)."""
        ...

    def chosen(self, modes: Index) -> Self:
        """Return the functions of some modes, in that order."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TransverseShapes:
    """Mode shapes of a body that moves along z alone, exact at any place of its plan."""

    forms: Forms  # over the plan of the body as it was computed
    weights: Array  # (M,): forms times these are mass-normalised shapes, kg^-1/2
    size: float = 1.0  # how many times larger the body has become since

    @classmethod
    def of(cls, forms: Forms, count: int, mass: float) -> TransverseShapes:
        """Make the shapes of a body of `mass` kg from `count` forms."""
        return cls(forms=forms, weights=np.full(count, mass**-0.5))

    def displacements(self, points: Array) -> Array:
        """Return the shapes at points of the body, m (K, 3): (K, 3, M), kg^-1/2."""
        plan = in_space(points)[:, : self.forms.dimensions] / self.size
        shapes = np.zeros((len(plan), 3, len(self.weights)))
        shapes[:, 2] = self.forms.values(plan) * self.weights
        return shapes

    def chosen(self, modes: Index, size: float = 1.0, density: float = 1.0) -> TransverseShapes:
        """Return some modes of a body `size` times as large and `density` times as dense."""
        return replace(
            self,
            forms=self.forms.chosen(modes),
            weights=self.weights[modes] * (density * size**3) ** -0.5,
            size=self.size * size,
        )

    def signed(self, signs: Array) -> TransverseShapes:
        """Return the shapes times `signs` (M,)."""
        return replace(self, weights=self.weights * signs)


# Modes closer than this share of their frequency count as turned copies of one another.
_SHARED = 1e-3
_TWIN_RATIO = 1e-6  # relative difference of frequencies up to which modes count as of one frequency
_FEW = 4  # pushes for which the core need not be loaded


class Radiation(Protocol):
    """A law of how loudly the modes of a surface reach the far field.

    It may have an attribute `scalable`: True if the pressure goes as size times shapes where the
    frequencies go as 1 / size, so that a body of another size needs no new computation.
    """

    name: str
    calibrated: bool
    references: tuple[str, ...]

    def coefficients(
        self, surface: Mesh, shapes: NDArray[np.floating], frequencies: Array, centre: Array
    ) -> Complex:
        """Return the pressure at 1 m for unit modal velocity, Pa/(kg^1/2 m/s) or relative (M,)."""
        ...


@runtime_checkable
class LossyRadiation(Protocol):
    """A law of radiation that also computes what the air takes from each mode."""

    def radiation(
        self, surface: Mesh, shapes: NDArray[np.floating], frequencies: Array, centre: Array
    ) -> tuple[Complex, AirLosses]:
        """Return the coefficients of `Radiation`, Pa/(kg^1/2 m/s) (M,), and the losses."""
        ...


@runtime_checkable
class SkinRadiation(Protocol):
    """A law of radiation from the outer surface of a body into a medium."""

    air: Air

    def skin_motion(
        self, surface: Mesh, shapes: NDArray[np.floating], centre: Array
    ) -> tuple[float, Array]:
        """Return the area, m^2, and the mean squares (M,) of the normal shapes on it, 1/kg."""
        ...


class Keep(Protocol):
    """A store that keeps finished parts of long work between runs."""

    def __call__(self, compute: Callable[[], Any], /, **inputs: object) -> Any:  # noqa: ANN401
        """Return the stored result for the same inputs, or compute and store it."""
        ...


@runtime_checkable
class FieldRadiation(Protocol):
    """A law of radiation that can also compute the sound around a body."""

    def field(
        self,
        gains: ShapeGains,
        frequencies: Array,
        *,
        band: tuple[float, float],
        near: bool,
        keep: Keep | None,
        progress: Progress,
    ) -> tuple[ShapeGains, Index, float]:
        """Return gains with a timbre field of a band, the modes left out, and the worst error."""
        ...


class Gains(ABC):
    """Drive (contact side) and output (listener side) of each mode, as a sum over R products."""

    @property
    @abstractmethod
    def calibrated(self) -> bool:
        """Whether gains are Pa/(N s), not relative."""

    @abstractmethod
    def changed(self, frequencies: Array, modes: Index, size: float, density: float) -> Gains:
        """Compute the gains of chosen modes of a body with other frequencies, size or density.

        Parameters
        ----------
        frequencies : array (K,)
            Frequencies of the chosen modes, Hz.
        modes : array (K,) of int
            Numbers of the chosen modes.
        size : float
            Ratio of the new to the present size.
        density : float
            Ratio of the new to the present density.

        Returns
        -------
        Gains
            Gains of the changed body.
        """

    @abstractmethod
    def at(self, points: Array, directions: Array) -> Array:
        """Compute the drive of unit impulses.

        Parameters
        ----------
        points : array (K, D)
            Contacts: points in body coordinates, m (D = 3), or coordinates of a recorded body.
        directions : array (K, 3)
            Unit directions of the pushes.

        Returns
        -------
        array (K, R, M)
            Drive of each product and mode.
        """

    @abstractmethod
    def toward(self, listeners: Array) -> Complex:
        """Compute the output at listeners, relative to the arrival time r/c.

        Parameters
        ----------
        listeners : array (L, 3)
            Positions in body coordinates, m.

        Returns
        -------
        array (L, R, M), complex
            Output of each product and mode.
        """

    def motion(self, points: Array) -> Array:
        """Compute the displacement of each mode along A axes.

        Parameters
        ----------
        points : array (K, D)
            Contacts: points in body coordinates, m (D = 3), or coordinates of a recorded body.

        Returns
        -------
        array (K, A, R, M)
            Displacements.
        """
        return self.at(points, np.zeros((len(points), 3)))[:, None]

    def deconvolved(self, spectrum: Complex) -> Gains:
        """Divide a recorded strike out of the gains.

        Parameters
        ----------
        spectrum : array (M,), complex
            Spectrum of the recorded strike at the pole of each mode.

        Returns
        -------
        Gains
            Gains for a force in N.

        Raises
        ------
        OptionError
            If the gains contain no strike.
        """
        del spectrum
        raise OptionError(f"{type(self).__name__} hold no recorded blow: leave blow= out")

    @property
    def directional(self) -> bool:
        """Whether places of the same distance hear differently: whether there is a timbre field."""
        return False

    @property
    def axial(self) -> bool:
        """Whether the body was recorded as round about the z axis through its centre."""
        return False

    @property
    def bounds(self) -> tuple[Array, Array] | None:
        """Lowest and highest contact coordinates (D,) that were recorded; None without any."""
        return None

    @property
    def of_surface(self) -> bool:
        """True when drives take a force in N; False when the recorded blow is part of the gain."""
        return False

    @property
    def rank(self) -> int:
        """Number of products of a contact and a listener part, R."""
        return 1

    @property
    def count(self) -> int | None:
        """How many modes it has gains of, M; None for as many as the model has."""
        return None

    @property
    def axes(self) -> int | None:
        """How many coordinates a contact has; None for any number."""
        return None

    def expanded(self) -> Gains:
        """Return the same gains as those of more modes with one product each.

        Returns
        -------
        Gains
            Gains of R M modes with one product each, mode by mode for each product.
        """
        return self if self.rank == 1 else ExpandedGains(products=self)


class RecordedGains(Gains):
    """Gains of recordings, which may hold the blow, and be relative."""

    is_calibrated: bool
    is_deconvolved: bool

    @property
    def calibrated(self) -> bool:
        """Whether gains are Pa/(N s), not relative."""
        return self.is_calibrated

    @property
    def of_surface(self) -> bool:
        """Whether drives take a force in N."""
        return self.is_deconvolved


@dataclass(frozen=True, kw_only=True, eq=False)
class ExpandedGains(Gains):
    """Gains whose R products for each of M modes count as R M modes, as resonators need them."""

    products: Gains

    @property
    def directional(self) -> bool:
        """Whether the products differ between directions."""
        return self.products.directional

    @property
    def axial(self) -> bool:
        """Whether the body was recorded as round about an axis."""
        return self.products.axial

    @property
    def bounds(self) -> tuple[Array, Array] | None:
        """Lowest and highest value of each of the D coordinates of a contact (D,)."""
        return self.products.bounds

    @property
    def of_surface(self) -> bool:
        """Whether drives take a force in N, as on a computed surface."""
        return self.products.of_surface

    @property
    def calibrated(self) -> bool:
        """Whether gains are Pa/(N s), not relative."""
        return self.products.calibrated

    @property
    def count(self) -> int | None:
        """Number of modes that the gains are of, R M."""
        return None if self.products.count is None else self.products.count * self.products.rank

    @property
    def axes(self) -> int | None:
        """Number of coordinates of a contact, D."""
        return self.products.axes

    def changed(self, frequencies: Array, modes: Index, size: float, density: float) -> Gains:
        """Refuse: a model is changed before it is expanded."""
        del frequencies, modes, size, density
        raise OptionError("expanded gains cannot be changed: change the model, then expand it")

    def at(self, points: Array, directions: Array) -> Array:
        """Return the drive of unit impulses (K, 1, R M)."""
        drives = self.products.at(points, directions)
        return drives.reshape(len(drives), 1, -1)

    def motion(self, points: Array) -> Array:
        """Return how far each mode moves (K, A, 1, R M)."""
        motions = self.products.motion(points)
        return motions.reshape(*motions.shape[:2], 1, -1)

    def toward(self, listeners: Array) -> Complex:
        """Return the output at listeners (L, 1, R M)."""
        outputs = self.products.toward(listeners)
        return outputs.reshape(len(outputs), 1, -1)


@dataclass(frozen=True, kw_only=True, eq=False)
class ShapeGains(Gains):
    """Gains of a body whose mode shapes are known on its surface, heard equally all around.

    Parameters
    ----------
    surface : Mesh
        Surface of the body.
    shapes : array (V, 3, M), float32
        Mass-normalised mode shapes at its vertices, kg^-1/2.
    outputs : array (M,), complex
        Pressure at 1 m for unit modal velocity.
    centre : array (3,)
        Acoustic centre, the centre of mass, m.
    radiation : Radiation
        Estimate that computed `outputs`, used again if frequencies or size change.
    formula : TransverseShapes or None, default None
        Mode shapes in closed form, at any point.
    losses : AirLosses or None, default None
        Losses to the air, of a calibrated estimate of radiation.
    """

    __repr__ = brief
    surface: Mesh
    shapes: NDArray[np.float32]
    outputs: Complex
    centre: Array
    radiation: Radiation
    formula: TransverseShapes | None = None
    losses: AirLosses | None = None

    def __post_init__(self) -> None:
        modes = np.shape(self.outputs)[-1:]
        for name, shape in (
            ("shapes", (len(self.surface.points), 3, *modes)),
            ("outputs", modes),
            ("centre", (3,)),
        ):
            require_numbers(name, getattr(self, name), shape)
        if self.losses is not None:
            require_numbers("losses", self.losses.sound, modes)

    @classmethod
    def radiating(
        cls,
        surface: Mesh,
        shapes: NDArray[np.floating],
        frequencies: Array,
        centre: Array,
        radiation: Radiation,
        formula: TransverseShapes | None = None,
    ) -> ShapeGains:
        """Make gains whose outputs `radiation` computes.

        Parameters
        ----------
        surface : Mesh
            Surface with N points.
        shapes : array (N, 3, M)
            Mode shapes at the points, kg^(-1/2).
        frequencies : array (M,)
            Natural frequencies, Hz.
        centre : array (3,)
            Centre of the radiated sound, m.
        radiation : Radiation
            Estimate that computes the outputs.
        formula : TransverseShapes, optional
            Mode shapes in closed form, which contacts then use.

        Returns
        -------
        ShapeGains
            The gains.
        """
        # Outputs are those of the shapes as they are stored: of a mode that radiates little,
        # rounding is most of the sum, and a copy or a file of the body must give the same again.
        single_shapes = np.ascontiguousarray(shapes, np.float32)
        arguments = surface, single_shapes.astype(np.float64), frequencies, centre
        if isinstance(radiation, LossyRadiation):
            coefficients, losses = radiation.radiation(*arguments)
            twins = _twin_groups(np.asarray(frequencies))
            losses = losses.means(twins)
            levels = np.sqrt(group_means(twins, np.square(np.abs(coefficients))))
            outputs = levels * np.exp(1j * np.angle(coefficients))
        else:
            outputs, losses = radiation.coefficients(*arguments), None
        return cls(
            surface=surface,
            shapes=single_shapes,
            outputs=outputs,
            centre=np.asarray(centre, np.float64),
            radiation=radiation,
            formula=formula,
            losses=losses,
        )

    def changed(self, frequencies: Array, modes: Index, size: float, density: float) -> ShapeGains:
        """Compute the gains of chosen modes of a body with other frequencies, size or density.

        Parameters
        ----------
        frequencies : array (K,)
            Frequencies of the chosen modes, Hz.
        modes : array (K,) of int
            Numbers of the chosen modes.
        size : float
            Ratio of the new to the present size.
        density : float
            Ratio of the new to the present density.

        Returns
        -------
        ShapeGains
            Gains of the changed body.
        """
        surface, shapes, centre, formula = self._moving(modes, size, density)
        return ShapeGains.radiating(surface, shapes, frequencies, centre, self.radiation, formula)

    def similar(self, size: float, density: float) -> ShapeGains:
        """Compute the gains of a body whose frequencies have changed as 1 / size alone.

        Only for an estimate of radiation that is scalable; both arguments are ratios.

        Parameters
        ----------
        size : float
            Ratio of the new to the present size.
        density : float
            Ratio of the new to the present density.

        Returns
        -------
        ShapeGains
            Gains of the changed body.
        """
        modes = np.arange(self.count)
        surface, shapes, centre, formula = self._moving(modes, size, density)
        return replace(
            self,
            surface=surface,
            shapes=np.ascontiguousarray(shapes, np.float32),
            # Size times the factor of the shapes.
            outputs=self.outputs * (size * (density * size**3) ** -0.5),
            centre=np.asarray(centre, np.float64),
            formula=formula,
            losses=None if self.losses is None else self.losses.scaled(size, density),
        )

    def weighted(self, modes: Index, factors: Array) -> ShapeGains:
        """Select modes, and multiply their shapes and outputs.

        Losses are those of the modes themselves, whatever their factors.

        Parameters
        ----------
        modes : array (K,) of int
            Numbers of the modes.
        factors : array (K,)
            Factor of shapes and of outputs.

        Returns
        -------
        ShapeGains
            Gains of the selected modes.
        """
        formula = self.formula
        return replace(
            self,
            shapes=(self.shapes[:, :, modes] * factors).astype(np.float32),
            outputs=self.outputs[modes] * factors,
            formula=None if formula is None else formula.chosen(modes).signed(factors),
            losses=None if self.losses is None else self.losses.chosen(modes),
        )

    def _moving(
        self, modes: Index, size: float, density: float
    ) -> tuple[Mesh, Array, Array, TransverseShapes | None]:
        """Return surface, shapes, centre and formula of some modes at another size or density.

        Mass-normalised shapes go with (density size^3)^(-1/2).
        """
        factor = (density * size**3) ** -0.5
        surface = self.surface if size == 1 else self.surface.scaled(size)
        shapes = self.shapes[:, :, modes].astype(np.float64) * factor
        formula = None if self.formula is None else self.formula.chosen(modes, size, density)
        return surface, shapes, self.centre * size, formula

    @property
    def of_surface(self) -> bool:
        """True: forces act on the body's surface."""
        return True

    @property
    def count(self) -> int:
        """Number of modes that the gains are of, M."""
        return len(self.outputs)

    @property
    def calibrated(self) -> bool:
        """Whether gains are Pa/(N s), not relative."""
        return self.radiation.calibrated

    @cached_property
    def locator(self) -> Surface:
        """The surface as a place to look contacts up on."""
        return self.surface.locator

    @cached_property
    def radius(self) -> float:
        """Radius of the smallest ball about `centre` that holds the body, m."""
        return float(np.linalg.norm(self.surface.points - self.centre, axis=1).max())

    def at(self, points: Array, directions: Array, faces: Index | None = None) -> Array:
        """Interpolate the mode shapes at the nearest surface points, along unit directions.

        Parameters
        ----------
        points : array (K, 3)
            Points, m.
        directions : array (K, 3)
            Unit directions of the pushes.
        faces : array (K,) of int, optional
            Faces on which the points lie. Default: found by search.

        Returns
        -------
        array (K, 1, M)
            Drive of each mode, kg^-1/2.
        """
        pushes = np.reshape(directions, (-1, 3))
        if self.formula is not None:
            shapes = self.formula.displacements(points)
            return np.einsum("kd,kdm->km", pushes, shapes)[:, None, :]
        if faces is None:
            _, faces, points = self.locator.closest(points)
        corners = self.surface.faces[faces]
        return shapes_along(self.surface.points, self.shapes, corners, points, pushes)[:, None, :]

    def motion(self, points: Array) -> Array:
        """Interpolate the mode shapes at the nearest surface points, along x, y and z.

        Parameters
        ----------
        points : array (K, 3)
            Points, m.

        Returns
        -------
        array (K, 3, 1, M)
            Mode shapes, kg^-1/2.
        """
        return self.shapes_at(points)[:, :, None]

    def shapes_at(self, points: Array) -> Array:
        """Interpolate the mode shapes at the nearest surface points.

        Parameters
        ----------
        points : array (K, 3)
            Points, m.

        Returns
        -------
        array (K, 3, M)
            Mode shapes, kg^-1/2.
        """
        if self.formula is not None:
            return self.formula.displacements(points)
        faces, weights = self.locator.barycentric(points)
        corners = self.surface.faces[faces]
        return np.einsum("kc,kcdm->kdm", weights, self.shapes[corners].astype(np.float64))

    def toward(self, listeners: Array) -> Complex:
        """Compute outputs that fall as 1/r from the centre of mass, and are constant near it.

        They are constant within the radius of the sphere of the same area, as the sound comes from
        all of the surface at once.

        Parameters
        ----------
        listeners : array (L, 3)
            Positions in body coordinates, m.

        Returns
        -------
        array (L, 1, M), complex
            Output of each mode.
        """
        distances = self._distances(in_space(listeners))
        nearest = min(self.surface.reach, self.radius)
        return self.outputs / np.maximum(distances, nearest)[:, None, None]

    def _distances(self, places: Array) -> Array:
        """Return distances (L,) from the centre; ContactError where a place is inside the body."""
        distances = np.linalg.norm(places - self.centre, axis=1)
        close = places[distances < self.radius]
        if len(close) and (is_inside := self.locator.holds(close)).any():
            place = tuple(close[int(np.argmax(is_inside))].tolist())
            raise ContactError(
                f"a listener is at {place} m, inside the body's surface: move it outside"
            )
        return distances


def shapes_along(
    points: Array, shapes: Single, corners: Index, places: Array, ways: Array
) -> Array:
    """Return shapes (V, 3, M) along directions `ways` (K, 3): (K, M).

    At places (K, 3) on the faces between corners (K, 3), which are numbers of points (V, 3).
    """
    arguments = (points, shapes, corners, places, ways)
    count, modes = len(corners), shapes.shape[2]
    fits = shapes.flags.c_contiguous and shapes.flags.aligned and shapes.dtype == np.float32
    if count < _FEW or not fits:
        return shapes_along_plainly(*arguments)
    from struck.core import entry

    core_function = entry("shapes_along")
    if core_function is None:
        return shapes_along_plainly(*arguments)
    displacements, pushes = np.empty((count, modes)), np.ascontiguousarray(ways)
    core_function(
        points, shapes, modes, corners, np.ascontiguousarray(places), pushes, count, displacements
    )
    return displacements


def shapes_along_plainly(
    points: Array, shapes: Single, corners: Index, places: Array, ways: Array
) -> Array:
    """Return mode shapes along directions like `shapes_along`, in plain NumPy."""
    weights = barycentric(points[corners], places)
    return np.einsum("kc,kd,kcdm->km", weights, ways, shapes[corners].astype(np.float64))


def _twin_groups(frequencies: Array) -> Index:
    """Return for each mode (M,) the number of its group of modes of one frequency."""
    # These are turned copies of one another, which radiate the same power; their estimates differ
    # by their angle to the faces.
    steps = np.abs(np.diff(frequencies, prepend=-np.inf))
    return np.cumsum(steps > _TWIN_RATIO * frequencies) - 1


def quarter_turns(frequencies: Array) -> Complex:
    """Return a phase for each mode (M,): i for every second mode of a shared frequency."""
    # A round body has its modes in pairs, which a solver may turn about the axis at will. An
    # estimate the same in all directions must not depend on that turn: a quarter period apart,
    # the two add to the root of their drives' squares, whichever way they are turned.
    phases = np.ones(len(frequencies), np.complex128)
    for mode in range(1, len(frequencies)):
        close = frequencies[mode] - frequencies[mode - 1] < _SHARED * frequencies[mode]
        if close and phases[mode - 1] == 1:
            phases[mode] = 1j
    return phases


def canonical_signs(surface: Mesh, shapes: NDArray[np.floating]) -> Array:
    """Return +1 or -1 for each mode (M,), so that any solver's shapes get the same sign."""
    # The sign is that of the volume displaced, weighted by a function without symmetry; a face
    # moves as the mean of its corners, so each corner carries a third of its weight.
    place = (surface.centroids - surface.bounds.mean(axis=0)) / surface.extent
    weights = np.exp(place @ np.array([2.0, 1.3, 0.7]))[:, None] * surface.area_vectors
    at_corners = np.zeros_like(surface.points)
    for corner in surface.faces.T:
        np.add.at(at_corners, corner, weights / 3)
    return np.where(np.tensordot(at_corners, shapes, 2) < 0, -1.0, 1.0)

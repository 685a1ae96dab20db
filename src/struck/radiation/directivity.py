"""Directivity: gains of a body whose sound was computed all around it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from struck.errors import ContactError, OptionError, rounded
from struck.model.air_losses import AirLosses, decays_of_pressures
from struck.model.arrays import Array, Complex, Index, brief
from struck.model.gains import ShapeGains, quarter_turns
from struck.model.material import AIR
from struck.model.mesh import in_space
from struck.radiation.boundary_elements import SurfaceField, edge_length
from struck.radiation.multipoles import CLOSE, FAR, Multipoles

_SAME_RATIO = 1e-9  # relative: frequencies closer than this are the same
# Depth that elements cut off, and distance of places from them, in edges of elements.
_CUT, _CLEARANCE = 0.1, 1e-3
_IMPULSE = 1j  # a unit impulse leaves the modal velocity cos wt, the imaginary part of i exp(iwt)


# A subclass, so that they are accepted wherever `ShapeGains` are.
@dataclass(frozen=True, kw_only=True, eq=False)
class RadiatingGains(ShapeGains):
    """Gains of a body with its computed timbre field: each mode's own pattern in space.

    Parameters
    ----------
    field : Multipoles
        The sound about the centre, right from 1.5 radii on, and with larger errors from 1.2.
    near : tuple of SurfaceField
        Fields on the surface, from which the sound within 1.5 radii is computed, up to the surface
        and into a bowl. Default: ().

    Raises
    ------
    OptionError
        Where field and shapes are not of the same modes.

    Notes
    -----
    `outputs` are root mean squares over directions, a measure of how loud a mode is. The
    estimate in `radiation` takes over where frequencies change by more than the size.
    """

    __repr__ = brief
    field: Multipoles
    near: tuple[SurfaceField, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.field.count != len(self.outputs):
            raise OptionError(
                f"the field has {self.field.count} modes, and the shapes {len(self.outputs)}: "
                "compute the field of all modes"
            )

    @classmethod
    def of(
        cls,
        gains: ShapeGains,
        frequencies: Array,
        parts: Sequence[SurfaceField],
        *,
        near: bool = False,
    ) -> RadiatingGains:
        """Make gains of a body from the fields computed on its surface.

        Modes in no part keep their estimate, which is the same in all directions.

        Parameters
        ----------
        gains : ShapeGains
            With the estimate, calibrated.
        frequencies : array (M,)
            Natural ones, Hz.
        parts : sequence of SurfaceField
            Each of other modes.
        near : bool
            Whether the parts are kept, for listeners within 1.2 radii.

        Raises
        ------
        OptionError
            Where gains are relative, or there are no parts.
        """
        if not (gains.calibrated and parts):
            raise OptionError(
                f"{len(parts)} computed fields for gains by {gains.radiation.name!r}: give at "
                "least one field, and gains in Pa, as by radiation='power'"
            )
        wave_numbers = 2 * np.pi * np.asarray(frequencies, np.float64) / AIR.sound_speed
        multipoles = [
            Multipoles.fit(
                part.pressure,
                centre=gains.centre,
                radius=gains.radius,
                wave_numbers=part.wave_numbers,
            )
            for part in parts
        ]
        pairs = [(part.modes, waves) for part, waves in zip(parts, multipoles, strict=True)]
        field = Multipoles.join(pairs, gains.outputs / _IMPULSE, wave_numbers)
        new_gains = replace(
            gains,
            outputs=field.levels * quarter_turns(frequencies),
            losses=_losses_of_field(gains.losses, parts, field.levels),
        )
        return cls.with_field(new_gains, field=field, near=tuple(parts) if near else ())

    @classmethod
    def with_field(
        cls, gains: ShapeGains, *, field: Multipoles, near: tuple[SurfaceField, ...] = ()
    ) -> RadiatingGains:
        """Return gains with a computed field in place of the estimate without directions."""
        return cls(**_parts(gains), field=field, near=near)

    @property
    def averaged(self) -> ShapeGains:
        """Gains that are the same in all directions: the root mean square over them."""
        return ShapeGains(**_parts(self))

    @property
    def directional(self) -> bool:
        """True: the sound differs with the direction of the listener."""
        return True

    def changed(self, frequencies: Array, modes: Index, size: float, density: float) -> ShapeGains:
        """Return the gains of chosen `modes` of a body with other frequencies, size or density.

        The field is scaled if frequencies are proportional to 1 / size, else the estimate
        replaces it.
        """
        wave_numbers = 2 * np.pi * frequencies * size / AIR.sound_speed
        if not np.allclose(wave_numbers, self.field.wave_numbers[modes], rtol=_SAME_RATIO, atol=0):
            return super().changed(frequencies, modes, size, density)
        factor = (density * size**3) ** -0.5
        surface, shapes, centre, formula = self._moving(modes, size, density)
        new_gains = ShapeGains(
            surface=surface,
            shapes=np.ascontiguousarray(shapes, np.float32),
            outputs=self.outputs[modes] * (factor * size),
            centre=centre,
            radiation=self.radiation,
            formula=formula,
            losses=None if self.losses is None else self.losses.chosen(modes).scaled(size, density),
        )
        return self._with_changed_field(new_gains, modes, size, factor)

    def weighted(self, modes: Index, factors: Array) -> RadiatingGains:
        """Return the gains of some modes, shapes and outputs each times a factor (K,)."""
        return self._with_changed_field(self.averaged.weighted(modes, factors), modes, 1.0, factors)

    def _with_changed_field(
        self, gains: ShapeGains, modes: Index, size: float, factor: float | Array
    ) -> RadiatingGains:
        """Return the field of some modes over shapes of another size, times a factor."""
        surface_fields = [part.chosen(modes, size, factor) for part in self.near]
        near_fields = tuple(part for part in surface_fields if part is not None)
        return self.with_field(
            gains, field=self.field.chosen(modes, size, factor), near=near_fields
        )

    def toward(self, listeners: Array) -> Complex:
        """Return the output at `listeners` (L, 3), relative to the arrival time r/c: (L, 1, M).

        Raises
        ------
        ContactError
            Inside the body; within 1.2 radii where nothing is kept of its surface.
        """
        places = in_space(listeners)
        distances = self._distances(places)
        outputs = np.zeros((len(places), self.field.count), np.complex128)
        # Where the waves miss more than 1 %, the field of the surface is blended in.
        reach = FAR if self.near else np.nextafter(CLOSE, 2.0)
        weights = np.clip((reach - distances / self.field.radius) / (reach - CLOSE), 0.0, 1.0)
        is_far, is_close = weights < 1, weights > 0
        if is_far.any():
            outputs[is_far] = _IMPULSE * self.field.at(places[is_far] - self.centre)
        if is_close.any():
            difference = (
                self._outputs_near_surface(places[is_close], distances[is_close])
                - outputs[is_close]
            )
            outputs[is_close] += weights[is_close, None] * difference
        return outputs[:, None]

    def _outputs_near_surface(self, places: Array, distances: Array) -> Complex:
        """Return the output at places (L, 3) near the surface, relative to the arrival: (L, M)."""
        if not self.near:
            raise ContactError(
                f"a listener is {rounded(distances.min(), 3)} m from the body's centre, and its "
                f"timbre field reaches in to {rounded(CLOSE * self.field.radius, 3)} m: move it "
                "away, or compute the field with near=True, which keeps the pressure on the "
                "surface as well"
            )
        min_distance = min(self.surface.reach, self.radius)
        outputs = self.outputs / np.maximum(distances, min_distance)[:, None]
        for part in self.near:
            arrivals = np.exp(1j * np.multiply.outer(distances, part.wave_numbers))
            all_modes = np.arange(len(part.modes))
            outputs[:, part.modes] = (
                _IMPULSE * part.pressure(_move_outside(part, places), all_modes) * arrivals
            )
        return outputs


def _move_outside(part: SurfaceField, places: Array) -> Array:
    """Return places (L, 3) moved out of the elements, which cut corners of the body's surface.

    Raises ContactError where one is deeper in them: so it is in a cavity that is closed.
    """
    is_inside = part.mesh.locator.holds(places)
    if not is_inside.any():
        return places
    distances, faces, surface_points = part.mesh.locator.closest(places[is_inside])
    edge = edge_length(part.mesh)
    if distances.max() > _CUT * edge:
        raise ContactError(
            f"a listener is {rounded(distances.max(), 2)} m within the elements of the timbre "
            f"field, and {rounded(_CUT * edge, 2)} m at most is near their surface: it is in a "
            "cavity of the body that is closed, so move it out"
        )
    new_places = places.copy()
    new_places[is_inside] = surface_points + _CLEARANCE * edge * part.mesh.face_normals[faces]
    return new_places


def _losses_of_field(
    losses: AirLosses | None, parts: Sequence[SurfaceField], levels: Array
) -> AirLosses | None:
    """Return losses whose sound is that of computed fields, for the modes that have one.

    `levels` (M,) are the root mean squares of the pressure over directions at 1 m.
    """
    if losses is None:
        return None
    sound, uncertainty = losses.sound.copy(), losses.uncertainty.copy()
    for part in parts:
        sound[part.modes] = decays_of_pressures(levels[part.modes], AIR.impedance)
        uncertainty[part.modes] = 20 * np.log10(1 + part.errors)
    return replace(losses, sound=sound, uncertainty=uncertainty)


def _parts(gains: ShapeGains) -> dict[str, Any]:
    """Return the modes' shapes and all else of which gains are made."""
    return {field.name: getattr(gains, field.name) for field in fields(ShapeGains)}

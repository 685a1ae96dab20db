"""Gains of a model sampled at contacts and listeners, as files of timbre fields hold them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError, require_choice
from struck.model.arrays import Array, Complex, Index
from struck.model.contact import Place
from struck.model.gains import ExpandedGains, Gains, ShapeGains
from struck.model.model import ModalModel
from struck.model.provenance import Provenance
from struck.model.survey import Survey, from_spherical
from struck.model.timbre_field import TimbreField
from struck.model.timbre_table import SinglePoint, TimbreTable, combinations


def unexpanded(gains: Gains) -> Gains:
    """Return gains as they were recorded or computed, before their products became modes."""
    return gains.products if isinstance(gains, ExpandedGains) else gains


def recorded_contacts(gains: Gains) -> Array | None:
    """Return the contacts (P, D) that were recorded; None of gains that were computed."""
    recorded_gains = unexpanded(gains)
    if isinstance(recorded_gains, SinglePoint):
        return np.zeros((1, 0))
    if isinstance(recorded_gains, TimbreTable):
        return combinations(recorded_gains.contacts.axes)
    if not isinstance(recorded_gains, TimbreField):
        return None
    part = recorded_gains.contact_part
    places = part.lowest + part.contacts * part.spans
    # Contacts of a round body struck all around, each height once: the azimuth makes no difference.
    return np.column_stack(
        [places, np.zeros((len(places), int(recorded_gains.listener_part.turned)))]
    )


def recorded_listeners(gains: Gains) -> Array | None:
    """Return the listeners (Q, 3) that were recorded, m; None of gains that were computed."""
    recorded_gains = unexpanded(gains)
    if isinstance(recorded_gains, SinglePoint):
        return recorded_gains.centre + np.eye(3)[:1]
    if isinstance(recorded_gains, TimbreTable):
        return _grid_places(recorded_gains)
    if not isinstance(recorded_gains, TimbreField):
        return None
    # A field keeps waves, not who heard them outside: 45 directions at the distance of the nearest
    # listener and at twice that, for how they fall. Listeners inside follow as they were.
    waves, inner_places = (
        recorded_gains.listener_part.waves,
        recorded_gains.listener_part.inside.places,
    )
    rings = [_all_around(far * waves.limit, len(waves.parts) - 1) for far in (2, 4)]
    return recorded_gains.centre + np.concatenate([*rings, inner_places])


def _grid_places(table: TimbreTable) -> Array:
    """Return one place for each listener of a table (Q, 3), m."""
    nodes = combinations(table.listeners.axes)
    places = from_spherical(*nodes.T) if table.system == "spherical" else nodes
    _, first = np.unique(table.listeners.sources, return_index=True)
    return (places[first] + table.centre) * table.size


def _all_around(distance: float, order: int) -> Array:
    """Return places (n, 3) that distinguish all waves up to an order."""
    # Gauss-Legendre nodes in the cosine of the polar angle, equal steps in azimuth (E. G. Williams,
    # Fourier Acoustics, Academic Press, 1999, section 6.3).
    heights, _ = np.polynomial.legendre.leggauss(order + 1)
    azimuths = np.arange(2 * order + 1) * (2 * np.pi / (2 * order + 1))
    polar, azimuth = np.meshgrid(np.arccos(heights), azimuths, indexing="ij")
    return from_spherical(distance, azimuth.ravel(), polar.ravel())


RECORDED = "recorded"  # default contact of a model of recordings
WAYS = ("field", "table")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Origin:
    """The model that gains were sampled from: its provenance, errors and doubtful modes."""

    provenance: Provenance = field(default_factory=Provenance)
    errors: Array | None = None  # (M,), relative, of frequencies; NaN where unknown
    # modes of a `TimbreField` of which a part is little known
    unmeasured: Index = field(default_factory=lambda: np.zeros(0, np.int64))
    notes: tuple[str, ...] = ()  # for users of such a field
    place: Array | None = None  # (D,), the contact that it called "recorded"

    @classmethod
    def of(cls, model: ModalModel) -> Origin:
        """Return the origin of a model's gains: provenance, errors and notes."""
        place = model.places.get(RECORDED)
        origin = cls(provenance=model.provenance, errors=model.errors, place=place)
        gains = unexpanded(model.gains)
        if not isinstance(gains, TimbreField):
            return origin
        return replace(origin, unmeasured=gains.unmeasured, notes=gains.notes)

    def chosen(self, modes: Index) -> Origin:
        """Return the origin of some modes, in their order."""
        return replace(
            self,
            errors=None if self.errors is None else self.errors[modes],
            unmeasured=np.flatnonzero(np.isin(modes, self.unmeasured)),
        )

    def annotated(self, gains: Gains) -> Gains:
        """Return sampled gains with the doubts of their origin; rank errors become unknown."""
        if not isinstance(gains, TimbreField):
            return gains
        errors = np.full_like(gains.rank_errors, np.nan)
        return replace(gains, rank_errors=errors, unmeasured=self.unmeasured, notes=self.notes)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SampledField:
    """The gains of every contact with every listener."""

    frequencies: Array  # (M,), ringing, Hz
    decays: Array  # (M,), 1/s
    contacts: Array  # (P, D): u, or u and v, or x, y, z in m
    listeners: Array  # (Q, 3), body coordinates, m
    gains: Complex  # (P, Q, M), relative to the arrival time r/c, with r from the centre
    centre: Array  # (3,), where the sound seems to come from, m
    symmetry: str = "none"  # "none" or "axial", as in `Survey`
    calibrated: bool = False  # gains are Pa/(N s), not relative
    coordinates: tuple[str, ...] = ()  # names and units of a contact's coordinates
    title: str = ""
    interpolation: str = "field"  # by its model: "field" or "table"
    radius: float = 0.0  # of a ball about the centre that holds the body, m; 0 where not known
    origin: Origin | None = None  # of gains sampled from a model; None of measured ones

    @classmethod
    def of(
        cls,
        model: ModalModel,
        contacts: ArrayLike | Sequence[Place] | None = None,
        listeners: ArrayLike | None = None,
    ) -> SampledField:
        """Take the gains of a model at contacts (P, D) or named places, and listeners (Q, 3)."""
        model_gains = unexpanded(model.gains)
        contacts = recorded_contacts(model_gains) if contacts is None else contacts
        listeners = recorded_listeners(model_gains) if listeners is None else listeners
        if contacts is None or listeners is None:
            raise OptionError(
                "a computed model has gains everywhere: to sample them give contacts=, as names or "
                "points in m, and listeners=, as x, y, z in m"
            )
        places, directions = _find_contacts(model, contacts)
        positions = np.asarray(listeners, np.float64)
        if positions.ndim != 2 or positions.shape[1:] != (3,) or not positions.size:
            raise OptionError(f"listeners have shape {positions.shape}: give x, y, z of each, m")
        drives = model.gains.at(places, directions)
        gains = np.einsum("prm,qrm->pqm", drives, model.gains.toward(positions))
        if not np.isfinite(gains).all():
            raise OptionError("the model has gains that are not finite: fit or analyze it again")
        return cls(
            frequencies=model.frequencies,
            decays=model.decays,
            contacts=places,
            listeners=positions,
            gains=gains,
            centre=_centre(model),
            symmetry="axial" if _is_axial(model_gains) else "none",
            calibrated=model.calibrated,
            coordinates=model.coordinates,
            interpolation="table" if isinstance(model_gains, TimbreTable) else "field",
            radius=float(getattr(model_gains, "radius", 0.0)),
            origin=Origin.of(model),
        )

    def survey(self) -> Survey:
        """Return the gains as of a measurement; OptionError for contacts of three coordinates."""
        if self.contacts.shape[1] > 2:
            raise OptionError(
                "its contacts have 3 coordinates, and fields are interpolated over 1 or 2: give "
                "`contacts` as coordinates on the surface, or use `gains` as they are"
            )
        measured = self.contacts, self.listeners, self.gains, self.frequencies
        return Survey.full(
            *measured, centre=self.centre, symmetry=self.symmetry, calibrated=self.calibrated
        )

    def model(self, interpolation: str | None = None, *, radius: float | None = None) -> ModalModel:
        """Return the modal model: a product of contact and listener patterns, or a linear table."""
        chosen = self.interpolation if interpolation is None else interpolation
        require_choice("interpolation", chosen, WAYS)
        natural = np.hypot(self.frequencies, self.decays / (2 * np.pi))
        order = np.argsort(natural, kind="stable")
        sorted_field = replace(
            self,
            frequencies=self.frequencies[order],
            decays=self.decays[order],
            gains=self.gains[:, :, order],
        )
        numbered_field, places = _number_places(sorted_field)
        origin = Origin() if self.origin is None else self.origin.chosen(order)
        method = origin.provenance.method
        gains = _interpolate(numbered_field, chosen, self.radius if radius is None else radius)
        return ModalModel(
            frequencies=sorted_field.frequencies,
            natural_frequencies=natural[order],
            decays=sorted_field.decays,
            gains=gains if self.origin is None else origin.annotated(gains),
            centre=self.centre,
            complete_to=0.0,
            errors=origin.errors,
            places=places,
            coordinates=numbered_field.coordinates
            or ("u", "v")[: numbered_field.contacts.shape[1]],
            provenance=Provenance(
                method=f"timbre {chosen} of sampled gains",
                references=origin.provenance.references,
                dropped=origin.provenance.dropped,
                details={"sampled_from": method} if method else {},
            ),
        )


def _number_places(field: SampledField) -> tuple[SampledField, dict[str, Array]]:
    """Return a field with contacts by number where they are points in space, and their names."""
    # A contact without coordinates is the recorded one; of several it is that which a model called
    # so, else that of most energy. Between points in space nothing is known.
    count, axes = field.contacts.shape
    if axes in {1, 2}:
        known = None if field.origin is None else field.origin.place
        if known is not None and known.shape == (axes,):
            return field, {RECORDED: known}
        energies = (np.abs(field.gains) ** 2 / np.maximum(field.decays, 1e-6)).sum(axis=(1, 2))
        return field, {RECORDED: field.contacts[energies.argmax()]}
    if axes == 0 and field.gains.shape[:2] == (1, 1):
        return field, {RECORDED: field.contacts[0]}
    numbers = np.arange(1.0, count + 1)[:, np.newaxis]
    names = {f"contact {number}": numbers[number - 1] for number in range(1, count + 1)}
    return replace(field, contacts=numbers, coordinates=("number of contact",)), names


def _interpolate(field: SampledField, interpolation: str, radius: float) -> Gains:
    if not field.contacts.shape[1]:
        distance = float(np.linalg.norm(field.listeners[0] - field.centre))
        return SinglePoint(
            outputs=field.gains[0, 0] * distance,
            centre=field.centre,
            is_calibrated=field.calibrated,
        )
    survey = field.survey()
    return (
        TimbreTable.of(survey)
        if interpolation == "table"
        else TimbreField.of(survey, radius=radius)
    )


def _find_contacts(model: ModalModel, contacts: ArrayLike | Sequence[Place]) -> tuple[Array, Array]:
    """Return contacts (P, D) and the directions of pushes there (P, 3)."""
    if isinstance(model.gains, ShapeGains) and model.geometry is not None:
        model_contacts = [model.contact(place) for place in contacts]  # type: ignore[union-attr] - a list
        if not model_contacts:
            raise OptionError("contacts are empty: give points on the surface, m, or names")
        points = np.array([contact.point for contact in model_contacts])
        return points, np.array([contact.direction for contact in model_contacts])
    places = np.asarray(contacts, np.float64)
    if places.ndim != 2 or not len(places):
        raise OptionError(f"contacts have shape {places.shape}: give the coordinates of each")
    return places, np.zeros((len(places), 3))


def _centre(model: ModalModel) -> Array:
    """Return the point from which travel times count, m."""
    gains = unexpanded(model.gains)
    if isinstance(gains, TimbreTable):
        return gains.centre * gains.size
    if isinstance(gains, TimbreField | ShapeGains | SinglePoint):
        return gains.centre
    return np.zeros(3) if model.centre is None else model.centre


def _is_axial(recorded_gains: Gains) -> bool:
    """Return whether only the azimuth between contact and listener matters."""
    if isinstance(recorded_gains, TimbreTable):
        return recorded_gains.mirrored
    return isinstance(recorded_gains, TimbreField) and recorded_gains.listener_part.mirrored

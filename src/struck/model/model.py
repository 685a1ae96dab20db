"""The modal model: the one thing that every source makes and every player reads."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import (
    MaterialError,
    OptionError,
    ScaleWarning,
    counted,
    printable,
    rounded,
)
from struck.model.arrays import Array, Index, Mask, checked, require_number, require_numbers
from struck.model.contact import Contact, Place, located, nearest_contacts
from struck.model.damping import (
    Band,
    Damping,
    Each,
    contains_air,
    natural_at,
    require_band,
    ringing,
)
from struck.model.gains import (
    ExpandedGains,
    FieldRadiation,
    Gains,
    Keep,
    Radiation,
    ShapeGains,
    canonical_signs,
)
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.modes import Modes, Stiffness, changed
from struck.model.provenance import Progress, Provenance, silent
from struck.model.recoil import Recoil

if TYPE_CHECKING:
    from struck.model.chart import Chart
    from struck.model.radiation_efficiency import RadiationEfficiency
    from struck.model.residual import Residual

XYZ = ("x (m)", "y (m)", "z (m)")
_COPIED_FIELDS = ("mass", "centre", "inertia", "supported", "tensioned", "complete_to")
_KINDS = {
    "material": Material | None,
    "geometry": Mesh | None,
    "places": Mapping,
    "playing_place": str | None,
    "coordinates": tuple,
    "recoil": Recoil | None,
    "provenance": Provenance,
}
_LOST_FIELD = (
    "the timbre field was computed at other frequencies: an estimate, the same in all directions, "
    "takes its place; compute the field anew"
)
LOUDEST = "loudest"  # a place that every model has
_MAX_LISTED_MODES = 12  # modes that a note lists
_CONSTANTS = ("density", "youngs_modulus", "poisson_ratio")  # of a material, without damping
_RINGING = ("frequencies", "natural_frequencies", "decays")
_OTHERS = ("blow", "vague")  # details of a fit: indices of modes that are not the object's
_MAX_MODE = 2**32 - 1  # index of a mode, as in the schema of model files
_MAX_SHOWN = 60  # characters of a value in a message


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ModalModel:
    """Frequencies, decay rates and gains of a body.

    Parameters
    ----------
    frequencies : array (M,)
        Ringing (damped) frequencies, Hz, in the order of the natural ones.
    natural_frequencies : array (M,)
        Natural frequencies, ascending, Hz.
    decays : array (M,)
        Amplitude decay rates, 1/s.
    gains : Gains
        Drive over contacts and output over listeners.
    material : Material or None, default None
        Material; None if unknown, as for recordings.
    mass : float or None, default None
        Mass, kg; None if unknown.
    centre : array (3,) or None, default None
        Centre of mass, or the acoustic centre of recordings, m; None if unknown.
    inertia : array (3, 3) or None, default None
        Moments of inertia about `centre`, kg m^2; None if unknown.
    geometry : Mesh or None, default None
        Surface; None if unknown.
    supported : bool, default False
        Whether the body is clamped or supported somewhere.
    tensioned : bool, default False
        Whether tension, not its stiffness, is the restoring force.
    air : bool, default False
        Whether `decays` contain the losses to the air, `air_decays`, in addition to those of the
        damping law. Nothing is added to a law that contains them already.
    complete_to : float
        Frequency below which no mode is missing, Hz.
    poisson_slopes : array (M,) or None, default None
        d ln f / d(Poisson's ratio), as in `Modes`.
    errors : array (M,) or None, default None
        Relative error of each frequency: of the discretisation, as in `Modes`, or the standard
        error of a fit.
    places : mapping of str to array (3,), optional
        Contacts by name, m.
    playing_place : str or None, default None
        Name of the default contact. None, or a name that `places` lacks: where the lowest modes are
        most audible.
    coordinates : tuple of str, default ("x (m)", "y (m)", "z (m)")
        Names and units of the coordinates of a contact.
    chart : Chart or None, default None
        Positions of the contact coordinates of recordings in space, m. None: if all coordinates
        have a unit of length, from these; otherwise unknown until `charted` is called.
    residual : Residual or None, default None
        Attack and noise of the recorded hit.
    recoil : Recoil or None, default None
        Sound of the acceleration of a free body as a whole.
    provenance : Provenance, optional
        Method, versions, references, and what was left out.

    Notes
    -----
    p(t) = sum_n Im[g_n exp((-d_n + 2 pi i f_n) t)] is the response to a unit impulse, with gains g,
    decay rates d and frequencies f.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> model = struck.analyze(bar, "steel", progress=None)
    >>> model.frequencies[:3].round(1)
    array([ 288. ,  792.3, 1549. ])
    >>> model.t60[:2].round(1)
    array([37. , 13.6])
    >>> model.contact("end").point.round(3)
    array([0.297, 0.   , 0.002])
    >>> model.made_of("aluminium").frequencies[:3].round(1)
    array([ 294.6,  810.5, 1584.5])
    """

    frequencies: Array
    natural_frequencies: Array
    decays: Array
    gains: Gains
    material: Material | None = None
    mass: float | None = None
    centre: Array | None = None
    inertia: Array | None = None
    geometry: Mesh | None = None
    supported: bool = False
    tensioned: bool = False
    air: bool = False
    complete_to: float
    poisson_slopes: Array | None = None
    errors: Array | None = None
    places: Mapping[str, Array] = field(default_factory=dict)
    playing_place: str | None = None
    coordinates: tuple[str, ...] = XYZ
    chart: Chart | None = None
    residual: Residual | None = None
    recoil: Recoil | None = None
    provenance: Provenance = field(default_factory=Provenance)

    def __post_init__(self) -> None:
        _require_modes(self)
        _require_body(self)
        _require_indices(self.provenance)
        if self.recorded:
            object.__setattr__(self, "chart", _chart(self))

    @classmethod
    def of(
        cls,
        modes: Modes,
        material: Material,
        *,
        radiation: Radiation,
        lowest: float = 20.0,
        places: Mapping[str, Array] | None = None,
        playing_place: str | None = None,
        air: bool = True,
    ) -> ModalModel:
        """Make a model of undamped modes.

        Modes below the lowest frequency are removed and counted.

        Parameters
        ----------
        modes : Modes
            Undamped modes.
        material : Material
            Material, whose damping gives the decay rates.
        radiation : Radiation
            Estimate of the radiated sound, which gives the outputs.
        lowest : float, default 20.0
            Lowest frequency, Hz.
        places : mapping of str to array (3,), optional
            Contacts by name, m.
        playing_place : str, optional
            Name of the default contact.
        air : bool, default True
            Whether decay rates contain the losses to the air, where the radiation gives them.

        Returns
        -------
        ModalModel
            The damped model.
        """
        indices = np.flatnonzero(modes.frequencies >= lowest)
        dropped_count = len(modes.frequencies) - len(indices)
        natural = modes.frequencies[indices]
        shapes = modes.shapes[:, :, indices]
        signs = canonical_signs(modes.surface, shapes)
        formula = None if modes.formula is None else modes.formula.chosen(indices).signed(signs)
        model = cls(
            frequencies=natural,
            natural_frequencies=natural,
            decays=np.zeros_like(natural),
            gains=ShapeGains.radiating(
                modes.surface, shapes * signs, natural, modes.centre, radiation, formula
            ),
            material=material,
            geometry=modes.surface,
            poisson_slopes=modes.poisson_slopes[indices],
            errors=modes.errors[indices],
            places=places or {},
            playing_place=playing_place,
            air=air and radiation.calibrated,
            coordinates=XYZ if formula is None else XYZ[: formula.forms.dimensions],
            provenance=modes.provenance.extended(
                references=radiation.references,
                dropped=(f"{counted(dropped_count, 'mode')} below {rounded(lowest)} Hz",)
                * (dropped_count > 0),
                radiation=radiation.name,
            ),
            **{name: getattr(modes, name) for name in _COPIED_FIELDS},
        )
        return model.damped(material.damping)

    @property
    def calibrated(self) -> bool:
        """Whether the gains are Pa/(N s), not relative."""
        return self.gains.calibrated

    @property
    def recorded(self) -> bool:
        """Whether contacts are coordinates of recordings, not points of a surface."""
        return self.geometry is None or not isinstance(self.gains, ShapeGains)

    @property
    def of_object(self) -> Mask:
        """Mask of the object's modes (M,).

        The others are of a fit: some stand for the blow, some are vague, known to 30 % at best.
        """
        details = self.provenance.details
        others = [np.asarray(details.get(kind, ()), int) for kind in _OTHERS]
        return ~np.isin(np.arange(len(self.frequencies)), np.concatenate(others))

    @property
    def air_decays(self) -> Array:
        """Decay rates by sound and by friction in the air (M,), 1/s: the part added to `decays`.

        They are 0 where the air was left out, or where the damping law contains its losses.
        """
        return self._air_decays(None if self.material is None else self.material.damping)

    @property
    def decay_bounds(self) -> tuple[Array, Array] | None:
        """Lowest and highest decay rates (M,), 1/s, by the uncertainty of the losses to the air.

        None if the rates do not contain `air_decays`.
        """
        losses = self.gains.losses if isinstance(self.gains, ShapeGains) else None
        if losses is None or not self.air_decays.any():
            return None
        return losses.bounds(self.decays)

    @property
    def t60(self) -> Array:
        """Times to fall by 60 dB, s (M,); infinite without damping."""
        with np.errstate(divide="ignore", over="ignore"):
            return np.log(1000) / self.decays

    @checked
    def contact(self, at: Place = None, direction: Place = None) -> Contact:
        """Find a contact on the body.

        Parameters
        ----------
        at : str, array-like (3,) or None, default None
            A name of the model's places, "vertex:120", or a point, m. None: the playing place,
            which is the rim of a bell, bowl or glass, the end of a tube, otherwise the place at
            which the lowest modes are most audible. "loudest": where a default strike is loudest,
            one of the places by name unless another is at least 0.5 dB above them. For a model of
            recordings both are the first place that it names.
        direction : array-like (3,), optional
            Direction of the push. Default: the inward normal.

        Returns
        -------
        Contact
            Point, direction and outward normal of the contact.

        Raises
        ------
        ContactError
            If there is no such place, or the point is not on the body.
        """
        is_loudest = isinstance(at, str) and at == LOUDEST
        if self.geometry is None or not isinstance(self.gains, ShapeGains):
            at = None if is_loudest else at
            return Contact.recorded(at, self.places, self.coordinates, direction)
        if at is None or is_loudest:
            from struck.model.playing_place import loudest_place, playing_place

            find = loudest_place if is_loudest else playing_place
            point, name = find(self, self.gains, self.geometry)
        else:
            name = at if isinstance(at, str) else None
            axes = len(self.coordinates)
            point = located(self.geometry, self.places, at, axes)
            # A place on the plan is pushed from above, at the edges too, where normals turn.
            if direction is None and not isinstance(at, str) and np.shape(at) == (axes,) != (3,):
                direction = (0.0, 0.0, -1.0)
        contact = Contact.on(self.gains.locator, self.geometry, point, direction)
        return contact if name is None else replace(contact, name=name)

    def contacts(
        self, points: Array, directions: Array | None = None
    ) -> tuple[Array, Array, Array, Index | None]:
        """Find several contacts, as by `contact`.

        Parameters
        ----------
        points : array (K, D)
            Points, m, or contact coordinates of a recorded body.
        directions : array (K, 3), optional
            Directions of the pushes. Default: the inward normals.

        Returns
        -------
        tuple of array (K, D), array (K, 3), array (K, 3), array (K,) or None
            Nearest points, unit directions of the pushes, outward normals, and the faces on which
            the points lie; None without a surface.

        Raises
        ------
        ContactError
            When one is off the body.
        """
        if self.geometry is None or not isinstance(self.gains, ShapeGains) or points.shape[1] != 3:
            optional_directions = [None] * len(points) if directions is None else directions
            contacts = [
                self.contact(at, direction)
                for at, direction in zip(points, optional_directions, strict=True)
            ]
            rows = [(contact.point, contact.direction, contact.normal) for contact in contacts]
            nearest, pushes, normals = (np.array(column) for column in zip(*rows, strict=True))
            return nearest, pushes, normals, None
        return nearest_contacts(self.gains.locator, self.geometry, points, directions)

    @checked
    def damped(self, damping: Damping) -> ModalModel:
        """Return a copy with another damping law.

        The losses to the air are added, unless the model has none or the law contains them.
        Overdamped modes are removed and counted. The noise of a residual decays by the new law; its
        attack stays.

        Parameters
        ----------
        damping : Damping
            The new law.

        Returns
        -------
        ModalModel
            The copy.
        """
        material = None if self.material is None else self.material.damped(damping)
        rates = damping.decays(self.natural_frequencies)
        if material is not None:
            rates = rates + self._air_decays(damping)
        indices = np.flatnonzero(rates < 2 * np.pi * self.natural_frequencies)
        dropped_count, residual = len(rates) - len(indices), self.residual
        notes = (f"{counted(dropped_count, 'overdamped mode')} left out",) if dropped_count else ()
        if dropped_count and not len(indices):
            law_alone = damping.decays(self.natural_frequencies)
            cause, advice = repr(damping), _OVERDAMPED
            if np.any(law_alone < 2 * np.pi * self.natural_frequencies):
                cause, advice = "the air", _OVERDAMPED_BY_AIR
            warnings.warn(
                f"{cause} leaves no mode that rings, of {dropped_count}: {advice}",
                ScaleWarning,
                stacklevel=3,
            )
        if residual is not None:
            residual = residual.damped(damping)
            notes += ("the noise of its residual decays by the new law, its attack is as recorded",)
        model = self._chosen(indices, self._stiffness()) if dropped_count else self
        return replace(
            model,
            frequencies=ringing(model.natural_frequencies, rates[indices]),
            decays=rates[indices],
            material=material,
            residual=residual,
            provenance=self.provenance.extended(dropped=notes),
        )

    @checked
    def scaled(self, factor: float) -> ModalModel:
        """Compute the model of the same body in another size.

        Frequencies are divided by the factor.

        Parameters
        ----------
        factor : float
            Ratio of the new to the old size.

        Returns
        -------
        ModalModel
            The model of the other size.

        Raises
        ------
        OptionError
            If the factor is below 1e-9 or above 1e9.
        """
        require_number("factor", factor, 1e-9, 1e9, hint="a size must exceed 1e-9")
        return self._remade(self._stiffness(factor), self.material, size=factor)

    @checked
    def tuned(self, *, lowest: float | str) -> ModalModel:
        """Scale the body so that its lowest mode has a given frequency.

        Parameters
        ----------
        lowest : float or str
            Ringing frequency of the lowest mode, Hz, or a note such as "A5".

        Returns
        -------
        ModalModel
            The model of the other size.

        Raises
        ------
        MaterialError
            If no mode can ring that low, or the model has no modes.
        """
        if not len(self.decays):
            raise MaterialError("the body has no modes to tune: lower its damping")
        law = Each(rates=self.decays[0]) if self.material is None else self.material.damping
        natural, losses = self.natural_frequencies[0], None
        if self.air_decays[0] > 0 and isinstance(self.gains, ShapeGains):
            losses = self.gains.losses

        def decay_at(frequency: float) -> float:
            rate = float(law.decays(frequency))
            if losses is None:
                return rate
            return rate + float(losses.scaled(natural / frequency, 1.0).total[0])

        return self.scaled(natural / natural_at(lowest, decay_at))

    @checked
    def made_of(self, material: Material | str, *, field: bool = False) -> ModalModel:
        """Compute the model of the same body of another isotropic material.

        The result is exact for the same Poisson's ratio (2002, section 3.3), and of first order in
        the shapes for another: `errors` grows by the estimated effect, and `complete_to` falls by
        as much as a mode from above it may have come down.

        Parameters
        ----------
        material : Material or str
            The new material.
        field : bool, default False
            Compute the timbre field again by boundary elements.

        Returns
        -------
        ModalModel
            The model of the other material.

        Raises
        ------
        MaterialError
            If the material is unknown, or the model has none to start from.
        OptionError
            If the model is loaded by a fluid, whose mass does not change with the material.
        """
        new_material = Material.of(material)
        if self.material is None:
            raise MaterialError("this model's own material is unknown: compute or fit it again")
        fluid = self.provenance.details.get("fluid")
        if fluid is not None and any(
            getattr(new_material, name) != getattr(self.material, name) for name in _CONSTANTS
        ):
            raise OptionError(
                f"the material is {new_material.name!r} and the model is loaded by {fluid}, whose "
                "mass stays: analyze the dry body of this material, and load it"
            )
        new_stiffness = changed(self._stiffness(), self.material, new_material)
        model = self._remade(
            new_stiffness, new_material, density=new_material.density / self.material.density
        )
        provenance = model.provenance.extended(computed_as=self.material.name)
        new_model = replace(model, provenance=provenance)
        return new_model.radiating() if field else new_model

    @checked
    def radiating(
        self,
        *,
        band: Band = (20.0, 20_000.0),
        near: bool = False,
        keep: Keep | None = None,
        progress: Progress | None = silent,
    ) -> ModalModel:
        """Compute the timbre field: the directivity of each mode.

        Modes outside the band, and modes whose waves are much shorter than the body, keep their
        estimate, which is equal in all directions: `provenance.dropped` lists the latter.

        Parameters
        ----------
        band : (float, float) or (str, str), default (20, 20000)
            Band of the modes to compute, Hz or notes.
        near : bool, default False
            Keep also the pressures on the surface, for listeners within 1.2 radii.
        keep : callable, optional
            Stores finished frequencies between runs; `struck.analyze` and ``struck radiate`` store
            them in the cache. Default: no storage.
        progress : callable or None, optional
            Called as ``progress(stage, fraction)``. Default: silent.

        Returns
        -------
        ModalModel
            The copy with the timbre field.

        Raises
        ------
        OptionError
            If the model was recorded, or its gains are relative.
        MeshError
            If its surface is not closed, or a wall is too thin for the elements.
        SolverError
            If memory does not suffice.
        """
        gains = self.gains
        if not isinstance(gains, ShapeGains) or not isinstance(gains.radiation, FieldRadiation):
            raise OptionError(
                "a timbre field is computed from mode shapes on a surface, in Pa, and this model's "
                f"gains are {'relative' if gains.of_surface else 'recorded'}: analyze a body with "
                "radiation='power'"
            )
        band = require_band(band)
        options = {"keep": keep, "progress": progress or silent}
        field_gains, high, error = gains.radiation.field(
            gains, self.natural_frequencies, band=band, near=near, **options
        )
        listing = ", ".join(
            f"{mode + 1} ({self.frequencies[mode]:.0f} Hz)" for mode in high[:_MAX_LISTED_MODES]
        )
        remark = f" and {len(high) - _MAX_LISTED_MODES} more" * (len(high) > _MAX_LISTED_MODES)
        number = counted(len(high), "mode")
        note = f"{number} without a timbre field, by an estimate: {listing}{remark}"
        natural = self.natural_frequencies
        if is_outside := not np.any((natural >= band[0]) & (natural <= band[1])):
            span = f"{rounded(band[0])} to {rounded(band[1])} Hz"
            note = f"no mode lies from {span}: no timbre field is computed"
            warnings.warn(note, ScaleWarning, stacklevel=3)
        details = {"radiation": "field", "field_error": f"{error:.1%}"}
        provenance = self.provenance.extended(
            references=("schenck1968", "wilton1984") * field_gains.directional,
            dropped=(note,) * (len(high) > 0 or is_outside),
            **(details if field_gains.directional else {}),
        )
        model = replace(self, gains=field_gains, provenance=provenance)
        # What leaves as sound is that of the field now.
        return model if self.material is None else model.damped(self.material.damping)

    @checked
    def charted(
        self, *, pitch: ArrayLike | None = None, geometry: Mesh | None = None
    ) -> ModalModel:
        """Return a copy of a recorded body with a chart of its surface, for scrapes and rolls.

        Parameters
        ----------
        pitch : float or array-like (D,), optional
            Metres per unit of each contact coordinate; for an azimuth in rad, the radius of the
            body. Default: from the units in the names of the coordinates, such as "height (m)".
        geometry : Mesh, optional
            Surface of a body of revolution about the z axis through its centre, m: the first
            coordinate times its pitch is the height z. An azimuth then needs no pitch.

        Returns
        -------
        ModalModel
            The model with its `chart`.

        Raises
        ------
        OptionError
            If a pitch is missing, the surface does not fit the recordings, or the body was not
            recorded at several contacts.
        """
        from struck.model.chart import Chart

        bounds = self.gains.bounds
        if not self.recorded or bounds is None or not self.coordinates:
            raise OptionError(
                f"{'geometry' if pitch is None else 'pitch'}= is about the way between places that "
                "were recorded, and this body "
                f"{'was recorded at one' if self.recorded else 'has a surface'}: leave it out"
            )
        middle = np.zeros(3) if self.centre is None else self.centre
        chart = Chart.of(
            self.coordinates,
            pitch=pitch,
            geometry=geometry,
            round_about=middle if self.gains.axial else None,
            heights=(float(bounds[0][0]), float(bounds[1][0])),
        )
        return replace(self, chart=chart)

    def expanded(self) -> ModalModel:
        """Return the model with a mode for each product of its gains, as resonators need them.

        Returns
        -------
        ModalModel
            R M modes for gains that are sums of R products; the model itself for R = 1.
        """
        if self.gains.rank == 1:
            return self
        rank, details = self.gains.rank, dict(self.provenance.details)
        expanded = {name: np.tile(getattr(self, name), rank) for name in _RINGING}
        for kind in details.keys() & set(_OTHERS):
            is_marked = np.isin(np.arange(len(self.frequencies)), np.asarray(details[kind], int))
            details[kind] = np.flatnonzero(np.tile(is_marked, rank)).tolist()
        return replace(
            self,
            **expanded,
            gains=self.gains.expanded(),
            poisson_slopes=None,
            errors=None,
            provenance=replace(self.provenance, details=details),
        )

    def radiated_power(self) -> RadiationEfficiency:
        """Compute how strongly each mode radiates: its radiation efficiency and power.

        Returns
        -------
        RadiationEfficiency
            Numbers of each mode, as a table also in third octaves. The energy that an excitation
            radiates is that of `struck.energy`.

        Raises
        ------
        OptionError
            If the model was recorded, or its gains are relative.

        Examples
        --------
        >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
        >>> power = struck.analyze(bar, "steel", progress=None).radiated_power()
        >>> bool(power.efficiencies[0] < 0.01)
        True
        """
        from struck.model.radiation_efficiency import RadiationEfficiency

        return RadiationEfficiency.of(
            self.gains,
            self.frequencies,
            self.decays,
            damping=None if self.material is None else self.material.damping,
            air=self.air_decays,
        )

    def cite(self) -> str:
        """List the papers behind this model.

        Returns
        -------
        str
            One reference per line.
        """
        return self.provenance.cite()

    def __repr__(self) -> str:
        """Return the number of modes, their range, the material and the mass in a line."""
        frequencies = self.frequencies[self.of_object]
        parts = [counted(len(frequencies), "mode")]
        parts[0] += (
            f" from {rounded(frequencies.min(), 5)} to {rounded(frequencies.max(), 5)} Hz"
            if len(frequencies)
            else ""
        )
        parts += [] if self.material is None else [self.material.name]
        parts += [] if self.mass is None else [f"{rounded(self.mass, 3)} kg"]
        return f"<ModalModel: {', '.join(parts)}>"

    def _repr_html_(self) -> str:
        from struck.model.html import modes_table  # for notebooks alone

        return modes_table(self, self.of_object)

    def _air_decays(self, damping: Damping | None) -> Array:
        """Return the decay rates (M,) that the air adds to a law, 1/s."""
        losses = self.gains.losses if isinstance(self.gains, ShapeGains) else None
        if losses is None or not self.air or damping is None or contains_air(damping):
            return np.zeros(len(self.natural_frequencies))
        return losses.total

    def _stiffness(self, size: float = 1) -> Stiffness:
        return Stiffness(
            frequencies=self.natural_frequencies / size,
            poisson_slopes=self.poisson_slopes,
            errors=self.errors,
            complete_to=self.complete_to / size,
            tensioned=self.tensioned,
        )

    def _remade(
        self, modes: Stiffness, material: Material | None, *, size: float = 1, density: float = 1
    ) -> ModalModel:
        """Return the body with other natural frequencies, put in order, size or density."""
        order = np.argsort(modes.frequencies, kind="stable")
        weight = density * size**3
        step = size if self.coordinates == XYZ[: len(self.coordinates)] else 1
        new_model = self._chosen(order, modes, size=size, density=density)
        lost = self.gains.directional and not new_model.gains.directional
        left = (_LOST_FIELD,) * lost + (_RESIDUAL_LEFT,) * (self.residual is not None)
        model = replace(
            new_model,
            provenance=new_model.provenance.extended(dropped=left),
            complete_to=modes.complete_to,
            material=material,
            mass=None if self.mass is None else self.mass * weight,
            centre=None if self.centre is None else self.centre * size,
            inertia=None if self.inertia is None else self.inertia * weight * size**2,
            geometry=None if self.geometry is None else self.geometry.scaled(size),
            places={name: point * step for name, point in self.places.items()},
            chart=None if self.chart is None else self.chart.scaled(size),
            residual=None,
            recoil=None if self.recoil is None else self.recoil.changed(size, density),
        )
        return model.damped(Each(rates=model.decays) if material is None else material.damping)

    def _chosen(
        self, indices: Index, modes: Stiffness, *, size: float = 1, density: float = 1
    ) -> ModalModel:
        """Return a copy with some modes, in the order of `indices`."""
        natural, slopes, errors = modes.frequencies[indices], modes.poisson_slopes, modes.errors
        gains = self.gains
        # If size and wavelengths scale together, so does the radiation: no new computation.
        if (
            type(gains) is ShapeGains
            and getattr(gains.radiation, "scalable", False)
            and np.array_equal(indices, np.arange(len(self.natural_frequencies)))
            and np.allclose(natural * size, self.natural_frequencies, rtol=_ALIKE, atol=0)
        ):
            new_gains: Gains = gains.similar(size, density)
        else:
            new_gains = gains.changed(natural, indices, size, density)
        return replace(
            self,
            frequencies=natural,
            natural_frequencies=natural,
            decays=self.decays[indices],
            gains=new_gains,
            poisson_slopes=None if slopes is None else slopes[indices],
            errors=None if errors is None else errors[indices],
        )


_OVERDAMPED = (
    "a Rayleigh law takes mass in 1/s, as 1, and stiffness in s, as 1e-7; loss tangents lie far "
    "below 1"
)
_OVERDAMPED_BY_AIR = (
    "it takes their energy within a period, as of a film; check thickness and density, or leave "
    "its losses out by air=False"
)
_ALIKE = 1e-12  # of frequencies times size: rounding
_RESIDUAL_LEFT = "its residual (attack and noise), which is of the recorded size and material"


def _require_modes(model: ModalModel) -> None:
    """Refuse modes that are no numbers, as many each, in order and with losses."""
    shape = np.shape(model.natural_frequencies)[:1]
    for name in _RINGING:
        require_numbers(name, getattr(model, name), shape, least=0)
    for name, least in (("poisson_slopes", None), ("errors", 0)):
        values = getattr(model, name)
        if values is not None:
            require_numbers(name, values, shape, gaps=True, least=least)
    if not isinstance(model.gains, Gains):
        raise TypeError(f"gains are a {type(model.gains).__name__}: give Gains")
    # Expanded gains have all modes once for each of their products.
    times = model.gains.products.rank if isinstance(model.gains, ExpandedGains) else 1
    natural = model.natural_frequencies.reshape(times, -1)
    if np.any(natural <= 0) or np.any(np.diff(natural) < 0):
        raise OptionError(
            "its natural_frequencies must ascend from above 0 Hz: put the modes in order, and "
            "leave rigid motions out"
        )
    if model.gains.count not in {None, *shape}:
        raise OptionError(
            f"its gains are those of {model.gains.count} modes, and it has {shape[0]}: give as many"
        )


def _require_body(model: ModalModel) -> None:
    """Refuse a body without mass, and places that its contacts do not have."""
    for name, kind in _KINDS.items():
        value = getattr(model, name)
        if not isinstance(value, kind):
            raise TypeError(f"{name} is a {type(value).__name__}: give a {kind}")
    require_numbers("complete_to", model.complete_to, (), least=0)
    for name, shape in (("mass", ()), ("centre", (3,)), ("inertia", (3, 3))):
        value = getattr(model, name)
        if value is not None:
            require_numbers(name, value, shape)
    if model.mass is not None and model.mass <= 0:
        raise OptionError(f"its mass is {model.mass} kg: it must exceed 0, or be None for unknown")
    names = model.coordinates
    if not all(isinstance(name, str) for name in (*names, *model.places)):
        raise TypeError(f"coordinates are {names} of {tuple(model.places)}: give names")
    if model.gains.axes not in {None, len(names)}:
        raise OptionError(
            f"its contacts have {len(names)} coordinates, {', '.join(names)}, and its "
            f"{type(model.gains).__name__} knows {model.gains.axes}: name as many"
        )
    count = 3 if isinstance(model.gains, ShapeGains) else len(names)
    for name, place in model.places.items():
        require_numbers(f"place {name!r}", place, (count,))


def _require_indices(provenance: Provenance) -> None:
    """Refuse details that name modes by anything but a list of their indices."""
    for kind in _OTHERS:
        others = provenance.details.get(kind, ())
        if not isinstance(others, Sequence | np.ndarray) or not all(
            isinstance(mode, int | np.integer) and 0 <= mode <= _MAX_MODE for mode in others
        ):
            raise OptionError(
                f"details[{kind!r}] is {printable(repr(others))[:_MAX_SHOWN]}: give a list of "
                "indices of modes"
            )


def _chart(model: ModalModel) -> Chart | None:
    """Return the chart of recorded contacts: as given, or from the units in coordinate names."""
    from struck.model.chart import Chart  # computed bodies need none

    chart, names = model.chart, model.coordinates
    if chart is None:
        return Chart.named(names)
    if not isinstance(chart, Chart):
        raise TypeError(f"chart is a {type(chart).__name__}: give a Chart")
    if len(chart.pitch) != len(names):
        raise OptionError(
            f"its chart has {len(chart.pitch)} pitches for {len(names)} coordinates: give as many"
        )
    return chart

"""Timbre fields: the gain of each mode as a part over contacts times a part over listeners."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import ContactError, OptionError, counted, rounded
from struck.model.arrays import Array, Complex, Index, Mask, brief, checked
from struck.model.contact import require_recorded
from struck.model.gains import RecordedGains
from struck.model.material import AIR
from struck.model.survey import Survey, distinct, shares
from struck.model.waves import ORDER, SphericalWaves, azimuths_of

if TYPE_CHECKING:
    from scipy.sparse import csr_array

_SILENT = 1e-3  # drive below which nothing is known of a listener, however small the noise
_SWEEPS = 200
_SETTLED = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Separation:
    """Real contact parts and complex listener parts whose products come nearest to the gains."""

    drives: Array  # (P, M); the largest of each mode is 1
    outputs: Complex  # (Q, M)
    weights: Array  # (Q, M): one over the variance of each output, in any unit
    # (M,): distance of the gains from the products, root mean square over root mean square,
    # corrected for how much was fitted; NaN where nothing is left to judge by.
    rank_errors: Array
    # (M,): expected error of a part at half of its places, over its root mean square.
    drive_errors: Array
    output_errors: Array

    @classmethod
    def of(cls, survey: Survey) -> Separation:
        """Separate contact and listener parts by alternating least squares."""
        # Without errors, noise counts as equally strong in all modes, and as strong as what the
        # products leave of the gains.
        table = _Recordings.of(survey)
        table.require_connected()
        drives, outputs = table.separated()
        known = table.listeners @ (table.weights * np.square(drives)[table.contact])
        is_loud = known > _SILENT**2 * table.listeners @ table.weights
        energies = np.square(np.abs(outputs))
        contact_powers = table.contacts @ (table.weights * energies[table.listener])
        variance = table.variance(drives, outputs) if survey.errors is None else 1.0
        return cls(
            drives=drives,
            outputs=outputs,
            weights=known,
            rank_errors=table.rank_errors(drives, outputs),
            drive_errors=_part_errors(contact_powers, variance, drives**2),
            output_errors=_part_errors(known * is_loud, variance, energies),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Recordings:
    """Recorded gains (n, M) with matrices that sum over the recordings of a contact or listener."""

    gains: Complex
    weights: Array
    contact: Index
    listener: Index
    contacts: csr_array
    listeners: csr_array

    @classmethod
    def of(cls, survey: Survey) -> _Recordings:
        contact, listener = survey.pairs.T
        errors = np.ones(survey.gains.shape) if survey.errors is None else survey.errors
        return cls(
            gains=survey.gains,
            weights=1 / np.square(errors),
            contact=contact,
            listener=listener,
            contacts=_summing_matrix(contact, len(survey.contacts)),
            listeners=_summing_matrix(listener, len(survey.listeners)),
        )

    @property
    def surplus(self) -> int:
        """Number of recorded real values of a mode less the number of its unknowns."""
        unknowns = self.contacts.shape[0] + 2 * self.listeners.shape[0] - 1
        return 2 * len(self.gains) - unknowns

    def require_connected(self) -> None:
        reached = np.zeros(self.contacts.shape[0])
        reached[self.contact[0]] = 1
        for _ in reached:
            is_connected = self.listeners @ reached[self.contact] > 0
            reached = (self.contacts @ is_connected[self.listener] > 0).astype(float)
        unconnected = np.flatnonzero(self.contacts.sum(axis=1) * (reached == 0))
        if len(unconnected):
            raise OptionError(
                f"contact {unconnected[0] + 1} shares no listener with contact "
                f"{self.contact[0] + 1}, not even by way of others: record one listener with all "
                "contacts"
            )

    def separated(self) -> tuple[Array, Complex]:
        """Return drives (P, M), the largest of each mode 1, and outputs (Q, M)."""
        # Each mode starts from the contact of which most was recorded, and spreads from there.
        energies = self.contacts @ (self.weights * np.square(np.abs(self.gains)))
        drives = (np.arange(len(energies))[:, None] == energies.argmax(axis=0)).astype(float)
        for _ in range(_SWEEPS):
            last, outputs = drives, self._outputs(drives)[self.listener]
            agreement = self.contacts @ (self.weights * (outputs.conj() * self.gains).real)
            powers = self.contacts @ (self.weights * np.square(np.abs(outputs)))
            drives = agreement * _inverse(powers)
            leading = np.abs(drives).argmax(axis=0)[None]
            drives = drives * _inverse(np.take_along_axis(drives, leading, axis=0))
            if np.abs(drives - last).max() < _SETTLED:
                break
        return drives, self._outputs(drives)

    def variance(self, drives: Array, outputs: Complex) -> float:
        """Return the variance of the noise of a gain, the same for all modes; 0 where unknown."""
        residuals = self.gains - drives[self.contact] * outputs[self.listener]
        if self.surplus <= 0:
            return 0.0
        return 2 * float(np.square(np.abs(residuals)).sum()) / (self.surplus * residuals.shape[1])

    def rank_errors(self, drives: Array, outputs: Complex) -> Array:
        if self.surplus <= 0:
            return np.full(drives.shape[1], np.nan)
        residuals = self.gains - drives[self.contact] * outputs[self.listener]
        energies = (self.weights * np.square(np.abs(self.gains))).sum(axis=0)
        shares = (self.weights * np.square(np.abs(residuals))).sum(axis=0) * _inverse(energies)
        return np.sqrt(shares * 2 * len(residuals) / self.surplus)

    def _outputs(self, drives: Array) -> Complex:
        pushes = self.weights * drives[self.contact]
        known = self.listeners @ (pushes**2 / self.weights)
        return np.asarray(self.listeners @ (pushes * self.gains), np.complex128) * _inverse(known)


def _summing_matrix(owner: Index, count: int) -> csr_array:
    """Return the matrix (count, n) that sums the recordings of each owner (n,)."""
    from scipy.sparse import csr_array  # not loaded with every model file

    ones, numbers = np.ones(len(owner)), np.arange(len(owner))
    return csr_array((ones, (owner, numbers)), shape=(count, len(owner)))


def _inverse(values: Array) -> Array:
    """Return one over each value, and 0 for 0, so that unknown values have no weight."""
    return np.where(values == 0, 0.0, 1 / np.where(values == 0, 1.0, values))


def _part_errors(weights: Array, variance: float, powers: Array) -> Array:
    """Return the error at half of the places of a part (P, M) over its root mean square (M,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        variances = np.where(weights > 0, variance / weights, np.inf)
        shares = np.median(variances, axis=0) / powers.mean(axis=0)
    return np.sqrt(np.where(powers.any(axis=0), shares, np.inf))


# Length scales of the kernel, as fractions of the range of a coordinate.
LENGTHS = (0.15, 0.2, 0.25, 0.35, 0.5, 0.7, 1.0, 1.5, 2.5)
_NOISES = (1e-8, 1.0)  # the least keeps what is known twice over solvable


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContactPart:
    """Real, signed drives over contact coordinates: a Gaussian process over u, or u and v."""

    lowest: Array  # (D,)
    spans: Array  # (D,), range of each coordinate
    contacts: Array  # (P, D), places that were struck, from 0 to 1 in each coordinate
    factors: Array  # (K, P, M), weight of the kernel at each contact, for each of K length scales

    @classmethod
    def of(cls, contacts: Array, drives: Array, errors: Array) -> ContactPart:
        """Fit drives (P, M) at contacts (P, D), with errors (M,) over their root mean squares."""
        # The kernel is squared-exponential, of unknown scale, averaged over its lengths by their
        # evidence (Rasmussen & Williams, Gaussian Processes for Machine Learning, MIT Press, 2006,
        # chapters 2 and 5).
        lowest = contacts.min(axis=0)
        spans = np.ptp(contacts, axis=0)
        places = (contacts - lowest) / np.where(spans > 0, spans, 1.0)
        kernels = _likenesses(places, places).transpose(1, 0, 2)
        noises = np.clip(np.square(errors), *_NOISES)
        fits = [_fit_process(kernel, drives, noises) for kernel in kernels]
        posterior = shares(np.stack([evidence for evidence, _ in fits]))
        return cls(
            lowest=lowest,
            spans=spans,
            contacts=places,
            factors=np.stack([factors for _, factors in fits]) * posterior[:, None],
        )

    def at(self, points: Array) -> Array:
        """Return drives (K, M) at points (K, D); ContactError more than 2 % out of range."""
        require_recorded(points, self.lowest, self.lowest + self.spans)
        places = np.clip((points - self.lowest) / np.where(self.spans > 0, self.spans, 1.0), 0, 1)
        return np.einsum("knp,npm->km", _likenesses(places, self.contacts), self.factors)

    def chosen(self, modes: Index, factor: float = 1.0) -> ContactPart:
        """Return the drives of some modes, times a factor."""
        return replace(self, factors=np.ascontiguousarray(self.factors[:, :, modes] * factor))


def _likenesses(some: Array, others: Array) -> Array:
    """Return the kernels exp(-distance^2 / (2 length^2)) of all lengths (K, lengths, P)."""
    squares = np.square(some[:, None] - others).sum(axis=2)
    return np.exp(-squares[:, None] / (2 * np.square(LENGTHS)[:, None]))


def _fit_process(kernel: Array, drives: Array, noises: Array) -> tuple[Array, Array]:
    """Return evidence (M,) and factors (P, M) for noises (M,), the scale left free."""
    powers, vectors = np.linalg.eigh(kernel)
    seen = vectors.T @ drives
    variances = np.maximum(powers, 0.0)[:, None] + noises
    quadratic = np.maximum((np.square(seen) / variances).sum(axis=0), np.finfo(np.float64).tiny)
    evidence = -0.5 * (len(drives) * np.log(quadratic) + np.log(variances).sum(axis=0))
    return evidence, vectors @ (seen / variances)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Inside:
    """Corrections of the outgoing waves around listeners inside a body."""

    places: Array  # (I, 3), from the centre, m
    corrections: Complex  # (I, M)
    reach: float  # distance from which on nothing is added, m: up to the nearest listener outside

    @classmethod
    def of(cls, places: Array, missing: Complex, outside: Array) -> Inside:
        """Let corrections (I, M) at places (I, 3) fade away up to the listeners outside."""
        gaps = np.linalg.norm(places[:, None] - outside, axis=2)
        reach = float(gaps.min()) if gaps.size else 1.0
        matrix = _closeness(places, places, reach)
        return cls(
            places=places,
            corrections=np.asarray(np.linalg.solve(matrix, missing), complex),
            reach=reach,
        )

    def at(self, places: Array) -> Complex:
        """Return the correction at places (L, 3): (L, M)."""
        return _closeness(places, self.places, self.reach) @ self.corrections

    def chosen(self, modes: Index, size: float, factor: complex | Complex) -> Inside:
        """Return some modes of a body `size` times as large, times a factor."""
        return Inside(
            places=self.places * size,
            corrections=np.ascontiguousarray(self.corrections[:, modes] * factor),
            reach=self.reach * size,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ListenerPart:
    """Complex outputs over places, relative to the arrival time r/c."""

    waves: SphericalWaves
    inside: Inside
    mirrored: bool  # outputs are even in y
    turned: bool  # outputs are given by angular order

    @classmethod
    def of(
        cls,
        places: Array,
        outputs: Complex,
        weights: Array,
        wave_numbers: Array,
        *,
        radius: float = 0.0,
        mirrored: bool = False,
        turned: bool = False,
    ) -> ListenerPart:
        """Fit outputs (Q, M) with weights (Q, M) at places (Q, 3) from the centre."""
        distances = np.linalg.norm(places, axis=1)
        is_outside = (distances >= radius) & (distances > 0)
        if not is_outside.any() or np.any(distances[~is_outside] >= radius):
            raise OptionError(
                f"{np.count_nonzero(is_outside)} of {len(places)} listeners are off the centre and "
                f"at least radius={rounded(radius)} m from it: one must be, and one on the centre "
                "needs a radius= above 0"
            )
        samples = places[is_outside], outputs[is_outside], weights[is_outside]
        part = cls(
            waves=SphericalWaves.of(*samples, wave_numbers, radius=radius, mirrored=mirrored),
            inside=Inside.of(np.zeros((0, 3)), np.zeros((0, len(wave_numbers)), complex), places),
            mirrored=mirrored,
            turned=turned,
        )
        return part._with_inside(places[~is_outside], outputs[~is_outside], places[is_outside])

    @property
    def rank(self) -> int:
        """Number of products of a contact and a listener part, R."""
        return 2 * len(self.waves.parts) - 1 if self.turned else 1

    def at(self, places: Array) -> Complex:
        """Return outputs at places (L, 3) from the centre: (L, R, M)."""
        outputs = self.waves.turned(places) if self.turned else self.waves.at(places)[:, None]
        outputs[:, 0] += self.inside.at(self._folded(places))
        return outputs

    def chosen(self, modes: Index, size: float, factor: complex | Complex) -> ListenerPart:
        """Return some modes of a body `size` times as large, times a factor or one for each."""
        waves, inside = (part.chosen(modes, size, factor) for part in (self.waves, self.inside))
        return replace(self, waves=waves, inside=inside)

    def _with_inside(self, places: Array, outputs: Complex, outside: Array) -> ListenerPart:
        if not len(places):
            return self
        missing = outputs - self.waves.at(places)
        folded, number = distinct(self._folded(places))
        incidence = np.eye(len(folded))[number]
        missing = incidence.T @ missing / incidence.sum(axis=0)[:, None]
        return replace(self, inside=Inside.of(folded, missing, self._folded(outside)))

    def _folded(self, places: Array) -> Array:
        """Return places folded by the symmetry of the field, so that equivalent ones are equal."""
        # A contact may lie at any azimuth: then only the distance from the axis counts.
        x, y, z = places.T
        if self.turned:
            return np.stack([np.hypot(x, y), np.zeros_like(x), z], axis=1)
        return np.stack([x, np.abs(y) if self.mirrored else y, z], axis=1)


def _closeness(some: Array, others: Array, reach: float) -> Array:
    """Return 1 at no distance and 0 from `reach` on, twice differentiable (Wendland 1995)."""
    distances = np.linalg.norm(some[:, None] - others, axis=2) / reach
    return np.maximum(1 - distances, 0.0) ** 4 * (4 * distances + 1)


# Errors of a part, over its root mean square, from which a mode counts as not measured, and from
# which nothing of its listener part is used but the size.
WORST, LOST = 0.1, 0.5
# Limit of the error of listeners predicted from all others, by energy, over that recorded.
_MAX_PREDICTION_ERROR = 0.06
_FARTHEST = 50.0  # of listeners whose places are believed, m


@dataclass(frozen=True, kw_only=True, eq=False)
class TimbreField(RecordedGains):
    """Gains of a body as recorded: each mode a contact part times a listener part.

    The parts are interpolated separately: the contact part with its sign, the listener part with
    travel phase and 1/r taken out. A body round about the z axis that is struck all around has
    a product for each angular harmonic.

    Parameters
    ----------
    contact_part : ContactPart
        Drives over contacts.
    listener_part : ListenerPart
        Outputs over listeners.
    centre : array (3,)
        Acoustic centre in body coordinates, m.
    radius : float
        Radius of a sphere about it that encloses the body, m; 0 if unknown.
    rank_errors : array (M,)
        How far gains are from a product, relative; NaN where that was not measured.
    unmeasured : array of int
        Modes of which a part is little known, as where the contact that most listeners heard has
        a node, or where listeners are too few for a pattern. Those that drown in noise are heard
        alike from all sides, as loud as where they were recorded best.
    notes : tuple of str
        What a person should know: which modes are unmeasured, and the way out.
    is_calibrated : bool
        Whether gains are in Pa/(N s).
    is_deconvolved : bool, default False
        Whether the recorded strike was divided out.
    """

    __repr__ = brief
    contact_part: ContactPart
    listener_part: ListenerPart
    centre: Array
    radius: float
    rank_errors: Array
    unmeasured: Index
    notes: tuple[str, ...]
    is_calibrated: bool
    is_deconvolved: bool = False

    @classmethod
    @checked
    def of(
        cls,
        survey: Survey,
        *,
        radius: float = 0.0,
        worst: float = WORST,
        object_modes: Mask | None = None,
    ) -> TimbreField:
        """Estimate the timbre field of a survey.

        Parameters
        ----------
        survey : Survey
            Gains between contacts and listeners.
        radius : float, default 0.0
            Radius of a sphere about the centre that encloses the body, m. Listeners within it are
            inside the body; if none was recorded there, none may be placed there.
        worst : float, default 0.1
            Error of a part, relative to its root mean square, above which a mode counts as not
            measured.
        object_modes : array (M,) of bool, optional
            Modes of the object, to which the notes are limited. Default: all.

        Returns
        -------
        TimbreField
            The field.

        Raises
        ------
        OptionError
            If recordings have neither a contact nor a listener in common, or no listener is outside
            the body.
        """
        folded = survey.folded()
        parts = Separation.of(folded)
        unmeasured_modes = np.flatnonzero(
            ~(np.maximum(parts.drive_errors, parts.output_errors) < worst)
        )
        outputs, weights = _levelled(parts, folded)
        listener_part = ListenerPart.of(
            folded.places,
            outputs,
            weights,
            2 * np.pi * survey.frequencies / AIR.sound_speed,
            radius=radius,
            mirrored=survey.symmetry == "axial",
            turned=survey.turns,
        )
        unresolved_modes = np.setdiff1d(_too_fine(folded, listener_part), unmeasured_modes)
        is_object_mode = (
            np.ones(len(survey.frequencies), bool) if object_modes is None else object_modes
        )
        notes = _notes(survey, is_object_mode, unmeasured_modes, worst)
        notes += _grid_notes(folded, is_object_mode, unresolved_modes, listener_part, radius)
        return cls(
            contact_part=ContactPart.of(folded.contacts, parts.drives, parts.drive_errors),
            listener_part=replace(listener_part, waves=replace(listener_part.waves, errors=None)),
            centre=survey.centre,
            radius=radius,
            rank_errors=parts.rank_errors,
            unmeasured=np.union1d(unmeasured_modes, unresolved_modes),
            notes=notes,
            is_calibrated=survey.calibrated,
        )

    @property
    def directional(self) -> bool:
        """True: the sound differs with the direction of the listener."""
        return True

    @property
    def axial(self) -> bool:
        """Whether the body was recorded as round about the z axis."""
        return self.listener_part.mirrored

    @property
    def bounds(self) -> tuple[Array, Array]:
        """Lowest and highest contact coordinates (D,); azimuths have none."""
        part = self.contact_part
        unbounded = np.full(self.axes - len(part.spans), np.inf)
        return np.append(part.lowest, -unbounded), np.append(part.lowest + part.spans, unbounded)

    @property
    def count(self) -> int:
        """Number of modes that the gains are of, M."""
        return len(self.rank_errors)

    @property
    def axes(self) -> int:
        """Number of coordinates of a contact, D."""
        return 2 if self.listener_part.turned else len(self.contact_part.spans)

    @property
    def rank(self) -> int:
        """Number of products of a contact and a listener part, R."""
        return self.listener_part.rank

    def at(self, points: Array, directions: Array) -> Array:
        """Interpolate the drives.

        Parameters
        ----------
        points : array (K, D)
            Contact coordinates.
        directions : array (K, 3)
            Has no effect.

        Returns
        -------
        array (K, R, M)
            Drive of each product and mode.

        Raises
        ------
        ContactError
            If the number of coordinates is wrong, or they are outside the recorded range.
        """
        del directions
        places = np.atleast_2d(np.asarray(points, np.float64))
        axes = 2 if self.listener_part.turned else len(self.contact_part.spans)
        if places.shape[1] != axes:
            raise ContactError(
                f"a contact has {places.shape[1]} coordinates: this field has {axes}"
            )
        if not self.listener_part.turned:
            return self.contact_part.at(places)[:, None]
        return (
            self.contact_part.at(places[:, :1])[:, None]
            * _turns(places[:, 1], self.rank // 2)[:, :, None]
        )

    def toward(self, listeners: Array) -> Complex:
        """Interpolate the outputs, relative to the arrival time r/c.

        Parameters
        ----------
        listeners : array (L, 3)
            Positions in body coordinates, m.

        Returns
        -------
        array (L, R, M), complex
            Output of each product and mode.

        Raises
        ------
        ContactError
            If a listener is inside the body, where nothing was recorded.
        """
        places = np.atleast_2d(np.asarray(listeners, np.float64)) - self.centre
        distances = np.linalg.norm(places, axis=1)
        if not len(self.listener_part.inside.places) and distances.min() < self.radius:
            raise ContactError(
                f"a listener is {rounded(distances.min(), 3)} m from the body's centre, inside its "
                f"radius of {rounded(self.radius, 3)} m, where nothing was recorded: move it away"
            )
        return self.listener_part.at(places)

    def deconvolved(self, spectrum: Complex) -> TimbreField:
        """Divide a recorded strike out of the gains.

        Parameters
        ----------
        spectrum : array (M,), complex
            Spectrum of the recorded strike at the pole of each mode.

        Returns
        -------
        TimbreField
            Gains for a force in N.
        """
        part = self.listener_part.chosen(np.arange(self.count), 1.0, 1 / spectrum)
        return replace(self, listener_part=part, is_deconvolved=True)

    def changed(self, frequencies: Array, modes: Index, size: float, density: float) -> TimbreField:
        """Compute the gains of chosen modes of a body with other frequencies, size or density.

        Shapes go with (density size^3)^(-1/2) where a body is pushed and where it radiates;
        directions with the distance over the size, as frequencies do. Contact coordinates stay as
        they are.

        Parameters
        ----------
        frequencies : array (K,)
            Has no effect.
        modes : array (K,) of int
            Numbers of the chosen modes.
        size : float
            Ratio of the new to the present size.
        density : float
            Ratio of the new to the present density.

        Returns
        -------
        TimbreField
            Gains of the changed body.
        """
        del frequencies
        factor = (density * size**3) ** -0.5
        return replace(
            self,
            contact_part=self.contact_part.chosen(modes, factor),
            listener_part=self.listener_part.chosen(modes, size, factor),
            centre=self.centre * size,
            radius=self.radius * size,
            rank_errors=self.rank_errors[modes],
            unmeasured=np.flatnonzero(np.isin(modes, self.unmeasured)),
        )


def _levelled(parts: Separation, survey: Survey) -> tuple[Complex, Array]:
    """Return outputs and weights, equal in all directions for modes below the noise."""
    outputs, weights = parts.outputs.copy(), parts.weights.copy()
    distances = np.linalg.norm(survey.places, axis=1)
    for mode in np.flatnonzero(~(parts.output_errors < LOST)):
        loudest_index = parts.weights[:, mode].argmax()
        outputs[:, mode] = outputs[loudest_index, mode] * distances[loudest_index] / distances
        weights[:, mode] = 1.0
    return outputs, weights


def _notes(
    survey: Survey, is_object_mode: Mask, unmeasured: Index, worst: float
) -> tuple[str, ...]:
    unmeasured = unmeasured[is_object_mode[unmeasured]]
    if not len(unmeasured):
        return ()
    names = ", ".join(f"{frequency:.6g}" for frequency in survey.frequencies[unmeasured])
    note = (
        f"{len(unmeasured)} of {np.count_nonzero(is_object_mode)} modes were not measured to "
        f"{rounded(100 * worst)} %, at {names} Hz: record all listeners with another contact as "
        "well, or with less noise"
    )
    return (note,)


def _too_fine(survey: Survey, part: ListenerPart) -> Index:
    """Return the modes whose gain at a listener is not predicted by the other listeners."""
    if part.waves.errors is None or len(survey.places) - len(part.inside.places) < 2:
        return np.zeros(0, np.int64)
    return np.flatnonzero(part.waves.errors > _MAX_PREDICTION_ERROR)


def _grid_notes(
    survey: Survey, is_object_mode: Mask, modes: Index, part: ListenerPart, radius: float
) -> tuple[str, ...]:
    """Return notes on patterns that the listeners' grid cannot resolve, and the grid needed."""
    notes, modes = [], modes[is_object_mode[modes]]
    azimuth_count, distance = (
        azimuths_of(survey.places),
        np.median(np.linalg.norm(survey.places, axis=1)),
    )
    if distance > _FARTHEST:
        notes.append(f"listeners are {rounded(distance, 3)} m away: give their places in m, not mm")
    if part.mirrored and azimuth_count <= ORDER:
        confusion = f"a mode of {azimuth_count} or more waves around is taken for one of fewer"
        notes.append(
            f"listeners are at {counted(azimuth_count, 'azimuth')} from the contact: "
            f"{confusion if azimuth_count > 1 else 'modes are heard alike all around'}; record on "
            "a spiral, each at another azimuth and height"
        )
    if len(modes):
        tones = survey.frequencies[modes]
        waves = 2 * np.pi * tones.max() / AIR.sound_speed * (radius or part.waves.limit)
        spacing = min(180 / (1 + waves), _spacing(survey.places) / 2)
        names = ", ".join(f"{frequency:.6g}" for frequency in tones)
        notes.append(
            f"the directions of {len(modes)} of {np.count_nonzero(is_object_mode)} modes are finer "
            f"than the listeners can tell, at {names} Hz: it takes listeners {rounded(spacing, 2)} "
            "degrees apart"
        )
    return tuple(notes)


def _spacing(places: Array) -> float:
    """Return the median angle from a listener to the nearest in another direction, degrees."""
    ways = places / np.maximum(np.linalg.norm(places, axis=1), 1e-12)[:, None]
    angles = np.degrees(np.arccos(np.clip(ways @ ways.T, -1, 1)))
    return float(np.median(np.where(angles < 1, 180, angles).min(axis=1)))


def _turns(azimuths: Array, order: int) -> Array:
    """Return 1, cos a, sin a, cos 2 a ... (K, 2 order + 1)."""
    angles = azimuths[:, None] * np.arange(1, order + 1)
    pairs = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(len(azimuths), -1)
    return np.concatenate([np.ones((len(azimuths), 1)), pairs], axis=1)

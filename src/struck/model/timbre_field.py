"""The timbre field: gains over contact and listener, as product of a part of each."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import ContactError
from struck.model.air import AIR
from struck.model.gains import Gains
from struck.model.survey import Survey
from struck.recordings.fields.contact_part import ContactPart
from struck.recordings.fields.listener_part import ListenerPart
from struck.recordings.fields.outgoing import ORDER
from struck.recordings.separation import Separation

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]

WORST = 0.1
"""Error of a part, over its root mean square, from which a mode counts as not measured."""
LOST = 0.5
"""The same from which nothing of a listener part is used but its size."""


@dataclass(frozen=True, kw_only=True, eq=False)
class TimbreField(Gains):
    """Gains of a body as recorded: each mode a contact part times a listener part.

    The parts are interpolated separately: the contact part with its sign, the listener part with
    travel phase and 1/r taken out. A body round about the z axis that is struck all around has
    2 ORDER + 1 products, one for each angular harmonic.

    Parameters
    ----------
    contact_part : ContactPart
    listener_part : ListenerPart
    centre : array (3,)
        Where the sound seems to come from, body coordinates, m.
    radius : float
        Of the ball about it that holds the body, m; 0 where it is not known.
    rank_errors : array (M,)
        How far gains are from a product, relative; NaN where that was not measured.
    unmeasured : array of int
        Modes of which a part is little known, as where the contact that most listeners heard has
        a node. Those that drown in noise are heard alike from all sides, as loud as where they
        were recorded best.
    notes : tuple of str
        What a person should know: which modes are unmeasured, and the way out.
    """

    contact_part: ContactPart
    listener_part: ListenerPart
    centre: Array
    radius: float
    rank_errors: Array
    unmeasured: Index
    notes: tuple[str, ...]
    is_calibrated: bool

    @classmethod
    def of(cls, survey: Survey, *, radius: float = 0.0, worst: float = WORST) -> TimbreField:
        """Make the field of what was recorded.

        Parameters
        ----------
        survey : Survey
        radius : float
            Of a ball about the centre that holds the body, m: listeners in it are inside, and
            where there are none, nobody may listen there.
        worst : float
            Error of a part, over its root mean square, from which a mode is not measured.

        Raises
        ------
        OptionError
            When recordings share neither contact nor listener, or no listener is outside.
        """
        folded = survey.folded()
        parts = Separation.of(folded)
        part_errors = np.maximum(parts.drive_errors, parts.output_errors)
        unmeasured = np.flatnonzero(~(part_errors < worst))
        outputs, weights = _levelled(parts, folded)
        return cls(
            contact_part=ContactPart.of(folded.contacts, parts.drives, parts.drive_errors),
            listener_part=ListenerPart.of(
                folded.places,
                outputs,
                weights,
                2 * np.pi * survey.frequencies / AIR.sound_speed,
                radius=radius,
                mirrored=survey.symmetry == "axial",
                turned=survey.turns,
            ),
            centre=survey.centre,
            radius=radius,
            rank_errors=parts.rank_errors,
            unmeasured=unmeasured,
            notes=_notes(survey, unmeasured, worst),
            is_calibrated=survey.calibrated,
        )

    @property
    def calibrated(self) -> bool:
        """Whether gains are Pa/(N s), not relative."""
        return self.is_calibrated

    @property
    def directional(self) -> bool:
        """Directions differ."""
        return True

    @property
    def rank(self) -> int:
        """How many products there are."""
        return self.listener_part.rank

    def at(self, points: Array, directions: Array) -> Array:
        """Return drives at contact coordinates (K, D): (K, R, M). Directions do not matter.

        Raises
        ------
        ContactError
            At coordinates outside of what was recorded.
        """
        del directions
        places = np.atleast_2d(np.asarray(points, np.float64))
        wanted = 2 if self.listener_part.turned else len(self.contact_part.spans)
        if places.shape[1] != wanted:
            raise ContactError(
                f"a contact has {places.shape[1]} coordinates: this field has {wanted}"
            )
        if not self.listener_part.turned:
            return self.contact_part.at(places)[:, None]
        return self.contact_part.at(places[:, :1])[:, None] * _turns(places[:, 1])[:, :, None]

    def toward(self, listeners: Array) -> Complex:
        """Return outputs at listeners (L, 3), relative to the arrival time r/c: (L, R, M).

        Raises
        ------
        ContactError
            Inside the body, unless something was recorded there.
        """
        places = np.atleast_2d(np.asarray(listeners, np.float64)) - self.centre
        distances = np.linalg.norm(places, axis=1)
        if not len(self.listener_part.inside.places) and distances.min() < self.radius:
            raise ContactError(
                f"a listener is {distances.min():.3g} m from the body's centre, inside its "
                f"radius of {self.radius:.3g} m, where nothing was recorded: move it away"
            )
        return self.listener_part.at(places)

    def changed(self, frequencies: Array, modes: Index, size: float, density: float) -> TimbreField:
        """Return the gains of chosen `modes` of a body with other frequencies, size or density.

        Shapes go with (density size^3)^(-1/2) where a body is pushed and where it radiates;
        directions with the distance over the size, as frequencies do. Contact coordinates stay as
        they are.
        """
        del frequencies
        factor = (density * size**3) ** -0.5
        return TimbreField(
            contact_part=self.contact_part.chosen(modes, factor),
            listener_part=self.listener_part.chosen(modes, size, factor),
            centre=self.centre * size,
            radius=self.radius * size,
            rank_errors=self.rank_errors[modes],
            unmeasured=np.flatnonzero(np.isin(modes, self.unmeasured)),
            notes=self.notes,
            is_calibrated=self.is_calibrated,
        )


def _levelled(parts: Separation, survey: Survey) -> tuple[Complex, Array]:
    """Return outputs and weights, those of modes that drown in noise alike on all sides."""
    outputs, weights = parts.outputs.copy(), parts.weights.copy()
    distances = np.linalg.norm(survey.places, axis=1)
    for mode in np.flatnonzero(~(parts.output_errors < LOST)):
        best = parts.weights[:, mode].argmax()
        outputs[:, mode] = outputs[best, mode] * distances[best] / distances
        weights[:, mode] = 1.0
    return outputs, weights


def _notes(survey: Survey, unmeasured: Index, worst: float) -> tuple[str, ...]:
    if not len(unmeasured):
        return ()
    names = ", ".join(f"{each:.6g}" for each in survey.frequencies[unmeasured])
    note = (
        f"{len(unmeasured)} of {len(survey.frequencies)} modes were not measured to "
        f"{100 * worst:g} %, at {names} Hz: record all listeners with another contact as well, or "
        "with less noise"
    )
    return (note,)


def _turns(azimuths: Array) -> Array:
    """Return 1, cos a, sin a, cos 2 a ... (K, 2 ORDER + 1)."""
    angles = azimuths[:, None] * np.arange(1, ORDER + 1)
    pairs = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(len(azimuths), -1)
    return np.concatenate([np.ones((len(azimuths), 1)), pairs], axis=1)

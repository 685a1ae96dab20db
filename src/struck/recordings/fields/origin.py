"""What a model tells of its gains, once they are sampled from it and not measured."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from struck.model.gains import Gains
from struck.model.model import ModalModel
from struck.model.provenance import Provenance
from struck.model.timbre_field import TimbreField
from struck.recordings.fields.recorded_places import unexpanded

Array = NDArray[np.float64]
Index = NDArray[np.int64]

RECORDED = "recorded"
"""What a model of recordings calls the contact that it is struck at unless told."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Origin:
    """The model that gains were sampled from.

    Parameters
    ----------
    provenance : Provenance
        Of the model.
    errors : array (M,) or None
        Relative errors of its frequencies; NaN where unknown.
    unmeasured : array of int
        Modes of a `TimbreField` of which a part is little known.
    notes : tuple of str
        What a person should know of such a field.
    place : array (D,) or None
        The contact that it called "recorded".
    """

    provenance: Provenance = field(default_factory=Provenance)
    errors: Array | None = None
    unmeasured: Index = field(default_factory=lambda: np.zeros(0, np.int64))
    notes: tuple[str, ...] = ()
    place: Array | None = None

    @classmethod
    def of(cls, model: ModalModel) -> Origin:
        """Ask a model."""
        place = model.places.get(RECORDED)
        told = cls(provenance=model.provenance, errors=model.errors, place=place)
        gains = unexpanded(model.gains)
        if not isinstance(gains, TimbreField):
            return told
        return replace(told, unmeasured=gains.unmeasured, notes=gains.notes)

    def chosen(self, modes: Index) -> Origin:
        """Return what is told of some modes, in their order."""
        return replace(
            self,
            errors=None if self.errors is None else self.errors[modes],
            unmeasured=np.flatnonzero(np.isin(modes, self.unmeasured)),
        )

    def told_to(self, gains: Gains) -> Gains:
        """Return gains with what was known before: of products nothing tells how good they are."""
        if not isinstance(gains, TimbreField):
            return gains
        return replace(
            gains,
            rank_errors=np.full_like(gains.rank_errors, np.nan),
            unmeasured=self.unmeasured,
            notes=self.notes,
        )

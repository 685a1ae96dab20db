"""Which recordings to make: one listener with all contacts, one contact with all listeners."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from struck.errors import OptionError
from struck.model.arrays import Array, Complex, Index

SILENT = -20.0
"""Level of a mode under that at its loudest contact from which a contact counts as silent, dB."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurveyPlan:
    """P + Q recordings that tell what P Q would, since the table of a mode has rank one.

    First the pivot listener hears all contacts. That shows which contact drives all modes: the
    pivot contact, which all other listeners hear then. One pair more, of another contact and
    another listener, checks that contact and listener do separate.

    Parameters
    ----------
    contacts : array (P, D)
        As in `Survey`.
    listeners : array (Q, 3)
        Body coordinates, m.
    listener : int
        The pivot.
    contact, check : int or None
        The pivot contact and the one that checks; None until `after` chose them.
    silent : array of int
        Modes that the pivot contact hardly drives, which the plan will not measure.
    """

    contacts: Array
    listeners: Array
    listener: int
    contact: int | None = None
    check: int | None = None
    silent: Index = field(default_factory=lambda: np.zeros(0, np.int64))

    @classmethod
    def of(
        cls,
        contacts: Array,
        listeners: Array,
        *,
        centre: Array | None = None,
        symmetry: str = "none",
        listener: int | None = None,
    ) -> SurveyPlan:
        """Plan the recordings of P contacts and Q listeners.

        Parameters
        ----------
        centre : array (3,), optional
            Where the sound seems to come from, m; the origin unless given.
        symmetry : str
            As in `Survey`.
        listener : int, optional
            The pivot. Left out: one that no mode avoids by symmetry. With axial symmetry nearest to
            the direction of the contacts, azimuth 0 in the plane z = 0, else farthest from the
            planes x = 0, y = 0 and z = 0.

        Raises
        ------
        OptionError
            When there is no such listener.
        """
        places = listeners - (np.zeros(3) if centre is None else centre)
        pivot = _generic(places, symmetry) if listener is None else listener
        if not 0 <= pivot < len(listeners):
            raise OptionError(f"listener is {pivot}: there are 0 to {len(listeners) - 1}")
        return cls(contacts=contacts, listeners=listeners, listener=pivot)

    def after(self, gains: Complex) -> SurveyPlan:
        """Choose the pivot contact from gains (P, M) of the first recordings.

        It is the one at which modes are strongest over all, compared to where each is loudest: with
        the least mean of the noise that dividing by their drives there would bring.
        """
        powers = np.square(np.abs(gains))
        relative = powers / np.maximum(powers.max(axis=0), np.finfo(np.float64).tiny)
        silent = 10 ** (SILENT / 10)
        order = np.argsort((1 / np.maximum(relative, silent / 4)).mean(axis=1), kind="stable")
        return replace(
            self,
            contact=int(order[0]),
            check=int(order[1]) if len(order) > 1 else None,
            silent=np.flatnonzero(relative[order[0]] < silent),
        )

    @property
    def first(self) -> Index:
        """Contact and listener of the recordings to begin with (P, 2)."""
        numbers = np.arange(len(self.contacts))
        return np.stack([numbers, np.full_like(numbers, self.listener)], axis=1)

    @property
    def rest(self) -> Index:
        """Contact and listener of those that follow (at most Q, 2).

        Raises
        ------
        OptionError
            Before the pivot contact was chosen.
        """
        if self.contact is None:
            raise OptionError("the pivot contact is not chosen yet: record `first`, then `after`")
        others = np.delete(np.arange(len(self.listeners)), self.listener)
        row = np.stack([np.full_like(others, self.contact), others], axis=1)
        if self.check is None or not len(others):
            return row
        gaps = np.linalg.norm(self.listeners - self.listeners[self.listener], axis=1)
        return np.append(row, [[self.check, int(gaps.argmax())]], axis=0)

    @property
    def pairs(self) -> Index:
        """Contact and listener of all recordings (P + Q, 2)."""
        return np.concatenate([self.first, self.rest])


def _generic(places: Array, symmetry: str) -> int:
    """Return the number of a listener in whose direction every mode sends something."""
    distances = np.linalg.norm(places, axis=1)
    directions = places / np.where(distances > 0, distances, np.inf)[:, None]
    if symmetry == "axial":
        return int(directions[:, 0].argmax())
    return int(np.abs(directions).min(axis=1).argmax())

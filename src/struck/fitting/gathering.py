"""Gains of many hits and channels, gathered into what a timbre field is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import RecordingError
from struck.fitting.arrival import arrivals
from struck.model.survey import Survey
from struck.recordings.alignment import aligned, averaged
from struck.recordings.gain_table import Recorded
from struck.recordings.poles.fitted import Fitted

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]

_FINEST = 1e-6
"""No gain is known better than this, as a share of the largest of its mode."""
_MOST_GROWN = 1.0
"""A mode that has died away by more nepers before its hit is fitted is hardly known at the hit."""
_SLOWEST = 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gathered:
    """Gains of each channel of each hit, all as of the same moment after the sound arrived.

    Parameters
    ----------
    gains, errors : array (n, M)
        Complex gains and their standard errors.
    poles : array (M,), complex
        1/s.
    hits, takes, channels : array (n,)
        What each row belongs to; hits count on from take to take.
    arrivals : array (n,)
        When the sound of each row arrived, s in its take.
    lead : float
        From the arrival of a hit to the moment of the gains, s: until then it is being struck.
    """

    gains: Complex
    errors: Array
    poles: Complex
    hits: Index
    takes: Index
    channels: Index
    arrivals: Array
    lead: float

    @classmethod
    def of(cls, fitted: Fitted, recorded: Recorded) -> Gathered:
        """Gather what was fitted."""
        rows = fitted.rows
        arrived = arrivals(fitted, recorded)
        later = np.array([row.time for row in rows]) - arrived
        lead = float(np.median(later))
        growth = np.outer(later - lead, fitted.decays)
        turns = np.outer(later - lead, 2 * np.pi * fitted.frequencies)
        turned = np.exp(np.minimum(growth, _MOST_GROWN) - 1j * turns)
        gains = np.asarray(fitted.gains * turned, np.complex128)
        errors = fitted.gain_errors * np.abs(turned)
        errors = np.where(growth > _MOST_GROWN, np.maximum(errors, np.abs(gains)), errors)
        finest = _FINEST * np.maximum(np.abs(gains).max(axis=0, initial=0.0), 1e-300)
        hits = list(dict.fromkeys((row.take, row.hit) for row in rows))
        return cls(
            gains=gains,
            errors=np.maximum(errors, finest),
            poles=-fitted.decays + 2j * np.pi * fitted.frequencies,
            hits=np.array([hits.index((row.take, row.hit)) for row in rows]),
            takes=np.array([row.take for row in rows]),
            channels=np.array([row.channel for row in rows]),
            arrivals=arrived,
            lead=lead,
        )

    @property
    def energies(self) -> Array:
        """Energies (n, M) that modes have over their time."""
        return np.abs(self.gains) ** 2 / (2 * np.maximum(-self.poles.real, _SLOWEST))

    def survey(self, recorded: Recorded) -> Survey:
        """Return what was recorded of contacts, listeners, or both.

        Where nobody told the listeners, the microphone counts as one place 1 m away; where nobody
        told the contacts, as one contact.

        Raises
        ------
        RecordingError
            When takes without listeners have different numbers of channels.
        """
        told = self if recorded.listeners is not None else self.in_one_channel()
        places, contact = _contacts(recorded, told.takes)
        microphones, listener = _listeners(recorded, told)
        gains, errors = aligned(told.gains, told.errors, told.hits, contact, listener, told.poles)
        pairs, gains, errors = averaged(gains, errors, np.stack([contact, listener], axis=1))
        return Survey(
            contacts=places,
            listeners=microphones,
            pairs=pairs,
            gains=gains,
            frequencies=told.poles.imag / (2 * np.pi),
            errors=errors,
            centre=recorded.centre,
            symmetry=recorded.symmetry,
        )

    def in_one_channel(self) -> Gathered:
        """Return one row for each hit: in each mode that of the channel that hears it best.

        Its size is the root mean square over channels, in the mean over hits.

        Raises
        ------
        RecordingError
            When takes have different numbers of channels.
        """
        counts = np.bincount(self.hits)
        if np.ptp(counts):
            raise RecordingError(
                f"takes have {counts.min()} and {counts.max()} channels, and nobody told where "
                "their microphones were: give listeners, or the same number of channels in all"
            )
        rows = np.argsort(self.hits, kind="stable").reshape(len(counts), -1)  # of a hit in order
        energies = self.energies[rows].sum(axis=0)
        best, modes = energies.argmax(axis=0), np.arange(self.gains.shape[1])
        level = np.sqrt(energies.mean(axis=0) / np.maximum(energies[best, modes], 1e-300))
        chosen = rows[:, best], modes
        return Gathered(
            gains=self.gains[chosen] * level,
            errors=self.errors[chosen] * level,
            poles=self.poles,
            hits=self.hits[rows[:, 0]],
            takes=self.takes[rows[:, 0]],
            channels=self.channels[rows[:, 0]],
            arrivals=self.arrivals[rows[:, 0]],
            lead=self.lead,
        )

    def in_one_point(self) -> Complex:
        """Return the gains (M,) of one contact, heard at one place: how the object rings as a rule.

        The size of each mode is its root mean square over hits, each brought to the strength of
        the loudest one; phases are that one's.

        Raises
        ------
        RecordingError
            When takes have different numbers of channels.
        """
        one = self.in_one_channel()
        energies = one.energies.sum(axis=1)
        loudest = int(energies.argmax())
        shares = np.abs(one.gains) ** 2 / energies[:, None]
        sure = one.errors < np.abs(one.gains)
        sure[loudest] |= ~sure.any(axis=0)
        mean = (shares * sure).sum(axis=0) / sure.sum(axis=0)
        turns = one.gains[loudest] / np.maximum(np.abs(one.gains[loudest]), 1e-300)
        phases = np.where(one.gains[loudest] == 0, 1.0, turns)
        return np.asarray(np.sqrt(mean * energies[loudest]) * phases, np.complex128)


def _contacts(recorded: Recorded, takes: Index) -> tuple[Array, Index]:
    """Return each contact once, and the number of that of each row."""
    if recorded.contacts is None:
        return np.zeros((1, 1)), np.zeros(len(takes), np.int64)
    places, number = np.unique(recorded.contacts, axis=0, return_inverse=True)
    return places, number.reshape(-1)[takes]


def _listeners(recorded: Recorded, told: Gathered) -> tuple[Array, Index]:
    """Return each listener once, m, and the number of that of each row."""
    if recorded.listeners is None:
        return recorded.centre + np.array([[1.0, 0.0, 0.0]]), np.zeros(len(told.takes), np.int64)
    every = np.array(
        [
            recorded.listeners[take][channel]
            for take, channel in zip(told.takes, told.channels, strict=True)
        ]
    )
    places, number = np.unique(every, axis=0, return_inverse=True)
    return places, number.reshape(-1)

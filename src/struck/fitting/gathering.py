"""Gains of many hits and channels, gathered into what a timbre field is made of."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import RecordingError
from struck.fitting.arrival import arrivals
from struck.fitting.recorded import Recorded
from struck.recordings.fields.alignment import aligned, averaged
from struck.recordings.fields.survey import Survey
from struck.recordings.poles.fit import Fitted

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Index = NDArray[np.int64]

_FINEST = 1e-6
"""No gain is known better than this, as a share of the largest of its mode."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gathered:
    """Gains of each channel of each hit, all as of the same moment after the sound arrived.

    Parameters
    ----------
    gains, errors : array (n, M)
        Complex gains and their standard errors.
    hits, takes, channels : array (n,)
        What each row belongs to; hits count on from take to take.
    arrivals : array (n,)
        When the sound of each row arrived, s in its take.
    lead : float
        From the arrival of a hit to the moment of the gains, s: until then it is being struck.
    """

    gains: Complex
    errors: Array
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
        poles = -fitted.decays + 2j * np.pi * fitted.frequencies
        turned = np.exp(-np.outer(later - lead, poles))
        numbers = {(row.take, row.hit): None for row in rows}
        order = {hit: number for number, hit in enumerate(numbers)}
        gains = np.asarray(fitted.gains * turned, np.complex128)
        finest = _FINEST * np.maximum(np.abs(gains).max(axis=0, initial=0.0), 1e-300)
        return cls(
            gains=gains,
            errors=np.maximum(fitted.gain_errors * np.abs(turned), finest),
            hits=np.array([order[row.take, row.hit] for row in rows]),
            takes=np.array([row.take for row in rows]),
            channels=np.array([row.channel for row in rows]),
            arrivals=arrived,
            lead=lead,
        )

    def survey(self, recorded: Recorded, frequencies: Array) -> Survey:
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
        gains, errors = aligned(told.gains, told.errors, told.hits, contact, listener, frequencies)
        pairs, gains, errors = averaged(gains, errors, np.stack([contact, listener], axis=1))
        return Survey(
            contacts=places,
            listeners=microphones,
            pairs=pairs,
            gains=gains,
            frequencies=frequencies,
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
        channels = [self.channels == channel for channel in np.unique(self.channels)]
        energies = np.stack([(np.abs(self.gains[own]) ** 2).sum(axis=0) for own in channels])
        best, modes = energies.argmax(axis=0), np.arange(self.gains.shape[1])
        level = np.sqrt(energies.mean(axis=0) / np.maximum(energies[best, modes], 1e-300))
        first = channels[0]
        chosen = [np.stack([each[own] for own in channels]) for each in (self.gains, self.errors)]
        gains, errors = (each[best, :, modes].T * level for each in chosen)
        return Gathered(
            gains=gains,
            errors=np.asarray(errors, np.float64),
            hits=self.hits[first],
            takes=self.takes[first],
            channels=self.channels[first],
            arrivals=self.arrivals[first],
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
        energies = (np.abs(one.gains) ** 2).sum(axis=1)
        loudest = one.gains[energies.argmax()]
        shares = np.abs(one.gains) ** 2 / energies[:, None]
        sizes = np.sqrt(shares.mean(axis=0) * energies.max())
        phases = np.where(loudest == 0, 1.0, loudest / np.maximum(np.abs(loudest), 1e-300))
        return np.asarray(sizes * phases, np.complex128)


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

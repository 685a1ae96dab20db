"""A pluck: a load put on softly and let go."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from struck.excitation.bounds import freeze_place, require_at_least_zero, require_positive
from struck.excitation.excitation import Burst, burst_of
from struck.excitation.pulses import LEAD, Samples, low_pass
from struck.model.contact import Place
from struck.model.model import ModalModel

Array = NDArray[np.float64]

_FINE = 256


@dataclass(frozen=True, slots=True, kw_only=True)
class Pluck:
    """A body pulled aside and let go.

    The force rises over `rise` as half a cosine, slowly enough not to be heard, and ends at once.
    A step of force F excites a mode of frequency f as an impulse F / (2 pi f) would. So the upper
    modes of a plucked string are weaker by 1/n than those of a struck one: amplitudes fall as
    1/n^2 where those fall as 1/n (1998, section 6).

    Parameters
    ----------
    at : array-like, str or None
        Place, as for a strike.
    force : float
        The load that is let go, N.
    rise : float
        How long it takes to put on, s. Modes below about 2 / rise hear it come.
    time : float
        When the load begins to rise, s; it is let go at time + rise.
    direction : array-like (3,) or None
        Which way the load pushes, of any length; None is straight into the surface.
    patch : float
        Radius of the area of contact, m; 0 is a point.

    Raises
    ------
    OptionError
        On a number outside its bound.
    """

    at: Place = None
    force: float = 1.0
    rise: float = 0.05
    time: float = 0.0
    direction: Place = None
    patch: float = 0.0

    def __post_init__(self) -> None:
        freeze_place(self, "direction")
        require_positive(force=self.force, rise=self.rise)
        require_at_least_zero(time=self.time, patch=self.patch)

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Burst:
        """Begin on a model at sample number `start`; see `struck.excitation.pushing`.

        The moment of release lies between samples as it falls; the force is band-limited there
        like a pulse.

        Raises
        ------
        ContactError
            When it touches no body.
        """
        return burst_of(self, model, sample_rate, start=start)

    def sampled(self, sample_rate: float) -> Samples:
        """Return the force, N."""
        first = int(np.floor(self.time * sample_rate))
        release = (self.time + self.rise) * sample_rate
        numbers = np.arange(first, int(np.ceil(release)) + LEAD, dtype=np.float64)
        risen = np.clip((numbers / sample_rate - self.time) / self.rise, 0, 1)
        load = self.force * np.sin(np.pi / 2 * risen) ** 2
        return Samples(first=first, force=load * (1 - _step(numbers - release)))


def _step(positions: Array) -> Array:
    """Return a band-limited step from 0 to 1, over positions in samples."""
    table = _step_table()
    return np.interp(positions, np.linspace(-LEAD, LEAD, len(table)), table)


@cache
def _step_table() -> Array:
    pulse = low_pass(np.linspace(-LEAD, LEAD, 2 * LEAD * _FINE + 1))
    rising = np.concatenate([[0.0], np.cumsum(pulse[1:] + pulse[:-1])])
    return rising / rising[-1]

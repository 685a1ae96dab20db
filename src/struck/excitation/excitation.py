"""A finite stretch of force at one place: what a strike, a pluck and a recorded force come to."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from struck.excitation.bounds import require_positive
from struck.excitation.contact_patch import drive
from struck.excitation.pulses import Samples
from struck.excitation.pushing import Push
from struck.model.contact import Contact, Place
from struck.model.model import ModalModel

Array = NDArray[np.float64]


class Sampled(Protocol):
    """A force at one place that is known beforehand."""

    @property
    def at(self) -> Place:
        """Where it acts."""
        ...

    @property
    def direction(self) -> Place:
        """Which way it pushes."""
        ...

    @property
    def patch(self) -> float:
        """Radius of the area of contact, m."""
        ...

    def sampled(self, sample_rate: float) -> Samples:
        """Return the force, N."""
        ...


def burst_of(excitation: Sampled, model: ModalModel, sample_rate: float, *, start: int) -> Burst:
    """Begin a force on a model; ContactError when it touches no body."""
    require_positive(sample_rate=sample_rate)
    contact = model.contact(excitation.at, excitation.direction)
    samples, patch = excitation.sampled(sample_rate), excitation.patch
    driven = drive(model, contact, radius=patch)
    return Burst(samples, driven, start=start, contact=contact, patch=patch)


class Burst:
    """A `Pushing` that hands out given samples.

    Parameters
    ----------
    samples : Samples
        The force, counted from sample 0 of the sound.
    drive : array (M,)
        How strongly each mode answers, kg^-1/2.
    start : int
        Number of the sample at which the first block begins; what lies before it is lost.
    contact : Contact or None
        Where it acts; without it the drive stays when the body changes.
    patch : float
        Radius of the area of contact, m.
    """

    def __init__(
        self,
        samples: Samples,
        drive: Array,
        *,
        start: int = 0,
        contact: Contact | None = None,
        patch: float = 0.0,
    ) -> None:
        self._samples = samples
        self._drive = drive
        self._now = start
        self._contact, self._patch = contact, patch

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, None where there is no force in them."""
        offset = self._now - self._samples.first
        self._now += length
        part = self._samples.force[max(offset, 0) : max(offset + length, 0)]
        if not len(part):
            return None
        force = np.zeros(length)
        begin = max(-offset, 0)
        force[begin : begin + len(part)] = part
        return Push(force=force, drive=self._drive)

    def change(self, model: ModalModel) -> None:
        """Push at the same place of a body that has changed, where the place is known."""
        if self._contact is not None:
            self._drive = drive(model, self._contact, radius=self._patch)

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return self._now >= self._samples.first + len(self._samples.force)

"""A hand that holds a ringing body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from struck.excitation.contact_patch import drive_at
from struck.excitation.excitation import freeze_place, require_at_least_zero, require_positive
from struck.model.arrays import Array
from struck.model.contact import Place
from struck.model.model import ModalModel


@dataclass(frozen=True, slots=True, kw_only=True)
class Hold:
    """A soft grip that takes energy from the modes that move where it holds.

    A grip of c N s/m resists motion at its place in every direction. It raises the decay of a mode
    by c / 2 times the square of its mass-normalised shape there: modes with a node under the hand
    ring on.

    Parameters
    ----------
    at : array-like, str or None
        Place, as for a strike.
    grip : float
        N s/m; a finger on a bell is some 10.
    time : float
        When it takes hold, s.
    seconds : float or None
        For how long; None: for good.
    patch : float
        Radius of the area held, m; 0 is a point.

    Raises
    ------
    OptionError
        On a number outside its bound.
    """

    at: Place = None
    grip: float = 10.0
    time: float = 0.0
    seconds: float | None = None
    patch: float = 0.0

    def __post_init__(self) -> None:
        freeze_place(self)
        require_positive(seconds=self.seconds)
        require_at_least_zero(grip=self.grip, time=self.time, patch=self.patch)

    def holds_at(self, time: float) -> bool:
        """Tell whether it holds at a time, s."""
        return self.time <= time < self.time + (np.inf if self.seconds is None else self.seconds)

    def raised(self, model: ModalModel) -> Array:
        """Return by how much it raises each decay, 1/s (M,).

        Raises
        ------
        ContactError
            When it touches no body.
        """
        contact = model.contact(self.at)
        moved = [
            drive_at(model, contact.point, contact.normal, axis, radius=self.patch)
            for axis in np.eye(3)
        ]
        return self.grip / 2 * np.square(moved).sum(axis=0)

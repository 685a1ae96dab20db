"""One body while it is played: where it is touched, what holds it, how it is heard."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from struck.ears.listeners import Listener, is_listener, position_of
from struck.ears.pose import aside
from struck.errors import OptionError
from struck.excitation.contact_patch import drive
from struck.excitation.hold import Hold
from struck.model.contact import Contact, Place
from struck.model.model import ModalModel
from struck.scene.body import centre_of, place_beside, radius_of
from struck.synth.poles import Complex, Poles

Array = NDArray[np.float64]
Kept = TypeVar("Kept")

_KEPT = 256  # contacts, and drives, that are not looked up again


class Played:
    """A model, and what hands do to it.

    Parameters
    ----------
    model : ModalModel
        What rings.
    sample_rate : float
        Hz.

    Raises
    ------
    OptionError
        Where the model is not fit to ring.
    """

    def __init__(self, model: ModalModel, sample_rate: float) -> None:
        self.model = model
        self.free = Poles.of(model, sample_rate)
        self._rate = sample_rate
        self._contacts: dict[Hashable, Contact] = {}
        self._drives: dict[Hashable, Array] = {}
        self._holds: dict[Hashable, tuple[Hold, Array]] = {}

    def contact(self, at: Contact | Place = None, direction: Place = None) -> Contact:
        """Return a contact, the same object for the same place."""
        if isinstance(at, Contact):
            return at
        key = (_hashable(at), _hashable(direction))
        known = self._contacts.get(key)
        return known or _keep(self._contacts, key, self.model.contact(at, direction))

    def drive(self, contact: Contact, patch: float = 0.0) -> Array:
        """Return how strongly each mode answers, the same object for the same contact."""
        key = (*contact.point.tolist(), *contact.direction.tolist(), patch)
        known = self._drives.get(key)
        if known is None:
            known = _keep(self._drives, key, drive(self.model, contact, radius=patch))
        return known

    def hold(self, at: Place, grip: float) -> None:
        """Hold it somewhere with a viscous grip, N s/m (`Hold`); 0 lets go."""
        place = tuple(self.contact(at).point.tolist())
        hold = Hold(at=place, grip=grip)
        self._holds.pop(place, None)
        if grip:
            self._holds[place] = hold, hold.raised(self.model)

    def changed(self, model: ModalModel) -> Played:
        """Return another body in the same hands.

        Raises
        ------
        OptionError
            Where the model is not fit to ring, or has another number of modes.
        """
        other = Played(model, self._rate)
        self.free.require_size(other.free.values, "the changed model")
        for hold, _ in self._holds.values():
            other.hold(hold.at, hold.grip)
        return other

    @property
    def logarithms(self) -> Complex:
        """What a sample turns each mode by, in its logarithm, (M,); hands raise the decays."""
        values = self.free.values
        for _, raised in self._holds.values():
            values = values - (values != 0) * raised
        return values / self._rate

    def outputs(self, listener: Array) -> Complex:
        """Return how loudly each mode is heard at a position, (M,).

        Raises
        ------
        ContactError
            Where the listener is inside the body.
        OptionError
            Where the gains are no product of contact and listener, or are not finite.
        """
        gains = self.model.gains.toward(listener[None])[0]
        if len(gains) != 1 or not np.isfinite(gains).all():
            raise OptionError(
                f"the gains are a sum of {len(gains)} products of contact and listener, or not "
                "finite: playing needs one product; use the model's expanded() gains"
            )
        return gains[0]

    def outputs_aside(self) -> Complex:
        """Return how loudly each mode would be heard at 1 m were it a point, (M,)."""
        far = place_beside(self.model)
        return far[0] * self.outputs(centre_of(self.model) + far)


def listening(listener: Any) -> Array | Listener:  # noqa: ANN401 - whatever is no listener
    """Return a listener, or a position (3,); OptionError on what is neither."""
    return listener if is_listener(listener) else position_of(listener)


def default_listener(models: Sequence[ModalModel]) -> Array:
    """Return a position on the x axis through the first centre, 1 m or two radii of all away."""
    centre = centre_of(models[0])
    farthest = max(radius_of(replace(model, centre=centre)) for model in models)
    return centre + aside(farthest)


def _hashable(place: Place) -> Hashable:
    if place is None or isinstance(place, str):
        return place
    return tuple(np.asarray(place, np.float64).ravel().tolist())


def _keep(known: dict[Hashable, Kept], key: Hashable, value: Kept) -> Kept:
    """Remember one more, forget the oldest where there are too many; any thread may call it."""
    if len(known) >= _KEPT:
        known.pop(list(known)[0], None)  # noqa: RUF015 - no other thread comes between in `list`
    return known.setdefault(key, value)

"""Offline sound: bodies and what happens to them, in; samples, out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from struck.driven import LONGEST_RING, SHORTEST_RING
from struck.ears.listeners import Listener, Mono, is_listener, position_of
from struck.ears.room import Room
from struck.errors import OptionError
from struck.files.sound import Sound
from struck.model.model import ModalModel
from struck.scene.body import Action, Body, centre_of, place_beside
from struck.scene.one_body import dry_sound
from struck.scene.render import mixed

__all__ = ["LONGEST_RING", "LONGEST_SOUND", "SHORTEST_RING", "Action", "render"]

LONGEST_SOUND = 3600.0
"""The largest `seconds`."""


def render(
    model: ModalModel | Body | Sequence[Body],
    excitations: Action | Sequence[Action] = (),
    *,
    seconds: float | None = None,
    sample_rate: int = 48000,
    listener: Listener | ArrayLike | None = None,
    room: Room | None = None,
) -> Sound:
    """Return what a listener hears of bodies that are struck, scraped, rolled on, plucked or held.

    Parameters
    ----------
    model : ModalModel, Body, or several bodies
        What sounds; a `Body` is a model with its place in the scene and what happens to it.
    excitations : Strike, Scrape, Roll, Pluck, ForceTrack, Hold, or several of them
        What pushes a single model and what holds it.
    seconds : float or None
        Length of the sound. None: until 60 dB of decay of the slowest among the loud modes (within
        40 dB of the loudest), at most 10 s after the last push.
    sample_rate : int
        Hz. Modes at or above half of it are left out, and the sound's notes say how many.
    listener : Mono, Stereo, Binaural, array-like (3,) or None
        Who hears it. A bare position in body coordinates, m, is one ear for which the travel time
        is left out: what a contact sends at t is heard at t. None: on the body's x axis through its
        centre, 1 m or two of its radii away, whichever is farther; several bodies are heard by
        `Mono()`.
    room : Room or None
        Whose walls reflect, for listeners other than a bare position.

    Returns
    -------
    Sound
        A channel for each ear, left first, in Pa when the models are calibrated.

    Raises
    ------
    OptionError
        On nothing to render, arguments outside their bounds, gains that are not finite, or pushes
        that never end where no length is said.
    ContactError
        On a contact off the body, or a listener inside one.

    Notes
    -----
    p(t) = sum_n Im[g_n exp((-d_n + 2 pi i f_n) t)] is the answer to a unit impulse. Half-sine
    strikes at points are convolved with it in closed form (`struck.synth.ring_down`); all else goes
    through `struck.synth.resonators`, strikes too where a hand holds the body.
    """
    _require_bounds(seconds, sample_rate)
    if isinstance(model, ModalModel) and not (room or is_listener(listener)):
        body = Body(model=model, excitations=excitations)
        place = (
            centre_of(model) + place_beside(model) if listener is None else position_of(listener)
        )
        arrived = dry_sound(model, body.actions, place, seconds=seconds, sample_rate=sample_rate)
        return Sound(
            samples=arrived.samples.astype(np.float32),
            sample_rate=sample_rate,
            calibrated=model.calibrated,
            notes=arrived.notes,
        )
    return mixed(
        _bodies(model, excitations),
        _someone(listener),
        seconds=seconds,
        sample_rate=sample_rate,
        room=room,
    )


def _bodies(
    model: ModalModel | Body | Sequence[Body], excitations: Action | Sequence[Action]
) -> Sequence[Body]:
    if isinstance(model, ModalModel):
        return (Body(model=model, excitations=excitations),)
    bodies = (model,) if isinstance(model, Body) else tuple(model)
    if not bodies or not all(isinstance(each, Body) for each in bodies):
        raise OptionError(f"{model!r} are no bodies: give a ModalModel, or Body(...) for each")
    if excitations:
        raise OptionError("a Body brings its own excitations: give them there")
    return bodies


def _someone(listener: Listener | ArrayLike | None) -> Listener:
    if listener is None or is_listener(listener):
        return listener or Mono()
    return Mono(position=tuple(position_of(listener).tolist()))


def _require_bounds(seconds: float | None, sample_rate: int) -> None:
    if seconds is not None and not 0 < seconds <= LONGEST_SOUND:
        raise OptionError(f"seconds is {seconds}: it must lie above 0 and at most at 3600")
    if not (sample_rate >= 1 and float(sample_rate).is_integer()):
        raise OptionError(f"sample_rate is {sample_rate}: give a whole number of Hz, such as 48000")

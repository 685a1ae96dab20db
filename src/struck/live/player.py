"""Bodies that sound while they are touched: the live counterpart of `render`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.ears.listeners import Listener
from struck.errors import OptionError
from struck.excitation.pulses import LEAD, Samples, sampled
from struck.excitation.pushing import Excitation
from struck.excitation.strike import Strike
from struck.excitation.tool import Tool
from struck.excitation.touch_log import TouchLog
from struck.live.outlet import DeviceOutlet, Outlet
from struck.live.played import default_listener, listening
from struck.live.pushes import Started
from struck.live.running import Running
from struck.model.contact import Contact, Place
from struck.model.model import ModalModel

Array = NDArray[np.float64]

QUIETEST, LOUDEST = -120.0, 60.0
"""Bounds of the volume, dB."""


class Player(Running):
    """Bodies that are struck, scraped, touched and held while they sound.

    `struck.play` makes it. All of its methods may be called from any thread, at any rate: they
    return at once, and what they say is heard two blocks and the device's own latency later, in
    order and as far apart as it was said.

    Parameters
    ----------
    models : sequence of ModalModel
        One or more bodies, in one system of coordinates.
    listener : Mono, Stereo, Binaural or array-like (3,), optional
        Who hears them, as for `render`; with a position and a direction that stay until
        `listener` is set anew.
    outlet : Outlet
        Where sound leaves: an audio device.
    block : int
        Samples for each call of the device.
    volume : float
        dB. At 0 the default strike of the loudest body peaks at -12 dB of full scale.
    voices : int
        Excitations at once; strikes at one place share one.
    ahead : int
        Blocks of forces kept ready: more of them bear a busier machine, and are heard later.
    """

    def __init__(
        self,
        models: Sequence[ModalModel],
        *,
        outlet: Outlet,
        listener: Listener | ArrayLike | None = None,
        block: int = 128,
        volume: float = 0.0,
        voices: int = 16,
        ahead: int = 2,
    ) -> None:
        if not models:
            raise OptionError("there is nothing to play: give at least one model")
        _require_volume(volume)
        super().__init__(
            models,
            outlet=outlet,
            listener=default_listener(models) if listener is None else listening(listener),
            block=block,
            volume=volume,
            voices=voices,
            ahead=ahead,
        )

    def strike(self, strike: Strike | None = None, *, body: int = 0, **given: Any) -> None:  # noqa: ANN401 - of `Strike`
        """Strike a body.

        Where there is no voice for it the strike is left out and counted in `dropped`.

        Parameters
        ----------
        strike : Strike, optional
            Its `time` counts from now.
        body : int
            Which one.
        **given
            What makes a `Strike`, in place of one.

        Raises
        ------
        DeviceError
            Where the device has gone.
        ContactError, OptionError
            On a strike that is not possible.
        """
        if strike is not None and given:
            raise OptionError(f"a Strike and {', '.join(given)}: give one or the other")
        self._require_playing()
        if not self._desk.has_room():
            return
        blow = Strike(**given) if strike is None else strike
        struck = self._desk.body(body)
        if blow.transient:
            self.start(blow, body=body)
            return
        contact = struck.contact(blow.at, blow.direction)
        pulse = self._pulse(blow, struck.model, contact)
        self._desk.strike(body, struck.drive(contact, blow.patch), pulse)

    def start(self, excitation: Excitation, *, body: int = 0) -> Started:
        """Start any excitation; its `time` counts from now.

        Returns
        -------
        Started
            With `stop()`, which lets it go within 5 ms, and `finished`: at once where there is no
            voice for it, which `dropped` counts.

        Raises
        ------
        DeviceError, ContactError, OptionError
            As for `strike`.
        """
        self._require_playing()
        rate = self._outlet.sample_rate
        pushing = excitation.begin(self._desk.body(body).model, rate, start=-LEAD)
        started = Started(pushing, rate)
        self._desk.start(body, started)
        return started

    def touch(
        self,
        at: Contact | Place,
        force: float,
        velocity: float | ArrayLike = 0.0,
        *,
        direction: Place = None,
        body: int = 0,
        finger: int = 0,
        tool: Tool | None = None,
    ) -> None:
        """Say where a hand, a tool or a haptic device is, how hard it presses and how it moves.

        Call it 60 to 1000 times a second while it touches, and once with force 0 when it lets go.

        Parameters
        ----------
        at : Contact, array-like or str
            Place, as for a strike.
        force : float
            Load, N; 0 lets go.
        velocity : float or array-like
            Along the surface, m/s; its magnitude counts.
        direction : array-like (3,), optional
            Along which it presses; straight into the surface unless given.
        body, finger : int
            Which body, and which of several touches on it.
        tool : Tool, optional
            What touches, said with the first touch of a finger.

        Raises
        ------
        DeviceError, ContactError, OptionError
            As for `strike`.
        """
        self._require_playing()
        contact = self._desk.body(body).contact(at, direction)
        touching, _ = self._desk.touching(body, finger, tool)
        self._desk.touch(body, finger, touching.word(contact, force, velocity))

    def touch_log_of(self, *, body: int = 0, finger: int = 0) -> TouchLog:
        """Return what a touch did so far (its last 60,000 updates), to be rendered offline.

        Its times count from when the player began.

        Raises
        ------
        OptionError
            Where there was no such touch.
        """
        return self._desk.notes(body, finger).log()

    @property
    def touch_log(self) -> TouchLog:
        """What the first touch of the first body did so far; see `touch_log_of`."""
        return self.touch_log_of()

    def dampen(self, at: Place, grip: float, *, body: int = 0) -> None:
        """Hold a body by a hand.

        Parameters
        ----------
        at : array-like or str
            Where.
        grip : float
            Viscous, N s/m, as of a `Hold`; 0 lets go there. Modes that move more there decay
            faster; frequencies stay.
        body : int
            Which one.

        Raises
        ------
        DeviceError, ContactError, OptionError
            As for `strike`.
        """
        self._require_playing()
        self._desk.dampen(body, at, grip)

    def change(self, model: ModalModel, *, body: int = 0) -> None:
        """Let a body go on as another, such as one of another material; it may ring meanwhile.

        Raises
        ------
        DeviceError
            Where the device has gone.
        OptionError
            Where it has another number of modes, or is not fit to ring.
        """
        self._require_playing()
        self._desk.change(body, model)

    @property
    def listener(self) -> Array | Listener:
        """Where all bodies are heard, m (3,), or with which ears.

        Ears go to a new place, and turn, within some 10 ms; what is on its way arrives there.
        """
        return self._desk.listener

    @listener.setter
    def listener(self, listener: Listener | ArrayLike) -> None:
        self._require_playing()
        self._desk.listen(listening(listener))

    @property
    def volume(self) -> float:
        """dB; at 0 the default strike of the loudest body peaks at -12 dB of full scale."""
        return self._desk.volume

    @volume.setter
    def volume(self, decibels: float) -> None:
        self._require_playing()
        _require_volume(decibels)
        self._desk.volume = decibels

    def _pulse(self, blow: Strike, model: ModalModel, contact: Contact) -> Samples:
        resolved = blow.resolved(model, contact)
        return sampled(
            blow.shape,
            impulse=resolved.impulse,
            onset=blow.time,
            duration=resolved.duration,
            sample_rate=self.sample_rate,
        )


def _require_volume(decibels: float) -> None:
    if not QUIETEST <= decibels <= LOUDEST:
        raise OptionError(f"volume is {decibels}: it must lie from {QUIETEST:g} to {LOUDEST:g} dB")


def play(
    models: Sequence[ModalModel],
    *,
    device: int | str | None = None,
    sample_rate: float | None = None,
    **options: Any,  # noqa: ANN401 - of `Player`
) -> Player:
    """Return a running player on an audio device; see `struck.play`."""
    outlet = DeviceOutlet(device, sample_rate)
    try:
        player = Player(models, outlet=outlet, **options)
        player.begin()
    except BaseException:
        outlet.close()
        raise
    return player

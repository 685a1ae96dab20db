"""Bodies that sound while they are touched: the live counterpart of `render`.

A `Player` queues what its user says (`struck.live.commands`). A thread, the `Feeder`, makes a
record of it for each block and keeps a ring of them filled ahead of the audio device, whose
callback (`struck.live.callback`) reads them without Python.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import Any, Protocol, Self

from numpy.typing import ArrayLike

from struck.ears.listeners import Listener
from struck.errors import DeviceError, OptionError
from struck.excitation.excitation import Excitation
from struck.excitation.friction import Tool
from struck.excitation.pulses import LEAD
from struck.excitation.strike import Strike
from struck.excitation.touch import TouchLog
from struck.live import callback, limiter
from struck.live.callback import OPEN, Shared
from struck.live.commands import Host, default_listener, listening
from struck.live.device import TO_FILE, PortAudio, Stream, keep
from struck.live.ring import Ring
from struck.live.voices import Started
from struck.model.arrays import Array, Index
from struck.model.contact import Contact, Place
from struck.model.model import ModalModel

QUIETEST, LOUDEST = -120.0, 60.0  # bounds of the volume, dB
_STALLED = 2.0  # s without a new block: the device is gone
_FADED = 1.0  # s, in which a stream ends after it was asked to
_SWITCH_INTERVAL = 0.00005  # s


class Player:
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
        rate = outlet.sample_rate
        self._outlet, self._block, self._ahead = outlet, block, ahead
        self._host = Host(
            models,
            listener=default_listener(models) if listener is None else listening(listener),
            sample_rate=rate,
            block=block,
            volume=volume,
            voices=voices,
            ahead=ahead,
        )
        self._limited = limiter.limiter(sample_rate=rate, channels=outlet.channels)
        self._shared = callback.Shared(
            records=self._host.records,
            limited=self._limited,
            arena=self._host.arena,
            channels=outlet.channels,
            block=block,
        )
        self._feeder = Feeder(
            self._host.records, self._host.fill, seconds=block / rate, ahead=ahead
        )
        self._stopped = False
        outlet.open(callback.play(), self._shared, block)

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
        if not self._host.queue.have_room():
            return
        blow = Strike(**given) if strike is None else strike
        struck = self._host.body(body)
        if blow.transient:
            self.start(blow, body=body)
            return
        contact = struck.contact(blow.at, blow.direction)
        pulse = blow.pulse(blow.resolved(struck.model, contact), self.sample_rate)
        self._host.strike(body, struck.drive(contact, blow.patch), pulse)

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
        pushing = excitation.begin(self._host.body(body).model, rate, start=-LEAD)
        started = Started(pushing, rate)
        self._host.start(body, started, type(excitation))
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
        contact = self._host.body(body).contact(at, direction)
        touching, _ = self._host.touching(body, finger, tool)
        self._host.touch(body, finger, touching.word(contact, force, velocity))

    def touch_log_of(self, *, body: int = 0, finger: int = 0) -> TouchLog:
        """Return what a touch did so far (its last 60,000 updates), to be rendered offline.

        Its times count from when the player began.

        Raises
        ------
        OptionError
            Where there was no such touch.
        """
        return self._host.notes(body, finger).log()

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
        self._host.dampen(body, at, grip)

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
        self._host.change(body, model)

    @property
    def listener(self) -> Array | Listener:
        """Where all bodies are heard, m (3,), or with which ears.

        Ears go to a new place, and turn, within some 10 ms; what is on its way arrives there.
        """
        return self._host.listener

    @listener.setter
    def listener(self, listener: Listener | ArrayLike) -> None:
        self._require_playing()
        self._host.listen(listening(listener))

    @property
    def volume(self) -> float:
        """dB; at 0 the default strike of the loudest body peaks at -12 dB of full scale."""
        return self._host.volume

    @volume.setter
    def volume(self, decibels: float) -> None:
        self._require_playing()
        _require_volume(decibels)
        self._host.volume = decibels

    def begin(self) -> None:
        """Let it be heard; `struck.play` has done that. Where it fails, nothing of it stays."""
        try:
            self._feeder.start()
            atexit.register(self.stop)
            self._outlet.start()
        except BaseException:
            self.stop()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def stop(self) -> None:
        """Fade out and close the device; more than once does no harm."""
        if self._stopped:
            return
        self._stopped = True
        atexit.unregister(self.stop)
        try:
            self._outlet.close()
        finally:
            self._feeder.stop()

    @property
    def active(self) -> bool:
        """Whether it is heard: not once it was stopped or the device went."""
        if self._stopped or not self._feeder.running or not self._outlet.active:
            return False
        return self._host.queue.idle < _STALLED

    @property
    def sample_rate(self) -> float:
        """Hz."""
        return self._outlet.sample_rate

    @property
    def latency(self) -> float:
        """From a call to the air at most, s: waiting blocks, look-ahead of the limiter, device."""
        ahead = ((self._ahead + 1) * self._block + self._limited[limiter.DELAY]) / self.sample_rate
        return ahead + self._outlet.latency

    @property
    def load(self) -> float:
        """The share of its time that the audio callback takes, in percent."""
        return 100 * self._outlet.load

    @property
    def underflows(self) -> int:
        """How often the device ran out of samples."""
        return int(self._shared.counters[callback.UNDERFLOWS])

    @property
    def late(self) -> int:
        """Blocks for which no forces had come in time: loads were held."""
        return int(self._shared.counters[callback.LATE])

    @property
    def dropped(self) -> int:
        """Strikes, excitations and updates left out, as there was no voice or no room."""
        return self._host.dropped

    @property
    def notes(self) -> tuple[str, ...]:
        """What recorded bodies could not know of what was done to them, as a sound's notes say."""
        return self._host.unknowns

    @property
    def peak(self) -> float:
        """The loudest sample so far before the limiter; 1.0 is full scale."""
        return self._host.arena.peak

    def _require_playing(self) -> None:
        if not self.active:
            raise _gone(self._outlet.name, self._feeder.failure)
        self._host.error.raise_again()


def _require_volume(decibels: float) -> None:
    if not QUIETEST <= decibels <= LOUDEST:
        raise OptionError(f"volume is {decibels}: it must lie from {QUIETEST:g} to {LOUDEST:g} dB")


def play(
    model: ModalModel | Sequence[ModalModel],
    *,
    device: int | str | None = None,
    sample_rate: float | None = None,
    **options: Any,  # noqa: ANN401 - of `Player`
) -> Player:
    """Return a running player on an audio device; see `struck.play`."""
    models = [model] if isinstance(model, ModalModel) else list(model)
    outlet = DeviceOutlet(device, sample_rate)
    try:
        player = Player(models, outlet=outlet, **options)
        player.begin()
    except BaseException:
        outlet.close()
        raise
    return player


class _Haste:
    """The interpreter's switch interval: short while any feeder runs, then as it was before."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._feeders, self._usual = 0, 0.0

    def begin(self) -> None:
        with self._lock:
            if not self._feeders:
                self._usual = sys.getswitchinterval()
                sys.setswitchinterval(min(_SWITCH_INTERVAL, self._usual))
            self._feeders += 1

    def end(self) -> None:
        with self._lock:
            self._feeders -= 1
            if not self._feeders:
                sys.setswitchinterval(self._usual)


_HASTE = _Haste()  # one for the interpreter, as is the interval


class Feeder:
    """Thread that fills a ring with records, block after block, until it is stopped.

    The callback must not wake anybody: that could make it wait. So the thread looks again after
    half a block. What delays it is the interpreter's lock: another thread that computes in Python
    lets go of it only once a switch interval, by default 5 ms, as long as two blocks of 128
    samples. While it runs the interval is 0.05 ms, as excitations let go of the lock several times
    in a block, wherever compiled code or NumPy works, and wait for it each time.
    """

    def __init__(
        self,
        records: Ring,  # of at least `ahead` + 1: the one being heard keeps its slot
        fill: Callable[[Index, Array], None],  # writes the next record in place
        *,
        seconds: float,  # of a block
        ahead: int = 2,  # blocks kept ready, each one block more between a touch and its sound
    ) -> None:
        self.longest = 0.0  # time between two looks at the ring, s
        self._records = records
        self._fill = fill
        self._nap = seconds / 2
        self._ready = ahead + 1
        self.failure: Exception | None = None
        self._stopping = self._started = False
        self._thread = threading.Thread(target=self._run, name="struck feeder", daemon=True)

    def start(self) -> None:
        """Fill the ring for the first time, and go on in a thread."""
        self._top_up()
        self._thread.start()
        _HASTE.begin()
        self._started = True

    def stop(self) -> None:
        """Join the thread, if it ever began; raise what `fill` raised, if it did."""
        self._stopping = True
        if not self._started:
            return
        self._started = False
        self._thread.join()
        _HASTE.end()
        if self.failure is not None:
            raise self.failure

    @property
    def running(self) -> bool:
        """Whether it still fills: not once `fill` raised."""
        return self._thread.is_alive()

    def _run(self) -> None:
        _hurry()
        looked = time.perf_counter()
        try:
            while not self._stopping:
                self._top_up()
                time.sleep(self._nap)
                now = time.perf_counter()
                self.longest = max(self.longest, now - looked)
                looked = now
        except Exception as failure:  # noqa: BLE001 - `stop` raises it in the caller's thread
            self.failure = failure

    def _top_up(self) -> None:
        while self._records.waiting < self._ready:
            slot = self._records.reserve()
            if slot is None:
                return
            self._fill(*slot)
            self._records.publish()


def _hurry() -> None:
    """Give this thread real-time priority, where the system allows that."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError):
            os.sched_setscheduler(threading.get_native_id(), os.SCHED_RR, os.sched_param(1))


class Outlet(Protocol):
    """Where a player's sound leaves: an audio device, or a test's own loop."""

    name: str
    sample_rate: float  # Hz
    channels: int

    def open(self, callback: int, shared: Shared, block: int) -> None:
        """Get ready to call the callback at an address for each block."""
        ...

    def start(self) -> None:
        """Begin to call it."""
        ...

    @property
    def active(self) -> bool:
        """Whether it is being called."""
        ...

    @property
    def load(self) -> float:
        """The share of its time that the callback takes, 0 to 1."""
        ...

    @property
    def latency(self) -> float:
        """From the callback to the air, s."""
        ...

    def close(self) -> None:
        """Fade out, and let nothing be called any more."""
        ...


class DeviceOutlet:
    """An audio device from opening to closing."""

    def __init__(self, device: int | str | None = None, sample_rate: float | None = None) -> None:
        self._portaudio = PortAudio()
        try:
            chosen = self._portaudio.device(device)
        except DeviceError:
            self._portaudio.close()
            raise
        self.name = chosen.name
        self.sample_rate = chosen.sample_rate if sample_rate is None else float(sample_rate)
        self.channels = min(2, chosen.outputs)
        self._number = chosen.number
        self._stream: Stream | None = None
        self._used: Shared | None = None

    def open(self, callback: int, shared: Shared, block: int) -> None:
        """Open the stream; DeviceError where the device refuses."""
        self._used = shared
        self._stream = self._portaudio.open(
            callback,
            shared.address,
            sample_rate=self.sample_rate,
            block=block,
            channels=self.channels,
            device=self._number,
        )

    def start(self) -> None:
        """Let the callback be called."""
        if self._stream is None:
            raise DeviceError(f"{self.name} is not open: play anew")
        self._stream.start()

    @property
    def active(self) -> bool:
        """Whether the callback is being called."""
        return self._stream is not None and self._portaudio.answers and self._stream.active

    @property
    def load(self) -> float:
        """The share of its time that the callback takes, 0 to 1."""
        return 0.0 if self._stream is None else self._stream.load

    @property
    def latency(self) -> float:
        """From the callback to the air, s."""
        return 0.0 if self._stream is None else self._stream.latency

    def close(self) -> None:
        """Fade out and close; a device that no longer answers is left alone."""
        stream, self._stream = self._stream, None
        if stream is not None and self._used is not None:
            self._end(stream, self._used)
            if not stream.close():
                keep(self._used)
        self._portaudio.close()

    def _end(self, stream: Stream, shared: Shared) -> None:
        shared.counters[OPEN] = 0
        give_up = time.monotonic() + _FADED
        with contextlib.suppress(DeviceError):
            while stream.active and time.monotonic() < give_up:
                time.sleep(0.005)
            stream.stop()


def _gone(name: str, failure: Exception | None) -> DeviceError:
    """Return the error of a device that has gone, or of a feeder whose failure is its cause."""
    if failure is None:
        why = "it was stopped or unplugged, or its sound server ended; play anew, on another"
        return DeviceError(f"{name} no longer plays: {why} device with device=; {TO_FILE}")
    why = f"what fills its blocks failed with {failure!r}; play anew; {TO_FILE}"
    error = DeviceError(f"{name} no longer plays: {why}")
    error.__cause__ = failure
    return error

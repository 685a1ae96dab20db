"""Bodies that sound while they are touched: the live counterpart of `render`.

A `Player` queues the calls of its user (`struck.live.commands`). A thread, the `Feeder`, makes a
record of it for each block and keeps a ring of them filled ahead of the audio device, whose
callback (`struck.live.callback_memory`) reads them without Python.
"""

from __future__ import annotations

import atexit
import sys
import threading
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Self

from numpy.typing import ArrayLike

from struck.ears.listeners import Course3, Listener, Mono
from struck.ears.orientation import Turning
from struck.errors import ArgumentError, DeviceError, OptionError
from struck.excitation.excitation import Excitation
from struck.excitation.scraping_force import Tool
from struck.excitation.strike import Strike
from struck.excitation.touch import TouchLog
from struck.live import callback_memory, limiter
from struck.live.commands import Host, default_listener, listening
from struck.live.contact_stream import ContactStream, SimulationRun, hurry
from struck.live.device import TO_FILE, Outlet
from struck.live.ring import Ring
from struck.live.voices import Started
from struck.model.arrays import Array, Index, checked, require_number
from struck.model.contact import Contact, Place
from struck.model.model import ModalModel
from struck.scene.body import Body, Scene, with_fewer_modes

if TYPE_CHECKING:
    from struck.scene.contacts import Contacts
    from struck.scene.engines.mujoco import Control
    from struck.scene.engines.simulation import Simulation

_VOICES, _BLOCKS_AHEAD = 16, 2  # defaults; and those of scenes, which are planned ahead anyway
_SCENE_VOICES, _SCENE_BLOCKS_AHEAD = 128, 8
MIN_VOLUME, MAX_VOLUME = -120.0, 60.0  # bounds of the volume, dB
_STALL_SECONDS = 2.0  # s without a new block: the device is gone
_SWITCH_INTERVAL = 0.00005  # s


class Player:
    """Bodies that are struck, scraped, touched and held while they sound.

    Made by `struck.play`. All methods may be called from any thread at any rate. They return at
    once and take effect at most `latency` later, in the same order and at
    the same intervals as the calls. With a `moment` they take effect at that moment of the player's
    clock, to the sample.

    Parameters
    ----------
    models : sequence of ModalModel, or Scene
        The B bodies.
    outlet : Outlet
        Audio device, or a substitute of tests.
    listener : Mono, Stereo, Binaural or array-like (3,), optional
        Listener, or its position, m, as for `struck.play`.
    block : int, default 128
        Samples per call of the device.
    volume : float, default 0.0
        Volume, dB, as for `struck.play`.
    voices : int, optional
        Maximum number of simultaneous excitations. Default: 16, or 128 for a scene.
    ahead : int, optional
        Number of blocks that are computed ahead. Default: 2, or 8 for a scene.
    lost : sequence of str, default ()
        Notes on modes that were left out.
    """

    def __init__(
        self,
        models: Sequence[ModalModel] | Scene,
        *,
        outlet: Outlet,
        listener: Listener | ArrayLike | None = None,
        block: int = 128,
        volume: float = 0.0,
        voices: int | None = None,
        ahead: int | None = None,
        lost: Sequence[str] = (),  # of modes beyond a budget
    ) -> None:
        self._mode_notes = lost
        scene = models if isinstance(models, Scene) else None
        bodies = _sounding(models)
        _require_volume(volume)
        rate = outlet.sample_rate
        defaults = (_SCENE_VOICES, _SCENE_BLOCKS_AHEAD) if scene else (_VOICES, _BLOCKS_AHEAD)
        voices, ahead = (
            default if option is None else option
            for option, default in zip((voices, ahead), defaults, strict=True)
        )
        self._outlet, self._block, self._blocks_ahead = outlet, block, ahead
        fallback_listener = (
            Mono() if scene else default_listener([body.sounding for body in bodies.values()])
        )
        self._host = Host(
            bodies,
            listener=fallback_listener if listener is None else listening(listener),
            sample_rate=rate,
            block=block,
            volume=volume,
            voices=voices,
            ahead=ahead,
        )
        self._stream = scene and ContactStream(scene=scene, host=self._host, sample_rate=rate)
        self._run: SimulationRun | None = None
        self._limiter_state = limiter.limiter(sample_rate=rate, channels=outlet.channels)
        self._shared = callback_memory.Shared(
            records=self._host.records,
            limited=self._limiter_state,
            arena=self._host.arena,
            channels=outlet.channels,
            block=block,
        )
        self._feeder = Feeder(
            self._host.records, self._host.fill, seconds=block / rate, ahead=ahead
        )
        self._stopped = False
        outlet.open(callback_memory.play(), self._shared, block)

    @checked
    def strike(
        self,
        strike: Strike | None = None,
        *,
        body: int | str = 0,
        moment: float | None = None,
        **options: Any,  # noqa: ANN401 - of `Strike`
    ) -> None:
        """Strike a body.

        If no voice is free, the strike is left out and counted in `dropped`.

        Parameters
        ----------
        strike : Strike, optional
            The strike; its `time` counts from the moment.
        body : int or str, default 0
            Number of the body, or its name in the scene.
        moment : float, optional
            Time on the clock of the player (`now`), s. Default: at once.
        **options
            Arguments of a `Strike`, instead of one.

        Raises
        ------
        DeviceError
            If the device has stopped.
        ContactError
            If the contact is not on the body.
        OptionError
            If a value is out of range.
        """
        if strike is not None and options:
            raise OptionError(f"a Strike and {', '.join(options)}: give one or the other")
        self._require_playing()
        if not self._host.queue.have_room():
            return
        blow = Strike(**options) if strike is None else strike
        if blow.transient and moment is None:
            self.start(blow, body=body)
        else:
            self._host.strike(self._host.number(body), blow, moment)

    @checked
    def start(self, excitation: Excitation, *, body: int | str = 0) -> Started:
        """Start an excitation of a body.

        Parameters
        ----------
        excitation : excitation
            Strike, Scrape, Roll, Pluck or ForceTrack; its `time`, s, counts from now.
        body : int or str, default 0
            Number of the body, or its name in the scene.

        Returns
        -------
        Started
            The excitation, with `stop()`, which ends it within 5 ms, and `finished`, which is True
            at once if no voice is free; `dropped` counts such excitations.

        Raises
        ------
        ArgumentError
            If it is not an excitation.
        DeviceError
            If the device has stopped.
        ContactError
            If the contact is not on the body.
        OptionError
            If a value is out of range.
        """
        self._require_playing()
        if not callable(getattr(excitation, "begin", None)):
            hint = "start takes a Strike, Scrape, Roll, Pluck or ForceTrack; dampen() holds a place"
            raise ArgumentError(f"excitation is {excitation!r}: {hint}")
        return self._host.start(self._host.number(body), excitation)

    @checked
    def touch(
        self,
        at: Contact | Place,
        force: float,
        velocity: float | ArrayLike = 0.0,
        *,
        direction: Place = None,
        body: int | str = 0,
        finger: int = 0,
        tool: Tool | None = None,
        moment: float | None = None,
    ) -> None:
        """Report position, load and velocity of a hand, a tool or a haptic device.

        Call it 60 to 1000 times per second during a touch, and once with force 0 at its end.

        Parameters
        ----------
        at : Contact, array-like or str
            Contact, as for a `Strike`.
        force : float
            Load, N; 0 ends the touch.
        velocity : float or array-like, default 0.0
            Velocity along the surface, m/s, of which the magnitude counts.
        direction : array-like (3,), optional
            Direction of the load. Default: straight into the surface.
        body : int or str, default 0
            Number of the body, or its name in the scene.
        finger : int, default 0
            Number of the touch, of several on one body.
        tool : Tool, optional
            What touches, given with the first touch of a finger.
        moment : float, optional
            As for `strike`.

        Raises
        ------
        DeviceError
            If the device has stopped.
        ContactError
            If the contact is not on the body.
        OptionError
            If a value is out of range.
        """
        self._require_playing()
        number, contact = self._host.number(body), self._host.body(body).contact(at, direction)
        touching, _ = self._host.touching(number, finger, tool)
        self._host.touch(number, finger, touching.make_update(contact, force, velocity), moment)

    @checked
    def touch_log_of(self, *, body: int | str = 0, finger: int = 0) -> TouchLog:
        """Return the log of a touch (its last 60,000 updates), for offline rendering.

        Its times count from the start of the player.

        Parameters
        ----------
        body : int or str, default 0
            Number of the body, or its name in the scene.
        finger : int, default 0
            Number of the touch, of several on one body.

        Returns
        -------
        TouchLog
            The log.

        Raises
        ------
        OptionError
            If there was no such touch.
        """
        return self._host.notes(self._host.number(body), finger).log()

    @property
    def touch_log(self) -> TouchLog:
        """Log of the first touch of the first body so far; see `touch_log_of`."""
        return self.touch_log_of()

    @checked
    def dampen(self, at: Place, grip: float, *, body: int | str = 0) -> None:
        """Hold a body with a hand.

        Parameters
        ----------
        at : array-like or str
            Contact, as for a `Strike`.
        grip : float
            Resistance, N s/m, as of a `Hold`; 0 releases the contact. Modes with larger motion
            there decay faster; frequencies do not change.
        body : int or str, default 0
            Number of the body, or its name in the scene.

        Raises
        ------
        DeviceError
            If the device has stopped.
        ContactError
            If the contact is not on the body.
        OptionError
            If a value is out of range.
        """
        self._require_playing()
        self._host.dampen(self._host.number(body), at, grip)

    @checked
    def change(self, model: ModalModel, *, body: int | str = 0) -> None:
        """Replace the model of a body, for instance by one of another material, while it rings.

        Parameters
        ----------
        model : ModalModel
            The new model, with the same number of modes.
        body : int or str, default 0
            Number of the body, or its name in the scene.

        Raises
        ------
        DeviceError
            If the device has stopped.
        OptionError
            If the model has another number of modes, or cannot be played.
        """
        self._require_playing()
        self._host.change(self._host.number(body), model)

    @checked
    def move(
        self,
        body: int | str,
        position: Course3 | None = None,
        rotation: Turning | None = None,
        *,
        moment: float | None = None,
    ) -> None:
        """Move a body, with its Doppler shift.

        Parameters
        ----------
        body : int or str
            Number of the body, or its name in the scene.
        position : array-like (3,), optional
            New position of the origin of its coordinates, m. Default: unchanged.
        rotation : array-like (3, 3) or (4,), optional
            New rotation, as for a `Body`. Default: unchanged.
        moment : float, optional
            Time of arrival on the clock of the player, s: the body moves evenly from its last pose.
            Default: within about 10 ms.

        Raises
        ------
        DeviceError
            If the device has stopped.
        OptionError
            If a value is out of range, or the listener is a bare position, for which nothing moves.
        """
        self._require_playing()
        self._host.move(self._host.number(body), position, rotation, moment)

    @checked
    def follow(self, contacts: Contacts, *, ended: bool = False) -> None:
        """Play the next piece of a contact log: motion and contacts of the bodies of the scene.

        It takes effect about 100 ms later, by which time the next piece must have come. Pass 20 to
        100 ms at a time, with the same names and ascending times.

        Parameters
        ----------
        contacts : Contacts
            The piece.
        ended : bool, default False
            Whether it is the last one, which is then played to its end.

        Raises
        ------
        DeviceError
            If the device has stopped.
        OptionError
            If the scene lacks a name of the log, or the player has no scene.
        """
        self._require_playing()
        if self._stream is None:
            raise OptionError("the player has no scene: begin it with struck.play(Scene(...))")
        self._stream.take(contacts, ended=ended)

    @checked
    def simulate(self, simulation: Simulation, control: Control | None = None) -> None:
        """Run a simulation together with the player, before it begins; as `struck.play` does.

        Parameters
        ----------
        simulation : Simulation
            The simulation.
        control : callable, optional
            As for `struck.play`.

        Raises
        ------
        OptionError
            If the player has a simulation already, or no scene.
        """
        if self._stream is None:
            raise OptionError("the player has no scene: begin it with struck.play(Scene(...))")
        if self._run is not None:
            raise OptionError(
                "this player has a simulation already: call struck.play again for another"
            )
        self._run = SimulationRun(simulation, self._stream, control)

    @property
    def listener(self) -> Array | Listener:
        """Position at which all bodies are heard, m (3,), or the ears.

        Ears move to a new place, and turn, within some 10 ms; sound that travels already arrives
        there.
        """
        return self._host.listener

    @listener.setter
    def listener(self, listener: Listener | ArrayLike) -> None:
        self.listen(listener)

    @checked
    def listen(self, listener: Listener | ArrayLike, *, moment: float | None = None) -> None:
        """Set the listener.

        Parameters
        ----------
        listener : Mono, Stereo, Binaural or array-like (3,)
            Listener, or its position, m.
        moment : float, optional
            Time on the clock of the player (`now`), s. Default: at once.
        """
        self._require_playing()
        self._host.listen(listening(listener), moment)

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
        """Start the sound, as `struck.play` has done already; on failure, undo all of the start."""
        try:
            self._feeder.start()
            atexit.register(self.stop)
            self._outlet.start()
            if self._run is not None:
                self._run.start()
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
            if self._run is not None:
                self._run.stop()
            self._outlet.close()
        finally:
            self._feeder.stop()

    @property
    def active(self) -> bool:
        """Whether the player sounds: False once it was stopped or the device has gone."""
        if self._stopped or not self._feeder.running or not self._outlet.active:
            return False
        return self._host.queue.idle < _STALL_SECONDS

    @property
    def sample_rate(self) -> float:
        """Sample rate of the device, Hz."""
        return self._outlet.sample_rate

    @property
    def now(self) -> float:
        """The player's clock, s: the earliest moment that is not yet made."""
        return self._host.now / self.sample_rate

    @property
    def simulating(self) -> bool:
        """Whether a simulation runs with the player; False once it has exploded."""
        return self._run is not None and self._run.running

    @property
    def simulation_load(self) -> float:
        """Percentage of time that the simulation computes, its contacts included."""
        return 0.0 if self._run is None else 100 * self._run.load

    @property
    def slipped(self) -> float:
        """How long the sound had to wait for contacts in all, s: the simulation is too slow."""
        return 0.0 if self._stream is None else self._stream.slipped

    @property
    def overdue(self) -> int:
        """Number of commands whose moment was over, and that were carried out at once."""
        return self._host.queue.overdue + (self._stream.missed if self._stream else 0)

    @property
    def latency(self) -> float:
        """From a call to the air at most, s: waiting blocks, look-ahead of the limiter, device."""
        wait_seconds = (
            (self._blocks_ahead + 1) * self._block + self._limiter_state[limiter.DELAY]
        ) / self.sample_rate
        return wait_seconds + self._outlet.latency

    @property
    def load(self) -> float:
        """Percentage of the time of a block that the audio callback takes."""
        return 100 * self._outlet.load

    @property
    def underflows(self) -> int:
        """Number of times that the device ran out of samples."""
        return int(self._shared.counters[callback_memory.UNDERFLOWS])

    @property
    def late(self) -> int:
        """Number of blocks whose forces were late; loads were held."""
        return int(self._shared.counters[callback_memory.LATE])

    @property
    def dropped(self) -> int:
        """Strikes, excitations and updates left out, as there was no voice or no room."""
        return self._host.dropped

    @property
    def notes(self) -> tuple[str, ...]:
        """Warnings about modes left out, silent bodies and recorded ones, as in a sound's notes."""
        scene = () if self._stream is None else self._stream.scene.notes
        return (*self._mode_notes, *scene, *self._host.unknowns)

    @property
    def peak(self) -> float:
        """The loudest sample so far before the limiter; 1.0 is full scale."""
        return self._host.arena.peak

    def _require_playing(self) -> None:
        if not self.active:
            raise _make_device_error(self._outlet.name, self._feeder.failure)
        self._host.error.raise_again()


def _require_volume(decibels: float) -> None:
    hint = f"it must lie from {MIN_VOLUME:g} to {MAX_VOLUME:g} dB"
    require_number("volume", decibels, MIN_VOLUME, MAX_VOLUME, hint=hint)


def _sounding(models: Sequence[ModalModel] | Scene) -> dict[str, Body]:
    """Return the bodies that sound, by their names."""
    if not isinstance(models, Scene):
        if not models:
            raise OptionError("there is nothing to play: give at least one model")
        return {str(number): Body(model=model) for number, model in enumerate(models)}
    bodies = {name: body for name, body in models.bodies.items() if not body.silent}
    if not bodies:
        reason = "; ".join(models.notes) or "all of its bodies are silent"
        raise OptionError(f"there is nothing to play: {reason}")
    excited_names = [name for name, body in bodies.items() if body.actions]
    if excited_names:
        raise OptionError(
            f"{excited_names[0]!r} brings excitations: give them to player.start instead"
        )
    return bodies


@checked
def play(
    model: ModalModel | Sequence[ModalModel] | Scene | Simulation,
    *,
    listener: Listener | ArrayLike | None = None,
    device: int | str | None = None,
    sample_rate: float | None = None,
    block: int = 128,
    volume: float = 0.0,
    voices: int | None = None,
    ahead: int | None = None,
    modes: int | None = None,
    control: Control | None = None,
) -> Player:
    """Play models, a scene or a simulation on an audio device.

    Parameters
    ----------
    model : ModalModel, sequence of ModalModel, Scene or Simulation
        The bodies, all in one coordinate system; or those of a scene, which `Player.move` and
        `Player.follow` move; or a simulation, which runs while it sounds.
    listener : Mono, Stereo, Binaural or array-like (3,), optional
        Listener as for `render`, at a constant position and orientation, until `Player.listener`
        is set.
    device : int or str, optional
        Number of the output device, or a part of its name (``struck play --list-devices``).
        Default: the default device of the system.
    sample_rate : float, optional
        Hz. Default: that of the device.
    block : int, default 128
        Samples per call of the device. Fewer give a lower latency and a higher processor load.
    volume : float, default 0.0
        dB. At 0 dB the default strike of the loudest body at its default contact peaks at -12 dB of
        full scale. A limiter keeps the output below -1 dB.
    voices : int, optional
        Maximum number of simultaneous excitations. Default: 16, or 128 for a scene. Strikes at one
        contact share a voice.
    ahead : int, optional
        Number of blocks of forces that are computed ahead. More tolerate a busier machine and
        increase the latency. Default: 2, or 8 for a scene.
    modes : int, optional
        Maximum number of modes of each body, as for `render`. `Player.notes` report the audible
        difference.
    control : callable, optional
        As for `simulate`. Its effect is audible after about 200 ms.

    Returns
    -------
    Player
        A running player. Use it in a ``with`` statement, or call its `stop`.

    Raises
    ------
    MissingDependencyError
        If PortAudio is not installed.
    DeviceError
        If there is no such device, or it refuses the sample rate or the block size.
    OptionError
        If an option is out of range.
    ContactError
        If the listener is inside a body.

    Examples
    --------
    .. code-block:: python

        bar = struck.solids.Block(size=(0.1, 0.02, 0.01))
        model = struck.analyze(bar, "steel", accuracy="preview")
        with struck.play(model) as player:
            player.strike(at="top", striker="wood")
            time.sleep(2)
    """
    simulation: Any = model if hasattr(model, "started") else None
    models, mode_notes = with_fewer_modes(simulation.scene if simulation else model, modes)
    outlet = Outlet(device, sample_rate)
    try:
        player = Player(
            [models] if isinstance(models, ModalModel) else models,
            outlet=outlet,
            lost=mode_notes,
            listener=listener,
            block=block,
            volume=volume,
            voices=voices,
            ahead=ahead,
        )
        if simulation is not None:
            player.simulate(simulation, control)
        player.begin()
    except BaseException:
        outlet.close()
        raise
    return player


class _Haste:
    """The interpreter's switch interval: short while any feeder runs, then as it was before."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._feeders, self._default_interval = 0, 0.0

    def begin(self) -> None:
        with self._lock:
            if not self._feeders:
                self._default_interval = sys.getswitchinterval()
                sys.setswitchinterval(min(_SWITCH_INTERVAL, self._default_interval))
            self._feeders += 1

    def end(self) -> None:
        with self._lock:
            self._feeders -= 1
            if not self._feeders:
                sys.setswitchinterval(self._default_interval)


_HASTE = _Haste()  # one for the interpreter, as is the interval


class Feeder:
    """Thread that fills a ring with records, block after block, until it is stopped.

    The callback must not wake a thread: that could make it wait. So the feeder checks the ring
    every half block. What delays it is the interpreter's lock: another thread that computes in
    Python lets go of it only once a switch interval, by default 5 ms, as long as two blocks of 128
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
        self.longest = 0.0  # time between two checks of the ring, s
        self._records = records
        self._fill = fill
        self._nap = seconds / 2
        self._ready = ahead + 1
        self.failure: Exception | None = None
        self._stopping = self._started = False
        self._thread = threading.Thread(target=self._run, name="struck feeder", daemon=True)

    def start(self) -> None:
        """Fill the ring for the first time, and continue in a thread."""
        self._top_up()
        self._thread.start()
        _HASTE.begin()
        self._started = True

    def stop(self) -> None:
        """Join the feeder's thread, if it ever began; raise the exception of `fill`, if any."""
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
        """Whether the feeder still fills blocks: not once `fill` raised."""
        return self._thread.is_alive()

    def _run(self) -> None:
        hurry(2)  # before a simulation
        last_time = time.perf_counter()
        try:
            while not self._stopping:
                self._top_up()
                time.sleep(self._nap)
                loop_time = time.perf_counter()
                self.longest = max(self.longest, loop_time - last_time)
                last_time = loop_time
        except Exception as failure:  # noqa: BLE001 - `stop` raises it in the caller's thread
            self.failure = failure

    def _top_up(self) -> None:
        while self._records.waiting < self._ready:
            slot = self._records.reserve()
            if slot is None:
                return
            self._fill(*slot)
            self._records.publish()


def _make_device_error(name: str, failure: Exception | None) -> DeviceError:
    """Return the error of a device that has gone, or of a feeder whose failure is its cause."""
    if failure is None:
        reason = "it was stopped or unplugged, or its sound server ended; play anew, on another"
        return DeviceError(f"{name} no longer plays: {reason} device with device=; {TO_FILE}")
    reason = f"what fills its blocks failed with {failure!r}; play anew; {TO_FILE}"
    error = DeviceError(f"{name} no longer plays: {reason}")
    error.__cause__ = failure
    return error

"""From commands to records: commands of users' threads become the record of each block.

`Host` is what is played: bodies, voices, touches. A command waits in the `CommandQueue` until the
feeder fills the next block; then it changes the host, which writes the block's record.
"""

from __future__ import annotations

import heapq
import threading
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import count
from operator import itemgetter
from typing import Any, TypeVar

import numpy as np

from struck.ears.listeners import Course3, Listener, Trajectory, is_listener, position_of
from struck.ears.orientation import Orientation, Turning
from struck.ears.propagation import aside
from struck.errors import OptionError
from struck.excitation.excitation import Excitation, Hold, Pushing, drive
from struck.excitation.pulses import LEAD, Samples
from struck.excitation.scraping_force import Tool
from struck.excitation.strike import Strike, after_attack, residual_of
from struck.excitation.touch import Touching, TouchLog, Update
from struck.live.callback_memory import arena
from struck.live.ears import MAX_DISTANCE, LiveEars
from struck.live.ring import FIRST_OUTPUTS, NEW_OUTPUTS, NEW_POLES, Layout, Record, Ring
from struck.live.voices import Blows, LastError, Started, Voices
from struck.model.arrays import Array, Complex, Index, require_number
from struck.model.contact import Contact, Place
from struck.model.model import ModalModel
from struck.scene.body import Body, away_from, centre_of, place_beside, radius_of, unknowns
from struck.scene.render import render
from struck.scene.sustained_contact import Rub
from struck.synth.memory import BodyColumn
from struck.synth.poles import Poles, require_session, with_recoil
from struck.synth.resonators import Stepped

Value = TypeVar("Value")
STRIKE_PEAK = 10 ** (-12 / 20)  # of full scale: peak of a default strike
MAX_UPDATES = 60_000  # updates of each touch in its log: ten minutes at 100 Hz
MAX_COMMANDS = 1024  # that may wait for the next block; more are refused and counted
MAX_PLANNED_COMMANDS = 65_536  # that may wait for a later moment
LAST_MOMENT = 1e6  # s
MAX_BLOCKS_AHEAD = 64  # blocks that may be kept ready
_CACHE_SIZE = 256  # contacts, and drives, that are not looked up again
_LOUDNESS_SECONDS = 0.25  # s of the strike that sets the loudness


class Host:
    """Host of the audio callback: bodies, voices, touches, and the records of blocks."""

    def __init__(
        self,
        bodies: Mapping[str, Body],
        *,
        listener: Array | Listener,
        sample_rate: float,
        block: int,
        volume: float,
        voices: int,
        ahead: int = 2,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        require_session(sample_rate, block, 1)
        if voices < 1 or not 1 <= ahead <= MAX_BLOCKS_AHEAD:
            raise OptionError(
                f"voices is {voices} and ahead {ahead}: give at least 1, and at most "
                f"{MAX_BLOCKS_AHEAD} blocks ahead"
            )
        self.listener, self.volume = listener, volume
        self._rate, self._block = sample_rate, block
        body_list = list(bodies.values())
        self._numbers = {name: number for number, name in enumerate(bodies)}
        self._bodies = [PlayedBody(body.sounding, sample_rate) for body in body_list]
        self._ears: LiveEars | None = None
        if not isinstance(listener, np.ndarray):
            self._ears = LiveEars(body_list, listener, sample_rate=sample_rate, block=block)
        listener_points = self._ears.heads() if self._ears else [self._place] * len(body_list)
        self._scale = full_scale(self._bodies, listener_points, sample_rate)
        self._prepare(voices, ahead)
        self.error = LastError()
        self._voices = Voices(voices, self.error)
        self._touches: dict[tuple[int, int], tuple[Touching, Notes]] = {}
        # Residual sounds of each body at each point.
        self._residuals: dict[tuple[int, int], Blows] = {}
        # States of each body's modes under 1 N and their outputs as of now, and both multiplied.
        self._ringing: dict[int, tuple[Complex, Complex]] = {}
        self._steady_outputs: dict[int, Complex] = {}
        self.queue = CommandQueue(clock, block=block, sample_rate=sample_rate, error=self.error)
        self._changing = threading.Lock()  # bodies, hands and listener, and the order of changes
        self._poles: dict[int, Complex] = {}
        self._outputs = {n: self._compute_outputs(body) for n, body in enumerate(self._bodies)}
        self._first = True
        self._dropped_count = self.now = self.drawn_in = 0
        self._action_kinds: dict[
            tuple[int, type], None
        ] = {}  # kinds of action on each body, in order

    def _prepare(self, voices: int, ahead: int) -> None:
        """Lay out all memory; later only excitations allocate."""
        ears = self._ears
        points = ears.points if ears else 1
        self.bank = Stepped(  # once it plays only the callback may touch it
            [body.free for body in self._bodies],
            points=points,
            block=self._block,
            voices=voices,
            sample_rate=self._rate,
        )
        memory = self.bank.memory
        self._layout = Layout.of(memory, points, *((ears.paths, ears.taps) if ears else ()))
        self._firsts = memory.bodies[:, BodyColumn.FIRST].tolist()
        self.arena = arena(self.bank, volume=self.gain, ears=ears)
        # The blocks ahead, the one that is played, and the one that is written.
        self.records = Ring(
            capacity=ahead + 2, integers=self._layout.integers, reals=self._layout.reals
        )

    @property
    def gain(self) -> float:
        """Gain from Pa to full scale of the device, volume included."""
        return self._scale * 10 ** (self.volume / 20)

    @property
    def dropped(self) -> int:
        """Number of commands and excitations left out because the queue or all voices were full."""
        return self.queue.refused + self._dropped_count

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Warnings about excitations that recorded bodies cannot follow, each once."""
        action_kinds, has_several = list(self._action_kinds), len(self._bodies) > 1
        body_notes = ((n, unknowns(self._bodies[n].model, [kind])) for n, kind in action_kinds)
        messages = [
            f"body {n}: {note}" if has_several else note
            for n, notes in body_notes
            for note in notes
        ]
        if self.drawn_in:
            messages.append(
                f"{self.drawn_in} poses are more than {MAX_DISTANCE:g} m from the listener: heard "
                "as from there"
            )
        return tuple(dict.fromkeys(messages))

    def number(self, body: int | str) -> int:
        """Return the number of a body; OptionError on an unknown name or number."""
        if isinstance(body, str):
            if body not in self._numbers:
                names = ", ".join(map(repr, self._numbers))
                raise OptionError(f"body is {body!r}: those that sound are {names}")
            return self._numbers[body]
        if not 0 <= body < len(self._bodies):
            raise OptionError(f"body is {body}: there are 0 to {len(self._bodies) - 1}")
        return body

    def body(self, body: int | str) -> PlayedBody:
        """Return a body; OptionError on an unknown name or number."""
        return self._bodies[self.number(body)]

    def strike(self, body: int, strike: Strike, moment: float | None) -> None:
        """Strike a body; the time of the strike counts from now, or from a moment, s."""
        blow = PlannedBlow.of(self.body(body), strike, self._rate)
        self._say(lambda sample: self._strike(body, blow, sample), moment)

    def _say(self, command: Command, moment: float | None) -> None:
        """Queue a command for now, or for a moment on the player's clock, s."""
        if moment is None:
            self.queue.add(command)
            return
        self.queue.plan(self._sample(moment), command)

    def _sample(self, moment: float) -> int:
        """Return the sample of a moment on the player's clock, s."""
        hint = "give seconds on the player's clock, player.now and later"
        require_number("moment", moment, 0.0, LAST_MOMENT, hint=hint)
        return round(moment * self._rate)

    def start(self, body: int, excitation: Excitation) -> Started:
        """Start an excitation with the next block; it ends at once where no voice is free."""
        model, residual, ideal = self.body(body).model, None, False
        if isinstance(excitation, Strike):
            blow = PlannedBlow.of(self.body(body), excitation, self._rate)
            residual, ideal = blow.residual, blow.ideal
            excitation = after_attack(excitation, model)
        pushing = excitation.begin(model, self._rate, start=-LEAD)
        started = Started(pushing, self._rate, ideal=ideal)
        self._action_kinds[body, type(excitation)] = None

        def begin(_: int) -> None:
            if self._add(started, body, started):
                self._add_residual(body, residual, self.now)
            else:
                started.end()

        if not self.queue.add(begin):
            started.end()
        return started

    def touching(self, body: int, finger: int, tool: Tool | None) -> tuple[Touching, Notes]:
        """Return a touch and the notes of its updates; the first call begins it."""
        key = (body, finger)
        if key not in self._touches:
            chosen = tool or Tool()
            self._action_kinds[body, TouchLog] = None
            touching = Touching(self.body(body).model, self._rate, tool=chosen)
            self._touches.setdefault(key, (touching, Notes(chosen)))
        return self._touches[key]

    def touch(self, body: int, finger: int, update: Update, moment: float | None) -> None:
        """Let a touch follow an update from now on, or from a moment, s."""
        self._say(lambda sample: self._touch(body, finger, update, sample), moment)

    def move(
        self, body: int, position: Course3 | None, rotation: Turning | None, moment: float | None
    ) -> None:
        """Move a body to a pose now, or by a moment, s; OptionError without ears."""
        ears = self._ears
        if ears is None:
            raise OptionError(
                "the player has a bare position for a listener, by which nothing moves: begin it "
                "with listener=Mono(position=...), Stereo(...) or Binaural(...)"
            )
        start = np.zeros(1)
        point = None if position is None else Trajectory.of("position", position).at(start)[0]
        orientation = None if rotation is None else Orientation.of("rotation", rotation)
        quaternion = None if orientation is None else orientation.quaternions[0]
        self.queue.add(self._going(partial(ears.go, body), point, quaternion, moment))

    def _going(
        self,
        go: Callable[..., None],
        point: Array | None,
        quaternion: Array | None,
        moment: float | None,
    ) -> Command:
        """Return the command to move to a pose, in time with the strikes of its sample.

        A moment is passed on at once, as paths to the ears are computed ahead of the sound.
        """
        at, is_exact = None if moment is None else self._sample(moment), moment is not None

        def begin(now: int) -> None:
            self.queue.overdue += at is not None and at < now
            go((max(now, at or 0) + LEAD) / self._rate, point, quaternion, exact=is_exact)

        return begin

    def blow(self, body: str, strike: Strike) -> Callable[[int], None]:
        """Return a function that plans a strike, given the sample from which its time counts."""
        number = self._numbers[body]
        blow = PlannedBlow.of(self.body(body), strike, self._rate)

        def plan(zero: int) -> None:
            first = zero + LEAD + blow.first
            self.queue.plan(first, lambda _: self._strike(number, blow, zero))

        return plan

    def rub(self, body: str, rub: Rub) -> Callable[[int], None]:
        """Return a function that plans one side of a sustained contact, as `blow` does."""
        number, playing = self._numbers[body], rub.begin(self.body(body).model, self._rate)

        def begin(_: int) -> None:
            playing.resume(self.now)
            self._add(playing, number, playing)

        def plan(zero: int) -> None:
            self.queue.plan(playing.put_off(zero + LEAD), begin)

        return plan

    def follow(self, poses: Mapping[str, tuple[Array, Array, Array]], zero: int) -> None:
        """Let bodies take poses at times, s, that count from sample `zero`."""
        offset_seconds = (zero + LEAD) / self._rate

        def go(_: int) -> None:
            for body, (times, places, rotations) in poses.items():
                if self._ears and body in self._numbers and len(times):
                    number = self._numbers[body]
                    self.drawn_in += self._ears.follow(
                        number, times + offset_seconds, places, rotations
                    )

        self.queue.add(go)

    def notes(self, body: int, finger: int) -> Notes:
        """Return the notes of a touch; OptionError where there was none."""
        if (body, finger) not in self._touches:
            raise OptionError(f"finger {finger} has not touched body {body} yet: there is no log")
        return self._touches[body, finger][1]

    def dampen(self, body: int, at: Place, grip: float) -> None:
        """Hold a body with a viscous grip, N s/m; 0 releases it."""
        with self._changing:
            played_body = self.body(body)
            played_body.hold(at, grip)
            self._action_kinds[body, Hold] = None
            logarithms = played_body.logarithms
            self.queue.put(("hold", body), lambda _: self._poles.update({body: logarithms}))

    def change(self, body: int, model: ModalModel) -> None:
        """Replace the model of a body."""
        with self._changing:
            changed_body = self.body(body).changed(model)
            poles, outputs = changed_body.logarithms, self._compute_outputs(changed_body)
            self._bodies[body] = changed_body
            self.queue.put(
                ("change", body), lambda _: self._change(body, changed_body.model, poles, outputs)
            )

    def listen(self, listener: Array | Listener, moment: float | None = None) -> None:
        """Move the listener; OptionError on ears of another kind."""
        with self._changing:
            ears = self._ears
            if ears is not None and not isinstance(listener, np.ndarray):
                go = self._going(partial(ears.go, None), *ears.goal(listener), moment)
            elif ears is None and isinstance(listener, np.ndarray):
                outputs = {n: body.outputs(listener[None]) for n, body in enumerate(self._bodies)}
                go = partial(self._set_outputs, outputs)
            else:
                raise OptionError(
                    f"listener is {listener!r}: a player begun with ears keeps to ears, one begun "
                    "with a bare position to positions; start another"
                )
            if moment is None:
                self.queue.put("listener", go)
            else:
                _ = self.queue.add(go) if ears else self._say(go, moment)
            self.listener = listener

    def _set_outputs(self, outputs: Mapping[int, Complex], _: int) -> None:
        self._outputs.update(outputs)

    @property
    def _place(self) -> Array:
        """Position at which loudness counts, m (3,)."""
        if self._ears is not None:
            return self._ears.position
        return np.asarray(self.listener, np.float64)

    def _compute_outputs(self, body: PlayedBody) -> Complex:
        return body.outputs_aside() if self._ears else body.outputs(self._place[None])

    def fill(self, integers: Index, reals: Array) -> None:
        """Write the record of the next block; the feeder calls it."""
        self.queue.run(self.now)
        record = self._layout.record(integers, reals)
        record.volume[0] = self.gain
        self._write_bodies(record)
        record.beside[:] = 0.0
        self._voices.write(record, self._steady_outputs)
        for place, sounds in self._residuals.items():
            push = sounds.advance(self._block)
            if push is not None:
                record.beside[place] += push.force
        if self._ears is not None:
            self._ears.write(record)
        self.now += self._block

    def _write_bodies(self, record: Record) -> None:
        record.bodies[:] = 0
        for body, logarithms in self._poles.items():
            self._put(record.poles, body, logarithms)
            record.bodies[body] |= NEW_POLES
        if self._ears is not None:
            for body in self._ears.fields:
                self._outputs[body] = self._ears.outputs(body, self._bodies[body].outputs)
        for body, outputs in self._outputs.items():
            for point, gains in enumerate(outputs):
                self._put(record.outputs[:, point], body, gains)
            record.bodies[body] |= NEW_OUTPUTS | (FIRST_OUTPUTS if self._first else 0)
        for body in self._poles.keys() | self._outputs.keys():
            poles = self._bodies[body].free
            states, outputs = self._ringing.get(body, (None, np.zeros((0, 0), np.complex128)))
            if states is None or body in self._poles:
                logs = self._poles.get(body, poles.values / self._rate)
                states = poles.steady(logs, self._rate)
            outputs = self._outputs.get(body, outputs)
            self._ringing[body], self._steady_outputs[body] = (states, outputs), outputs * states
        self._poles, self._outputs, self._first = {}, {}, False

    def _put(self, places: Array, body: int, values: Complex) -> None:
        modes = slice(self._firsts[body], self._firsts[body] + len(values))
        places[0, modes], places[1, modes] = values.real, values.imag

    def _strike(self, body: int, blow: PlannedBlow, sample: int) -> None:
        key = ("strike", body, id(blow.drive), blow.ideal)
        blows = self._voices.find(key)
        if not isinstance(blows, Blows):
            blows = Blows(blow.drive, start=self.now, ideal=blow.ideal)
            if not self._add(blows, body, key):
                return
        pulse = blow.pulse
        if not blows.add(Samples(first=sample + LEAD + pulse.first, force=pulse.force)):
            self._dropped_count += 1
            return
        self._add_residual(body, blow.residual, sample)

    def _add_residual(self, body: int, residual: Samples | None, sample: int) -> None:
        """Play the attack and noise of a strike, as strong as at the listener's present place."""
        if residual is None:
            return
        if self._ears is None:
            centre = centre_of(self._bodies[body].model)
            distances = np.linalg.norm((self._place - centre)[None], axis=1)
        else:
            distances = self._ears.distances(body)
        for point, distance in enumerate(distances):
            place = body, point
            sounds = self._residuals.setdefault(place, Blows(np.zeros(0), start=self.now))
            samples = Samples(first=sample + LEAD + residual.first, force=residual.force / distance)
            self._dropped_count += not sounds.add(samples)

    def _touch(self, body: int, finger: int, update: Update, sample: int) -> None:
        touching, notes = self._touches[body, finger]
        key = ("touch", body, finger)
        if self._voices.find(key) is None:
            touching.resume(self.now)
            if not self._add(touching, body, key):
                return
        touching.follow(update._replace(sample=sample))
        notes.add(sample / self._rate, update)

    def _change(self, body: int, model: ModalModel, poles: Complex, outputs: Complex) -> None:
        self._poles[body], self._outputs[body] = poles, outputs
        self._voices.change(body, model)
        for (touched_body, finger), (touching, _) in list(self._touches.items()):
            if touched_body == body and self._voices.find(("touch", body, finger)) is None:
                touching.change(model)  # at rest

    def _add(self, pushing: Pushing, body: int, key: object) -> bool:
        is_added = self._voices.add(pushing, body, key)
        self._dropped_count += not is_added
        return is_added


Command = Callable[[int], object]  # called with the number of the sample at which it takes effect


class CommandQueue:
    """Queue of commands from the user's threads to the feeder's thread, emptied block by block.

    Commands keep their distances in time: one that was queued just after the last block was filled
    takes effect at the first sample of the block, one that was queued just now at its last.
    """

    def __init__(
        self, clock: Callable[[], float], *, block: int, sample_rate: float, error: LastError
    ) -> None:
        self._clock, self._block, self._length = clock, block, block / sample_rate
        self._error = error
        self._waiting: dict[Hashable, tuple[float, Command]] = {}
        self._planned: list[tuple[int, int, Command]] = []
        self._order = count()
        self._lock = threading.RLock()
        self.refused, self.overdue, self._last_run = 0, 0, clock()

    @property
    def idle(self) -> float:
        """Time since the queue was last emptied, s."""
        return self._clock() - self._last_run

    def have_room(self) -> bool:
        """Return whether one more command fits; where not, it counts as refused."""
        with self._lock:
            room = len(self._waiting) < MAX_COMMANDS
            self.refused += not room
            return room

    def add(self, command: Command) -> bool:
        """Queue a command; return False if the queue is full."""
        with self._lock:
            room = self.have_room()
            if room:
                self._waiting[object()] = self._clock(), command
            return room

    def put(self, key: Hashable, command: Command) -> None:
        """Queue a command in place of an older one of its key, even if the queue is full."""
        with self._lock:
            self._waiting.pop(key, None)  # the new one comes last
            self._waiting[key] = self._clock(), command

    def plan(self, sample: int, command: Command) -> None:
        """Queue a command for a sample; where that is over, it comes at once and is counted."""
        with self._lock:
            if len(self._planned) >= MAX_PLANNED_COMMANDS:
                self.refused += 1
            else:
                heapq.heappush(self._planned, (sample, next(self._order), command))

    def run(self, sample: int) -> None:
        """Run the commands since the last call, in the block that begins at this sample."""
        run_time, last, due_commands = self._clock(), 0, []
        with self._lock:
            waiting, self._waiting = self._waiting, {}
            while self._planned and self._planned[0][0] < sample + self._block:
                planned, _, command = heapq.heappop(self._planned)
                self.overdue += planned < sample
                due_commands.append((max(planned, sample), command))
        for queued_time, command in waiting.values():
            place = int((queued_time - self._last_run) / self._length * self._block)
            last = max(last, min(place, self._block - 1))
            due_commands.append((sample + last, command))
        for place, command in sorted(due_commands, key=itemgetter(0)):
            try:
                command(place)
            except Exception as failure:  # noqa: BLE001 - raised in the user's thread
                self._error.keep(failure)
        self._last_run = run_time


class PlayedBody:
    """A model that is played, with the hands that hold it and the contacts looked up so far."""

    def __init__(self, model: ModalModel, sample_rate: float) -> None:
        self.model = model.expanded()  # resonators need one product of contact and listener
        self.free = Poles.of(self.model, sample_rate)
        self._rate = sample_rate
        self._contacts: dict[Hashable, Contact] = {}
        self._drives: dict[Hashable, Array] = {}
        self._holds: dict[Hashable, tuple[Hold, Array]] = {}

    def contact(self, at: Contact | Place = None, direction: Place = None) -> Contact:
        """Return a contact, the same object for the same place."""
        if isinstance(at, Contact):
            return at
        key = (_hashable(at), _hashable(direction))
        contact = self._contacts.get(key)
        return contact or _keep(self._contacts, key, self.model.contact(at, direction))

    def drive(self, contact: Contact, patch: float = 0.0) -> Array:
        """Return how strongly each mode answers, the same object for the same contact."""
        key = (*contact.point.tolist(), *contact.direction.tolist(), patch)
        mode_drive = self._drives.get(key)
        if mode_drive is None:
            mode_drive = _keep(self._drives, key, drive(self.model, contact, radius=patch))
        return mode_drive

    def hold(self, at: Place, grip: float) -> None:
        """Hold the body at a place with a viscous grip, N s/m (`Hold`); 0 releases it."""
        place = tuple(self.contact(at).point.tolist())
        hold = Hold(at=place or None, grip=grip)  # recorded at one place, it has no coordinates
        self._holds.pop(place, None)
        if grip:
            self._holds[place] = hold, hold.raised(self.model)

    def changed(self, model: ModalModel) -> PlayedBody:
        """Return another body in the same hands; OptionError where the number of modes differs."""
        body = PlayedBody(model, self._rate)
        self.free.require_same(body.free)
        for hold, _ in self._holds.values():
            body.hold(hold.at, hold.grip)
        return body

    @property
    def logarithms(self) -> Complex:
        """Logarithm of each mode's factor per sample (M,), decays raised by the hands."""
        rises = np.zeros(self.free.modes)
        for _, rise in self._holds.values():
            rises = rises + rise
        return self.free.raised(rises) / self._rate

    def outputs(self, places: Array) -> Complex:
        """Return the output gain of each mode at places (K, 3): (K, M)."""
        gains = self.model.gains.toward(places)[:, 0]
        if not np.isfinite(gains).all():
            raise OptionError(
                "the gains are not finite: fit or analyze the body again, or look at its model file"
            )
        return with_recoil(gains, self.model.recoil, away_from(self.model, places), self._rate)

    def outputs_aside(self) -> Complex:
        """Return the output gain of each mode (1, M) at 1 m, the body taken as a point source."""
        offset = place_beside(self.model)
        return offset[0] * self.outputs((centre_of(self.model) + offset)[None])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlannedBlow:
    """A planned strike: its force, the drive of each mode, and its residual sound at 1 m."""

    drive: Array
    pulse: Samples
    ideal: bool  # without duration
    residual: Samples | None

    @classmethod
    def of(cls, body: PlayedBody, strike: Strike, sample_rate: float) -> PlannedBlow:
        """Plan a strike of a body."""
        model, contact = body.model, body.contact(strike.at, strike.direction)
        blow = strike.resolved(model, contact)
        return cls(
            drive=body.drive(contact, strike.patch),
            pulse=after_attack(strike, model).pulse(blow, sample_rate),
            ideal=not blow.duration,
            residual=residual_of(strike, model, sample_rate),
        )

    @property
    def first(self) -> int:
        """Number of the first sample of the blow."""
        first_sample = self.pulse.first
        return first_sample if self.residual is None else min(first_sample, self.residual.first)


class Notes:
    """The last updates of a touch, to be rendered offline."""

    def __init__(self, tool: Tool) -> None:
        self._tool = tool
        self._rows: Array = np.full((MAX_UPDATES, 9), 0.0)
        self._count, self._axes, self._has_directions = 0, 3, True

    def add(self, time: float, update: Update) -> None:
        """Note an update that takes effect at a time, s; when full it replaces the oldest."""
        row = self._rows[self._count % MAX_UPDATES]
        self._axes, self._has_directions = len(update.point), bool(update.direction.any())
        row[0] = time
        row[1 : 1 + self._axes], row[4:7] = update.point, update.direction
        row[7:] = update.force, update.speed
        self._count += 1

    def log(self) -> TouchLog:
        """Return the updates as an excitation; OptionError where there was no touch."""
        if not self._count:
            raise OptionError("nothing was touched yet: there is no log")
        rows = np.roll(self._rows, -(self._count % MAX_UPDATES), axis=0)
        rows = rows if self._count > MAX_UPDATES else self._rows[: self._count]
        return TouchLog(
            times=rows[:, 0],
            points=rows[:, 1 : 1 + self._axes] if self._axes else None,
            directions=rows[:, 4:7] if self._has_directions else None,
            forces=rows[:, 7],
            speeds=rows[:, 8],
            tool=self._tool,
        )


def listening(listener: Any) -> Array | Listener:  # noqa: ANN401 - whatever is no listener
    """Return a listener, or a position (3,); OptionError on other values."""
    return listener if is_listener(listener) else position_of(listener)


def default_listener(models: Sequence[ModalModel]) -> Array:
    """Return a position on the x axis through the first centre, 1 m or two radii of all away."""
    centre = centre_of(models[0])
    return centre + aside(max(radius_of(replace(model, centre=centre)) for model in models))


def _hashable(place: Place) -> Hashable:
    if place is None or isinstance(place, str):
        return place
    return tuple(np.asarray(place, np.float64).ravel().tolist())


def _keep(cache: dict[Hashable, Value], key: Hashable, value: Value) -> Value:
    """Cache a value, and drop the oldest one if the cache is full; any thread may call it."""
    if len(cache) >= _CACHE_SIZE:
        cache.pop(list(cache)[0], None)  # noqa: RUF015 - no other thread comes between in `list`
    return cache.setdefault(key, value)


def full_scale(
    bodies: Sequence[PlayedBody], listeners: Sequence[Array], sample_rate: float
) -> float:
    """Return full scale per Pa at which a default strike of the loudest body peaks at -12 dB.

    The listener is in the coordinates of each body, m (3,).
    """
    pairs = zip(bodies, listeners, strict=True)
    peak = max(_peak(body, listener, sample_rate) for body, listener in pairs)
    if not peak > 0:
        raise OptionError(
            "no body is audible at the listener: check the models' gains, or give another listener="
        )
    return STRIKE_PEAK / peak


def _peak(body: PlayedBody, listener: Array, sample_rate: float) -> float:
    rate = round(sample_rate)
    return render(
        body.model, Strike(), seconds=_LOUDNESS_SECONDS, sample_rate=rate, listener=listener
    ).peak

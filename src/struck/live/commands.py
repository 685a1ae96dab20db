"""Where a player's wishes become records: any thread on one side, the feeder on the other."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from struck.ears.listeners import Listener
from struck.errors import OptionError
from struck.excitation.pulses import LEAD, Samples
from struck.excitation.pushing import Pushing
from struck.excitation.tool import Tool, Update
from struck.excitation.touch import Touching
from struck.live.ears import LiveEars
from struck.live.level import full_scale
from struck.live.played import Played
from struck.live.pushes import Blows, Started
from struck.live.ring import FIRST_OUTPUTS, NEW_OUTPUTS, NEW_POLES, Layout, Record, Ring
from struck.live.sounding import arena
from struck.live.touches import Notes
from struck.live.troubles import Troubles
from struck.live.voices import Voices
from struck.live.wishes import Wishes
from struck.model.contact import Place
from struck.model.model import ModalModel
from struck.synth.memory import Body
from struck.synth.poles import Complex, require_session
from struck.synth.stepped import Stepped

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

MOST_AHEAD = 64
"""Blocks that may be kept ready."""


class Desk:
    """The host's side of what is played.

    Parameters
    ----------
    models : sequence of ModalModel
        The bodies.
    listener : array (3,) or Listener
        Where they are heard, m, by one ear for which the travel time is left out; or with which
        ears.
    sample_rate : float
        Hz.
    block, voices : int
        Samples of a block; excitations at once.
    volume : float
        dB.
    ahead : int
        Blocks kept ready.
    clock : callable
        The time, s.

    Attributes
    ----------
    records : Ring
        For the callback.
    arena : array
        For the callback.
    now : int
        Number of the sample at which the next block begins.

    Raises
    ------
    OptionError
        On models that are not fit to ring, or numbers outside their bounds.
    ContactError
        Where the listener is inside a body.
    """

    def __init__(
        self,
        models: Sequence[ModalModel],
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
        if voices < 1 or not 1 <= ahead <= MOST_AHEAD:
            raise OptionError(
                f"voices is {voices} and ahead {ahead}: give at least 1, and at most {MOST_AHEAD} "
                "blocks ahead"
            )
        self.listener, self.volume = listener, volume
        self._rate, self._block = sample_rate, block
        self._bodies = [Played(model, sample_rate) for model in models]
        self._ears: LiveEars | None = None
        if not isinstance(listener, np.ndarray):
            self._ears = LiveEars(models, listener, sample_rate=sample_rate, block=block)
        self._scale = full_scale(self._bodies, self._place, sample_rate)
        self._prepare(voices, ahead)
        self._troubles = Troubles()
        self._voices = Voices(voices, self._troubles)
        self._touches: dict[tuple[int, int], tuple[Touching, Notes]] = {}
        self._wishes = Wishes(clock, block=block, sample_rate=sample_rate, troubles=self._troubles)
        self._changing = threading.Lock()  # bodies, hands and listener, and the order of changes
        self._poles: dict[int, Complex] = {}
        self._outputs = {n: self._heard(body) for n, body in enumerate(self._bodies)}
        self._first = True
        self._dropped = self.now = 0

    def _prepare(self, voices: int, ahead: int) -> None:
        """Lay out all memory; nothing is allocated later but what excitations make."""
        self._bank = Stepped(
            [body.free for body in self._bodies],
            points=1,
            block=self._block,
            voices=voices,
            sample_rate=self._rate,
        )
        memory = self._bank.memory
        ears = self._ears
        self._layout = Layout.of(memory, 1, *((ears.paths, ears.taps) if ears else ()))
        self._firsts = memory.bodies[:, Body.FIRST].tolist()
        self.arena = arena(self._bank, volume=self.gain, ears=ears)
        # Those ahead, the one that is heard, and the one that is written.
        self.records = Ring(
            capacity=ahead + 2, integers=self._layout.integers, reals=self._layout.reals
        )

    @property
    def gain(self) -> float:
        """Of full scale for each Pa."""
        return self._scale * 10 ** (self.volume / 20)

    @property
    def bank(self) -> Stepped:
        """The modes; the callback's alone once it plays."""
        return self._bank

    @property
    def idle(self) -> float:
        """How long ago the last block was filled, s."""
        return self._wishes.idle

    @property
    def dropped(self) -> int:
        """Wishes that there was no room or no voice for."""
        return self._wishes.refused + self._dropped

    def body(self, number: int) -> Played:
        """Return a body; OptionError where there is none of that number."""
        if not 0 <= number < len(self._bodies):
            raise OptionError(f"body is {number}: there are 0 to {len(self._bodies) - 1}")
        return self._bodies[number]

    def raise_trouble(self) -> None:
        """Raise why an excitation was stopped since this was last asked, if one was."""
        self._troubles.tell()

    def has_room(self) -> bool:
        """Tell whether one more wish may wait; where not, it counts as dropped."""
        return self._wishes.have_room()

    def strike(self, body: int, drive: Array, pulse: Samples) -> None:
        """Strike a body with a pulse whose first sample counts from now."""
        self._wishes.add(lambda sample: self._strike(body, drive, pulse, sample))

    def start(self, body: int, started: Started) -> None:
        """Let an excitation begin with the next block; it has ended where there is no room."""
        if not self._wishes.add(lambda _: self._add(started, body, started) or started.end()):
            started.end()

    def touching(self, body: int, finger: int, tool: Tool | None) -> tuple[Touching, Notes]:
        """Return a touch, and what is noted of it; a first one begins."""
        key = (body, finger)
        if key not in self._touches:
            chosen = tool or Tool()
            touching = Touching(self.body(body).model, self._rate, tool=chosen)
            self._touches.setdefault(key, (touching, Notes(chosen)))
        return self._touches[key]

    def touch(self, body: int, finger: int, word: Update) -> None:
        """Let a touch follow a word from now on."""
        self._wishes.add(lambda sample: self._touch(body, finger, word, sample))

    def notes(self, body: int, finger: int) -> Notes:
        """Return what is noted of a touch; OptionError where there was none."""
        if (body, finger) not in self._touches:
            raise OptionError(f"finger {finger} has not touched body {body} yet: there is no log")
        return self._touches[body, finger][1]

    def dampen(self, body: int, at: Place, grip: float) -> None:
        """Hold a body, or let it go."""
        with self._changing:
            held = self.body(body)
            held.hold(at, grip)
            logarithms = held.logarithms
            self._wishes.put(("hold", body), lambda _: self._poles.update({body: logarithms}))

    def change(self, body: int, model: ModalModel) -> None:
        """Let a body go on as another."""
        with self._changing:
            other = self.body(body).changed(model)
            poles, outputs = other.logarithms, self._heard(other)
            self._bodies[body] = other
            self._wishes.put(("change", body), lambda _: self._change(body, model, poles, outputs))

    def listen(self, listener: Array | Listener) -> None:
        """Let all bodies be heard elsewhere; OptionError on ears of another kind."""
        with self._changing:
            if self._ears is not None and not isinstance(listener, np.ndarray):
                self._ears.listen(listener)
            elif self._ears is None and isinstance(listener, np.ndarray):
                outputs = {n: body.outputs(listener) for n, body in enumerate(self._bodies)}
                self._wishes.put("listener", lambda _: self._outputs.update(outputs))
            else:
                raise OptionError(
                    f"listener is {listener!r}: a player begun with ears keeps to ears, one begun "
                    "with a bare position to positions; start another"
                )
            self.listener = listener

    @property
    def _place(self) -> Array:
        """Where loudness counts, m (3,)."""
        if self._ears is not None:
            return self._ears.position
        return np.asarray(self.listener, np.float64)

    def _heard(self, body: Played) -> Complex:
        return body.outputs_aside() if self._ears else body.outputs(self._place)

    def fill(self, integers: Integers, reals: Array) -> None:
        """Write the record of the next block; the feeder calls it."""
        self._wishes.obey(self.now)
        record = self._layout.record(integers, reals)
        record.volume[0] = self.gain
        self._write_bodies(record)
        self._voices.write(record)
        if self._ears is not None:
            self._ears.write(record)
        self.now += self._block

    def _write_bodies(self, record: Record) -> None:
        record.bodies[:] = 0
        for body, logarithms in self._poles.items():
            self._put(record.poles, body, logarithms)
            record.bodies[body] |= NEW_POLES
        for body, outputs in self._outputs.items():
            self._put(record.outputs[:, 0], body, outputs)
            record.bodies[body] |= NEW_OUTPUTS | (FIRST_OUTPUTS if self._first else 0)
        self._poles, self._outputs, self._first = {}, {}, False

    def _put(self, places: Array, body: int, values: Complex) -> None:
        modes = slice(self._firsts[body], self._firsts[body] + len(values))
        places[0, modes], places[1, modes] = values.real, values.imag

    def _strike(self, body: int, drive: Array, pulse: Samples, sample: int) -> None:
        key = ("strike", body, id(drive))
        blows = self._voices.find(key)
        if not isinstance(blows, Blows):
            blows = Blows(drive, start=self.now)
            if not self._add(blows, body, key):
                return
        if not blows.add(Samples(first=sample + LEAD + pulse.first, force=pulse.force)):
            self._dropped += 1

    def _touch(self, body: int, finger: int, word: Update, sample: int) -> None:
        touching, notes = self._touches[body, finger]
        key = ("touch", body, finger)
        if self._voices.find(key) is None:
            touching.resume(self.now)
            if not self._add(touching, body, key):
                return
        touching.follow(replace(word, sample=sample))
        notes.add(sample / self._rate, word)

    def _change(self, body: int, model: ModalModel, poles: Complex, outputs: Complex) -> None:
        self._poles[body], self._outputs[body] = poles, outputs
        self._voices.change(body, model)
        for (touched, finger), (touching, _) in list(self._touches.items()):
            if touched == body and self._voices.find(("touch", body, finger)) is None:
                touching.change(model)  # at rest

    def _add(self, pushing: Pushing, body: int, key: object) -> bool:
        added = self._voices.add(pushing, body, key)
        self._dropped += not added
        return added

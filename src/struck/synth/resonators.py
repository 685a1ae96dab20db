"""All bodies of a scene as one bank of resonators: all that changes while sound plays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from struck.core import compiled, entry
from struck.errors import OptionError
from struck.excitation.excitation import Push
from struck.model.arrays import Array, Complex, checked, require_number
from struck.synth.memory import BodyColumn, Drive, Level, Mode, Output, Voice, lay_out, view_memory
from struck.synth.poles import (
    Key,
    Poles,
    Ringing,
    require_outputs,
    require_pushes,
    require_session,
    voices_for,
)
from struck.synth.reference import Tables

QUIET_RATIO = 1e-6  # of its loudest, below which a body may fall asleep: -120 dB


class Stepped:
    """Bodies stepped sample by sample, in one memory that is laid out once."""

    def __init__(
        self,
        poles: Sequence[Poles],
        *,
        points: int,
        block: int,
        voices: int,
        sample_rate: float,
        quiet: float = QUIET_RATIO,
    ) -> None:
        self._counts = [len(body_poles.values) for body_poles in poles]
        self._points, self._rate = points, sample_rate
        sizes = {"points": points, "voices": voices, "block": block}
        self._reals, self._wholes = lay_out(tuple(self._counts), **sizes)
        self.memory = view_memory(self._reals, self._wholes)
        self.memory.levels[Level.RATE], self.memory.levels[Level.QUIET] = sample_rate, quiet
        self._first = True
        self._forces = list(self.memory.forces)
        self._slots: dict[Key, int] = {}
        self._drives: dict[Key, Array] = {}
        self._free = list(range(voices))
        # Arguments of the core: addresses need no check in every block.
        self._places = self._reals.ctypes.data, self._wholes.ctypes.data
        core = (compiled(f"bank_{name}") for name in ("make_block", "settle", "refresh", "stand"))
        self._make_block, self._settle, self._refresh, self._stand = core
        for body, body_poles in enumerate(poles):
            self.take_poles(body, body_poles)

    @property
    def numbers(self) -> tuple[Array, NDArray[np.int64]]:
        """The real and the whole numbers of its memory, for compiled code."""
        return self._reals, self._wholes

    @property
    def asleep(self) -> NDArray[np.bool_]:
        """Which bodies are asleep (bodies,)."""
        return self.memory.bodies[:, BodyColumn.ASLEEP] > 0

    def states(self, body: int) -> Complex:
        """Return c of a body's modes after the last block; wakes it."""
        self._settle(*self._places, body)
        modes = self.memory.modes[:, self._range(body)]
        return modes[Mode.STATE_RE] + 1j * modes[Mode.STATE_IM]

    def next_block(
        self, pushes: Mapping[Key, tuple[Array, Array]], outputs: Mapping[int, Complex]
    ) -> Array:
        """Return the next samples (bodies, points, block), valid until the next call."""
        for body, gains in outputs.items():
            self._take_outputs(body, gains)
        if pushes.keys() != self._slots.keys():
            self._free_slots(pushes)
        for key, (force, drive) in pushes.items():
            self._take_push(key, force, drive)
        self._first = False
        self._make_block(*self._places)
        return self.memory.sounds[:, : self._points]

    def _range(self, body: int) -> slice:
        first = int(self.memory.bodies[body, BodyColumn.FIRST])
        return slice(first, first + self._counts[body])

    def take_poles(self, body: int, poles: Poles) -> None:
        """Replace a body's poles and all that follows from them; states stay."""
        self._settle(*self._places, body)
        values, memory, modes = poles.values, self.memory, self._range(body)
        memory.modes[Mode.LOG_RE, modes] = values.real / self._rate
        memory.modes[Mode.LOG_IM, modes] = values.imag / self._rate
        memory.modes[Mode.STATE_RE : Mode.STATE_IM + 1, modes] *= values != 0
        self._refresh(*self._places, body)
        memory.bodies[body, BodyColumn.MOVED] = 1
        memory.voices[memory.voices[:, Voice.BODY] == body, Voice.MOVED] = 1

    def _take_outputs(self, body: int, gains: Complex) -> None:
        memory, modes = self.memory, self._range(body)
        layers = memory.outputs[:, : self._points, modes]
        layers[Output.TARGET_RE], layers[Output.TARGET_IM] = gains.real, gains.imag
        if self._first:
            layers[Output.RE], layers[Output.IM] = gains.real, gains.imag
            self._stand(*self._places, body)
        memory.bodies[body, BodyColumn.MOVED] = 1
        memory.turned[0] |= bool(gains.imag.any())

    def _free_slots(self, pushes: Mapping[Key, tuple[Array, Array]]) -> None:
        for key in self._slots.keys() - pushes.keys():
            slot = self._slots.pop(key)
            del self._drives[key]
            self.memory.voices[slot, Voice.ACTIVE] = 0
            self._free.append(slot)

    def _take_push(self, key: Key, force: Array, drive: Array) -> None:
        slot = self._slots.get(key)
        if slot is None:
            slot = self._slots[key] = self._free.pop()
            self.memory.voices[slot, Voice.BODY] = key[0]
            self.memory.voices[slot, Voice.ACTIVE] = 2
            self.memory.drives[Drive.NOW, slot, : len(drive)] = drive
            self._take_drive(key, slot, drive)
        else:
            self.memory.voices[slot, Voice.ACTIVE] = 1
            if drive is not self._drives[key]:
                self._take_drive(key, slot, drive)
        self._forces[slot][:] = force

    def _take_drive(self, key: Key, slot: int, drive: Array) -> None:
        self.memory.drives[Drive.TARGET, slot, : len(drive)] = drive
        self.memory.voices[slot, Voice.MOVED] = 1
        self._drives[key] = drive


@checked
class Resonators:
    """Modes of all bodies, pushed and heard block after block.

    Parameters
    ----------
    models : sequence
        Bodies, each with `frequencies` and `decays`. Modes at or above half the sample rate are
        left out and counted in `dropped`.
    sample_rate : float, default 48000
        Sample rate, Hz, 8,000 to 192,000.
    block : int, default 128
        Samples per call of `process`, 1 to 4,096.
    points : int, default 1
        Number of outputs of each body.
    voices : int or None, default None
        Maximum number of pushes in one block. None: 4 per body, at least 16.
    quiet : float, default 1e-6
        Fraction of its largest level below which a body that is not pushed is no longer computed.
        When pushed again, it continues as if it had been.

    Raises
    ------
    OptionError
        If there are no models or no modes, or a number is out of range.

    Notes
    -----
    A mode with pole s is c[k] = exp(s / rate) c[k-1] + drive F[k] / rate. What is heard is
    Im[sum of output c[k]] less what a constant force would end in: a body that only bends under a
    steady load is silent. Gains go linearly, sample by sample, from those of the last block's end
    to those given.

    Examples
    --------
    >>> from struck.excitation import Push
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> model = struck.analyze(bar, "steel", progress=None)
    >>> drive = np.ones(len(model.frequencies))  # kg^-1/2
    >>> outputs = np.ones((1, len(model.frequencies)), complex)
    >>> force = np.zeros(128)
    >>> force[0] = 1.0
    >>> resonators = struck.synth.Resonators([model], block=128)
    >>> resonators.process([Push(force=force, drive=drive)], [outputs]).shape
    (1, 1, 128)
    """

    def __init__(
        self,
        models: Sequence[Ringing],
        *,
        sample_rate: float = 48000,
        block: int = 128,
        points: int = 1,
        voices: int | None = None,
        quiet: float = QUIET_RATIO,
    ) -> None:
        require_session(sample_rate, block, points)
        if not len(models):
            raise OptionError("there are 0 models: give at least one")
        self.sample_rate, self.block, self.points = sample_rate, block, points
        self._poles = [Poles.of(model, sample_rate) for model in models]
        self._voices = voices_for(len(models), voices)
        engine = Stepped if entry("bank_make_block") else Tables
        self._engine = engine(
            self._poles,
            points=points,
            block=block,
            voices=self._voices,
            sample_rate=sample_rate,
            quiet=quiet,
        )
        self._last: dict[Key, tuple[Array, Array]] = {}

    @property
    def dropped(self) -> tuple[int, ...]:
        """How many modes of each body lie at or above half the sample rate."""
        return tuple(poles.dropped for poles in self._poles)

    @property
    def asleep(self) -> NDArray[np.bool_]:
        """Which bodies are asleep (bodies,)."""
        return self._engine.asleep

    @checked
    def states(self, body: int) -> Complex:
        """Return the states of a body after the last block.

        Parameters
        ----------
        body : int
            Number of the body.

        Returns
        -------
        array (M,), complex
            State c of each mode.
        """
        return self._engine.states(self._number(body))

    def process(
        self, pushes: Sequence[Push] = (), outputs: Sequence[NDArray[np.generic] | None] = ()
    ) -> Array:
        """Compute the next block of sound of all bodies.

        Parameters
        ----------
        pushes : sequence of Push, default ()
            Forces (block,), N, and drives (M,) at the end of the block. A voice of a body that was
            in the last block continues from its last drive.
        outputs : sequence of array (points, M), complex, or None, default ()
            Gains of each body at the end of the block. None, or no entry: unchanged. Those of the
            first block hold from its start; a body without them is silent.

        Returns
        -------
        array (bodies, points, block)
            Sound, valid until the next call.

        Raises
        ------
        OptionError
            If forces, drives or outputs are not finite or do not fit. Nothing is changed then.
        """
        pushing = require_pushes(pushes, self._poles, self.block, self._voices, self._last)
        gains = require_outputs(outputs, self._poles, self.points)
        samples = self._engine.next_block(pushing, gains)
        self._last = pushing
        return samples

    @checked
    def change(self, body: int, model: Ringing) -> None:
        """Change frequencies and decay rates of a body, which continues from its states.

        Modes that pass half the sample rate fall silent; they come back, at rest, with lower
        frequencies.

        Parameters
        ----------
        body : int
            Number of the body.
        model : Ringing
            The new frequencies and decay rates.

        Raises
        ------
        OptionError
            When the model is not fit to ring, or has another number of modes.
        """
        poles, body = Poles.of(model, self.sample_rate), self._number(body)
        self._poles[body].require_same(poles)
        self._engine.take_poles(body, poles)
        self._poles[body] = poles

    def _number(self, body: int) -> int:
        """Return the number of a body, once it is one."""
        require_number("body", body, 0, len(self._poles) - 1, whole=True)
        return int(body)

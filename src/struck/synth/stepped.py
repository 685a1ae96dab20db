"""Bodies that are stepped sample by sample, in one memory; the host's side of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from struck.synth.blocks import refresh, settle, stand, wake
from struck.synth.dispatch import runner
from struck.synth.memory import (
    Body,
    Drive,
    Level,
    Mode,
    Output,
    Run,
    Voice,
    laid_out,
    rows_for,
    seen,
)
from struck.synth.poles import Array, Complex, Key, Poles
from struck.synth.process import make_block

# Of its loudest, the share below which a body may fall asleep: -120 dB.
QUIET = 1e-6


class Stepped:
    """The memory of some bodies, filled from checked input and moved on block by block.

    Parameters
    ----------
    poles : sequence of Poles
        Of each body.
    points, block, voices : int
        Outputs of a body, samples in a block, pushes at once.
    sample_rate : float
        Hz.
    quiet : float
        Share of its loudest at which a body falls asleep.
    """

    def __init__(
        self,
        poles: Sequence[Poles],
        *,
        points: int,
        block: int,
        voices: int,
        sample_rate: float,
        quiet: float = QUIET,
    ) -> None:
        self._counts = [len(each.values) for each in poles]
        self._points, self._rate, self._rows = points, sample_rate, rows_for(points)
        sizes = {"points": points, "voices": voices, "block": block}
        self._reals, self._wholes = laid_out(tuple(self._counts), **sizes)
        self.memory = seen(self._reals, self._wholes)
        self.memory.levels[Level.RATE], self.memory.levels[Level.QUIET] = sample_rate, quiet
        self.turned, self._first = False, True
        self._forces = list(self.memory.forces)
        self._slots: dict[Key, int] = {}
        self._drives: dict[Key, Array] = {}
        self._free, self._voices = list(range(voices)), voices
        for body, each in enumerate(poles):
            self.take_poles(body, each)

    @property
    def numbers(self) -> tuple[Array, NDArray[np.int64]]:
        """The real and the whole numbers of its memory, for functions without Python."""
        return self._reals, self._wholes

    @property
    def asleep(self) -> NDArray[np.bool_]:
        """Which bodies are asleep (bodies,)."""
        return self.memory.bodies[:, Body.ASLEEP] > 0

    def states(self, body: int) -> Complex:
        """Return c of a body's modes after the last block; wakes it."""
        settle(self.memory, body)
        wake(self.memory, body)
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
        if not self.memory.run[Run.ADDRESS]:
            self.compile()
        make_block(self._reals, self._wholes)
        return self.memory.sounds[:, : self._points]

    def compile(self, *, turned: bool = False) -> None:
        """Choose and compile kernels, for complex outputs if told; `next_block` does if need be."""
        self.turned |= turned
        self.memory.run[:] = runner(self._rows, turned=self.turned, voices=self._voices)

    def _range(self, body: int) -> slice:
        first = int(self.memory.bodies[body, Body.FIRST])
        return slice(first, first + self._counts[body])

    def take_poles(self, body: int, poles: Poles) -> None:
        """Go on with these poles; work out anew what follows from them, gains too."""
        settle(self.memory, body)
        wake(self.memory, body)
        values, memory, modes = poles.values, self.memory, self._range(body)
        memory.modes[Mode.LOG_RE, modes] = values.real / self._rate
        memory.modes[Mode.LOG_IM, modes] = values.imag / self._rate
        memory.modes[Mode.STATE_RE : Mode.STATE_IM + 1, modes] *= values != 0
        refresh(memory, body)
        memory.bodies[body, Body.MOVED] = 1
        memory.voices[memory.voices[:, Voice.BODY] == body, Voice.MOVED] = 1

    def _take_outputs(self, body: int, gains: Complex) -> None:
        memory, modes = self.memory, self._range(body)
        layers = memory.outputs[:, : self._points, modes]
        layers[Output.TARGET_RE], layers[Output.TARGET_IM] = gains.real, gains.imag
        if self._first:
            layers[Output.RE], layers[Output.IM] = gains.real, gains.imag
            stand(memory, body)
        memory.bodies[body, Body.MOVED] = 1
        if not self.turned and gains.imag.any():
            self.turned = True
            self.memory.run[Run.ADDRESS] = 0

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

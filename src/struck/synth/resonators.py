"""All bodies of a scene as one bank of resonators: all that changes while sound plays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.excitation.excitation import Push
from struck.model.arrays import Array, Complex
from struck.synth.block_transform import Transformed, fits_transform, gains_by_transform
from struck.synth.blocks import make_block, refresh, runner, settle, stand, wake
from struck.synth.memory import (
    BodyColumn,
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
from struck.synth.poles import (
    Key,
    Poles,
    Ringing,
    require_outputs,
    require_pushes,
    require_session,
    voices_for,
)
from struck.synth.reference import Piece

QUIET = 1e-6  # of its loudest, below which a body may fall asleep: -120 dB


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
        """The real and the whole numbers of its memory, for compiled code."""
        return self._reals, self._wholes

    @property
    def asleep(self) -> NDArray[np.bool_]:
        """Which bodies are asleep (bodies,)."""
        return self.memory.bodies[:, BodyColumn.ASLEEP] > 0

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
        """Choose and compile kernels; `next_block` does it if need be."""
        self.turned |= turned
        self.memory.run[:] = runner(self._rows, turned=self.turned, voices=self._voices)

    def _range(self, body: int) -> slice:
        first = int(self.memory.bodies[body, BodyColumn.FIRST])
        return slice(first, first + self._counts[body])

    def take_poles(self, body: int, poles: Poles) -> None:
        """Replace a body's poles and all that follows from them; states stay."""
        settle(self.memory, body)
        wake(self.memory, body)
        values, memory, modes = poles.values, self.memory, self._range(body)
        memory.modes[Mode.LOG_RE, modes] = values.real / self._rate
        memory.modes[Mode.LOG_IM, modes] = values.imag / self._rate
        memory.modes[Mode.STATE_RE : Mode.STATE_IM + 1, modes] *= values != 0
        refresh(memory, body)
        memory.bodies[body, BodyColumn.MOVED] = 1
        memory.voices[memory.voices[:, Voice.BODY] == body, Voice.MOVED] = 1

    def _take_outputs(self, body: int, gains: Complex) -> None:
        memory, modes = self.memory, self._range(body)
        layers = memory.outputs[:, : self._points, modes]
        layers[Output.TARGET_RE], layers[Output.TARGET_IM] = gains.real, gains.imag
        if self._first:
            layers[Output.RE], layers[Output.IM] = gains.real, gains.imag
            stand(memory, body)
        memory.bodies[body, BodyColumn.MOVED] = 1
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


ENGINES = ("auto", "stepped", "transformed")


class Resonators:
    """Modes of all bodies, pushed and heard block after block.

    Parameters
    ----------
    models : sequence
        A body each, with `frequencies` and `decays`. Modes at or above half the sample rate are
        left out and counted in `dropped`.
    sample_rate : float
        8000 to 192000 Hz.
    block : int
        Samples that each `process` makes, 1 to 4096.
    points : int
        Outputs of each body.
    voices : int or None
        Pushes that there may be in one block; None: 4 for each body, at least 16.
    quiet : float
        A body that nothing pushes falls asleep once it can be no louder than this share of the
        loudest that it was, and costs nothing more; it wakes as the one it would have been.
    engine : str
        "stepped": sample by sample; "transformed": by the block transform, for bodies of thousands
        of modes; "auto": for each body whichever is faster. Their sounds differ by at most -120 dB.

    Raises
    ------
    OptionError
        On no models, no modes, or numbers outside their bounds.

    Notes
    -----
    A mode with pole s is c[k] = exp(s / rate) c[k-1] + drive F[k] / rate. What is heard is
    Im[sum of output c[k]] less what a constant force would end in: a body that only bends under a
    steady load is silent. Gains go linearly, sample by sample, from those of the last block's end
    to those given.
    """

    def __init__(
        self,
        models: Sequence[Ringing],
        *,
        sample_rate: float = 48000,
        block: int = 128,
        points: int = 1,
        voices: int | None = None,
        quiet: float = QUIET,
        engine: str = "auto",
    ) -> None:
        require_session(sample_rate, block, points)
        if not models:
            raise OptionError("there are 0 models: give at least one")
        self.sample_rate, self.block, self.points = sample_rate, block, points
        self._poles = [Poles.of(model, sample_rate) for model in models]
        self._voices = voices_for(len(models), voices)
        large = [_by_transform(engine, poles, sample_rate, block) for poles in self._poles]
        self._large = {
            body: Transformed(
                self._poles[body], points=points, block=block, sample_rate=sample_rate, quiet=quiet
            )
            for body in np.flatnonzero(large).tolist()
        }
        small = [body for body, other in enumerate(large) if not other]
        self._place = {body: place for place, body in enumerate(small)}
        self._stepped = Stepped(
            [self._poles[body] for body in small],
            points=points,
            block=block,
            voices=self._voices,
            sample_rate=sample_rate,
            quiet=quiet,
        )
        self._last: dict[Key, tuple[Array, Array]] = {}
        self._arranged: dict[Key, tuple[Array, Array]] = {}
        self._first = True

    @property
    def dropped(self) -> tuple[int, ...]:
        """How many modes of each body lie at or above half the sample rate."""
        return tuple(poles.dropped for poles in self._poles)

    @property
    def asleep(self) -> NDArray[np.bool_]:
        """Which bodies are asleep (bodies,)."""
        asleep, stepped = np.zeros(len(self._poles), np.bool_), self._stepped.asleep
        for body, place in self._place.items():
            asleep[body] = stepped[place]
        for body, modes in self._large.items():
            asleep[body] = modes.asleep
        return asleep

    def states(self, body: int) -> Complex:
        """Return c of a body's modes after the last block (M,)."""
        if body in self._large:
            return self._large[body].states
        return self._stepped.states(self._place[body])

    def process(
        self, pushes: Sequence[Push] = (), outputs: Sequence[NDArray[np.generic] | None] = ()
    ) -> Array:
        """Make the next block.

        Parameters
        ----------
        pushes : sequence of Push
            Forces (block,), N, and drives (M,) at the end of the block. A body's voice that was
            there in the last block goes on from its last drive.
        outputs : sequence of array (points, M), complex, or None
            For each body its gains at the end of the block; None, or none at all: as they were.
            Those of the first block hold from its start; without them a body is silent.

        Returns
        -------
        array (bodies, points, block)
            Valid until the next call: copy what shall last.

        Raises
        ------
        OptionError
            On forces, drives or outputs that are not finite or do not fit, before anything is
            changed.
        """
        checked = require_pushes(pushes, self._poles, self.block, self._voices, self._last)
        gains = require_outputs(outputs, self._poles, self.points)
        if self._large:
            samples = self._with_large(checked, gains)
        else:
            samples = self._stepped.next_block(checked, gains)
        self._last, self._first = checked, False
        return samples

    def change(self, body: int, model: Ringing) -> None:
        """Let a body go on with other frequencies and decays, from the states that it has.

        Modes that pass half the sample rate fall silent; they come back, at rest, with lower
        frequencies.

        Raises
        ------
        OptionError
            When the model is not fit to ring, has another number of modes, or decays too much
            within a block of the block transform.
        """
        poles = Poles.of(model, self.sample_rate)
        self._poles[body].require_size(poles.values, "the changed model")
        if body in self._large:
            _require_fit(poles, self.sample_rate, self.block)
            self._large[body].take(poles)
            for key in self._arranged.keys() & {(body, voice) for _, voice in self._arranged}:
                drive = self._arranged[key][0]
                self._arranged[key] = drive, self._large[body].kept(drive)
        else:
            self._stepped.take_poles(self._place[body], poles)
        self._poles[body] = poles

    def _with_large(
        self, pushes: Mapping[Key, tuple[Array, Array]], outputs: Mapping[int, Complex]
    ) -> Array:
        samples = np.zeros((len(self._poles), self.points, self.block))
        if self._place:
            samples[list(self._place)] = self._stepped.next_block(
                {
                    (self._place[body], voice): push
                    for (body, voice), push in pushes.items()
                    if body in self._place
                },
                {self._place[body]: gain for body, gain in outputs.items() if body in self._place},
            )
        pieces = self._pieces(pushes)
        for body, modes in self._large.items():
            gains = outputs.get(body)
            wanted = None if gains is None else modes.arranged(gains)
            if self._first and wanted is not None:
                modes.outputs, wanted = wanted, None
            samples[body] = modes.next_block(pieces.get(body, []), wanted)
        return samples

    def _pieces(self, pushes: Mapping[Key, tuple[Array, Array]]) -> dict[int, list[Piece]]:
        """Return what pushes large bodies, with drives in their own order."""
        pieces: dict[int, list[Piece]] = {body: [] for body in self._large}
        arranged: dict[Key, tuple[Array, Array]] = {}
        for key, (force, drive) in pushes.items():
            if key[0] in self._large:
                before = self._arranged.get(key)
                same = before is not None and before[0] is drive
                now = before[1] if before and same else self._large[key[0]].kept(drive)
                arranged[key] = drive, now
                pieces[key[0]].append((force, before[1] if before else now, now))
        self._arranged = arranged
        return pieces


def _by_transform(engine: str, poles: Poles, sample_rate: float, block: int) -> bool:
    if engine not in ENGINES:
        raise OptionError(f"engine is {engine!r}: give one of {', '.join(ENGINES)}")
    if engine == "transformed":
        _require_fit(poles, sample_rate, block)
        return True
    return engine == "auto" and gains_by_transform(poles, sample_rate, block)


def _require_fit(poles: Poles, sample_rate: float, block: int) -> None:
    if not fits_transform(poles, sample_rate, block):
        raise OptionError(
            f"some modes die within a block of {block} samples, or it is shorter than the block "
            "transform's 16: take another block, or engine='stepped'"
        )

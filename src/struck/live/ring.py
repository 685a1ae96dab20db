"""A queue of fixed-size records between one writer and one reader, without a lock.

Records lie in plain memory, each of some integers and some reals. The writer fills the next slot
and then moves `WRITTEN`; the reader sees it move, reads the slot in place and then moves `READ`
(`queue.h` in the core explains why neither ever waits). Here is the writer's side; the reader is
the audio callback.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from struck.core import compiled
from struck.errors import OptionError
from struck.model.arrays import Array, Index
from struck.synth.memory import Memory, part

# A record is what the feeder gives the callback for one block: forces, and all that changed. It has
# the same size for every block, to fit a slot of the ring; flags mark its new parts.

# What a voice does in a block, and flags of what is new to it or to a body.
SILENT, ON, BEGIN = 0, 1, 2
NEW_POLES, NEW_OUTPUTS, FIRST_OUTPUTS = 1, 2, 4

# Columns of `Record.voices`.
STATE, OF_BODY, MOVED = 0, 1, 2
_COLUMNS = 3

# Entries of `Record.stretch`.
NEW_WAYS, SINCE = 0, 1
_STRETCH = 2


class Record(NamedTuple):
    """The arrays of one record."""

    voices: Index  # (voices, 3): SILENT, ON or BEGIN; the body; whether its drive is new
    bodies: Index  # (bodies,): NEW_POLES, NEW_OUTPUTS, FIRST_OUTPUTS added up
    volume: Array  # (1,): full scale per Pa, at the end of the block
    loads: Array  # (voices,): value of each force while the next record is late, N
    forces: Array  # (voices, block)
    beside: Array  # (bodies, points, block): sounds added to the modes of each
    drives: Array  # (voices, modes of the largest body)
    outputs: Array  # (2, points, N): real and imaginary parts, at the end of the block
    poles: Array  # (2, N): logarithm of a sample's factor, real and imaginary part
    stretch: Index  # (2,): whether the ears' paths are new, samples of their stretch that are over
    ways: Array  # (2, paths, 3): delays, samples, and gains, as of `struck.ears.delay_lines.Paths`
    responses: Array  # (paths, taps) of the ears, at the end of the stretch


@dataclass(frozen=True, slots=True, kw_only=True)
class Layout:
    """The sizes of a record."""

    voices: int
    bodies: int
    points: int
    block: int
    width: int  # modes of the largest body, padded
    modes: int  # of all bodies, padded
    paths: int = 0  # to a listener's ears; 0 where one ear hears all at once
    taps: int = 0

    @classmethod
    def of(cls, memory: Memory, points: int, paths: int = 0, taps: int = 0) -> Layout:
        """Return the sizes for a scene's memory."""
        voices, block = memory.forces.shape
        return cls(
            voices=voices - 1,
            bodies=len(memory.bodies),
            points=points,
            block=block,
            width=memory.drives.shape[2],
            modes=memory.modes.shape[1],
            paths=paths,
            taps=taps,
        )

    @property
    def integers(self) -> int:
        """Number of integers in a record."""
        return self.voices * _COLUMNS + self.bodies + _STRETCH

    @property
    def reals(self) -> int:
        """Number of reals in a record."""
        each_voice = 1 + self.block + self.width
        ears_size = self.paths * (2 * 3 + self.taps)
        each_mode, beside_size = 2 * self.points + 2, self.bodies * self.points * self.block
        return 1 + self.voices * each_voice + beside_size + each_mode * self.modes + ears_size

    def record(self, integers: Index, reals: Array) -> Record:
        """Return the parts of the record that a slot holds."""
        voices, bodies, points, block = self.voices, self.bodies, self.points, self.block
        a = 1 + voices
        beside_start = a + voices * block
        b = beside_start + bodies * points * block
        c = b + voices * self.width
        d = c + 2 * points * self.modes
        e = d + 2 * self.modes
        f = e + 6 * self.paths
        return Record(
            part(integers, 0, (voices, _COLUMNS)),
            part(integers, voices * _COLUMNS, (bodies,)),
            part(reals, 0, (1,)),
            part(reals, 1, (voices,)),
            part(reals, a, (voices, block)),
            part(reals, beside_start, (bodies, points, block)),
            part(reals, b, (voices, self.width)),
            part(reals, c, (2, points, self.modes)),
            part(reals, d, (2, self.modes)),
            part(integers, voices * _COLUMNS + bodies, (_STRETCH,)),
            part(reals, e, (2, self.paths, 3)),
            part(reals, f, (self.paths, self.taps)),
        )


# Places in the head of the memory. What different threads write is 128 bytes apart: the pair of
# cache lines that a processor fetches together.
CAPACITY, INTEGERS, REALS, WRITTEN, READ = 0, 1, 2, 16, 32
_HEAD = 48


class Ring:
    """Memory of a queue of records, and its writer's side."""

    def __init__(self, *, capacity: int, integers: int, reals: int) -> None:
        if capacity < 1 or integers < 0 or reals < 0:
            raise OptionError(
                f"a ring of {capacity} records of {integers} integers and {reals} reals: "
                "give at least 1 record, and sizes of at least 0"
            )
        self.memory: Index = np.zeros(_HEAD + capacity * (integers + reals), dtype=np.int64)
        self.memory[[CAPACITY, INTEGERS, REALS]] = capacity, integers, reals
        self._capacity = capacity
        # Compiled, so that no slot is written before it is seen to be free.
        self._publish, self._waiting = compiled("queue_publish"), compiled("queue_waiting")

    @property
    def waiting(self) -> int:
        """Records written and not yet released."""
        return self._waiting(self.memory)

    def reserve(self) -> tuple[Index, Array] | None:
        """Return the next slot, (I,) and (R,), to write before `publish`; None where full."""
        if self.waiting == self._capacity:
            return None
        slot = int(self.memory[WRITTEN]) % self._capacity
        integers, reals = (int(size) for size in self.memory[[INTEGERS, REALS]])
        first = _HEAD + self._capacity * integers
        return (
            part(self.memory, _HEAD + slot * integers, (integers,)),
            part(self.memory, first + slot * reals, (reals,)).view(np.float64),
        )

    def publish(self) -> None:
        """Hand over the slot that `reserve` returned."""
        self._publish(self.memory)

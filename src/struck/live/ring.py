"""A queue of fixed-size records between one writer and one reader, without a lock.

Records lie in plain memory, each of some integers and some reals. The writer fills the next slot
and then moves `WRITTEN` (release); the reader sees it move (acquire), reads the slot in place and
then moves `READ`. Each count has one owner and only grows, so neither side ever waits for the
other (L. Lamport, "Specifying concurrent program modules", ACM TOPLAS 5(2), 1983).

The functions here are compiled; they take `Ring.memory`, which a callback reaches by its address.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.errors import TypingError

from struck.ears import delay_kernels
from struck.errors import OptionError
from struck.model.arrays import Array, Index
from struck.synth import blocks
from struck.synth.blocks import refresh, settle, stand, wake
from struck.synth.compiler import Compiler
from struck.synth.memory import BodyColumn, Drive, Memory, Mode, Output, Typed, Voice, intrinsic

# Atomic integers. A plain store may be reordered by compiler and processor alike. A release store
# may not sink below nor an acquire load rise above what surrounds them: who sees the stored value
# also sees all that was written before it. (ISO/IEC 9899:2011, 7.17.3; LLVM language reference,
# "Atomic Memory Ordering Constraints".)
_ALIGNMENT = 8  # bytes, of an int64


def _check(array: types.Type, index: types.Type) -> None:
    counts = (
        isinstance(array, types.Array)
        and array.ndim == 1
        and array.layout == "C"
        and array.dtype == types.int64
    )
    if not counts or not isinstance(index, types.Integer):
        raise TypingError(
            f"atomics need a contiguous int64 array and an index, not {array}, {index}"
        )


def _element(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
    """Return the pointer to an element; the index is not checked."""
    array_type, index_type = signature.args[:2]
    array = context.make_array(array_type)(context, builder, arguments[0])
    index = context.cast(builder, arguments[1], index_type, types.intp)
    return cgutils.get_item_pointer(
        context, builder, array_type, array, [index], wraparound=False, boundscheck=False
    )


@intrinsic
def load(_typing: object, array: types.Type, index: types.Type) -> Typed:
    """Return `array[index]`; nothing after it is read before it (acquire)."""
    _check(array, index)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
        pointer = _element(context, builder, signature, arguments)
        return builder.load_atomic(pointer, "acquire", _ALIGNMENT, typ=ir.IntType(64))

    return types.int64(array, index), generate


@intrinsic
def store(_typing: object, array: types.Type, index: types.Type, value: types.Type) -> Typed:
    """Set `array[index]`; all that was written before it is seen with it (release)."""
    _check(array, index)

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
        pointer = _element(context, builder, signature, arguments)
        number = context.cast(builder, arguments[2], signature.args[2], types.int64)
        builder.store_atomic(number, pointer, "release", _ALIGNMENT)
        return context.get_dummy_value()

    return types.void(array, index, value), generate


# The compiler of what plays live: of its own package and of those that its code is made of.

_COMPILER = Compiler.of_packages(__file__, delay_kernels.__file__, blocks.__file__)
jitted, jitted_within = _COMPILER.jitted, _COMPILER.jitted_within
callback = _COMPILER.callback


# A record is what the feeder gives the callback for one block: forces, and all that changed. It has
# the same size for every block, to fit a slot of the ring; flags say which parts of it are new.

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
    loads: Array  # (voices,): what each force settles at while the next record is late, N
    forces: Array  # (voices, block)
    drives: Array  # (voices, modes of the largest body)
    outputs: Array  # (2, points, N): real and imaginary parts, at the end of the block
    poles: Array  # (2, N): logarithm of a sample's factor, real and imaginary part
    stretch: Index  # (2,): whether the ears' ways are new, samples of their stretch that are over
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
        heard = self.paths * (2 * 3 + self.taps)
        return 1 + self.voices * each_voice + (2 * self.points + 2) * self.modes + heard

    def record(self, integers: Index, reals: Array) -> Record:
        """Return the parts of the record that a slot holds."""
        sizes = (self.voices, self.bodies, self.points, self.block, self.width, self.modes)
        return _parted(integers, reals, (*sizes, self.paths, self.taps))


def _parted(
    integers: Index, reals: Array, sizes: tuple[int, int, int, int, int, int, int, int]
) -> Record:
    """Return the arrays of the record that lies in a slot."""
    voices, bodies, points, block, width, modes, paths, taps = sizes
    a = 1 + voices
    b = a + voices * block
    c = b + voices * width
    d = c + 2 * points * modes
    e = d + 2 * modes
    f = e + 6 * paths
    last = voices * _COLUMNS + bodies
    return Record(
        integers[: voices * _COLUMNS].reshape((voices, _COLUMNS)),
        integers[voices * _COLUMNS : last],
        reals[:1],
        reals[1:a],
        reals[a:b].reshape((voices, block)),
        reals[b:c].reshape((voices, width)),
        reals[c:d].reshape((2, points, modes)),
        reals[d:e].reshape((2, modes)),
        integers[last : last + _STRETCH],
        reals[e:f].reshape((2, paths, 3)),
        reals[f : f + paths * taps].reshape((paths, taps)),
    )


parted_compiled = jitted_within(_parted)  # for compiled code


@jitted_within
def apply(memory: Memory, record: Record) -> None:
    """Take over all that is new in a record."""
    for body in range(memory.bodies.shape[0]):
        if record.bodies[body] & NEW_POLES:
            _take_poles(memory, record, body)
        if record.bodies[body] & NEW_OUTPUTS:
            _take_outputs(memory, record, body)
    for voice in range(record.voices.shape[0]):
        _take_push(memory, record, voice)


@jitted_within
def hold(memory: Memory, record: Record) -> None:
    """Move each force to its steady load within the block, as no new record has come."""
    block = memory.forces.shape[1]
    for voice in range(record.voices.shape[0]):
        if memory.voices[voice, Voice.ACTIVE]:
            memory.voices[voice, Voice.ACTIVE] = 1
            load = record.loads[voice]
            last = memory.forces[voice, block - 1]
            for k in range(block):
                share = 0.5 + 0.5 * np.cos(np.pi * (k + 1) / block)
                memory.forces[voice, k] = load + share * (last - load)


@jitted_within
def _take_poles(memory: Memory, record: Record, body: int) -> None:
    settle(memory, body)
    wake(memory, body)
    modes = memory.modes
    for n in range(memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]):
        modes[Mode.LOG_RE, n], modes[Mode.LOG_IM, n] = record.poles[0, n], record.poles[1, n]
        if record.poles[1, n] == 0.0:
            modes[Mode.STATE_RE, n] = modes[Mode.STATE_IM, n] = 0.0
    refresh(memory, body)
    memory.bodies[body, BodyColumn.MOVED] = 1
    for voice in range(record.voices.shape[0]):
        if memory.voices[voice, Voice.BODY] == body:
            memory.voices[voice, Voice.MOVED] = 1


@jitted_within
def _take_outputs(memory: Memory, record: Record, body: int) -> None:
    first, last = memory.bodies[body, BodyColumn.FIRST], memory.bodies[body, BodyColumn.LAST]
    for point in range(record.outputs.shape[1]):
        for n in range(first, last):
            real, imag = record.outputs[0, point, n], record.outputs[1, point, n]
            memory.outputs[Output.TARGET_RE, point, n] = real
            memory.outputs[Output.TARGET_IM, point, n] = imag
            if record.bodies[body] & FIRST_OUTPUTS:
                memory.outputs[Output.RE, point, n] = real
                memory.outputs[Output.IM, point, n] = imag
    if record.bodies[body] & FIRST_OUTPUTS:
        stand(memory, body)
    memory.bodies[body, BodyColumn.MOVED] = 1


@jitted_within
def _take_push(memory: Memory, record: Record, voice: int) -> None:
    state = record.voices[voice, STATE]
    memory.voices[voice, Voice.ACTIVE] = state
    if state == SILENT:
        return
    for k in range(memory.forces.shape[1]):
        memory.forces[voice, k] = record.forces[voice, k]
    if record.voices[voice, MOVED]:
        for n in range(memory.drives.shape[2]):
            memory.drives[Drive.TARGET, voice, n] = record.drives[voice, n]
        memory.voices[voice, Voice.MOVED] = 1
    if state == BEGIN:
        memory.voices[voice, Voice.BODY] = record.voices[voice, OF_BODY]
        for n in range(memory.drives.shape[2]):
            memory.drives[Drive.NOW, voice, n] = record.drives[voice, n]


# Places in the head of the memory. What different threads write is 128 bytes apart: the pair of
# cache lines that a processor fetches together.
CAPACITY, INTEGERS, REALS, WRITTEN, READ = 0, 1, 2, 16, 32
_HEAD = 48


@njit(cache=True, nogil=True, error_model="numpy")
def waiting(memory: Index) -> int:
    """Return how many records are written and not yet released."""
    return load(memory, WRITTEN) - load(memory, READ)


@njit(cache=True, nogil=True, error_model="numpy")
def integers_of(memory: Index, count: int) -> Index:
    """Return the integers (I,) in the slot of the record of this number, counted from 0."""
    size = memory[INTEGERS]
    first = _HEAD + count % memory[CAPACITY] * size
    return memory[first : first + size]


@njit(cache=True, nogil=True, error_model="numpy")
def reals_of(memory: Index, count: int) -> Array:
    """Return the reals (R,) in the slot of the record of this number, counted from 0."""
    size = memory[REALS]
    first = _HEAD + memory[CAPACITY] * memory[INTEGERS] + count % memory[CAPACITY] * size
    return memory[first : first + size].view(np.float64)


@njit(cache=True, nogil=True, error_model="numpy")
def release(memory: Index) -> None:
    """Give the slot of the oldest record back to the writer."""
    store(memory, READ, memory[READ] + 1)


@njit(cache=True, nogil=True, error_model="numpy")
def publish(memory: Index) -> None:
    """Hand the slot that was just written to the reader."""
    store(memory, WRITTEN, memory[WRITTEN] + 1)


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

    @property
    def waiting(self) -> int:
        """Records written and not yet released."""
        return waiting(self.memory)

    def reserve(self) -> tuple[Index, Array] | None:
        """Return the next slot, (I,) and (R,), to write before `publish`; None where full."""
        if self.waiting == self._capacity:
            return None
        number = int(self.memory[WRITTEN])
        return integers_of(self.memory, number), reals_of(self.memory, number)

    def publish(self) -> None:
        """Hand over the slot that `reserve` returned."""
        publish(self.memory)

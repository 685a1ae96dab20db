"""Where everything lives that changes while sound plays: two pieces of memory, laid out once.

Real numbers lie in one array and whole numbers in another, so that a function without Python,
such as the callback of an audio device, needs two addresses and nothing else.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numba import njit, types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic as _intrinsic
from numba.extending import overload
from numba.np.numpy_support import carray
from numpy.typing import NDArray

from struck.model.arrays import AnyArray, Array, Index
from struck.synth.sample_loop import OUTPUTS, jitted

Typed = tuple[Any, Callable[..., Any]]  # signature of an intrinsic, and what generates its code
# Called, an intrinsic takes no context: not what its definition says.
intrinsic: Any = _intrinsic


@intrinsic
def pointer_to(_context: object, address: types.Type) -> Typed:
    """Return an address held as an integer as an untyped pointer."""
    if not isinstance(address, types.Integer):
        raise TypingError(f"an address is an integer, not {address}")

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
        return builder.inttoptr(arguments[0], context.get_value_type(signature.return_type))

    return types.voidptr(address), generate


@njit(nogil=True, error_model="numpy")
def integers_at(address: int, count: int) -> NDArray[np.int64]:
    """Return the int64 array (count,) that begins at an address; it must outlive its use."""
    return carray(pointer_to(address), (count,), np.int64)


@njit(nogil=True, error_model="numpy")
def reals_at(address: int, count: int) -> NDArray[np.float64]:
    """Return the float64 array (count,) that begins at an address; it must outlive its use."""
    return carray(pointer_to(address), (count,), np.float64)


@njit(nogil=True, error_model="numpy")
def singles_at(address: int, count: int) -> NDArray[np.float32]:
    """Return the float32 array (count,) that begins at an address; it must outlive its use."""
    return carray(pointer_to(address), (count,), np.float32)


def part(array: AnyArray, first: int, shape: tuple[int, ...]) -> AnyArray:
    """Return the numbers of a contiguous array from the first on, in a shape."""
    return array[first : first + math.prod(shape)].reshape(shape)


@overload(part)
def _part(array: AnyArray, first: int, shape: tuple[int, ...]) -> Callable[..., AnyArray]:  # noqa: ARG001 - numba asks by types
    def compiled(array: AnyArray, first: int, shape: tuple[int, ...]) -> AnyArray:
        address = array.ctypes.data + array.itemsize * first
        return carray(pointer_to(address), shape, array.dtype)

    return compiled


def address_of(function: Any, arguments: tuple[types.Type, ...]) -> int:  # noqa: ANN401 - numba has no types
    """Return the address of a compiled function, which must outlive its use."""
    made = _made(function, arguments)
    return made.library.get_pointer_to_function(made.fndesc.llvm_func_name)


def result_of(function: Any, arguments: tuple[types.Type, ...]) -> types.Type:  # noqa: ANN401 - numba has no types
    """Return the type that a compiled function returns for these argument types."""
    return _made(function, arguments).signature.return_type


def _made(function: Any, arguments: tuple[types.Type, ...]) -> Any:  # noqa: ANN401 - numba has no types
    function.compile(arguments)
    return function.overloads[arguments]


def _calling(result: types.Type) -> Any:  # noqa: ANN401 - numba has no types
    @intrinsic
    def call(_context: object, address: types.Type, arguments: types.BaseTuple) -> Typed:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:  # noqa: ANN401 - numba has no types
            kinds = signature.args[1].types
            pointed = context.call_conv.get_function_type(result, kinds).as_pointer()
            pointer = builder.inttoptr(values[0], pointed)
            parts = cgutils.unpack_tuple(builder, values[1])
            _, value = context.call_conv.call_function(builder, pointer, result, kinds, parts)
            return context.get_dummy_value() if result == types.none else value

        return result(address, arguments), generate

    return call


call = _calling(types.none)  # call(address, arguments) of a compiled function that returns nothing
call_for_integer = _calling(types.int64)  # the same of one that returns an int64

_LINE = 8  # real numbers in a cache line


class Mode(IntEnum):
    """Rows of `Memory.modes`: of each mode its pole, what follows from it, and its state."""

    LOG_RE = 0  # logarithm of z, the factor of a sample
    LOG_IM = 1
    TURN_RE = 2  # z
    TURN_IM = 3
    LEAP_RE = 4  # factor of a block
    LEAP_IM = 5
    FEEDBACK = 6  # 2 Re z
    LOSS = 7  # -|z|^2
    INPUT = 8  # Im z / rate
    INVERSE = 9  # 1 / Im z
    HOLD_RE = 10  # steady state under a constant unit force
    HOLD_IM = 11
    STATE_RE = 12  # c
    STATE_IM = 13
    LATEST = 14  # the state as a pair, in units of UNIT while one push alone is steady
    PREVIOUS = 15
    LOUDNESS = 16  # the largest output gain
    UNIT = 17


class Output(IntEnum):
    """Layers of `Memory.outputs`: gains now and at the end of the block, and what they make."""

    RE = 0
    IM = 1
    TARGET_RE = 2
    TARGET_IM = 3
    WEIGHT = 4
    TURNED = 5
    WEIGHT_SLOPE = 6
    TURNED_SLOPE = 7
    STILL = 8
    UNIT_WEIGHT = 9  # for states in units of UNIT
    UNIT_TURNED = 10


class Drive(IntEnum):
    """Layers of `Memory.drives`: as for outputs."""

    NOW = 0
    TARGET = 1
    GAIN = 2
    SLOPE = 3


class BodyColumn(IntEnum):
    """Columns of `Memory.bodies`."""

    FIRST = 0  # range of its modes
    LAST = 1
    ASLEEP = 2
    SLEPT = 3  # samples
    MOVED = 4  # whether its outputs move in this block
    VOICE = 5  # the first of its voices in this block, or -1
    HELD_AS = 6


class HeldAs(IntEnum):
    """Where the state of a body's modes is."""

    STATE = 0  # c
    PAIRS = 1  # LATEST and PREVIOUS
    UNIT_PAIRS = 2  # the same in units of UNIT


class Voice(IntEnum):
    """Columns of `Memory.voices`."""

    BODY = 0
    ACTIVE = 1  # 0 silent, 1 pushes, 2 begins
    MOVED = 2  # whether its drive moves in this block
    NEXT = 3  # the body's next voice


class Run(IntEnum):
    """Entries of `Memory.run`."""

    ADDRESS = 0  # of the machine code that `blocks.run` calls
    OUTPUTS = 1  # taken at once
    PUSHES = 2  # taken at once
    SAMPLES = 3  # a block is to be a multiple of for one steady push


class Level(IntEnum):
    """Entries at the front of `Memory.levels`."""

    RATE = 0  # Hz
    QUIET = 1  # share of its loudest at which a body falls asleep


class Memory(NamedTuple):
    """The arrays of a scene's memory."""

    modes: Array  # (Mode, N)
    outputs: Array  # (Output, rows, N)
    drives: Array  # (Drive, voices + 1, modes of the largest body); the last voice is silent
    forces: Array  # (voices + 1, block)
    feeds: Array  # (2, voices + 1, rows): direct gains of forces, now and at the block's end
    sounds: Array  # (bodies, rows, block)
    levels: Array  # (Level, then the loudest so far of each body)
    bodies: Index  # (bodies, BodyColumn)
    voices: Index  # (voices + 1, Voice)
    run: Index  # (Run,)


# Numbers at the front of the whole ones.
_BODIES, _MODES, _ROWS, _VOICES, _WIDTH, _BLOCK, _HEADER = range(7)
_PER_MODE, _PER_OUTPUT, _PER_DRIVE = len(Mode), len(Output), len(Drive)
_PER_BODY, _PER_VOICE, _RUN, LEVELS = len(BodyColumn), len(Voice), len(Run), len(Level)


def rows_for(points: int) -> int:
    """Return how many output rows kernels need for this number of outputs."""
    most = OUTPUTS[-1]
    return next((n for n in OUTPUTS if n >= points), -(-points // most) * most)


def laid_out(
    counts: tuple[int, ...], *, points: int, voices: int, block: int
) -> tuple[Array, Index]:
    """Return real and whole numbers for bodies of these numbers of modes, zero but for sizes."""
    padded = [_lines(count) for count in counts]
    sizes = (
        len(counts),
        _row(sum(padded)),
        rows_for(points),
        voices + 1,
        _row(max(padded, default=0)),
        block,
    )
    bodies, modes, rows, slots, width, _ = sizes
    wholes = np.zeros(_HEADER + bodies * _PER_BODY + slots * _PER_VOICE + _RUN, np.int64)
    wholes[:_HEADER] = sizes
    table = wholes[_HEADER : _HEADER + bodies * _PER_BODY].reshape(bodies, _PER_BODY)
    ends = np.cumsum(padded)
    table[:, BodyColumn.FIRST], table[:, BodyColumn.LAST] = ends - padded, ends
    reals = (
        (_PER_MODE + _PER_OUTPUT * rows) * modes
        + _PER_DRIVE * slots * width
        + _lines(slots * block)
        + _lines(2 * slots * rows)
        + _lines(bodies * rows * block)
        + LEVELS
        + bodies
    )
    return aligned(reals, np.float64), wholes


def seen(reals: Array, wholes: Index) -> Memory:
    """Return the arrays that lie in a scene's real and whole numbers."""
    bodies, modes, rows = wholes[_BODIES], wholes[_MODES], wholes[_ROWS]
    slots, width, block = wholes[_VOICES], wholes[_WIDTH], wholes[_BLOCK]
    a = _PER_MODE * modes
    b = a + _PER_OUTPUT * rows * modes
    c = b + _PER_DRIVE * slots * width
    d = c + _lines(slots * block)
    e = d + _lines(2 * slots * rows)
    f = e + _lines(bodies * rows * block)
    table = _HEADER + bodies * _PER_BODY
    return Memory(
        part(reals, 0, (_PER_MODE, modes)),
        part(reals, a, (_PER_OUTPUT, rows, modes)),
        part(reals, b, (_PER_DRIVE, slots, width)),
        part(reals, c, (slots, block)),
        part(reals, d, (2, slots, rows)),
        part(reals, e, (bodies, rows, block)),
        part(reals, f, (LEVELS + bodies,)),
        part(wholes, _HEADER, (bodies, _PER_BODY)),
        part(wholes, table, (slots, _PER_VOICE)),
        part(wholes, table + slots * _PER_VOICE, (_RUN,)),
    )


def _row(count: int) -> int:
    """Return the length of rows of which no two begin at the same place of the first cache."""
    lines = _lines(count) // _LINE
    return _LINE * (lines + (3 - lines) % 8)


def _lines(count: int) -> int:
    return -(-count // _LINE) * _LINE


def aligned(count: int, kind: type) -> AnyArray:
    """Return zeros (count,) that begin on a cache line of 64 bytes."""
    raw = np.zeros(count + 16, kind)
    start = -raw.ctypes.data % 64 // raw.itemsize
    return raw[start : start + count]


_lines = jitted(_lines)
view = jitted(seen)  # for compiled code
NUMBERS = (types.float64[::1], types.int64[::1])  # types of the real and the whole numbers

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

# Memory and functions at an address, for compiled code.

Typed = tuple[Any, Callable[..., Any]]
"""The signature of an intrinsic, and what generates its code."""
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
    """Return so many numbers from the first on, in a shape, of a contiguous array (N,).

    Compiled, it costs nothing and keeps nothing alive.
    """
    return array[first : first + math.prod(shape)].reshape(shape)


@overload(part)
def _part(array: AnyArray, first: int, shape: tuple[int, ...]) -> Callable[..., AnyArray]:  # noqa: ARG001 - numba asks by types
    def compiled(array: AnyArray, first: int, shape: tuple[int, ...]) -> AnyArray:
        address = array.ctypes.data + array.itemsize * first
        return carray(pointer_to(address), shape, array.dtype)

    return compiled


def address_of(function: Any, arguments: tuple[types.Type, ...]) -> int:  # noqa: ANN401 - numba has no types
    """Return where the machine code of a compiled function begins, for arguments of these types.

    What is called by its address is not compiled anew with all that calls it; it must outlive them.
    """
    made = _made(function, arguments)
    return made.library.get_pointer_to_function(made.fndesc.llvm_func_name)


def result_of(function: Any, arguments: tuple[types.Type, ...]) -> types.Type:  # noqa: ANN401 - numba has no types
    """Return the type of what a compiled function returns for arguments of these types."""
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


call = _calling(types.none)
"""call(address, arguments): call a compiled function that returns nothing, with a tuple."""
call_for_integer = _calling(types.int64)
"""The same of one that returns an int64."""

_LINE = 8  # numbers in a cache line


class Mode(IntEnum):
    """Rows of `Memory.modes`: of each mode its pole, what follows from it, and its state."""

    LOG_RE = 0
    LOG_IM = 1
    TURN_RE = 2
    TURN_IM = 3
    LEAP_RE = 4
    LEAP_IM = 5
    FEEDBACK = 6
    LOSS = 7
    INPUT = 8
    INVERSE = 9
    HOLD_RE = 10
    HOLD_IM = 11
    STATE_RE = 12
    STATE_IM = 13
    LATEST = 14
    PREVIOUS = 15
    LOUDNESS = 16
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
    UNIT_WEIGHT = 9
    UNIT_TURNED = 10


class Drive(IntEnum):
    """Layers of `Memory.drives`: as for outputs."""

    NOW = 0
    TARGET = 1
    GAIN = 2
    SLOPE = 3


class BodyColumn(IntEnum):
    """Columns of `Memory.bodies`."""

    FIRST = 0
    LAST = 1
    ASLEEP = 2
    SLEPT = 3
    MOVED = 4
    VOICE = 5
    HELD_AS = 6


class HeldAs(IntEnum):
    """Where the state of a body's modes is."""

    STATE = 0
    PAIRS = 1
    UNIT_PAIRS = 2


class Voice(IntEnum):
    """Columns of `Memory.voices`."""

    BODY = 0
    ACTIVE = 1
    MOVED = 2
    NEXT = 3


class Run(IntEnum):
    """Entries of `Memory.run`."""

    ADDRESS = 0
    OUTPUTS = 1
    PUSHES = 2
    SAMPLES = 3


class Level(IntEnum):
    """Entries at the front of `Memory.levels`."""

    RATE = 0
    QUIET = 1


class Memory(NamedTuple):
    """The parts of a scene's memory.

    Parameters
    ----------
    modes : array (fields, N)
        LOG is the logarithm of what a sample turns a mode by, TURN that itself, LEAP a block's;
        FEEDBACK, LOSS and INPUT (Im z / rate) are coefficients, INVERSE is 1 / Im z; HOLD is what
        a constant unit force ends in. LATEST and PREVIOUS are the state as kernels take it, in
        units of UNIT while one push alone is steady.
    outputs : array (layers, rows, N)
        UNIT_WEIGHT and UNIT_TURNED are for states in units of UNIT.
    drives : array (layers, voices + 1, modes of the largest body)
        The last voice is silent.
    forces : array (voices + 1, block)
    feeds : array (2, voices + 1, rows)
        How loudly a force is heard directly, now and at the end of the block.
    sounds : array (bodies, rows, block)
    levels : array (2 + bodies,)
        Sample rate; the share of its loudest at which a body falls asleep; each body's loudest.
    bodies : array (bodies, columns), int64
        The range of its modes, whether it is asleep and for how many samples, whether its outputs
        move in this block, the first of its voices in it (or -1), and as what its state is held:
        as c in STATE, or as pairs in LATEST and PREVIOUS.
    voices : array (voices + 1, columns), int64
        Body, whether it pushes in this block, whether its drive moves, the body's next voice.
    run : array (4,), int64
        Where the machine code begins that `dispatch.run` calls, the outputs and pushes that it
        takes at once, and of how many samples a block is to be a multiple for one steady push.
    """

    modes: Array
    outputs: Array
    drives: Array
    forces: Array
    feeds: Array
    sounds: Array
    levels: Array
    bodies: Index
    voices: Index
    run: Index


# Numbers at the front of the whole ones.
_BODIES, _MODES, _ROWS, _VOICES, _WIDTH, _BLOCK, _HEADER = range(7)
_PER_MODE, _PER_OUTPUT, _PER_DRIVE = len(Mode), len(Output), len(Drive)
_PER_BODY, _PER_VOICE, _RUN, LEVELS = len(BodyColumn), len(Voice), len(Run), len(Level)


def rows_for(points: int) -> int:
    """Return the rows that kernels need for so many outputs."""
    most = OUTPUTS[-1]
    return next((n for n in OUTPUTS if n >= points), -(-points // most) * most)


def laid_out(
    counts: tuple[int, ...], *, points: int, voices: int, block: int
) -> tuple[Array, Index]:
    """Return the memory of bodies of so many modes, all zero but for the tables' ranges.

    Parameters
    ----------
    counts : tuple of int
        Modes of each body; each begins with a cache line of its own.
    points, voices, block : int
        Outputs of a body, pushes at once, samples in a block.
    """
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
    return _aligned(reals), wholes


def seen(reals: Array, wholes: Index) -> Memory:
    """Return the parts of a scene's memory."""
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


def _aligned(count: int) -> Array:
    """Return zeros that begin with a cache line."""
    raw = np.zeros(count + _LINE)
    start = (-raw.ctypes.data // raw.itemsize) % _LINE
    return raw[start : start + count]


_lines = jitted(_lines)
view = jitted(seen)
"""`seen`, for functions without Python."""
NUMBERS = (types.float64[::1], types.int64[::1])
"""Types of the real and the whole numbers."""

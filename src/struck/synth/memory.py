"""Where everything lives that changes while sound plays: two pieces of memory, laid out once.

Real numbers lie in one array and whole numbers in another, so that a function without Python,
such as the callback of an audio device, needs two addresses and nothing else. The core has the
same names and numbers in `memory.h`.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from struck.model.arrays import AnyArray, Array, Index

OUTPUTS = (1, 2, 4, 8)  # outputs that the core makes at a time
_LINE = 8  # real numbers in a cache line


class Mode(IntEnum):
    """Rows of `Memory.modes`: the pole of each mode, values derived from it, and its state."""

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
    """Layers of `Memory.outputs`: gains now and at the end of the block, and their products."""

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
    """The place where the states of a body's modes are kept."""

    STATE = 0  # c
    PAIRS = 1  # LATEST and PREVIOUS
    UNIT_PAIRS = 2  # the same in units of UNIT


class Voice(IntEnum):
    """Columns of `Memory.voices`."""

    BODY = 0
    ACTIVE = 1  # 0 silent, 1 pushes, 2 begins
    MOVED = 2  # whether its drive moves in this block
    NEXT = 3  # the body's next voice


class Level(IntEnum):
    """Entries at the front of `Memory.levels`."""

    RATE = 0  # Hz
    QUIET = 1  # of its loudest level: a softer body falls asleep


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
    turned: Index  # (1,): whether outputs are complex


# Numbers at the front of the whole ones.
_BODIES, _MODES, _ROWS, _VOICES, _WIDTH, _BLOCK, _TURNED, _HEADER = range(8)
_PER_MODE, _PER_OUTPUT, _PER_DRIVE = len(Mode), len(Output), len(Drive)
_PER_BODY, _PER_VOICE, _LEVELS = len(BodyColumn), len(Voice), len(Level)


def rows_for(points: int) -> int:
    """Return how many output rows the core needs for this number of outputs."""
    max_outputs = OUTPUTS[-1]
    return next((n for n in OUTPUTS if n >= points), -(-points // max_outputs) * max_outputs)


def lay_out(
    counts: tuple[int, ...], *, points: int, voices: int, block: int
) -> tuple[Array, Index]:
    """Return real and whole numbers for bodies of `counts` modes: sizes, all others 0."""
    padded_counts = [_lines(count) for count in counts]
    sizes = (
        len(counts),
        _row(sum(padded_counts)),
        rows_for(points),
        voices + 1,
        _row(max(padded_counts, default=0)),
        block,
    )
    bodies, modes, rows, slots, width, _ = sizes
    wholes = np.zeros(_HEADER + bodies * _PER_BODY + slots * _PER_VOICE, np.int64)
    wholes[: len(sizes)] = sizes
    table = wholes[_HEADER : _HEADER + bodies * _PER_BODY].reshape(bodies, _PER_BODY)
    ends = np.cumsum(padded_counts)
    table[:, BodyColumn.FIRST], table[:, BodyColumn.LAST] = ends - padded_counts, ends
    reals = (
        (_PER_MODE + _PER_OUTPUT * rows) * modes
        + _PER_DRIVE * slots * width
        + _lines(slots * block)
        + _lines(2 * slots * rows)
        + _lines(bodies * rows * block)
        + _LEVELS
        + bodies
    )
    return allocate_aligned(reals, np.float64), wholes


def view_memory(reals: Array, wholes: Index) -> Memory:
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
        part(reals, f, (_LEVELS + bodies,)),
        part(wholes, _HEADER, (bodies, _PER_BODY)),
        part(wholes, table, (slots, _PER_VOICE)),
        part(wholes, _TURNED, (1,)),
    )


def part(array: AnyArray, first: int, shape: tuple[int, ...]) -> AnyArray:
    """Return the numbers of a contiguous array from the first on, in a shape."""
    return array[first : first + math.prod(shape)].reshape(shape)


def _row(count: int) -> int:
    """Return the length of rows of which no two begin at the same place of the first cache."""
    lines = _lines(count) // _LINE
    return _LINE * (lines + (3 - lines) % 8)


def _lines(count: int) -> int:
    return -(-count // _LINE) * _LINE


def allocate_aligned(count: int, kind: type) -> AnyArray:
    """Return zeros (count,) that begin on a cache line of 64 bytes."""
    raw = np.zeros(count + 16, kind)
    start = -raw.ctypes.data % 64 // raw.itemsize
    return raw[start : start + count]

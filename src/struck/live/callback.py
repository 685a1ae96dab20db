"""What the audio device calls for each block: compiled, without Python, lock or allocation.

It takes the next record of host commands from the ring, lets `process` compute the block, limits
it and hands it over. Everything it touches hangs on one table of addresses, its `userData`. When
no record has come in time it goes on with the last one, which stays in its slot until there is a
newer one, and counts that as late.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numba import types
from numba.np.numpy_support import carray
from numpy.typing import NDArray

from struck.live import limiter, ring
from struck.live.atomics import load
from struck.live.compiling import callback, jitted_within
from struck.live.device import COMPLETE, CONTINUE, OUTPUT_UNDERFLOW
from struck.synth.addresses import address_of, call, integers_at, reals_at

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Process = Callable[[Array, Integers, Array, bool, Array], None]

# What is counted. `OPEN` is set from outside: 1, as at first, fades in; 0 fades out and then ends
# the stream.
CALLS, UNDERFLOWS, LATE, HOLDING, OPEN = 0, 1, 2, 3, 4
_COUNTERS = 8

# Places in the table: address and length of each array, the shape of a block, and what makes it.
_RING, _LIMITER, _ARENA, _MIX, _COUNTED, _CHANNELS, _BLOCK, _PROCESS = 0, 2, 4, 6, 8, 10, 11, 12
_TABLE = 13

_LONG = types.uint64 if ctypes.sizeof(ctypes.c_ulong) == 8 else types.uint32
SIGNATURE = types.int32(
    types.voidptr, types.voidptr, _LONG, types.voidptr, _LONG, types.voidptr
)  # PaStreamCallback: input, output, frames, times, flags, userData
_REALS, _INTEGERS = types.float64[::1], types.int64[::1]
_ARGUMENTS = (_REALS, _INTEGERS, _REALS, types.boolean, types.float64[:, ::1])  # of `Process`


class Shared:
    """All that a callback reaches; it must live until the stream is closed.

    Parameters
    ----------
    records : Ring
        Host commands, one record a block.
    limited : array
        State of a limiter (`limiter.limiter`).
    arena : array
        State of what makes the samples.
    process : compiled function (arena, integers, reals, fresh, outputs)
        Called once a block, from the first record on. It writes all `outputs` (channels, block)
        under the record's `integers` and `reals`, which it must not keep; `fresh` is False where
        the record is that of the block before.
    channels, block : int
        Shape of a block.

    Attributes
    ----------
    counters : array (8,), int64
        `CALLS`, `UNDERFLOWS` that the device reported, `LATE` records; `OPEN`, 1 until set to 0.
    """

    def __init__(
        self,
        *,
        records: ring.Ring,
        limited: Array,
        arena: Array,
        process: Process,
        channels: int,
        block: int,
    ) -> None:
        self.counters: Integers = np.zeros(_COUNTERS, dtype=np.int64)
        self.counters[OPEN] = 1
        mix = np.zeros(channels * block)
        self._arrays = (records.memory, limited, arena, mix, self.counters)
        self._process = process
        places = [place for array in self._arrays for place in (array.ctypes.data, array.size)]
        made = address_of(process, _ARGUMENTS)
        self._table = np.array([*places, channels, block, made], dtype=np.int64)

    @property
    def address(self) -> int:
        """What the callback is given as `userData`."""
        return self._table.ctypes.data


@cache
def compiled() -> Any:  # noqa: ANN401 - numba's class has no type
    """Return the callback; its `address` is for `PortAudio.open`."""

    @callback(SIGNATURE)
    def play(_input, output, _frames, _times, flags, data):  # noqa: ANN001, ANN202, PLR0917, RUF100 - SIGNATURE types it
        table = carray(data, (_TABLE,), np.int64)
        counters = integers_at(table[_COUNTED], table[_COUNTED + 1])
        records = integers_at(table[_RING], table[_RING + 1])
        limited = reals_at(table[_LIMITER], table[_LIMITER + 1])
        block = (table[_CHANNELS], table[_BLOCK])
        outputs = reals_at(table[_MIX], table[_MIX + 1]).reshape(block)
        count(counters, flags)
        fresh = take(records, counters)
        if counters[HOLDING] == 0:
            outputs[:] = 0.0
        else:
            current = records[ring.READ]
            integers = ring.integers_of(records, current)
            reals = ring.reals_of(records, current)
            arena = reals_at(table[_ARENA], table[_ARENA + 1])
            call(table[_PROCESS], (arena, integers, reals, fresh, outputs))
        opened = load(counters, OPEN) != 0
        limiter.limit(limited, outputs, opened)
        interleave(outputs, carray(output, (block[1], block[0]), np.float32))
        return CONTINUE if opened or not limiter.is_closed(limited) else COMPLETE

    return play


@jitted_within
def count(counters: Integers, flags: int) -> None:
    """Count a call, and an underflow where the device reports one."""
    counters[CALLS] += 1
    if flags & OUTPUT_UNDERFLOW:
        counters[UNDERFLOWS] += 1


@jitted_within
def take(records: Integers, counters: Integers) -> bool:
    """Hold the next record, and return whether there was one; where not, it is late."""
    fresh = ring.waiting(records) > counters[HOLDING]
    if fresh and counters[HOLDING]:
        ring.release(records)
    if fresh:
        counters[HOLDING] = 1
    elif counters[HOLDING]:
        counters[LATE] += 1
    return fresh


@jitted_within
def interleave(outputs: Array, frames: NDArray[np.float32]) -> None:
    """Write channels (channels, block) as frames (block, channels)."""
    for channel in range(outputs.shape[0]):
        for frame in range(outputs.shape[1]):
            frames[frame, channel] = outputs[channel, frame]

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
from struck.live.device import COMPLETE, CONTINUE, OUTPUT_UNDERFLOW
from struck.live.ears import LiveEars, listen, seen, take
from struck.live.ring import (
    SINCE,
    apply,
    callback,
    hold,
    jitted,
    jitted_within,
    load,
    parted_compiled,
)
from struck.model.arrays import Array, Index, Single
from struck.synth.blocks import make_block
from struck.synth.memory import NUMBERS, address_of, call, integers_at, reals_at, singles_at, view
from struck.synth.resonators import Stepped

# Places in the arena: addresses and lengths of the modes' memory as int64, outputs in use, address
# of `make_block`; volume at the end of the last block and the loudest sample so far, before the
# limiter; addresses and lengths of the memory of ears, and their paths and taps: 0 without them.
_STORE_REALS, _STORE_WHOLES, _POINTS, _MAKE_BLOCK = 0, 2, 4, 5
VOLUME, PEAK = 6, 7
_SINGLES, _WAYS, _SIZES, _PATHS, _TAPS = 8, 10, 12, 14, 15
_ARENA_SIZE = 16


def arena(bank: Stepped, *, volume: float, ears: LiveEars | None = None) -> Array:
    """Return the array by which the callback finds modes and ears; both must outlive it."""
    places = np.zeros(_ARENA_SIZE)
    whole = places.view(np.int64)
    reals, wholes = bank.numbers
    whole[_STORE_REALS : _STORE_REALS + 2] = reals.ctypes.data, reals.size
    whole[_STORE_WHOLES : _STORE_WHOLES + 2] = wholes.ctypes.data, wholes.size
    whole[_POINTS] = 1
    whole[_MAKE_BLOCK] = address_of(make_block, NUMBERS)
    bank.compile(turned=True)
    places[VOLUME] = volume
    if ears is not None:
        for place, numbers in zip((_SINGLES, _WAYS, _SIZES), ears.memory, strict=True):
            whole[place : place + 2] = numbers.ctypes.data, numbers.size
        whole[_PATHS], whole[_TAPS] = ears.paths, ears.taps
    return places


@jitted
def sound(arena: Array, integers: Index, reals: Array, fresh: bool, outputs: Array) -> None:  # noqa: FBT001 - compiled: positional
    """Compute one block of outputs (channels, block); not `fresh`: the last block's record."""
    whole = arena.view(np.int64)
    store_reals = reals_at(whole[_STORE_REALS], whole[_STORE_REALS + 1])
    store_wholes = integers_at(whole[_STORE_WHOLES], whole[_STORE_WHOLES + 1])
    memory = view(store_reals, store_wholes)
    sizes = (
        memory.voices.shape[0] - 1,
        memory.bodies.shape[0],
        whole[_POINTS],
        memory.forces.shape[1],
        memory.drives.shape[2],
        memory.modes.shape[1],
        whole[_PATHS],
        whole[_TAPS],
    )
    record = parted_compiled(integers, reals, sizes)
    if fresh:
        apply(memory, record)
    else:
        hold(memory, record)
    call(whole[_MAKE_BLOCK], (store_reals, store_wholes))
    if whole[_PATHS]:
        ears = seen(
            singles_at(whole[_SINGLES], whole[_SINGLES + 1]),
            reals_at(whole[_WAYS], whole[_WAYS + 1]),
            integers_at(whole[_SIZES], whole[_SIZES + 1]),
        )
        if fresh:
            take(ears, record)
        listen(ears, memory.sounds, record.stretch[SINCE], not fresh)
        hand_over(ears.heard, outputs)
    else:
        mix(memory.sounds, whole[_POINTS], outputs)
    level(arena, record.volume[0], outputs)


@jitted_within
def mix(sounds: Array, points: int, outputs: Array) -> None:
    """Add up all bodies (bodies, rows, block) in the channels, points in turn."""
    outputs[:] = 0.0
    for channel in range(outputs.shape[0]):
        for body in range(sounds.shape[0]):
            for k in range(outputs.shape[1]):
                outputs[channel, k] += sounds[body, channel % points, k]


@jitted_within
def hand_over(heard: Single, outputs: Array) -> None:
    """Give each channel an ear in turn; a single channel gets the mean of all."""
    ears, alone = heard.shape[0], outputs.shape[0] == 1
    outputs[:] = 0.0
    for channel in range(outputs.shape[0]):
        for ear in range(ears):
            if alone or ear == channel % ears:
                for k in range(outputs.shape[1]):
                    outputs[channel, k] += heard[ear, k] / (ears if alone else 1)


@jitted_within
def level(arena: Array, volume: float, outputs: Array) -> None:
    """Go from the volume of the last block to this one's, and note the loudest sample."""
    block = outputs.shape[1]
    step = (volume - arena[VOLUME]) / block
    for channel in range(outputs.shape[0]):
        for k in range(block):
            outputs[channel, k] *= arena[VOLUME] + step * (k + 1)
            arena[PEAK] = max(arena[PEAK], abs(outputs[channel, k]))
    arena[VOLUME] = volume


Process = Callable[[Array, Index, Array, bool, Array], None]  # arena, record (2), fresh, outputs

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
    """All that a callback reaches, by a table of addresses; it must outlive the stream."""

    def __init__(
        self,
        *,
        records: ring.Ring,  # commands of the host, one record a block
        limited: Array,  # state of `limiter.limiter`
        arena: Array,  # state of what makes the samples
        process: Process,  # compiled; writes all outputs (channels, block), keeps no record
        channels: int,
        block: int,
    ) -> None:
        self.counters: Index = np.zeros(_COUNTERS, dtype=np.int64)
        self.counters[OPEN] = 1
        mix = np.zeros(channels * block)
        self._arrays = (records.memory, limited, arena, mix, self.counters)
        self._process = process
        places = [place for array in self._arrays for place in (array.ctypes.data, array.size)]
        made = address_of(process, _ARGUMENTS)
        self._table = np.array([*places, channels, block, made], dtype=np.int64)

    @property
    def address(self) -> int:
        """Address of the table, the callback's `userData`."""
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
        fresh = take_block(records, counters)
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
def count(counters: Index, flags: int) -> None:
    """Count a call, and an underflow where the device reports one."""
    counters[CALLS] += 1
    if flags & OUTPUT_UNDERFLOW:
        counters[UNDERFLOWS] += 1


@jitted_within
def take_block(records: Index, counters: Index) -> bool:
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

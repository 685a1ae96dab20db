"""The audio device's callback for each block, in the core: without Python, lock or wait.

It takes the next record of host commands from the ring, lets a function of the core compute the
block, limits it and hands it over. Everything it touches hangs on one structure, its `userData`;
`callback.h` in the core has the same fields. Without a record in time, it uses the last one
again, which stays in its slot until there is a newer one, and counts that block as late.
"""

from __future__ import annotations

import ctypes

import numpy as np

from struck.core import address
from struck.live import ring
from struck.live.ears import EarsMemory, LiveEars
from struck.model.arrays import Array, Index
from struck.synth.resonators import Stepped

# What is counted. `OPEN` is set from outside: 1, as at first, fades in; 0 fades out and then ends
# the stream.
CALLS, UNDERFLOWS, LATE, HOLDING, OPEN = 0, 1, 2, 3, 4
_COUNTER_COUNT = 8


class Arena(ctypes.Structure):
    """Where the callback finds the bodies' memory and the ears; both must outlive it."""

    volume: float
    peak: float
    last: Array  # sample of the sounds added to each body's modes
    _fields_ = (
        ("reals", ctypes.c_void_p),
        ("wholes", ctypes.c_void_p),
        ("points", ctypes.c_int64),
        ("volume", ctypes.c_double),  # at the end of the last block
        ("peak", ctypes.c_double),  # the loudest sample so far, before the limiter
        ("beside", ctypes.c_void_p),
        ("ears", ctypes.POINTER(EarsMemory)),
    )


def arena(bank: Stepped, *, volume: float, ears: LiveEars | None = None) -> Arena:
    """Return the addresses of modes and ears for the callback; ears hear bodies at their points."""
    bank.memory.turned[0] = 1
    reals, wholes = (numbers.ctypes.data for numbers in bank.numbers)
    ears_pointer = ctypes.pointer(ears.memory) if ears else None
    points = ears.points if ears else 1
    last = np.zeros((len(bank.memory.bodies), points))
    places = {"reals": reals, "wholes": wholes, "beside": last.ctypes.data}
    structure = Arena(**places, points=points, volume=volume, ears=ears_pointer)
    structure.last = last  # kept, as the callback has but its address
    return structure


class _Places(ctypes.Structure):
    _fields_ = (
        *((name, ctypes.c_void_p) for name in ("records", "limited")),
        ("limited_size", ctypes.c_int64),
        *((name, ctypes.c_void_p) for name in ("arena", "mix", "counters")),
        ("channels", ctypes.c_int64),
        ("block", ctypes.c_int64),
        ("process", ctypes.c_void_p),
    )


class Shared:
    """All that a callback reaches; it must outlive the stream."""

    def __init__(
        self,
        *,
        records: ring.Ring,  # commands of the host, one record a block
        limited: Array,  # state of `limiter.limiter`
        arena: ctypes.Structure | Array,  # state of the function that makes the samples
        channels: int,
        block: int,
        process: int | None = None,  # address of the function of a block; default: that of the core
    ) -> None:
        self.counters: Index = np.zeros(_COUNTER_COUNT, dtype=np.int64)
        self.counters[OPEN] = 1
        mix = np.zeros(channels * block)
        self._references = records.memory, limited, arena, mix
        self._places = _Places(
            records=records.memory.ctypes.data,
            limited=limited.ctypes.data,
            limited_size=limited.size,
            arena=arena.ctypes.data if isinstance(arena, np.ndarray) else ctypes.addressof(arena),
            mix=mix.ctypes.data,
            counters=self.counters.ctypes.data,
            channels=channels,
            block=block,
            process=process or address("callback_sound"),
        )

    @property
    def address(self) -> int:
        """Address of the structure, the callback's `userData`."""
        return ctypes.addressof(self._places)


def play() -> int:
    """Return the address of the callback, for `PortAudio.open`."""
    return address("callback_play")

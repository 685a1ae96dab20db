"""What the callback does for each block: take a record, let the modes ring, mix."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.live.compiling import jitted, jitted_within
from struck.live.ears import LiveEars, listen, seen, take
from struck.live.ring import SINCE, apply, hold, parted_compiled
from struck.synth.addresses import address_of, call, integers_at, reals_at, singles_at
from struck.synth.memory import NUMBERS, view
from struck.synth.process import make_block
from struck.synth.stepped import Stepped

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Single = NDArray[np.float32]

# Places in the arena: addresses and lengths of the store as int64, outputs that are in use; volume
# at the end of the last block and the loudest sample so far, before the limiter; addresses and
# lengths of the memory of ears, and how many paths and taps they have: 0 without them.
_REALS, _WHOLES, _POINTS, _PROCESS = 0, 2, 4, 5
VOLUME, PEAK = 6, 7
_SINGLES, _WAYS, _SIZES, _PATHS, _TAPS = 8, 10, 12, 14, 15
_ARENA = 16


def arena(bank: Stepped, *, volume: float, ears: LiveEars | None = None) -> Array:
    """Return what the callback is given to find the modes and ears, which must outlive it."""
    places = np.zeros(_ARENA)
    whole = places.view(np.int64)
    reals, wholes = bank.numbers
    whole[_REALS : _REALS + 2] = reals.ctypes.data, reals.size
    whole[_WHOLES : _WHOLES + 2] = wholes.ctypes.data, wholes.size
    whole[_POINTS] = 1
    whole[_PROCESS] = address_of(make_block, NUMBERS)
    bank.compile(turned=True)
    places[VOLUME] = volume
    if ears is not None:
        for place, numbers in zip((_SINGLES, _WAYS, _SIZES), ears.memory, strict=True):
            whole[place : place + 2] = numbers.ctypes.data, numbers.size
        whole[_PATHS], whole[_TAPS] = ears.paths, ears.taps
    return places


@jitted
def sound(arena: Array, integers: Integers, reals: Array, fresh: bool, outputs: Array) -> None:  # noqa: FBT001 - compiled: positional
    """Make a block; see `callback.compiled`."""
    whole = arena.view(np.int64)
    store_reals = reals_at(whole[_REALS], whole[_REALS + 1])
    store_wholes = integers_at(whole[_WHOLES], whole[_WHOLES + 1])
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
    call(whole[_PROCESS], (store_reals, store_wholes))
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

"""What the callback does for each block: take a record, let the modes ring, mix."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit, typeof, types
from numba.extending import intrinsic
from numpy.typing import NDArray

from struck.live.record import apply, hold, parted_compiled
from struck.synth.addresses import integers_at, reals_at
from struck.synth.compiling import jitted
from struck.synth.process import process
from struck.synth.stepped import Stepped
from struck.synth.store import rows_for, view

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

# Places in the arena: addresses and lengths of the store as int64, outputs that are in use; volume
# at the end of the last block and the loudest sample so far, before the limiter.
_REALS, _WHOLES, _POINTS, _PROCESS = 0, 2, 4, 5
VOLUME, PEAK = 6, 7
_ARENA = 8


def arena(bank: Stepped, *, volume: float) -> Array:
    """Return what the callback is given to find the modes, which must outlive it."""
    places = np.zeros(_ARENA)
    whole = places.view(np.int64)
    reals, wholes = bank.numbers
    whole[_REALS : _REALS + 2] = reals.ctypes.data, reals.size
    whole[_WHOLES : _WHOLES + 2] = wholes.ctypes.data, wholes.size
    whole[_POINTS] = 1
    whole[_PROCESS] = _address(bank)
    places[VOLUME] = volume
    return places


def _address(bank: Stepped) -> int:
    """Return where the machine code that makes a block of these modes begins.

    Were it called by name, all kernels would be compiled anew with whatever calls it.
    """
    run: Any = process(rows_for(1), turned=True)  # for as long as Python runs
    run.compile(tuple(typeof(numbers) for numbers in bank.numbers))
    made = next(iter(run.overloads.values()))
    return made.library.get_pointer_to_function(made.fndesc.llvm_func_name)


@intrinsic
def _call(_typing, address, reals, wholes):  # noqa: ANN001, ANN202 - numba's own types
    """Call a compiled function of two arrays by its address."""

    def generate(context, builder, signature, arguments):  # noqa: ANN001, ANN202 - compiled
        kind = context.call_conv.get_function_type(types.none, signature.args[1:])
        pointer = builder.inttoptr(arguments[0], kind.as_pointer())
        context.call_conv.call_function(
            builder, pointer, types.none, signature.args[1:], arguments[1:]
        )
        return context.get_dummy_value()

    return types.none(address, reals, wholes), generate


@njit(nogil=True, error_model="numpy")  # not cached: a cache would not see a change in `record`
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
    )
    record = parted_compiled(integers, reals, sizes)
    if fresh:
        apply(memory, record)
    else:
        hold(memory, record)
    _call(whole[_PROCESS], store_reals, store_wholes)  # type: ignore[call-arg] # numba adds the typing context
    mix(memory.sounds, arena, record.volume[0], whole[_POINTS], outputs)


@jitted
def mix(sounds: Array, arena: Array, volume: float, points: int, outputs: Array) -> None:
    """Add up all bodies (bodies, rows, block) in the channels, points in turn."""
    block = outputs.shape[1]
    step = (volume - arena[VOLUME]) / block
    outputs[:] = 0.0
    for channel in range(outputs.shape[0]):
        for body in range(sounds.shape[0]):
            for k in range(block):
                outputs[channel, k] += sounds[body, channel % points, k]
        for k in range(block):
            outputs[channel, k] *= arena[VOLUME] + step * (k + 1)
            arena[PEAK] = max(arena[PEAK], abs(outputs[channel, k]))
    arena[VOLUME] = volume

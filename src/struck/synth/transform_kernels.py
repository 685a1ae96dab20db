"""The loops of the block transform over modes, compiled.

A mode is sixteen numbers: the real and imaginary parts of its eight weights, alternating. Its state
is x + i y, so that it adds x W + i y W to eight neighbours on the grid of frequencies: all modes of
a bin are summed into two vectors, one of x W and one of y W.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.extending import register_model
from numpy.typing import NDArray

from struck.model.arrays import Array, Complex, Index, Single
from struck.synth.memory import Typed, intrinsic
from struck.synth.sample_loop import jitted

FORCES_AT_ONCE = 8  # samples of a force that are convolved together
REACH = 3  # frequencies of the grid below a mode's bin that it touches; above it there is one more


@jitted
def fold(straight: Array, turned: Array, spectra: Complex) -> None:
    """Turn sums of x W and y W on the grid into spectra (C, H + 1) of real samples."""
    highest = spectra.shape[1] - 1
    spectra[:] = 0.0
    for c in range(spectra.shape[0]):
        for k in range(-REACH, highest + REACH + 1):
            i = 2 * (c * (highest + 1 + 2 * REACH) + REACH + k)
            real, imaginary = straight[i] - turned[i + 1], straight[i + 1] + turned[i]
            value = 0.5 * complex(imaginary, -real)
            if 0 <= k <= highest:
                spectra[c, k] += value
            if k <= 0:
                spectra[c, -k] += value.conjugate()
            if k >= highest:
                spectra[c, 2 * highest - k] += value.conjugate()


@jitted
def unfold(spectra: Complex, straight: Single, turned: Single) -> None:
    """Write the conjugate of a force's spectra (C, H + 1) on the grid that `gather` reads."""
    highest = spectra.shape[1] - 1
    for c in range(spectra.shape[0]):
        for k in range(-REACH, highest + REACH + 1):
            i = 2 * (c * (highest + 1 + 2 * REACH) + REACH + k)
            inside = 0 <= k <= highest
            mirrored = -k if k < 0 else 2 * highest - k
            value = spectra[c, k].conjugate() if inside else spectra[c, mirrored]
            straight[i], straight[i + 1] = value.real, -value.imag
            turned[i], turned[i + 1] = value.imag, value.real


@jitted
def reverse(force: Array, openings: Array, backwards: Array) -> None:
    """Write F[B - t], t = 1 to B, times the opening of each class into `backwards` (C, M)."""
    block = force.size
    for c in range(openings.shape[0]):
        for t in range(1, block + 1):
            backwards[c, t] = force[block - t] * openings[c, t]


@jitted
def close(samples: Array, openings: Array, into: Array) -> None:
    """Add samples (L, C, M) of all classes, each times its opening (C, B + 1), to `into` (L, B)."""
    for output in range(into.shape[0]):
        for c in range(openings.shape[0]):
            for t in range(into.shape[1]):
                into[output, t] += samples[output, c, t] * openings[c, t]


@jitted
def convolve(force: Array, answer: Array, past: Array, into: Array) -> None:
    """Add force * answer to `into` (B,); `past` (B + 8,) begins with 8 zeros."""
    block = force.size
    for t in range(block):
        past[8 + t] = answer[t]
    whole = block - block % 8
    for first in range(0, whole, 8):
        f0, f1, f2, f3 = force[first], force[first + 1], force[first + 2], force[first + 3]
        f4, f5, f6, f7 = force[first + 4], force[first + 5], force[first + 6], force[first + 7]
        for t in range(block - first):
            early = f0 * past[t + 8] + f1 * past[t + 7] + f2 * past[t + 6] + f3 * past[t + 5]
            late = f4 * past[t + 4] + f5 * past[t + 3] + f6 * past[t + 2] + f7 * past[t + 1]
            into[first + t] += early + late
    for first in range(whole, block):
        for t in range(first, block):
            into[t] += force[first] * answer[t - first]


# Vectors of sixteen single-precision numbers inside compiled code.
#
# numba turns a loop over modes into vectors by itself, but not a loop over the sixteen numbers of
# one mode. These functions say it outright; the compiler fits them to the machine, one register
# with AVX-512, two with AVX, four with NEON or SSE. They exist inside compiled functions only.

WIDTH = 16  # numbers in a vector

_FLOATS = ir.VectorType(ir.FloatType(), WIDTH)
_DOUBLES = ir.VectorType(ir.DoubleType(), WIDTH)
_LANES = ir.VectorType(ir.IntType(32), WIDTH)


class _Vector(types.Type):
    """The type of sixteen single-precision numbers, as the compiler knows it."""

    def __init__(self) -> None:
        super().__init__(name=f"Vector{WIDTH}")


_VECTOR = _Vector()


@register_model(_Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:  # noqa: ANN401 - numba has no types
        super().__init__(manager, kind, _FLOATS)


@intrinsic
def zeros(_context: Any) -> Typed:  # noqa: ANN401 - numba has no types
    """zeros(): sixteen zeros."""

    def generate(_context: Any, _builder: Any, _signature: Any, _arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
        return ir.Constant(_FLOATS, [0.0] * WIDTH)

    return _VECTOR(), generate


@intrinsic
def load(_context: Any, array: Any, start: Any) -> Typed:  # noqa: ANN401 - numba has no types
    """load(array, start): array[start : start + 16], float32."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
        place = _place(context, builder, signature, arguments, _FLOATS)
        return builder.load(place, align=4)

    return _VECTOR(array, start), generate


@intrinsic
def store(_context: Any, array: Any, start: Any, vector: Any) -> Typed:  # noqa: ANN401 - numba has no types
    """store(array, start, vector): array[start : start + 16] = vector, float32."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
        place = _place(context, builder, signature, arguments, _FLOATS)
        builder.store(arguments[2], place, align=4)
        return context.get_dummy_value()

    return types.void(array, start, vector), generate


@intrinsic
def accumulate(_context: Any, array: Any, start: Any, vector: Any) -> Typed:  # noqa: ANN401 - numba has no types
    """accumulate(array, start, vector): array[start : start + 16] += vector, float64."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
        place = _place(context, builder, signature, arguments, _DOUBLES)
        more = builder.fpext(arguments[2], _DOUBLES)
        builder.store(builder.fadd(builder.load(place, align=8), more), place, align=8)
        return context.get_dummy_value()

    return types.void(array, start, vector), generate


@intrinsic
def multiply(_context: Any, first: Any, second: Any) -> Typed:  # noqa: ANN401 - numba has no types
    """multiply(first, second): their products."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
        return builder.fmul(*arguments)

    return _VECTOR(first, second), generate


@intrinsic
def add(_context: Any, first: Any, second: Any) -> Typed:  # noqa: ANN401 - numba has no types
    """add(first, second): their sums."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
        return builder.fadd(*arguments)

    return _VECTOR(first, second), generate


@intrinsic
def scaled(_context: Any, factor: Any, vector: Any, addend: Any) -> Typed:  # noqa: ANN401 - numba has no types
    """scaled(factor, vector, addend): factor * vector + addend for a float32 factor."""

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
        factor, vector, addend = arguments
        kind = ir.FunctionType(_FLOATS, [_FLOATS] * 3)
        fused = cgutils.get_or_insert_function(builder.module, kind, f"llvm.fma.v{WIDTH}f32")
        return builder.call(fused, [_spread(builder, factor), vector, addend])

    return _VECTOR(factor, vector, addend), generate


@intrinsic
def folded(_context: Any, first: Any, second: Any, group: Any) -> Typed | None:  # noqa: ANN401 - numba has no types
    """folded(first, second, group): halves of each group added, first's groups then second's.

    The group, 16, 8, 4 or 2 numbers long, is a literal. Four such steps turn sixteen vectors into
    the vector of their sums.
    """
    if not isinstance(group, types.IntegerLiteral):
        return None
    length = group.literal_value
    lows = [start + k for start in range(0, 2 * WIDTH, length) for k in range(length // 2)]

    def generate(_context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
        pair = arguments[:2]
        low = builder.shuffle_vector(*pair, _lanes(lows))
        return builder.fadd(
            low, builder.shuffle_vector(*pair, _lanes([lane + length // 2 for lane in lows]))
        )

    return _VECTOR(first, second, group), generate


def _place(context: Any, builder: Any, signature: Any, arguments: Any, kind: Any) -> Any:  # noqa: ANN401 - numba has no types
    """Return a pointer to a vector of this kind inside an array, from (array, start, ...)."""
    array = context.make_array(signature.args[0])(context, builder, arguments[0])
    return builder.bitcast(builder.gep(array.data, [arguments[1]]), kind.as_pointer())


def _spread(builder: Any, factor: Any) -> Any:  # noqa: ANN401 - numba has no types
    """Return the vector of sixteen times the same number."""
    nothing = ir.Constant(_FLOATS, ir.Undefined)
    first = builder.insert_element(nothing, factor, ir.Constant(ir.IntType(32), 0))
    return builder.shuffle_vector(first, nothing, _lanes([0] * WIDTH))


def _lanes(numbers: Sequence[int]) -> ir.Constant:
    return ir.Constant(_LANES, list(numbers))


Places = NDArray[np.int32]

STRETCH = 512  # modes moved on while what was collected for them is still near the core
MODES_AT_ONCE = 8  # modes whose collected sums fill a vector: padding of rows of weights
LONGEST_RUN = 64  # modes summed in single precision before the sum goes to double


@jitted
def spread(
    values: Single,
    weights: Single,
    runs: Index,
    places: Index,
    straight: Array,
    turned: Array,
) -> None:
    """Sum rows of weights (16 N,) times x and times y of values (2 N,) on the grid, run by run."""
    for run in range(places.size):
        n, end = runs[run], runs[run + 1]
        x_even = y_even = x_odd = y_odd = zeros()
        while n + 1 < end:
            even = load(weights, 16 * n)
            odd = load(weights, 16 * n + 16)
            x_even = scaled(values[2 * n], even, x_even)
            y_even = scaled(values[2 * n + 1], even, y_even)
            x_odd = scaled(values[2 * n + 2], odd, x_odd)
            y_odd = scaled(values[2 * n + 3], odd, y_odd)
            n += 2
        if n < end:
            last = load(weights, 16 * n)
            x_even = scaled(values[2 * n], last, x_even)
            y_even = scaled(values[2 * n + 1], last, y_even)
        accumulate(straight, places[run], add(x_even, x_odd))
        accumulate(turned, places[run], add(y_even, y_odd))


@jitted
def gather(
    weights: Single,
    bins: Places,
    straight: Single,
    turned: Single,
    collected: Single,
) -> None:
    """Read the grid back: for each mode the sums of W times `straight` and of W times `turned`."""
    for n in range(0, bins.size, 8):
        first = folded(
            _pair(weights, bins, straight, turned, n),
            _pair(weights, bins, straight, turned, n + 2),
            4,
        )
        second = folded(
            _pair(weights, bins, straight, turned, n + 4),
            _pair(weights, bins, straight, turned, n + 6),
            4,
        )
        store(collected, 2 * n, folded(first, second, 2))


@jitted
def _pair(weights: Single, bins: Places, straight: Single, turned: Single, n: int) -> Any:  # noqa: ANN401 - a vector or tuple of numba's
    """Return the products of two modes, folded to four numbers each sum."""
    first = _mode(weights, bins, straight, turned, n)
    return folded(first, _mode(weights, bins, straight, turned, n + 1), 8)


@jitted
def _mode(weights: Single, bins: Places, straight: Single, turned: Single, n: int) -> Any:  # noqa: ANN401 - a vector or tuple of numba's
    """Return the products of one mode, folded to eight numbers each sum."""
    row = load(weights, 16 * n)
    first = multiply(row, load(straight, bins[n]))
    return folded(first, multiply(row, load(turned, bins[n])), 16)


@jitted
def sum_up(
    states: Complex,
    outputs: Array | Complex,
    weights: Single,
    runs: Index,
    places: Index,
    values: Single,
    grids: Array,
) -> None:
    """Sum on the grids (L, 2, G) what the modes of some runs sound like at each output (L, N)."""
    first, end = runs[0], runs[-1]
    some, room = states[first:end], values[2 * first : 2 * end]
    for output in range(outputs.shape[0]):
        gains = outputs[output, first:end]
        for n in range(some.size):
            heard = some[n] * gains[n]
            room[2 * n] = np.float32(heard.real)
            room[2 * n + 1] = np.float32(heard.imag)
        spread(values, weights, runs, places, grids[output, 0], grids[output, 1])


@jitted
def advance(states: Complex, steps: Complex) -> None:
    """Multiply states by steps."""
    for n in range(states.size):
        states[n] *= steps[n]


@jitted
def absorb(states: Complex, drive: Array | Complex, collected: Single) -> None:
    """Add to states drive times what was collected from the force."""
    for n in range(states.size):
        states[n] += drive[n] * complex(collected[2 * n], collected[2 * n + 1])


@jitted
def step(
    states: Complex,
    steps: Complex,
    drive: Array | Complex,
    outputs: Array | Complex,
    weights: Single,
    bins: Places,
    runs: Index,
    places: Index,
    force: tuple[Single, Single],
    collected: Single,
    values: Single,
    grids: Array,
) -> None:
    """Do `advance`, `gather`, `absorb` and `sum_up`, stretch by stretch of modes."""
    grids[:] = 0.0
    run = 0
    for first in range(0, states.size, STRETCH):
        end = min(first + STRETCH, states.size)
        advance(states[first:end], steps[first:end])
        if drive.size:
            some = bins[first : first + STRETCH]
            gather(weights[16 * first :], some, force[0], force[1], collected)
            absorb(states[first:end], drive[first:end], collected)
        next_run = run
        while next_run < places.size and runs[next_run + 1] <= end:
            next_run += 1
        some_runs = runs[run : next_run + 1]
        sum_up(states, outputs, weights, some_runs, places[run:next_run], values, grids)
        run = next_run

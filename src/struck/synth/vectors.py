"""Vectors of sixteen single-precision numbers inside compiled code.

numba turns a loop over modes into vectors by itself, but not a loop over the sixteen numbers of one
mode. These functions say it outright; the compiler fits them to the machine, one register with
AVX-512, two with AVX, four with NEON or SSE. They exist inside compiled functions only.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.extending import register_model

from struck.synth.addresses import Typed, intrinsic

WIDTH = 16
"""Numbers in a vector."""

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

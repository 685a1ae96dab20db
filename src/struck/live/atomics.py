"""Atomic integers, for compiled code that shares memory with Python.

A plain store may be reordered by compiler and processor alike. A release store may not sink below
nor an acquire load rise above what surrounds them: who sees the stored value also sees all that
was written before it. (ISO/IEC 9899:2011, 7.17.3; LLVM language reference, "Atomic Memory
Ordering Constraints".)
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.base import BaseContext
from numba.core.errors import TypingError
from numba.core.typing.templates import Signature
from numba.extending import intrinsic

Generator = Callable[[BaseContext, ir.IRBuilder, Signature, Sequence[ir.Value]], ir.Value | None]
Typed = tuple[Signature, Generator]

_ALIGNMENT = 8  # bytes, of an int64

# Without the typing context that each intrinsic is written with and not called with.
_intrinsic = cast("Callable[[Callable[..., Typed]], Callable[..., Any]]", intrinsic)


def _check(array: types.Type, index: types.Type) -> None:
    counts = (
        isinstance(array, types.Array)
        and array.ndim == 1
        and array.layout == "C"
        and array.dtype == types.int64
    )
    if not counts or not isinstance(index, types.Integer):
        raise TypingError(
            f"atomics need a contiguous int64 array and an index, not {array}, {index}"
        )


def _element(
    context: BaseContext, builder: ir.IRBuilder, signature: Signature, arguments: Sequence[ir.Value]
) -> ir.Value:
    """Return the pointer to an element; the index is not checked."""
    array_type, index_type = signature.args[:2]
    array = context.make_array(array_type)(context, builder, arguments[0])
    index = context.cast(builder, arguments[1], index_type, types.intp)
    return cgutils.get_item_pointer(
        context, builder, array_type, array, [index], wraparound=False, boundscheck=False
    )


@_intrinsic
def load(_typing: object, array: types.Type, index: types.Type) -> Typed:
    """Return `array[index]`; nothing after it is read before it (acquire)."""
    _check(array, index)

    def generate(
        context: BaseContext,
        builder: ir.IRBuilder,
        signature: Signature,
        arguments: Sequence[ir.Value],
    ) -> ir.Value | None:
        pointer = _element(context, builder, signature, arguments)
        return builder.load_atomic(pointer, "acquire", _ALIGNMENT, typ=ir.IntType(64))

    return types.int64(array, index), generate


@_intrinsic
def store(_typing: object, array: types.Type, index: types.Type, value: types.Type) -> Typed:
    """Set `array[index]`; all that was written before it is seen with it (release)."""
    _check(array, index)

    def generate(
        context: BaseContext,
        builder: ir.IRBuilder,
        signature: Signature,
        arguments: Sequence[ir.Value],
    ) -> ir.Value | None:
        pointer = _element(context, builder, signature, arguments)
        number = context.cast(builder, arguments[2], signature.args[2], types.int64)
        builder.store_atomic(number, pointer, "release", _ALIGNMENT)
        return context.get_dummy_value()

    return types.void(array, index, value), generate


@_intrinsic
def add(_typing: object, array: types.Type, index: types.Type, value: types.Type) -> Typed:
    """Add to `array[index]` in one step (acquire and release) and return what it was before."""
    _check(array, index)

    def generate(
        context: BaseContext,
        builder: ir.IRBuilder,
        signature: Signature,
        arguments: Sequence[ir.Value],
    ) -> ir.Value | None:
        pointer = _element(context, builder, signature, arguments)
        number = context.cast(builder, arguments[2], signature.args[2], types.int64)
        return builder.atomic_rmw("add", pointer, number, "acq_rel")

    return types.int64(array, index, value), generate

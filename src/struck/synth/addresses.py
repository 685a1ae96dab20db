"""Memory and functions at an address, for compiled code."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, types
from numba.core import cgutils
from numba.core.errors import TypingError
from numba.extending import intrinsic as _intrinsic
from numba.extending import overload
from numba.np.numpy_support import carray
from numpy.typing import NDArray

Array = NDArray[Any]
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


def part(array: Array, first: int, shape: tuple[int, ...]) -> Array:
    """Return so many numbers from the first on, in a shape, of a contiguous array (N,).

    Compiled, it costs nothing and keeps nothing alive.
    """
    return array[first : first + math.prod(shape)].reshape(shape)


@overload(part)
def _part(array: Array, first: int, shape: tuple[int, ...]) -> Callable[..., Array]:  # noqa: ARG001 - numba asks by types
    def compiled(array: Array, first: int, shape: tuple[int, ...]) -> Array:
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

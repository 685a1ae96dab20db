"""Memory at an address, for compiled code."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numba import njit, types
from numba.core.errors import TypingError
from numba.extending import intrinsic as _intrinsic
from numba.extending import overload
from numba.np.numpy_support import carray
from numpy.typing import NDArray

Array = NDArray[Any]
# Called, an intrinsic takes no context: not what its definition says.
intrinsic: Any = _intrinsic


@intrinsic
def pointer_to(_context: object, address: types.Type) -> tuple[Any, Callable[..., Any]]:
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

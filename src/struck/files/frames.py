"""Messages between two processes: a header in JSON, then raw little-endian arrays.

Nothing in a message can run: the receiver checks its lengths, types and shapes before it takes it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]

LONGEST_HEADER = 16 * 2**20
_TYPES = {"f": "<f8", "i": "<i8"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """One message: `content` is plain JSON, `arrays` are two-dimensional."""

    content: dict[str, Any]
    arrays: list[Array] = field(default_factory=list)


def write_frame(stream: IO[bytes], content: dict[str, Any], arrays: Sequence[Array] = ()) -> None:
    """Send one message.

    Parameters
    ----------
    stream : binary stream
        Where to.
    content : dict
        What JSON can say.
    arrays : sequence of array (N, D)
        Of real or integer numbers.

    Raises
    ------
    ValueError
        When the header is longer than a receiver takes.
    """
    shapes = [[_TYPES[array.dtype.kind], *array.shape] for array in arrays]
    header = json.dumps({"content": content, "arrays": shapes}).encode()
    if len(header) > LONGEST_HEADER:
        raise ValueError(f"the header has {len(header)} bytes, and {LONGEST_HEADER} are taken")
    _send(stream, len(header).to_bytes(8, "little") + header)
    for array in arrays:
        plain = np.ascontiguousarray(array, dtype=_TYPES[array.dtype.kind])
        _send(stream, plain.reshape(-1).view(np.uint8).data)
    stream.flush()


def read_frame(stream: IO[bytes], *, largest: int) -> Frame:
    """Receive one message.

    Parameters
    ----------
    stream : binary stream
        Where from.
    largest : int
        Bytes that its arrays may take up.

    Raises
    ------
    EOFError
        When the sender has gone.
    ValueError
        When what comes is no message, or a larger one.
    """
    length = int.from_bytes(_received(stream, 8), "little")
    if length > LONGEST_HEADER:
        raise ValueError(f"the header has {length} bytes, and {LONGEST_HEADER} are taken")
    try:
        header = json.loads(_received(stream, length).tobytes())
    except RecursionError as error:
        raise ValueError("the header is nested too deep") from error
    if not _is_header(header):
        raise ValueError("the header is no header")
    content, shapes = header["content"], header["arrays"]
    if sum(8 * math.prod(shape[1:]) for shape in shapes) > largest:
        raise ValueError(f"the arrays take up more than {largest} bytes")
    return Frame(content=content, arrays=[_array(stream, *shape) for shape in shapes])


def _is_header(header: object) -> bool:
    return (
        isinstance(header, dict)
        and header.keys() == {"content", "arrays"}
        and isinstance(header["content"], dict)
        and isinstance(header["arrays"], list)
        and all(_is_shape(shape) for shape in header["arrays"])
    )


def _is_shape(shape: object) -> bool:
    return (
        isinstance(shape, list)
        and len(shape) == 3
        and shape[0] in _TYPES.values()
        and all(type(length) is int and 0 <= length < 2**40 for length in shape[1:])
    )


def _array(stream: IO[bytes], kind: str, rows: int, columns: int) -> Array:
    data = _received(stream, 8 * rows * columns)
    return data.view(kind).reshape(rows, columns)


def _send(stream: IO[bytes], data: bytes | memoryview) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[stream.write(rest) or 0 :]


def _received(stream: IO[bytes], count: int) -> NDArray[np.uint8]:
    data = np.empty(count, dtype=np.uint8)
    rest = data.data
    while rest:
        # The type of binary streams does not tell of readinto, though all of them have it.
        taken = stream.readinto(rest)  # type: ignore[attr-defined]
        if not taken:
            raise EOFError("the sender has gone")
        rest = rest[taken:]
    return data

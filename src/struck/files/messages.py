"""Messages between the program and the process that reads foreign files.

A message is a header in JSON, then raw little-endian arrays. Nothing in it can run: the receiver
checks its lengths, types and shapes before it takes it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from struck.model.arrays import AnyArray

# What a reading process exits with when its memory does not suffice: an answer would need some.
OUT_OF_MEMORY = 77
FORMATS = ("obj", "stl", "ply", "off", "glb", "gltf")
PACKINGS = ("gz", "bz2", "xz", "zip")
READERS = {".vtk": "vtk", ".vtu": "vtu", ".msh": "gmsh", ".inp": "abaqus"}
_LONGEST_HEADER = 16 * 2**20
_TYPES = {"f": "<f8", "i": "<i8"}


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingLimits:
    """Bounds on size, memory, time and counts within which a mesh file is read."""

    size: int = 256 * 2**20  # bytes of a file with all that belongs to it, packed or not
    # bytes of address space of the reading process; held on Linux, not Windows
    memory: int = 2 * 2**30
    seconds: float = 10.0  # processor time for one file, s; enforced where the system can
    wall: float = 120.0  # time for one file by the clock, s: a busy machine is no fault of the file
    vertices: int = 15_000_000
    faces: int = 5_000_000  # triangles
    parts: int = 10_000

    @property
    def answer(self) -> int:
        """Bytes that all vertices and faces take up together."""
        return 24 * (self.vertices + self.faces)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Part:
    """A named part of a file: raw vertices (V, 3) and triangles (F, 3)."""

    name: str
    points: NDArray[np.float64]
    faces: NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Parsed:
    """Contents of a surface mesh file, not checked yet."""

    kind: str  # one of `FORMATS`
    parts: list[Part]
    beside: dict[str, int]  # how many points, lines and curves it has besides its faces


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElementBlocks:
    """Nodes and elements of a volume mesh file, not checked yet."""

    nodes: NDArray[np.float64]  # (N, D), in the file's own unit
    cells: list[tuple[str, NDArray[np.int64]]]  # meshio's kind, (E, K); K is 0 where it varies


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Frame:
    """One message: `content` is plain JSON, `arrays` are two-dimensional."""

    content: dict[str, Any]
    arrays: list[AnyArray] = field(default_factory=list)


def write_frame(
    stream: IO[bytes], content: dict[str, Any], arrays: Sequence[AnyArray] = ()
) -> None:
    """Send JSON content and arrays (N, D) of real or integer numbers as one message."""
    shapes = [[_TYPES[array.dtype.kind], *array.shape] for array in arrays]
    header = json.dumps({"content": content, "arrays": shapes}).encode()
    if len(header) > _LONGEST_HEADER:
        raise ValueError(f"the header has {len(header)} bytes, and {_LONGEST_HEADER} are taken")
    _send(stream, len(header).to_bytes(8, "little") + header)
    for array in arrays:
        plain = np.ascontiguousarray(array, dtype=_TYPES[array.dtype.kind])
        _send(stream, plain.reshape(-1).view(np.uint8).data)
    stream.flush()


def read_frame(stream: IO[bytes], *, largest: int) -> Frame:
    """Receive one message with at most `largest` bytes of arrays; ValueError if malformed."""
    length = int.from_bytes(_received(stream, 8), "little")
    if length > _LONGEST_HEADER:
        raise ValueError(f"the header has {length} bytes, and {_LONGEST_HEADER} are taken")
    try:
        header = json.loads(_received(stream, length).tobytes())
    except RecursionError as error:
        raise ValueError("the header is nested too deep") from error
    if not _is_header(header):
        raise ValueError("the header is no header")
    content, shapes = header["content"], header["arrays"]
    if sum(8 * math.prod(shape[1:]) for shape in shapes) > largest:
        raise ValueError(f"the arrays take up more than {largest} bytes")
    arrays = [
        _received(stream, 8 * rows * columns).view(kind).reshape(rows, columns)
        for kind, rows, columns in shapes
    ]
    return Frame(content=content, arrays=arrays)


def _is_header(header: object) -> bool:
    return (
        isinstance(header, dict)
        and header.keys() == {"content", "arrays"}
        and isinstance(header["content"], dict)
        and isinstance(header["arrays"], list)
        and all(
            isinstance(shape, list)
            and len(shape) == 3
            and shape[0] in _TYPES.values()
            and all(type(length) is int and 0 <= length < 2**40 for length in shape[1:])
            for shape in header["arrays"]
        )
    )


def _send(stream: IO[bytes], data: bytes | memoryview) -> None:
    rest = memoryview(data)
    while rest:
        rest = rest[stream.write(rest) or 0 :]


def _received(stream: IO[bytes], count: int) -> NDArray[np.uint8]:
    data = np.empty(count, dtype=np.uint8)
    rest = data.data
    while rest:
        # The type of binary streams lacks readinto, though all of them have it.
        taken = stream.readinto(rest)  # type: ignore[attr-defined]
        if not taken:
            raise EOFError("the sender has gone")
        rest = rest[taken:]
    return data

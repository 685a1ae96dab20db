"""Messages between the program and the process that reads foreign files.

A message is a header in JSON, then raw little-endian arrays. Nothing in it can run: the receiver
checks its lengths, types and shapes before it takes it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from struck.model.arrays import AnyArray

# What a reading process exits with when its memory does not suffice: an answer would need some.
OUT_OF_MEMORY = 77
# What an answer says instead of the name of an error: the system, or a reader, has failed.
UNREADABLE, DAMAGED = "unreadable", "damaged"
BROKEN = "broken"  # damaged, and a compiled library may not work any more in that process
# By task: the function that does it, (path, limits, **options) -> Answer.
TASKS = {
    "surface": "struck.files.mesh_formats:answer_surface",
    "repair": "struck.files.mesh_repair:answer",
    "volume": "struck.files.mesh_formats:answer_volume",
    "contacts": "struck.files.contact_log:answer",
    "animation": "struck.files.gltf:answer_animation",
    "sound": "struck.files.sound_formats:answer",
    "sofa": "struck.files.sofa:answer",
    "scene": "struck.scene.engines.scene_file:answer",
}
FORMATS = ("obj", "stl", "ply", "off", "glb", "gltf")
PACKINGS = ("gz", "bz2", "xz", "zip")
READERS = {".vtk": "vtk", ".vtu": "vtu", ".msh": "gmsh", ".inp": "abaqus"}
READING_SECONDS = 10.0  # s, default processor time for a file
_LONGEST_HEADER = 16 * 2**20
_TYPES = ("<f8", "<i8", "<f4", "|u1")


Answer = tuple[dict[str, Any], list[AnyArray]]  # plain JSON, and arrays (N, D)


@dataclass(frozen=True, slots=True, kw_only=True)
class ReadingLimits:
    """Bounds on size, memory, time and counts within which a foreign file is read."""

    size: int = 256 * 2**20  # bytes of a file with all that belongs to it, packed or not
    # bytes of address space of the reading process; held on Linux, not Windows
    memory: int = 2 * 2**30
    seconds: float = (
        READING_SECONDS  # processor time for one file, s; enforced where the system can
    )
    wall: float = 120.0  # time for one file by the clock, s: a busy machine is no fault of the file
    vertices: int = 15_000_000
    faces: int = 5_000_000  # triangles
    parts: int = 10_000
    answer: int = 2**30  # bytes of all arrays that come from a file


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
    seconds: float = 0.0  # processor time that reading took


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
    shapes = [[_type_of(array), *array.shape] for array in arrays]
    header = json.dumps({"content": content, "arrays": shapes}).encode()
    if len(header) > _LONGEST_HEADER:
        raise ValueError(f"the header has {len(header)} bytes, and {_LONGEST_HEADER} are taken")
    _send(stream, len(header).to_bytes(8, "little") + header)
    for array in arrays:
        plain = np.ascontiguousarray(array, dtype=_type_of(array))
        _send(stream, plain.reshape(-1).view(np.uint8).data)
    stream.flush()


def _type_of(array: AnyArray) -> str:
    """Return the type in which an array is sent: single precision and bytes stay as they are."""
    return {"float32": "<f4", "uint8": "|u1"}.get(
        array.dtype.name, "<f8" if array.dtype.kind == "f" else "<i8"
    )


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
    sizes = [np.dtype(kind).itemsize * rows * columns for kind, rows, columns in shapes]
    if sum(sizes) > largest:
        raise ValueError(f"the arrays take up more than {largest} bytes")
    arrays = [
        _received(stream, size).view(kind).reshape(rows, columns)
        for size, (kind, rows, columns) in zip(sizes, shapes, strict=True)
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
            and shape[0] in _TYPES
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

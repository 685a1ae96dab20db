"""The process that reads foreign files, so that nothing they do can harm the program.

Started by `guard`; asked on standard input, answers on standard output, ends with either. Messages
are a header in JSON, then raw little-endian arrays. Nothing in a message can run: the receiver
checks its lengths, types and shapes before it takes it.
"""

from __future__ import annotations

import contextlib
import faulthandler
import json
import math
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError, MissingDependencyError
from struck.files.archives import OUT_OF_MEMORY, ReadingLimits
from struck.model.arrays import AnyArray

_GRACE = 2.0  # s, after which a question ends the process if nobody else does
_LONGEST_HEADER = 16 * 2**20
_TYPES = {"f": "<f8", "i": "<i8"}

Answer = tuple[dict[str, Any], list[AnyArray]]


def main() -> None:
    """Answer one question after the other, until nobody asks."""
    limits = ReadingLimits(**json.loads(sys.argv[1]))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program
    # Standard output is for answers: readers print to nowhere.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    _confine(limits.memory)
    with contextlib.suppress(EOFError, OSError):
        write_frame(answers, {"ready": True})
        while True:
            question = read_frame(sys.stdin.buffer, largest=0).content
            # The asker ends this process in time, unless it has died itself.
            faulthandler.dump_traceback_later(limits.seconds + _GRACE, exit=True)
            try:
                write_frame(answers, *_answer(question, limits))
            except MemoryError:
                os._exit(OUT_OF_MEMORY)
            faulthandler.cancel_dump_traceback_later()


def _confine(memory: int) -> None:
    """Limit the address space, where the system can, and leave no image of a crash."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        hard = resource.getrlimit(resource.RLIMIT_AS)[1]
        bound = memory if hard == resource.RLIM_INFINITY else min(memory, hard)
        resource.setrlimit(resource.RLIMIT_AS, (bound, bound))


def _answer(question: dict[str, Any], limits: ReadingLimits) -> Answer:
    try:
        return _TASKS[question["task"]](Path(question["path"]), limits)
    except (MeshError, MissingDependencyError) as error:
        return {"error": type(error).__name__, "message": str(error)}, []
    except OSError as error:
        message = f"it cannot be read ({error.strerror or error}): check the disk it is on"
        return {"error": "MeshError", "message": message}, []


def _surface(path: Path, limits: ReadingLimits) -> Answer:
    from struck.files.mesh_formats import parse

    kind, parts = parse(path, limits)
    arrays = [array for part in parts for array in (part.points, part.faces)]
    return {"kind": kind, "names": [part.name for part in parts]}, arrays


def _volume(path: Path, limits: ReadingLimits) -> Answer:
    from struck.files.mesh_formats import read_blocks

    found = read_blocks(path, limits)
    arrays = [found.nodes, *(cells for _, cells in found.cells)]
    return {"kinds": [kind for kind, _ in found.cells]}, arrays


_TASKS: dict[str, Callable[[Path, ReadingLimits], Answer]] = {
    "surface": _surface,
    "volume": _volume,
}


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
        # The type of binary streams does not tell of readinto, though all of them have it.
        taken = stream.readinto(rest)  # type: ignore[attr-defined]
        if not taken:
            raise EOFError("the sender has gone")
        rest = rest[taken:]
    return data

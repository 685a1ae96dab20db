"""A disk on which the n-th call fails: what writes to a folder of this process goes through it.

Calls of `os` and files opened by `open` are counted where they concern the folder. Writers in C do
not come through here, which a dry run shows: fewer bytes are written than the files have.
"""

from __future__ import annotations

import builtins
import errno
import io
import os
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from types import FrameType, TracebackType
from typing import Any, Self
from unittest.mock import patch

ENDED = 75  # status of a process that a fault has ended
_WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | getattr(os, "O_DIRECTORY", 0)
# Their first argument is a path, or two of the same folder; or the number of an open file.
_OF_PATHS = ("replace", "rename", "unlink", "remove", "mkdir", "rmdir", "link", "symlink", "chmod")
_RENAMES = ("replace", "rename")
_OF_FILES = ("fsync", "fdatasync", "fchmod", "ftruncate")


class Fault(Enum):
    """What happens at a call."""

    FULL = "the disk is full"
    BROKEN = "the disk fails once"
    GONE = "this call and all that follow fail"
    HALF = "half of the bytes are written before the disk is full"
    FEWER = "fewer bytes are written than given, without an error"
    END = "the process ends before the call"
    TORN = "the process ends after half of the bytes"


OF_WRITES = (Fault.HALF, Fault.FEWER, Fault.TORN)
ENDS = (Fault.END, Fault.TORN)


@dataclass(frozen=True)
class Step:
    """A call that concerns the folder."""

    operation: str
    name: str
    size: int = 0


class FailingDisk:
    """The calls by which a folder is written to, of which one fails.

    Without a fault all are counted only. `callers` are the functions of struck, as
    "module:function", that stood on the stack when a file got its name; `versions` the contents
    that each name was given.
    """

    def __init__(self, folder: Path, fault: Fault | None = None, at: int = 0) -> None:
        self.folder = os.path.realpath(folder)
        self.steps: list[Step] = []
        self.callers: set[str] = set()
        self.versions: dict[str, list[bytes]] = {}
        self._fault, self._at = fault, at
        self._names: dict[int, str] = {}  # of open files, by their numbers
        self._patches = ExitStack()
        self._os_open, self._os_write, self._open = os.open, os.write, builtins.open

    def __enter__(self) -> Self:
        replaced: list[tuple[Any, str, Callable[..., object]]] = [
            (os, "open", self._open_number),
            (os, "write", self._write_number),
            (os, "close", self._closing(os.close)),
            (builtins, "open", self._open_file),
            (io, "open", self._open_file),
        ]
        replaced += [(os, name, self._of_path(name)) for name in _OF_PATHS]
        replaced += [(os, name, self._of_file(name)) for name in _OF_FILES if hasattr(os, name)]
        for place, name, function in replaced:
            self._patches.enter_context(patch.object(place, name, function))
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._patches.close()

    def write(
        self, name: str, data: bytes | memoryview, write: Callable[[memoryview], int | None]
    ) -> int:
        """Write bytes by a function of the system, or a part of them."""
        content = memoryview(data).cast("B")
        fault = self._count("write", name, len(content))
        if fault is None:
            return write(content) or 0
        half = content[: len(content) // 2]
        if fault is Fault.FEWER:
            return write(half or content) or 0
        write(half)
        if fault is Fault.TORN:
            os._exit(ENDED)
        raise _error(errno.ENOSPC, name)

    def _count(self, operation: str, name: str, size: int = 0) -> Fault | None:
        """Count a call; let it fail if that is due, or return the fault of a write."""
        self.steps.append(Step(operation, name, size))
        number = len(self.steps) - 1
        if self._fault is None or number < self._at:
            return None
        if self._fault is Fault.GONE:
            raise _error(errno.EIO, name)
        if number > self._at:
            return None
        if self._fault in OF_WRITES:
            return self._fault
        if self._fault is Fault.END:
            os._exit(ENDED)
        raise _error(errno.ENOSPC if self._fault is Fault.FULL else errno.EIO, name)

    def _name(self, path: object) -> str | None:
        """Return a path within the folder, or None if it is elsewhere."""
        if not isinstance(path, str | bytes | os.PathLike):
            return None
        folder, name = os.path.split(os.path.abspath(os.fsdecode(path)))  # noqa: PTH100
        place = os.path.join(os.path.realpath(folder), name)  # noqa: PTH118
        is_inside = place == self.folder or place.startswith(self.folder + os.sep)
        return os.path.relpath(place, self.folder) if is_inside else None

    def _open_number(
        self,
        path: Any,  # noqa: ANN401
        flags: int,
        mode: int = 0o777,
        *,
        dir_fd: int | None = None,
    ) -> int:
        name = self._name(path) if dir_fd is None and flags & _WRITING else None
        if name is not None:
            self._count("open", name)
        number = self._os_open(path, flags, mode, dir_fd=dir_fd)
        if name is not None:
            self._names[number] = name
        return number

    def _write_number(self, number: int, data: bytes | memoryview) -> int:
        if number not in self._names:
            return self._os_write(number, data)
        return self.write(
            self._names[number], data, lambda content: self._os_write(number, content)
        )

    def _closing(self, close: Callable[[int], None]) -> Callable[[int], None]:
        def close_number(number: int) -> None:
            self.forget(number)
            close(number)

        return close_number

    def forget(self, number: int) -> None:
        """Forget the number of a file that is closed, which another may get."""
        self._names.pop(number, None)

    def _open_file(
        self,
        file: Any,  # noqa: ANN401 - a path or a number
        mode: str = "r",
        buffering: int = -1,
        encoding: str | None = None,
        errors: str | None = None,
        newline: str | None = None,
        closefd: bool = True,  # noqa: FBT001, FBT002
        opener: Callable[[str, int], int] | None = None,
    ) -> Any:  # noqa: ANN401 - as `open`
        if not set(mode) & set("wax+") or self._name(file) is None:
            return self._open(file, mode, buffering, encoding, errors, newline, closefd, opener)
        raw = _File(self, file, mode.replace("t", "").replace("b", ""), opener=opener or _open_new)
        if buffering == 0:
            return raw
        binary = io.BufferedRandom(raw) if "+" in mode else io.BufferedWriter(raw)
        return binary if "b" in mode else io.TextIOWrapper(binary, encoding, errors, newline)

    def _of_path(self, operation: str) -> Callable[..., object]:
        call = getattr(os, operation)

        def counted(path: Any, *others: Any, **options: Any) -> object:  # noqa: ANN401
            name = None if options.get("dir_fd") is not None else self._name(path)
            if name is not None:
                self._count("unlink" if operation == "remove" else operation, name)
            if name is not None and operation in _RENAMES:
                new_name = self._name(others[0]) or name
                self.callers |= _callers(sys._getframe(1))
                self.versions.setdefault(new_name, []).append(Path(path).read_bytes())
            return call(path, *others, **options)

        return counted

    def _of_file(self, operation: str) -> Callable[..., object]:
        call = getattr(os, operation)

        def counted(number: int, *others: object) -> object:
            if number in self._names:
                self._count(operation, self._names[number])
            return call(number, *others)

        return counted

    def name_of(self, number: int) -> str:
        """Return the name of an open file."""
        return self._names[number]


class _File(io.FileIO):
    """A file opened by `open`, whose writes are counted."""

    def __init__(self, disk: FailingDisk, *arguments: Any, **options: Any) -> None:  # noqa: ANN401
        super().__init__(*arguments, **options)
        self._disk = disk

    def write(self, data: bytes | memoryview, /) -> int:
        return self._disk.write(self._disk.name_of(self.fileno()), data, super().write)

    def close(self) -> None:
        if not self.closed:
            self._disk.forget(self.fileno())
        super().close()


def _open_new(name: str, flags: int) -> int:
    return os.open(name, flags, 0o666)


def _error(number: int, name: str) -> OSError:
    return OSError(number, os.strerror(number), name)


def _callers(frame: FrameType | None) -> set[str]:
    """Return the functions of struck on the stack."""
    callers = set()
    while frame is not None:
        module = frame.f_globals.get("__name__", "")
        if module.startswith("struck."):
            callers.add(f"{module}:{frame.f_code.co_qualname}")
        frame = frame.f_back
    return callers

"""Folder of a room: for this user alone, removed at the end, or by a later start.

A process that is killed leaves its folder behind. While it lives it holds a lock on a file in it,
which the system releases however the process ends, so that a later start removes what no process
uses, and nothing else.
"""

from __future__ import annotations

import os
import re
import shutil
import stat
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import IO

from struck.files.atomic import write_bytes

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

_PREFIX = "struck-room-"
_NAME = re.compile(rf"{_PREFIX}[a-z0-9_]{{8}}")  # as `tempfile` completes it
_LOCK = "lock"


class PrivateFolder:
    """A temporary folder of mode 0700 that a live process holds.

    Raises
    ------
    OSError
        When it cannot be made.
    """

    def __init__(self) -> None:
        sweep(Path(tempfile.gettempdir()))
        self._folder = tempfile.TemporaryDirectory(prefix=_PREFIX, ignore_cleanup_errors=True)
        self.path = Path(self._folder.name)
        self._lock = _lock_folder(self.path)

    def write_private(self, name: str, text: str) -> Path:
        """Write a file of mode 0600, and return its path; FileFormatError if that fails."""
        path = self.path / name
        write_bytes(path, text.encode(), private=True)
        return path

    def remove(self) -> None:
        """Remove the folder with all that it holds."""
        self._lock.close()
        self._folder.cleanup()


def sweep(parent: Path) -> int:
    """Remove and count the folders of this user whose processes have ended.

    Links are not followed, and nothing is removed on Windows, where no lock shows which processes
    have ended.
    """
    count = 0
    if not hasattr(os, "geteuid"):
        return count
    with suppress(OSError), os.scandir(parent) as entries:
        for entry in entries:
            if _NAME.fullmatch(entry.name):
                with suppress(OSError):
                    count += _remove_dead(Path(entry.path))
    return count


def _remove_dead(folder: Path) -> bool:
    """Remove a folder of this user that no process holds; return whether that was so."""
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid():
        return False
    descriptor = os.open(folder / _LOCK, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            return False
        _lock(descriptor)
        shutil.rmtree(folder)
    finally:
        os.close(descriptor)
    return True


def _lock_folder(folder: Path) -> IO[str]:
    """Return the open file by whose lock a folder is held."""
    # Only a file that is locked already gets the name by which it is looked for.
    new_path = folder / f".{_LOCK}"
    file = open(new_path, "x", encoding="utf-8", opener=_open_private)  # noqa: SIM115 - open until the end
    with suppress(OSError):  # where there are no locks it is not swept
        _lock(file.fileno())
        new_path.rename(folder / _LOCK)
    return file


def _lock(descriptor: int) -> None:
    """Lock an open file; OSError where another process holds it, or the system has no locks."""
    if fcntl is None:
        raise OSError
    fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _open_private(path: str, flags: int) -> int:
    """Open a file that its owner alone may read and write."""
    return os.open(path, flags, 0o600)

"""Finished work kept between runs: sealed entries of bytes in one folder.

Any number of processes may share the folder. An entry appears whole or not at all, under the name
of its key; its seal covers the key and the content, so that one that is damaged, cut short,
foreign or in another's place is never returned. A cache raises no errors: if it
cannot keep a result, it warns once, and the work continues without it.
"""

from __future__ import annotations

import hashlib
import os
import re
import stat
import sys
import warnings
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from struck.errors import CacheWarning, FileFormatError, OptionError
from struck.model.arrays import checked

MOST_BYTES = 2 * 2**30
VARIABLE = "STRUCK_CACHE"
OFF = "off"
_HEAD = b"struck cache" + (1).to_bytes(4, "little")  # kind of file, and its version
_SEAL = hashlib.sha256().digest_size
_KEY = re.compile(r"[0-9a-f]{64}")


@dataclass(frozen=True, slots=True, kw_only=True)
class CacheEntry:
    """One file of a cache, with its size and last use."""

    path: Path  # its name is the key
    size: int  # bytes on the disk
    used: int  # last written or read, ns


@checked
class Cache:
    """Entries of bytes by key; of more than fits, the least recently used go.

    Parameters
    ----------
    folder : path
        Folder of the entries, created when the first is stored.
    most_bytes : int, default 2147483648
        Maximum size of all entries together on the disk, bytes.

    Attributes
    ----------
    damaged : int
        Entries that were found damaged here, and removed.

    Raises
    ------
    OptionError
        If `most_bytes` is negative.

    Examples
    --------
    >>> from hashlib import sha256
    >>> from struck.files import Cache
    >>> cache, key = Cache("results"), sha256(b"what it depends on").hexdigest()
    >>> cache.put(key, b"content")
    >>> cache.get(key)
    b'content'
    >>> cache.clear()
    1
    """

    def __init__(self, folder: str | os.PathLike[str], *, most_bytes: int = MOST_BYTES) -> None:
        if most_bytes < 0:
            raise OptionError(f"most_bytes is {most_bytes}: give 0 or more")
        self.folder = Path(folder).absolute()
        self.most_bytes = most_bytes
        self.damaged = 0
        self._said: set[str] = set()

    def get(self, key: str) -> bytes | None:
        """Return the content of an entry.

        A damaged entry is removed, counted in `damaged`, and reported once by a `CacheWarning`.

        Parameters
        ----------
        key : str
            SHA-256 in hexadecimal.

        Returns
        -------
        bytes or None
            The content; None if there is no entry.
        """
        path = self._path(key)
        try:
            content = _content(path, self.most_bytes)
        except (FileNotFoundError, NotADirectoryError):
            return None
        except FileFormatError as error:
            self.discard(key, str(error))
            return None
        except (OSError, MemoryError) as error:
            self.say("closed", f"the cache in {self.folder} cannot be read: {_reason(error)}")
            return None
        with suppress(OSError):  # a cache may be there for reading alone
            os.utime(path)
        return content

    def put(self, key: str, content: bytes) -> None:
        """Store content, if the disk allows it.

        Parameters
        ----------
        key : str
            SHA-256 in hexadecimal.
        content : bytes
            The content.
        """
        from struck.files.atomic import write_bytes  # only where something is kept

        path = self._path(key)
        size = len(_HEAD) + _SEAL + len(content)
        if size > self.most_bytes:
            self.say("large", f"{size} bytes exceed the whole cache of {self.most_bytes}: not kept")
            return
        try:
            self.folder.mkdir(mode=0o700, parents=True, exist_ok=True)
            write_bytes(path, _HEAD, _seal(key, content), content)
        except (OSError, FileFormatError, MemoryError) as error:
            self.say("closed", f"finished work is not kept: {_reason(error)}")
            return
        self._trim(path)

    def discard(self, key: str, reason: str) -> None:
        """Remove a damaged entry, count it, and warn once.

        Parameters
        ----------
        key : str
            SHA-256 in hexadecimal.
        reason : str
            Cause of the damage.
        """
        self.damaged += 1
        with suppress(OSError):
            self._path(key).unlink()
        self.say(
            "damaged",
            f"an entry of the cache in {self.folder} was damaged ({reason}): it is computed again",
        )

    def say(self, kind: str, text: str) -> None:
        """Warn once for each kind of warning.

        Parameters
        ----------
        kind : str
            Kind of the warning.
        text : str
            Its text.
        """
        if kind not in self._said:
            self._said.add(kind)
            warnings.warn(text, CacheWarning, stacklevel=3)

    def entries(self) -> list[CacheEntry]:
        """List all entries, the least recently used first.

        Returns
        -------
        list of CacheEntry
            Path, size and last use of each.
        """
        entries: list[CacheEntry] = []
        with suppress(OSError), os.scandir(self.folder) as directory:
            for file in (file for file in directory if _KEY.fullmatch(file.name)):
                with suppress(OSError):
                    status = file.stat(follow_symlinks=False)
                    if stat.S_ISREG(status.st_mode):
                        path, size, time = Path(file.path), status.st_size, status.st_mtime_ns
                        entries.append(CacheEntry(path=path, size=size, used=time))
        return sorted(entries, key=lambda entry: entry.used)

    def clear(self) -> int:
        """Remove all entries, and files that killed processes left.

        Returns
        -------
        int
            Number of entries that were removed.
        """
        from struck.files.atomic import sweep

        sweep(self.folder)
        return sum(_removed(entry.path) for entry in self.entries())

    def _path(self, key: str) -> Path:
        if not _KEY.fullmatch(key):
            raise OptionError(f"key is {key!r}: give a SHA-256 in hexadecimal")
        return self.folder / key

    def _trim(self, newest: Path) -> None:
        """Remove the least recently used until the rest fits; `newest` stays."""
        entries = self.entries()
        excess_size = sum(entry.size for entry in entries) - self.most_bytes
        for entry in entries:
            if excess_size <= 0:
                return
            if entry.path != newest and _removed(entry.path):
                excess_size -= entry.size


def opened(*, choice: bool | str | os.PathLike[str] = True) -> Cache | None:
    """Return the cache that a user chose by path or STRUCK_CACHE; None for no cache."""
    if choice is False:
        return None
    if choice is not True:
        return Cache(choice)
    named = os.environ.get(VARIABLE, "")
    if named.strip().lower() == OFF:
        return None
    if named:
        folder = os.path.expanduser(named)  # noqa: PTH111  a user without a home is no error
        if not folder.startswith("~"):
            return Cache(folder)
        text = f"{VARIABLE} is {named!r}, and there is no such home: finished work is not kept"
        warnings.warn(f"{text}; set the whole path of a folder", CacheWarning, stacklevel=3)
        return None
    folder = user_folder(sys.platform, os.environ)
    return None if folder is None else Cache(folder)


def user_folder(system: str, environment: Mapping[str, str]) -> Path | None:
    """Return the folder of caches on a `sys.platform`; None for a user without a home."""
    # Linux follows the XDG base directory specification: its paths count only where absolute.
    if system == "win32" and environment.get("LOCALAPPDATA"):
        return Path(environment["LOCALAPPDATA"]) / "struck" / "Cache"
    named = Path(environment.get("XDG_CACHE_HOME", ""))
    if system not in {"win32", "darwin"} and named.is_absolute():
        return named / "struck"
    try:
        home = Path.home()
    except RuntimeError:
        return None
    if system == "win32":
        return home / "AppData" / "Local" / "struck" / "Cache"
    return home / ("Library/Caches" if system == "darwin" else ".cache") / "struck"


def _content(path: Path, most: int) -> bytes:
    """Return the content of an entry; FileFormatError if name, seal and content disagree."""
    status = path.lstat()
    if not stat.S_ISREG(status.st_mode):
        raise FileFormatError("it is no ordinary file")
    if status.st_size > most:
        raise FileFormatError(f"it has {status.st_size} bytes of {most} at most")
    with path.open("rb") as file:
        head, seal, content = file.read(len(_HEAD)), file.read(_SEAL), file.read()
    if head != _HEAD:
        raise FileFormatError("it does not begin like an entry of this version")
    if seal != _seal(path.name, content):
        raise FileFormatError("its content does not match its SHA-256")
    return content


def _seal(key: str, content: bytes) -> bytes:
    digest = hashlib.sha256(_HEAD)
    digest.update(key.encode())
    digest.update(content)
    return digest.digest()


def _removed(path: Path) -> bool:
    """Remove a file; return whether it is gone, as another process may be reading it."""
    try:
        path.unlink(missing_ok=True)
    except OSError:
        return False
    return True


def _reason(error: Exception) -> str:
    return "memory is short" if isinstance(error, MemoryError) else str(error)

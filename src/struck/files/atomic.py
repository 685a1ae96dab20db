"""Files written whole or not at all, also where a process is killed at it, and read within bounds.

What is read is an ordinary file of bounded size: a pipe would be waited for, a device may have no
end.
"""

from __future__ import annotations

import errno
import os
import platform
import re
import secrets
import stat
import sys
import zlib
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import IO

from struck.errors import FileFormatError, nearest

# Host, process and chance: whose a hidden file is, so that those of ended processes are recognised.
_PART = re.compile(r"\.struck-([0-9a-f]{8})-([1-9][0-9]{0,9})-[0-9a-f]{16}\.part")
_DAY = 86_400.0
_BOOT, _NAMESPACE = Path("/proc/sys/kernel/random/boot_id"), Path("/proc/self/ns/pid")
_MAX_SIZE = 2**31  # bytes of a file that is read
_PIPE = "a pipe or a device, not an ordinary file"
_ACCESS_LIST = "system.posix_acl_access"  # name of the attribute, Linux
_AT_ONCE = getattr(os, "O_NONBLOCK", 0)
_names_in_use: set[str] = set()  # of the hidden files that threads of this process write


def open_ordinary(path: str | os.PathLike[str]) -> IO[bytes]:
    """Open a file for reading; OSError on pipes and devices, which are not even opened."""
    if not _ordinary(Path(path).stat()):
        raise OSError(errno.EINVAL, _PIPE)
    # Should a pipe have taken its place meanwhile, its writer is not waited for.
    file = open(  # noqa: SIM115 - for who called to close
        path, "rb", opener=lambda name, flags: os.open(name, flags | _AT_ONCE)
    )
    if not _ordinary(os.fstat(file.fileno())):
        file.close()
        raise OSError(errno.EINVAL, _PIPE)
    return file


def _ordinary(status: os.stat_result) -> bool:
    return stat.S_ISREG(status.st_mode) or stat.S_ISDIR(status.st_mode)


def read_bytes(path: str | os.PathLike[str], *, most: int = _MAX_SIZE) -> bytes:
    """Return the content of an ordinary file of at most `most` bytes; else FileFormatError."""
    try:
        with open_ordinary(path) as file:
            size = os.fstat(file.fileno()).st_size
            data = file.read(size) if size <= most else b""
    except (OSError, ValueError) as error:
        raise FileFormatError(f"{path} {unread(path, error)}") from error
    if size > most:
        raise FileFormatError(
            f"{path} has {size} bytes, and at most {most} are read: split it, or give another file"
        )
    return data


def require_readable(path: str | os.PathLike[str]) -> None:
    """Raise FileFormatError where a file is missing, or cannot be opened to be read."""
    try:
        open_ordinary(path).close()
    except (OSError, ValueError) as error:
        raise FileFormatError(f"{path} {unread(path, error)}") from error


def unread(path: str | os.PathLike[str], error: Exception) -> str:
    """Return why a file cannot be read, and the nearest name in its folder where it is missing."""
    folder = Path(path).parent
    if isinstance(error, FileNotFoundError) and not is_folder(folder):
        return f"is missing, as there is no folder {folder}: check its name"
    if isinstance(error, FileNotFoundError):
        is_readable = os.access(folder, os.R_OK)  # a folder may be entered and yet not listed
        names = [entry.name for entry in folder.iterdir()] if is_readable else []
        suggestion = nearest(Path(path).name, names)
        return f"is missing, there is no file of that name: {suggestion}check its name"
    reason = getattr(error, "strerror", None) or error
    return f"cannot be read ({reason}): check its name and the permissions"


def is_file(path: str | os.PathLike[str]) -> bool:
    """Return whether there is an ordinary file, also of a name that is too long to be one."""
    return os.path.isfile(path)  # noqa: PTH113 - Path raises there


def is_folder(path: str | os.PathLike[str]) -> bool:
    """Return whether there is a folder, also of a name that is too long to be one."""
    return os.path.isdir(path)  # noqa: PTH112 - Path raises there


def real(path: str | os.PathLike[str]) -> Path:
    """Return where links lead to, as far as they do; no error where a name cannot be one."""
    try:
        return Path(os.path.realpath(path))
    except ValueError:
        return Path(path)


def write_bytes(path: str | os.PathLike[str], *blocks: bytes, private: bool = False) -> None:
    """Write a file whole: readers see the old content or the new, never a part.

    A new file that is private may be read and written by its owner alone.
    """
    # The data goes to a hidden file in the same folder, is flushed to the disk and then renamed;
    # files that a killed process or a failing disk left are removed with the next one written
    # there. Symbolic links are followed. A file that is replaced passes on who may read and write
    # it; as with every rename, the permissions of the folder decide whether it may be replaced.
    require_file_name(path)
    target = real(path)
    if is_folder(target):
        raise FileFormatError(f"{path} is a folder: add the name of a file in it")
    if os.path.exists(target) and not is_file(target):  # noqa: PTH110 - Path raises there
        raise FileFormatError(f"{path} is not an ordinary file: give another name")
    if not is_folder(target.parent):
        raise FileFormatError(
            f"{path} cannot be written: the folder {target.parent} does not exist; make it first"
        )
    try:
        sweep(target.parent)
        _replace(target, blocks, private=private)
    except PermissionError as error:
        raise FileFormatError(
            f"{path} cannot be written: {target.parent} allows no new files here; "
            "give another folder, or get the permission"
        ) from error
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FileFormatError(
            f"{path} cannot be written ({reason}): free some space, or give another name or folder"
        ) from error


def require_file_name(path: str | os.PathLike[str]) -> None:
    """Raise FileFormatError where a path is empty, or ends as that of a folder does."""
    text = os.fspath(path)
    if not text:
        raise FileFormatError("the name of the file to write is empty: give one")
    if text.endswith((os.sep, os.altsep or os.sep)):
        raise FileFormatError(f"{text} is the name of a folder: add the name of a file in it")


def ended(path: str | os.PathLike[str]) -> str:
    """Return how a file's name ends, in words."""
    ending = Path(path).suffix
    return f"ends in {ending!r}" if ending else "has no ending"


def require_ending(path: str | os.PathLike[str], endings: Sequence[str], kind: str) -> None:
    """Raise FileFormatError where a name does not end as files of that `kind` do."""
    ending = Path(path).suffix.lower()
    if ending not in endings:
        raise FileFormatError(
            f"{os.fspath(path)} {ended(path)}: {kind} end in {', '.join(endings)}, as "
            f"{Path(path).stem or 'file'}{endings[0]}"
        )


def writable(
    path: str | os.PathLike[str],
    *,
    unlike: Iterable[str | os.PathLike[str]] = (),
    endings: Sequence[str] = (),
    kind: str = "files",
) -> Path:
    """Return a path to write, after refusing folders and the files `unlike` that are in use.

    Names that do not end in one of the `endings` that files of its `kind` have are refused too.
    """
    require_file_name(path)
    target = Path(path)
    if is_folder(target):
        raise FileFormatError(f"{target} is a folder: give the name of a file in it")
    if not is_folder(target.parent):
        raise FileFormatError(f"there is no folder {target.parent}: make it first")
    for other in unlike:
        if _same(target, Path(other)):
            remark = "" if str(target) == str(other) else f", that is {other},"
            raise FileFormatError(
                f"{target}{remark} is read or written as well, and would be replaced: give another "
                "name"
            )
    if endings:
        require_ending(path, endings, kind)
    return target


def _same(one: Path, other: Path) -> bool:
    """Return whether two names lead to one file, also where it does not exist yet."""
    try:
        return os.path.realpath(one) == os.path.realpath(other) or one.samefile(other)
    except (OSError, ValueError):
        return False


def make_folder(folder: str | os.PathLike[str], *, parents: bool = False) -> Path:
    """Make a folder unless it exists, and return its path; FileFormatError if that fails."""
    path = Path(folder)
    try:
        path.mkdir(parents=parents, exist_ok=True)
    except (OSError, ValueError) as error:
        if isinstance(error, FileNotFoundError) and not is_folder(path.parent):
            raise FileFormatError(f"there is no folder {path.parent}: make it first") from error
        reason = getattr(error, "strerror", None) or error
        raise FileFormatError(
            f"the folder {folder} cannot be made ({reason}): give another name, or free some space"
        ) from error
    return path


def remove(path: str | os.PathLike[str]) -> None:
    """Remove a file unless it is missing; FileFormatError if that fails."""
    try:
        Path(path).unlink(missing_ok=True)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise FileFormatError(
            f"{path} cannot be removed ({reason}): remove it by hand, or give another folder"
        ) from error


def sweep(folder: Path) -> int:
    """Remove and count the hidden files whose writing was killed, or left on a failing disk."""
    # A process of our own computer and namespace is known to be gone; files of others are left
    # until the folder has changed a day after it last did, by the clock of who keeps the folder.
    removed_count, host = 0, _host()
    with suppress(OSError):
        changed = folder.stat().st_mtime
        for part in filter(None, map(_PART.fullmatch, os.listdir(folder))):  # noqa: PTH208 - fast
            path = folder / part[0]
            with suppress(OSError):
                if (part[1] == host and _is_left(part[0], int(part[2]))) or (
                    changed - path.stat().st_mtime > _DAY
                ):
                    path.unlink()
                    removed_count += 1
    return removed_count


def _replace(target: Path, blocks: Iterable[bytes], *, private: bool) -> None:
    name = f".struck-{_host()}-{os.getpid()}-{secrets.token_hex(8)}.part"
    temporary = target.with_name(name)
    _names_in_use.add(name)
    try:
        _write_through(temporary, blocks, target, private=private)
        temporary.replace(target)
        _sync_folder(target.parent)
    finally:
        with suppress(OSError):  # the next file written there removes it
            temporary.unlink(missing_ok=True)
        _names_in_use.discard(name)


def _write_through(path: Path, blocks: Iterable[bytes], target: Path, *, private: bool) -> None:
    """Write a new file to the disk, with the permissions of the target that it will replace."""
    old_status = target.stat() if is_file(target) else None
    # What is to replace a private file is private from its first byte on.
    default_mode = 0o666 if old_status is None and not private else 0o600
    with open(path, "xb", opener=lambda name, flags: os.open(name, flags, default_mode)) as file:
        file.writelines(blocks)
        if old_status is not None and hasattr(os, "fchown"):  # Windows has other permissions
            _pass_on_permissions(target, old_status, file.fileno())
        file.flush()
        os.fsync(file.fileno())


def _pass_on_permissions(target: Path, old_status: os.stat_result, handle: int) -> None:
    """Give an open file the owner, group, mode and access list of a file, as far as allowed."""
    mode = stat.S_IMODE(old_status.st_mode)
    with suppress(OSError):
        os.fchown(handle, old_status.st_uid, -1)  # which is for root alone
    with suppress(OSError):
        os.fchown(handle, -1, old_status.st_gid)
    status = os.fstat(handle)
    if (status.st_uid, status.st_gid) != (old_status.st_uid, old_status.st_gid):
        mode &= 0o777  # no setuid or setgid bit is passed on
    if status.st_gid != old_status.st_gid:  # another group may do what all others may
        mode = mode & ~0o070 | (mode & 0o007) << 3
    if hasattr(os, "removexattr"):
        with suppress(OSError):  # which a folder gives to what is made in it
            os.removexattr(handle, _ACCESS_LIST)
    os.fchmod(handle, mode)
    names: list[str] = []
    if hasattr(os, "listxattr"):
        with suppress(OSError):  # of a file system without attributes
            names = os.listxattr(target)
    for name in names:
        has_group = status.st_gid == old_status.st_gid  # a list has rights of the group, too
        if name.startswith("user.") or (name == _ACCESS_LIST and has_group):
            with suppress(OSError):
                os.setxattr(handle, name, os.getxattr(target, name))


def _sync_folder(folder: Path) -> None:
    """Flush the folder, so that the new name survives a power cut."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    except PermissionError:  # a folder may be writable and yet closed to reading
        return
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _host() -> str:
    """Return whose process numbers ours are: this computer's since it started, in a namespace."""
    facts = platform.node()
    if sys.platform == "linux":
        try:
            facts += _kept_text(_BOOT) + str(_NAMESPACE.readlink())
        except OSError:
            facts = secrets.token_hex(8)  # of no process, so that no file in use is removed
    return f"{zlib.crc32(facts.encode()):08x}"


@cache
def _kept_text(path: Path) -> str:
    """Return the text of a file that does not change while the computer runs."""
    return path.read_text(encoding="ascii")


def _is_left(name: str, process: int) -> bool:
    """Return whether a hidden file of a process of this computer is no longer being written."""
    return name not in _names_in_use if process == os.getpid() else _is_gone(process)


def _is_gone(process: int) -> bool:
    """Return whether a process has ended; False on Windows, where asking would end it."""
    if os.name == "nt":
        return False
    try:
        os.kill(process, 0)
        state = Path(f"/proc/{process}/stat").read_text(encoding="ascii", errors="replace")
    except (OSError, OverflowError) as error:
        return isinstance(error, ProcessLookupError)
    return state.rpartition(")")[2].split()[:1] in (["Z"], ["X"])  # ended, and not yet waited for

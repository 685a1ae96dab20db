"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import secrets
from pathlib import Path

from struck.errors import FileFormatError


def write_bytes(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file so that readers see the old content or the new, never a part.

    The data goes to a hidden file in the same folder, is flushed to the disk and then renamed;
    on a failure or an interruption the hidden file is removed and `path` stays as it was. A
    symbolic link is followed.

    Parameters
    ----------
    path : path
        Where to write; its folder must exist.
    data : bytes
        The whole content.

    Raises
    ------
    FileFormatError
        When the folder is missing or closed to us, `path` is not an ordinary file, or the disk
        refuses.
    """
    target = Path(os.path.realpath(path))
    try:
        _require_place(target, path)
        _replace(target, data)
    except PermissionError as error:
        raise FileFormatError(
            f"{path} cannot be written: {target.parent} allows no new files here; "
            "give another folder or ask for the permission"
        ) from error
    except OSError as error:
        raise FileFormatError(
            f"{path} cannot be written ({error.strerror or error}): free some space, or give "
            "another name or folder"
        ) from error


def _require_place(target: Path, path: str | os.PathLike[str]) -> None:
    if target.is_dir():
        raise FileFormatError(f"{path} is a folder: add the name of a file in it")
    if target.exists() and not target.is_file():
        raise FileFormatError(f"{path} is not an ordinary file: give another name")
    if not target.parent.is_dir():
        raise FileFormatError(
            f"{path} cannot be written: the folder {target.parent} does not exist; make it first"
        )


def _replace(target: Path, data: bytes) -> None:
    temporary = target.with_name(f".struck-{secrets.token_hex(8)}.part")
    try:
        _write_through(temporary, data)
        temporary.replace(target)
        _sync_folder(target.parent)
    finally:
        temporary.unlink(missing_ok=True)


def _write_through(path: Path, data: bytes) -> None:
    with path.open("xb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    """Make the new name itself survive a power cut, where folders can be opened for that."""
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

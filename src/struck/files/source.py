"""Bytes of a mesh file: opened, unpacked and counted before anything looks into them."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from io import BufferedIOBase
from pathlib import Path
from typing import IO

from struck.errors import MeshError
from struck.files.limits import Limits

FORMATS = ("obj", "stl", "ply", "off", "glb", "gltf")
PACKINGS = ("gz", "bz2", "xz", "zip")
CHUNK = 2**14
# Meshes as text pack ten to one; what packs better than this, and is no small file, is a trap.
_HIGHEST_RATIO = 200
_SMALL = 16 * 2**20
_SEPARATORS = re.compile(r"[/\\]")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Source:
    """A mesh file in memory.

    Parameters
    ----------
    kind : str
        One of `FORMATS`, by the file's name.
    data : bytes
        Its content, unpacked.
    beside : callable
        From the name of another file beside it to the content of that; raises `MeshError`.
    """

    kind: str
    data: bytes
    beside: Callable[[str], bytes]


def kind_of(name: str) -> str:
    """Return the mesh format that a file's name promises.

    Raises
    ------
    MeshError
        When it promises none that is read here.
    """
    suffix = Path(name).suffix
    if suffix[1:].lower() not in FORMATS:
        raise MeshError(
            f"its extension {suffix!r} names no mesh format read here: use one of "
            f"{', '.join(FORMATS)}, or one of them packed as {', '.join(PACKINGS)}"
        )
    return suffix[1:].lower()


def open_regular(path: Path, limits: Limits) -> IO[bytes]:
    """Open an ordinary file that is not too large.

    Raises
    ------
    MeshError
        When it is missing, closed to us, empty, too large, a folder, a pipe or a device.
    """
    try:
        # Opening a pipe would wait for its writer.
        if not stat.S_ISREG(path.stat().st_mode) and not path.is_dir():
            raise MeshError("it is a pipe or a device: copy its content to an ordinary file")
        file = path.open("rb")
    except (OSError, ValueError) as error:
        raise MeshError(
            f"it cannot be opened ({getattr(error, 'strerror', None) or error}): check the name "
            "and the permissions"
        ) from error
    size = os.fstat(file.fileno()).st_size
    if not 0 < size <= limits.size:
        file.close()
        require_size(size, limits)
        raise MeshError("it is empty (0 bytes): export it again")
    return file


def require_size(size: int, limits: Limits) -> None:
    """Refuse more bytes than a file may take up.

    Raises
    ------
    MeshError
        With the bound and the way out.
    """
    if size > limits.size:
        raise MeshError(
            f"it takes up {size} bytes or more, and {limits.size} are read: simplify the surface "
            "(decimate it), or export it in a binary format"
        )


def gathered(
    chunks: Iterable[bytes], limits: Limits, *, packed: Callable[[], int] | None = None
) -> bytes:
    """Join the pieces of a file, as long as they stay within bounds.

    Parameters
    ----------
    chunks : iterable of bytes
        Pieces, each made only when asked for.
    limits : Limits
        Their sizes count together.
    packed : callable, optional
        Tells, where they were packed, how many packed bytes have been taken so far.

    Raises
    ------
    MeshError
        When there are more, or they were packed tighter than any mesh.
    """
    data = bytearray()
    for chunk in chunks:
        data += chunk
        require_size(len(data), limits)
        if packed is not None and len(data) > max(_SMALL, _HIGHEST_RATIO * packed()):
            raise MeshError(
                f"its first {packed()} bytes unpack to {len(data)}, and no mesh packs better than "
                f"{_HIGHEST_RATIO} to 1: unpack it yourself if you trust it"
            )
    return bytes(data)


def pieces_of(file: IO[bytes] | BufferedIOBase) -> Iterator[bytes]:
    """Read a file piece by piece."""
    return iter(lambda: file.read(CHUNK), b"")


def require_beside(name: str) -> None:
    """Refuse names that lead elsewhere: up, to the root, to another drive or to the net.

    Raises
    ------
    MeshError
        With the name.
    """
    steps = _SEPARATORS.split(name)
    if not steps[0] or not steps[-1] or ".." in steps or re.search(r"[:\0]", name):
        raise MeshError(
            f"it names {name[:80]!r}, and only files beside or below it are read: put it there, "
            "or export one file with everything inside"
        )


def plain_source(path: Path, limits: Limits) -> Source:
    """Read a mesh file that is not packed.

    Raises
    ------
    MeshError
        When it, or a file that it names, cannot be read within bounds.
    """
    kind = kind_of(path.name)
    with open_regular(path, limits) as file:
        data = gathered(pieces_of(file), limits)
    return Source(kind=kind, data=data, beside=Folder(path.parent, limits, taken=len(data)).read)


class Folder:
    """The files beside a mesh file, which count with it."""

    def __init__(self, folder: Path, limits: Limits, *, taken: int) -> None:
        self._folder, self._limits, self._taken = folder, limits, taken

    def read(self, name: str) -> bytes:
        """Return the content of a file.

        Raises
        ------
        MeshError
            When it lies elsewhere, cannot be read, or is too large.
        """
        require_beside(name)
        try:
            with open_regular(self._folder / name, self._limits) as file:
                data = gathered(pieces_of(file), self._limits)
        except MeshError as error:
            raise MeshError(f"{name[:80]!r}, which it names, fails: {error}") from error
        self._taken += len(data)
        require_size(self._taken, self._limits)
        return data

"""Bytes of a mesh file, plain or packed as gz, bz2, xz or zip, read within bounds."""

from __future__ import annotations

import bz2
import gzip
import lzma
import os
import re
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from io import BufferedIOBase
from pathlib import Path
from typing import IO

from struck.errors import MeshError
from struck.files.atomic import open_ordinary, unread
from struck.files.messages import FORMATS, PACKINGS, ReadingLimits
from struck.files.recognition import explain_not_surface, recognise

CHUNK = 2**14
# Meshes as text pack ten to one; a large file that packs better than this is a trap.
_HIGHEST_RATIO = 200
_SMALL = 16 * 2**20
_SEPARATORS = re.compile(r"[/\\]")
_MAGIC = (b"\x1f\x8b\x08", b"BZh", b"\xfd7zXZ\0", b"PK\3\4", b"7z\xbc\xaf", b"Rar!")
_MOST_MEMBERS = 1000
# The end of a zip file: a record of 22 bytes with a comment of up to 64 KiB after it.
_END = 22 + 2**16
_LARGEST_DIRECTORY = 2**20
_UNPACKING = 128 * 2**20
_UNPACKING_ERRORS = (OSError, EOFError, ValueError, RuntimeError, zlib.error, lzma.LZMAError)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Source:
    """A mesh file in memory: its format, its bytes, and access to the files it names."""

    kind: str  # one of `FORMATS`, by the file's name
    data: bytes  # unpacked content
    beside: Callable[[str], bytes]  # name of a file next to it to that file's content


def open_source(path: Path, limits: ReadingLimits) -> Source:
    """Read a mesh file, packed or not; MeshError when it is damaged or beyond its limits."""
    packing = path.suffix[1:].lower()
    if packing not in PACKINGS:
        kind = kind_of(path.name, path)
        with open_regular(path, limits) as file:
            data = gathered(pieces_of(file), limits)
        return Source(
            kind=kind, data=data, beside=_folder(path.parent, limits, total_size=len(data))
        )
    unpack = _read_zip if packing == "zip" else _read_packed
    try:
        with open_regular(path, limits) as file:
            source = unpack(path, file, limits)
    # zipfile says of a compression it does not know that it is not implemented.
    except (*_UNPACKING_ERRORS, zipfile.BadZipFile, NotImplementedError) as error:
        if isinstance(error, MeshError):
            raise
        raise MeshError(
            f"it cannot be unpacked as {packing} ({' '.join(str(error).split())[:120]}): it is "
            "truncated, damaged, locked or of another kind; pack it again"
        ) from error
    if source.data.startswith(_MAGIC):
        raise MeshError("it holds an archive in an archive: unpack the outer one")
    return source


def kind_of(name: str, path: Path | None = None) -> str:
    """Return the mesh format that a file's name promises; MeshError for formats not read here.

    The error names the kind of the content, too, if there is a `path` to an unpacked file.
    """
    kind = Path(name).suffix[1:].lower()
    if kind not in FORMATS:
        raise MeshError(explain_not_surface(name, None if path is None else recognise(path)))
    return kind


def open_regular(path: Path, limits: ReadingLimits) -> IO[bytes]:
    """Open an ordinary file within the size limit; MeshError on folders, pipes and devices."""
    try:
        file = open_ordinary(path)
    except (OSError, ValueError) as error:
        raise MeshError(f"it {unread(path, error)}") from error
    size = os.fstat(file.fileno()).st_size
    if not 0 < size <= limits.size:
        file.close()
        require_size(size, limits)
        raise MeshError("it is empty (0 bytes): export it again")
    return file


def require_size(size: int, limits: ReadingLimits) -> None:
    """Raise a MeshError when a file has more bytes than the limit."""
    if size > limits.size:
        raise MeshError(
            f"it takes up {size} bytes or more, and {limits.size} are read: simplify the surface "
            "(decimate it), or export it in a binary format"
        )


def gathered(
    chunks: Iterable[bytes], limits: ReadingLimits, *, packed: Callable[[], int] | None = None
) -> bytes:
    """Join the chunks of a file while they stay within its size limit and packing ratio."""
    data = bytearray()
    for chunk in chunks:
        data += chunk
        require_size(len(data), limits)
        if packed is not None:
            require_ratio(len(data), packed())
    return bytes(data)


def require_ratio(unpacked_size: int, packed_size: int) -> None:
    """Raise a MeshError when bytes unpack to more than any honest file of that size does."""
    if unpacked_size > max(_SMALL, _HIGHEST_RATIO * packed_size):
        raise MeshError(
            f"its first {packed_size} bytes unpack to {unpacked_size}, and no honest file packs "
            f"better than {_HIGHEST_RATIO} to 1: unpack it yourself if you trust it"
        )


def pieces_of(file: IO[bytes] | BufferedIOBase) -> Iterator[bytes]:
    """Read a file in chunks of `CHUNK` bytes."""
    return iter(lambda: file.read(CHUNK), b"")


def require_beside(name: str) -> None:
    """Refuse file names that lead up, to the root, to another drive or to the net."""
    steps = _SEPARATORS.split(name)
    if not steps[0] or not steps[-1] or ".." in steps or re.search(r"[:\0]", name):
        raise MeshError(
            f"it names {name[:80]!r}, and only files beside or below it are read: put it there, "
            "or export one file with everything inside"
        )


def _folder(folder: Path, limits: ReadingLimits, *, total_size: int) -> Callable[[str], bytes]:
    """Return a reader of the files next to a mesh file, whose sizes count with it."""

    def read(name: str) -> bytes:
        nonlocal total_size
        require_beside(name)
        try:
            with open_regular(folder / name, limits) as file:
                data = gathered(pieces_of(file), limits)
        except MeshError as error:
            raise MeshError(f"{name[:80]!r}, which it names, fails: {error}") from error
        total_size += len(data)
        require_size(total_size, limits)
        return data

    return read


def _read_packed(path: Path, file: IO[bytes], limits: ReadingLimits) -> Source:
    """Unpack one gz, bz2 or xz file; its name without that ending gives the format inside."""
    kind = kind_of(path.stem)
    data = gathered(_UNPACKERS[path.suffix[1:].lower()](file), limits, packed=file.tell)
    if not data:
        raise MeshError("it is empty once unpacked (0 bytes): pack it again")
    return Source(kind=kind, data=data, beside=_folder(path.parent, limits, total_size=len(data)))


def _streams(
    make: Callable[[], bz2.BZ2Decompressor | lzma.LZMADecompressor],
) -> Callable[[IO[bytes]], Iterator[bytes]]:
    """Return a reader of streams that follow each other, which unpacks one chunk at a time."""

    def unpacked(file: IO[bytes]) -> Iterator[bytes]:
        data = file.read(CHUNK)
        while data:
            stream = make()
            while not stream.eof:
                yield stream.decompress(data, CHUNK)
                data = b""
                if stream.needs_input and not stream.eof:
                    data = file.read(CHUNK)
                    if not data:
                        raise EOFError("it ends in the middle")
            data = stream.unused_data or file.read(CHUNK)

    return unpacked


_UNPACKERS: dict[str, Callable[[IO[bytes]], Iterator[bytes]]] = {
    "gz": lambda file: pieces_of(gzip.GzipFile(fileobj=file, mode="rb")),
    "bz2": _streams(bz2.BZ2Decompressor),
    "xz": _streams(partial(lzma.LZMADecompressor, memlimit=_UNPACKING)),
}


def _read_zip(_: Path, file: IO[bytes], limits: ReadingLimits) -> Source:
    """Unpack the only mesh of a zip file, with its buffers if it is glTF."""
    _require_small_directory(file)
    with zipfile.ZipFile(file) as archive:
        members = [member for member in archive.infolist() if not member.is_dir()]
        for member in members:
            _require_harmless(member)
        mesh = _only_mesh(members)
        kind = kind_of(mesh.filename)
        folder = mesh.filename.rpartition("/")[0]
        needed_members = [mesh]
        if kind == "gltf":
            needed_members += [item for item in members if item.filename.endswith(".bin")]
        require_size(sum(member.file_size for member in needed_members), limits)
        contents = {item.filename: _unzip(archive, file, item, limits) for item in needed_members}
    if not contents[mesh.filename]:
        raise MeshError("it is empty once unpacked (0 bytes): pack it again")
    return Source(kind=kind, data=contents[mesh.filename], beside=_among(contents, folder))


def _unzip(
    archive: zipfile.ZipFile, file: IO[bytes], member: zipfile.ZipInfo, limits: ReadingLimits
) -> bytes:
    """Unpack one member, at most to the size that the archive states."""
    with archive.open(member) as content:
        return gathered(
            pieces_of(content), limits, packed=lambda: file.tell() - member.header_offset
        )


def _among(members: dict[str, bytes], folder: str) -> Callable[[str], bytes]:
    def read(name: str) -> bytes:
        require_beside(name)
        place = f"{folder}/{name}" if folder else name
        if place not in members:
            raise MeshError(
                f"it needs {name[:80]!r}, and the archive has no {place[:80]!r}: add it"
            )
        return members[place]

    return read


def _require_small_directory(file: IO[bytes]) -> None:
    """Refuse tables of contents that take longer to read than any mesh."""
    size = file.seek(0, 2)
    file.seek(max(0, size - _END))
    end = file.read()
    record = end[end.rfind(b"PK\5\6") :]
    directory = int.from_bytes(record[12:16], "little")
    if b"PK\6\7" in end or directory > _LARGEST_DIRECTORY:
        raise MeshError(
            f"its table of contents is larger than {_LARGEST_DIRECTORY} bytes, or it is of the "
            "kind for files above 4 GB: pack the mesh alone"
        )
    file.seek(0)


def _require_harmless(member: zipfile.ZipInfo) -> None:
    require_beside(member.filename)
    if member.compress_type not in {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED}:
        raise MeshError(f"it is packed by method {member.compress_type} of zip: pack it by deflate")
    if stat.S_ISLNK(member.external_attr >> 16):
        raise MeshError(f"it holds a link, {member.filename[:80]!r}: pack the file itself")
    if member.filename.lower().endswith(tuple(f".{packing}" for packing in PACKINGS)):
        raise MeshError(
            f"it holds an archive in an archive, {member.filename[:80]!r}: unpack the outer one"
        )


def _only_mesh(members: list[zipfile.ZipInfo]) -> zipfile.ZipInfo:
    if len(members) > _MOST_MEMBERS:
        raise MeshError(
            f"it holds {len(members)} files, and {_MOST_MEMBERS} are taken: pack the mesh alone"
        )
    meshes = [
        member
        for member in members
        if member.filename.lower().endswith(tuple(f".{kind}" for kind in FORMATS))
        and not member.filename.startswith("__MACOSX/")
    ]
    if len(meshes) != 1:
        raise MeshError(
            f"it holds {len(meshes)} mesh files ({', '.join(FORMATS)}), and one is read: pack the "
            "mesh alone"
        )
    return meshes[0]

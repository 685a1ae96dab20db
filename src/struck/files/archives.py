"""Packed mesh files: gz, bz2, xz and zip, unpacked in memory and within bounds."""

from __future__ import annotations

import bz2
import gzip
import lzma
import stat
import zipfile
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO

from struck.errors import MeshError
from struck.files.limits import Limits
from struck.files.source import (
    CHUNK,
    FORMATS,
    PACKINGS,
    Folder,
    Source,
    gathered,
    kind_of,
    open_regular,
    pieces_of,
    plain_source,
    require_beside,
    require_size,
)

_MAGIC = (b"\x1f\x8b\x08", b"BZh", b"\xfd7zXZ\0", b"PK\3\4", b"7z\xbc\xaf", b"Rar!")
_MOST_MEMBERS = 1000
# The end of a zip file: a record of 22 bytes with a comment of up to 64 KiB after it.
_END = 22 + 2**16
_LARGEST_DIRECTORY = 2**20
_UNPACKING = 128 * 2**20
_DAMAGED = (OSError, EOFError, ValueError, RuntimeError, zlib.error, lzma.LZMAError)


def open_source(path: Path, limits: Limits) -> Source:
    """Read a mesh file, packed or not.

    Raises
    ------
    MeshError
        When it cannot be read within bounds, or its name promises no mesh.
    """
    packing = path.suffix[1:].lower()
    if packing not in PACKINGS:
        return plain_source(path, limits)
    unpack = _zipped if packing == "zip" else _packed
    try:
        with open_regular(path, limits) as file:
            source = unpack(path, file, limits)
    # zipfile says of a compression it does not know that it is not implemented.
    except (*_DAMAGED, zipfile.BadZipFile, NotImplementedError) as error:
        if isinstance(error, MeshError):
            raise
        raise MeshError(
            f"it cannot be unpacked as {packing} ({' '.join(str(error).split())[:120]}): it is "
            "truncated, damaged, locked or of another kind; pack it again"
        ) from error
    if source.data.startswith(_MAGIC):
        raise MeshError("it holds an archive in an archive: unpack the outer one")
    return source


def _packed(path: Path, file: IO[bytes], limits: Limits) -> Source:
    """Unpack one file, whose name is that of the archive less its ending."""
    kind = kind_of(path.stem)
    chunks = _UNPACKED[path.suffix[1:].lower()](file)
    data = gathered(chunks, limits, packed=file.tell)
    if not data:
        raise MeshError("it is empty once unpacked (0 bytes): pack it again")
    return Source(kind=kind, data=data, beside=Folder(path.parent, limits, taken=len(data)).read)


def _gunzipped(file: IO[bytes]) -> Iterator[bytes]:
    with gzip.GzipFile(fileobj=file, mode="rb") as unpacked:
        yield from pieces_of(unpacked)


def _streams(
    make: Callable[[], bz2.BZ2Decompressor | lzma.LZMADecompressor],
) -> Callable[[IO[bytes]], Iterator[bytes]]:
    """Return how to unpack streams that follow each other, never more than a piece at once."""

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


def _xz_stream() -> lzma.LZMADecompressor:
    return lzma.LZMADecompressor(memlimit=_UNPACKING)


_UNPACKED: dict[str, Callable[[IO[bytes]], Iterator[bytes]]] = {
    "gz": _gunzipped,
    "bz2": _streams(bz2.BZ2Decompressor),
    "xz": _streams(_xz_stream),
}


def _zipped(_: Path, file: IO[bytes], limits: Limits) -> Source:
    """Unpack the one mesh of a zip file, and the buffers below its folder where it is glTF."""
    _require_small_directory(file)
    with zipfile.ZipFile(file) as archive:
        members = [member for member in archive.infolist() if not member.is_dir()]
        for member in members:
            _require_harmless(member)
        mesh = _only_mesh(members)
        kind = kind_of(mesh.filename)
        folder = mesh.filename.rpartition("/")[0]
        used = [mesh]
        if kind == "gltf":
            used += [each for each in members if each.filename.endswith(".bin")]
        require_size(sum(member.file_size for member in used), limits)
        found = {each.filename: _unzipped(archive, file, each, limits) for each in used}
    if not found[mesh.filename]:
        raise MeshError("it is empty once unpacked (0 bytes): pack it again")
    return Source(kind=kind, data=found[mesh.filename], beside=_among(found, folder))


def _unzipped(
    archive: zipfile.ZipFile, file: IO[bytes], member: zipfile.ZipInfo, limits: Limits
) -> bytes:
    """Unpack one member; it ends at the latest where it said it would."""
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

"""The container of model files: tensors and text in safetensors form, sealed by a SHA-256.

The bytes are written here, not by the safetensors package, whose order of metadata changes from
run to run; the same content gives the same file. They are read back by that package.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from struck.errors import FileFormatError

_LONGEST_HEADER = 16 * 2**20
_DTYPES = {"float64": "F64", "float32": "F32", "uint32": "U32"}
_UNSEALED = "0" * 64
_SEAL = re.compile(rb'"sha256"\s*:\s*"([0-9a-f]{64})"')
_AGAIN = "copy it again from its source, or save the model again"


def pack(tensors: Mapping[str, NDArray[Any]], metadata: Mapping[str, str]) -> bytes:
    """Return a safetensors file.

    Parameters
    ----------
    tensors : mapping
        Arrays of float64, float32 or uint32 by name.
    metadata : mapping
        Text by name; ``sha256`` is added.

    Raises
    ------
    FileFormatError
        When the metadata would exceed 16 MiB.
    """
    # Widest items first: then every tensor starts at a multiple of its own item's size.
    ordered = dict(sorted(tensors.items(), key=lambda item: (-item[1].itemsize, item[0])))
    header = _header(ordered, {**metadata, "sha256": _UNSEALED})
    if len(header) > _LONGEST_HEADER:
        raise FileFormatError(
            f"names, places and provenance take {len(header)} bytes of at most {_LONGEST_HEADER}: "
            "keep large tables elsewhere"
        )
    start = len(header).to_bytes(8, "little")
    blocks = [array.astype(array.dtype.newbyteorder("<")).tobytes() for array in ordered.values()]
    digest = _sha256(start, header, *blocks)
    return b"".join([start, header.replace(_UNSEALED.encode(), digest.encode(), 1), *blocks])


def _header(tensors: Mapping[str, NDArray[Any]], metadata: Mapping[str, str]) -> bytes:
    # The seal comes first, so that nothing before it can look like it.
    first = {"sha256": metadata["sha256"], **metadata}
    entries: dict[str, Any] = {"__metadata__": first}
    offset = 0
    for name, array in tensors.items():
        end = offset + array.nbytes
        kind = _DTYPES[array.dtype.name]
        entries[name] = {"dtype": kind, "shape": list(array.shape), "data_offsets": [offset, end]}
        offset = end
    text = json.dumps(entries, separators=(",", ":")).encode()
    return text + b" " * (-len(text) % 8)


def _sha256(*blocks: bytes | memoryview) -> str:
    digest = hashlib.sha256()
    for block in blocks:
        digest.update(block)
    return digest.hexdigest()


def unpack(data: bytes, *, kind: str, newest: int) -> tuple[dict[str, str], dict[str, Any]]:
    """Return the metadata and tensors of a safetensors file whose seal is intact.

    Parameters
    ----------
    data : bytes
        The whole file.
    kind : str
        What the metadata key ``format`` must say.
    newest : int
        The highest ``version`` that the caller understands.

    Raises
    ------
    FileFormatError
        When the file is of another format or newer, damaged or truncated.
    """
    from safetensors import SafetensorError
    from safetensors.numpy import load

    end = _header_end(data)
    metadata = _metadata(data[8:end])
    if metadata.get("format") != kind:
        raise FileFormatError(
            f"its format is {metadata.get('format')!r} and not {kind!r}: give a .{kind} file"
        )
    _require_version(metadata.get("version", ""), newest)
    _require_seal(data, end)
    try:
        return metadata, load(data)
    except SafetensorError as error:
        raise FileFormatError(f"its tensors cannot be read ({error}): {_AGAIN}") from error


def _header_end(data: bytes) -> int:
    length = int.from_bytes(data[:8], "little")
    if len(data) < 8 or not 2 <= length <= _LONGEST_HEADER:
        raise FileFormatError(
            f"it does not begin like a model file (a header of {length} bytes, with 2 to "
            f"{_LONGEST_HEADER} allowed): {_AGAIN}"
        )
    if 8 + length > len(data):
        raise FileFormatError(
            f"it ends after {len(data)} bytes, within its header of {length}: {_AGAIN}"
        )
    return 8 + length


def _metadata(header: bytes) -> dict[str, str]:
    try:
        metadata = json.loads(header)["__metadata__"]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise FileFormatError(f"its header cannot be read, it is damaged: {_AGAIN}") from error
    if not isinstance(metadata, dict) or not all(isinstance(v, str) for v in metadata.values()):
        raise FileFormatError(f"its header holds no text, it is damaged: {_AGAIN}")
    return metadata


def _require_version(version: str, newest: int) -> None:
    if not re.fullmatch(r"[1-9][0-9]{0,5}", version):
        raise FileFormatError(f"its version is {version!r}, no number, it is damaged: {_AGAIN}")
    if int(version) > newest:
        raise FileFormatError(
            f"its version is {version}, and this struck reads up to {newest}: update struck"
        )


def _require_seal(data: bytes, header_end: int) -> None:
    seal = _SEAL.search(data, 8, header_end)
    view = memoryview(data)
    if seal is None or seal[1].decode() != _sha256(
        view[: seal.start(1)], _UNSEALED.encode(), view[seal.end(1) :]
    ):
        raise FileFormatError(
            f"its content does not match its SHA-256, it is damaged or truncated: {_AGAIN}"
        )

"""The container of model files: tensors and text in safetensors form, sealed by a SHA-256.

The bytes are written here, not by the safetensors package, whose order of metadata changes from
run to run; the same content gives the same file. They are read back by that package. The cache
keeps any dataclasses of arrays in such containers (`to_bytes`): the bytes name the dataclasses,
and only those that the reader expects are made, so that nothing in them chooses code.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from operator import attrgetter
from typing import Any, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import FileFormatError, StruckError, rounded
from struck.model.arrays import AnyArray, Array, Complex
from struck.model.gains import Gains
from struck.model.mesh import Mesh

FARTHEST = 1e9  # m: coordinates beyond it are refused, so that their squares stay finite
_VERSION = 1  # of what `to_bytes` writes
_FORMAT = "struck-packing"
_LARGEST = 2**32 - 1
_LONGEST_HEADER = 16 * 2**20
_DTYPES = {"float64": "F64", "float32": "F32", "uint32": "U32"}
_UNSEALED = "0" * 64
_SEAL = re.compile(rb'"sha256"\s*:\s*"([0-9a-f]{64})"')
# What Python raises where content has another form than is read.
UNEXPECTED = (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError)
_MAX_SHOWN = 60  # characters of a value in a message
_AGAIN = "copy it again from its source, or save the model again"

Arrays = dict[str, AnyArray]
Tensors = Mapping[str, AnyArray]
Text = Mapping[str, Any]


def pack(tensors: Mapping[str, AnyArray], metadata: Mapping[str, str]) -> bytes:
    """Return the bytes of a safetensors file with a SHA-256 among its metadata."""
    # Widest items first: then every tensor starts at a multiple of its item's size.
    ordered_tensors = dict(sorted(tensors.items(), key=lambda item: (-item[1].itemsize, item[0])))
    header = _header(ordered_tensors, {**metadata, "sha256": _UNSEALED})
    if len(header) > _LONGEST_HEADER:
        raise FileFormatError(
            f"names, places and provenance take {len(header)} bytes of at most {_LONGEST_HEADER}: "
            "keep large tables elsewhere"
        )
    start = len(header).to_bytes(8, "little")
    blocks = [
        array.astype(array.dtype.newbyteorder("<")).tobytes() for array in ordered_tensors.values()
    ]
    digest = _sha256(start, header, *blocks)
    return b"".join([start, header.replace(_UNSEALED.encode(), digest.encode(), 1), *blocks])


def _header(tensors: Mapping[str, AnyArray], metadata: Mapping[str, str]) -> bytes:
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
    """Return metadata and tensors of a sealed file; FileFormatError when damaged or newer."""
    from safetensors import SafetensorError
    from safetensors.numpy import load

    end, metadata = _read_header(data)
    if metadata.get("format") != kind:
        raise FileFormatError(
            f"its format is {metadata.get('format')!r} and not {kind!r}: give a .{kind} file"
        )
    version = metadata.get("version", "")
    if not re.fullmatch(r"[1-9][0-9]{0,5}", version):
        raise FileFormatError(f"its version is {version!r}, no number, it is damaged: {_AGAIN}")
    if int(version) > newest:
        raise FileFormatError(
            f"its version is {version}, and this struck reads up to {newest}: update struck"
        )
    _require_seal(data, end)
    try:
        return metadata, load(data)
    except SafetensorError as error:
        raise FileFormatError(f"its tensors cannot be read ({error}): {_AGAIN}") from error


def _read_header(data: bytes) -> tuple[int, dict[str, str]]:
    """Return where the header ends, and the texts in it."""
    length = int.from_bytes(data[:8], "little")
    if len(data) < 8:
        raise FileFormatError(f"it is too short for a model file, {len(data)} bytes: {_AGAIN}")
    if not 2 <= length <= _LONGEST_HEADER:
        raise FileFormatError(
            f"it does not begin like a model file (a header of {length} bytes, with 2 to "
            f"{_LONGEST_HEADER} allowed): {_AGAIN}"
        )
    if 8 + length > len(data):
        raise FileFormatError(
            f"it ends after {len(data)} bytes, within its header of {length}: {_AGAIN}"
        )
    try:
        metadata = json.loads(data[8 : 8 + length])["__metadata__"]
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise FileFormatError(f"its header cannot be read, it is damaged: {_AGAIN}") from error
    if not isinstance(metadata, dict) or not all(isinstance(v, str) for v in metadata.values()):
        raise FileFormatError(f"its header holds no text, it is damaged: {_AGAIN}")
    return 8 + length, metadata


def _require_seal(data: bytes, header_end: int) -> None:
    seal = _SEAL.search(data, 8, header_end)
    view = memoryview(data)
    if seal is None or seal[1].decode() != _sha256(
        view[: seal.start(1)], _UNSEALED.encode(), view[seal.end(1) :]
    ):
        raise FileFormatError(
            f"its content does not match its SHA-256, it is damaged or truncated: {_AGAIN}"
        )


# Dataclasses of arrays, numbers and text as bytes, and back


def to_bytes(value: object, kinds: tuple[type, ...]) -> bytes:
    """Return dataclasses, mappings, tuples, lists, arrays and numbers as sealed bytes."""
    arrays: Arrays = {}
    text = json.dumps(to_plain(value, kinds, arrays), separators=(",", ":"))
    return pack(arrays, {"format": _FORMAT, "version": str(_VERSION), "json": text})


def from_bytes(data: bytes, kinds: tuple[type, ...]) -> Any:  # noqa: ANN401  as given to to_bytes
    """Return the value that `to_bytes` was given, made of the dataclasses `kinds` alone."""
    metadata, arrays = unpack(data, kind=_FORMAT, newest=_VERSION)
    try:
        return from_plain(
            json.loads(metadata["json"]), {kind.__name__: kind for kind in kinds}, arrays
        )
    except StruckError as error:
        raise FileFormatError(str(error)) from error
    except UNEXPECTED as error:
        raise FileFormatError(
            f"its content is not as the format demands ({error!r}): {_AGAIN}"
        ) from error


def to_plain(value: object, kinds: tuple[type, ...], arrays: Arrays) -> Any:  # noqa: ANN401  JSON
    """Return a value as JSON holds it, and put its arrays into `arrays`."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return {"array": _put(value, arrays)}
    if isinstance(value, tuple | list):
        return {type(value).__name__: [to_plain(item, kinds, arrays) for item in value]}
    if isinstance(value, Mapping) and all(isinstance(name, str) for name in value):
        pairs = value.items()
        return {"mapping": [[name, to_plain(item, kinds, arrays)] for name, item in pairs]}
    if type(value) in kinds and is_dataclass(value):
        field_names = [field.name for field in fields(value) if field.init]
        content = {name: to_plain(getattr(value, name), kinds, arrays) for name in field_names}
        return {type(value).__name__: content}
    raise FileFormatError(f"{type(value).__name__} cannot be kept as bytes")


def _put(array: AnyArray, arrays: Arrays) -> list[str]:
    """Add an array as a type that containers hold; return its name and its own type."""
    dtype = array.dtype.name
    name = f"array{len(arrays)}"
    is_index = dtype == "int64" and (not array.size or 0 <= array.min() <= array.max() <= _LARGEST)
    if dtype in _DTYPES:
        arrays[name] = array
    elif dtype == "bool" or is_index:
        arrays[name] = array.astype(np.uint32)
    elif dtype == "complex128":
        arrays[name] = _in_pairs(array)
    else:
        raise FileFormatError(f"an array of {dtype} cannot be kept as bytes")
    return [name, dtype]


def from_plain(plain: Any, kinds: Mapping[str, type], arrays: Arrays) -> Any:  # noqa: ANN401  JSON
    """Return the value that `to_plain` took, made of the dataclasses in `kinds`."""
    if plain is None or isinstance(plain, bool | int | float | str):
        return plain
    if not isinstance(plain, dict) or len(plain) != 1:
        raise FileFormatError(f"it holds {_excerpt(plain)} where an object of one key belongs")
    ((tag, content),) = plain.items()
    if type(content).__name__ != ("dict" if tag in kinds else "list"):
        raise FileFormatError(f"it holds {_excerpt(plain)}, which is no value of this format")
    if tag == "array":
        return _take(content, arrays)
    if tag in {"tuple", "list"}:
        parts = [from_plain(part, kinds, arrays) for part in content]
        return tuple(parts) if tag == "tuple" else parts
    if tag == "mapping":
        return {name: from_plain(part, kinds, arrays) for name, part in content}
    arguments = {name: from_plain(part, kinds, arrays) for name, part in content.items()}
    return kinds[tag](**arguments)


def _take(content: list[str], arrays: Arrays) -> AnyArray:
    """Return an array of the type that `_put` was given; other types are refused."""
    name, dtype = content
    array = arrays[name]
    if dtype == array.dtype.name:
        return array
    if dtype in {"bool", "int64"} and array.dtype == np.uint32:
        return array.astype(dtype)
    if dtype == "complex128" and array.dtype == np.float64 and array.shape[-1:] == (2,):
        return from_pairs(array)
    raise FileFormatError(
        f"its array {name!r} is {array.dtype.name} {array.shape}, to be read as {_excerpt(dtype)}: "
        f"give {', '.join(_DTYPES)}, bool or int64 of uint32, or complex128 of pairs"
    )


def _excerpt(value: object) -> str:
    """Return a value as the beginning of its text."""
    return repr(value)[:_MAX_SHOWN]


def _in_pairs(values: Complex) -> Array:
    """Return complex numbers (...) as real and imaginary parts (..., 2)."""
    return np.stack([values.real, values.imag], axis=-1)


def from_pairs(pairs: Array) -> Complex:
    """Return real and imaginary parts (..., 2) as complex numbers (...)."""
    return np.ascontiguousarray(pairs).view(np.complex128)[..., 0]


# What a kind of content looks like in a model file


@dataclass(frozen=True, slots=True)
class Tensor:
    """Type and shape that one array of a file must have."""

    dtype: str  # "float64", "float32" or "uint32"
    shape: tuple[str | int, ...]  # lengths, or letters for lengths that tensors share
    source: str = ""  # attribute that it keeps, such as "waves.parts"; none: kept elsewhere
    optional: bool = False  # may be absent
    gaps: bool = False  # may hold NaN or infinity, for unknown


Layout = Mapping[str, Tensor]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Kind:
    """How files keep one class of gains."""

    made: type[Gains]
    layout: Layout
    # gains to JSON values, and arrays that the layout does not name
    keep: Callable[[Any], tuple[dict[str, Any], Arrays]]
    make: Callable[[Text, Tensors, Mesh | None], Gains]  # the mesh is the body's surface
    version: int = 1  # of model files, the first that has it


def kept_tensors(owner: object, layout: Layout) -> Arrays:
    """Return the arrays of an object that a layout names, as files hold them."""
    tensors: Arrays = {}
    for name, tensor in layout.items():
        value = attrgetter(tensor.source)(owner) if tensor.source else None
        if value is not None:
            array = np.asarray(value)
            values = array.astype(np.uint32) if tensor.dtype == "uint32" else array
            tensors[name] = _in_pairs(array) if array.dtype.kind == "c" else values
    return tensors


def require_layout(tensors: Tensors, layout: Layout) -> None:
    """Refuse tensors of a layout that are missing, or have other types, shapes or gaps."""
    sizes: dict[str, int] = {}
    names = ", ".join(name for name, tensor in layout.items() if not tensor.optional)
    for name, spec in layout.items():
        if name in tensors:
            _require_fit(name, tensors[name], spec, sizes)
        elif not spec.optional:
            raise FileFormatError(f"its tensor {name!r} is missing: write all of {names}")


def _require_fit(name: str, array: AnyArray, spec: Tensor, sizes: dict[str, int]) -> None:
    is_fitting = array.dtype.name == spec.dtype and array.ndim == len(spec.shape)
    if not is_fitting or any(
        size != (length if isinstance(length, int) else sizes.setdefault(length, size))
        for length, size in zip(spec.shape, array.shape, strict=True)
    ):
        raise FileFormatError(
            f"its tensor {name!r} is {array.dtype.name} {array.shape}, not {spec.dtype} "
            f"({', '.join(str(length) for length in spec.shape)}): make the tensors fit"
        )
    if not spec.gaps and not np.isfinite(array).all():
        raise FileFormatError(f"its tensor {name!r} holds numbers that are not finite")


# Values of a model file's JSON


def refuse_constant(name: str) -> NoReturn:
    """Refuse NaN and infinities, which Python reads though JSON has none."""
    raise FileFormatError(f"its metadata holds {name}, which is no number of JSON")


def numbers(value: object, shape: tuple[int, ...]) -> Array:
    """Return a list of numbers as an array of the given shape."""
    array = np.array(value, dtype=np.float64)
    if array.shape != shape:
        raise FileFormatError(f"its metadata holds {array.shape} numbers where {shape} belong")
    return array


def near(places: ArrayLike, name: str) -> Array:
    """Return places, m, once none has a coordinate beyond `FARTHEST`."""
    array = np.array(places, np.float64)
    extent = float(np.abs(array).max(initial=0.0))
    if not extent <= FARTHEST:
        raise FileFormatError(
            f"its {name} goes up to {rounded(extent)} m: at most {rounded(FARTHEST)} m fits"
        )
    return array

"""Dataclasses of arrays, numbers and text as bytes, and back.

The bytes name the dataclasses, and only those that the reader expects are made: nothing in them
chooses code.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError
from struck.files.container import pack, unpack

VERSION = 1
_FORMAT = "struck-packing"
_LARGEST = 2**32 - 1

Arrays = dict[str, NDArray[Any]]


def to_bytes(value: object, kinds: tuple[type, ...]) -> bytes:
    """Return a value as bytes from which `from_bytes` makes the same.

    Parameters
    ----------
    value : object
        Arrays, numbers, text and None, in tuples, lists, mappings by text and dataclasses.
    kinds : tuple of types
        The dataclasses that may occur.

    Raises
    ------
    FileFormatError
        When it holds anything else.
    """
    arrays: Arrays = {}
    text = json.dumps(to_plain(value, kinds, arrays), separators=(",", ":"))
    return pack(arrays, {"format": _FORMAT, "version": str(VERSION), "json": text})


def from_bytes(data: bytes, kinds: tuple[type, ...]) -> Any:  # noqa: ANN401  as given to to_bytes
    """Return the value that `to_bytes` was given; arrays are contiguous.

    Raises
    ------
    FileFormatError
        When the bytes are damaged, or hold a dataclass that is none of `kinds` as they are now.
    StruckError
        When a dataclass refuses what they say.
    """
    metadata, arrays = unpack(data, kind=_FORMAT, newest=VERSION)
    try:
        return from_plain(
            json.loads(metadata["json"]), {kind.__name__: kind for kind in kinds}, arrays
        )
    except (KeyError, TypeError, ValueError, RecursionError) as error:
        raise FileFormatError(f"it holds what is not expected: {error!r}") from error


def to_plain(value: object, kinds: tuple[type, ...], arrays: Arrays) -> Any:  # noqa: ANN401  JSON
    """Return a value as JSON holds it, and put its arrays into `arrays`; see `to_bytes`."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return {"array": _put(value, arrays)}
    if isinstance(value, tuple | list):
        return {type(value).__name__: [to_plain(each, kinds, arrays) for each in value]}
    if isinstance(value, Mapping) and all(isinstance(name, str) for name in value):
        pairs = value.items()
        return {"mapping": [[name, to_plain(each, kinds, arrays)] for name, each in pairs]}
    if type(value) in kinds and is_dataclass(value):
        given = [field.name for field in fields(value) if field.init]
        content = {name: to_plain(getattr(value, name), kinds, arrays) for name in given}
        return {type(value).__name__: content}
    raise FileFormatError(f"{type(value).__name__} cannot be kept as bytes")


def _put(array: NDArray[Any], arrays: Arrays) -> list[str]:
    """Add an array as a type that containers hold; return its name and its own type."""
    own = array.dtype.name
    name = f"array{len(arrays)}"
    if own in {"float64", "float32", "uint32"}:
        arrays[name] = array
    elif own == "bool" or (own == "int64" and (not array.size or _is_index(array))):
        arrays[name] = array.astype(np.uint32)
    elif own == "complex128":
        arrays[name] = np.stack([np.real(array), np.imag(array)], axis=-1)
    else:
        raise FileFormatError(f"an array of {own} cannot be kept as bytes")
    return [name, own]


def _is_index(array: NDArray[np.int64]) -> bool:
    return bool(array.min() >= 0 and array.max() <= _LARGEST)


def from_plain(plain: Any, kinds: Mapping[str, type], arrays: Arrays) -> Any:  # noqa: ANN401  JSON
    """Return the value that `to_plain` took; `kinds` by name."""
    if not isinstance(plain, dict):
        return plain
    ((tag, content),) = plain.items()
    if tag == "array":
        name, own = content
        return _taken(arrays[name], own)
    if tag in {"tuple", "list"}:
        each = [from_plain(part, kinds, arrays) for part in content]
        return tuple(each) if tag == "tuple" else each
    if tag == "mapping":
        return {name: from_plain(part, kinds, arrays) for name, part in content}
    made = {name: from_plain(part, kinds, arrays) for name, part in content.items()}
    return kinds[tag](**made)


def _taken(array: NDArray[Any], own: str) -> NDArray[Any]:
    if own == "complex128":
        return np.ascontiguousarray(array).view(np.complex128)[..., 0]
    return array.astype(own, copy=False)

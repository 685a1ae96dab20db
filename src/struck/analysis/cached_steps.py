"""Cached steps of an analysis: finished stages are kept on disk, and taken up again.

The key of a result is the SHA-256 of the content of everything that it depends on, of struck's own
source, and of the versions of the libraries that compute: a changed method needs no version
number, and two versions side by side never share an entry.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from functools import cache as computed_once
from importlib.metadata import version
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np

from struck.errors import StruckError
from struck.files.cache import Cache
from struck.model.provenance import Progress, silent

T = TypeVar("T")

_LIBRARIES = ("struck", "numpy", "scipy", "rslab", "libigl")
# Formats whose files are complete; other formats may refer to further files.
_SURFACE_ENDINGS = {".obj", ".stl", ".ply", ".off", ".glb"}
# Larger files are read once only, by a reader that knows how much of them to take.
_LARGEST_FILE = 2**30


@dataclass(frozen=True, slots=True, kw_only=True)
class Stage(Generic[T]):
    """A piece of work whose result can be kept."""

    name: str  # of the result, for keys and progress
    pack: Callable[[T], bytes]  # FileFormatError for a result that it cannot
    unpack: Callable[[bytes], T]  # StruckError for bytes that hold no result


def holding(name: str, *kinds: type) -> Stage:
    """Return the stage `name` whose result is made of the dataclasses `kinds`."""

    def pack(value: object) -> bytes:
        from struck.files.container import to_bytes  # only where results are kept

        return to_bytes(value, kinds)

    def unpack(data: bytes) -> Any:  # noqa: ANN401 - made of the kinds
        from struck.files.container import from_bytes

        return from_bytes(data, kinds)

    return Stage(name=name, pack=pack, unpack=unpack)


@dataclass(frozen=True, slots=True, kw_only=True)
class Stages:
    """Stages of one analysis, with where they are kept."""

    cache: Cache | None = None
    progress: Progress = silent  # also called for a result that was there already

    def get_or_compute(self, stage: Stage[T], compute: Callable[[], T], /, **inputs: object) -> T:
        """Return the result of a stage from the cache, or computed from its `inputs` and kept."""
        # Inputs are everything the result depends on, and nothing else. With one whose content
        # cannot be known, as a function, the result is computed and not kept. With a cache, it has
        # been packed and unpacked in both cases, so later steps do not depend on the source.
        cache, key = self.cache, None if self.cache is None else _key(stage.name, inputs)
        if cache is None or key is None:
            return compute()
        cached_value = _load_value(stage, cache, key)
        if cached_value is not None:
            self.progress(f"{stage.name} taken from the cache", 1.0)
            return cached_value
        value = compute()
        has_changed = _key(stage.name, inputs) != key
        return value if has_changed else _store_value(stage, cache, key, value)


def _load_value(stage: Stage[T], cache: Cache, key: str) -> T | None:
    data = cache.get(key)
    if data is None:
        return None
    try:
        return stage.unpack(data)
    except StruckError as error:
        cache.discard(key, str(error))
    except MemoryError:
        cache.say("memory", f"{stage.name}: memory is too short to take up what was kept")
    return None


def _store_value(stage: Stage[T], cache: Cache, key: str, value: T) -> T:
    try:
        data = stage.pack(value)
        again = stage.unpack(data)
    except (StruckError, MemoryError) as error:
        cache.say(stage.name, f"{stage.name}: finished work is not kept: {error!r}")
        return value
    cache.put(key, data)
    return again


class _UnknownContentError(TypeError):
    """An input whose content cannot be known."""


def _key(stage: str, inputs: Mapping[str, object]) -> str | None:
    try:
        return fingerprint((stage, method(), inputs))
    except _UnknownContentError:
        return None


@computed_once
def method() -> str:
    """Return the fingerprint of the method: struck's own source, and the libraries' versions."""
    source = Path(__file__).parents[1]
    files = {
        path.relative_to(source).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in source.rglob("*.py")
    }
    return fingerprint((files, {name: version(name) for name in _LIBRARIES}))


def fingerprint(value: object) -> str:
    """Return a SHA-256 in hexadecimal that equals another's only where type and content do."""
    # It covers numbers, text, arrays, dataclasses of struck, mesh files (by their content), and
    # sequences and mappings of these; TypeError for anything else.
    digest = hashlib.sha256()
    for piece in _pieces(value):
        digest.update(len(piece).to_bytes(8, "little"))
        digest.update(piece)
    return digest.hexdigest()


def _pieces(value: object) -> Sequence[bytes | memoryview]:
    """Return a value as its type and content."""
    if isinstance(value, np.generic):
        value = value.item()
    kind = type(value).__name__.encode()
    if value is None or isinstance(value, bool | int | float | str | bytes):
        return kind, repr(value).encode()
    if isinstance(value, np.ndarray):
        if value.dtype.hasobject:
            raise _UnknownContentError(f"an array of {value.dtype}")
        flat = np.ascontiguousarray(value).reshape(-1).view(np.uint8)
        return b"array", value.dtype.str.encode(), repr(value.shape).encode(), flat.data
    if isinstance(value, Path):
        return b"file", _file_digest(value)
    return kind, *(fingerprint(part).encode() for part in _parts(value))


def _parts(value: object) -> Iterable[object]:
    """Return the parts of a value, in order."""
    if isinstance(value, tuple | list):
        return value
    if isinstance(value, Mapping):
        return value.items()
    # The class of another package may compute otherwise tomorrow, unnoticed.
    if is_dataclass(value) and type(value).__module__.partition(".")[0] == "struck":
        values = {field.name: getattr(value, field.name) for field in fields(value)}
        return type(value).__qualname__, *values.items()
    raise _UnknownContentError(f"the content of {type(value).__name__} cannot be known")


def _file_digest(path: Path) -> bytes:
    try:
        if path.suffix.lower() not in _SURFACE_ENDINGS or not path.is_file():
            raise _UnknownContentError(f"{path} may depend on more than its content")
        if path.stat().st_size > _LARGEST_FILE:
            raise _UnknownContentError(f"{path} is too large to be read twice")
        with path.open("rb") as file:
            content = hashlib.file_digest(file, "sha256").digest()
    except OSError as error:
        raise _UnknownContentError(f"{path} cannot be read") from error
    return path.suffix.lower().encode() + content

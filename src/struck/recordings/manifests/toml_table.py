"""TOML files whose keys are asked for one by one: what is wrong or unknown is named."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeGuard

from struck.errors import FileFormatError

LARGEST = 2**26
"""Bytes of a file that is read."""


class TomlTable:
    """A table of a TOML file.

    Parameters
    ----------
    values : mapping
        As `tomllib` gives it.
    name : str
        What errors call it.
    """

    def __init__(self, values: Mapping[str, Any], name: str) -> None:
        self.name = name
        self._values = values
        self._known: list[str] = []

    def __contains__(self, key: str) -> bool:
        return key in self._values

    def value(self, key: str) -> Any:  # noqa: ANN401 - whatever TOML holds
        """Return what stands there; None where nothing does."""
        self._known.append(key)
        return self._values.get(key)

    def number(self, key: str, low: float, high: float, default: float | None = None) -> float:
        """Return a number from `low` to `high`; without a default it has to be there."""
        found = self.value(key)
        if found is None and default is not None:
            return default
        if not (_is_number(found) and low <= found <= high):
            raise self.error(f"{key} is {_told(found)}: give a number from {low:g} to {high:g}")
        return float(found)

    def maybe(self, key: str, low: float, high: float) -> float | None:
        """Return a number from `low` to `high`, or None where nothing stands."""
        if key in self._values:
            return self.number(key, low, high)
        return self.value(key)

    def count(self, key: str, low: int, high: int, *, default: int) -> int:
        """Return a whole number from `low` to `high`."""
        found = float(self.number(key, low, high, default))
        if not found.is_integer():
            raise self.error(f"{key} is {found:g}: give a whole number from {low} to {high}")
        return int(found)

    def text(self, key: str, default: str | None = None) -> str:
        """Return text; without a default it has to be there and not be empty."""
        found = self.value(key)
        if found is None and default is not None:
            return default
        if not isinstance(found, str) or not (found or default is not None):
            raise self.error(f'{key} is {_told(found)}: give text, as {key} = "..."')
        return found

    def texts(self, key: str) -> tuple[str, ...]:
        """Return a list of texts; empty where nothing stands."""
        found = self.value(key)
        if found is None:
            return ()
        if not (isinstance(found, list) and found and all(isinstance(each, str) for each in found)):
            raise self.error(f'{key} is {_told(found)}: give a list of texts, as ["...", "..."]')
        return tuple(found)

    def choice(self, key: str, names: tuple[str, ...], default: str) -> str:
        """Return one of some names."""
        found = self.text(key, default)
        if found not in names:
            raise self.error(f"{key} is {found!r}: give one of {', '.join(names)}")
        return found

    def numbers(self, key: str, *counts: int) -> tuple[float, ...]:
        """Return a list of one of some numbers of finite numbers; empty where nothing stands."""
        found = self.value(key)
        return () if found is None else numbers(found, self, key, *counts)

    def table(self, key: str) -> TomlTable:
        """Return the table there; an empty one where nothing stands."""
        found = self.value(key)
        if not isinstance(found, dict | None):
            raise self.error(f"{key} is {_told(found)}: give a table, as [{key}]")
        return TomlTable(found or {}, f"{self.name}, [{key}]")

    def list(self, key: str) -> list[Any]:
        """Return the list there; an empty one where nothing stands."""
        found = self.value(key)
        if not isinstance(found, list | None):
            raise self.error(f"{key} is {_told(found)}: give a list")
        return found or []

    def tables(self, key: str) -> list[TomlTable]:
        """Return the tables that stand there as [[key]]."""
        found = self.list(key)
        if not all(isinstance(each, dict) for each in found):
            raise self.error(f"{key} holds what is no table: write each as [[{key}]]")
        return [
            TomlTable(each, f"{self.name}, [[{key}]] {number}")
            for number, each in enumerate(found, 1)
        ]

    def require_known(self) -> None:
        """Refuse keys that nobody asked for.

        Raises
        ------
        FileFormatError
            Naming them, and those that are known.
        """
        strange = sorted(set(self._values) - set(self._known))
        if strange:
            raise self.error(
                f"{', '.join(strange)} is not known here: use {', '.join(sorted(self._known))}"
            )

    def error(self, trouble: str) -> FileFormatError:
        """Return an error that says where it is."""
        return FileFormatError(f"{self.name}: {trouble}")


def numbers(found: object, table: TomlTable, key: str, *counts: int) -> tuple[float, ...]:
    """Return a list of finite numbers, of one of some lengths.

    Raises
    ------
    FileFormatError
        When it is none.
    """
    if (
        not (isinstance(found, list) and len(found) in counts)
        or not all(map(_is_number, found))
        or not all(map(math.isfinite, found))
    ):
        wanted = " or ".join(map(str, counts))
        raise table.error(f"{key} is {_told(found)}: give a list of {wanted} finite numbers")
    return tuple(map(float, found))


def read_toml(path: Path) -> TomlTable:
    """Read a TOML file.

    Raises
    ------
    FileFormatError
        When it cannot be read or is no TOML.
    """
    try:
        return TomlTable(tomllib.loads(read_text(path)), str(path))
    except tomllib.TOMLDecodeError as error:
        raise FileFormatError(f"{path} is no TOML: {error}; correct it there") from error


def read_text(path: Path) -> str:
    """Read a file as UTF-8, with or without a byte order mark.

    Raises
    ------
    FileFormatError
        When it cannot be read, is too large, or holds something else.
    """
    try:
        size = path.stat().st_size
        if size > LARGEST:
            raise FileFormatError(f"{path} has {size} bytes, more than {LARGEST}: split it")
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise FileFormatError(
            f"{path} cannot be read ({error.strerror or error}): check its name"
        ) from error
    except UnicodeDecodeError as error:
        raise FileFormatError(f"{path} is no UTF-8 text: save it as UTF-8") from error


def _is_number(found: object) -> TypeGuard[float]:
    return isinstance(found, int | float) and not isinstance(found, bool)


def _told(found: object) -> str:
    return "missing" if found is None else repr(found)[:80]

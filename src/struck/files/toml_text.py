"""Text files that people write: TOML and CSV, read in place within bounds of size and form."""

from __future__ import annotations

import os
import re
import tomllib
from typing import Any

from struck.errors import FileFormatError, printable
from struck.files.atomic import read_bytes

MAX_BYTES = 2**22  # of a file; the slowest TOML of this size takes 8 s of processor time
_BITS = 63  # of a whole number in TOML, its sign apart
# Reading a key takes time as the square of its parts, and names of tables several times as long.
_MAX_KEY_PARTS, _MAX_DOTTED_TABLES = 8, 1000
_KEY_PART = r"""[ \t]*+(?:[\w-]++|"(?:[^"\\\n]|\\.)*+"|'[^'\n]*+')[ \t]*+"""
_LONG_KEY = re.compile(rf"(?:\.{_KEY_PART}){{{_MAX_KEY_PARTS}}}")
_DOTTED_TABLE = re.compile(
    rf"^[ \t]*+\[\[?+{_KEY_PART}(?:\.{_KEY_PART})++\]\]?+[ \t]*+(?:#.*)?$", re.MULTILINE
)
_MAX_SHOWN = 200  # characters of an error of another package


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a file in UTF-8, with or without a byte order mark."""
    try:
        return read_bytes(path, most=MAX_BYTES).decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FileFormatError(
            f"{path} is no UTF-8 text: save it as UTF-8, or give another file"
        ) from error


def read_toml(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return the table of a TOML file; FileFormatError beyond the bounds."""
    text = read_text(path)
    try:
        return _parse(text)
    except RecursionError as error:
        raise FileFormatError(
            f"{path} has lists or tables too deep in one another: make them flat"
        ) from error
    except ValueError as error:
        reason = printable(str(error))[:_MAX_SHOWN]
        raise FileFormatError(f"{path} is no TOML: {reason}; correct it there") from error


def _parse(text: str) -> dict[str, Any]:
    """Return the table of a TOML text; ValueError if it is invalid, RecursionError if too deep."""
    if _LONG_KEY.search(text):
        raise ValueError(f"a key has more than {_MAX_KEY_PARTS} parts between dots")
    dotted_tables = sum(1 for _ in _DOTTED_TABLE.finditer(text))
    if dotted_tables > _MAX_DOTTED_TABLES:
        raise ValueError(
            f"{dotted_tables} tables have names of several parts, and at most "
            f"{_MAX_DOTTED_TABLES} may"
        )
    table = tomllib.loads(text)
    pending_values: list[object] = [table]
    while pending_values:
        value = pending_values.pop()
        if isinstance(value, int) and value.bit_length() > _BITS:
            raise ValueError(f"a number has {value.bit_length()} bits, and at most {_BITS} fit")
        if isinstance(value, dict | list):
            pending_values += value.values() if isinstance(value, dict) else value
    return table

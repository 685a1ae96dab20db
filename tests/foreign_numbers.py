"""Numbers and arrays of many types, the same ones in Python's own types, and their results."""

from __future__ import annotations

import array
import dataclasses
import struct
from collections.abc import Callable, Mapping, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pandas as pd

FLOATS = (np.float16, np.float32, np.float64)
WHOLES = (np.int8, np.int16, np.int32, np.int64, np.uint8, np.uint16, np.uint32, np.uint64)


class Subclass(float):
    """A float that names itself."""

    __slots__ = ()

    def __repr__(self) -> str:
        return "a float of another class"


class Foreign:
    """An array of another package, which NumPy can read."""

    def __init__(self, values: object) -> None:
        self._values = np.asarray(values)

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> np.ndarray:  # noqa: ANN401, FBT001
        return np.array(self._values, dtype, copy=copy)


def _finer(value: float) -> np.longdouble:
    """Return a long double near a number, which double precision rounds; a whole one as it is."""
    if isinstance(value, int):
        return np.longdouble(value)
    return np.longdouble(value) * (1 + np.longdouble(2) ** -60)


def _whole(kind: type[np.integer]) -> Callable[[float], np.integer]:
    info = np.iinfo(kind)
    return lambda value: kind(min(max(round(value), info.min), info.max))


SCALARS: dict[str, Callable[[Any], Any]] = {
    **{kind.__name__: kind for kind in FLOATS},
    **{kind.__name__: _whole(kind) for kind in WHOLES},
    "longdouble": _finer,
    "Fraction": Fraction,
    "Decimal": lambda value: Decimal(repr(float(value))),
    "subclass": Subclass,
    "element of a Series": lambda value: pd.Series([value], dtype="float32").iloc[0],
    "nullable element": lambda value: pd.Series([value], dtype="Float32").iloc[0],
}
# Neither is a number.
NO_SCALARS: dict[str, Callable[[Any], Any]] = {
    "complex64": np.complex64,
    "bytes": lambda _: b"1",
    "text of NumPy": lambda _: np.str_("1"),
    "bytes of NumPy": lambda _: np.bytes_(b"1"),
    "datetime64": lambda _: np.datetime64("2026-01-01"),
    "Timedelta": lambda _: pd.Timedelta(seconds=1),
    "NA": lambda _: pd.NA,
    "NaT": lambda _: pd.NaT,
    "masked": lambda _: np.ma.masked,
    "signalling NaN": lambda _: Decimal("sNaN"),
    "5,000 digits": lambda _: 10**5000,
    "Series": lambda value: pd.Series([value] * 7),
    "Categorical": lambda _: pd.Categorical(["a", "b"]),
}


def _read_only(values: np.ndarray) -> np.ndarray:
    copy = values.copy()
    copy.setflags(write=False)
    return copy


def _strided(values: np.ndarray) -> np.ndarray:
    return np.repeat(values, 2, axis=-1)[..., ::2]


def _frame(values: np.ndarray, dtype: object = None) -> Any:  # noqa: ANN401 - of pandas
    """Return a Series, a DataFrame, or a list of them."""
    if values.ndim > 2:
        return [_frame(part, dtype) for part in values]
    return (pd.Series if values.ndim == 1 else pd.DataFrame)(values, dtype=dtype)


def _listed(values: Any, convert: Callable[[Any], Any]) -> Any:  # noqa: ANN401 - nested
    """Return nested lists of the converted elements of an array."""
    if np.ndim(values):
        return [_listed(row, convert) for row in values]
    return convert(values)


ARRAYS: dict[str, Callable[[np.ndarray], Any]] = {
    **{kind.__name__: lambda values, kind=kind: values.astype(kind) for kind in FLOATS},
    **{
        kind.__name__: lambda values, kind=kind: _listed_array(values, _whole(kind), kind)
        for kind in WHOLES
    },
    "longdouble": lambda values: _listed_array(values, _finer, np.longdouble),
    "big-endian": lambda values: values.astype(values.dtype.newbyteorder(">")),
    "big-endian float32": lambda values: values.astype(">f4"),
    "read-only": _read_only,
    "strided": _strided,
    "columns first": np.asfortranarray,
    "objects": lambda values: values.astype(object),
    "fractions": lambda values: _listed_array(values, Fraction, object),
    "list of float32": lambda values: _listed(values, np.float32),
    "tuple of arrays": lambda values: tuple(np.float32(row) for row in values),
    "unmasked": np.ma.MaskedArray,
    "pandas": _frame,
    "pandas float32": lambda values: _frame(values, "float32"),
    "pandas nullable": lambda values: _frame(values, "Float64"),
    "index": lambda values: pd.Index(values) if values.ndim == 1 else _frame(values),
    "foreign": Foreign,
    "foreign float16": lambda values: Foreign(values.astype(np.float16)),
    "memory": memoryview,
    "array of Python": lambda values: array.array("d", values) if values.ndim == 1 else values,
}
ARRAYS_OF_COMPLEX = {
    **{
        kind.__name__: lambda values, kind=kind: values.astype(kind)
        for kind in (np.complex64, np.clongdouble)
    },
    **{
        kind: ARRAYS[kind]
        for kind in ("big-endian", "read-only", "strided", "columns first", "objects", "foreign")
    },
}
# None is an array of numbers.
NO_ARRAYS: dict[str, Callable[[np.ndarray], Any]] = {
    "masked": lambda values: np.ma.MaskedArray(
        values, np.arange(values.size).reshape(values.shape) < 1
    ),
    "rows of masked": lambda values: [*np.ma.MaskedArray(np.atleast_2d(values), mask=True)],
    "text": lambda values: values.astype(str),
    "bytes": lambda values: values.tobytes(),
    "mutable bytes": lambda values: bytearray(values.tobytes()),
    "dates": lambda values: np.zeros(values.shape, "M8[s]"),
    "durations of pandas": lambda values: pd.Series(np.zeros(values.size, "m8[s]")),
    "categories": lambda values: pd.Categorical(["a"] * len(values)),
    "missing": lambda values: pd.Series([1.5, None] * len(values), dtype=object),
    "records": lambda values: np.zeros(values.shape, [("x", float)]),
    "generator": lambda values: (value for value in values),
    "a set": lambda values: {*values.ravel().tolist()},
    "endless": lambda _: range(10**9),
    "endless rows": lambda _: [[0.0], range(10**9)],
    "huge": lambda values: [10**400] * len(values),
    "5,000 digits": lambda values: [10**5000] * len(values),
}


def _listed_array(values: np.ndarray, convert: Callable[[Any], Any], kind: type[Any]) -> np.ndarray:
    items = [convert(value) for value in values.ravel().tolist()]
    filled = np.empty(values.size, kind)
    filled[:] = items
    return filled.reshape(values.shape)


def python_number(value: object, *, whole: bool) -> Any:  # noqa: ANN401 - an int or a float
    """Return a number as Python's own."""
    number: Any = value
    return int(number) if whole and np.isfinite(float(number)) else float(number)


def python_numbers(values: Any) -> Any:  # noqa: ANN401 - nested lists
    """Return an array of any type as nested lists of Python's own numbers."""
    if isinstance(values, list | tuple):
        return [python_numbers(row) for row in values]
    plain = np.asarray(values)
    if plain.dtype.kind in "iub":
        return plain.tolist()
    is_complex = np.iscomplexobj(plain) or any(isinstance(number, complex) for number in plain.flat)
    return _listed(plain, complex if is_complex else float)


def same(one: object, other: object) -> bool:
    """Return whether results are equal to the last bit, with the types of all their parts."""
    return bits(one) == bits(other)


def bits(value: Any) -> Any:  # noqa: ANN401 - nested tuples
    """Return the type and the content of a result; functions are as good as any other."""
    content: Any = ""
    if isinstance(value, np.ndarray):
        content = value.dtype.str, value.shape, value.tobytes()
    elif isinstance(value, float):
        content = struct.pack("d", value)
    elif dataclasses.is_dataclass(value):
        content = [bits(getattr(value, field.name)) for field in dataclasses.fields(value)]
    elif isinstance(value, Mapping):
        content = [(key, bits(item)) for key, item in value.items()]
    elif isinstance(value, str | bytes | int | complex):
        content = value
    elif isinstance(value, Sequence):
        content = [bits(item) for item in value]
    return type(value), content

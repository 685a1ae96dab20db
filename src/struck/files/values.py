"""Values of a model file's JSON, refused where they are not what belongs there."""

from __future__ import annotations

from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError

Array = NDArray[np.float64]

FARTHEST = 1e9
"""No place of a body is farther away, m: squares of it are numbers still."""


def refuse_constant(name: str) -> NoReturn:
    """Refuse NaN and infinities, which Python reads though JSON has none."""
    raise FileFormatError(f"its metadata holds {name}, which is no number of JSON")


def numbers(value: object, shape: tuple[int, ...]) -> Array:
    """Return a nested list of finite numbers as an array of that shape.

    Raises
    ------
    FileFormatError
        When there are more or fewer, or one is not finite.
    """
    array = np.array(value, dtype=np.float64)
    if array.shape != shape:
        raise FileFormatError(f"its metadata holds {array.shape} numbers where {shape} belong")
    if not np.isfinite(array).all():
        raise FileFormatError(f"its metadata holds {value!r}, not all of it finite")
    return array


def numbers_or_none(value: object, shape: tuple[int, ...]) -> Array | None:
    """Return `numbers`, or None for null."""
    return None if value is None else numbers(value, shape)


def vector(value: object, count: int = 3) -> Array:
    """Return the coordinates of a place.

    Raises
    ------
    FileFormatError
        When they are not as many finite numbers.
    """
    if value is None:
        raise FileFormatError("its metadata holds null where the coordinates of a place belong")
    return numbers(value, (count,))


def near(places: Array, name: str) -> Array:
    """Return places, m.

    Raises
    ------
    FileFormatError
        When one has a coordinate beyond `FARTHEST`.
    """
    farthest = float(np.abs(places).max(initial=0.0))
    if farthest > FARTHEST:
        raise FileFormatError(f"its {name} goes up to {farthest:g} m: at most {FARTHEST:g} m fits")
    return places


def number(value: object, name: str, least: float, most: float = np.inf) -> float:
    """Return a finite number.

    Raises
    ------
    FileFormatError
        When it lies outside of `least` and `most`.
    """
    found = float(numbers(value, ()))
    if not least <= found <= most:
        raise FileFormatError(f"its {name} is {found:g}: it must lie from {least:g} to {most:g}")
    return found


def flag(value: object, name: str) -> bool:
    """Return true or false.

    Raises
    ------
    FileFormatError
        When it is neither.
    """
    if not isinstance(value, bool):
        raise FileFormatError(f"its {name} is {value!r}: give true or false")
    return value


def texts(value: object, name: str) -> tuple[str, ...]:
    """Return a list of texts.

    Raises
    ------
    FileFormatError
        When it is none.
    """
    if not isinstance(value, list) or not all(isinstance(each, str) for each in value):
        raise FileFormatError(f"its {name} are {value!r}: give a list of texts")
    return tuple(value)


def one_of(value: object, name: str, choices: tuple[str, ...]) -> str:
    """Return one of some texts.

    Raises
    ------
    FileFormatError
        When it is another.
    """
    if not isinstance(value, str) or value not in choices:
        raise FileFormatError(f"its {name} is {value!r}: give one of {', '.join(choices)}")
    return value

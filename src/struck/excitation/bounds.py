"""Bounds that every excitation checks when it is made."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from struck.errors import OptionError
from struck.model.contact import Place


class Placed(Protocol):
    """What acts at a place."""

    @property
    def at(self) -> Place:
        """Coordinates in m, a name, or None for the loudest."""
        ...


def require_positive(**numbers: float | None) -> None:
    """Raise an OptionError unless each number is finite and above 0, or None."""
    for name, value in numbers.items():
        if value is not None and not (np.isfinite(value) and value > 0):
            raise OptionError(f"{name} is {value}: it must be a finite number above 0")


def require_at_least_zero(**numbers: float | None) -> None:
    """Raise an OptionError unless each number is finite and at least 0, or None."""
    for name, value in numbers.items():
        if value is not None and not (np.isfinite(value) and value >= 0):
            raise OptionError(f"{name} is {value}: it must be a finite number of at least 0")


def require_finite(**numbers: float) -> None:
    """Raise an OptionError unless each number is finite."""
    for name, value in numbers.items():
        if not np.isfinite(value):
            raise OptionError(f"{name} is {value}: it must be a finite number")


def coordinates(name: str, values: object) -> tuple[float, ...]:
    """Return one to three finite numbers as a tuple, or raise an OptionError."""
    return _finite(name, values, "one to three finite coordinates in m, or the name of a place")


def unit_vector(name: str, values: object) -> tuple[float, ...]:
    """Return a vector of three numbers, made one long, or raise an OptionError."""
    wanted = "a vector (x, y, z) with a length"
    vector = _finite(name, values, wanted)
    length = float(np.linalg.norm(vector))
    if len(vector) != 3 or not length:
        raise OptionError(f"{name} is {values!r}: give {wanted}")
    return tuple(part / length for part in vector)


def _finite(name: str, values: object, wanted: str) -> tuple[float, ...]:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name} is {values!r}: give {wanted}") from error
    if array.ndim != 1 or not 1 <= array.size <= 3 or not np.isfinite(array).all():
        raise OptionError(f"{name} is {values!r}: give {wanted}")
    return tuple(array.tolist())


def freeze_place(excitation: Placed, *names: str) -> None:
    """Turn `at`, and what else is named of a frozen excitation's directions, into plain tuples.

    Raises
    ------
    OptionError
        On numbers that are no place or no direction.
    """
    at = excitation.at
    if at is not None and not isinstance(at, str):
        object.__setattr__(excitation, "at", coordinates("at", at))
    for name in names:
        if getattr(excitation, name) is not None:
            vector = unit_vector(name, getattr(excitation, name))
            object.__setattr__(excitation, name, vector)

"""A quantity that a person sets over time: a number, a table, or a function."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError

Array = NDArray[np.float64]
Course = float | tuple[Sequence[float], Sequence[float]] | Callable[[float], float]
"""A constant; (times in s, values), joined by straight lines and held beyond their ends; or a
function of the time in s. Times count from when the excitation begins."""


def require_course(name: str, course: Course) -> None:
    """Raise an OptionError unless all numbers of a course are finite and at least 0."""
    if callable(course):
        return
    if not isinstance(course, tuple):
        _require(name, course)
        return
    times, values = _table(name, course)
    if times.ndim != 1 or times.shape != values.shape or not len(times):
        raise OptionError(f"{name} has times {times.shape} and values {values.shape}: as many each")
    if not (np.isfinite(times).all() and np.all(np.diff(times) > 0)):
        raise OptionError(f"{name} has times {times}: they must be finite and ascend, in s")
    for value in values:
        _require(name, float(value))


def frozen(name: str, course: Course) -> Course:
    """Return a course that nobody can change afterwards, after checking it."""
    require_course(name, course)
    if not isinstance(course, tuple):
        return course
    times, values = _table(name, course)
    return tuple(times.tolist()), tuple(values.tolist())


def follow(name: str, course: Course) -> Callable[[float], float]:
    """Return the course as a function of time that checks what it returns."""
    if isinstance(course, tuple):
        times, values = _table(name, course)
        return lambda time: float(np.interp(time, times, values))
    if callable(course):
        return lambda time: _require(name, course(time))
    constant = float(course)
    return lambda _: constant


def _table(name: str, course: tuple[Sequence[float], Sequence[float]]) -> tuple[Array, Array]:
    try:
        times, values = course
        return np.asarray(times, np.float64), np.asarray(values, np.float64)
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name} is {course!r}: give (times, values)") from error


def _require(name: str, value: float) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name} is {value!r}: give a number") from error
    if not (np.isfinite(number) and number >= 0):
        raise OptionError(f"{name} is {number}: it must be a finite number of at least 0")
    return number

"""Where something is over time: a point, a table, or a function."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeGuard

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import OptionError

Array = NDArray[np.float64]
Course3 = ArrayLike | tuple[Sequence[float], ArrayLike] | Callable[[float], ArrayLike]
"""(x, y, z); (times in s, points (T, 3)), joined by straight lines and held beyond their ends; or a
function of the time in s that returns (x, y, z)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """Three numbers over time.

    Parameters
    ----------
    name : str
        What they are, for errors.
    times, points : array (T,), (T, 3)
        Of a table; a point that does not move has one.
    function : callable or None
        In place of a table.
    """

    name: str
    times: Array
    points: Array
    function: Callable[[float], ArrayLike] | None = None

    @classmethod
    def of(cls, name: str, course: Course3) -> Trajectory:
        """Check what a person gives; OptionError on what is no point, table or function."""
        if callable(course):
            return cls(name=name, times=np.zeros(0), points=np.zeros((0, 3)), function=course)
        if _is_table(course):
            return cls._table(name, *course)
        return cls(name=name, times=np.zeros(1), points=_points(name, course, (3,))[None])

    @classmethod
    def _table(cls, name: str, times: ArrayLike, points: ArrayLike) -> Trajectory:
        moments = np.atleast_1d(np.asarray(times, np.float64))
        ascend = moments.ndim == 1 and np.isfinite(moments).all() and (np.diff(moments) > 0).all()
        if not (len(moments) and ascend):
            raise OptionError(f"{name} has times {times}: they must be finite and ascend, in s")
        return cls(name=name, times=moments, points=_points(name, points, (len(moments), 3)))

    @property
    def moves(self) -> bool:
        """Whether it may change."""
        return self.function is not None or len(self.times) > 1

    def at(self, times: Array) -> Array:
        """Return the numbers at some times (n,): (n, 3).

        What is heard at first was sent before; then all is held as at 0 s.
        """
        if self.function is not None:
            found = [self.function(max(time, 0.0)) for time in times.tolist()]
            return _points(self.name, found, (len(times), 3))
        if len(self.times) == 1:
            return np.broadcast_to(self.points[0], (len(times), 3))
        after = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        begin = self.times[after - 1]
        share = np.clip((times - begin) / (self.times[after] - begin), 0, 1)[:, None]
        return (1 - share) * self.points[after - 1] + share * self.points[after]


def _is_table(course: object) -> TypeGuard[tuple[Sequence[float], ArrayLike]]:
    """Tell (times, points) from a point: its second part is a list."""
    return isinstance(course, tuple) and len(course) == 2 and not np.isscalar(course[1])


def _points(name: str, values: object, shape: tuple[int, ...]) -> Array:
    try:
        points = np.array(values)
        points = points.astype(np.float64, casting="same_kind")
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name} is {values!r}: give (x, y, z), or (times, points)") from error
    # A sum that is finite tells the same of nearly all points in less time.
    if points.shape != shape or not (math.isfinite(points.sum()) or np.isfinite(points).all()):
        raise OptionError(
            f"{name} is {values!r}: give finite numbers of shape {shape}, or (times, points), or a "
            "function of time"
        )
    return points

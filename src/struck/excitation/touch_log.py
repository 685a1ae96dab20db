"""What a touch did, to be heard again."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.errors import OptionError
from struck.excitation.pushing import Push
from struck.excitation.tool import HEAVIEST, Tool
from struck.excitation.touch import Touching
from struck.model.contact import Contact
from struck.model.model import ModalModel

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TouchLog:
    """A touch, update by update: an excitation that sounds offline as it did live.

    Parameters
    ----------
    times : array-like (K,)
        When each update takes effect, ascending, s; moved to the nearest sample.
    points : array-like (K, 3)
        On the body, m.
    forces : array-like (K,)
        Loads, N, at least 0.
    speeds : array-like (K,) or float
        Along the surface, m/s, at least 0.
    directions : array-like (K, 3) or None
        Along which the loads push; straight into the surface unless given.
    tool : Tool
        What touched.

    Raises
    ------
    OptionError
        On numbers that are not finite, out of bounds or not as many.
    """

    times: ArrayLike
    points: ArrayLike
    forces: ArrayLike
    speeds: ArrayLike = 0.0
    directions: ArrayLike | None = None
    tool: Tool = field(default_factory=Tool)

    def __post_init__(self) -> None:
        times = _column("times", self.times, None)
        if not len(times) or times[0] < 0 or np.any(np.diff(times) < 0):
            raise OptionError(f"times are {times}: give at least one, ascending from 0 s on")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "points", _rows("points", self.points, len(times)))
        object.__setattr__(self, "forces", _column("forces", self.forces, len(times), HEAVIEST))
        object.__setattr__(self, "speeds", _column("speeds", self.speeds, len(times), np.inf))
        if self.directions is not None:
            directions = _rows("directions", self.directions, len(times))
            object.__setattr__(self, "directions", directions)

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Replay:
        """Begin on a model at sample number `start`; see `struck.excitation.pushing`.

        Raises
        ------
        ContactError
            When it begins off the body; where it leaves it later, `advance` raises that.
        """
        model.contact(*self.place(0))
        return Replay(self, model, sample_rate, start=start)

    def place(self, number: int) -> tuple[Array, Array | None]:
        """Return point and direction (3,) of an update."""
        directions = None if self.directions is None else np.asarray(self.directions)[number]
        return np.asarray(self.points)[number], directions


class Replay:
    """A `Pushing`: the touch of a log, let go of only where its last force is 0."""

    def __init__(
        self, log: TouchLog, model: ModalModel, sample_rate: float, *, start: int = 0
    ) -> None:
        self._touching = Touching(model, sample_rate, tool=log.tool, start=start)
        self._log, self._model, self._now, self._next = log, model, start, 0
        self._samples = np.round(np.asarray(log.times) * sample_rate).astype(np.int64)
        self._contact: Contact | None = None

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, None where there is no force in them.

        Raises
        ------
        ContactError
            Where the touch leaves the body.
        """
        self._now += length
        last = int(np.searchsorted(self._samples, self._now))
        for number in range(self._next, last):
            self._say(number)
        self._next = last
        return self._touching.advance(length)

    def change(self, model: ModalModel) -> None:
        """Go on with a body that has changed."""
        self._model, self._contact = model, None
        self._touching.change(model)

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return self._touching.finished

    def _say(self, number: int) -> None:
        log = self._log
        if self._contact is None or not _stays(log, number):
            self._contact = self._model.contact(*log.place(number))
        self._touching.update(
            self._contact,
            float(np.asarray(log.forces)[number]),
            float(np.asarray(log.speeds)[number]),
            sample=int(self._samples[number]),
        )
        self._touching.ended = number == len(self._samples) - 1


def _stays(log: TouchLog, number: int) -> bool:
    (point, way), (before, way_before) = log.place(number), log.place(number - 1)
    return np.array_equal(point, before) and (
        way is None or way_before is None or np.array_equal(way, way_before)
    )


def _column(name: str, values: ArrayLike, count: int | None, most: float = np.inf) -> Array:
    column = np.array(values, np.float64)
    if count is not None and column.ndim == 0:
        column = np.full(count, column)
    if column.ndim != 1 or (count is not None and len(column) != count):
        raise OptionError(f"{name} have shape {column.shape}: give one for each of {count} times")
    if not (np.isfinite(column).all() and np.all(column >= 0) and np.all(column <= most)):
        raise OptionError(f"{name} must be finite, at least 0 and at most {most:g}")
    column.setflags(write=False)
    return column


def _rows(name: str, values: ArrayLike, count: int) -> Array:
    rows = np.array(values, np.float64)
    if rows.shape != (count, 3) or not np.isfinite(rows).all():
        raise OptionError(f"{name} have shape {rows.shape}: give {count} finite rows (x, y, z)")
    rows.setflags(write=False)
    return rows

"""A finite stretch of force at one place: what a strike, a pluck and a recorded force come to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np

from struck.errors import OptionError
from struck.excitation.contact_patch import drive
from struck.excitation.pulses import Samples
from struck.model.arrays import Array
from struck.model.contact import Contact, Place
from struck.model.model import ModalModel

# Bounds that every excitation checks when it is made.


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
    """Turn `at` and the named directions of a frozen excitation into plain tuples."""
    at = excitation.at
    if at is not None and not isinstance(at, str):
        object.__setattr__(excitation, "at", coordinates("at", at))
    for name in names:
        if getattr(excitation, name) is not None:
            vector = unit_vector(name, getattr(excitation, name))
            object.__setattr__(excitation, name, vector)


# A quantity that a person sets over time: a number, a table, or a function.

# A constant; (times in s, values), joined by straight lines and held beyond their ends; or a
# function of the time in s since the excitation began
Course = float | tuple[Sequence[float], Sequence[float]] | Callable[[float], float]


def require_course(name: str, course: Course) -> None:
    """Raise an OptionError unless all numbers of a control curve are finite and at least 0."""
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
    """Return a checked control curve that nobody can change afterwards."""
    require_course(name, course)
    if not isinstance(course, tuple):
        return course
    times, values = _table(name, course)
    return tuple(times.tolist()), tuple(values.tolist())


def follow(name: str, course: Course) -> Callable[[float], float]:
    """Return a control curve as a function of time that checks what it returns."""
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


# What every excitation has in common: once begun on a model it pushes, block after block.


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Push:
    """A force on one place of a body during one block.

    Parameters
    ----------
    force : array (block,)
        N, at each sample; band-limited to half the sample rate.
    drive : array (M,)
        How strongly each mode answers at the place where the block ends, kg^-1/2. Within the
        block it is ramped to from the last one of the same body and voice. The very same array
        means that nothing moved: do not write to it afterwards.
    body : int
        Its number in the scene.
    voice : int
        Pushes of the same body and voice in one block after the other are one contact that moves.
    """

    force: Array
    drive: Array
    body: int = 0
    voice: int = 0


class Pushing(Protocol):
    """An excitation at work on one model."""

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, None where there is no force in them."""
        ...

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        ...


@runtime_checkable
class Changing(Protocol):
    """A `Pushing` that can go on when its body changes."""

    def change(self, model: ModalModel) -> None:
        """Push at the same place of a body that has changed."""
        ...


class Excitation(Protocol):
    """What pushes a body: constant, and the same again for the same seed."""

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Pushing:
        """Begin on a model at sample number `start` (may be negative: a prelude).

        Raises
        ------
        ContactError
            When it touches no body.
        """
        ...


# Straight lines between what is said now and then.


class Ramp:
    """A number that moves to its target in a straight line, sample by sample."""

    def __init__(self, value: float = 0.0) -> None:
        self.value = self.target = value
        self._left = 0

    def toward(self, target: float, samples: int) -> None:
        """Set a target, to be reached after some samples; 0 is at once."""
        self.target, self._left = target, samples
        if samples == 0:
            self.value = target

    def take(self, count: int) -> Array:
        """Return the next values (count,)."""
        if self._left == 0 or count == 0:
            return np.full(count, self.value)
        shares = np.minimum(np.arange(1, count + 1) / self._left, 1.0)
        values = self.value + shares * (self.target - self.value)
        self._left = max(0, self._left - count)
        self.value = float(values[-1]) if self._left else self.target
        return values


class Blend:
    """An array that moves to its target in a straight line; the same object while it rests."""

    def __init__(self) -> None:
        self.now: Array = np.zeros(0)
        self._target = self.now
        self._left = 0

    def toward(self, target: Array, samples: int) -> None:
        """Set a target, to be reached after some samples; 0 is at once."""
        self._target, self._left = target, samples
        if samples == 0 or target is self.now:
            self.now, self._left = target, 0

    def go(self, count: int) -> None:
        """Move on by `count` samples."""
        if not self._left or not count:
            return
        share = min(count / self._left, 1.0)
        self._left = max(0, self._left - count)
        self.now = self.now + share * (self._target - self.now) if self._left else self._target


class Sampled(Protocol):
    """A force at one place that is known beforehand."""

    @property
    def at(self) -> Place:
        """Where it acts."""
        ...

    @property
    def direction(self) -> Place:
        """Which way it pushes."""
        ...

    @property
    def patch(self) -> float:
        """Radius of the area of contact, m."""
        ...

    def sampled(self, sample_rate: float) -> Samples:
        """Return the force, N."""
        ...


def burst_of(excitation: Sampled, model: ModalModel, sample_rate: float, *, start: int) -> Burst:
    """Begin a sampled force on a model; ContactError when it touches no body."""
    require_positive(sample_rate=sample_rate)
    contact = model.contact(excitation.at, excitation.direction)
    samples, patch = excitation.sampled(sample_rate), excitation.patch
    driven = drive(model, contact, radius=patch)
    return Burst(samples, driven, start=start, contact=contact, patch=patch)


class Burst:
    """A `Pushing` that plays given samples of force at one place."""

    def __init__(
        self,
        samples: Samples,
        drive: Array,
        *,
        start: int = 0,
        contact: Contact | None = None,
        patch: float = 0.0,
    ) -> None:
        self._samples = samples
        self._drive = drive
        self._now = start
        self._contact, self._patch = contact, patch

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, None where there is no force in them."""
        offset = self._now - self._samples.first
        self._now += length
        part = self._samples.force[max(offset, 0) : max(offset + length, 0)]
        if not len(part):
            return None
        force = np.zeros(length)
        begin = max(-offset, 0)
        force[begin : begin + len(part)] = part
        return Push(force=force, drive=self._drive)

    def change(self, model: ModalModel) -> None:
        """Push at the same place of a body that has changed, where the place is known."""
        if self._contact is not None:
            self._drive = drive(model, self._contact, radius=self._patch)

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return self._now >= self._samples.first + len(self._samples.force)

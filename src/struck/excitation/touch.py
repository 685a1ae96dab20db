"""A touch: a hand, a tool or a haptic device on a body, told from outside at its own rate.

Whoever moves it says 60 to 1000 times a second where it is, how hard it presses and how fast it
moves. Between two updates everything goes in straight lines, for as long as updates lie apart, and
the load then passes a window of 2 ms: no step, no corner, nothing of the rate of the updates above
about 1 kHz (2007 closes a loop of contacts at 100 Hz over audio in the same way). A moving contact
adds the force of the surface at its place, as a scrape does (`struck.excitation.friction`). A
steady load itself is silent; what is heard is how it changes.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError
from struck.excitation.excitation import HEAVIEST, Push, drive
from struck.excitation.friction import FADE, Reader, Tool, fading, limited
from struck.excitation.texture import CHUNK
from struck.model.arrays import Array, checked
from struck.model.contact import Contact, Place
from struck.model.model import ModalModel

SLOWEST, FASTEST = 60.0, 1000.0  # Hz, of updates that ramps adapt to
USUAL = 100.0  # Hz, expected before there were two updates

_WINDOW = 2e-3  # s, that smooths the load
_CALM = 0.25  # how soon the length of ramps follows the rate of updates
_PAUSE = 1.2  # times the slowest rate's interval: then it is no interval but a pause
_MOVES = 0.5  # share of the speed by which a place must move to be where the surface is felt


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Update:
    """Place, load and speed of a touch from one sample on."""

    sample: int  # number of the first sample that it holds for
    contact: Contact  # place, and direction of the load
    drive: Array  # (M,), kg^-1/2, of each mode there
    force: float  # N, at least 0
    speed: float  # m/s, at least 0


class Touching:
    """A `Pushing` that follows updates of place, load and speed while it pushes."""

    def __init__(
        self, model: ModalModel, sample_rate: float, *, tool: Tool | None = None, start: int = 0
    ) -> None:
        self._model, self._rate = model, sample_rate
        self.now = start
        self._tool = tool or Tool()
        self._updates: deque[Update] = deque()
        self._heard: Update | None = None
        self._said: tuple[ModalModel, Update] | None = None
        self._interval = sample_rate / USUAL
        self._load, self._speed, self._pressed, self._moving = Ramp(), Ramp(), Ramp(), Ramp()
        self._drive, self._place = Blend(), Places()
        hann = np.hanning(max(1, round(_WINDOW * sample_rate)) + 2)[1:-1]
        self._window: Array = hann / hann.sum()
        self._before: Array = np.zeros(len(self._window) - 1)
        self._fade = max(1, round(FADE * sample_rate))
        self._reader = Reader(self._tool.on(model), sample_rate)
        self._looks = np.zeros((2, 2))  # speed, load where the last chunk began and this one
        self._way = 0.0  # m
        self._rubbed_for, self._skipped, self._still = 0, 0, 0  # samples
        self.ended = False

    @property
    def finished(self) -> bool:
        """Whether no force will come any more: only once `ended` was set and the load is off."""
        return self.ended and self.at_rest

    @property
    def at_rest(self) -> bool:
        """Whether it is let go of, and no update waits."""
        return not self._updates and self._is_off()

    def resume(self, sample: int) -> None:
        """Go on in the block that begins at this sample, after rest for which it was not asked."""
        self._skipped += sample - self.now if self._heard else 0
        self.now = sample

    def update(
        self,
        at: Contact | Place,
        force: float,
        velocity: float | ArrayLike = 0.0,
        *,
        direction: Place = None,
        sample: int | None = None,
    ) -> Update:
        """Follow a new place, load, N, and velocity along the surface, m/s; a load of 0 lets go."""
        word = self.word(at, force, velocity, direction=direction, sample=sample)
        self.follow(word)
        return word

    def word(
        self,
        at: Contact | Place,
        force: float,
        velocity: float | ArrayLike = 0.0,
        *,
        direction: Place = None,
        sample: int | None = None,
    ) -> Update:
        """Return the checked `Update` that `update` would follow."""
        if not 0 <= force <= HEAVIEST:
            raise OptionError(f"force is {force}: it must lie from 0 to {HEAVIEST:g} N")
        vector, load = np.asarray(velocity, np.float64), float(force)
        if vector.ndim > 1 or not np.isfinite(vector).all():
            raise OptionError(f"velocity is {velocity!r}: give a finite number or (x, y, z) in m/s")
        speed = float(np.linalg.norm(vector))
        model, said = self._model, self._said  # `change` may be called from another thread
        contact = at if isinstance(at, Contact) else model.contact(at, direction)
        if said is not None and said[0] is model and said[1].contact is contact:
            drives = said[1].drive
        else:
            drives = drive(model, contact, radius=self._tool.patch)
        number = self.now if sample is None else sample
        word = Update(sample=number, contact=contact, drive=drives, force=load, speed=speed)
        self._said = model, word
        return word

    def follow(self, word: Update) -> None:
        """Follow an update from its sample on."""
        self._updates.append(word)

    def change(self, model: ModalModel) -> None:
        """Go on with a body that has changed: drives move to those of the new one."""
        self._model = model
        if self._heard is not None:
            drives = drive(model, self._heard.contact, radius=self._tool.patch)
            self._drive.toward(drives, max(1, round(self._interval)))

    @property
    def load(self) -> float:
        """Load at the end of the last block, N."""
        return self._load.value * self._pressed.value

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, None where there is no force in them."""
        loads, speeds, pressed, moving = courses = np.empty((4, length))
        places = np.empty((length, 3))
        first, done = 0 if self._heard else length, 0
        while self._updates and self._updates[0].sample < self.now + length:
            word = self._updates.popleft()
            begin = max(done, word.sample - self.now)
            self._fill(courses[:, done:begin], places[done:begin])
            first, done = min(first, begin), begin
            self._take(word)
        self._fill(courses[:, done:], places[done:])
        self.now += length
        if self._heard is None or self._rests(length, pressed):
            return None
        longer = np.concatenate([self._before, loads * pressed])
        self._before = longer[length:]
        force = np.convolve(longer, self._window, "valid")
        rubbing = self._rub(places[first:], loads[first:], speeds[first:])
        force[first:] += rubbing * moving[first:]
        return Push(force=force, drive=self._drive.now)

    def _fill(self, courses: Array, places: Array) -> None:
        ramps = (self._load, self._speed, self._pressed, self._moving)
        for course, ramp in zip(courses, ramps, strict=True):
            course[:] = ramp.take(courses.shape[1])
        places[:] = self._place.take(len(places))
        self._drive.go(courses.shape[1])

    def _take(self, word: Update) -> None:
        """Set the ramps for an update."""
        gap = self._gap(word.sample)
        jump = self._is_off()
        if word.force > 0:
            self._load.toward(word.force, 0 if jump else gap)
        self._pressed.toward(1.0 if word.force > 0 else 0.0, gap)
        speed = word.speed if word.force > 0 else 0.0
        self._speed.toward(speed, 0 if jump else gap)
        self._moving.toward(1.0 if speed else 0.0, gap)  # at rest the force is the load
        self._drive.toward(word.drive, 0 if jump else gap)
        between = 0 if self._heard is None else word.sample - self._heard.sample
        self._place.toward(word.contact.point, speed * between / self._rate, 0 if jump else gap)
        self._heard = word

    def _gap(self, sample: int) -> int:
        """Return how many samples there are likely to be until the next update."""
        if self._heard is not None:
            between = sample - self._heard.sample
            if self._rate / FASTEST / _PAUSE <= between <= self._rate / SLOWEST * _PAUSE:
                self._interval += _CALM * (between - self._interval)
        return max(1, round(self._interval))

    def _is_off(self) -> bool:
        return self._pressed.value == 0.0 == self._pressed.target

    def _rests(self, length: int, pressed: Array) -> bool:
        """Tell whether it is silent, smoothing included; count silent samples."""
        if pressed.any():
            self._still = 0
            return False
        self._still += length
        if self._still < length + len(self._window) + 2 * CHUNK:
            return False
        self._skipped += length
        return True

    def _rub(self, places: Array, loads: Array, speeds: Array) -> Array:
        """Return the force of the surface at places (n, 3) under loads and speeds (n,), N."""
        count = len(loads)
        if not count:
            return np.zeros(0)
        if self._skipped:  # at rest it was not asked
            self._rubbed_for += self._skipped
            self._skipped, self._looks = 0, np.array([(0.0, loads[0])] * 2)
        first = self._rubbed_for
        looked = np.arange(-first % CHUNK, count, CHUNK)
        looks = np.concatenate([self._looks, np.stack([speeds[looked], loads[looked]], axis=1)])
        begun = first % CHUNK
        row = 0 if begun else 1  # of the look at the begin of the chunk before the first sample's
        ways = self._way + np.cumsum(speeds) / self._rate
        squeezes = self._reader.squeezes(begun, places, ways, *looks[row:].T.copy())
        self._looks, self._way = looks[-2:], float(ways[-1])
        self._rubbed_for += count
        numbers = np.arange(first, first + count, dtype=np.float64)
        return limited(squeezes, loads) * fading(numbers, self._fade, None)


@checked
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
        """Begin on a model at sample number `start`; see `struck.excitation.excitation`.

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
    """A `Pushing` that plays the touch of a log."""

    def __init__(
        self, log: TouchLog, model: ModalModel, sample_rate: float, *, start: int = 0
    ) -> None:
        self._touching = Touching(model, sample_rate, tool=log.tool, start=start)
        self._log, self._model, self._now, self._next = log, model, start, 0
        self._samples = np.round(np.asarray(log.times) * sample_rate).astype(np.int64)
        self._contact: Contact | None = None

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples; ContactError off the body."""
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
        (point, way), (before, way_before) = log.place(number), log.place(number - 1)
        turned = way is not None and way_before is not None and not np.array_equal(way, way_before)
        if self._contact is None or turned or not np.array_equal(point, before):
            self._contact = self._model.contact(point, way)
        self._touching.update(
            self._contact,
            float(np.asarray(log.forces)[number]),
            float(np.asarray(log.speeds)[number]),
            sample=int(self._samples[number]),
        )
        self._touching.ended = number == len(self._samples) - 1


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


class Places:
    """Where on its surface a touch is felt: the point that was said, where that moves as it should.

    Where a speed is said and the point stands still, the surface moves past under it: it goes on by
    the distance, along a line of its own.
    """

    def __init__(self) -> None:
        self._now, self._target = np.zeros(3), np.zeros(3)
        self._said: Array | None = None
        self._left = 0

    def toward(self, point: Array, way: float, samples: int) -> None:
        """Set the next point (D,), after `way` m, to be reached after some samples."""
        said = np.zeros(3)
        said[: len(point)] = point
        step = said if self._said is None else said - self._said
        if self._said is not None and np.linalg.norm(step) < _MOVES * way:
            step = np.array([way, 0.0, 0.0])
        self._target = self._target + step
        self._said, self._left = said, samples
        if samples == 0:
            self._now = self._target

    def take(self, count: int) -> Array:
        """Return the next places (count, 3), m."""
        if self._left == 0 or count == 0:
            return np.broadcast_to(self._now, (count, 3))
        shares = np.minimum(np.arange(1, count + 1) / self._left, 1.0)
        found = self._now + shares[:, None] * (self._target - self._now)
        self._left = max(0, self._left - count)
        self._now = found[-1] if self._left else self._target
        return found


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

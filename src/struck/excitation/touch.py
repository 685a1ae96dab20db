"""A touch: a hand, a tool or a haptic device on a body, updated from outside at its own rate.

60 to 1000 updates per second give its position, load and speed. Between updates all values are
interpolated linearly over the expected interval, and the load then passes a window of 2 ms, or the
tool's kernel: no step, no corner, nothing of the rate of the updates above about 1 kHz (2007 closes
a loop of contacts at 100 Hz over audio in the same way). A moving contact adds the force of the
surface at its place, as a scrape does (`struck.excitation.scraping_force`). A steady load is
silent; only its changes sound.
"""

from __future__ import annotations

from collections import deque
from copy import copy
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from struck.core import entry
from struck.errors import ContactError, OptionError, rounded
from struck.excitation.excitation import MAX_LOAD, Push, drive, drive_at, drives_at
from struck.excitation.scraping_force import FADE_SECONDS, Reader, Tool, fading, force_variation
from struck.excitation.texture import CHUNK
from struck.model.arrays import Array, Index, Mask, checked
from struck.model.contact import Contact, Place
from struck.model.model import ModalModel

MIN_RATE, MAX_RATE = 60.0, 1000.0  # Hz, of updates that ramps adapt to
DEFAULT_RATE = 100.0  # Hz, the assumed rate before the second update

_SMOOTHING = 0.25  # how soon the length of ramps follows the rate of updates
_PAUSE_RATIO = 1.2  # times the interval of the slowest rate; longer ones are pauses
_PRESSED, _MOVING, _LOAD, _SPEED, _PLACE, _DRIVE = 0, 1, 2, 3, 4, 7  # columns of lines
_STRETCH_SAMPLES, _MAX_BLOCKS = 4096, 32  # samples, and blocks, of a log that are computed at once
_MOVING_RATIO = 0.5  # of the speed; a point that moves less counts as resting


class Update(NamedTuple):
    """Place, load and speed of a touch from one sample on."""

    sample: int  # number of the first sample that it holds for
    point: list[float]  # of the contact, m, or in coordinates of recordings
    direction: Array  # (3,), of the load
    normal: Array  # (3,), of the surface there
    drive: Array  # (M,), kg^-1/2, of each mode there
    force: float  # N, at least 0
    speed: float  # m/s, at least 0


class Updates(NamedTuple):
    """Updates that take effect within one stretch, in order."""

    samples: Index  # (K,)
    points: Array  # (K, D)
    drives: Array  # (K, M)
    forces: Array  # (K,), N
    speeds: Array  # (K,), m/s
    last: Update

    @classmethod
    def of(cls, updates: list[Update]) -> Updates | None:
        """Return single updates as one; None of none."""
        if not updates:
            return None
        return cls(
            samples=np.array([update.sample for update in updates]),
            points=np.array([update.point for update in updates]),
            drives=np.array([update.drive for update in updates]),
            forces=np.array([update.force for update in updates]),
            speeds=np.array([update.speed for update in updates]),
            last=updates[-1],
        )


class Grasps(NamedTuple):
    """Contacts and drives of updates."""

    points: Array  # (K, D)
    directions: Array  # (K, 3), of loads
    normals: Array  # (K, 3)
    drives: Array  # (K, M)


class Touching:
    """A `Pushing` that follows updates of place, load and speed while it pushes."""

    def __init__(
        self, model: ModalModel, sample_rate: float, *, tool: Tool | None = None, start: int = 0
    ) -> None:
        self._model, self._rate = model, sample_rate
        self.now = start
        self._tool = tool or Tool()
        self._updates: deque[Update] = deque()
        self._last_update: Update | None = None
        self._last_contact: tuple[ModalModel, Contact, Array] | None = None
        self._interval = sample_rate / DEFAULT_RATE
        self._line = Line(start - 1, 1, np.zeros(_DRIVE), np.zeros(_DRIVE))
        self._last_drive = np.zeros(0)  # drive of the last push
        self._surface_point = np.zeros(3)  # point of the surface in contact next, m
        self._last_place = np.zeros(0)  # where the last update was, m
        self._window = self._tool.window(sample_rate)
        self._load_history: Array = np.zeros(len(self._window) - 1)
        self._fade_samples = max(1, round(FADE_SECONDS * sample_rate))
        self._reader = Reader(self._tool.on(model), sample_rate)
        self._controls = np.zeros((2, 2))  # speed, load where the last chunk began and this one
        self._distance = 0.0  # m
        self._rubbed_samples, self._skipped_samples, self._still_samples = 0, 0, 0  # samples
        self.ended = False

    @property
    def finished(self) -> bool:
        """Whether no force will come any more: only once `ended` was set and the load is off."""
        return self.ended and self.at_rest

    @property
    def at_rest(self) -> bool:
        """Whether the body is released, and no update waits."""
        return not self._updates and self._is_off()

    def resume(self, sample: int) -> None:
        """Continue in the block that begins at this sample, after a rest without calls."""
        self._skipped_samples += sample - self.now if self._last_update else 0
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
        update = self.make_update(at, force, velocity, direction=direction, sample=sample)
        self.follow(update)
        return update

    def make_update(
        self,
        at: Contact | Place,
        force: float,
        velocity: float | ArrayLike = 0.0,
        *,
        direction: Place = None,
        sample: int | None = None,
    ) -> Update:
        """Return the checked `Update` that `update` would follow."""
        if not 0 <= force <= MAX_LOAD:
            raise OptionError(f"force is {force}: it must lie from 0 to {rounded(MAX_LOAD)} N")
        vector, load = np.asarray(velocity, np.float64), float(force)
        if vector.ndim > 1 or not np.isfinite(vector).all():
            raise OptionError(f"velocity is {velocity!r}: give a finite number or (x, y, z) in m/s")
        speed = float(np.linalg.norm(vector))
        model, last_contact = (
            self._model,
            self._last_contact,
        )  # `change` may be called from another thread
        contact = at if isinstance(at, Contact) else model.contact(at, direction)
        if last_contact is not None and last_contact[0] is model and last_contact[1] is contact:
            drives = last_contact[2]
        else:
            drives = drive(model, contact, radius=self._tool.patch)
        number = self.now if sample is None else sample
        point = contact.point.tolist()
        self._last_contact = model, contact, drives
        return Update(number, point, contact.direction, contact.normal, drives, load, speed)

    def grasps(self, points: Array, directions: Array | None) -> Grasps:
        """Return the contacts and drives at points (K, D)."""
        model, patch = self._model, self._tool.patch
        places, load_directions, normals, faces = model.contacts(points, directions)
        if patch:
            rows = zip(places, normals, load_directions, strict=True)
            drives = np.array([drive_at(model, *row, radius=patch) for row in rows])
        else:
            drives = drives_at(model, places, load_directions, faces=faces)
        return Grasps(places, load_directions, normals, drives)

    def copied(self) -> Touching:
        """Return an independent copy of the touch."""
        duplicate = copy(self)
        duplicate._updates = deque(self._updates)  # noqa: SLF001 - all else is replaced, not changed
        return duplicate

    def follow(self, update: Update) -> None:
        """Follow an update from its sample on."""
        self._updates.append(update)

    def change(self, model: ModalModel) -> None:
        """Continue on a changed body: drives move in a line to the drives of the new one."""
        self._model = model
        last_update = self._last_update
        if last_update is not None:
            place, patch = np.array(last_update.point), self._tool.patch
            drives = drive_at(model, place, last_update.normal, last_update.direction, radius=patch)
            current_values, target_values = self._line.at(self.now), self._line.high.copy()
            target_values[_DRIVE:] = drives
            left = self._line.begin + self._line.length - self.now
            self._line = Line(
                self.now, max(1, left, round(self._interval)), current_values, target_values
            )

    @property
    def load(self) -> float:
        """Load at the end of the last block, N."""
        values = self._line.at(self.now)
        return float(values[_LOAD] * values[_PRESSED])

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, or None without force."""
        updates = []
        while self._updates and self._updates[0].sample < self.now + length:
            updates.append(self._updates.popleft())
        return self.stretch(length, 1, Updates.of(updates))[0]

    def stretch(self, length: int, count: int, updates: Updates | None) -> list[Push | None]:
        """Return the pushes of the next `count` blocks of `length` samples, computed together.

        `updates` are all that take effect in them.
        """
        start, end = self.now, self.now + length * count
        first = 0 if self._last_update else length * count
        lines = self._lines(updates)
        if updates is not None:
            first = min(first, int(lines[0][1]) - start)
        drives = self._drives(lines, np.arange(start + length, end + 1, length))
        courses = sample_lines(lines, start, end, _DRIVE)
        self.now, self._line = end, Line(*(values[-1] for values in lines))
        if count == 1 or courses[_PRESSED].all():
            forces = self._forces(courses, first, length)
        else:
            forces = [
                force
                for block in range(0, length * count, length)
                for force in self._forces(
                    courses[:, block : block + length], min(max(first - block, 0), length), length
                )
            ]
        return [
            None if force is None else Push(force=force, drive=drive)
            for force, drive in zip(forces, drives, strict=True)
        ]

    def _drives(self, lines: Lines, samples: Index) -> list[Array]:
        """Return the drives before some samples; equal drives are the same array."""
        drives = numbers_at(lines, samples, _DRIVE)
        is_same = [np.array_equal(drives[0], self._last_drive)]
        is_same += (drives[1:] == drives[:-1]).all(axis=1).tolist()
        shared_drives = []
        for row, is_equal in zip(drives, is_same, strict=True):
            self._last_drive = self._last_drive if is_equal else row
            shared_drives.append(self._last_drive)
        return shared_drives

    def _forces(self, courses: Array, first: int, length: int) -> list[Array | None]:
        """Return the force of each block of a stretch; None for a silent block."""
        count = courses.shape[1] // length
        if first >= courses.shape[1] or self._rests(length, courses[_PRESSED]):
            return [None] * count
        pressed, moving, loads, speeds = courses[:_PLACE]
        extended_loads = np.concatenate([self._load_history, loads * pressed])
        self._load_history = extended_loads[len(loads) :]
        force = smooth_numbers(extended_loads, self._window)
        points = courses[_PLACE:, first:].T
        force[first:] += self._rub(points, loads[first:], speeds[first:]) * moving[first:]
        return list(force.reshape(count, length))

    def _lines(self, updates: Updates | None) -> Lines:
        """Return the lines of all numbers from now on, to the values of the updates."""
        line = self._line
        start_samples, lengths = np.array([line.begin]), np.array([line.length])
        if updates is None:
            return start_samples, lengths, line.low[None], line.high[None]
        count, columns = len(updates.samples), _DRIVE + updates.drives.shape[1]
        if len(line.low) < columns:  # no drive was known
            line = Line(*line[:2], *np.zeros((2, columns)))
        highs = np.empty((1 + count, columns))
        highs[0] = line.high
        gaps = self._aim(updates, highs)
        min_sample = max(self.now, line.begin)
        start_samples = np.append(
            start_samples, np.maximum.accumulate(np.maximum(updates.samples, min_sample))
        )
        lengths = np.append(lengths, gaps)
        return start_samples, lengths, join_lines(start_samples, lengths, line.low, highs), highs

    def _aim(self, updates: Updates, highs: Array) -> Index:
        """Write the targets of all numbers into `highs` (1 + K, N); return the expected gaps (K,).

        The first row stays.

        A load of 0 lets go: the last one stays, and is no longer pressed.
        """
        is_pressed, target_rows = updates.forces > 0, highs[1:]
        last = np.maximum.accumulate(np.where(is_pressed, np.arange(1, len(highs)), 0))
        speeds = np.where(is_pressed, updates.speeds, 0.0)
        previous_sample = (
            updates.samples[0] if self._last_update is None else self._last_update.sample
        )
        intervals = np.diff(updates.samples, prepend=previous_sample)
        target_rows[:, _PLACE:_DRIVE] = self._find_surface_points(
            updates.points, speeds * intervals / self._rate
        )
        self._last_update = updates.last
        target_rows[:, _PRESSED], target_rows[:, _MOVING], target_rows[:, _SPEED] = (
            is_pressed,
            speeds > 0,
            speeds,
        )
        target_rows[:, _LOAD], target_rows[:, _DRIVE:] = updates.forces, updates.drives
        target_rows[:, _LOAD] = highs[last, _LOAD]
        return self._gaps(intervals)

    def _find_surface_points(self, points: Array, distances: Array) -> Array:
        """Return the points of the surface in contact, m (K, 3).

        They move with the updates.

        If a point rests while the speed is not 0, the surface moves past it: the point of the
        surface advances by `distances`, m (K,), along the x axis.
        """
        places = self._to_space(points)
        steps, axes = np.zeros((len(places), 3)), places.shape[1]
        if self._last_update is None:
            self._last_place, self._surface_point = places[0], np.zeros(3)
            self._surface_point[:axes] = places[0]
        steps[0, :axes] = places[0] - self._last_place
        steps[1:, :axes] = places[1:] - places[:-1]
        is_still = np.sqrt(np.vecdot(steps, steps)) < _MOVING_RATIO * distances
        steps[is_still] = distances[is_still, None] * [1.0, 0.0, 0.0]
        surface_points = self._surface_point + np.cumsum(steps, axis=0)
        self._last_place, self._surface_point = places[-1], surface_points[-1]
        return np.asarray(surface_points, np.float64)

    def _to_space(self, points: Array) -> Array:
        """Return where contacts are in space, m (K, D); none on a recorded body without chart."""
        if not self._model.recorded:
            return points
        chart = self._model.chart
        return points[:, :0] if chart is None else chart.places(points)

    def _gaps(self, intervals: Index) -> Index:
        """Return the likely number of samples from each update to the next."""
        bounds = self._rate / MAX_RATE / _PAUSE_RATIO, self._rate / MIN_RATE * _PAUSE_RATIO
        gaps, self._interval = expect_gaps(intervals, *bounds, self._interval)
        return gaps

    def _is_off(self) -> bool:
        return bool(self._line.at(self.now)[_PRESSED] == 0.0 == self._line.high[_PRESSED])

    def _rests(self, length: int, pressed: Array) -> bool:
        """Return whether a block is silent, smoothing included; count silent samples."""
        if pressed.any():
            self._still_samples = 0
            return False
        self._still_samples += length
        if self._still_samples < length + len(self._window) + 2 * CHUNK:
            return False
        self._skipped_samples += length
        return True

    def _rub(self, points: Array, loads: Array, speeds: Array) -> Array:
        """Return the force of the surface at places (n, 3) under loads and speeds (n,), N."""
        count = len(loads)
        if not count:
            return np.zeros(0)
        if self._skipped_samples:  # no calls while at rest
            self._rubbed_samples += self._skipped_samples
            self._skipped_samples, self._controls = 0, np.array([(0.0, loads[0])] * 2)
        first = self._rubbed_samples
        control_rows = np.arange(-first % CHUNK, count, CHUNK)
        controls = np.concatenate(
            [self._controls, np.stack([speeds[control_rows], loads[control_rows]], axis=1)]
        )
        chunk_offset = first % CHUNK
        row = 0 if chunk_offset else 1  # of the control point before the first sample
        distances = self._distance + np.cumsum(speeds) / self._rate
        compressions = self._reader.compressions(
            chunk_offset, points, distances, *controls[row:].T.copy()
        )
        self._controls, self._distance = controls[-2:], float(distances[-1])
        self._rubbed_samples += count
        return force_variation(compressions, loads) * fading(first, count, self._fade_samples, None)


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TouchLog:
    """A touch, update by update: an excitation that sounds offline as it did live.

    Parameters
    ----------
    times : array-like (K,)
        Time of each update, ascending, s, rounded to the nearest sample.
    points : array-like (K, 3), (K, D) or None, default None
        Points on the body, m, or the D contact coordinates of a recorded body. None: one contact
        throughout, the playing place of the model or the first that was recorded.
    forces : array-like (K,)
        Loads, N, at least 0.
    speeds : array-like (K,) or float, default 0.0
        Speeds along the surface, m/s, at least 0.
    directions : array-like (K, 3) or None, default None
        Directions of the loads. None: straight into the surface.
    tool : Tool, optional
        What touches. Default: ``Tool()``.

    Raises
    ------
    OptionError
        If numbers are not finite or out of range, or arrays differ in length.

    Examples
    --------
    >>> from struck.excitation import TouchLog
    >>> log = TouchLog(times=[0.0, 0.1, 0.2], forces=[0.0, 2.0, 0.0], speeds=[0.0, 0.1, 0.0])
    >>> log.moves()
    array([ True, False, False])
    """

    times: ArrayLike
    points: ArrayLike | None = None
    forces: ArrayLike
    speeds: ArrayLike = 0.0
    directions: ArrayLike | None = None
    tool: Tool = field(default_factory=Tool)

    def __post_init__(self) -> None:
        times = _column("times", self.times, None)
        if not len(times) or times[0] < 0 or np.any(np.diff(times) < 0):
            raise OptionError(f"times are {times}: give at least one, ascending from 0 s on")
        object.__setattr__(self, "times", times)
        if self.points is not None:
            object.__setattr__(self, "points", _rows("points", self.points, len(times), (1, 2, 3)))
        object.__setattr__(self, "forces", _column("forces", self.forces, len(times), MAX_LOAD))
        object.__setattr__(self, "speeds", _column("speeds", self.speeds, len(times), np.inf))
        if self.directions is not None:
            directions = _rows("directions", self.directions, len(times), (3,))
            object.__setattr__(self, "directions", directions)

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Replay:
        """Begin the excitation on a model.

        Parameters
        ----------
        model : ModalModel
            Model of the body.
        sample_rate : float
            Sample rate of the forces, Hz.
        start : int, default 0
            Number of the first sample; negative for a prelude.

        Returns
        -------
        Replay
            The excitation at work, which returns its pushes block by block.

        Raises
        ------
        ContactError
            When it begins off the body; where it leaves it later, `advance` raises that.
        """
        model.contact(*self.place(0))
        return Replay(self, model, sample_rate, start=start)

    def place(self, number: int) -> tuple[Array | None, Array | None]:
        """Return the point and direction of an update.

        Parameters
        ----------
        number : int
            Number of the update, from 0.

        Returns
        -------
        tuple of array (D,) or None, array (3,) or None
            Point, m, and direction; None if not logged.
        """
        points, directions = self.places(np.array([number]))
        return (
            None if points is None else points[0],
            None if directions is None else directions[0],
        )

    def places(self, numbers: Index) -> tuple[Array | None, Array | None]:
        """Return the points and directions of several updates.

        Parameters
        ----------
        numbers : array (K,) of int
            Numbers of the updates, from 0.

        Returns
        -------
        tuple of array (K, D) or None, array (K, 3) or None
            Points, m, and directions; None if not logged.
        """
        tables = (self.points, self.directions)
        points, load_directions = (
            None if rows is None else np.asarray(rows)[numbers] for rows in tables
        )
        return points, load_directions

    def moves(self) -> Mask:
        """Find the updates whose point or direction differs from the previous one.

        Returns
        -------
        array (K,) of bool
            True for the first update, and for each change.
        """
        is_moved = np.zeros(len(np.asarray(self.times)), np.bool_)
        is_moved[0] = True
        for rows in (
            np.asarray(values) for values in (self.points, self.directions) if values is not None
        ):
            is_moved[1:] |= np.any(rows[1:] != rows[:-1], axis=1)
        return is_moved


class Replay:
    """A `Pushing` that plays the touch of a log."""

    # Some blocks are computed at once, and the contacts and drives of all updates in them. Where
    # the next block has another length, or the body changes, it returns to the end of the last
    # block that was given out.

    def __init__(
        self, log: TouchLog, model: ModalModel, sample_rate: float, *, start: int = 0
    ) -> None:
        self._touching = Touching(model, sample_rate, tool=log.tool, start=start)
        self._log, self._model, self._next = log, model, 0
        self._samples = np.round(np.asarray(log.times) * sample_rate).astype(np.int64)
        self._is_moved = log.moves()
        self._last: Grasps | None = None
        self._ready: deque[Push | None] = deque()
        self._length, self._given_count = (
            0,
            0,
        )  # of blocks, samples, and how many of a stretch were given
        self._last_state = self._copy_state()

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples; ContactError off the body."""
        if length != self._length:
            self._return()
            self._length = length
        if not self._ready:
            self._last_state, self._given_count = self._copy_state(), 0
            count = max(1, min(_MAX_BLOCKS, _STRETCH_SAMPLES // length))
            try:
                self._ready.extend(self._stretch(count))
            except ContactError:  # perhaps not of this block
                self._restore()
                self._ready.extend(self._stretch(1))
        self._given_count += 1
        return self._ready.popleft()

    def change(self, model: ModalModel) -> None:
        """Continue with a body that has changed."""
        self._return()
        self._model, self._last = model, None
        self._touching.change(model)
        self._last_state = self._copy_state()

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return self._touching.finished and all(push is None for push in self._ready)

    def _stretch(self, count: int) -> list[Push | None]:
        end = self._touching.now + count * self._length
        first, self._next = self._next, int(np.searchsorted(self._samples, end))
        updates = self._updates(first, self._next) if self._next > first else None
        return self._touching.stretch(self._length, count, updates)

    def _return(self) -> None:
        """Go back to the end of the samples already given out."""
        if self._ready:
            given_count = self._given_count
            self._restore()
            if given_count:
                self._stretch(given_count)

    def _copy_state(self) -> tuple[Touching, int, Grasps | None]:
        return self._touching.copied(), self._next, self._last

    def _restore(self) -> None:
        self._touching, self._next, self._last = self._last_state
        self._last_state = self._copy_state()
        self._ready.clear()
        self._given_count = 0

    def _updates(self, first: int, end: int) -> Updates:
        """Return the updates from number `first` to before `end` of the log."""
        log, last = self._log, self._last
        is_moved = self._is_moved[first:end].copy()
        is_moved[0] |= last is None
        chosen = first + np.flatnonzero(is_moved)
        points, load_directions = log.places(chosen)
        if points is None:
            points = np.tile(self._model.contact().point, (len(chosen), 1))
        grasps = [last] if last is not None and not is_moved[0] else []
        if len(chosen):
            grasps.append(self._touching.grasps(points, load_directions))
        rows = Grasps(*map(np.concatenate, zip(*grasps, strict=True))) if grasps[1:] else grasps[0]
        self._last = Grasps(*(column[-1:] for column in rows))
        if not is_moved.all():
            number = np.cumsum(is_moved) - is_moved[0]
            rows = Grasps(*(column[number] for column in rows))
        forces, speeds = (np.asarray(values)[first:end] for values in (log.forces, log.speeds))
        samples = self._samples[first:end]
        self._touching.ended = end == len(self._samples)
        point, direction, normal, drives = (column[0] for column in self._last)
        return Updates(
            samples=samples,
            points=rows.points,
            drives=rows.drives,
            forces=forces,
            speeds=speeds,
            last=Update(
                sample=int(samples[-1]),
                point=point.tolist(),
                direction=direction,
                normal=normal,
                drive=drives,
                force=float(forces[-1]),
                speed=float(speeds[-1]),
            ),
        )


class Line(NamedTuple):
    """Numbers that change linearly, and stay at the end of the line.

    For a touch they are how far it is pressed and how far it moves, 0 to 1, load, N, speed, m/s,
    place, m, and the drive of each mode.
    """

    begin: int  # sample
    length: int  # samples
    low: Array
    high: Array

    def at(self, sample: int) -> Array:
        """Return the numbers (N,) before a sample."""
        if sample - self.begin >= self.length:
            return self.high
        return self.low + (sample - self.begin) / self.length * (self.high - self.low)


Lines = tuple[Index, Index, Array, Array]  # begins and lengths (L,), lows and highs (L, N)


def expect_gaps(
    intervals: Index, shortest: float, longest: float, interval: float
) -> tuple[Index, float]:
    """Return the gap expected after each update (K,), and the usual interval at the end."""
    compiled_loop = entry("lines_expect")
    if compiled_loop is None:
        return expect_gaps_plainly(intervals, shortest, longest, interval)
    gaps, interval_array = np.empty(len(intervals), np.int64), np.array([interval])
    compiled_loop(intervals, len(intervals), shortest, longest, _SMOOTHING, interval_array, gaps)
    return gaps, float(interval_array[0])


def expect_gaps_plainly(
    intervals: Index, shortest: float, longest: float, interval: float
) -> tuple[Index, float]:
    """Return expected samples between updates like `expect_gaps`, update by update."""
    gaps = []
    for samples in intervals.tolist():
        if shortest <= samples <= longest:
            interval += _SMOOTHING * (samples - interval)
        gaps.append(max(1, round(interval)))
    return np.array(gaps), interval


def join_lines(start_samples: Index, lengths: Index, low: Array, highs: Array) -> Array:
    """Return where lines begin (L, N): the first at `low`, others where the one before is by then.

    At rest, where the first number of the line before is 0, the numbers beyond the first two begin
    at their ends: the force is the load, and nothing needs to be moved there.
    """
    lows = np.empty_like(highs)
    lows[0] = low
    compiled_loop = entry("lines_join")
    if compiled_loop is None:
        return join_lines_plainly(start_samples, lengths, lows, highs)
    compiled_loop(start_samples, lengths, lows, highs, *lows.shape, _LOAD)
    return lows


def join_lines_plainly(start_samples: Index, lengths: Index, lows: Array, highs: Array) -> Array:
    """Return starts of lines like `join_lines`, in plain NumPy; the first of `lows` is filled."""
    for n in range(1, len(lows)):
        line = Line(int(start_samples[n - 1]), int(lengths[n - 1]), lows[n - 1], highs[n - 1])
        lows[n] = line.at(int(start_samples[n]))
        if lows[n, _PRESSED] == 0.0 == highs[n - 1, _PRESSED]:
            lows[n, _LOAD:] = highs[n, _LOAD:]
    return lows


def sample_lines(lines: Lines, start: int, end: int, columns: int) -> Array:
    """Return the first numbers (columns, end - begin) that each sample ends with."""
    start_samples, lengths, lows, highs = lines
    if len(start_samples) == 1 and start - start_samples[0] >= lengths[0]:  # all rest
        return np.repeat(highs[:, :columns].T, end - start, axis=1)
    compiled_loop = entry("lines_fill")
    if compiled_loop is None:
        return read_plainly(lines, np.arange(start + 1, end + 1))[:, :columns].T
    values = np.empty((columns, end - start))
    compiled_loop(
        start_samples, lengths, lows, highs, *lows.shape, columns, start, end - start, values
    )
    return values


def numbers_at(lines: Lines, samples: Index, column: int) -> Array:
    """Return the numbers from a column on (K, N - column) before some samples (K,), ascending."""
    start_samples, lengths, lows, highs = lines
    compiled_loop = entry("lines_read")
    if compiled_loop is None:
        return read_plainly(lines, samples)[:, column:]
    values = np.empty((len(samples), lows.shape[1] - column))
    compiled_loop(
        start_samples, lengths, lows, highs, *lows.shape, column, samples, len(samples), values
    )
    return values


def smooth_numbers(numbers: Array, window: Array) -> Array:
    """Return the convolution of numbers with a window, where the window is full."""
    compiled_loop = entry("lines_smooth")
    if compiled_loop is None:
        return np.convolve(numbers, window, "valid")
    out = np.empty(len(numbers) - len(window) + 1)
    compiled_loop(numbers, window, len(window), len(out), out)
    return out


def read_plainly(lines: Lines, samples: Index) -> Array:
    """Return the numbers (K, N) before samples (K,), in plain NumPy."""
    start_samples, lengths, lows, highs = lines
    number = np.maximum(np.searchsorted(start_samples, samples) - 1, 0)
    shares = np.minimum((samples - start_samples[number]) / lengths[number], 1.0)[:, None]
    rises = highs[number] - lows[number]
    return np.where(shares < 1, lows[number] + shares * rises, highs[number])


def _column(name: str, values: ArrayLike, count: int | None, max_value: float = np.inf) -> Array:
    column = np.array(values, np.float64)
    if count is not None and column.ndim == 0:
        column = np.full(count, column)
    if column.ndim != 1 or (count is not None and len(column) != count):
        raise OptionError(f"{name} have shape {column.shape}: give one for each of {count} times")
    if not (np.isfinite(column).all() and np.all(column >= 0) and np.all(column <= max_value)):
        raise OptionError(f"{name} must be finite, at least 0 and at most {rounded(max_value)}")
    column.setflags(write=False)
    return column


def _rows(name: str, values: ArrayLike, count: int, widths: tuple[int, ...]) -> Array:
    rows = np.array(values, np.float64)
    if rows.shape not in {(count, width) for width in widths} or not np.isfinite(rows).all():
        hint = "coordinates" if len(widths) > 1 else "(x, y, z)"
        raise OptionError(f"{name} have shape {rows.shape}: give {count} finite rows of {hint}")
    rows.setflags(write=False)
    return rows

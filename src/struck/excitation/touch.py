"""A touch: a hand, a tool or a haptic device on a body, updated from outside at its own rate.

Whoever moves it says 60 to 1000 times a second where it is, how hard it presses and how fast it
moves. Between two updates everything goes in straight lines, for as long as updates lie apart, and
the load then passes a window of 2 ms, or the tool's kernel: no step, no corner, nothing of the rate
of the updates above about 1 kHz (2007 closes a loop of contacts at 100 Hz over audio in the same
way). A moving contact adds the force of the surface at its place, as a scrape does
(`struck.excitation.friction`). A steady load itself is silent; what is heard is how it changes.
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
from struck.excitation.excitation import HEAVIEST, Push, drive, drive_at, drives_at
from struck.excitation.friction import FADE, Reader, Tool, fading, limited
from struck.excitation.texture import CHUNK
from struck.model.arrays import Array, Index, Mask, checked
from struck.model.contact import Contact, Place
from struck.model.model import ModalModel

SLOWEST, FASTEST = 60.0, 1000.0  # Hz, of updates that ramps adapt to
USUAL = 100.0  # Hz, expected before there were two updates

_CALM = 0.25  # how soon the length of ramps follows the rate of updates
_PAUSE = 1.2  # times the slowest rate's interval: then it is no interval but a pause
_PRESSED, _MOVING, _LOAD, _SPEED, _PLACE, _DRIVE = 0, 1, 2, 3, 4, 7  # columns of lines
_STRETCH, _MOST_BLOCKS = 4096, 32  # samples, and blocks, of a log that are computed at once
_MOVES = 0.5  # share of the speed by which a place must move to be where the surface is felt


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
    def of(cls, words: list[Update]) -> Updates | None:
        """Return single updates as one; None of none."""
        if not words:
            return None
        return cls(
            samples=np.array([word.sample for word in words]),
            points=np.array([word.point for word in words]),
            drives=np.array([word.drive for word in words]),
            forces=np.array([word.force for word in words]),
            speeds=np.array([word.speed for word in words]),
            last=words[-1],
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
        self._heard: Update | None = None
        self._said: tuple[ModalModel, Contact, Array] | None = None
        self._interval = sample_rate / USUAL
        self._line = Line(start - 1, 1, np.zeros(_DRIVE), np.zeros(_DRIVE))
        self._pushed = np.zeros(0)  # drive of the last push
        self._spot = np.zeros(3)  # where on its surface it is felt next, m
        self._last_place = np.zeros(0)  # where the last update was, m
        self._window = self._tool.window(sample_rate)
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
        """Whether the body is let go of, and no update waits."""
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
            raise OptionError(f"force is {force}: it must lie from 0 to {rounded(HEAVIEST)} N")
        vector, load = np.asarray(velocity, np.float64), float(force)
        if vector.ndim > 1 or not np.isfinite(vector).all():
            raise OptionError(f"velocity is {velocity!r}: give a finite number or (x, y, z) in m/s")
        speed = float(np.linalg.norm(vector))
        model, said = self._model, self._said  # `change` may be called from another thread
        contact = at if isinstance(at, Contact) else model.contact(at, direction)
        if said is not None and said[0] is model and said[1] is contact:
            drives = said[2]
        else:
            drives = drive(model, contact, radius=self._tool.patch)
        number = self.now if sample is None else sample
        point = contact.point.tolist()
        self._said = model, contact, drives
        return Update(number, point, contact.direction, contact.normal, drives, load, speed)

    def grasps(self, points: Array, directions: Array | None) -> Grasps:
        """Return the contacts and drives at points (K, D)."""
        model, patch = self._model, self._tool.patch
        places, ways, normals, faces = model.contacts(points, directions)
        if patch:
            rows = zip(places, normals, ways, strict=True)
            drives = np.array([drive_at(model, *row, radius=patch) for row in rows])
        else:
            drives = drives_at(model, places, ways, faces=faces)
        return Grasps(places, ways, normals, drives)

    def copied(self) -> Touching:
        """Return a copy of the touch that goes on independently."""
        other = copy(self)
        other._updates = deque(self._updates)  # noqa: SLF001 - all else is replaced, not changed
        return other

    def follow(self, word: Update) -> None:
        """Follow an update from its sample on."""
        self._updates.append(word)

    def change(self, model: ModalModel) -> None:
        """Continue on a changed body: drives move in a line to the drives of the new one."""
        self._model = model
        held = self._heard
        if held is not None:
            place, patch = np.array(held.point), self._tool.patch
            drives = drive_at(model, place, held.normal, held.direction, radius=patch)
            now, end = self._line.at(self.now), self._line.high.copy()
            end[_DRIVE:] = drives
            left = self._line.begin + self._line.length - self.now
            self._line = Line(self.now, max(1, left, round(self._interval)), now, end)

    @property
    def load(self) -> float:
        """Load at the end of the last block, N."""
        now = self._line.at(self.now)
        return float(now[_LOAD] * now[_PRESSED])

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, None where there is no force in them."""
        words = []
        while self._updates and self._updates[0].sample < self.now + length:
            words.append(self._updates.popleft())
        return self.stretch(length, 1, Updates.of(words))[0]

    def stretch(self, length: int, count: int, told: Updates | None) -> list[Push | None]:
        """Return the pushes of the next `count` blocks of `length` samples, computed together.

        All updates that take effect in them are `told`.
        """
        begin, end = self.now, self.now + length * count
        first = 0 if self._heard else length * count
        lines = self._lines(told)
        if told is not None:
            first = min(first, int(lines[0][1]) - begin)
        drives = self._drives(lines, np.arange(begin + length, end + 1, length))
        courses = each_sample(lines, begin, end, _DRIVE)
        self.now, self._line = end, Line(*(each[-1] for each in lines))
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
        same = [np.array_equal(drives[0], self._pushed)]
        same += (drives[1:] == drives[:-1]).all(axis=1).tolist()
        found = []
        for row, known in zip(drives, same, strict=True):
            self._pushed = self._pushed if known else row
            found.append(self._pushed)
        return found

    def _forces(self, courses: Array, first: int, length: int) -> list[Array | None]:
        """Return the force of each block of a stretch; None in place of one that is silent."""
        count = courses.shape[1] // length
        if first >= courses.shape[1] or self._rests(length, courses[_PRESSED]):
            return [None] * count
        pressed, moving, loads, speeds = courses[:_PLACE]
        longer = np.concatenate([self._before, loads * pressed])
        self._before = longer[len(loads) :]
        force = smoothed(longer, self._window)
        places = courses[_PLACE:, first:].T
        force[first:] += self._rub(places, loads[first:], speeds[first:]) * moving[first:]
        return list(force.reshape(count, length))

    def _lines(self, told: Updates | None) -> Lines:
        """Return the lines of all numbers, from now on, that updates ask for."""
        line = self._line
        begins, lengths = np.array([line.begin]), np.array([line.length])
        if told is None:
            return begins, lengths, line.low[None], line.high[None]
        count, columns = len(told.samples), _DRIVE + told.drives.shape[1]
        if len(line.low) < columns:  # no drive was known
            line = Line(*line[:2], *np.zeros((2, columns)))
        highs = np.empty((1 + count, columns))
        highs[0] = line.high
        gaps = self._aim(told, highs)
        earliest = max(self.now, line.begin)
        begins = np.append(begins, np.maximum.accumulate(np.maximum(told.samples, earliest)))
        lengths = np.append(lengths, gaps)
        return begins, lengths, joined(begins, lengths, line.low, highs), highs

    def _aim(self, told: Updates, highs: Array) -> Index:
        """Fill in where updates want all numbers (1 + K, N), after the first row; return how soon.

        A load of 0 lets go: the last one stays, and is no longer pressed.
        """
        pressed, targets = told.forces > 0, highs[1:]
        last = np.maximum.accumulate(np.where(pressed, np.arange(1, len(highs)), 0))
        speeds = np.where(pressed, told.speeds, 0.0)
        before = told.samples[0] if self._heard is None else self._heard.sample
        between = np.diff(told.samples, prepend=before)
        targets[:, _PLACE:_DRIVE] = self._spots(told.points, speeds * between / self._rate)
        self._heard = told.last
        targets[:, _PRESSED], targets[:, _MOVING], targets[:, _SPEED] = pressed, speeds > 0, speeds
        targets[:, _LOAD], targets[:, _DRIVE:] = told.forces, told.drives
        targets[:, _LOAD] = highs[last, _LOAD]
        return self._gaps(between)

    def _spots(self, points: Array, ways: Array) -> Array:
        """Return the places of the surface that are felt, m (K, 3): the points said, if they move.

        Where a point stands still, the surface moves past under it: it goes on by the way it was
        said to go, m (K,), along a line of its own.
        """
        places = self._placed(points)
        steps, axes = np.zeros((len(places), 3)), places.shape[1]
        if self._heard is None:
            self._last_place, self._spot = places[0], np.zeros(3)
            self._spot[:axes] = places[0]
        steps[0, :axes] = places[0] - self._last_place
        steps[1:, :axes] = places[1:] - places[:-1]
        still = np.sqrt(np.vecdot(steps, steps)) < _MOVES * ways
        steps[still] = ways[still, None] * [1.0, 0.0, 0.0]
        spots = self._spot + np.cumsum(steps, axis=0)
        self._last_place, self._spot = places[-1], spots[-1]
        return np.asarray(spots, np.float64)

    def _placed(self, points: Array) -> Array:
        """Return where contacts are in space, m (K, D); none on a recorded body without chart."""
        if not self._model.recorded:
            return points
        chart = self._model.chart
        return points[:, :0] if chart is None else chart.places(points)

    def _gaps(self, between: Index) -> Index:
        """Return the likely number of samples from each update to the next."""
        bounds = self._rate / FASTEST / _PAUSE, self._rate / SLOWEST * _PAUSE
        gaps, self._interval = expected(between, *bounds, self._interval)
        return gaps

    def _is_off(self) -> bool:
        return bool(self._line.at(self.now)[_PRESSED] == 0.0 == self._line.high[_PRESSED])

    def _rests(self, length: int, pressed: Array) -> bool:
        """Return whether a block is silent, smoothing included; count silent samples."""
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
        return limited(squeezes, loads) * fading(first, count, self._fade, None)


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TouchLog:
    """A touch, update by update: an excitation that sounds offline as it did live.

    Parameters
    ----------
    times : array-like (K,)
        When each update takes effect, ascending, s; moved to the nearest sample.
    points : array-like (K, 3), (K, D) or None
        On the body, m; of a recorded body its D contact coordinates. None: one place throughout,
        the model's playing place, or the first that was recorded.
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
        object.__setattr__(self, "forces", _column("forces", self.forces, len(times), HEAVIEST))
        object.__setattr__(self, "speeds", _column("speeds", self.speeds, len(times), np.inf))
        if self.directions is not None:
            directions = _rows("directions", self.directions, len(times), (3,))
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

    def place(self, number: int) -> tuple[Array | None, Array | None]:
        """Return update `number`'s point (D,), m, and direction (3,); None if not logged."""
        points, directions = self.places(np.array([number]))
        return (
            None if points is None else points[0],
            None if directions is None else directions[0],
        )

    def places(self, numbers: Index) -> tuple[Array | None, Array | None]:
        """Return the points (K, D) and directions (K, 3) at `numbers` (K,); None if not logged."""
        given = (self.points, self.directions)
        points, ways = (None if rows is None else np.asarray(rows)[numbers] for rows in given)
        return points, ways

    def moves(self) -> Mask:
        """Return which updates (K,) have another place or direction than the one before."""
        moved = np.zeros(len(np.asarray(self.times)), np.bool_)
        moved[0] = True
        for rows in (
            np.asarray(each) for each in (self.points, self.directions) if each is not None
        ):
            moved[1:] |= np.any(rows[1:] != rows[:-1], axis=1)
        return moved


class Replay:
    """A `Pushing` that plays the touch of a log."""

    # Some blocks are computed at once, and the contacts and drives of all updates in them. Where
    # the next block has another length, or the body changes, it goes back to the last block that
    # was asked for.

    def __init__(
        self, log: TouchLog, model: ModalModel, sample_rate: float, *, start: int = 0
    ) -> None:
        self._touching = Touching(model, sample_rate, tool=log.tool, start=start)
        self._log, self._model, self._next = log, model, 0
        self._samples = np.round(np.asarray(log.times) * sample_rate).astype(np.int64)
        self._moved = log.moves()
        self._last: Grasps | None = None
        self._ready: deque[Push | None] = deque()
        self._length, self._given = 0, 0  # of blocks, samples, and how many of a stretch were given
        self._before = self._kept()

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples; ContactError off the body."""
        if length != self._length:
            self._return()
            self._length = length
        if not self._ready:
            self._before, self._given = self._kept(), 0
            count = max(1, min(_MOST_BLOCKS, _STRETCH // length))
            try:
                self._ready.extend(self._stretch(count))
            except ContactError:  # perhaps not of this block
                self._restore()
                self._ready.extend(self._stretch(1))
        self._given += 1
        return self._ready.popleft()

    def change(self, model: ModalModel) -> None:
        """Go on with a body that has changed."""
        self._return()
        self._model, self._last = model, None
        self._touching.change(model)
        self._before = self._kept()

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return self._touching.finished and all(push is None for push in self._ready)

    def _stretch(self, count: int) -> list[Push | None]:
        end = self._touching.now + count * self._length
        begin, self._next = self._next, int(np.searchsorted(self._samples, end))
        told = self._updates(begin, self._next) if self._next > begin else None
        return self._touching.stretch(self._length, count, told)

    def _return(self) -> None:
        """Go back to the end of the samples already given out."""
        if self._ready:
            given = self._given
            self._restore()
            if given:
                self._stretch(given)

    def _kept(self) -> tuple[Touching, int, Grasps | None]:
        return self._touching.copied(), self._next, self._last

    def _restore(self) -> None:
        self._touching, self._next, self._last = self._before
        self._before = self._kept()
        self._ready.clear()
        self._given = 0

    def _updates(self, begin: int, end: int) -> Updates:
        """Return the updates from number `begin` to `end` of the log."""
        log, last = self._log, self._last
        moved = self._moved[begin:end].copy()
        moved[0] |= last is None
        chosen = begin + np.flatnonzero(moved)
        points, ways = log.places(chosen)
        if points is None:
            points = np.tile(self._model.contact().point, (len(chosen), 1))
        held = [last] if last is not None and not moved[0] else []
        if len(chosen):
            held.append(self._touching.grasps(points, ways))
        rows = Grasps(*map(np.concatenate, zip(*held, strict=True))) if held[1:] else held[0]
        self._last = Grasps(*(column[-1:] for column in rows))
        if not moved.all():
            number = np.cumsum(moved) - moved[0]
            rows = Grasps(*(column[number] for column in rows))
        forces, speeds = (np.asarray(each)[begin:end] for each in (log.forces, log.speeds))
        samples = self._samples[begin:end]
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
    """Numbers that move in a straight line, and stay at its end.

    For a touch they are how far it is pressed and how far it moves, 0 to 1, load, N, speed, m/s,
    place, m, and the drive of each mode.
    """

    begin: int  # sample
    length: int  # samples
    low: Array
    high: Array

    def at(self, sample: int) -> Array:
        """Return how many updates come before a sample number."""
        if sample - self.begin >= self.length:
            return self.high
        return self.low + (sample - self.begin) / self.length * (self.high - self.low)


Lines = tuple[Index, Index, Array, Array]  # begins and lengths (L,), lows and highs (L, N)


def expected(
    between: Index, shortest: float, longest: float, interval: float
) -> tuple[Index, float]:
    """Return the gap expected after each update (K,), and the usual interval at the end."""
    compiled = entry("lines_expect")
    if compiled is None:
        return expected_plainly(between, shortest, longest, interval)
    gaps, now = np.empty(len(between), np.int64), np.array([interval])
    compiled(between, len(between), shortest, longest, _CALM, now, gaps)
    return gaps, float(now[0])


def expected_plainly(
    between: Index, shortest: float, longest: float, interval: float
) -> tuple[Index, float]:
    """Return expected samples between updates like `expected`, update by update."""
    gaps = []
    for samples in between.tolist():
        if shortest <= samples <= longest:
            interval += _CALM * (samples - interval)
        gaps.append(max(1, round(interval)))
    return np.array(gaps), interval


def joined(begins: Index, lengths: Index, low: Array, highs: Array) -> Array:
    """Return where lines begin (L, N): the first at `low`, others where the one before is by then.

    At rest, where the first number of the line before is 0, the numbers beyond the first two begin
    at their ends: the force is the load, and nothing needs to be moved there.
    """
    lows = np.empty_like(highs)
    lows[0] = low
    compiled = entry("lines_join")
    if compiled is None:
        return joined_plainly(begins, lengths, lows, highs)
    compiled(begins, lengths, lows, highs, *lows.shape, _LOAD)
    return lows


def joined_plainly(begins: Index, lengths: Index, lows: Array, highs: Array) -> Array:
    """Return starts of lines like `joined`, in plain NumPy, with the first row of `lows` filled."""
    for n in range(1, len(lows)):
        before = Line(int(begins[n - 1]), int(lengths[n - 1]), lows[n - 1], highs[n - 1])
        lows[n] = before.at(int(begins[n]))
        if lows[n, _PRESSED] == 0.0 == highs[n - 1, _PRESSED]:
            lows[n, _LOAD:] = highs[n, _LOAD:]
    return lows


def each_sample(lines: Lines, begin: int, end: int, columns: int) -> Array:
    """Return the first numbers (columns, end - begin) that each sample ends with."""
    begins, lengths, lows, highs = lines
    if len(begins) == 1 and begin - begins[0] >= lengths[0]:  # all rest
        return np.repeat(highs[:, :columns].T, end - begin, axis=1)
    compiled = entry("lines_fill")
    if compiled is None:
        return at_plainly(lines, np.arange(begin + 1, end + 1))[:, :columns].T
    filled = np.empty((columns, end - begin))
    compiled(begins, lengths, lows, highs, *lows.shape, columns, begin, end - begin, filled)
    return filled


def numbers_at(lines: Lines, samples: Index, column: int) -> Array:
    """Return the numbers from a column on (K, N - column) before some samples (K,), ascending."""
    begins, lengths, lows, highs = lines
    compiled = entry("lines_read")
    if compiled is None:
        return at_plainly(lines, samples)[:, column:]
    read = np.empty((len(samples), lows.shape[1] - column))
    compiled(begins, lengths, lows, highs, *lows.shape, column, samples, len(samples), read)
    return read


def smoothed(numbers: Array, window: Array) -> Array:
    """Return the convolution of numbers with a window, where the window is full."""
    compiled = entry("lines_smooth")
    if compiled is None:
        return np.convolve(numbers, window, "valid")
    out = np.empty(len(numbers) - len(window) + 1)
    compiled(numbers, window, len(window), len(out), out)
    return out


def at_plainly(lines: Lines, samples: Index) -> Array:
    """Return the numbers (K, N) before samples (K,), in plain NumPy."""
    begins, lengths, lows, highs = lines
    number = np.maximum(np.searchsorted(begins, samples) - 1, 0)
    shares = np.minimum((samples - begins[number]) / lengths[number], 1.0)[:, None]
    rises = highs[number] - lows[number]
    return np.where(shares < 1, lows[number] + shares * rises, highs[number])


def _column(name: str, values: ArrayLike, count: int | None, most: float = np.inf) -> Array:
    column = np.array(values, np.float64)
    if count is not None and column.ndim == 0:
        column = np.full(count, column)
    if column.ndim != 1 or (count is not None and len(column) != count):
        raise OptionError(f"{name} have shape {column.shape}: give one for each of {count} times")
    if not (np.isfinite(column).all() and np.all(column >= 0) and np.all(column <= most)):
        raise OptionError(f"{name} must be finite, at least 0 and at most {rounded(most)}")
    column.setflags(write=False)
    return column


def _rows(name: str, values: ArrayLike, count: int, widths: tuple[int, ...]) -> Array:
    rows = np.array(values, np.float64)
    if rows.shape not in {(count, width) for width in widths} or not np.isfinite(rows).all():
        wanted = "coordinates" if len(widths) > 1 else "(x, y, z)"
        raise OptionError(f"{name} have shape {rows.shape}: give {count} finite rows of {wanted}")
    rows.setflags(write=False)
    return rows

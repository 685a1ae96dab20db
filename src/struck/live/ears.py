"""A listener's ears while bodies are played: the feeder computes delays, the callback sounds.

What the callback needs is in arrays that are laid out once; `struck.ears.delay_lines` describes
their use. The poses of bodies and listener are tables that grow.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from struck.ears.delay_lines import interpolation_kernel
from struck.ears.listeners import Listener, Trajectory
from struck.ears.orientation import MovingPoint, Orientation
from struck.ears.propagation import STRETCH, Pose, Propagation
from struck.errors import ContactError, OptionError, rounded
from struck.live.ring import NEW_WAYS, SINCE, Record
from struck.model.arrays import Array, Complex
from struck.scene.body import Body, centre_of

MAX_DISTANCE = 340.0  # m from a body to a listener while it is played: a second of travel
_VECTOR_TAPS = 8  # taps in a vector
_ZERO_DISTANCE = 1e-7  # m
_HISTORY_SECONDS = 1.5  # s, for which poses are stored: sound that left a body before has arrived


class EarsMemory(ctypes.Structure):
    """Memory of the callback's ears; `callback.h` in the core has the same fields."""

    _fields_ = (
        *((name, ctypes.c_int64) for name in ("lines", "length", "fine", "paths", "taps")),
        *((name, ctypes.c_int64) for name in ("ears", "block", "stretch", "now")),
        *((name, ctypes.c_void_p) for name in ("line", "between", "before", "after", "history")),
        *((name, ctypes.c_void_p) for name in ("heard", "ways", "line_of", "ear_of")),
    )


class Course:
    """Poses of a body or listener over time, added while it sounds, with uniform motion between.

    The feeder's thread alone adds to them.
    """

    def __init__(self, position: Array, rotation: Array) -> None:
        self._times, self._places = np.zeros(1), position[None]
        self._rotations = _quaternions(rotation[None])

    @property
    def last(self) -> tuple[Array, Array]:
        """The last pose: place, m (3,), and unit quaternion (4,)."""
        return self._places[-1], self._rotations[-1]

    def add(self, times: Array, positions: Array, rotations: Array) -> None:
        """Add poses at ascending times, s (K,), which replace all from the first of them on."""
        oldest_row = np.searchsorted(self._times, times[0] - _HISTORY_SECONDS) - 1
        rows = slice(max(0, int(oldest_row)), int(np.searchsorted(self._times, times[0])))
        self._times = np.concatenate([self._times[rows], times])
        self._places = np.concatenate([self._places[rows], positions])
        self._rotations = np.concatenate([self._rotations[rows], rotations])

    def go(
        self, time: float, place: Array | None, target_quaternion: Array | None, duration: float
    ) -> None:
        """Move to a pose from a time on, in `duration` s; a part that is None stays as it was."""
        position, quaternion = self.last
        position, quaternion = (
            position if place is None else place,
            quaternion if target_quaternion is None else target_quaternion,
        )
        if not duration:
            return self.add(np.array([time]), position[None], quaternion[None])
        times = np.array([time])
        start_position, start_rotation = (
            self.carried(np.zeros(3)).at(times),
            self.orientation.at(times),
        )
        positions, quaternions = (
            np.vstack([start_position, position]),
            np.vstack([_quaternions(start_rotation), quaternion]),
        )
        return self.add(np.array([time, time + duration]), positions, quaternions)

    @property
    def orientation(self) -> Orientation:
        """Orientation of the body over time."""
        return Orientation(name="rotation", times=self._times, quaternions=self._rotations)

    def carried(self, point: Array) -> MovingPoint:
        """Return a point (3,) of it as it moves, m."""
        origin = Trajectory(name="position", times=self._times, points=self._places)
        return MovingPoint(origin=origin, orientation=self.orientation, point=point)


def _quaternions(rotations: Array) -> Array:
    return Rotation.from_matrix(rotations).as_quat(scalar_first=True)


class Following:
    """Pose of a listener that moves to the places set on the player."""

    moves = True

    def __init__(self, pose: Pose) -> None:
        self.ear_points, self.field = pose.ear_points, pose.field
        self.course = Course(*_require_rest(pose))

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return places and axes as `Pose.at`."""
        moving_point = self.course.carried(np.zeros(3))
        centres, rotations = moving_point.at(times), moving_point.orientation.at(times)
        ears = centres[:, None] + self.ear_points @ rotations
        return np.concatenate([centres[:, None], ears], axis=1), rotations


def _require_rest(pose: Pose) -> tuple[Array, Array]:
    if pose.moves:
        raise OptionError(
            "the listener of a player moves by `player.listener`: give a position and "
            "a direction that stay"
        )
    points, rotations = pose.at(np.zeros(1))
    return points[0, 0].copy(), rotations[0].copy()


class _Bounded(Propagation):
    """Propagation that continues if a body comes over its listener: pressure is bounded there."""

    def _require_possible(self, distances: Array, times: Array, places: Array) -> None:
        pass


class _FieldGains(NamedTuple):
    """Gains of a timbre field (points, M) at both ends of a stretch, with their places."""

    before: Complex
    after: Complex
    places: Array
    toward: Callable[[Array], Complex]


class LiveEars:
    """The ears of a listener, and the memory of the sound that travels to them."""

    def __init__(
        self, bodies: Sequence[Body], listener: Listener, *, sample_rate: float, block: int
    ) -> None:
        self._emitters = [body.emitter for body in bodies]
        self.fields = [number for number, emitter in enumerate(self._emitters) if emitter.field]
        self._field_gains: dict[int, _FieldGains] = {}
        # A coordinate that is a rounding error is 0.
        centres = [centre_of(body.model) for body in bodies]
        self._centres = [np.where(np.abs(c) < _ZERO_DISTANCE, 0.0, c) for c in centres]
        start = np.zeros(1)
        self._courses = [Course(b.origin.at(start)[0], b.orientation.at(start)[0]) for b in bodies]
        self._moved_bodies = set(range(len(bodies)))
        self._pose = Following(Pose.of(listener, self._emitters))
        self._rate, self._block = sample_rate, block
        self._stretch = block * max(1, round(STRETCH / block))
        self._place_bodies()
        self.propagation = _Bounded(
            self._emitters,
            self._pose,
            listener.filters(sample_rate, brief=True),
            sample_rate=sample_rate,
            stretch=self._stretch,
            even=True,
        )
        self._sample_count, self._stretch_samples = 0, self._stretch
        self._require_possible(self.position)
        self._lay_out()

    @property
    def position(self) -> Array:
        """Centre of the head where it goes, m (3,)."""
        return self._pose.course.last[0]

    def heads(self) -> list[Array]:
        """Return the centre of the head in the coordinates of each body, m (3,)."""
        poses = [course.last for course in self._courses]
        rotations = [Rotation.from_quat(rotation, scalar_first=True) for _, rotation in poses]
        return [
            rotation.inv().apply(self.position - position)
            for (position, _), rotation in zip(poses, rotations, strict=True)
        ]

    @property
    def points(self) -> int:
        """Number of points at which bodies sound: 2 if bare ears hear a timbre field, else 1."""
        return self.propagation.lines // len(self._emitters)

    @property
    def paths(self) -> int:
        """Number of paths from bodies to ears."""
        return len(self.propagation.paths.lines)

    @property
    def taps(self) -> int:
        """Length of the ears' responses, padded to whole vectors."""
        return -(-self.propagation.paths.after.shape[1] // _VECTOR_TAPS) * _VECTOR_TAPS

    def _lay_out(self) -> None:
        paths, taps, block, propagation = self.paths, self.taps, self._block, self.propagation
        longest = MAX_DISTANCE / 340.0 * self._rate + propagation.lead + block + 64
        length = 2 << int(np.ceil(np.log2(longest)))
        responses = np.zeros((paths, taps), np.float32)
        responses[:, : propagation.paths.after.shape[1]] = propagation.paths.after
        table = interpolation_kernel()
        # Kept, as the callback has but their addresses.
        self._arrays = {
            "line": np.zeros((propagation.lines, length), np.float32),
            "between": table,
            "before": np.zeros_like(responses),
            "after": responses,
            "history": np.zeros((paths, taps - 1 + block), np.float32),
            "heard": np.zeros((propagation.ears, block), np.float32),
            "ways": np.zeros((2, paths, 3)),
            "line_of": np.array(propagation.paths.lines, np.int64),
            "ear_of": np.array(propagation.paths.ears, np.int64),
        }
        self.memory = EarsMemory(
            lines=propagation.lines,
            length=length,
            fine=len(table) - 1,
            paths=paths,
            taps=taps,
            ears=propagation.ears,
            block=block,
            stretch=self._stretch,
            now=0,
            **{name: array.ctypes.data for name, array in self._arrays.items()},
        )

    def goal(self, listener: Listener) -> tuple[Array, Array]:
        """Return the checked target position (3,), m, and quaternion (4,) of a listener."""
        pose = Pose.of(listener, self._emitters)
        if pose.ear_points.shape != self._pose.ear_points.shape or pose.field != self._pose.field:
            raise OptionError(
                f"the player has {self.propagation.ears} ears and field={self._pose.field!r}, the "
                f"new listener {len(pose.ear_points)} and {pose.field!r}: start another player"
            )
        position, rotation = _require_rest(pose)
        self._require_possible(position)
        return position, _quaternions(rotation[None])[0]

    def go(
        self,
        body: int | None,
        time: float,
        position: Array | None,
        quaternion: Array | None,
        *,
        exact: bool,
    ) -> None:
        """Move a body, or the listener, to a pose at a time, s, or from that time on."""
        course = self._pose.course if body is None else self._courses[body]
        course.go(time, position, quaternion, 0.0 if exact else self._stretch / self._rate)
        self._moved_bodies |= set() if body is None else {body}

    def follow(self, body: int, times: Array, positions: Array, quaternions: Array) -> int:
        """Let a body take poses at times, s (K,); return how many were too far away, and drawn in.

        The lines of sound are no longer than `MAX_DISTANCE`.
        """
        offsets = positions - self.position
        factors = np.minimum(1.0, MAX_DISTANCE / np.maximum(np.linalg.norm(offsets, axis=1), 1e-9))
        self._courses[body].add(times, self.position + offsets * factors[:, None], quaternions)
        self._moved_bodies.add(body)
        return int(np.count_nonzero(factors < 1))

    def _place_bodies(self) -> None:
        """Update the emitters of `propagation` to the present courses."""
        for body in self._moved_bodies:
            centre = self._courses[body].carried(self._centres[body])
            self._emitters[body] = replace(self._emitters[body], centre=centre)
        self._moved_bodies.clear()

    def _require_possible(self, place: Array) -> None:
        for number, emitter in enumerate(self._emitters):
            distance = float(np.linalg.norm(emitter.centre.at(np.array([np.inf]))[0] - place))
            if emitter.holds(place, np.inf):
                raise ContactError(
                    f"the listener is {rounded(distance, 3)} m from the centre of body {number}, "
                    "inside its surface: move it away"
                )
            if distance > MAX_DISTANCE:
                raise OptionError(
                    f"the listener is {rounded(distance, 4)} m from body {number}: at most "
                    f"{MAX_DISTANCE:g} m while it is played"
                )

    def outputs(self, body: int, toward: Callable[[Array], Complex]) -> Complex:
        """Return the gains of a body with a timbre field at the end of the next block (points, M).

        They are computed by `toward`, of the places of its listeners, once per stretch, and change
        linearly in between. At places without a known field they stay as they were.
        """
        stretch_position = self._stretch_samples % self._stretch
        if not stretch_position:
            self._field_gains[body] = self._compute_gains(body, toward)
        fraction, gains = (stretch_position + self._block) / self._stretch, self._field_gains[body]
        return gains.before + fraction * (gains.after - gains.before)

    def distances(self, body: int) -> Array:
        """Return distances of points from a body's centre now (points,), m; 1 without a field."""
        if body not in self.fields:
            return np.ones(1)
        self._place_bodies()
        places = self.propagation.heard_at(body, self._sample_count / self._rate)
        return np.linalg.norm(places - self._centres[body], axis=1)

    def _compute_gains(self, body: int, toward: Callable[[Array], Complex]) -> _FieldGains:
        self._place_bodies()
        places = self.propagation.heard_at(body, (self._sample_count + self._stretch) / self._rate)
        last = self._field_gains.get(body)
        if last and last.toward == toward and np.array_equal(last.places, places):
            return last._replace(before=last.after)
        try:
            end_gains = toward(places)
        except ContactError:
            if last is None:
                raise
            end_gains = last.after
        return _FieldGains(last.after if last else end_gains, end_gains, places, toward)

    def write(self, record: Record) -> None:
        """Write delays, gains and responses of the next block into its record."""
        self._sample_count += self._block
        record.stretch[NEW_WAYS] = self._stretch_samples == self._stretch
        if self._stretch_samples == self._stretch:
            self._place_bodies()
            paths, self._stretch_samples = self.propagation.go_on(), 0
            record.ways[0], record.ways[1] = paths.delays, paths.gains
            record.responses[:, : paths.after.shape[1]] = paths.after
        record.stretch[SINCE] = self._stretch_samples
        self._stretch_samples += self._block

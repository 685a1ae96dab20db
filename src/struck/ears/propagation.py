"""Propagation of sound from bodies to ears, one stretch of time after the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from operator import is_
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from struck.ears.delay_lines import READ, Paths
from struck.ears.listeners import Listener, Trajectory, axes
from struck.ears.orientation import Centres, MovingPoint
from struck.errors import ContactError, OptionError, rounded
from struck.model.arrays import Array, Single, checked
from struck.model.material import AIR
from struck.model.mesh import Surface

if TYPE_CHECKING:
    from struck.ears.heads import Filters
    from struck.ears.room import Room

STRETCH = 512  # samples between two evaluations of all positions, with a parabola in between
LONGEST_WAY = 10_000.0  # m, the largest distance of a body, or its image, from a listener
# How much earlier than at its centre a head may hear, s, and how long responses wait, samples.
_MAX_ADVANCE, _RESPONSE_LEAD = 1e-3, 16
_MIN_DISTANCE = 1e-3  # m, to a point without a surface
MAX_FIELD_IMAGES = 129  # images of a body with a timbre field: of up to 4 reflections
_ROUNDS = 8  # of the fixed-point iteration for the time when a moving body sent


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Emitter:
    """The place from which a body's sound comes, and its surface.

    Parameters
    ----------
    centre : Trajectory or MovingPoint
        Acoustic centre of the body, m.
    radius : float, default 0.0
        Radius of a sphere about the centre that encloses the body, m.
    surface : Surface or None, default None
        Surface within which no listener may be, in the coordinates of the body of the centre. None:
        the sphere.
    nearest : float, default 0.0
        Distance below which the level is constant, m, as the sound comes from all sides.
    field : {"head", "ears"} or None, default None
        Whether gains depend on direction, and are heard at the centre of the head, and then through
        the head, or at each ear, without a head, unless the listener has another setting. No
        distance law is applied in addition. None: equal in all directions.
    """

    centre: Trajectory | MovingPoint
    radius: float = 0.0
    surface: Surface | None = None
    nearest: float = 0.0
    field: str | None = None

    def holds(self, place: Array, time: float) -> bool:
        """Return whether a point is inside the body at a time.

        Parameters
        ----------
        place : array (3,)
            Point, m.
        time : float
            Time, s.

        Returns
        -------
        bool
            True inside the surface, or the sphere.
        """
        moment = np.array([time])
        distance = float(np.linalg.norm(place - self.centre.at(moment)[0]))
        if self.surface is None or not isinstance(self.centre, MovingPoint):
            return distance < max(self.radius, _MIN_DISTANCE)
        if distance >= self.radius:
            return False
        return bool(self.surface.holds(self.centre.in_body(place, moment))[0])


class Sources:
    """Bodies and their mirror images in the walls of a room.

    An image of what is at p is at signs * p + offsets (I, 3); the first is the body itself.
    """

    def __init__(self, emitters: Sequence[Emitter], signs: Array, offsets: Array) -> None:
        self._emitters, self._signs, self._offsets = emitters, signs, offsets
        self._placed: list[Emitter] = []
        images = len(signs)
        self.emitter = np.repeat(np.arange(len(emitters)), images)
        self.image = np.tile(np.arange(images), len(emitters))
        self.bodies = images * np.arange(len(emitters))
        self._least = np.array([max(emitter.radius, _MIN_DISTANCE) for emitter in emitters])
        self.field = np.repeat([emitter.field is not None for emitter in emitters], images)
        self.nearest = np.repeat(
            [max(emitter.nearest, _MIN_DISTANCE) for emitter in emitters], images
        )

    @classmethod
    def of(cls, emitters: Sequence[Emitter], room: Room | None) -> Sources:
        """Return bodies alone, or with the images that walls make."""
        if room is None:
            return cls(emitters, np.ones((1, 3)), np.zeros((1, 3)))
        images = room.images()
        return cls(emitters, images.signs, images.offsets)

    def require_outside(self, distances: Array, places: Array, times: Array) -> None:
        """Raise a ContactError where a listener at places (n, 3), at times (n,), is in a body."""
        bodies = distances[:, self.bodies]
        if (bodies >= self._least).all():
            return
        for moment, body in np.argwhere(bodies < self._least):
            if self._emitters[body].holds(places[moment], times[moment]):
                raise ContactError(
                    f"the listener is {rounded(bodies[moment, body], 3)} m from the centre of body "
                    f"{body}, inside its surface: move one of them away"
                )

    def heard_at(self, body: int, pose: Posed, time: float, points: slice) -> Array:
        """Return the listener's places as seen from a body and its images at a time of sending, s.

        In its own coordinates, m (images points, 3): a wall mirrors the listener for the body as it
        does the body for the listener. Points are those of the places of a pose.
        """
        moment, centre = np.array([time]), self._emitters[body].centre
        images = self._signs * centre.at(moment) + self._offsets
        path_lengths = np.linalg.norm(pose.at(moment)[0][0, 0] - images, axis=1)
        places = pose.at(time + path_lengths / AIR.sound_speed)[0][:, points]
        mirrored_points = self._signs[:, None] * (places - self._offsets[:, None])
        listener_points = mirrored_points.reshape(-1, 3)
        return (
            centre.in_body(listener_points, moment)
            if isinstance(centre, MovingPoint)
            else listener_points
        )

    @property
    def moves(self) -> bool:
        """Whether any body may move."""
        return any(emitter.centre.moves for emitter in self._emitters)

    def at(self, times: Array, path_lengths: Array) -> Array:
        """Return the places of sources (n, sources, 3) when they sent the sound of times (n,).

        `path_lengths` (n, sources), m, are the distances that the sound has travelled.
        """
        send_times = times[:, None] - path_lengths / AIR.sound_speed
        shape = len(times), len(self._emitters), len(self._signs)
        moments = send_times.reshape(shape).swapaxes(0, 1).reshape(len(self._emitters), -1)
        if not self._placed or not all(map(is_, self._placed, self._emitters)):
            self._placed = [*self._emitters]  # the player replaces its emitters while it plays
            self._centres = Centres([emitter.centre for emitter in self._placed])
        centres = self._centres.at(moments)
        positions = centres.reshape(shape[1], shape[0], shape[2], 3).swapaxes(0, 1)
        return (self._signs * positions + self._offsets).reshape(*path_lengths.shape, 3)


class Posed(Protocol):
    """A head that is somewhere and looks somewhere; see `Pose`."""

    @property
    def ear_points(self) -> Array:
        """Places of the ears in the head's frame, m (ears, 3)."""
        ...

    @property
    def field(self) -> str | None:
        """How timbre fields are heard, "head" or "ears"; None: as each says."""
        ...

    @property
    def moves(self) -> bool:
        """Whether the head may move with time."""
        ...

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return the places of the head's centre and the ears, and its axes."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Pose:
    """A listener's head over time."""

    position: Trajectory
    facing: Trajectory
    up: Trajectory
    ear_points: Array  # (ears, 3), m, in the head's frame
    field: str | None = None  # how timbre fields are heard: "head", "ears", or as each says

    @classmethod
    def of(cls, listener: Listener, emitters: Sequence[Emitter]) -> Pose:
        """Return the pose of a listener.

        Without a position it is near the first body; without a direction it faces the mean of the
        bodies' centres, level; if that is straight above or below or at its place, along x, or
        along y if x is up.
        """
        if listener.field and not any(emitter.field for emitter in emitters):
            reason = (
                f"0 of {len(emitters)} bodies have a timbre field: leave it out, or analyze one"
            )
            raise OptionError(f"field is {listener.field!r}, and {reason} with radiation='field'")
        start = np.zeros(1)
        centres = np.concatenate([emitter.centre.at(start) for emitter in emitters])
        listener_position = listener.position
        default_position = centres[0] + aside(emitters[0].radius)
        position = Trajectory.of(
            "position", default_position if listener_position is None else listener_position
        )
        up, facing = Trajectory.of("up", listener.up), listener.facing
        if facing is None:
            view = centres.mean(axis=0) - position.at(start)[0]
            facing = _level(view, up.at(start)[0])
        return cls(
            position=position,
            facing=Trajectory.of("facing", facing),
            up=up,
            ear_points=listener.ear_points,
            field=listener.field,
        )

    @property
    def moves(self) -> bool:
        """Whether the listener may move or turn."""
        return self.position.moves or self.facing.moves or self.up.moves

    def at(self, times: Array) -> tuple[Array, Array]:
        """Return the places of head and ears (n, 1 + ears, 3), and the head's axes (n, 3, 3).

        Rows of axes are forward, left and up.
        """
        if self.moves:
            return self._at(times)
        places, head_axes = self._rest
        return np.repeat(places, len(times), axis=0), np.repeat(head_axes, len(times), axis=0)

    @cached_property
    def _rest(self) -> tuple[Array, Array]:
        """Places and axes of a head that does not move."""
        return self._at(np.zeros(1))

    def _at(self, times: Array) -> tuple[Array, Array]:
        head_axes = axes(self.facing.at(times), self.up.at(times))
        centre = self.position.at(times)[:, None]
        return np.concatenate([centre, centre + self.ear_points @ head_axes], axis=1), head_axes


def aside(radius: float) -> Array:
    """Return a place well outside a ball, from its centre: along x, 1 m or two radii away (3,)."""
    return np.array([max(1.0, 2 * radius), 0.0, 0.0])


def _level(view: Array, up: Array) -> Array:
    """Return the part of a direction across `up`; of the x or y axis where it is along `up`."""
    for direction in (view, np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])):
        component = direction - up * (direction @ up) / max(up @ up, 1e-30)
        if np.linalg.norm(component) > 1e-6 * max(np.linalg.norm(view), 1.0):
            return component
    return view


class Propagation:
    """Paths from bodies to ears, with delays, gains and the filters of the head.

    Its `lead` is by how many samples all delays are longer, so that none is shorter than `READ` /
    2. Raises ContactError with the listener inside a body, OptionError on impossible directions or
    distances.
    """

    def __init__(
        self,
        emitters: Sequence[Emitter],
        pose: Posed,
        filters: Filters,
        *,
        sample_rate: float,
        stretch: int = STRETCH,
        room: Room | None = None,
        even: bool = False,  # whether all bodies have the same number of delay lines
    ) -> None:
        self._rate, self._stretch, self._pose, self._filters = sample_rate, stretch, pose, filters
        self._walls = None if room is None else room.responses(sample_rate)
        self._sources, self._room = Sources.of(emitters, room), room
        self.ears = len(pose.ear_points)
        self._lines_of, self.lines = self._numbered(emitters, even=even)
        self._ear_of = np.tile(np.arange(self.ears), len(self._lines_of))
        self.lead = READ // 2 + _RESPONSE_LEAD + int(np.ceil(_MAX_ADVANCE * sample_rate))
        self._start()

    def _numbered(
        self, emitters: Sequence[Emitter], *, even: bool
    ) -> tuple[NDArray[np.int64], int]:
        """Return the line of each source and ear (sources, ears), and how many there are."""
        # Each image of a timbre field has its own direction, and so has each ear without a head.
        sources, listener_field = self._sources, self._pose.field
        is_bare = np.array(
            [emitter.field and (listener_field or emitter.field) == "ears" for emitter in emitters],
            bool,
        )
        points, images = np.where(is_bare, self.ears, 1), len(sources.emitter) // len(emitters)
        if images > MAX_FIELD_IMAGES and sources.field.any():
            raise OptionError(
                f"a room makes {images} images of a body, and a timbre field has at most "
                f"{MAX_FIELD_IMAGES} of them: give an order= of 4 at most, and leave later "
                "ones to a Reverberation"
            )
        sizes = points * np.where(sources.field[sources.bodies], images, 1)
        sizes = np.full_like(sizes, sizes.max()) if even else sizes
        firsts = (np.cumsum(sizes) - sizes)[sources.emitter]
        firsts += sources.image * points[sources.emitter] * sources.field
        self._bare = is_bare[sources.emitter]
        return firsts[:, None] + np.outer(self._bare, np.arange(self.ears)), int(sizes.sum())

    def heard_at(self, body: int, time: float) -> Array:
        """Return the listener's places as seen from a timbre field at a time of sending, s.

        In its own coordinates, m (points, 3): of each image, itself first, the head's centre, or
        each ear.
        """
        points = slice(1, None) if self._bare[self._sources.bodies[body]] else slice(0, 1)
        return self._sources.heard_at(body, self._pose, time, points)

    @property
    def images(self) -> int:
        """How many images there are of each body, itself among them."""
        return len(self._sources.emitter) // len(self._sources.bodies)

    def _start(self) -> None:
        self._now, self._rates = -self.lead / self._rate, np.zeros(len(self._sources.emitter))
        self._guess, self._later = self._rates, np.zeros(self._lines_of.shape)
        start = np.array([self._now])
        for _ in range(_ROUNDS):
            self._guess = self._distances(start)[0][0, :, 0]
        delays, gains, responses = self._arriving(start)
        self._end = delays[-1], gains[-1], responses
        self.paths = self._paths_from(self._end, delays[[-1, -1]], gains[[-1, -1]])

    @property
    def still(self) -> bool:
        """Whether neither the body nor its sources move."""
        return not (self._pose.moves or self._sources.moves)

    @property
    def longest(self) -> int:
        """Number of samples until all sound sent now has arrived."""
        delays, _, responses = self._end
        return int(np.ceil(delays.max())) + responses.shape[-1]

    def go_on(self) -> Paths:
        """Return, and keep, the paths of the next stretch."""
        stretch = self._stretch / self._rate
        delays, gains, responses = self._arriving(self._now + np.array([stretch / 2, stretch]))
        self._now += stretch
        previous_end, self._end = self._end, (delays[-1], gains[-1], responses)
        self.paths = self._paths_from(previous_end, delays, gains)
        return self.paths

    def _paths_from(
        self, previous_end: tuple[Array, Array, Single], delays: Array, gains: Array
    ) -> Paths:
        count = self._lines_of.size
        return Paths(
            lines=self._lines_of.ravel(),
            ears=self._ear_of,
            delays=_stack_times(previous_end[0], delays).reshape(count, 3),
            gains=_stack_times(previous_end[1], gains).reshape(count, 3),
            before=previous_end[2].reshape(count, -1),
            after=self._end[2].reshape(count, -1),
            stretch=self._stretch,
        )

    def _arriving(self, times: Array) -> tuple[Array, Array, Single]:
        """Return delays, samples, and gains (n, sources, ears), and the last time's responses."""
        distances, directions, places = self._distances(times)
        centres = distances[..., 0]
        self._require_possible(centres, times, places)
        if len(times) > 1:
            self._rates = (centres[-1] - centres[-2]) / (times[-1] - times[-2])
        self._guess = centres[-1]
        path_lengths = np.where(self._bare[:, None], distances[..., 1:], distances[..., :1])
        distance_gains = 1 / np.maximum(path_lengths, self._sources.nearest[:, None])
        gains = np.where(self._sources.field[:, None], 1, distance_gains)
        head_delays, responses = self._filtered(directions[-1], centres[-1])
        # What heads add moves straight from stretch to stretch.
        shares = np.arange(1, len(times) + 1)[:, None, None] / len(times)
        added_delays, self._later = self._later + shares * (head_delays - self._later), head_delays
        return (
            self.lead + (path_lengths / AIR.sound_speed + added_delays) * self._rate,
            gains,
            responses,
        )

    def _distances(self, times: Array) -> tuple[Array, Array, Array]:
        """Return distances to head and ears (n, sources, 1 + ears), m, directions, and heads."""
        places, head_axes = self._pose.at(times)
        path_lengths = self._guess + np.outer(times - self._now, self._rates)
        sources = self._sources.at(times, path_lengths)
        if self._room is not None:
            self._room.require_inside(places[:, 0], "listener")
            self._room.require_inside(sources[:, self._sources.bodies], "body")
        displacements = sources[:, :, None] - places[:, None]
        distances = np.sqrt(np.einsum("nsed,nsed->nse", displacements, displacements))
        directions = np.einsum("nsd,nad->nsa", displacements[:, :, 0], head_axes)
        return distances, directions / np.maximum(distances[..., :1], 1e-9), places[:, 0]

    def _filtered(self, directions: Array, distances: Array) -> tuple[Array, Single]:
        """Return the delays of the head, s (sources, ears), and all responses."""
        head_delays, responses = self._filters.toward(directions, distances)
        is_bare = self._bare
        if is_bare.any():
            head_delays = np.where(is_bare[:, None], 0, head_delays)
            responses = np.where(is_bare[:, None, None], _unit(responses.shape[-1]), responses)
        if self._walls is not None:
            responses = _convolved(responses, self._walls[self._sources.image])
        return head_delays, responses

    def _require_possible(self, distances: Array, times: Array, places: Array) -> None:
        self._sources.require_outside(distances, places, times)
        if not distances.max() <= LONGEST_WAY:
            raise OptionError(
                f"a body is {rounded(distances.max(), 4)} m from the listener: at most "
                f"{LONGEST_WAY:g} m"
            )


def _stack_times(start_values: Array, later_values: Array) -> Array:
    """Return three values of each path, at begin, middle and end (sources, ears, 3)."""
    return np.stack([start_values, later_values[0], later_values[1]], axis=-1)


def _unit(taps: int) -> Single:
    response = np.zeros(taps, np.float32)
    response[0] = 1
    return response


def _convolved(responses: Single, walls: Single) -> Single:
    """Return responses (sources, ears, taps) convolved with responses of walls (sources, taps)."""
    taps = responses.shape[-1] + walls.shape[-1] - 1
    spectra = np.fft.rfft(responses, taps) * np.fft.rfft(walls, taps)[:, None]
    return np.fft.irfft(spectra, taps).astype(np.float32)

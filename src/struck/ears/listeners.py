"""Listeners: one point, two ears on a ball, or two measured ears; and where they are over time."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from struck.ears.sphere import HEAD_RADIUS
from struck.errors import OptionError, require_choice
from struck.model.arrays import Array, Single, brief, checked, numbers, short_text

if TYPE_CHECKING:
    from struck.ears.heads import Filters, Head

_LARGEST_HEAD = 0.5  # m
_TAPS = 8
UP = (0.0, 0.0, 1.0)
Course3 = ArrayLike | tuple[Sequence[float], ArrayLike] | Callable[[float], ArrayLike]
"""(x, y, z); (times in s, points (T, 3)), joined by straight lines and held beyond their ends; or a
function of the time in s that returns (x, y, z)."""


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Trajectory:
    """A place or a direction over time: a point, a table, or a function.

    Parameters
    ----------
    name : str
        Name of the quantity, for messages.
    times : array (T,)
        Times of a table, s; a constant has one.
    points : array (T, 3)
        Points or directions at these times.
    function : callable or None, default None
        Function of time, s, instead of a table.

    Examples
    --------
    >>> from struck.ears import Trajectory
    >>> path = Trajectory.of("position", ([0.0, 1.0], [[0.0, 0.0, 0.0], [2.0, 0.0, 0.0]]))
    >>> path.at(np.array([0.25, 3.0]))
    array([[0.5, 0. , 0. ],
           [2. , 0. , 0. ]])
    """

    __repr__ = brief
    name: str
    times: Array
    points: Array
    function: Callable[[float], ArrayLike] | None = None

    @classmethod
    def of(cls, name: str, course: Course3) -> Trajectory:
        """Make a trajectory of a constant, a table or a function.

        Parameters
        ----------
        name : str
            Name of the quantity, for messages.
        course : array-like (3,), (times, points) or function of time
            Constant, table (T,), (T, 3), or function.

        Returns
        -------
        Trajectory
            The trajectory.

        Raises
        ------
        OptionError
            If the course is none of these.
        """
        if callable(course):
            return cls(name=name, times=np.zeros(0), points=np.zeros((0, 3)), function=course)
        if is_table(course):
            return cls._table(name, *course)
        return cls(name=name, times=np.zeros(1), points=_points(name, course, (3,))[None])

    @classmethod
    def _table(cls, name: str, times: ArrayLike, points: ArrayLike) -> Trajectory:
        moments = ascending(name, times)
        return cls(name=name, times=moments, points=_points(name, points, (len(moments), 3)))

    @property
    def moves(self) -> bool:
        """Whether the course may change with time."""
        return self.function is not None or len(self.times) > 1

    def at(self, times: Array) -> Array:
        """Interpolate the trajectory.

        Sound that is heard at first was sent before 0 s; until then the trajectory is constant as
        at 0 s.

        Parameters
        ----------
        times : array (n,)
            Times, s.

        Returns
        -------
        array (n, 3)
            Points or directions.
        """
        if self.function is not None:
            points = [self.function(max(time, 0.0)) for time in times.tolist()]
            return _points(self.name, points, (len(times), 3))
        if len(self.times) == 1:
            return np.broadcast_to(self.points[0], (len(times), 3))
        next_rows = np.clip(np.searchsorted(self.times, times), 1, len(self.times) - 1)
        start_times = self.times[next_rows - 1]
        fractions = np.clip((times - start_times) / (self.times[next_rows] - start_times), 0, 1)[
            :, None
        ]
        return (1 - fractions) * self.points[next_rows - 1] + fractions * self.points[next_rows]


def ascending(name: str, times: ArrayLike) -> Array:
    """Return the times of a table, s (T,); OptionError where they do not ascend."""
    moments = np.atleast_1d(numbers(name, times))
    is_ascending = moments.ndim == 1 and np.isfinite(moments).all() and (np.diff(moments) > 0).all()
    if not (len(moments) and is_ascending):
        text = " ".join(str(times).split())
        raise OptionError(f"{name} has times {text:.60}: they must be finite and ascend, in s")
    return moments


def is_table(course: object) -> TypeGuard[tuple[Sequence[float], ArrayLike]]:
    """Return whether a position is a table (times, points) rather than one point."""
    return isinstance(course, tuple) and len(course) == 2 and not np.isscalar(course[1])


def _points(name: str, values: object, shape: tuple[int, ...]) -> Array:
    try:
        points = np.array(numbers(name, values))  # a copy: the caller may change its own
    except OptionError as error:
        text = short_text(values)
        raise OptionError(f"{name} is {text}: give (x, y, z), or (times, points)") from error
    # If the sum is finite, so are all points; it takes less time than the test of all.
    if points.shape != shape or not (math.isfinite(points.sum()) or np.isfinite(points).all()):
        raise OptionError(
            f"{name} is {short_text(values)}: give finite numbers of shape {shape}, or (times, "
            "points), or a function of time"
        )
    return points


class Listener(Protocol):
    """A listener: where it is, where it looks, and the filters of its head."""

    @property
    def position(self) -> Course3 | None:
        """Position of the head's centre, m; None: as for a bare position of `render`."""
        ...

    @property
    def facing(self) -> Course3 | None:
        """Direction of view, of any length; None: level towards the bodies as they are at first."""
        ...

    @property
    def up(self) -> Course3:
        """Direction of the top of the head, of any length; its part along `facing` is removed."""
        ...

    @property
    def ear_points(self) -> Array:
        """Places of the ears in the head's frame (ears, 3), m."""
        ...

    @property
    def field(self) -> str | None:
        """Where timbre fields are evaluated, "head" or "ears"; None: as each field was made."""
        ...

    def filters(self, sample_rate: float, *, brief: bool = False) -> Filters:
        """Return the filters of the head.

        Parameters
        ----------
        sample_rate : float
            Sample rate, Hz.
        brief : bool, default False
            Shorten measured responses, for live playing.

        Returns
        -------
        Filters
            Filters from directions to the ears.
        """
        ...


def is_listener(listener: object) -> TypeGuard[Listener]:
    """Return whether an object is a listener, and not a bare position."""
    return callable(getattr(listener, "filters", None)) and not isinstance(listener, type)


def position_of(listener: Any) -> Array:  # noqa: ANN401 - whatever is no listener
    """Return a listener's bare position (3,), m; OptionError on other values."""
    if isinstance(listener, type):
        raise OptionError(f"{listener.__name__} is a class: give {listener.__name__}(...)")
    if isinstance(listener, str):
        raise OptionError(f"listener is {listener!r}: give one position (x, y, z) in m, or Stereo")
    position = numbers("listener", listener)
    if position.shape != (3,) or not np.isfinite(position).all():
        raise OptionError(f"listener is {listener!r}: give one position (x, y, z) in m")
    return position


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Mono:
    """One ear without a head.

    Parameters
    ----------
    position : array-like (3,), (times, points), function of time or None, default None
        Position, m. None: on the x axis of the first body through its centre, at 1 m or at two of
        its radii, whichever is farther.

    Raises
    ------
    OptionError
        If the position is not one.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> model = struck.analyze(bar, "steel", progress=None)
    >>> ear = struck.Mono(position=(2.0, 0.0, 0.0))
    >>> struck.render(model, struck.Strike(), seconds=0.5, listener=ear).samples.shape
    (1, 24000)
    """

    position: Course3 | None = None

    def __post_init__(self) -> None:
        _require_course(position=self.position)

    @property
    def facing(self) -> Course3:
        """Direction in which the listener looks; any will do for one ear without a head."""
        return (1.0, 0.0, 0.0)

    @property
    def up(self) -> Course3:
        """Direction from the head's centre to its top."""
        return UP

    @property
    def field(self) -> None:
        """Kind of field that the filters hold; none here, as there is no head."""
        return

    @property
    def ear_points(self) -> Array:
        """Place of the ear: the listener's own."""
        return np.zeros((1, 3))

    def filters(self, sample_rate: float, *, brief: bool = False) -> Filters:
        """Return identity filters: one ear, and the sound unchanged.

        Parameters
        ----------
        sample_rate : float
            Has no effect.
        brief : bool, default False
            Has no effect.

        Returns
        -------
        Filters
            Filters of one ear.
        """
        del sample_rate, brief
        return Unchanged(ears=1)


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Stereo:
    """Two ears on a rigid sphere, with delays and levels by formula.

    Parameters
    ----------
    position : array-like (3,), (times, points), function of time or None, default None
        Position, m. None: on the x axis of the first body through its centre, at 1 m or two of its
        radii.
    facing : array-like (3,), (times, points), function of time or None, default None
        Direction of view. None: toward the bodies, as described in `Listener`.
    up : array-like (3,), (times, points) or function of time, default (0, 0, 1)
        Direction of the top of the head. Left is up x facing.
    head : {"exact", "woodworth", "simple1998"}, default "exact"
        "exact": diffraction by a rigid sphere, for near sources too (Duda and Martens 1998);
        "woodworth": the delay of the shortest path around it (Woodworth 1938), and the level by a
        filter of first order (Brown and Duda 1998); "simple1998": only that delay, the left-right
        localisation of van den Doel and Pai (1998).
    radius : float, default 0.0875
        Radius of the sphere, m.
    field : {"head", "ears"} or None, default None
        How bodies with a timbre field are heard: "head": at the centre of the head, and then
        through the head; "ears": at two bare points, as in 2007, so that only the field
        distinguishes the ears. None: computed fields by the head, recorded ones by the ears.

    Raises
    ------
    OptionError
        If the head is unknown, or an argument is out of range.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> body = struck.Body(
    ...     model=struck.analyze(bar, "steel", progress=None), excitations=struck.Strike()
    ... )
    >>> ears = struck.Stereo(position=(0.0, -1.0, 0.0), facing=(1.0, 0.0, 0.0))  # body on the left
    >>> sound = struck.render([body], seconds=0.5, listener=ears)
    >>> left, right = np.abs(sound.samples).max(axis=1)
    >>> bool(left > right)
    True
    """

    position: Course3 | None = None
    facing: Course3 | None = None
    up: Course3 = UP
    head: str = "exact"
    radius: float = HEAD_RADIUS
    field: str | None = None

    def __post_init__(self) -> None:
        _require_head(self)
        _ball(self.head, self.radius)

    @property
    def ear_points(self) -> Array:
        """Places of the left and right ear on the ball."""
        return _on_sides(self.radius)

    def filters(self, sample_rate: float, *, brief: bool = False) -> Filters:
        """Return the filters of a rigid sphere.

        Parameters
        ----------
        sample_rate : float
            Sample rate, Hz.
        brief : bool, default False
            Has no effect.

        Returns
        -------
        Filters
            Filters of both ears.
        """
        del brief
        return _ball(self.head, self.radius).prepared(sample_rate)


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Binaural:
    """Two ears with measured responses, for headphones.

    Parameters
    ----------
    position : array-like (3,), (times, points), function of time or None, default None
        Position, m. None: on the x axis of the first body through its centre, at 1 m or two of its
        radii.
    facing : array-like (3,), (times, points), function of time or None, default None
        Direction of view. None: toward the bodies, as described in `Listener`.
    up : array-like (3,), (times, points) or function of time, default (0, 0, 1)
        Direction of the top of the head. Left is up x facing.
    hrtf : str or path, default "kemar"
        "kemar": the dummy head of Gardner and Martin (1994), which comes with struck; or a SOFA
        file of the convention SimpleFreeFieldHRIR.
    radius : float, default 0.0875
        Half of the distance between the ears, m, if fields are heard at two bare points.
    field : {"head", "ears"} or None, default None
        How bodies with a timbre field are heard: "head": at the centre of the head, and then
        through the head; "ears": at two bare points, as in 2007, so that only the field
        distinguishes the ears. None: computed fields by the head, recorded ones by the ears.

    Raises
    ------
    OptionError
        If an argument is out of range.
    FileFormatError
        If the file is missing, or is not such a set.

    Examples
    --------
    >>> bar = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    >>> model = struck.analyze(bar, "steel", progress=None)
    >>> sound = struck.render(model, struck.Strike(), seconds=0.5, listener=struck.Binaural())
    >>> sound.samples.shape
    (2, 24000)
    """

    position: Course3 | None = None
    facing: Course3 | None = None
    up: Course3 = UP
    hrtf: str | os.PathLike[str] = "kemar"
    radius: float = HEAD_RADIUS
    field: str | None = None

    def __post_init__(self) -> None:
        _require_head(self)
        from struck.ears.measured_head import require_set

        require_set(os.fspath(self.hrtf))

    @property
    def ear_points(self) -> Array:
        """Places of the ears, left and right of the head's centre."""
        return _on_sides(self.radius)

    def filters(self, sample_rate: float, *, brief: bool = False) -> Filters:
        """Return the filters of the measured head.

        Brief ones last 5 ms, 256 samples at 48 kHz.

        Parameters
        ----------
        sample_rate : float
            Sample rate, Hz.
        brief : bool, default False
            Shorten measured responses, for live playing.

        Returns
        -------
        Filters
            Filters of both ears.
        """
        from struck.ears.measured_head import BUNDLED, MeasuredHead

        name = os.fspath(self.hrtf)
        head = MeasuredHead.named(name) if name in BUNDLED else MeasuredHead.read(name)
        return head.prepared(sample_rate, brief=brief)


@dataclass(frozen=True, slots=True, kw_only=True)
class Unchanged:
    """Identity filters: sound passes them unchanged."""

    ears: int

    @property
    def taps(self) -> int:
        """Length of the responses: one SIMD vector."""
        return _TAPS

    def toward(self, directions: Array, distances: Array) -> tuple[Array, Single]:
        """Return zero delays, and unit impulses as responses."""
        del distances
        responses = np.zeros((len(directions), self.ears, _TAPS), np.float32)
        responses[:, :, 0] = 1
        return np.zeros((len(directions), self.ears)), responses


def axes(facing: Array, up: Array) -> Array:
    """Return the head's axes in the scene (n, 3, 3), rows forward, left and up.

    Raises OptionError where `facing` lies along `up`.
    """
    forward = _normal("facing", facing)
    lateral_axes = _across(_normal("up", up), forward)
    if np.abs(lateral_axes).max(axis=1).min() < 1e-9:
        raise OptionError("facing lies along up, z by default: tilt one of them a little")
    left = _normal("left", lateral_axes)
    return np.stack([forward, left, _across(forward, left)], axis=1)


def _across(first: Array, second: Array) -> Array:
    """Return cross products (n, 3), in a third of the time of NumPy's `cross`."""
    a, b = first[:, [1, 2, 0]], second[:, [2, 0, 1]]
    return a * b - first[:, [2, 0, 1]] * second[:, [1, 2, 0]]


def _normal(name: str, vectors: Array) -> Array:
    lengths = np.sqrt(np.einsum("nd,nd->n", vectors, vectors))[:, None]
    if lengths.min() < 1e-9:
        raise OptionError(f"{name} is {vectors[np.argmin(lengths)]}: give one with a length")
    return vectors / lengths


def _on_sides(radius: float) -> Array:
    return np.array([[0.0, radius, 0.0], [0.0, -radius, 0.0]])


def _ball(name: str, radius: float) -> Head:
    from struck.ears.heads import SimpleHead, SphereHead, WoodworthHead

    heads = {"exact": SphereHead, "woodworth": WoodworthHead, "simple1998": SimpleHead}
    require_choice("head", name, heads)
    return heads[name](radius=radius)


def _require_course(**courses: Course3 | None) -> None:
    for name, course in courses.items():
        if course is not None:
            Trajectory.of(name, course)


def _require_head(listener: Stereo | Binaural) -> None:
    _require_course(position=listener.position)
    courses = {"facing": listener.facing, "up": listener.up}
    directions = [
        Trajectory.of(name, course) for name, course in courses.items() if course is not None
    ]
    if len(directions) == 2 and all(direction.function is None for direction in directions):
        axes(*(direction.at(np.zeros(1)) for direction in directions))
    if not 0 < listener.radius <= _LARGEST_HEAD:
        raise OptionError(
            f"radius is {listener.radius} m: a head's lies above 0 and at most at 0.5"
        )
    if listener.field is not None:
        require_choice("field", listener.field, ("head", "ears"), more=", or None")

"""Orientation over time: rotations as unit quaternions, turned evenly from one to the next.

Between two rotations of a table a body turns about one axis at an even rate, the shorter way round
(spherical linear interpolation: Shoemake, SIGGRAPH 1985).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from struck.ears.listeners import Trajectory, ascending, is_table
from struck.errors import OptionError
from struck.model.arrays import Array, Index, numbers

Turning = ArrayLike | tuple[Sequence[float], ArrayLike] | Callable[[float], ArrayLike]
"""A matrix (3, 3) or a unit quaternion (w, x, y, z); (times in s, quaternions (T, 4)), turned
evenly from one to the next and held beyond their ends; or a function of the time in s that returns
a matrix or a quaternion."""

_MATRIX_TOLERANCE = 1e-6  # how far from a rotation a matrix may be
_LENGTH_TOLERANCE = 1e-2  # how far from 1 the length of a quaternion may be
_MIN_ANGLE = 1e-4  # rad, below which a turn is as good as straight


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orientation:
    """How a body is turned over time: a rotation, a table of them, or a function.

    Parameters
    ----------
    name : str
        Name in error messages.
    times : array (T,)
        Times of a table, s; one for a body that does not turn.
    quaternions : array (T, 4)
        Unit quaternions (w, x, y, z) at these times.
    function : callable or None
        Function of the time in s that is used instead of a table. Default: None.
    """

    name: str
    times: Array
    quaternions: Array
    function: Callable[[float], ArrayLike] | None = None

    @classmethod
    def of(cls, name: str, turning: Turning) -> Orientation:
        """Return the orientation of a `Turning`.

        Raises
        ------
        OptionError
            On what is no rotation, table or function.
        """
        if callable(turning):
            empty = np.zeros((0, 4))
            return cls(name=name, times=np.zeros(0), quaternions=empty, function=turning)
        if is_table(turning):
            times, quaternions = ascending(name, turning[0]), numbers(name, turning[1])
            if quaternions.shape != (len(times), 4):
                raise OptionError(
                    f"{name} has times of shape {times.shape} and quaternions of "
                    f"{quaternions.shape}: give ascending times, s, and as many (w, x, y, z)"
                )
            return cls(name=name, times=times, quaternions=_unit(name, quaternions))
        one = numbers(name, turning)
        quaternion = (
            _unit(name, one[None]) if one.shape == (4,) else _quaternion_of_matrix(name, one)[None]
        )
        return cls(name=name, times=np.zeros(1), quaternions=quaternion)

    @property
    def moves(self) -> bool:
        """Whether the orientation may change with time."""
        return self.function is not None or len(self.times) > 1

    def at(self, times: Array) -> Array:
        """Return the rotations from the body's coordinates at some times, s (n,): (n, 3, 3).

        As of a `Trajectory`, all is held as at 0 s until then.
        """
        if self.function is not None:
            values = (numbers(self.name, self.function(max(t, 0.0))) for t in times.tolist())
            rotations = [
                _unit(self.name, one[None])[0]
                if one.shape == (4,)
                else _quaternion_of_matrix(self.name, one)
                for one in values
            ]
            return matrices(np.array(rotations).reshape(-1, 4))
        if len(self.times) == 1:
            return np.broadcast_to(matrices(self.quaternions), (len(times), 3, 3))
        next_rows, fractions = _locate_times(self.times, np.maximum(times, 0.0))
        return matrices(
            slerp(self.quaternions[next_rows - 1], self.quaternions[next_rows], fractions)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class MovingPoint:
    """A point that is carried by a body that moves and turns."""

    origin: Trajectory  # of the body's coordinates, m
    orientation: Orientation
    point: Array  # (3,), in the body's coordinates, m

    @property
    def moves(self) -> bool:
        """Whether the point may move with time."""
        return self.origin.moves or not self._steady

    def at(self, times: Array) -> Array:
        """Return the point's places at times, s (n,): m (n, 3)."""
        return self.origin.at(times) + (self._held if self._steady else self._turned(times))

    @cached_property
    def _steady(self) -> bool:
        return not (self.orientation.moves and self.point.any())

    @cached_property
    def _held(self) -> Array:
        """Place of the point from the origin of a body that does not turn, m (1, 3)."""
        return self._turned(np.zeros(1))

    def _turned(self, times: Array) -> Array:
        return np.asarray(self.orientation.at(times) @ self.point, np.float64)

    def in_body(self, place: Array, times: Array) -> Array:
        """Return a place of the scene, m (3,), in the body's coordinates at times (n,): (n, 3)."""
        displacements = place - self.origin.at(times)
        return np.einsum("nd,nde->ne", displacements, self.orientation.at(times))

    @property
    def tabled(self) -> bool:
        """Whether origin and orientation of the body are given at the same times, from 0 s on."""
        times = self.origin.times
        has_same_times = np.array_equal(times, self.orientation.times)
        return has_same_times and not self._steady and len(times) > 1 and bool(times[0] >= 0)


class Centres:
    """Centres of bodies over time; bodies that share a table of times are computed together."""

    def __init__(self, centres: Sequence[Trajectory | MovingPoint]) -> None:
        numbered_points = [
            (n, centre)
            for n, centre in enumerate(centres)
            if isinstance(centre, MovingPoint) and centre.tabled
        ]
        self._times = numbered_points[0][1].origin.times if numbered_points else np.zeros(0)
        self._together = {
            n: centre
            for n, centre in numbered_points
            if np.array_equal(centre.origin.times, self._times)
        }
        self._alone = {n: centre for n, centre in enumerate(centres) if n not in self._together}
        self._rows = np.array(list(self._together), np.intp)
        self._points = np.array([centre.point for centre in self._together.values()])

    def at(self, moments: Array) -> Array:
        """Return where bodies are, m (bodies, n, 3), at moments of each, s (bodies, n)."""
        places = np.empty((*moments.shape, 3))
        for row, centre in self._alone.items():
            places[row] = centre.at(moments[row])
        if self._together:
            places[self._rows] = self._carried(moments[self._rows])
        return places

    def _carried(self, moments: Array) -> Array:
        """Return the centres of the bodies that share a table of times, m (bodies, n, 3)."""
        next_rows, fractions = _locate_times(self._times, moments)
        ends = np.stack([next_rows - 1, next_rows], axis=1)
        bodies = list(zip(self._together.values(), ends, strict=True))
        origins = np.array([centre.origin.points.take(rows, axis=0) for centre, rows in bodies])
        quaternions = np.array(
            [centre.orientation.quaternions.take(rows, axis=0) for centre, rows in bodies]
        )
        rotations = slerp(
            quaternions[:, 0].reshape(-1, 4), quaternions[:, 1].reshape(-1, 4), fractions.ravel()
        )
        point_vectors = (
            matrices(rotations).reshape(*moments.shape, 3, 3) @ self._points[:, None, :, None]
        )
        fractions = fractions[..., None]
        return (1 - fractions) * origins[:, 0] + fractions * origins[:, 1] + point_vectors[..., 0]


def _locate_times(table: Array, times: Array) -> tuple[Index, Array]:
    """Return the next rows of a table of times after some times, and how far on the way to them."""
    next_rows = np.minimum(np.maximum(np.searchsorted(table, times), 1), len(table) - 1)
    start_times = table[next_rows - 1]
    return next_rows, np.minimum(
        np.maximum((times - start_times) / (table[next_rows] - start_times), 0), 1
    )


def slerp(first: Array, last: Array, fractions: Array) -> Array:
    """Return unit quaternions (n, 4) at fractions (n,) of the shorter arc between two."""
    cosine = np.einsum("nq,nq->n", first, last)
    last = np.where(cosine[:, None] < 0, -last, last)
    angle = np.arccos(np.minimum(np.abs(cosine), 1))
    is_near = angle < _MIN_ANGLE  # the arc is nearly straight
    sines = np.where(is_near, 1.0, np.sin(angle))
    first_weights = np.where(is_near, 1 - fractions, np.sin((1 - fractions) * angle) / sines)
    last_weights = np.where(is_near, fractions, np.sin(fractions * angle) / sines)
    quaternions = first_weights[:, None] * first + last_weights[:, None] * last
    return quaternions / np.sqrt(np.einsum("nq,nq->n", quaternions, quaternions))[:, None]


def matrices(quaternions: Array) -> Array:
    """Return the rotations (n, 3, 3) of unit quaternions (w, x, y, z) (n, 4)."""
    w, x, y, z = quaternions.T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


def _unit(name: str, quaternions: Array) -> Array:
    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    is_wrong = ~(np.abs(lengths - 1) <= _LENGTH_TOLERANCE)
    if is_wrong.any():
        row = quaternions[int(np.argmax(is_wrong))]
        raise OptionError(f"{name} is {row}: give unit quaternions (w, x, y, z)")
    return quaternions / lengths


def _quaternion_of_matrix(name: str, matrix: Array) -> Array:
    """Return the unit quaternion (4,) of a rotation matrix."""
    if matrix.shape != (3, 3) or not np.allclose(
        matrix @ matrix.T, np.eye(3), atol=_MATRIX_TOLERANCE
    ):
        raise OptionError(
            f"{name} is {matrix!r}: give a matrix (3, 3) with orthonormal rows, or a unit "
            "quaternion (w, x, y, z)"
        )
    if np.linalg.det(matrix) < 0:
        raise OptionError(f"{name} is {matrix!r}: it mirrors; give one that turns")
    from scipy.spatial.transform import Rotation

    x, y, z, w = Rotation.from_matrix(matrix).as_quat()
    return np.array([w, x, y, z])

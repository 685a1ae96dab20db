"""Contacts of rigid bodies and their motion: the whole interface to a simulation.

Every simulation, script or hand-written table passes its data as `Contacts`: one row for each point
of contact and step, in the names and the sense of NVIDIA Isaac's raw contact data (``time dt body0
body1 position normal impulse``), since no standard exists.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import OptionError, counted, rounded
from struck.model.arrays import AnyArray, Array, Index, Mask, checked, numbers

_MAX_STEP = 1.0  # s, of one row
_MAX_MAGNITUDE = 1e6  # m, m/s and N s: larger numbers are those of a simulation that exploded
_MAX_TIME = 1e6  # s


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Poses:
    """Where bodies are over time, row by row.

    Parameters
    ----------
    time : array-like (N,)
        Times, s.
    body : array-like (N,) of int
        Number of the body among the names of the log.
    position : array-like (N, 3)
        Position of the origin of the body coordinates in the world, m.
    rotation : array-like (N, 4)
        Unit quaternions (w, x, y, z) from body coordinates to those of the world.
    notes : tuple of str, optional
        Remarks on rows that were left out.

    Raises
    ------
    OptionError
        On numbers that are not finite, no rotations, or not as many.

    Notes
    -----
    Rows are put in order of body and time. Of several rows of one body and time the last counts;
    `notes` tell how many were left out.

    Examples
    --------
    >>> from struck.scene import Poses
    >>> poses = Poses.together(
    ...     time=[0.0, 0.1],
    ...     position=[[[0.0, 0.0, 0.0]], [[0.0, 0.0, 0.5]]],
    ...     rotation=[[[1.0, 0.0, 0.0, 0.0]]] * 2,
    ... )
    >>> times, positions, rotations = poses.of(0)
    >>> positions[:, 2]
    array([0. , 0.5])
    """

    time: Array
    body: Index
    position: Array
    rotation: Array
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        time = _column("time", self.time, None, _MAX_TIME)
        body = _integer_column("body", self.body, len(time))
        position = _column("position", self.position, (len(time), 3))
        rotation = _quaternions(self.rotation, len(time))
        order = np.lexsort((time, body))
        is_duplicate = (np.diff(body[order]) == 0) & (np.diff(time[order]) == 0)
        order = order[~np.append(is_duplicate, False)]
        if is_duplicate.any():
            poses = counted(is_duplicate.sum(), "pose")
            text = f"{poses} at the time of another of their body: the last counts"
            object.__setattr__(self, "notes", (*self.notes, text))
        for name, values in zip(_POSE, (time, body, position, rotation), strict=True):
            _store_array(self, name, values[order])

    @classmethod
    def together(cls, time: ArrayLike, position: ArrayLike, rotation: ArrayLike) -> Poses:
        """Return poses of bodies (B) that are all known at the same times (T).

        Parameters
        ----------
        time : array-like (T,)
            Times, s.
        position : array-like (T, B, 3)
            Positions, m, as in the class.
        rotation : array-like (T, B, 4)
            Rotations, as in the class.

        Returns
        -------
        Poses
            The poses, row by row.

        Raises
        ------
        OptionError
            On arrays of other shapes.
        """
        position_array, rotation_array = (
            numbers("position", position),
            numbers("rotation", rotation),
        )
        if position_array.ndim != 3 or rotation_array.shape != (*position_array.shape[:2], 4):
            raise OptionError(
                f"position has shape {position_array.shape} and rotation {rotation_array.shape}: "
                "give (times, bodies, 3) and (times, bodies, 4)"
            )
        bodies = position_array.shape[1]
        return cls(
            time=np.repeat(numbers("time", time), bodies),
            body=np.tile(np.arange(bodies), len(position_array)),
            position=position_array.reshape(-1, 3),
            rotation=rotation_array.reshape(-1, 4),
        )

    def of(self, body: int) -> tuple[Array, Array, Array]:
        """Return the poses of one body.

        Parameters
        ----------
        body : int
            Number of the body.

        Returns
        -------
        tuple of array (T,), array (T, 3), array (T, 4)
            Times, s, positions, m, and rotations; T may be 0.
        """
        first, last = np.searchsorted(self.body, [body, body + 1])
        return self.time[first:last], self.position[first:last], self.rotation[first:last]


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contacts:
    """A log of the contacts of a scene: one row for each point of contact and time step.

    Parameters
    ----------
    names : sequence of str
        Names of the bodies; `body0` and `body1` number them from 0.
    time : array-like (K,)
        Start of the step in which the impulse acts, s.
    body0 : array-like (K,) of int
        Number of the first body of each contact.
    body1 : array-like (K,) of int
        Number of the second body.
    position : array-like (K, 3)
        Points of contact in the world, m.
    impulse : array-like (K, 3)
        Impulse on body1 during the step, friction included, N s; that on body0 is the opposite.
    dt : array-like (K,) or float, default 0.0
        Duration of the step, s; 0 for an impact that is a single row.
    normal : array-like (K, 3), optional
        Normals from body0 to body1, of any length. Default: the direction of the impulse.
    velocity : array-like (K, 3) or None, default None
        Velocity of body1 relative to body0 at the point at the start of the step, m/s. None:
        unknown.
    id : array-like (K,) of int or None, default None
        Number of the point of contact, the same from step to step, if the simulation has one.
    poses : Poses or None, default None
        Poses of the bodies. None: those of the scene.
    notes : tuple of str, default ()
        Remarks on rows that were changed or left out.

    Raises
    ------
    OptionError
        If numbers are not finite or those of a simulation that exploded, bodies are unknown, a body
        is in contact with itself, or arrays differ in length.

    Notes
    -----
    Rows are sorted by time, and of identical rows one is kept; `notes` report such changes with
    their number.

    Examples
    --------
    >>> from struck.scene import Contacts
    >>> log = Contacts(
    ...     names=["floor", "bar"], time=[0.1], body0=[0], body1=[1], position=[[0.0, 0.0, 0.0]],
    ...     impulse=[[0.0, 0.0, 0.02]],
    ... )  # fmt: skip
    >>> len(log.time), log.normal
    (1, array([[0., 0., 1.]]))
    """

    names: Sequence[str]
    time: Array
    body0: Index
    body1: Index
    position: Array
    impulse: Array
    dt: Array = field(default_factory=lambda: np.zeros(()))
    normal: Array = field(default_factory=lambda: np.zeros((0, 3)))
    velocity: Array | None = None
    id: Index | None = None
    poses: Poses | None = None
    notes: tuple[str, ...] = field(default=())

    def __post_init__(self) -> None:
        object.__setattr__(self, "names", _names(self.names))
        time = _column("time", self.time, None, _MAX_TIME)
        count = len(time)
        columns: dict[str, AnyArray] = {
            "time": time,
            "dt": _steps(self.dt, count),
            "body0": _integer_column("body0", self.body0, count),
            "body1": _integer_column("body1", self.body1, count),
            "position": _column("position", self.position, (count, 3)),
            "impulse": _column("impulse", self.impulse, (count, 3)),
        }
        columns["normal"] = self._normals(columns["impulse"])
        if self.velocity is not None:
            columns["velocity"] = _column("velocity", self.velocity, (count, 3))
        if self.id is not None:
            columns["id"] = _integer_column("id", self.id, count)
        self._require_pairs(columns["body0"], columns["body1"])
        self._require_poses()
        order, notes = _sort_rows(columns)
        for name, values in columns.items():
            _store_array(self, name, values[order])
        pose_notes = () if self.poses is None else self.poses.notes
        object.__setattr__(self, "notes", tuple(dict.fromkeys((*self.notes, *pose_notes, *notes))))

    def __len__(self) -> int:
        return len(self.time)

    @classmethod
    def of_motion(cls, names: Sequence[str], poses: Poses) -> Contacts:
        """Make a log without contacts of moving bodies.

        Parameters
        ----------
        names : sequence of str
            Names of the bodies.
        poses : Poses
            Their poses over time.

        Returns
        -------
        Contacts
            The log.
        """
        no_vectors, no_numbers = np.zeros((0, 3)), np.zeros(0, np.int64)
        return cls(
            names=names,
            time=np.zeros(0),
            body0=no_numbers,
            body1=no_numbers,
            position=no_vectors,
            impulse=no_vectors,
            poses=poses,
        )

    def chosen(self, rows: Index | Mask) -> Contacts:
        """Select rows of the log.

        Parameters
        ----------
        rows : array (R,) of int, or (K,) of bool
            Numbers of the rows, or a mask.

        Returns
        -------
        Contacts
            The selected contacts, with all poses.
        """
        columns = {name: getattr(self, name) for name in _COLUMNS}
        parts = {n: None if v is None else np.asarray(v)[rows] for n, v in columns.items()}
        return replace(self, **parts)

    def _normals(self, impulses: Array) -> Array:
        normals = self.normal if np.size(self.normal) or not len(impulses) else impulses
        normals = _column("normal", normals, impulses.shape)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        # A point without load has no direction; it pushes nothing.
        return np.where(lengths > 0, normals / np.maximum(lengths, 1e-300), (0.0, 0.0, 1.0))

    def _require_pairs(self, body0: Index, body1: Index) -> None:
        for name, column in (("body0", body0), ("body1", body1)):
            invalid_rows = np.flatnonzero((column < 0) | (column >= len(self.names)))
            if len(invalid_rows):
                raise OptionError(
                    f"{name} is {column[invalid_rows[0]]} in row {invalid_rows[0]} and "
                    f"{len(invalid_rows) - 1} others: there are {len(self.names)} names, counted "
                    "from 0; name all bodies"
                )
        self_contacts = np.flatnonzero(body0 == body1)
        if len(self_contacts):
            raise OptionError(
                f"row {self_contacts[0]} and {len(self_contacts) - 1} others let "
                f"{self.names[int(body0[self_contacts[0]])]!r} touch itself: leave them out"
            )

    def _require_poses(self) -> None:
        max_body = -1 if self.poses is None else np.max(self.poses.body, initial=-1)
        if max_body >= len(self.names):
            raise OptionError(
                f"there are poses of body {max_body}, and {len(self.names)} names: name all bodies"
            )


_POSE = ("time", "body", "position", "rotation")
_COLUMNS = ("time", "dt", "body0", "body1", "position", "normal", "impulse", "velocity", "id")


def _sort_rows(columns: dict[str, AnyArray]) -> tuple[Index, tuple[str, ...]]:
    """Return the indices of the rows to keep, in order of time, and notes about changes."""
    time, notes = columns["time"], []
    order = np.arange(len(time))
    if not len(time):
        return order, ()
    reversal_count = int(np.count_nonzero(np.diff(time) < 0))
    if reversal_count:
        order = np.argsort(time, kind="stable")
        notes.append(f"the log went {counted(reversal_count, 'step')} back in time: put in order")
    table = np.column_stack(
        [columns[n][order].reshape(len(time), int(np.prod(columns[n].shape[1:]))) for n in columns]
    )
    is_duplicate = np.zeros(len(time), np.bool_)
    is_duplicate[1:] = (table[1:] == table[:-1]).all(axis=1) & columns["impulse"][order][1:].any(
        axis=1
    )
    if is_duplicate.any():
        notes.append(f"{counted(is_duplicate.sum(), 'row')} of the log as the one before: left out")
    return order[~is_duplicate], tuple(notes)


def _names(names: Sequence[str]) -> tuple[str, ...]:
    body_names = tuple(names)
    duplicate_names = sorted({name for name in body_names if body_names.count(name) > 1})
    if duplicate_names or not all(body_names):
        raise OptionError(f"names are {body_names}: give each body a different name")
    for name in body_names:
        try:
            name.encode()
        except UnicodeEncodeError as error:
            raise OptionError(f"the name {name!r} is no text ({error.reason}): rename it") from None
    return body_names


def _column(
    name: str,
    values: AnyArray,
    shape: tuple[int, ...] | None,
    max_magnitude: float = _MAX_MAGNITUDE,
) -> Array:
    """Return a copy of finite numbers of that shape, or (K,)."""
    column = values.astype(np.float64)
    if column.ndim != 1 if shape is None else column.shape != shape:
        raise OptionError(f"{name} has shape {column.shape}: give {shape or 'one for each row'}")
    is_invalid = ~(np.abs(column) <= max_magnitude)
    if is_invalid.any():
        rows = np.flatnonzero(is_invalid.reshape(len(column), -1).any(axis=1))
        first = ", ".join(map(rounded, column[rows[0]].flat))
        raise OptionError(
            f"{name} is {first} in row {rows[0]}, and {len(rows) - 1} others are not finite or "
            f"beyond {rounded(max_magnitude)} either: leave those out, or end the simulation before"
        )
    return column


def _integer_column(name: str, values: Index, count: int) -> Index:
    return _column(name, values, (count,), 2.0**53).astype(np.int64)


def _steps(values: Array, count: int) -> Array:
    values = np.broadcast_to(values, (count,)) if values.ndim == 0 else values
    steps = _column("dt", values, (count,))
    invalid_rows = np.flatnonzero((steps < 0) | (steps > _MAX_STEP))
    if len(invalid_rows):
        raise OptionError(
            f"dt is {steps[invalid_rows[0]]} s in row {invalid_rows[0]}: it must lie from 0 to "
            f"{_MAX_STEP:g}"
        )
    return steps


def _quaternions(values: Array, count: int) -> Array:
    rotations = _column("rotation", values, (count, 4))
    lengths = np.linalg.norm(rotations, axis=1, keepdims=True)
    invalid_rows = np.flatnonzero(np.abs(lengths - 1) > 0.01)
    if len(invalid_rows):
        raise OptionError(
            f"rotation is {rotations[invalid_rows[0]]} in row {invalid_rows[0]}, whose length is "
            f"{rounded(lengths[invalid_rows[0], 0], 4)}: give unit quaternions (w, x, y, z)"
        )
    return rotations / lengths


def _store_array(holder: object, name: str, values: AnyArray) -> None:
    array = np.ascontiguousarray(values)
    array.setflags(write=False)
    object.__setattr__(holder, name, array)

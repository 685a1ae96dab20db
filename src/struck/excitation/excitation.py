"""Common parts of excitations: bounds, control curves, the area of contact, and pushes.

An excitation is constant; once begun on a model, it pushes the body block after block. A push is
spread over a disc, which drives each mode by the mean of its shape: a patch wider than a mode's
waves does not drive that mode, which is why a soft, broad finger sounds duller than a nail (2007
lets the area of contact shape the sound).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Protocol, runtime_checkable

import numpy as np

from struck.errors import OptionError, require_choice, rounded
from struck.excitation.pulses import SPECTRA, Samples
from struck.model.arrays import Array, Index, brief, checked, require_number
from struck.model.contact import Contact, Place
from struck.model.gains import ShapeGains
from struck.model.model import ModalModel

_RINGS, _SPOKES = 4, 12
# Bounds of numbers, which are squared, divided by, or counted.
_MAX_MAGNITUDE = 1e100
MAX_LOAD = 1e6  # N, the largest load
_BOUNDS = {
    "duration": (0.0, 60.0),  # s
    "load": (0.0, MAX_LOAD),
    "radius": (1e-7, 1e6),  # m
    "rise": (0.0, 60.0),  # s
    "sample_rate": (1.0, 1e6),  # Hz
    "seed": (0.0, 2.0**63),
    "softness": (0.0, 60.0),  # s
}
# A constant; (times in s, values), joined by straight lines and held beyond their ends; or a
# function of the time in s since the excitation began
Course = float | tuple[Sequence[float], Sequence[float]] | Callable[[float], float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Push:
    """A force on one place of a body during one block.

    Parameters
    ----------
    force : array (block,)
        Force at each sample, N, band-limited to half the sample rate.
    drive : array (M,)
        Drive of each mode at the contact at the end of the block, kg^-1/2, followed by the three
        axes of recoil if the body has it and it shall be audible. Within the block the drive is
        interpolated from the last one of the same body and voice. The same array object means an
        unchanged drive: do not write to it afterwards.
    body : int, default 0
        Number of the body in the scene.
    voice : int, default 0
        Number of the voice. Pushes of the same body and voice in consecutive blocks are one contact
        that moves.
    """

    __repr__ = brief
    force: Array
    drive: Array
    body: int = 0
    voice: int = 0


class Pushing(Protocol):
    """An excitation at work on one model."""

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, or None without force."""
        ...

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        ...


@runtime_checkable
class Changing(Protocol):
    """A `Pushing` that continues when its body changes."""

    def change(self, model: ModalModel) -> None:
        """Push at the same place of a body that has changed."""
        ...


class Excitation(Protocol):
    """An excitation of a body: immutable, and the same each time for the same seed."""

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Pushing:
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
        Pushing
            The excitation at work, which returns its pushes block by block.

        Raises
        ------
        ContactError
            When it touches no body.
        """
        ...


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
        self._next_sample = start
        self._contact, self._patch = contact, patch

    @classmethod
    def at(
        cls, contact: Contact, samples: Samples, model: ModalModel, *, patch: float, start: int
    ) -> Burst:
        """Begin on a model, spread over a disc of radius `patch`, m."""
        return cls(
            samples, drive(model, contact, radius=patch), start=start, contact=contact, patch=patch
        )

    def wait(self, block: int) -> int:
        """Go on to the block of `block` samples in which the force begins; return its first one."""
        self._next_sample += max(0, self._samples.first - self._next_sample) // block * block
        return self._next_sample

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, or None without force."""
        offset = self._next_sample - self._samples.first
        self._next_sample += length
        part = self._samples.force[max(offset, 0) : max(offset + length, 0)]
        if not len(part):
            return None
        force = np.zeros(length)
        first = max(-offset, 0)
        force[first : first + len(part)] = part
        return Push(force=force, drive=self._drive)

    def change(self, model: ModalModel) -> None:
        """Push at the same place of a body that has changed, where the place is known."""
        if self._contact is not None:
            self._drive = drive(model, self._contact, radius=self._patch)

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return self._next_sample >= self._samples.first + len(self._samples.force)


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class Hold:
    """A soft grip, which removes energy from the modes that move at its contact.

    A grip of c N s/m resists motion at its contact in every direction. It raises the decay rate of
    a mode by c / 2 times the square of its mass-normalised shape there: modes with a node under the
    hand continue to ring. The shapes of a recorded body are known up to a factor: where a mode
    moves most, its modal mass counts as 1 kg.

    Parameters
    ----------
    at : str, array-like or None, default None
        Contact: a point in body coordinates, m, or a name such as "top", "rim" or "vertex:120".
        None: the playing place of the body (see `ModalModel.contact`).
    grip : float, default 10.0
        Resistance, N s/m; a finger on a bell has about 10.
    time : float, default 0.0
        Start, s.
    seconds : float or None, default None
        Duration, s. None: until the end.
    patch : float, default 0.0
        Radius of the area that is held, m; 0 for a point.

    Raises
    ------
    OptionError
        If a number is out of range.

    Examples
    --------
    >>> plate = struck.shapes.CircularPlate(radius=0.1, thickness=0.002)
    >>> model = struck.analyze(plate, "steel", progress=None)
    >>> damped = struck.Hold(at="rim", grip=10.0, time=0.1)
    >>> free, held = (
    ...     struck.render(model, [struck.Strike(at="quarter"), *holds], seconds=1.0)
    ...     for holds in ([], [damped])
    ... )
    >>> tails = [np.abs(sound.samples[:, 40_000:47_000]).max() for sound in (free, held)]
    >>> bool(tails[1] < 0.1 * tails[0])
    True
    """

    at: Place = None
    grip: float = 10.0
    time: float = 0.0
    seconds: float | None = None
    patch: float = 0.0

    def __post_init__(self) -> None:
        freeze_place(self)
        require_positive(seconds=self.seconds)
        require_at_least_zero(grip=self.grip, time=self.time, patch=self.patch)

    def holds_at(self, time: float) -> bool:
        """Return whether the hand holds the body at a time.

        Parameters
        ----------
        time : float
            Time, s.

        Returns
        -------
        bool
            True from the start of the hold to its end.
        """
        return self.time <= time < self.time + (np.inf if self.seconds is None else self.seconds)

    def raised(self, model: ModalModel) -> Array:
        """Compute the rise of the decay rate of each mode.

        Parameters
        ----------
        model : ModalModel
            Model of the body.

        Returns
        -------
        array (M,)
            Rise, 1/s; of gains with R products (R M,), as in `ModalModel.expanded`.

        Raises
        ------
        ContactError
            When it touches no body.
        """
        contact = model.contact(self.at)
        points, weights = _patch(model, contact.point, contact.normal, self.patch)
        mean_motion = np.tensordot(weights, model.gains.motion(points), 1)
        return _require_finite_gains(self.grip / 2 * np.square(mean_motion).sum(axis=0)).reshape(-1)


def drive(model: ModalModel, contact: Contact, *, radius: float = 0.0) -> Array:
    """Return the mean of each mode shape over a disc of contact, along its push, kg^-1/2 (M,).

    A body with recoil has three entries more, its `drives`.
    """
    return drive_at(model, contact.point, contact.normal, contact.direction, radius=radius)


def drive_at(
    model: ModalModel, point: Array, normal: Array, direction: Array, *, radius: float = 0.0
) -> Array:
    """Return `drive` of a disc about `point`, in the plane whose unit normal is `normal`."""
    points, weights = _patch(model, point, normal, radius)
    return weights @ _drives(model, points, direction)


def _patch(model: ModalModel, point: Array, normal: Array, radius: float) -> tuple[Array, Array]:
    """Return points (K, D) and weights (K,) that average over a disc; of a point, itself."""
    if not radius:
        return point[None], np.ones(1)
    if not normal.any():
        raise OptionError(
            f"the area of contact has a radius of {radius} m, but this body was recorded and has "
            "no surface: leave patch= out"
        )
    if model.geometry is not None and radius > model.geometry.extent:
        limit = f"{rounded(model.geometry.extent, 3)} m, as wide as the body is"
        raise OptionError(f"patch is {radius} m: give at most {limit}")
    places, weights = _disc()
    axis = np.zeros(3)
    axis[np.argmin(np.abs(normal))] = 1.0
    first: Array = np.cross(normal, axis)
    first /= np.linalg.norm(first)
    return point + places @ np.stack([first, np.cross(normal, first)]) * radius, weights


def drives_at(
    model: ModalModel,
    points: Array,
    directions: Array,
    *,
    radius: float = 0.0,
    faces: Index | None = None,
) -> Array:
    """Return drives (K, M) of pushes at points along directions (K, 3): over discs, straight in.

    Where the faces (K,) that points lie on are known, they are not looked up.
    """
    if not radius:
        return _drives(model, points, directions, faces)
    places = zip(points, directions, strict=True)
    return np.stack(
        [drive_at(model, at, -direction, direction, radius=radius) for at, direction in places]
    )


def _drives(
    model: ModalModel, points: Array, directions: Array, faces: Index | None = None
) -> Array:
    """Return the drives (K, M) of pushes at points (K, D) along directions (3,) or (K, 3)."""
    gains, row_directions = model.gains, directions
    if row_directions.shape != (len(points), 3):
        row_directions = np.broadcast_to(row_directions, (len(points), 3))
    if faces is not None and isinstance(gains, ShapeGains):
        drives = gains.at(points, row_directions, faces)
    else:
        drives = gains.at(points, row_directions)
    if drives.shape[1] != 1:
        raise OptionError(
            f"the gains are a sum of {drives.shape[1]} products of contact and listener, and a "
            "push needs one: begin on the model's expanded() copy, as render and play do"
        )
    mode_drives = _require_finite_gains(drives)[:, 0]
    if model.recoil is None:
        return mode_drives
    return np.concatenate([mode_drives, model.recoil.drives(row_directions)], axis=1)


def _require_finite_gains(drives: Array) -> Array:
    """Return drives (..., M), or raise an OptionError unless all are finite."""
    is_finite = np.isfinite(np.vdot(drives, drives)) or np.isfinite(drives)
    if not np.all(is_finite):
        invalid_count = np.count_nonzero(~is_finite.all(axis=tuple(range(drives.ndim - 1))))
        raise OptionError(
            f"{invalid_count} of {drives.shape[-1]} modes have gains that are not finite: "
            "analyze the body again, or look at its model file"
        )
    return drives


@cache
def _disc() -> tuple[Array, Array]:
    """Return points (K, 2) and weights (K,) that average over the unit disc to degree 7."""
    nodes, weights = np.polynomial.legendre.leggauss(_RINGS)
    radii = np.sqrt((nodes + 1) / 2)
    angles = 2 * np.pi * np.arange(_SPOKES) / _SPOKES
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    points = (radii[:, None, None] * rim).reshape(-1, 2)
    return points, np.repeat(weights / 2 / _SPOKES, _SPOKES)


def frozen(name: str, course: Course) -> Course:
    """Return a control curve as immutable values, checked to be finite and at least 0."""
    if callable(course):
        return course
    if not isinstance(course, tuple):
        _require(name, course)
        return course
    times, values = _table(name, course)
    if times.ndim != 1 or times.shape != values.shape or not len(times):
        raise OptionError(f"{name} has times {times.shape} and values {values.shape}: as many each")
    if not (np.isfinite(times).all() and np.all(np.diff(times) > 0)):
        raise OptionError(f"{name} has times {times}: they must be finite and ascend, in s")
    for value in values:
        _require(name, float(value))
    return tuple(times.tolist()), tuple(values.tolist())


def follow(name: str, course: Course) -> Callable[[float], float]:
    """Return a control curve as a function of time that checks each value."""
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
    require_number(name, number, 0.0, _BOUNDS.get(name, (0.0, _MAX_MAGNITUDE))[1])
    return number


def freeze_place(excitation: _Placed, *names: str) -> None:
    """Turn `at` and the named directions of a frozen excitation into plain tuples."""
    at = excitation.at
    if at is not None and not isinstance(at, str):
        object.__setattr__(excitation, "at", coordinates("at", at))
    for name in names:
        value = getattr(excitation, name)
        if value is not None:
            hint = "a vector (x, y, z) with a length from 1e-150 to 1e150"
            vector = _require_finite_vector(name, value, hint)
            with np.errstate(over="ignore"):
                length = float(np.linalg.norm(vector))
            if len(vector) != 3 or not 0 < length < np.inf:
                raise OptionError(f"{name} is {value!r}: give {hint}")
            object.__setattr__(excitation, name, tuple(part / length for part in vector))


def require_positive(**numbers: float | None) -> None:
    """Raise an OptionError unless each number is finite and above 0, or None."""
    for name, value in numbers.items():
        if value is not None:
            min_value, max_value = _BOUNDS.get(name, (0.0, _MAX_MAGNITUDE))
            hint = f"it must be a finite number above {rounded(min_value)}"
            require_number(name, value, min_value, max_value, above=True, hint=hint)


def require_at_least_zero(**numbers: float | None) -> None:
    """Raise an OptionError unless each number is finite and at least 0, or None."""
    for name, value in numbers.items():
        if value is not None:
            require_number(name, value, 0.0, _BOUNDS.get(name, (0.0, _MAX_MAGNITUDE))[1])


def require_finite(**numbers: float) -> None:
    """Raise an OptionError unless each number is finite."""
    for name, value in numbers.items():
        require_number(
            name, value, -_MAX_MAGNITUDE, _MAX_MAGNITUDE, hint="it must be a finite number"
        )


def coordinates(name: str, values: object) -> tuple[float, ...]:
    """Return one to three finite numbers as a tuple, or raise an OptionError."""
    return _require_finite_vector(
        name, values, "one to three finite coordinates in m, or the name of a place"
    )


def _require_finite_vector(name: str, values: object, hint: str) -> tuple[float, ...]:
    try:
        array = np.array(values, dtype=np.float64)
    except OverflowError:
        raise OptionError(f"{name} has a number of hundreds of digits: give {hint}") from None
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name} is {values!r}: give {hint}") from error
    if array.ndim != 1 or not 1 <= array.size <= 3 or not np.isfinite(array).all():
        raise OptionError(f"{name} is {values!r}: give {hint}")
    return tuple(array.tolist())


class _Placed(Protocol):
    @property
    def at(self) -> Place: ...


def require_kernel(
    kernel: str | None, softness: float | None, longest: float = _MAX_MAGNITUDE
) -> str | None:
    """Return the name of the pulse that forces are spread over, or raise an OptionError."""
    require_positive(softness=softness)
    if kernel is not None:
        if softness is not None and softness > longest:
            raise OptionError(
                f"softness is {rounded(softness)} s: it must be at most {rounded(longest)} s here"
            )
        return require_known(kernel, SPECTRA, "kernel")
    if softness is not None:
        raise OptionError(
            f"softness is {softness} s, but of what? add a kernel, such as kernel='gaussian', or "
            "leave it out"
        )
    return None


def require_known(name: str, table: Mapping[str, object], noun: str) -> str:
    """Return the key of a table for a name in any case, or raise an OptionError."""
    key = name.strip().lower()
    require_choice(noun, key, table)
    return key

"""A strike: one short push somewhere on a body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from struck.contact import Contact, Place
from struck.errors import OptionError
from struck.excitation.hertz import (
    Striker,
    contact_modulus,
    contact_time,
    effective_mass,
    joint_mass,
)
from struck.model import ModalModel

_DEFAULT_STRIKER = "wood"
_DEFAULT_SPEED = 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Push:
    """A half-sine of force, F(t) = impulse pi / (2 duration) sin(pi t / duration).

    Parameters
    ----------
    impulse : float
        Its area, N s.
    duration : float
        s; 0 is an ideal impulse.
    """

    impulse: float
    duration: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Strike:
    """A half-sine push at one place of a body.

    How hard is said by `impulse`, or by `striker` and `speed`. With a striker the other of the two
    and the duration follow from elastic impact (Hertz) between its head and the body, whose own
    mass, inertia and material count where the model knows them. A bare ``Strike()`` is the wooden
    striker at 0.5 m/s.

    Parameters
    ----------
    at : array-like, str or None
        Place in body coordinates, m, or its name ("top", "rim", "vertex:120"); None takes the
        loudest contact.
    impulse : float or None
        N s. Without a striker and a duration it acts in no time.
    striker : str or None
        Name in ``strikers.toml``: fingertip, felt, rubber, plastic, wood, brass, steel, glass.
    speed : float or None
        Speed of the striker along `direction` at the first touch, m/s; 0.5 when a striker comes
        with neither impulse nor speed.
    direction : array-like (3,) or None
        Which way it pushes, of any length; None is straight into the surface.
    duration : float or None
        How long it pushes, s; 0 is an ideal impulse, None leaves it to the striker.
    time : float
        When it begins, s.

    Raises
    ------
    OptionError
        On an unknown striker, contradictory arguments, or a number outside its bound.
    """

    at: Place = None
    impulse: float | None = None
    striker: str | None = None
    speed: float | None = None
    direction: Place = None
    duration: float | None = None
    time: float = 0.0

    def __post_init__(self) -> None:
        if self.at is not None and not isinstance(self.at, str):
            object.__setattr__(self, "at", _numbers("at", self.at))
        if self.direction is not None:
            object.__setattr__(self, "direction", _direction(self.direction))
        if self.striker is not None:
            Striker.named(self.striker)
        self._require_one_strength()
        _require_positive(impulse=self.impulse, speed=self.speed)
        _require_at_least_zero(duration=self.duration, time=self.time)

    def _require_one_strength(self) -> None:
        if self.impulse is not None and self.speed is not None:
            raise OptionError(
                f"impulse is {self.impulse} N s and speed is {self.speed} m/s: each follows from "
                "the other, so give one of them"
            )
        if self.speed is not None and self.striker is None:
            raise OptionError(
                f"speed is {self.speed} m/s, but of what? add a striker, such as "
                f"striker={_DEFAULT_STRIKER!r}, or give impulse= in N s instead"
            )

    def resolved(self, model: ModalModel, contact: Contact) -> Push:
        """Return the push that a model receives at a contact.

        A model without mass (as from recordings), or held somewhere, counts as heavy, one without
        material as hard.
        """
        if self.impulse is not None and (self.striker is None or self.duration is not None):
            return Push(impulse=self.impulse, duration=self.duration or 0.0)
        striker = Striker.named(self.striker or _DEFAULT_STRIKER)
        mass = _mass_in_contact(striker, model, contact)
        gain = mass * (1 + striker.restitution)
        speed = self.impulse / gain if self.impulse is not None else self.speed or _DEFAULT_SPEED
        duration = self.duration
        if duration is None:
            duration = _touch(striker, model, mass=mass, speed=speed)
        return Push(impulse=gain * speed, duration=duration)


def _mass_in_contact(striker: Striker, model: ModalModel, contact: Contact) -> float:
    if model.supported or model.mass is None or model.centre is None or model.inertia is None:
        return striker.mass
    body = effective_mass(
        mass=model.mass,
        centre=model.centre,
        inertia=model.inertia,
        point=contact.point,
        direction=contact.direction,
    )
    return joint_mass(striker.mass, body)


def _touch(striker: Striker, model: ModalModel, *, mass: float, speed: float) -> float:
    solids = (striker,) if model.material is None else (striker, model.material)
    modulus = contact_modulus(*solids)
    return contact_time(mass=mass, radius=striker.radius, modulus=modulus, speed=speed)


def _numbers(name: str, values: object) -> tuple[float, ...]:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise OptionError(f"{name} is {values!r}: give coordinates in m, or a name") from error
    if array.ndim != 1 or not 1 <= array.size <= 3 or not np.isfinite(array).all():
        raise OptionError(f"{name} is {values!r}: give one to three finite numbers")
    return tuple(array.tolist())


def _direction(values: object) -> tuple[float, ...]:
    direction = _numbers("direction", values)
    length = float(np.linalg.norm(direction))
    if len(direction) != 3 or not length:
        raise OptionError(f"direction is {values!r}: give a vector (x, y, z) with a length")
    return tuple(part / length for part in direction)


def _require_positive(**numbers: float | None) -> None:
    for name, value in numbers.items():
        if value is not None and not (np.isfinite(value) and value > 0):
            raise OptionError(f"{name} is {value}: it must be a finite number above 0")


def _require_at_least_zero(**numbers: float | None) -> None:
    for name, value in numbers.items():
        if value is not None and not (np.isfinite(value) and value >= 0):
            raise OptionError(f"{name} is {value}: it must be a finite number of at least 0")

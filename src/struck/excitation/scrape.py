"""A scrape: something hard is dragged over a rough body."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np

from struck.errors import OptionError
from struck.excitation.contact_patch import drive_at
from struck.excitation.excitation import (
    Course,
    Push,
    follow,
    frozen,
    require_at_least_zero,
    require_positive,
)
from struck.excitation.friction import LEVELS_AN_OCTAVE, RUNGS_AN_OCTAVE, Rubbed, rung
from struck.excitation.hertz import Striker, contact_modulus
from struck.excitation.path import Path, Waypoints, require_waypoints
from struck.excitation.roughness import Roughness, profile
from struck.excitation.tool import Tool
from struck.model.arrays import Array
from struck.model.material import Material
from struck.model.model import ModalModel

# A contact that moves over a body: the force of its roughness, and where it drives the modes.

FADE = 5e-3  # s, in which a moving contact comes on and lifts off

CHUNK = 64  # samples between two readings of speed and load
LIGHTEST = 1e-3  # N: the force of lighter contacts is in proportion to this one's


class Rubber(Protocol):
    """What a scrape and a roll have in common."""

    @property
    def path(self) -> Waypoints:
        """Over the body."""
        ...

    @property
    def repeat(self) -> str:
        """What it does at the end of the path."""
        ...

    @property
    def speed(self) -> Course:
        """m/s."""
        ...

    @property
    def time(self) -> float:
        """When it begins, s."""
        ...

    @property
    def seconds(self) -> float | None:
        """How long it lasts, s."""
        ...

    @property
    def patch(self) -> float:
        """Radius of the area of contact, m."""
        ...

    @property
    def seed(self) -> int:
        """Of the place on the roughness where it begins."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Path, speed and load of a contact that moves over a body."""

    path: Path
    rubbed: Rubbed
    speed: Callable[[float], float]  # m/s, at s since the contact began
    load: Callable[[float], float]  # N, at s since the contact began
    first: int  # number of the sample at which it begins
    seconds: float | None  # None: to the end of the path
    offset: float  # m along the roughness at the begin
    patch: float  # radius of the area of contact, m

    @classmethod
    def of(
        cls, rubber: Rubber, model: ModalModel, rubbed: Rubbed, load: Course, sample_rate: float
    ) -> Motion:
        """Return the motion of a scrape or a roll; ContactError when it leaves the body."""
        require_positive(sample_rate=sample_rate)
        random = np.random.default_rng(rubber.seed)
        return cls(
            path=Path.over(model, rubber.path, repeat=rubber.repeat),
            rubbed=rubbed,
            speed=follow("speed", rubber.speed),
            load=follow("load", load),
            first=round(rubber.time * sample_rate),
            seconds=rubber.seconds,
            offset=random.uniform(0, rubbed.roughness.length),
            patch=rubber.patch,
        )


class Rubbing:
    """A `Pushing` that moves over a body."""

    # Speed and load are read every 64 samples, counted from when the contact began, and joined by
    # straight lines, so that the force does not depend on how long the blocks are.

    def __init__(
        self, motion: Motion, model: ModalModel, sample_rate: float, *, start: int = 0
    ) -> None:
        self._motion = motion
        self._model = model
        self._rate = sample_rate
        self._fade = max(1, round(FADE * sample_rate))
        self._last = None if motion.seconds is None else round(motion.seconds * sample_rate)
        self._now = 0
        self._force = np.zeros(0)
        self._ways = np.zeros(0)
        self._way = 0.0
        self._chunk = 0
        self._speed, self._load = motion.speed(0.0), motion.load(0.0)
        self._wait = max(0, motion.first - start)
        # Tables and kernel are made now, not while the first block is waited for.
        self._read(self._ways, (self._speed, self._speed), (self._load, self._load))
        self._skip(max(0, start - motion.first))

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, None where there is no force in them."""
        waiting = min(self._wait, length)
        self._wait -= waiting
        if waiting == length or self.finished:
            return None
        force = np.zeros(length)
        force[waiting:] = self._take(length - waiting)
        return Push(force=force, drive=self._drive())

    def change(self, model: ModalModel) -> None:
        """Go on along the same path over a body that has changed; the roughness stays."""
        self._model = model

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return self._last is not None and self._now >= self._last + self._fade

    def _skip(self, count: int) -> None:
        for begin in range(0, count, CHUNK):
            self._take(min(CHUNK, count - begin))

    def _take(self, length: int) -> Array:
        """Return the next `length` samples of force, faded in and out."""
        while len(self._force) < length:
            force, ways = self._next_chunk()
            self._force = np.concatenate([self._force, force])
            self._ways = np.concatenate([self._ways, ways])
        numbers = np.arange(self._now, self._now + length, dtype=np.float64)
        taken = self._force[:length] * self._envelope(numbers)
        self._way = float(self._ways[length - 1])
        self._force, self._ways = self._force[length:], self._ways[length:]
        self._now += length
        return taken

    def _next_chunk(self) -> tuple[Array, Array]:
        """Return force and distances of the next 64 samples; note where the path ends."""
        self._chunk += 1
        time = self._chunk * CHUNK / self._rate
        speeds = self._speed, self._motion.speed(time)
        loads = self._load, self._motion.load(time)
        before = float(self._ways[-1]) if len(self._ways) else self._way
        steps = np.arange(1, CHUNK + 1)
        ways = before + (steps * speeds[0] + steps**2 * ((speeds[1] - speeds[0]) / 2 / CHUNK)) / (
            self._rate
        )
        self._speed, self._load = speeds[1], loads[1]
        self._note_end(ways)
        return self._read(ways, speeds, loads), ways

    def _note_end(self, ways: Array) -> None:
        motion = self._motion
        if motion.path.repeat == "once" and ways[-1] >= motion.path.length:
            reached = int(np.searchsorted(ways, motion.path.length))
            end = (self._chunk - 1) * CHUNK + reached
            self._last = end if self._last is None else min(self._last, end)

    def _read(self, ways: Array, speeds: tuple[float, float], loads: tuple[float, float]) -> Array:
        from struck.excitation.friction import add_reading

        motion, force = self._motion, np.zeros(len(ways))
        turns = (motion.offset + ways) / motion.rubbed.roughness.length
        levels = self._level(speeds[0]), self._level(speeds[1])
        for number, weights in _rungs(*loads).items():
            table = rung(motion.rubbed, number)
            add_reading(
                table.values, table.starts, table.counts, turns, levels, tuple(weights), force
            )
        return force

    def _level(self, speed: float) -> float:
        """Return the level whose shortest waves pass in two samples or more, between two levels."""
        passing = 2 * self._motion.rubbed.finest * speed / self._rate
        return max(0.0, LEVELS_AN_OCTAVE * math.log2(passing) + 1) if passing > 0 else 0.0

    def _envelope(self, numbers: Array) -> Array:
        rising = np.clip((numbers + 1) / self._fade, 0, 1)
        falling = 1.0
        if self._last is not None:
            falling = np.clip((self._last + self._fade - numbers) / self._fade, 0, 1)
        return np.square(np.sin(np.pi / 2 * rising) * np.sin(np.pi / 2 * falling))

    def _drive(self) -> Array:
        motion = self._motion
        normal = motion.path.normal(self._way)
        point = motion.path.at(self._way)
        return drive_at(self._model, point, normal, -normal, radius=motion.patch)


def _rungs(begin: float, end: float) -> dict[int, list[float]]:
    """Return the tabulated loads about two loads, and their weights in each."""
    rungs: dict[int, list[float]] = {}
    for which, load in enumerate((begin, end)):
        for number, weight in _between(load):
            rungs.setdefault(number, [0.0, 0.0])[which] += weight
    return rungs


def _between(load: float) -> list[tuple[int, float]]:
    if load <= 0:
        return []
    held = max(load, LIGHTEST)
    number = math.floor(RUNGS_AN_OCTAVE * math.log2(held))
    low, high = (2 ** (n / RUNGS_AN_OCTAVE) for n in (number, number + 1))
    share = (held - low) / (high - low)
    return [(number, (1 - share) * load / held), (number + 1, share * load / held)]


# A roll: something round rolls over a body, both of them uneven.

GRAVITY = 9.81  # m/s^2

_FEWEST_TURNS_LENGTH = 0.12  # m of surface before its roughness comes round again
_MOST_POINTS = 1 << 17


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Roll:
    """A ball or wheel that rolls over the surface of a body without slipping.

    The unevenness of both adds up: the surface's along the way, the roller's own round after round
    of 2 pi radius. Force follows as for a scrape (`struck.excitation.friction`); the large radius
    makes a wide contact that feels only the longer waves, so rolling is smoother and duller.

    Parameters
    ----------
    path : sequence of str or array-like
        Two places or more, as `at` of a strike; the roller takes the shortest way over the surface.
    radius : float
        Of the roller, m.
    mass : float or None
        Of the roller, kg: its weight is the load.
    speed : float, (times, values) or function
        m/s; see `struck.excitation.excitation`.
    load : float, (times, values), function or None
        N, in place of the weight.
    roughness, roller_roughness : str or Roughness
        Of the surface and of the roller: names in ``roughness.toml``, or profiles.
    material : str or Material
        Of the roller.
    flat : float
        Depth of a flat spot worn into the roller, m: it passes every 2 pi radius of the way. Its
        edges are taken as rounded over, so that its profile is a raised cosine of the length
        sqrt(8 radius flat) of the chord.
    seconds : float or None
        How long it lasts; None: to the end of the path, without end where that repeats.
    repeat : str
        "once", "back" (there and back) or "loop" (round, from the last place to the first).
    patch : float
        Radius of the area over which mode shapes are averaged, m; 0 is a point.
    time : float
        When it begins, s. It comes on and lifts off within 5 ms.
    seed : int
        Where on the profiles it begins.

    Raises
    ------
    OptionError
        On unknown names, numbers outside their bounds, or neither or both of mass and load.
    """

    path: Waypoints
    radius: float
    speed: Course
    mass: float | None = None
    load: Course | None = None
    roughness: str | Roughness = "wood"
    roller_roughness: str | Roughness = "steel"
    material: str | Material = "steel"
    flat: float = 0.0
    seconds: float | None = None
    repeat: str = "once"
    patch: float = 0.0
    time: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        require_waypoints(self.path, self.repeat)
        require_positive(radius=self.radius, mass=self.mass, seconds=self.seconds)
        require_at_least_zero(flat=self.flat, patch=self.patch, time=self.time, seed=self.seed)
        if self.flat >= self.radius:
            raise OptionError(f"flat is {self.flat} m: it must lie below the radius, {self.radius}")
        if (self.mass is None) == (self.load is None):
            raise OptionError(
                f"mass is {self.mass} kg and load is {self.load} N: the load is the weight of the "
                "mass unless given, so give one of them"
            )
        object.__setattr__(self, "speed", frozen("speed", self.speed))
        if self.load is not None:
            object.__setattr__(self, "load", frozen("load", self.load))
        for name in ("roughness", "roller_roughness"):
            object.__setattr__(self, name, profile(getattr(self, name)))
        if isinstance(self.material, str):
            object.__setattr__(self, "material", Material.named(self.material))

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Rubbing:
        """Begin on a model at sample number `start`; see `struck.excitation.excitation`.

        Raises
        ------
        ContactError
            When the path leaves the body.
        """
        load = GRAVITY * self.mass if self.mass is not None else self.load or 0.0
        motion = Motion.of(self, model, self._rubbed(model), load, sample_rate)
        return Rubbing(motion, model, sample_rate, start=start)

    def _rubbed(self, model: ModalModel) -> Rubbed:
        roller = self.material
        if isinstance(roller, str):
            roller = Material.named(roller)
        solids = (roller,) if model.material is None else (roller, model.material)
        return Rubbed(
            roughness=self.unevenness(),
            modulus=contact_modulus(*solids),
            radius=self.radius,
        )

    def unevenness(self) -> Roughness:
        """Return the height of surface and roller together, over whole turns of the roller."""
        return _together(
            profile(self.roughness), profile(self.roller_roughness), self.radius, self.flat
        )


@lru_cache(maxsize=16)
def _together(surface: Roughness, roller: Roughness, radius: float, flat: float) -> Roughness:
    around = 2 * math.pi * radius
    finest = min(surface.pitch, roller.pitch, around / 64)
    turns = math.ceil(_FEWEST_TURNS_LENGTH / around)
    points = min(math.ceil(around / finest), _MOST_POINTS // turns)
    heights = surface.over(turns * around, turns * points)
    worn = roller.over(around, points) - _worn(radius, flat, points)
    return Roughness(heights=heights + np.tile(worn, turns), pitch=around / points)


def _worn(radius: float, flat: float, points: int) -> Array:
    """Return the depth of a flat spot around the roller, m."""
    length = math.sqrt(8 * radius * flat)
    if not length:
        return np.zeros(points)
    from_middle = (np.arange(points) / points - 0.5) * (2 * math.pi * radius / length)
    inside = np.abs(from_middle) < 0.5
    return np.where(inside, flat * np.cos(np.pi * from_middle) ** 2, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scrape:
    """A round tip dragged over the surface of a body.

    The tip rides over the roughness by Hertz's law (`struck.excitation.friction`): faster is
    brighter, an octave for twice the speed; heavier is louder, by 2^(1/3) for twice the load on a
    smooth surface and twice on a rough one. A constant load itself makes no sound and is
    left out of the force.

    Parameters
    ----------
    path : sequence of str or array-like
        Two places or more, as `at` of a strike; the tip takes the shortest way over the surface.
    speed : float, (times, values) or function
        m/s; see `struck.excitation.excitation`.
    load : float, (times, values) or function
        How hard the tip is held down, N.
    roughness : str or Roughness
        Name in ``roughness.toml``, or a profile.
    striker : str
        Of what the tip is, a name in ``strikers.toml``.
    radius : float or None
        Of the tip, m; None takes the striker's.
    seconds : float or None
        How long it lasts; None: to the end of the path, without end where that repeats.
    repeat : str
        "once", "back" (there and back) or "loop" (round, from the last place to the first).
    patch : float
        Radius of the area over which mode shapes are averaged, m; 0 is a point.
    time : float
        When it begins, s. It comes on and lifts off within 5 ms.
    seed : int
        Where on the profile it begins.

    Raises
    ------
    OptionError
        On unknown names, or numbers outside their bounds.
    """

    path: Waypoints
    speed: Course
    load: Course
    roughness: str | Roughness = "sandpaper"
    striker: str = "steel"
    radius: float | None = None
    seconds: float | None = None
    repeat: str = "once"
    patch: float = 0.0
    time: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        require_waypoints(self.path, self.repeat)
        object.__setattr__(self, "speed", frozen("speed", self.speed))
        object.__setattr__(self, "load", frozen("load", self.load))
        object.__setattr__(self, "roughness", profile(self.roughness))
        Striker.named(self.striker)
        require_positive(radius=self.radius, seconds=self.seconds)
        require_at_least_zero(patch=self.patch, time=self.time, seed=self.seed)

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Rubbing:
        """Begin on a model at sample number `start`; see `struck.excitation.excitation`.

        Raises
        ------
        ContactError
            When the path leaves the body.
        """
        tool = Tool(roughness=self.roughness, striker=self.striker, radius=self.radius)
        motion = Motion.of(self, model, tool.on(model), self.load, sample_rate)
        return Rubbing(motion, model, sample_rate, start=start)

"""Scrapes and rolls: something hard is dragged, or something round rolls, over a rough body."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from struck.errors import OptionError
from struck.excitation.excitation import (
    Course,
    Push,
    drive_at,
    follow,
    frozen,
    require_at_least_zero,
    require_positive,
)
from struck.excitation.friction import CHUNK, FADE, Reader, Rubbed, Tool, fading
from struck.excitation.hertz import Striker, contact_modulus
from struck.excitation.path import Path, Waypoints, require_waypoints
from struck.excitation.roughness import Roughness, profile
from struck.model.arrays import Array, checked
from struck.model.material import Material
from struck.model.model import ModalModel

_GRAVITY = 9.81  # m/s^2
_FEWEST_TURNS_LENGTH = 0.12  # m of surface before its roughness comes round again
_MOST_POINTS = 1 << 17


@checked
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
        return Rubbing(self, tool.on(model), self.load, model, sample_rate, start=start)


@checked
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
        load = _GRAVITY * self.mass if self.mass is not None else self.load or 0.0
        return Rubbing(self, self._rubbed(model), load, model, sample_rate, start=start)

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


class Rubbing:
    """A `Pushing` that moves over a body: a scrape or a roll at work."""

    def __init__(
        self,
        contact: Scrape | Roll,
        rubbed: Rubbed,
        load: Course,
        model: ModalModel,
        sample_rate: float,
        *,
        start: int,
    ) -> None:
        require_positive(sample_rate=sample_rate)
        random = np.random.default_rng(int(contact.seed))
        self._path = Path.over(model, contact.path, repeat=contact.repeat)
        self._speed, self._load = follow("speed", contact.speed), follow("load", load)
        self._model, self._rate, self._patch = model, sample_rate, contact.patch
        self._fade = max(1, round(FADE * sample_rate))
        self._last = None if contact.seconds is None else round(contact.seconds * sample_rate)
        self._reader = Reader(
            rubbed,
            sample_rate,
            offset=random.uniform(0, rubbed.roughness.length),
            speed=self._speed(0.0),
            load=self._load(0.0),
        )
        self._now, self._way = 0, 0.0  # samples and m since it began
        first = round(contact.time * sample_rate)
        self._wait = max(0, first - start)
        for begin in range(0, start - first, CHUNK):
            self._take(min(CHUNK, start - first - begin))

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, None where there is no force in them."""
        waiting = min(self._wait, length)
        self._wait -= waiting
        if waiting == length or self.finished:
            return None
        force = np.zeros(length)
        force[waiting:] = self._take(length - waiting)
        normal = self._path.normal(self._way)
        point = self._path.at(self._way)
        drive = drive_at(self._model, point, normal, -normal, radius=self._patch)
        return Push(force=force, drive=drive)

    def change(self, model: ModalModel) -> None:
        """Go on along the same path over a body that has changed; the roughness stays."""
        self._model = model

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return self._last is not None and self._now >= self._last + self._fade

    def _take(self, length: int) -> Array:
        """Return the next `length` samples of force, faded in and out."""
        force, ways = self._reader.take(length, self._look)
        if self._path.repeat == "once" and ways[-1] >= self._path.length:
            end = self._now + int(np.searchsorted(ways, self._path.length))
            self._last = end if self._last is None else min(self._last, end)
        numbers = np.arange(self._now, self._now + length, dtype=np.float64)
        self._way = float(ways[-1])
        self._now += length
        return force * fading(numbers, self._fade, self._last)

    def _look(self, chunks: int) -> tuple[float, float]:
        time = chunks * CHUNK / self._rate
        return self._speed(time), self._load(time)


@lru_cache(maxsize=16)
def _together(surface: Roughness, roller: Roughness, radius: float, flat: float) -> Roughness:
    around = 2 * math.pi * radius
    finest = min(surface.pitch, roller.pitch, around / 64)
    turns = math.ceil(_FEWEST_TURNS_LENGTH / around)
    points = min(math.ceil(around / finest), _MOST_POINTS // turns)
    heights = surface.over(turns * around, turns * points)
    worn = roller.over(around, points)
    chord = math.sqrt(8 * radius * flat)
    if chord:
        from_middle = (np.arange(points) / points - 0.5) * (around / chord)
        inside = np.abs(from_middle) < 0.5
        worn -= np.where(inside, flat * np.cos(np.pi * from_middle) ** 2, 0.0)
    return Roughness(heights=heights + np.tile(worn, turns), pitch=around / points)

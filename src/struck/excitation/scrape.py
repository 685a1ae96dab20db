"""Scrapes and rolls: a hard tip is dragged, or a ball rolls, over a rough body."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import Self

import numpy as np

from struck.errors import OptionError
from struck.excitation.envelope import Envelope, Roller
from struck.excitation.excitation import (
    Course,
    Push,
    drives_at,
    follow,
    frozen,
    require_at_least_zero,
    require_positive,
)
from struck.excitation.hertz import Striker, contact_modulus
from struck.excitation.path import Path, Waypoints, require_waypoints
from struck.excitation.roughness import Finish, Roughness, finish
from struck.excitation.scraping_force import (
    FADE_SECONDS,
    ROLLER_FRACTION,
    Reader,
    SlidingContact,
    Tool,
    fading,
    force_variation,
)
from struck.excitation.texture import CHUNK
from struck.model.arrays import Array, checked
from struck.model.material import Material
from struck.model.model import ModalModel

_GRAVITY = 9.81  # m/s^2
_ROLLER_SEED_OFFSET = 1 << 32  # a roller of the same seed has another texture than the surface
_CHUNKS_AHEAD = 32  # chunks that are computed at once
_FRACTIONS = np.arange(1, CHUNK + 1) / CHUNK


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scrape:
    """A round tip that is dragged over the surface of a body.

    The tip follows the roughness by Hertz's law (`struck.excitation.scraping_force`). Doubling the
    speed raises the spectrum by an octave and the level of the force by about 4.5 dB. Doubling the
    load raises the level by 2 dB on a smooth surface and by 4 dB on a rough one. The surface is
    read by position: the same position has the same heights, and a path that never returns never
    repeats. A constant load itself is silent and left out of the force.

    Parameters
    ----------
    path : sequence of str or array-like
        Two points or more, as `at` of a `Strike`, which are connected by shortest paths over the
        surface.
    speed : float, (times, values) or function
        Speed, m/s (see `struck.excitation.excitation`).
    load : float, (times, values) or function
        Normal force, N.
    roughness : str, Roughness or Profile, default "sandpaper"
        Name in ``roughness.toml``, a finish, or a profile that is read as it is, repeatedly.
    striker : str, default "steel"
        Striker whose material and radius the tip has: a name in ``strikers.toml``.
    radius : float or None, default None
        Radius of the tip, m. None: that of the striker.
    seconds : float or None, default None
        Duration, s. None: to the end of the path; endless if it repeats.
    repeat : {"once", "back", "loop"}, default "once"
        Whether the path is followed once, there and back, or round from the last point to the
        first.
    patch : float, default 0.0
        Radius of the area over which mode shapes are averaged, m; 0 for a point.
    time : float, default 0.0
        Start, s. The force is faded in and out within 5 ms.
    seed : int, default 0
        Seed of the surface; of a profile, that of the point where the scrape begins.

    Raises
    ------
    OptionError
        If a name is unknown, or a number is out of range.

    Examples
    --------
    >>> plate = struck.shapes.RectangularPlate(length=0.3, width=0.2, thickness=0.003)
    >>> model = struck.analyze(plate, "steel", band=(20.0, 5000.0), progress=None)
    >>> scrape = struck.Scrape(path=["quarter", "middle"], speed=0.2, load=3.0, roughness="wood")
    >>> sound = struck.render(model, scrape, seconds=0.5)
    >>> sound.peak > 0
    True
    """

    path: Waypoints
    speed: Course
    load: Course
    roughness: str | Finish = "sandpaper"
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
        object.__setattr__(self, "roughness", finish(self.roughness))
        Striker.named(self.striker)
        require_positive(radius=self.radius, seconds=self.seconds)
        require_at_least_zero(patch=self.patch, time=self.time, seed=self.seed)

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Rubbing:
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
        Rubbing
            The excitation at work, which returns its pushes block by block.

        Raises
        ------
        ContactError
            When the path leaves the body.
        """
        rubbing = Rubbing(self, self.load, model, sample_rate)
        return rubbing.start(round(self.time * sample_rate), start)

    def reader(self, model: ModalModel, sample_rate: float, path: Path, load: float) -> Reader:
        """Return the reader of the surface along a path.

        Parameters
        ----------
        model : ModalModel
            Model of the body.
        sample_rate : float
            Sample rate, Hz.
        path : Path
            Path over the surface.
        load : float
            Normal force, N.

        Returns
        -------
        Reader
            Reader of the force, by position.
        """
        del path, load
        tool = Tool(
            roughness=self.roughness, striker=self.striker, radius=self.radius, seed=self.seed
        )
        return Reader(tool.on(model), sample_rate)


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Roll:
    """A ball or wheel that rolls over the surface of a body without slipping.

    The heights of surface and roller are added. The surface is read by position. The roller
    repeats after 2 pi radius of the path, which is the only period. It rests on the points that
    it touches first (`struck.excitation.envelope`), and the force follows as for a scrape
    (`struck.excitation.scraping_force`). Its large radius bridges valleys and averages over a wide
    contact, so that rolling is smoother and duller than scraping.

    Parameters
    ----------
    path : sequence of str or array-like
        Two points or more, as `at` of a `Strike`, which are connected by shortest paths over the
        surface.
    radius : float
        Radius of the roller, m.
    speed : float, (times, values) or function
        Speed, m/s (see `struck.excitation.excitation`).
    mass : float or None, default None
        Mass of the roller, kg: its weight is the load.
    load : float, (times, values), function or None, default None
        Normal force, N, instead of the weight.
    roughness : str or Roughness, default "wood"
        Finish of the surface, or its name in ``roughness.toml``. For a measured profile:
        `profile.roughness()`.
    roller_roughness : str or Roughness, default "steel"
        Finish of the roller.
    material : str or Material, default "steel"
        Material of the roller.
    roundness : float, default 1e-6
        Deviation of the roller from a circle, the root mean square of 2 to 240 waves around it, m:
        about 1e-7 for a ball of a good bearing, some 1e-6 for a marble.
    flat : float, default 0.0
        Depth of a flat spot of the roller, m, which passes once per 2 pi radius of the path. Its
        profile is a raised cosine of the length sqrt(8 radius flat) of the chord.
    seconds : float or None, default None
        Duration, s. None: to the end of the path; endless if it repeats.
    repeat : {"once", "back", "loop"}, default "once"
        Whether the path is followed once, there and back, or round from the last point to the
        first.
    patch : float, default 0.0
        Radius of the area over which mode shapes are averaged, m; 0 for a point.
    time : float, default 0.0
        Start, s. The force is faded in and out within 5 ms.
    seed : int, default 0
        Seed of the surface.
    roller_seed : int, default 0
        Seed of the roller.

    Raises
    ------
    OptionError
        If a name is unknown, a number is out of range, or mass and load are both given or both
        missing.

    Examples
    --------
    >>> plate = struck.shapes.RectangularPlate(length=0.3, width=0.2, thickness=0.003)
    >>> model = struck.analyze(plate, "steel", band=(20.0, 5000.0), progress=None)
    >>> marble = struck.Roll(
    ...     path=["quarter", "middle"], radius=0.008, mass=0.005, speed=0.2, material="glass"
    ... )
    >>> sound = struck.render(model, marble, seconds=0.5)
    >>> sound.peak > 0
    True
    """

    path: Waypoints
    radius: float
    speed: Course
    mass: float | None = None
    load: Course | None = None
    roughness: str | Roughness = "wood"
    roller_roughness: str | Roughness = "steel"
    material: str | Material = "steel"
    roundness: float = 1e-6
    flat: float = 0.0
    seconds: float | None = None
    repeat: str = "once"
    patch: float = 0.0
    time: float = 0.0
    seed: int = 0
    roller_seed: int = 0

    def __post_init__(self) -> None:
        require_waypoints(self.path, self.repeat)
        require_positive(radius=self.radius, mass=self.mass, seconds=self.seconds)
        require_at_least_zero(flat=self.flat, roundness=self.roundness, patch=self.patch)
        require_at_least_zero(time=self.time, seed=self.seed, roller_seed=self.roller_seed)
        for name in ("flat", "roundness"):
            depth = getattr(self, name)
            if depth >= self.radius:
                raise OptionError(
                    f"{name} is {depth} m: it must lie below the radius, {self.radius}"
                )
        if (self.mass is None) == (self.load is None):
            raise OptionError(
                f"mass is {self.mass} kg and load is {self.load} N: the load is the weight of the "
                "mass unless given, so give one of them"
            )
        object.__setattr__(self, "speed", frozen("speed", self.speed))
        if self.load is not None:
            object.__setattr__(self, "load", frozen("load", self.load))
        for name in ("roughness", "roller_roughness"):
            object.__setattr__(self, name, Roughness.of(getattr(self, name)))
        object.__setattr__(self, "material", Material.of(self.material))

    def begin(self, model: ModalModel, sample_rate: float, *, start: int = 0) -> Rubbing:
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
        Rubbing
            The excitation at work, which returns its pushes block by block.

        Raises
        ------
        ContactError
            When the path leaves the body.
        """
        rubbing = Rubbing(self, self._weight(), model, sample_rate)
        return rubbing.start(round(self.time * sample_rate), start)

    def _weight(self) -> Course:
        return _GRAVITY * self.mass if self.mass is not None else self.load or 0.0

    def reader(self, model: ModalModel, sample_rate: float, path: Path, load: float) -> Envelope:
        """Return the reader of the surface and the roller together, as `struck.Scrape.reader`.

        Parameters
        ----------
        model : ModalModel
            Model of the body.
        sample_rate : float
            Sample rate, Hz.
        path : Path
            Path over the surface.
        load : float
            Normal force, N.

        Returns
        -------
        Envelope
            Reader of the force, by the distance rolled.
        """
        surface, roller = Roughness.of(self.roughness), Roughness.of(self.roller_roughness)
        material = Material.of(self.material)
        solids = (material,) if model.material is None else (material, model.material)
        sliding = SlidingContact(
            roughness=surface,
            modulus=contact_modulus(*solids),
            radius=self.radius,
            height_fraction=ROLLER_FRACTION,
        )
        surface_layers = surface.layers(self.seed)
        ball = Roller(
            radius=self.radius,
            layers=roller.layers(self.roller_seed + _ROLLER_SEED_OFFSET),
            roundness=self.roundness,
            flat=self.flat,
            seed=self.roller_seed,
        )
        return Envelope(
            sliding,
            sample_rate,
            lambda ways: surface_layers.at(path.spot(ways)) + ball.heights(ways),
            load,
        )


class Rubbing:
    """A `Pushing` that moves over a body: a scrape or a roll at work."""

    # Force and distance are computed some chunks of 64 samples ahead, counted from the begin, and
    # drives for as many blocks, as many places at once take little longer than one. A function of
    # speed or load is called as late as possible.

    def __init__(
        self, contact: Scrape | Roll, load: Course, model: ModalModel, sample_rate: float
    ) -> None:
        require_positive(sample_rate=sample_rate)
        self._path = Path.over(model, contact.path, repeat=contact.repeat)
        self._speed, self._load = follow("speed", contact.speed), follow("load", load)
        self._chunk_count = 1 if callable(contact.speed) or callable(load) else _CHUNKS_AHEAD
        self._model, self._rate, self._patch = model, sample_rate, contact.patch
        self._fade_samples = max(1, round(FADE_SECONDS * sample_rate))
        self._last = None if contact.seconds is None else round(contact.seconds * sample_rate)
        self._reader = contact.reader(model, sample_rate, self._path, self._load(0.0))
        self._chunk, self._last_control = 0, (self._speed(0.0), self._load(0.0))
        self._force, self._ways = np.zeros(0), np.zeros(0)  # computed, but not taken yet
        self._drives: deque[Array] = deque()
        self._drive_interval = 0  # samples
        self._next_sample, self._distance, self._wait_samples = (
            0,
            0.0,
            0,
        )  # samples and m since it began
        self._chunk_distance = 0.0  # m, where the next chunk begins

    def start(self, first: int, start: int) -> Self:
        """Begin at sample number `start`, as if playing since sample `first`."""
        self._wait_samples = max(0, first - start)
        for offset in range(0, start - first, CHUNK):
            self._take(min(CHUNK, start - first - offset))
        return self

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, None where there is no force in them."""
        waiting = min(self._wait_samples, length)
        self._wait_samples -= waiting
        if waiting == length or self.finished:
            return None
        force = np.zeros(length)
        force[waiting:] = self._take(length - waiting)
        return Push(force=force, drive=self._drive(length))

    def change(self, model: ModalModel) -> None:
        """Go on along the same path over a body that has changed; the surface stays."""
        self._model = model
        self._drives.clear()

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return self._last is not None and self._next_sample >= self._last + self._fade_samples

    def _take(self, length: int) -> Array:
        """Return the next `length` samples of force, faded in and out."""
        while len(self._force) < length:
            force, ways = self._compute_chunks()
            self._force = np.concatenate([self._force, force])
            self._ways = np.concatenate([self._ways, ways])
        force, ways = self._force[:length], self._ways[:length]
        self._force, self._ways = self._force[length:], self._ways[length:]
        if self._path.repeat == "once" and ways[-1] >= self._path.length:
            end = self._next_sample + int(np.searchsorted(ways, self._path.length))
            self._last = end if self._last is None else min(self._last, end)
        self._distance = float(ways[-1])
        self._next_sample += length
        return force * fading(self._next_sample - length, length, self._fade_samples, self._last)

    def _compute_chunks(self) -> tuple[Array, Array]:
        """Return force, N, and distance, m, of the next chunks."""
        times = (self._chunk + np.arange(1, self._chunk_count + 1)) * (CHUNK / self._rate)
        controls = [self._last_control, *((self._speed(t), self._load(t)) for t in times.tolist())]
        speeds, loads = np.array(controls).T
        distances = (speeds[:-1] + speeds[1:]) * (CHUNK / 2 / self._rate)
        start_distances = np.cumsum(np.concatenate([[self._chunk_distance], distances]))
        rising = np.diff(speeds)[:, None] / 2
        chunk_distances = (speeds[:-1, None] + rising * _FRACTIONS) * (
            _FRACTIONS * (CHUNK / self._rate)
        )
        ways = (start_distances[:-1, None] + chunk_distances).reshape(-1)
        chunk_loads = (loads[:-1, None] + np.diff(loads)[:, None] * _FRACTIONS).reshape(-1)
        compressions = self._reader.compressions(0, self._path.spot(ways), ways, speeds, loads)
        self._chunk += self._chunk_count
        self._last_control, self._chunk_distance = controls[-1], float(start_distances[-1])
        return force_variation(compressions, chunk_loads), ways

    def _drive(self, length: int) -> Array:
        """Return how strongly a unit force drives each mode at the end of the block (M,)."""
        # Those of the next blocks are computed with it.
        if length != self._drive_interval or not self._drives:
            ends = np.concatenate([[self._distance], self._ways[length - 1 :: length]])
            normals = self._path.normal(ends)
            drives = drives_at(self._model, self._path.at(ends), -normals, radius=self._patch)
            self._drives, self._drive_interval = deque(drives), length
        return self._drives.popleft()

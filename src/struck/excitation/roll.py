"""A roll: something round rolls over a body, both of them uneven."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.excitation.bounds import require_at_least_zero, require_positive
from struck.excitation.course import Course, frozen
from struck.excitation.friction import Rubbed
from struck.excitation.hertz import contact_modulus
from struck.excitation.path import Waypoints, require_waypoints
from struck.excitation.roughness import Roughness, profile
from struck.excitation.rubbing import Motion, Rubbing
from struck.model.material import Material
from struck.model.model import ModalModel

Array = NDArray[np.float64]

GRAVITY = 9.81
"""m/s^2."""

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
        m/s; see `struck.excitation.course`.
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
        """Begin on a model at sample number `start`; see `struck.excitation.pushing`.

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
    """Return how deep a flat spot is around the roller, m."""
    length = math.sqrt(8 * radius * flat)
    if not length:
        return np.zeros(points)
    from_middle = (np.arange(points) / points - 0.5) * (2 * math.pi * radius / length)
    inside = np.abs(from_middle) < 0.5
    return np.where(inside, flat * np.cos(np.pi * from_middle) ** 2, 0.0)

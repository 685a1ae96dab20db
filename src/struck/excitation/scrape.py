"""A scrape: something hard is dragged over a rough body."""

from __future__ import annotations

from dataclasses import dataclass

from struck.excitation.bounds import require_at_least_zero, require_positive
from struck.excitation.course import Course, frozen
from struck.excitation.hertz import Striker
from struck.excitation.path import Waypoints, require_waypoints
from struck.excitation.roughness import Roughness, profile
from struck.excitation.rubbing import Motion, Rubbing
from struck.excitation.tool import Tool
from struck.model.model import ModalModel


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
        m/s; see `struck.excitation.course`.
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
        """Begin on a model at sample number `start`; see `struck.excitation.pushing`.

        Raises
        ------
        ContactError
            When the path leaves the body.
        """
        tool = Tool(roughness=self.roughness, striker=self.striker, radius=self.radius)
        motion = Motion.of(self, model, tool.on(model), self.load, sample_rate)
        return Rubbing(motion, model, sample_rate, start=start)

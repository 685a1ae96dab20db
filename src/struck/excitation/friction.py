"""The force between two bodies that move along each other, by Hertz's law over their roughness.

A round tip of radius R is pressed on a rough surface by a load. Its dent is a spring of stiffness
k = (6 E*^2 R load)^(1/3) (Hertz's law about the load; Johnson 1985, section 4.2). The height h(s)
over the distance s, averaged over the circle of contact, compresses that spring:

    x = k h / load,    F - load = load x / sqrt(1 + (x / 0.8)^2)

so that the force never turns into a pull: where the surface falls away it fades towards nothing,
where it rises the tip is pushed off before the force doubles. A constant load is silent and left
out. Unevenness beyond what the dent can take, x above 1 (rms), the tip follows up and down rather
than being squeezed: such a profile loses its long waves, each multiplied by q^2 / (q^2 + c^2), with
the wavenumber c at which the rms of x is 1.

- Smooth, x well below 1: F - load = k h. Twice the load gives 2^(1/3) times the force.
- Rough: twice the load gives twice the force, of somewhat longer waves.

The circle of contact has the radius a = (3 load R / (4 E*))^(1/3); averaging over its pressure,
sqrt(1 - (r/a)^2), multiplies waves of wavenumber q by 3 (sin qa - qa cos qa) / (qa)^3. All this
happens over distance: moving twice as fast shifts the whole spectrum up an octave (a profile read
at the speed of contact: van den Doel, Kry & Pai, FoleyAutomatic, SIGGRAPH 2001). The limit and the
following are simple stand-ins for the inertia of the tip, which would not scale like that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.optimize import brentq

from struck.core import entry
from struck.excitation.excitation import require_at_least_zero, require_positive
from struck.excitation.hertz import Striker, contact_modulus
from struck.excitation.roughness import Roughness, profile
from struck.model.arrays import Array, Complex, Index, checked
from struck.model.model import ModalModel

LEVELS_AN_OCTAVE = 3
RUNGS_AN_OCTAVE = 2  # loads are tabulated at 2^(rung / 2) N and interpolated between

_MOST = 0.8  # of the load: what filters overshoot stays a push
_ROUGHEST = 1.0
_POINTS_A_WAVE = 6  # of the shortest wave of a level
_FLAT = 2 / 3  # share of a level's band that passes whole
FADE = 5e-3  # s, in which a moving contact comes on and lifts off
CHUNK = 64  # samples between two looks at speed and load
_STEPS = np.arange(1.0, CHUNK + 1)
_SQUARES = np.square(_STEPS)
LIGHTEST = 1e-3  # N: the force of lighter contacts is in proportion to this one's


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tool:
    """What touches.

    Parameters
    ----------
    roughness : str or Roughness
        Of the two surfaces together: a name in ``roughness.toml``, or a profile.
    striker : str
        Of what the tip is, a name in ``strikers.toml``.
    radius : float or None
        Of the tip, m; None takes the striker's.
    patch : float
        Radius of the area over which mode shapes are averaged, m; 0 is a point.

    Raises
    ------
    OptionError
        On unknown names, or numbers outside their bounds.
    """

    roughness: str | Roughness = "wood"
    striker: str = "plastic"
    radius: float | None = None
    patch: float = 0.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "roughness", profile(self.roughness))
        Striker.named(self.striker)
        require_positive(radius=self.radius)
        require_at_least_zero(patch=self.patch)

    def on(self, model: ModalModel) -> Rubbed:
        """Return its tip in contact with a model."""
        tip = Striker.named(self.striker)
        solids = (tip,) if model.material is None else (tip, model.material)
        return Rubbed(
            roughness=profile(self.roughness),
            modulus=contact_modulus(*solids),
            radius=self.radius or tip.radius,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Rubbed:
    """Two bodies in contact: their roughness together, and the spring of the dent."""

    roughness: Roughness  # height of both together over distance
    modulus: float  # E* of the two, Pa
    radius: float  # joint radius of curvature, m

    @property
    def finest(self) -> float:
        """Highest wavenumber that is kept, cycles/m."""
        return 1 / self.roughness.pitch

    def contact_radius(self, load: float) -> float:
        """Return the radius of the circle of contact, m."""
        return (3 * load * self.radius / (4 * self.modulus)) ** (1 / 3)

    def stiffness(self, load: float) -> float:
        """Return the stiffness k of the dent under a load, N/m."""
        return (6 * self.modulus**2 * self.radius * load) ** (1 / 3)

    def force(self, load: float) -> Array:
        """Return F - load at twice as many places as the roughness has, N."""
        heights = self.roughness.heights
        turns: Array = 2 * np.pi * np.arange(len(heights) // 2 + 1.0) / self.roughness.length
        felt = np.fft.rfft(heights) * pressure_mean(turns * self.contact_radius(load))
        squeezed = _squeezed(felt * (self.stiffness(load) / load), turns)
        waves = np.fft.irfft(2 * squeezed, 2 * len(heights))
        limited = waves / np.sqrt(1 + np.square(waves / _MOST))
        return load * (limited - limited.mean())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rung:
    """The force at one load, low-passed to ever longer waves for ever faster motion."""

    values: NDArray[np.float32]  # (T,), N, level after level
    starts: Index  # (L,), where level j begins, of waves up to `finest` 2^(-j / LEVELS_AN_OCTAVE)
    counts: Index  # (L,), points of a level over the period
    places: tuple[int, ...] = field(init=False)  # addresses of the three, for the core

    def __post_init__(self) -> None:
        arrays = self.values, self.starts, self.counts
        object.__setattr__(self, "places", tuple(array.ctypes.data for array in arrays))


@lru_cache(maxsize=16)  # of some 2 MB
def rung(rubbed: Rubbed, number: int) -> Rung:
    """Return the force at a load of 2^(number / RUNGS_AN_OCTAVE) N."""
    force = rubbed.force(2 ** (number / RUNGS_AN_OCTAVE))
    spectrum = np.fft.rfft(force) / len(force)
    levels = []
    highest = len(force) / 2
    while highest > 1:
        levels.append(_low_passed(spectrum, highest))
        highest /= 2 ** (1 / LEVELS_AN_OCTAVE)
    counts = np.array([len(level) for level in levels])
    values = np.concatenate(levels).astype(np.float32)
    return Rung(values=values, starts=np.cumsum(counts) - counts, counts=counts)


def _squeezed(spectrum: Complex, turns: Array) -> Complex:
    """Return the spectrum of x (n / 2 + 1,) once the tip follows the long waves."""
    power = np.square(np.abs(spectrum) / (len(spectrum) - 1)) / 2

    def excess(cut: float) -> float:
        return float(power @ _followed(turns, np.exp(cut)) ** 2) - _ROUGHEST**2

    lowest, highest = np.log(turns[1]) - 5, np.log(turns[-1]) + 5
    if excess(lowest) <= 0:
        return spectrum
    return spectrum * _followed(turns, np.exp(brentq(excess, lowest, highest, xtol=1e-6)))


def _followed(turns: Array, cut: float) -> Array:
    return 1 / (1 + np.square(cut / np.maximum(turns, turns[1] / 1e3)))


def pressure_mean(turns: Array) -> Array:
    """Return the mean of a wave over a Hertz contact, 3 (sin u - u cos u) / u^3 at u = q a."""
    far = np.maximum(np.abs(turns), 0.1)
    closed = 3 * (np.sin(far) - far * np.cos(far)) / far**3
    near = 1 - np.square(turns) / 10 + turns**4 / 280
    return np.where(np.abs(turns) < 0.1, near, closed)


def _low_passed(spectrum: Complex, highest: float) -> Array:
    """Return one period of a profile without waves above `highest` in it."""
    kept = min(int(highest) + 1, len(spectrum))
    waves = np.arange(kept)
    fall = np.clip((highest - waves) / (highest * (1 - _FLAT)), 0, 1)
    count = next_fast_len(max(8, int(np.ceil(_POINTS_A_WAVE * highest))), real=True)
    return np.fft.irfft(spectrum[:kept] * np.sin(np.pi / 2 * fall) ** 2, count) * count


class Reader:
    """The force of a moving contact and the distance it has gone, sample by sample."""

    # Speed and load are looked at every 64 samples, counted from when the contact began, and joined
    # by straight lines, so that the force does not depend on how long the blocks are.

    def __init__(
        self, rubbed: Rubbed, sample_rate: float, *, offset: float, speed: float, load: float
    ) -> None:
        self._rubbed, self._rate, self._offset = rubbed, sample_rate, offset
        self._speed, self._load = speed, load
        self._force = np.zeros(0)  # read, but not taken yet
        self._ways = np.zeros(0)
        self._way = 0.0
        self._chunk = 0
        # Tables and kernel are made now, not while the first block is waited for.
        self._read(self._ways, (speed, speed), (load, load))

    def take(self, length: int, look: Callable[[int], tuple[float, float]]) -> tuple[Array, Array]:
        """Return force, N, and distance, m; `look` gives speed and load after so many chunks."""
        forces, distances = [self._force], [self._ways]
        for _ in range(len(self._force), length, CHUNK):
            self._chunk += 1
            force, ways = self._next(*look(self._chunk))
            forces.append(force)
            distances.append(ways)
        force, ways = np.concatenate(forces), np.concatenate(distances)
        self._force, self._ways = force[length:], ways[length:]
        return force[:length], ways[:length]

    def _next(self, speed: float, load: float) -> tuple[Array, Array]:
        speeds, loads = (self._speed, speed), (self._load, load)
        gone = _STEPS * speeds[0] + _SQUARES * ((speeds[1] - speeds[0]) / 2 / CHUNK)
        ways = self._way + gone / self._rate
        self._way, self._speed, self._load = float(ways[-1]), speed, load
        return self._read(ways, speeds, loads), ways

    def _read(self, ways: Array, speeds: tuple[float, float], loads: tuple[float, float]) -> Array:
        force = np.zeros(len(ways))
        turns = (self._offset + ways) / self._rubbed.roughness.length
        levels = self._level(speeds[0]), self._level(speeds[1])
        for number, weights in _rungs(*loads).items():
            add_reading(rung(self._rubbed, number), turns, levels, weights, force)
        return force

    def _level(self, speed: float) -> float:
        """Return the level whose shortest waves pass in two samples or more, between two levels."""
        passing = 2 * self._rubbed.finest * speed / self._rate
        return max(0.0, LEVELS_AN_OCTAVE * math.log2(passing) + 1) if passing > 0 else 0.0


def fading(numbers: Array, fade: int, last: int | None) -> Array:
    """Return factors that fade a contact in over `fade` samples, and out after its last one."""
    if numbers[0] >= fade and (last is None or numbers[-1] <= last):
        return np.ones(len(numbers))
    rising = np.clip((numbers + 1) / fade, 0, 1)
    falling = 1.0 if last is None else np.clip((last + fade - numbers) / fade, 0, 1)
    return np.square(np.sin(np.pi / 2 * rising) * np.sin(np.pi / 2 * falling))


def rung_at(load: float) -> int:
    """Return the number of the tabulated load at or below a load, N."""
    return math.floor(RUNGS_AN_OCTAVE * math.log2(max(load, LIGHTEST)))


@lru_cache(maxsize=64)  # as most loads are steady
def _rungs(begin: float, end: float) -> Mapping[int, Sequence[float]]:
    """Return the tabulated loads about two loads, and their weights in each."""
    rungs: dict[int, list[float]] = {}
    for which, load in enumerate((begin, end)):
        if load > 0:
            held, number = max(load, LIGHTEST), rung_at(load)
            low, high = (2 ** (n / RUNGS_AN_OCTAVE) for n in (number, number + 1))
            share = (held - low) / (high - low)
            for rung_number, weight in ((number, 1 - share), (number + 1, share)):
                rungs.setdefault(rung_number, [0.0, 0.0])[which] += weight * load / held
    return rungs


def add_reading(
    table: Rung,
    turns: Array,
    levels: Sequence[float],
    weights: Sequence[float],
    out: Array,
) -> None:
    """Add to `out` (n,) the values of a rung at `turns` (n,) of its period.

    Levels and weights go in a straight line from the first to the last of two.
    """
    compiled = entry("friction_add_reading")
    if compiled is None:
        add_reading_plainly(table, turns, levels, weights, out)
        return
    compiled(*table.places, len(table.counts), turns, len(turns), *levels, *weights, out)


def add_reading_plainly(
    table: Rung,
    turns: Array,
    levels: Sequence[float],
    weights: Sequence[float],
    out: Array,
) -> None:
    """Add the values of a rung as `add_reading` does, in plain NumPy."""
    share = np.arange(len(out)) / len(out)
    level = (1 - share) * levels[0] + share * levels[1]
    heard = level < len(table.counts)
    level, turns = level[heard], turns[heard]
    low = level.astype(np.int64)
    blend = level - low
    value = (1 - blend) * _cubic(table, low, turns)
    inner = low + 1 < len(table.counts)
    value[inner] += blend[inner] * _cubic(table, low[inner] + 1, turns[inner])
    out[heard] += ((1 - share) * weights[0] + share * weights[1])[heard] * value


def _cubic(table: Rung, levels: Index, turns: Array) -> Array:
    """Return the cubic through the four points about each place (Lagrange)."""
    starts, counts = table.starts[levels], table.counts[levels]
    place = (turns - np.floor(turns)) * counts
    whole = np.where(place <= counts, place, 0).astype(np.int64)
    x = place - whole
    points = (table.values[starts + (whole + ahead) % counts] for ahead in (-1, 0, 1, 2))
    before, here, after, beyond = points
    half, sixth = np.float64(1 / 2), np.float64(1 / 6)  # of float64: products are so too
    slope = after - 2 * sixth * before - half * here - sixth * beyond
    bend = half * (before + after) - here
    twist = sixth * (beyond - before) + half * (here - after)
    return here + x * (slope + x * (bend + x * twist))

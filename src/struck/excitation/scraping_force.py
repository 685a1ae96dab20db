"""The force between two bodies that move along each other, by Hertz's law over their roughness.

A round tip of radius R is pressed on a rough surface by a load. Its dent is a spring of stiffness
k = (6 E*^2 R load)^(1/3) (Hertz's law about the load; Johnson 1985, section 4.2). The heights h,
averaged over the contact, change the force of that spring by x = k h / load of the load. The force
is

    F = load (1 + y / sqrt(1 + (y / 0.8)^2)),  y = g(v) x / (1 + X^0.6),  X = rms of x

so that it is never a pull: it stays above 0.2 of the load where the surface falls, and below 1.8 of
it where it rises. A constant load is silent and left out.

- *Speed.* g(v) = 0.05 (v / 1 m/s)^(3/4) is the fraction of the heights that compresses the dent;
  the tip follows the rest as it moves up and down. A roller, all of whose mass would have to move,
  has a factor of 0.3. The level of rubbing noise is a linear function of the logarithm of speed and
  of roughness (Ben Abdelounis, Le Bot, Perret-Liaudet & Zahouani, Wear 268, 335 (2010)); the
  exponent is 3/4, or 4.5 dB per doubling ("Influence of sliding speed on roughness noise", 2019,
  experiment and simulation).
- *Roughness.* The force of smooth surfaces, X below 1, is proportional to their heights, that of
  rough ones, which the dent cannot take, to their power 0.4. Twice the load is louder by 2^(1/3)
  when smooth and by 2^0.73 when rough.
- *Contact.* The circle of contact has the radius a = (3 load R / (4 E*))^(1/3); averaging over its
  pressure, sqrt(1 - (r/a)^2), multiplies waves of wavenumber q by 3 (sin qa - qa cos qa) / (qa)^3.
  Waves longer than half a millimetre are followed: they count as the square of 0.5 mm over that.

All this happens over distance: moving twice as fast shifts the whole spectrum up an octave (a
surface read at the speed of contact: van den Doel, Kry & Pai, FoleyAutomatic, SIGGRAPH 2001). The
fraction, the power and the following are simple models for the inertia of the tip.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len

from struck.core import entry
from struck.excitation.excitation import require_at_least_zero, require_kernel, require_positive
from struck.excitation.hertz import Striker, contact_modulus
from struck.excitation.pulses import SOFTNESS, sampled
from struck.excitation.roughness import Finish, Profile, finish
from struck.excitation.texture import CHUNK, add_heights, hump, variance
from struck.model.arrays import Array, Complex, Index, checked
from struck.model.model import ModalModel

LEVELS_PER_OCTAVE = 3
FADE_SECONDS = 5e-3  # s, in which a moving contact fades in and out
LIGHTEST = 1e-6  # N: the force of lighter contacts is in proportion to this one's

_MAX_FORCE_RATIO = 0.8  # of the load: the largest change of the force, also if filters overshoot
TIP_FRACTION, ROLLER_FRACTION = 0.05, 0.3  # of the heights that compress the dent, at 1 m/s
_SPEED_EXPONENT = 0.75  # of the speed
_ROUGHNESS_EXPONENT = 0.6  # power of X by which a rough surface acts less than in proportion
FOLLOWED_LENGTH = 5e-4  # m, waves from which on the tip follows
# Spacings a sample between which layers fade out: their waves are two spacings long and longer.
_FADE_START, _FADE_END = 0.45, 0.8
_FAINT_RATIO = 3e-3  # of the loudest layer's weight: weaker layers are left out
_POINTS_PER_WAVE = 6  # of the shortest wave of a level
_WINDOW, _MAX_KERNEL = 2e-3, 0.1  # s, over which loads are spread
_FLAT_RATIO = 2 / 3  # of a level's band, which passes unchanged
_RESOLVED_PHASE = 3.3  # q a of the shortest wave that a contact resolves


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tool:
    """A tool that touches a body: its tip, roughness, patch and softness.

    Parameters
    ----------
    roughness : str, Roughness or Profile, default "wood"
        Surface: a name in ``roughness.toml``, a finish, or a profile that is read as it is.
    striker : str, default "plastic"
        Striker whose material and radius the tip has: a name in ``strikers.toml``.
    radius : float or None, default None
        Radius of the tip, m. None: that of the striker.
    patch : float, default 0.0
        Radius of the area over which mode shapes are averaged, m; 0 for a point.
    seed : int, default 0
        Seed of the surface.
    kernel : str or None, default None
        Pulse over which loads are spread, as of a `ForceTrack`: a soft tip takes up loads slowly
        (O'Brien et al. 2002, section 3.4). None: a window of 2 ms.
    softness : float or None, default None
        Duration of the kernel, s, at most 0.1. None: 3 ms.

    Raises
    ------
    OptionError
        If a name is unknown, or a number is out of range.

    Examples
    --------
    >>> from struck.excitation import Tool
    >>> tool = Tool(striker="steel", roughness="sandpaper")
    >>> round(float(tool.window(48_000).sum()), 6)
    1.0
    """

    roughness: str | Finish = "wood"
    striker: str = "plastic"
    radius: float | None = None
    patch: float = 0.0
    seed: int = 0
    kernel: str | None = None
    softness: float | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "roughness", finish(self.roughness))
        Striker.named(self.striker)
        require_positive(radius=self.radius)
        require_at_least_zero(patch=self.patch, seed=self.seed)
        kernel = require_kernel(self.kernel, self.softness, _MAX_KERNEL)
        object.__setattr__(self, "kernel", kernel)

    def window(self, sample_rate: float) -> Array:
        """Compute the window that smooths loads.

        Parameters
        ----------
        sample_rate : float
            Sample rate, Hz.

        Returns
        -------
        array (n,)
            Window with the sum 1.
        """
        if self.kernel is None:
            hann = np.hanning(max(1, round(_WINDOW * sample_rate)) + 2)[1:-1]
            return np.asarray(hann / hann.sum(), np.float64)
        duration = self.softness or SOFTNESS
        pulse = sampled(
            self.kernel, impulse=1.0, onset=0.0, duration=duration, sample_rate=sample_rate
        )
        return pulse.force / pulse.force.sum()

    def on(self, model: ModalModel) -> SlidingContact:
        """Compute the contact of the tip with a body.

        Parameters
        ----------
        model : ModalModel
            Model of the body, whose material counts.

        Returns
        -------
        SlidingContact
            Finish, contact modulus, radius and seed of the contact.
        """
        tip = Striker.named(self.striker)
        solids = (tip,) if model.material is None else (tip, model.material)
        return SlidingContact(
            roughness=finish(self.roughness),
            modulus=contact_modulus(*solids),
            radius=self.radius or tip.radius,
            seed=int(self.seed),
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SlidingContact:
    """Two bodies in contact: the surface that moves past, and the spring of the dent."""

    roughness: Finish
    modulus: float  # E* of the two, Pa
    radius: float  # joint radius of curvature, m
    seed: int = 0
    height_fraction: float = TIP_FRACTION  # of the heights that compresses the dent, at 1 m/s

    def contact_radius(self, loads: Array) -> Array:
        """Return the radius of the circle of contact, m, at loads of any shape, N."""
        return np.cbrt(3 * loads * self.radius / (4 * self.modulus))

    def stiffness(self, loads: Array) -> Array:
        """Return the stiffness of the contact under loads (an array of any shape, N), N/m."""
        return np.cbrt(6 * self.modulus**2 * self.radius * loads)

    def scale(self, rms_height: Array, speeds: Array, loads: Array) -> Array:
        """Return y per metre of height, 1/m, of heights with `rms_height`, m, at the dent."""
        positive_loads = np.maximum(loads, LIGHTEST)
        compression_per_height = self.stiffness(positive_loads) / positive_loads
        fraction = np.minimum(self.height_fraction * speeds**_SPEED_EXPONENT, 1.0)
        return (
            (loads > 0)
            * fraction
            * compression_per_height
            / (1 + (compression_per_height * rms_height) ** _ROUGHNESS_EXPONENT)
        )


def force_variation(compressions: Array, loads: Array) -> Array:
    """Return F - load, N, of compressions y under loads."""
    return loads * compressions / np.sqrt(1 + np.square(compressions * (1 / _MAX_FORCE_RATIO)))


class Reader:
    """The force of a surface that moves past a contact, read by place, or by distance.

    Speeds and loads are sampled at control points, every 64 samples from the start of the contact;
    values derived from them are interpolated linearly, so that the force does not depend on the
    length of blocks.
    """

    def __init__(self, sliding: SlidingContact, sample_rate: float) -> None:
        self._sliding, self._rate = sliding, sample_rate
        self._last_pair: tuple[float, float] | None = None
        self._weights = np.zeros(0)
        surface = sliding.roughness
        if isinstance(surface, Profile):
            self._levels = levels_of(surface)
            self._offset = float(np.random.default_rng(sliding.seed).random())
        else:
            self._layers = surface.layers(sliding.seed)
            self._layer_heights = self._layers.heights * unfollowed_fraction(self._layers.spacings)
            self._scales = np.log(self._layers.spacings)
            log_radii, _ = _patch_mean()
            self._laws = np.array([
                *(sliding.modulus, sliding.radius, sliding.height_fraction, _SPEED_EXPONENT),
                *(_ROUGHNESS_EXPONENT, variance(), LIGHTEST, _FADE_END / (_FADE_END - _FADE_START)),
                *(_FAINT_RATIO, log_radii[0], log_radii[1] - log_radii[0]),
            ])  # fmt: skip
            self._falls = 1 / (sample_rate * self._layers.spacings * (_FADE_END - _FADE_START))

    def compressions(
        self, first: int, places: Array, ways: Array, speeds: Array, loads: Array
    ) -> Array:
        """Return the compression y (n,) of the dent.

        At places (n, 3) and after distances (n,), m; speeds, m/s, and loads, N, are those of the
        control points (rows,); `first` samples have passed since the first of them.
        """
        out = np.zeros(len(ways))
        if isinstance(self._sliding.roughness, Profile):
            self._read_profile(first, ways, speeds, loads, out)
        else:
            add_heights(self._layers, self._find_weights(speeds, loads), first, places, out)
        return out

    def _find_weights(self, speeds: Array, loads: Array) -> Array:
        """Return the weight of each layer at each control point (rows, O)."""
        is_steady = speeds.min() == speeds.max() and loads.min() == loads.max()
        pair = (float(speeds[0]), float(loads[0]))
        if not is_steady:
            self._last_pair = None
            return self.weights_at(speeds, loads)
        if pair != self._last_pair or len(self._weights) < len(speeds):
            rows = self.weights_at(speeds[:1], loads[:1])
            self._last_pair, self._weights = pair, np.tile(rows, (max(len(speeds), 4), 1))
        return self._weights

    def weights_at(self, speeds: Array, loads: Array) -> Array:
        """Return the weight of each texture layer under speeds and loads (rows, O)."""
        compiled_loop = entry("friction_weigh")
        if compiled_loop is None:
            return self.weights_plainly(speeds, loads)
        weights, shares = np.empty((len(speeds), len(self._scales))), _patch_mean()[1]
        layers = self._layer_heights, self._scales, self._falls, len(self._scales)
        controls = *map(np.ascontiguousarray, (speeds, loads)), len(speeds)
        compiled_loop(*layers, shares, len(shares), *controls, self._laws, weights)
        return weights

    def weights_plainly(self, speeds: Array, loads: Array) -> Array:
        """Return weights of the surface's layers like `weights_at`, in plain NumPy."""
        sliding = self._sliding
        radii = sliding.contact_radius(np.maximum(loads, LIGHTEST))
        heights = self._layer_heights * patch_mean(np.log(radii)[:, None] - self._scales)
        rms_heights = np.sqrt(variance() * np.vecdot(heights, heights))
        falling = self._falls * speeds[:, None]
        band_gains = np.minimum(np.maximum(_FADE_END / (_FADE_END - _FADE_START) - falling, 0), 1)
        weights = heights * band_gains * sliding.scale(rms_heights, speeds, loads)[:, None]
        thresholds = _FAINT_RATIO * np.maximum.reduce(weights, axis=1)
        return weights * (weights >= thresholds[:, None])

    def _read_profile(
        self, first: int, distances: Array, speeds: Array, loads: Array, out: Array
    ) -> None:
        sliding, table = self._sliding, self._levels
        radii = sliding.contact_radius(np.maximum(loads, LIGHTEST))
        felt_levels = table.level_of(_RESOLVED_PHASE / (2 * np.pi * radii))
        rms_heights = np.interp(felt_levels, np.arange(len(table.rms)), table.rms)
        passing = table.level_of(self._rate / 2 / np.maximum(speeds, 1e-30))
        levels = np.maximum(felt_levels, np.where(passing > 0, passing + 1, 0))
        weights = sliding.scale(rms_heights, speeds, loads)
        phases = self._offset + distances / table.length
        sample_count = 0
        while sample_count < len(out):
            row, chunk_offset = divmod(first + sample_count, CHUNK)
            count = min(CHUNK - chunk_offset, len(out) - sample_count)
            shares = np.array([chunk_offset, chunk_offset + count]) / CHUNK
            ends = [
                tuple((course[row] + shares * (course[row + 1] - course[row])).tolist())
                for course in (levels, weights)
            ]
            piece = slice(sample_count, sample_count + count)
            add_reading(table, phases[piece], ends[0], ends[1], out[piece])
            sample_count += count


def unfollowed_fraction(lengths: Array) -> Array:
    """Return the fraction of waves of these lengths, m, that the tip does not follow."""
    return 1 / (1 + np.square(lengths / FOLLOWED_LENGTH))


def pressure_mean(phases: Array) -> Array:
    """Return the mean of a wave over a Hertz contact, 3 (sin u - u cos u) / u^3 at u = q a."""
    large_phases = np.maximum(np.abs(phases), 0.1)
    closed_form = 3 * (np.sin(large_phases) - large_phases * np.cos(large_phases)) / large_phases**3
    series = 1 - np.square(phases) / 10 + phases**4 / 280
    return np.where(np.abs(phases) < 0.1, series, closed_form)


def patch_mean(radii: Array) -> Array:
    """Return the rms of a layer's mean over a Hertz contact, relative to that of the layer.

    `radii` are logarithms of the radius of contact in spacings of the layer.
    """
    return np.interp(radii, *_patch_mean())


@cache
def _patch_mean() -> tuple[Array, Array]:
    radii = np.geomspace(1e-3, 1e3, 181)
    waves = np.geomspace(1e-3, 3.0, 800)
    spectrum = hump(waves) * np.square(waves)  # longer waves are those of coarser layers
    felt_spectra = np.square(pressure_mean(2 * np.pi * waves * radii[:, None])) * spectrum
    powers = np.trapezoid(felt_spectra, waves, axis=1) / np.trapezoid(spectrum, waves)
    return np.log(radii), np.sqrt(powers)


def fading(first: int, count: int, fade: int, last: int | None) -> Array | float:
    """Return factors that fade a contact in over `fade` samples, and out after its last one.

    They are those of `count` samples from number `first` on; one where all are 1.
    """
    if first >= fade and (last is None or first + count - 1 <= last):
        return 1.0
    end = np.inf if last is None else float(last)  # a whole number may exceed those of NumPy
    numbers, factors = np.arange(first, first + count), np.ones(count)
    edges = (numbers < fade) | (numbers > end)
    rising = np.minimum((numbers[edges] + 1) / fade, 1)
    falling = np.clip((end + fade - numbers[edges]) / fade, 0, 1)
    factors[edges] = np.square(np.sin(np.pi / 2 * rising) * np.sin(np.pi / 2 * falling))
    return factors


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Levels:
    """A profile low-passed to ever longer waves, for ever faster motion and wider contacts."""

    values: NDArray[np.float32]  # (T,), m, level after level
    starts: Index  # (L,), where level j begins, of waves up to `finest` 2^(-j / LEVELS_AN_OCTAVE)
    counts: Index  # (L,), points of a level over the period
    length: float = 1.0  # of the period, m
    finest: float = 1.0  # highest wavenumber of the first level, cycles/m
    rms: Array = field(default_factory=lambda: np.ones(1))  # (L,), m
    places: tuple[int, ...] = field(init=False)  # addresses of the first three, for the core

    def __post_init__(self) -> None:
        arrays = self.values, self.starts, self.counts
        object.__setattr__(self, "places", tuple(array.ctypes.data for array in arrays))

    def level_of(self, wavenumbers: Array) -> Array:
        """Return the level, between two, whose shortest waves have wavenumbers, cycles/m."""
        octaves = np.log2(self.finest / np.maximum(wavenumbers, 1e-300))
        return np.maximum(0.0, LEVELS_PER_OCTAVE * octaves)


@lru_cache(maxsize=16)  # of some 2 MB
def levels_of(profile: Profile) -> Levels:
    """Return a height profile low-passed by octaves, less the long waves that a tip follows."""
    count = len(profile.heights)
    waves = np.arange(count // 2 + 1)
    lengths = profile.length / np.maximum(waves, 1)
    spectrum = np.fft.rfft(profile.heights) / count * unfollowed_fraction(lengths)
    levels, cutoff = [], count / 2 / _FLAT_RATIO
    while cutoff > 1:
        levels.append(_low_pass(spectrum, cutoff))
        cutoff /= 2 ** (1 / LEVELS_PER_OCTAVE)
    counts = np.array([len(level) for level in levels])
    return Levels(
        values=np.concatenate(levels).astype(np.float32),
        starts=np.cumsum(counts) - counts,
        counts=counts,
        length=profile.length,
        finest=count / 2 / _FLAT_RATIO / profile.length,
        rms=np.array([level.std() for level in levels]),
    )


def _low_pass(spectrum: Complex, cutoff: float) -> Array:
    """Return one period of a profile without waves above `cutoff` in it."""
    wave_count = min(int(cutoff) + 1, len(spectrum))
    waves = np.arange(wave_count)
    fall = np.clip((cutoff - waves) / (cutoff * (1 - _FLAT_RATIO)), 0, 1)
    count = next_fast_len(max(8, int(np.ceil(_POINTS_PER_WAVE * cutoff))), real=True)
    return np.fft.irfft(spectrum[:wave_count] * np.sin(np.pi / 2 * fall) ** 2, count) * count


def add_reading(
    table: Levels, phases: Array, levels: Sequence[float], weights: Sequence[float], out: Array
) -> None:
    """Add to `out` (n,) the values of a table at `phases` (n,), in periods.

    Levels and weights go in a straight line from the first to the last of two.
    """
    compiled_loop = entry("friction_add_reading")
    if compiled_loop is None:
        add_reading_plainly(table, phases, levels, weights, out)
        return
    compiled_loop(*table.places, len(table.counts), phases, len(phases), *levels, *weights, out)


def add_reading_plainly(
    table: Levels, phases: Array, levels: Sequence[float], weights: Sequence[float], out: Array
) -> None:
    """Add the values of a table as `add_reading` does, in plain NumPy."""
    fraction = np.arange(len(out)) / len(out)
    level = (1 - fraction) * levels[0] + fraction * levels[1]
    is_resolved = level < len(table.counts)
    level, phases = level[is_resolved], phases[is_resolved]
    low = level.astype(np.int64)
    blend = level - low
    value = (1 - blend) * _interpolate_cubic(table, low, phases)
    inner = low + 1 < len(table.counts)
    value[inner] += blend[inner] * _interpolate_cubic(table, low[inner] + 1, phases[inner])
    out[is_resolved] += ((1 - fraction) * weights[0] + fraction * weights[1])[is_resolved] * value


def _interpolate_cubic(table: Levels, levels: Index, phases: Array) -> Array:
    """Return the cubic through the four points about each place (Lagrange)."""
    first_points, counts = table.starts[levels], table.counts[levels]
    place = (phases - np.floor(phases)) * counts
    point_numbers = np.where(place <= counts, place, 0).astype(np.int64)
    x = place - point_numbers
    points = (
        table.values[first_points + (point_numbers + shift) % counts] for shift in (-1, 0, 1, 2)
    )
    p0, p1, p2, p3 = points
    half, sixth = np.float64(1 / 2), np.float64(1 / 6)  # of float64: products are so too
    slope = p2 - 2 * sixth * p0 - half * p1 - sixth * p3
    bend = half * (p0 + p2) - p1
    twist = sixth * (p3 - p0) + half * (p1 - p2)
    return p1 + x * (slope + x * (bend + x * twist))

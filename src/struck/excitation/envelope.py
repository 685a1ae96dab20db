"""Envelope of heights under a rolling ball of a given radius, and the ball's own roundness.

A ball of radius R over heights h(s) rests where it touches first, so that its lowest point is at

    e(s) = max over u of h(s + u) - u^2 / (2 R)

(the morphological envelope of ISO 16610-41, by which stylus instruments account for the ball of
their tips): it bridges what it is too large to enter. Heights are taken along the way only; peaks
beside it would lift the ball a little more. They are read at the points of a grid over the way, and
the envelope is averaged over the circle of contact, or over the distance between two samples where
that is longer, so that nothing folds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.ndimage import grey_dilation

from struck.excitation.friction import FOLLOWED, LIGHTEST, Rubbed
from struck.excitation.texture import CHUNK, Layers
from struck.model.arrays import Array

_WAVES = 240  # around the roller, the more the lower, and at least 2: one would be off its axle
_POINTS = 1 << 14  # around it
_RANGE = 6.0  # rms heights from valley to peak
_WIDEST = 400  # grid points that a peak reaches to each side
_FINEST = 2e-6  # m, of the grid
_SLAB = 2048  # grid points that are added at once
_FASTEST = 64  # grid points a sample: what is faster is not heard
_WITHIN = np.sqrt(3 / 5)  # half width of a mean as wide as that over the pressure, of its radius
_SAMPLED = 8192  # grid points whose heights give the mean square


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Roller:
    """Deviations of a rolling body from round."""

    radius: float  # m
    layers: Layers  # of its finish
    roundness: float = 0.0  # rms height of the waviness of its circumference, m
    flat: float = 0.0  # depth of a flat spot, m
    seed: int = 0  # of the roundness
    outline: Array = field(init=False)  # (_POINTS,), m: out of round

    def __post_init__(self) -> None:
        random = np.random.default_rng(self.seed)
        waves = np.zeros(_POINTS // 2 + 1, np.complex128)
        waves[2 : _WAVES + 1] = np.exp(2j * np.pi * random.random(_WAVES - 1))
        waves[2 : _WAVES + 1] /= np.arange(2, _WAVES + 1)
        outline = np.fft.irfft(waves)
        object.__setattr__(self, "outline", outline * (self.roundness / outline.std()))

    def heights(self, ways: Array) -> Array:
        """Return how far its surface is out where it touches after rolling (n,), m."""
        turns = ways / self.radius
        places = np.stack([np.cos(turns), np.sin(turns), np.zeros(len(turns))], axis=1)
        found = self.layers.at(self.radius * places)
        points = turns * (_POINTS / 2 / np.pi)
        found += np.interp(points, np.arange(_POINTS), self.outline, period=_POINTS)
        chord = np.sqrt(8 * self.radius * self.flat)
        if chord:
            around = 2 * np.pi * self.radius
            from_middle = ((ways / around) % 1 - 0.5) * around / chord
            inside = np.abs(from_middle) < 0.5
            found -= np.where(inside, self.flat * np.cos(np.pi * from_middle) ** 2, 0.0)
        return found


class Envelope:
    """The squeeze of a rolling contact, by the distance rolled; reads as a `Reader` does."""

    def __init__(
        self,
        rubbed: Rubbed,
        sample_rate: float,
        heights: Callable[[Array], Array],  # m, of both surfaces together, after distances, m
        load: float,  # N, for which the grid is made
    ) -> None:
        self._rubbed, self._rate, self._heights = rubbed, sample_rate, heights
        contact = float(rubbed.contact_radius(np.array(max(load, LIGHTEST))))
        coarse = heights(np.linspace(0, 0.1, _SAMPLED))
        reach = np.sqrt(2 * rubbed.radius * _RANGE * max(float(coarse.std()), 1e-12))
        self._step = max(contact / 6, _FINEST, reach / _WIDEST)
        self._side = max(1, int(np.ceil(reach / self._step)))
        apart = np.arange(-self._side, self._side + 1) * self._step
        self._cap = -np.square(apart) / (2 * rubbed.radius)
        self._first = 0  # number of the first grid point kept
        self._sums = np.zeros(0)  # integral of the envelope up to each, in steps
        length = _SAMPLED * self._step
        self._felt = float(self._waves(np.linspace(0, length, _SAMPLED), contact * _WITHIN).std())
        self._restart(0)

    def squeezes(
        self, first: int, places: Array, ways: Array, speeds: Array, loads: Array
    ) -> Array:
        """Return the squeeze y (n,) of the dent, as `Reader.squeezes` does."""
        del places
        passed = (ways[-1] - ways[0]) / self._step
        if not passed < _FASTEST * len(ways):
            return np.zeros(len(ways))
        numbers = (first + np.arange(1.0, len(ways) + 1)) / CHUNK
        rows = np.arange(len(speeds))
        contact = _WITHIN * self._rubbed.contact_radius(np.maximum(loads, LIGHTEST))
        halves = np.maximum(contact, speeds / self._rate)
        scale = self._rubbed.scale(np.array(self._felt), speeds, loads)
        half, factor = (np.interp(numbers, rows, course) for course in (halves, scale))
        return factor * self._waves(ways, half)

    def _waves(self, ways: Array, half: Array | float) -> Array:
        """Return the envelope (n,), averaged over `half` m to each side, less its slow part."""
        return self._mean(ways, half) - self._mean(ways, FOLLOWED / 2)

    def _mean(self, ways: Array, half: Array | float) -> Array:
        widest = max(float(np.max(half)), FOLLOWED)
        self._cover(float(ways.min()) - widest, float(ways.max()) + widest)
        ahead, behind = (self._sum(ways + side * half) for side in (1, -1))
        return (ahead - behind) * self._step / (2 * np.asarray(half))

    def _sum(self, ways: Array) -> Array:
        numbers = ways / self._step - self._first
        return np.interp(numbers, np.arange(len(self._sums)), self._sums)

    def _cover(self, begin: float, end: float) -> None:
        """Extend the grid over a stretch of the way, and drop the part far behind it."""
        low, high = int(np.floor(begin / self._step)), int(np.ceil(end / self._step)) + 1
        last = self._first + len(self._sums)
        if low < self._first or low > last:
            self._restart(low)
            last = low
        if high >= last:
            slabs = -(-(high + 1 - last) // _SLAB)
            self._extend(last, slabs * _SLAB)
        spare = low - self._first
        if spare > 4 * _SLAB:
            self._first, self._sums = low, self._sums[spare:].copy()

    def _restart(self, number: int) -> None:
        self._first, self._sums = number, np.zeros(0)

    def _extend(self, number: int, count: int) -> None:
        numbers = np.arange(number - self._side, number + count + self._side, dtype=np.float64)
        heights = self._heights(numbers * self._step)
        cap: Any = self._cap  # as types know whole numbers alone
        found = grey_dilation(heights, size=(len(cap),), structure=cap, mode="nearest")
        envelope = found[self._side : self._side + count]
        before = self._sums[-1] if len(self._sums) else 0.0
        self._sums = np.concatenate([self._sums, before + np.cumsum(envelope)])

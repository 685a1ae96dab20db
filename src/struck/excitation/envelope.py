"""Envelope of heights under a rolling ball of a given radius, and the ball's own roundness.

A ball of radius R over heights h(s) rests where it touches first, so that its lowest point is at

    e(s) = max over u of h(s + u) - u^2 / (2 R)

(the morphological envelope of ISO 16610-41, by which stylus instruments account for the ball of
their tips): it bridges what it is too large to enter. Heights are taken along the path only; peaks
next to it would lift the ball a little more. They are read at the points of a grid over the way,
and the envelope is averaged over the circle of contact, or over the distance between two samples
where that is longer, so that nothing folds.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.ndimage import grey_dilation

from struck.excitation.scraping_force import FOLLOWED_LENGTH, LIGHTEST, SlidingContact
from struck.excitation.texture import CHUNK, Layers
from struck.model.arrays import Array

_WAVES = 240  # around the roller, the more the lower, and at least 2: one would be off its axle
_POINTS = 1 << 14  # around it
_HEIGHT_RANGE = 6.0  # rms heights from valley to peak
_MAX_REACH_POINTS = 400  # grid points that a peak reaches to each side
_MIN_STEP = 2e-6  # m, of the grid
_SLAB_POINTS = 2048  # grid points that are added at once
_MAX_POINTS_PER_SAMPLE = 64  # grid points per sample: a faster contact is silent
# Half width of a mean over a line that is as wide as the mean over the pressure, of its radius.
_MEAN_RADIUS_RATIO = np.sqrt(3 / 5)
_SAMPLED_POINTS = 8192  # grid points whose heights give the mean square


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Roller:
    """Deviations of a rolling body from round."""

    radius: float  # m
    layers: Layers  # of its finish
    roundness: float = 0.0  # rms height of the waviness of its circumference, m
    flat: float = 0.0  # depth of a flat area, m
    seed: int = 0  # of the roundness
    outline: Array = field(init=False)  # (_POINTS,), m: out of round

    def __post_init__(self) -> None:
        random = np.random.default_rng(self.seed)
        waves = np.zeros(_POINTS // 2 + 1, np.complex128)
        waves[2 : _WAVES + 1] = np.exp(2j * np.pi * random.random(_WAVES - 1))
        waves[2 : _WAVES + 1] /= np.arange(2, _WAVES + 1)
        outline = np.fft.irfft(waves)
        object.__setattr__(self, "outline", outline * (self.roundness / outline.std()))

    def heights(self, distances: Array) -> Array:
        """Return how far its surface is out where it touches after rolling (n,), m."""
        angles = distances / self.radius
        places = np.stack([np.cos(angles), np.sin(angles), np.zeros(len(angles))], axis=1)
        heights = self.layers.at(self.radius * places)
        points = angles * (_POINTS / 2 / np.pi)
        heights += np.interp(points, np.arange(_POINTS), self.outline, period=_POINTS)
        chord = np.sqrt(8 * self.radius * self.flat)
        if chord:
            circumference = 2 * np.pi * self.radius
            chord_position = ((distances / circumference) % 1 - 0.5) * circumference / chord
            is_inside = np.abs(chord_position) < 0.5
            heights -= np.where(is_inside, self.flat * np.cos(np.pi * chord_position) ** 2, 0.0)
        return heights


class Envelope:
    """The compression of a rolling contact, by the distance rolled; reads as a `Reader` does."""

    def __init__(
        self,
        sliding: SlidingContact,
        sample_rate: float,
        heights: Callable[[Array], Array],  # m, of both surfaces together, after distances, m
        load: float,  # N, for which the grid is made
    ) -> None:
        self._sliding, self._rate, self._heights = sliding, sample_rate, heights
        contact = float(sliding.contact_radius(np.array(max(load, LIGHTEST))))
        coarse_heights = heights(np.linspace(0, 0.1, _SAMPLED_POINTS))
        reach = np.sqrt(
            2 * sliding.radius * _HEIGHT_RANGE * max(float(coarse_heights.std()), 1e-12)
        )
        self._step = max(contact / 6, _MIN_STEP, reach / _MAX_REACH_POINTS)
        self._side = max(1, int(np.ceil(reach / self._step)))
        offsets = np.arange(-self._side, self._side + 1) * self._step
        self._cap = -np.square(offsets) / (2 * sliding.radius)
        self._first = 0  # number of the first grid point kept
        self._sums = np.zeros(0)  # integral of the envelope up to each, in steps
        length = _SAMPLED_POINTS * self._step
        self._rms_height = float(
            self._waves(np.linspace(0, length, _SAMPLED_POINTS), contact * _MEAN_RADIUS_RATIO).std()
        )
        self._restart(0)

    def compressions(
        self, first: int, places: Array, ways: Array, speeds: Array, loads: Array
    ) -> Array:
        """Return the compression y (n,) of the dent, as `Reader.compressions` does."""
        del places
        passed_points = (ways[-1] - ways[0]) / self._step
        if not passed_points < _MAX_POINTS_PER_SAMPLE * len(ways):
            return np.zeros(len(ways))
        numbers = (first + np.arange(1.0, len(ways) + 1)) / CHUNK
        rows = np.arange(len(speeds))
        contact = _MEAN_RADIUS_RATIO * self._sliding.contact_radius(np.maximum(loads, LIGHTEST))
        halves = np.maximum(contact, speeds / self._rate)
        scale = self._sliding.scale(np.array(self._rms_height), speeds, loads)
        half, factor = (np.interp(numbers, rows, course) for course in (halves, scale))
        return factor * self._waves(ways, half)

    def _waves(self, distances: Array, half: Array | float) -> Array:
        """Return the envelope (n,), averaged over `half` m to each side, less its slow part."""
        return self._mean(distances, half) - self._mean(distances, FOLLOWED_LENGTH / 2)

    def _mean(self, distances: Array, half: Array | float) -> Array:
        max_half_width = max(float(np.max(half)), FOLLOWED_LENGTH)
        self._cover(
            float(distances.min()) - max_half_width, float(distances.max()) + max_half_width
        )
        upper_sums, lower_sums = (self._sum(distances + side * half) for side in (1, -1))
        return (upper_sums - lower_sums) * self._step / (2 * np.asarray(half))

    def _sum(self, distances: Array) -> Array:
        numbers = distances / self._step - self._first
        return np.interp(numbers, np.arange(len(self._sums)), self._sums)

    def _cover(self, start: float, end: float) -> None:
        """Extend the grid over a range of distances, m, and drop the part far before it."""
        low, high = int(np.floor(start / self._step)), int(np.ceil(end / self._step)) + 1
        last = self._first + len(self._sums)
        if low < self._first or low > last:
            self._restart(low)
            last = low
        if high >= last:
            slabs = -(-(high + 1 - last) // _SLAB_POINTS)
            self._extend(last, slabs * _SLAB_POINTS)
        spare_points = low - self._first
        if spare_points > 4 * _SLAB_POINTS:
            self._first, self._sums = low, self._sums[spare_points:].copy()

    def _restart(self, number: int) -> None:
        self._first, self._sums = number, np.zeros(0)

    def _extend(self, number: int, count: int) -> None:
        numbers = np.arange(number - self._side, number + count + self._side, dtype=np.float64)
        heights = self._heights(numbers * self._step)
        cap: Any = self._cap  # as types know whole numbers alone
        dilated_heights = grey_dilation(heights, size=(len(cap),), structure=cap, mode="nearest")
        envelope = dilated_heights[self._side : self._side + count]
        base_sum = self._sums[-1] if len(self._sums) else 0.0
        self._sums = np.concatenate([self._sums, base_sum + np.cumsum(envelope)])

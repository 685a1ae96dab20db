"""Solid textures: random heights in the coordinates of a body, made on the fly from a seed.

A texture is a sum of layers of value noise (`core/texture.c`): lattices of random values with
different spacings and orientations, blended smoothly between corners. A place has its height
whatever was read before, the same place the same height again, and no table repeats.

Along a straight line a layer of spacing L has the covariance of its blend, whose spectrum is a
smooth hump: level up to about 0.2 / L, 3 dB less at 0.4 / L, 20 dB less at 0.9 / L, in any
direction within a few tenths of a dB. Spacings that go by factors of two then add up to any falling
law of the wavenumber, by least squares with positive weights (solid textures of such sums: Perlin,
SIGGRAPH 1985; Lewis, SIGGRAPH 1989).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from struck.core import entry
from struck.model.arrays import Array, Index

CHUNK = 64  # samples between two rows of weights, as in the core
_FACTOR = 2.0  # between the spacings of neighbouring layers
_FINEST_RATIO = 0.4  # spacing of the finest layer, of the shortest wave
_COARSEST_RATIO = 1.5  # spacing of the coarsest one, of the longest wave that matters
_MAX_SHIFT = 1e4  # cells, by which lattices are shifted at most
_MAX_CELL = 2e15  # number of a cell: beyond it positions in a cell are not resolved


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Layers:
    """Spacings and heights of the layers of a random texture, with its seed."""

    spacings: Array  # (O,), m
    heights: Array  # (O,), m: factors of values of variance 1 at the corners
    matrices: Array  # (O, 3, 3): from places to cells
    shifts: Array  # (O, 3)
    seeds: Index  # (O,)

    @classmethod
    def of(cls, spacings: Array, heights: Array, seed: int) -> Layers:
        """Return layers whose orientations, shifts and values follow from the seed."""
        random = np.random.default_rng(seed)
        rotations = Rotation.random(len(spacings), rng=random).as_matrix()
        return cls(
            spacings=spacings,
            heights=heights,
            matrices=np.ascontiguousarray(rotations / spacings[:, None, None]),
            shifts=random.uniform(0, _MAX_SHIFT, (len(spacings), 3)),
            seeds=random.integers(0, 1 << 32, len(spacings)),
        )

    def at(self, places: Array) -> Array:
        """Return the heights (n,) of places (n, 3), m."""
        out = np.zeros(len(places))
        add_heights(self, np.tile(self.heights, (len(places) // CHUNK + 2, 1)), 0, places, out)
        return out


def add_heights(layers: Layers, weights: Array, first: int, places: Array, out: Array) -> None:
    """Add to `out` (n,) the heights of layers at places (n, 3), m, times weights (rows, O).

    Weights go in a straight line from row to row in 64 samples, `first` of which are over.
    """
    compiled_loop = entry("texture_add_heights")
    if compiled_loop is None:
        add_heights_plainly(layers, weights, first, places, out)
        return
    lattices = layers.matrices, layers.shifts, layers.seeds, len(layers.seeds)
    sample_stride, axis_stride = (stride // places.itemsize for stride in places.strides)
    point_arguments = places.ctypes.data, sample_stride, axis_stride, len(places)
    compiled_loop(*lattices, weights, first, *point_arguments, out)


def add_heights_plainly(
    layers: Layers, weights: Array, first: int, places: Array, out: Array
) -> None:
    """Add the heights of layers like `add_heights`, in plain NumPy."""
    rows, offsets = np.divmod(first + np.arange(len(places)), CHUNK)
    fraction = (offsets[:, None] + 1) / CHUNK
    weight = weights[rows] + fraction * (weights[rows + 1] - weights[rows])
    for layer, (matrix, shift) in enumerate(zip(layers.matrices, layers.shifts, strict=True)):
        cells = places @ matrix.T + shift
        corner_cells = np.floor(cells)
        is_representable = np.all(np.abs(corner_cells) < _MAX_CELL, axis=1)
        part = blend(cells[is_representable] - corner_cells[is_representable])
        corners = _corners(
            corner_cells[is_representable].astype(np.int64), int(layers.seeds[layer])
        )
        for axis in (2, 1, 0):
            corners = corners[..., 0] + part[:, axis].reshape(-1, *[1] * axis) * (
                corners[..., 1] - corners[..., 0]
            )
        out[is_representable] += weight[is_representable, layer] * corners


def blend(shares: Array) -> Array:
    """Return the weight of the farther corner at 0 to 1 of the distance to it."""
    return shares**3 * (shares * (shares * 6 - 15) + 10)


def _corners(cells: Index, seed: int) -> Array:
    """Return random heights of variance 1 at the corners of texture cells (n, 2, 2, 2)."""
    numbers = (cells[:, :, None] + np.arange(2)).astype(np.uint32)  # (n, axis, side)
    x = _mixed(np.uint32(seed) + numbers[:, 0])
    x = _mixed(x[:, :, None] + numbers[:, 1, None, :])
    x = _mixed(x[:, :, :, None] + numbers[:, 2, None, None, :])
    return x * (2 * np.sqrt(3) / 2**32) - np.sqrt(3)


def _mixed(x: np.ndarray) -> np.ndarray:
    x = (x ^ (x >> np.uint32(16))) * np.uint32(0x7FEB352D)
    x = (x ^ (x >> np.uint32(15))) * np.uint32(0x846CA68B)
    return x ^ (x >> np.uint32(16))


def spacings_of(shortest: float, longest: float) -> Array:
    """Return the spacings of layers that hold waves between two lengths, m, coarsest first."""
    coarsest_spacing, finest_spacing = _COARSEST_RATIO * longest, _FINEST_RATIO * shortest
    count = max(1, int(np.ceil(np.log(coarsest_spacing / finest_spacing) / np.log(_FACTOR))) + 1)
    return coarsest_spacing * (finest_spacing / coarsest_spacing) ** (
        np.arange(count) / max(1, count - 1)
    )


def fit_layers(
    law: Callable[[Array], Array], shortest: float, longest: float
) -> tuple[Array, Array]:
    """Return spacings and heights (O,), m, of layers whose spectrum follows a law of wavenumbers.

    The law takes cycles/m and gives m^2 per cycle/m, one-sided.
    """
    spacings = spacings_of(shortest, longest)
    waves = np.geomspace(0.02 / longest, 1 / shortest, 300)
    target = law(waves)
    humps = hump(waves[:, None] * spacings) * spacings
    powers, _ = nnls(humps / target[:, None], np.ones(len(waves)))
    return spacings[powers > 0], np.sqrt(powers[powers > 0])


def variance() -> float:
    """Return the mean square of a layer of values of variance 1: that of its blend, cubed."""
    return float(_covariance()[1][0] ** 3)


def hump(waves: Array) -> Array:
    """Return the one-sided spectrum of a layer along a line, waves in cycles per spacing."""
    wavenumbers, spectrum = _hump()
    return np.interp(waves, wavenumbers, spectrum, right=0.0)


@cache
def _hump() -> tuple[Array, Array]:
    lags, covariance = _covariance()
    waves = np.concatenate([[0.0], np.geomspace(1e-2, 3.0, 200)])
    distances = np.linspace(0, 2 * np.sqrt(3), 600)
    random = np.random.default_rng(0).standard_normal((200, 3))
    axes = random / np.linalg.norm(random, axis=1)[:, None]
    parts = np.interp(np.abs(axes[:, :, None] * distances), lags, covariance, right=0.0)
    mean = parts.prod(axis=1).mean(axis=0)
    spectrum = 4 * np.trapezoid(
        np.cos(2 * np.pi * waves[:, None] * distances) * mean, distances, axis=1
    )
    return waves, np.maximum(spectrum, 0.0)


@cache
def _covariance() -> tuple[Array, Array]:
    """Return the mean covariance along one axis at lags from 0 to 2 spacings."""
    steps = 400
    places = np.arange(-steps, steps + 1) / steps
    kernel = 1 - blend(np.abs(places))
    covariance = np.convolve(kernel, kernel)[2 * steps :] / steps
    return np.arange(len(covariance)) / steps, covariance

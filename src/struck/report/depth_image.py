"""Depth image: surfaces seen along one direction, the nearest one at each pixel.

Triangles that are drawn one over the other, farthest first, as `matplotlib` does, hide each other
wrongly where they are of very different sizes: a table's edge lay over what stood on it. Renderers
with a depth buffer (MuJoCo's own, pyrender) need OpenGL, which a machine without a display lacks:
MuJoCo 4.0.0 there ends with "an OpenGL platform library has not been loaded".
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from struck.model.arrays import Array, Index

Numbers = NDArray[np.floating]
_FINER = 2  # pixels drawn along each edge of a pixel of the image, so that edges are smooth
_AT_ONCE = 2_000_000  # pixels of triangles that are drawn together
_OUTLINE = 0.45  # of the brightness that remains at the outline of a body
_SLACK = -1e-9  # of barycentric weights: pixels on an edge belong to both triangles
_BIAS = (
    0.03  # of a pixel drawn, for each body up to 16: of faces in one plane the later one is seen
)
_THINNEST = 1e-6  # square pixels: smaller triangles, and those seen from behind, are not drawn
_NOBODY, GROUND = -2, -1  # owners that have no outline


@dataclass(kw_only=True)
class DepthImage:
    """An image of a rectangle that grows surface by surface.

    Parameters
    ----------
    low : array (2,)
        Lower left corner of the rectangle, m to the right and upward.
    pixel : float
        Edge of a pixel, m.
    width, height : int
        Pixels.
    """

    low: Array
    pixel: float
    width: int
    height: int
    _depth: Numbers = field(init=False, repr=False)
    _colour: Numbers = field(init=False, repr=False)
    _owner: Index = field(init=False, repr=False)

    def __post_init__(self) -> None:
        count = self._columns * self._rows
        self._depth = np.full(count, -np.inf)
        self._colour = np.ones((count, 3))
        self._owner = np.full(count, _NOBODY)

    @property
    def _columns(self) -> int:
        return self.width * _FINER

    @property
    def _rows(self) -> int:
        return self.height * _FINER

    def add_triangles(self, corners: Array, colours: Array, owner: int) -> None:
        """Add the triangles that face the eye.

        Parameters
        ----------
        corners : array (F, 3, 3)
            m to the right, upward and toward the eye, counter-clockwise as seen from outside.
        colours : array (F, 3)
            Red, green and blue, 0 to 1.
        owner : int
            Number of the body, which gets an outline; `GROUND` for none.
        """
        places = corners.copy()
        places[:, :, :2] = (places[:, :, :2] - self.low) * (_FINER / self.pixel) - 0.5
        first, second = places[:, 1] - places[:, 0], places[:, 2] - places[:, 0]
        areas = first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]
        front = np.flatnonzero(areas > _THINNEST)
        places = places[front]
        low = np.maximum(np.ceil(places[:, :, :2].min(axis=1)), 0).astype(np.int64)
        high = np.floor(places[:, :, :2].max(axis=1)).astype(np.int64)
        high = np.minimum(high, [self._columns - 1, self._rows - 1])
        sizes = (high - low).max(axis=1) + 1
        visible = np.flatnonzero((high >= low).all(axis=1))
        classes = np.ceil(np.log2(np.maximum(sizes, 1))).astype(np.int64)
        for power in np.unique(classes[visible]).tolist():
            indices = visible[classes[visible] == power]
            batch_size = max(1, _AT_ONCE >> (2 * power))
            for part in np.split(indices, range(batch_size, len(indices), batch_size)):
                self._fill(places[part], colours[front[part]], low[part], 1 << power, owner)

    def _fill(self, places: Array, colours: Array, low: Index, size: int, owner: int) -> None:
        """Fill triangles (T, 3, 3), in pixels, none larger than `size` from its `low` corner."""
        steps = np.arange(size)
        x = low[:, 0, None, None] + steps[None, None, :]
        y = low[:, 1, None, None] + steps[None, :, None]
        (ax, ay, az), (bx, by, bz), (cx, cy, cz) = places.transpose(1, 2, 0)[..., None, None]
        area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax)
        b = ((x - ax) * (cy - ay) - (y - ay) * (cx - ax)) / area
        c = ((bx - ax) * (y - ay) - (by - ay) * (x - ax)) / area
        is_inside = (b >= _SLACK) & (c >= _SLACK) & (b + c <= 1 - _SLACK)
        is_inside &= (x < self._columns) & (y < self._rows)
        triangle, row, column = np.nonzero(is_inside)
        depth = (az + b * (bz - az) + c * (cz - az))[triangle, row, column]
        depth += _BIAS * self.pixel / _FINER * (max(owner, 0) % 16)
        pixels = (low[triangle, 1] + row) * self._columns + low[triangle, 0] + column
        self._take(pixels, depth, colours[triangle], owner)

    def add_plane(self, origin: Array, axes: Array, tile: float, light: Array, dark: Array) -> None:
        """Add a plane without end, tiled.

        Parameters
        ----------
        origin : array (3,)
            A point of it, as the corners of triangles.
        axes : array (3, 3)
            Rows: two directions along it, and its normal; a plane that faces away is not seen.
        tile : float
            Edge of a tile, m.
        light, dark : array (3,)
            Colours of neighbouring tiles.
        """
        normal = axes[2]
        if normal[2] < 1e-3:
            return
        step = self.pixel / _FINER
        x, y = np.meshgrid(
            self.low[0] + step * (np.arange(self._columns) + 0.5),
            self.low[1] + step * (np.arange(self._rows) + 0.5),
        )
        away = np.stack([x - origin[0], y - origin[1]], axis=-1).reshape(-1, 2)
        height = -(away @ normal[:2]) / normal[2]
        u, v = (away @ axis[:2] + height * axis[2] for axis in axes[:2])
        is_even = (np.floor(u / tile) + np.floor(v / tile)) % 2 == 0
        colours = np.where(is_even[:, None], light, dark)
        self._take(np.arange(len(height)), height + origin[2], colours, GROUND)

    def _take(self, pixels: Index, depth: Array, colours: Array, owner: int) -> None:
        """Colour pixels, some of them several times, where a surface is the nearest."""
        np.maximum.at(self._depth, pixels, depth)
        is_nearest = self._depth[pixels] == depth
        self._colour[pixels[is_nearest]] = colours[is_nearest]
        self._owner[pixels[is_nearest]] = owner

    def image(self) -> Numbers:
        """Return the image (height, width, 3), its first row below."""
        shape = self._rows, self._columns
        colour = self._colour.reshape(*shape, 3).copy()
        owner, depth = self._owner.reshape(shape), self._depth.reshape(shape)
        edge = np.zeros(shape, np.bool_)
        for axis in (0, 1):
            for shift in (-1, 1):
                other, beyond = np.roll(owner, shift, axis), np.roll(depth, shift, axis)
                edge |= (owner != other) & (owner >= 0) & (depth > beyond)
        colour[edge] *= _OUTLINE
        blocks = colour.reshape(self.height, _FINER, self.width, _FINER, 3)
        return blocks.mean(axis=(1, 3))

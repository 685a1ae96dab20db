"""The wine glass of the tests as bricks and wedges around its axis, on its 96 flat sides."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from struck.solids import VolumeMesh
from struck.solids.fem.elements import ELEMENTS
from struck.solids.volume_mesh import unique_rows
from tests.physics.everyday import arc

Array = NDArray[np.float64]
Index = NDArray[np.int64]
AROUND = 96
_BOWL, _FOOT = 1, 6  # cells through the wall of the bowl, and through the foot
_RADII = (4, 5, 6, 7.5, 9, 12, 16, 20, 24, 28, 31, 32)  # mm, lines in the foot
_STEM = (20, 22, 25, 30, 35, 40, 50, 60, 70, 75, 80, 84, 88, 90, 91, 91.6, 92)  # mm, and heights


def wine_glass(size: float) -> list[VolumeMesh]:
    """Return bricks of 20 nodes and wedges of 15 on the same nodes."""
    quads = _profile(1000 * size) / 1000
    points, corners = np.unique(np.round(quads.reshape(-1, 2), 9), axis=0, return_inverse=True)
    corners = corners.reshape(-1, 4)
    angle = 2 * np.pi * np.arange(AROUND) / AROUND
    radius, height = points.T[:, :, None]
    height = np.broadcast_to(height, (len(points), AROUND))
    nodes = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=-1)
    numbers = np.arange(len(points) * AROUND).reshape(len(points), AROUND)
    numbers[points[:, 0] == 0] = numbers[points[:, 0] == 0][:, :1]
    here, ahead = (np.roll(numbers, -step, axis=1)[corners] for step in (0, 1))  # (Q, 4, AROUND)
    inner = (points[corners, 0] == 0).sum(axis=1) == 2
    bricks = np.concatenate([ahead[~inner], here[~inner]], axis=1)
    wedges = np.array(
        [_wedge(here[q], ahead[q], points[corners[q], 0]) for q in np.flatnonzero(inner)]
    )
    cells = [np.moveaxis(part, 1, 2).reshape(-1, part.shape[1]) for part in (bricks, wedges)]
    return _quadratic(nodes.reshape(-1, 3), dict(zip(("hex20", "wedge15"), cells, strict=True)))


def _wedge(here: Index, ahead: Index, radius: Array) -> Index:
    """Return the corners (6, AROUND) of cells with one edge on the axis."""
    first = next(i for i in range(4) if radius[i] == radius[(i + 1) % 4] == 0)
    order = np.roll(np.arange(4), -first)
    (lower, upper, above, beside), turned = here[order], ahead[order]
    return np.stack([lower, turned[3], beside, upper, turned[2], above])


def _quadratic(nodes: Array, cells: dict[str, Index]) -> list[VolumeMesh]:
    """Return meshes with nodes halfway along their edges, which they share."""
    ends = {kind: each[:, np.array(ELEMENTS[kind].edges)] for kind, each in cells.items()}
    every = np.vstack([each.reshape(-1, 2) for each in ends.values()])
    edges, inverse = unique_rows(np.sort(every, axis=1))
    split = np.split(len(nodes) + inverse, [ends["hex20"].size // 2])
    whole = [
        np.hstack([c, m.reshape(len(c), -1)]) for c, m in zip(cells.values(), split, strict=True)
    ]
    nodes = np.vstack([nodes, nodes[edges].mean(axis=1)])
    used, local = np.unique(np.concatenate([each.ravel() for each in whole]), return_inverse=True)
    parts = np.split(local, [whole[0].size])
    return [
        VolumeMesh(nodes=nodes[used], elements=part.reshape(each.shape), kind=kind)
        for part, each, kind in zip(parts, whole, cells, strict=True)
    ]


def _profile(size: float) -> Array:
    """Return quadrilaterals (Q, 4, 2) of radius and height, mm, anticlockwise."""
    outer, inner = arc((0, 130), 35, -85, 5, 28), arc((0, 130), 33.8, -90, 5, 28)
    inner[0, 0] = 0.0
    outside, inside = np.vstack([outer, [[33, 190]]]), np.vstack([inner[1:], [[31.8, 190]]])
    share = np.unique(np.round(np.concatenate([_shares(outside), _shares(inside)]), 6))
    # Closer where the stem begins.
    share = np.union1d(share, subdivided(share, size / 140))
    share = np.union1d(share, subdivided([0, 0.02, 0.05], size / 560))
    bowl = _between(_at(outside, share), _at(inside, share), _BOWL)
    radius = subdivided(_RADII, size)
    top = np.interp(radius, [4, 6, 12, 32], [20, 8, 3, 1.2])
    foot = _between(np.stack([radius, 0 * radius], axis=1), np.stack([radius, top], axis=1), _FOOT)
    foot[-1, :, 0] -= 0.3 * (1 - np.abs(np.linspace(-1, 1, _FOOT + 1)))  # its edge is a diamond
    height = subdivided(_STEM, size)
    stem = np.stack([np.interp(height, [80, 92], [4, 5]), height], axis=1)
    neck = _at(np.array([[5, 92], outer[0]]), np.linspace(0, 1, 6))
    side = np.vstack([foot[0], stem[1:], neck[1:], bowl[0, 1:]])
    middle = np.interp(side[:, 1], [0, 85, inner[1, 1]], [0, 85, inner[0, 1]])
    core = _between(np.stack([0 * middle, middle], axis=1), side, 3)
    return np.vstack([quadrilaterals(grid) for grid in (bowl, foot, _edge(foot[-1]), core)])


def _edge(line: Array) -> Array:
    """Return the grid between the last line of the foot and its sharp edge."""
    half = _FOOT // 2
    share = np.linspace(0, 1, half + 1)[:, None]
    inner = line[half] + share * (line[0] - line[half])
    return _between(inner, line[-1] + share * ([32.6, 0.6] - line[-1]), half)


def _shares(line: Array) -> Array:
    """Return how far along a line its points are, of 1."""
    way = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    return way / way[-1]


def _at(line: Array, share: Array) -> Array:
    return np.stack([np.interp(share, _shares(line), line[:, k]) for k in (0, 1)], axis=1)


def subdivided(planes: ArrayLike, size: float) -> Array:
    """Return planes no further apart than `size`, the given ones among them."""
    given = np.asarray(planes, np.float64)
    counts = np.maximum(1, np.ceil(np.diff(given) / size - 1e-9)).astype(int)
    parts = [
        np.linspace(a, b, n + 1)[1:] for (a, b), n in zip(pairwise(given), counts, strict=True)
    ]
    return np.concatenate([given[:1], *parts])


def _between(first: Array, last: Array, count: int) -> Array:
    """Return a grid (I, J, 2) of straight lines from one line's points to another's."""
    share = np.linspace(0, 1, count + 1)[:, None]
    return (1 - share) * first[:, None] + share * last[:, None]


def quadrilaterals(grid: Array) -> Array:
    """Return the corners of a grid's cells, anticlockwise (Q, 4, 2)."""
    corners = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    cells = np.stack(corners, axis=2).reshape(-1, 4, 2)
    x, y = np.moveaxis(cells, 2, 0)
    area = np.sum(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y, axis=1)
    return np.where(area[:, None, None] > 0, cells, cells[:, ::-1])

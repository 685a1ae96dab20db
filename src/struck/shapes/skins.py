"""Closed surfaces of flat bodies: a plan, its twin below, and the rims between."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.model.mesh import Mesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def slab(points: Array, triangles: Index, thickness: float) -> Mesh:
    """Return the surface of a plate.

    Parameters
    ----------
    points : array (N, 2)
        Of its plan, m.
    triangles : array (T, 3)
        Of the plan, counter-clockwise; open edges become rims.
    thickness : float
        m, half of it above the plan.
    """
    count = len(points)
    heights = np.repeat([thickness / 2, -thickness / 2], count)
    both = np.column_stack([np.vstack([points, points]), heights])
    start, end = rim(triangles).T
    walls = np.vstack(
        [
            np.column_stack([start, start + count, end + count]),
            np.column_stack([start, end + count, end]),
        ]
    )
    return Mesh(points=both, faces=np.vstack([triangles, triangles[:, ::-1] + count, walls]))


def rim(triangles: Index) -> Index:
    """Return the edges (E, 2) that one triangle alone has, in its sense of rotation."""
    edges = triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    _, kinds, counts = np.unique(
        np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    return edges[counts[kinds.ravel()] == 1]


def rectangle(
    length: float, width: float, spacing: float, *, corner: tuple[float, float] = (0.0, 0.0)
) -> tuple[Array, Index]:
    """Return points (N, 2) and triangles (T, 3) of a rectangle from its lower left corner on."""
    x = corner[0] + np.linspace(0, length, _steps(length, spacing) + 1)
    y = corner[1] + np.linspace(0, width, _steps(width, spacing) + 1)
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2)
    numbers = np.arange(len(points)).reshape(len(x), len(y))
    squares = [numbers[:-1, :-1], numbers[1:, :-1], numbers[1:, 1:], numbers[:-1, 1:]]
    first, second, third, fourth = (part.ravel() for part in squares)
    halves = [np.column_stack([first, second, third]), np.column_stack([first, third, fourth])]
    return points, np.vstack(halves)


def _steps(length: float, spacing: float) -> int:
    return max(2, int(np.ceil(length / spacing)))

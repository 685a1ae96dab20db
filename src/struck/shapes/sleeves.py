"""Closed surfaces of round bars: rods and tubes along x."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

from struck.model.mesh import Mesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_AROUND = 24


def sleeve(
    length: float, radius: float, bore: float, spacing: float, *, around: int = _AROUND
) -> Mesh:
    """Return the surface of a rod or tube along x from 0 to `length` m.

    Parameters
    ----------
    length, radius : float
        m.
    bore : float
        Inner radius of a tube, m; 0 makes a rod with flat ends.
    spacing : float
        About how far apart vertices lie along x, m.
    around : int
        Sides of the polygon, one vertex of which points up; it has the area of the circle, so
        that the body keeps its volume.
    """
    x = np.linspace(0, length, max(2, int(np.ceil(length / spacing))) + 1)
    sides = np.arange(len(x) * around).reshape(len(x), around)
    outer, outside = _tube(x, radius, sides)
    if bore:
        inner, inside = _tube(x, bore, sides + sides.size)
        first, last = (_between(sides[k], sides[k] + sides.size) for k in (0, -1))
        ends = [first, last[:, ::-1]]
        return _joined([outer, inner], [outside, inside[:, ::-1], *ends])
    middles = np.array([[0, 0, 0], [length, 0, 0]], dtype=float)
    first, last = (_fan(sides[k], sides.size + number) for number, k in enumerate((0, -1)))
    return _joined([outer, middles], [outside, first, last[:, ::-1]])


def _joined(points: list[Array], faces: list[Index]) -> Mesh:
    return Mesh(points=np.vstack(points), faces=np.vstack(faces))


def _tube(x: Array, radius: float, numbers: Index) -> tuple[Array, Index]:
    """Return points and outward triangles of a cylinder's mantle."""
    around = numbers.shape[1]
    angles = 2 * np.pi * np.arange(around) / around
    reach = radius * np.sqrt(angles[1] / np.sin(angles[1]))
    points = np.empty((len(x), around, 3))
    points[..., 0] = x[:, None]
    points[..., 1] = reach * np.sin(angles)
    points[..., 2] = reach * np.cos(angles)
    rings = [_between(second, first) for first, second in itertools.pairwise(numbers)]
    return points.reshape(-1, 3), np.vstack(rings)


def _between(first: Index, second: Index) -> Index:
    """Return the triangles between two rings of as many vertices."""
    following, across = np.roll(first, -1), np.roll(second, -1)
    halves = [np.column_stack([first, following, across]), np.column_stack([first, across, second])]
    return np.vstack(halves)


def _fan(ring: Index, middle: int) -> Index:
    return np.column_stack([ring, np.roll(ring, -1), np.full(len(ring), middle)])

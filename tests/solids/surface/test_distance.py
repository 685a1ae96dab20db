"""A sheet's wall ends square at its rim, also where the rim turns a corner."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck import Mesh
from struck.solids.surface.distance import WalledSheet
from tests.physics.known import flat_sheet, turned

WALL = 0.1


def corner() -> WalledSheet:
    """Return the square (-1, 1)^2 without its quarter x, y > 0, of few large faces."""
    points = [(-1, -1), (0, -1), (1, -1), (-1, 0), (0, 0), (1, 0), (-1, 1), (0, 1)]
    squares = [(0, 1, 4, 3), (1, 2, 5, 4), (3, 4, 7, 6)]
    faces = [(a, b, c) for a, b, c, _ in squares] + [(a, c, d) for a, _, c, d in squares]
    flat = np.column_stack([np.array(points, float), np.zeros(len(points))])
    return WalledSheet(mesh=Mesh(points=flat, faces=np.array(faces)), wall=WALL)


def scattered(count: int, reach: float) -> NDArray[np.float64]:
    random = np.random.default_rng(5)
    return random.uniform(-1, 1, (count, 3)) * [reach, reach, 0.04]


def test_inside_is_where_the_sheet_is() -> None:
    points = scattered(4000, 1.3)
    x, y, _ = points.T
    inside = (np.abs(points[:, :2]).max(axis=1) < 1) & ~((x > 0) & (y > 0))
    assert np.array_equal(corner().depths(points).max(axis=1) < 0, inside)


def test_points_move_onto_the_rim() -> None:
    points = scattered(500, 1.3)
    moved = corner().onto(2, points)
    x, y, z = moved.T
    outer = np.abs(np.abs(moved[:, :2]).max(axis=1) - 1) < 1e-12
    inner = (np.minimum(np.abs(x), np.abs(y)) < 1e-12) & (np.minimum(x, y) > -1e-12)
    assert np.all(outer | inner)
    assert z == pytest.approx(points[:, 2])


def test_a_turned_square_keeps_its_volume() -> None:
    sheet = WalledSheet(mesh=turned(flat_sheet(1.0)), wall=WALL)
    assert sheet.volume(0.02) == pytest.approx(WALL, rel=3e-3)

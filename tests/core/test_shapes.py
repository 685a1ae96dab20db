"""Mode shapes along pushes, in C and in plain NumPy."""

from __future__ import annotations

import numpy as np

from struck.model.gains import shapes_along, shapes_along_plainly
from tests.core.agreement import EXACT, apart


def test_as_in_plain_numpy() -> None:
    random = np.random.default_rng(1)
    for modes in (1, 7, 130):
        shapes = random.standard_normal((20, 3, modes)).astype(np.float32)
        weights, ways = random.standard_normal((2, 9, 3))
        given = shapes, random.integers(0, 20, (9, 3)), weights, ways
        assert apart(shapes_along(*given), shapes_along_plainly(*given)) < EXACT


def test_by_hand() -> None:
    shapes = np.arange(12, dtype=np.float32).reshape(2, 3, 2)  # row 3 v + axis holds 6 v + 2 axis
    for count in (1, 5):
        corners, weights = np.tile([0, 1, 1], (count, 1)), np.tile([0.5, 0.25, 0.25], (count, 1))
        ways = np.tile([0.0, 2.0, 0.0], (count, 1))
        assert shapes_along(shapes, corners, weights, ways).tolist() == [[10.0, 12.0]] * count

"""Mode shapes along pushes, in C and in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from struck.model.gains import shapes_along, shapes_along_plainly
from tests.core.agreement import EXACT, apart
from tests.core.chance import random_shapes


def test_as_in_plain_numpy() -> None:
    random = np.random.default_rng(1)
    for _ in range(100):
        given = random_shapes(random)
        assert apart(shapes_along(*given), shapes_along_plainly(*given)) < EXACT


@pytest.mark.parametrize("count", [1, 5])
def test_by_hand(count: int) -> None:
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0]])
    shapes = np.arange(18, dtype=np.float32).reshape(3, 3, 2)  # point v, axis: 6 v + 2 axis
    corners, places = np.tile([0, 1, 2], (count, 1)), np.tile([0.25, 1.0, 0.0], (count, 1))
    ways = np.tile([0.0, 2.0, 0.0], (count, 1))  # weights are 1/4, 1/4 and 1/2
    found = shapes_along(points, shapes, corners, places, ways)
    assert found.tolist() == [[19.0, 21.0]] * count

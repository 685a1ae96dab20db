"""Lines that samples follow, in C and in plain NumPy."""

from __future__ import annotations

import numpy as np

from struck.excitation.touch import each_sample, each_sample_plainly
from tests.core.agreement import EXACT, apart
from tests.core.chance import random_lines


def test_as_in_plain_numpy() -> None:
    random = np.random.default_rng(1)
    for _ in range(200):
        drawn = random_lines(random)
        assert apart(each_sample(*drawn), each_sample_plainly(*drawn)) < EXACT


def test_by_hand() -> None:
    begins, lengths = np.array([9, 12, 13]), np.array([2, 4, 1])
    lows, highs = np.array([[1.0], [3.0], [3.5]]), np.array([[3.0], [5.0], [7.0]])
    # Sample n ends at n + 1; what is exactly there belongs to the line before.
    wanted = [[2.0, 3.0, 3.0, 3.5, 7.0, 7.0]]
    drawn = (begins, lengths, lows, highs), 9, 15
    assert each_sample(*drawn).tolist() == each_sample_plainly(*drawn).tolist() == wanted

"""Lines that samples follow, in C and in plain NumPy."""

from __future__ import annotations

import numpy as np
import pytest

from struck.excitation.touch import (
    expect_gaps,
    expect_gaps_plainly,
    join_lines,
    join_lines_plainly,
    numbers_at,
    read_plainly,
    sample_lines,
    smooth_numbers,
)
from tests.core.agreement import EXACT, apart
from tests.core.chance import random_lines


def test_as_in_plain_numpy() -> None:
    random = np.random.default_rng(1)
    for _ in range(200):
        lines, begin, end = random_lines(random)
        wanted = read_plainly(lines, np.arange(begin + 1, end + 1))
        half = lines[2].shape[1] // 2
        assert apart(sample_lines(lines, begin, end, half + 1), wanted[:, : half + 1].T) < EXACT
        moments = np.sort(random.integers(begin, end + 1, 5)) + 1
        expected = read_plainly(lines, moments)[:, half:]
        assert apart(numbers_at(lines, moments, half), expected) < EXACT


def test_joined_as_in_plain_numpy() -> None:
    random = np.random.default_rng(2)
    rests = 0
    for _ in range(200):
        (begins, lengths, lows, highs), *_ = random_lines(random)
        highs[:, 0] = random.integers(0, 2, len(highs))
        lows[0, 0] = random.integers(0, 2)
        found = join_lines(begins, lengths, lows[0], highs)
        plain = join_lines_plainly(begins, lengths, lows.copy(), highs)
        assert np.abs(found - plain).max() < 1e-12
        rests += np.count_nonzero((found[1:, 0] == 0) & (highs[:-1, 0] == 0))
    assert rests > 50


def test_expected_as_in_plain_python() -> None:
    random = np.random.default_rng(3)
    for _ in range(50):
        between = random.integers(0, 1000, 40)
        gaps, interval = expect_gaps(between, 40.0, 960.0, 480.0)
        plain, wanted = expect_gaps_plainly(between, 40.0, 960.0, 480.0)
        assert gaps.tolist() == plain.tolist()
        assert interval == pytest.approx(wanted, rel=1e-14)
    assert expect_gaps(np.array([0, 5000, 480, 80]), 40.0, 960.0, 480.0)[0].tolist() == [
        480
    ] * 3 + [380]


def test_smoothed_as_in_plain_numpy() -> None:
    random = np.random.default_rng(4)
    for count, taps in ((1, 1), (31, 7), (32, 98), (1000, 98)):
        numbers, window = random.standard_normal(count + taps - 1), random.standard_normal(taps)
        plain = np.convolve(numbers, window, "valid")
        assert np.abs(smooth_numbers(numbers, window) - plain).max() < 1e-12


def test_by_hand() -> None:
    begins, lengths = np.array([9, 12, 13]), np.array([2, 4, 1])
    lows, highs = np.array([[1.0], [3.0], [3.5]]), np.array([[3.0], [5.0], [7.0]])
    # Sample n ends at n + 1; what is exactly there belongs to the line before.
    wanted = [[2.0, 3.0, 3.0, 3.5, 7.0, 7.0]]
    drawn = begins, lengths, lows, highs
    assert join_lines(begins, lengths, lows[0], highs).tolist() == lows.tolist()
    assert sample_lines(drawn, 9, 15, 1).tolist() == wanted
    assert numbers_at(drawn, np.arange(10, 16), 0).T.tolist() == wanted
    assert read_plainly(drawn, np.arange(10, 16)).T.tolist() == wanted

"""Delay lines in C as they were when numba compiled them; `tests/ears` compares with NumPy."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.ears.delay_lines import DelayLines, Paths
from struck.errors import OptionError
from tests.core.agreement import SINGLE, apart, golden


def played(parts: tuple[int, ...] = (32,)) -> NDArray[np.float64]:
    """Return what two ears hear of two bodies that move, in parts of blocks of 32."""
    random = np.random.default_rng(1)
    delayed = DelayLines(lines=2, paths=3, block=32, longest=90, taps=13)
    responses = random.standard_normal((9, 3, 13)).astype(np.float32)
    heard = []
    for number in range(16):
        paths = Paths(
            lines=np.array([0, 1, 1]),
            ears=np.array([0, 0, 1]),
            delays=random.uniform(16, 90, (3, 3)),
            gains=random.standard_normal((3, 3)),
            before=responses[number // 2],
            after=responses[number // 2 + 1],
            stretch=64,
        )
        samples, since = random.standard_normal((2, 32)), 32 * (number % 2)
        for part in np.split(samples, np.cumsum(parts)[:-1], axis=1):
            heard.append(delayed.next_block(part, paths, 2, since=since))
            since += part.shape[1]
    return np.concatenate(heard, axis=1)


@pytest.mark.parametrize("parts", [(32,), (5, 27)])
def test_as_before(parts: tuple[int, ...]) -> None:
    assert apart(played(parts), golden("delay_lines")["heard"]) <= SINGLE


def lines_of(delay: float) -> tuple[DelayLines, Paths]:
    """Return a line that is heard by one ear, late by a delay."""
    paths = Paths(
        lines=np.zeros(1, np.int64),
        ears=np.zeros(1, np.int64),
        delays=np.full((1, 3), delay),
        gains=np.ones((1, 3)),
        before=np.ones((1, 1), np.float32),
        after=np.ones((1, 1), np.float32),
        stretch=8,
    )
    return DelayLines(lines=1, paths=1, block=8, longest=20, taps=1), paths


@pytest.mark.parametrize("delay", [np.nan, np.inf, -np.inf, 1e300])
def test_delays_that_are_no_numbers_read_nothing_beyond_a_line(delay: float) -> None:
    lines, paths = lines_of(delay)
    heard = lines.next_block(np.ones((1, 8)), paths, 1)
    assert heard.shape == (1, 8)
    assert np.isfinite(delay) or not np.isfinite(heard).any()


def test_more_samples_than_there_is_room_for_are_refused() -> None:
    lines, paths = lines_of(16)
    with pytest.raises(OptionError, match="9 samples"):
        lines.next_block(np.ones((1, 9)), paths, 1)

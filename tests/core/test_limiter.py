"""The limiter in C, in plain Python, and as it was when numba compiled it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.live import limiter
from tests.core.agreement import EXACT, apart, golden

Array = NDArray[np.float64]


def played(limit: Callable[[Array, Array, bool], None]) -> tuple[Array, Array]:
    """Return loud and spoiled noise limited while the output opens and closes, and the state."""
    random = np.random.default_rng(1)
    state = limiter.limiter(sample_rate=8000, channels=2)
    blocks = []
    for number in range(6):
        samples = random.normal(size=(2, 64)) * 10 ** random.uniform(-2, 2)
        samples[number % 2, number * 10] = (np.nan, np.inf, -np.inf)[number % 3]
        limit(state, samples, number < 4)
        blocks.append(samples)
    return np.concatenate(blocks, axis=1), state


def test_as_before() -> None:
    out, state = played(limiter.limit)
    kept = golden("limiter")
    assert apart(out, kept["out"]) <= EXACT
    assert apart(state, kept["state"]) <= EXACT
    assert state[limiter.REPLACED] == 6


def test_as_in_plain_python() -> None:
    for found, expected in zip(played(limiter.limit), played(limiter.limit_plainly), strict=True):
        assert apart(found, expected) <= EXACT


def test_other_channels_than_those_of_the_state_are_refused() -> None:
    state = limiter.limiter(sample_rate=8000, channels=2)
    with pytest.raises(OptionError, match="3 channels"):
        limiter.limit(state, np.zeros((3, 8)), True)  # noqa: FBT003

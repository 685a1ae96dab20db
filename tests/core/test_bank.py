"""The bank of resonators in C: what numba gave before it, and plain NumPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.core.scenes import SCENES, played
from tests.synth.scenes import reference

GOLDEN = Path(__file__).parent / "golden/bank.npz"


@pytest.mark.parametrize("name", SCENES)
def test_the_bank_is_what_numba_gave(name: str) -> None:
    with np.load(GOLDEN) as file:
        expected = file[str(list(SCENES).index(name))]
    assert np.abs(played(name) - expected).max() < 1e-10 * np.abs(expected).max()


@pytest.mark.parametrize("name", SCENES)
def test_the_bank_is_what_plain_numpy_gives(name: str) -> None:
    expected = played(name, reference)
    assert np.abs(played(name) - expected).max() < 1e-10 * np.abs(expected).max()

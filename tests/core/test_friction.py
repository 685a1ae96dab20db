"""Readings of a surface in C, in plain NumPy, and as they were when numba compiled them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.excitation import scraping_force
from struck.excitation.roughness import Roughness
from struck.excitation.scraping_force import LIGHTEST, Levels, Reader, SlidingContact
from tests.core.agreement import EXACT, apart, golden

Array = NDArray[np.float64]
LEVELS = [(0.0, 0.0), (0.3, 2.6), (1.5, 5.7), (9.0, 4.0)]  # of four tabulated ones


def read(add_reading: Callable[..., None], levels: tuple[float, float]) -> Array:
    """Return random readings of a random surface, begun before 0 and gone on beyond its period."""
    random = np.random.default_rng(1)
    counts = np.array([45, 32, 18, 8])
    values = random.standard_normal(counts.sum()).astype(np.float32)
    table = Levels(values=values, starts=np.cumsum(counts) - counts, counts=counts)
    turns = np.concatenate([[-1e-20, 0.0, 1.0], random.uniform(-1, 3, 61)])
    out = random.standard_normal(64)
    add_reading(table, turns, levels, (0.7, -1.2), out)
    return out


@pytest.mark.parametrize("number", range(len(LEVELS)))
def test_as_before(number: int) -> None:
    found = read(scraping_force.add_reading, LEVELS[number])
    assert apart(found, golden("friction")["out"][number]) <= EXACT


@pytest.mark.parametrize("levels", LEVELS)
def test_as_in_plain_numpy(levels: tuple[float, float]) -> None:
    plain = read(scraping_force.add_reading_plainly, levels)
    assert apart(read(scraping_force.add_reading, levels), plain) <= EXACT


def test_what_is_not_finite_reads_nothing_beyond_the_table() -> None:
    out = np.zeros(4)
    counts = np.array([8])
    table = Levels(values=np.ones(8, np.float32), starts=0 * counts, counts=counts)
    scraping_force.add_reading(
        table, np.array([np.nan, np.inf, -np.inf, 0.5]), (0.0, 0.0), (1, 1), out
    )
    assert np.isnan(out[:3]).all()
    assert out[3] == 1
    scraping_force.add_reading(table, np.zeros(4), (np.nan, np.inf), (1, 1), out)
    assert out[3] == 1


@pytest.mark.parametrize("name", ["sandpaper", "wood", "glass"])
def test_weights_of_layers_as_in_plain_numpy(name: str) -> None:
    random = np.random.default_rng(2)
    rubbed = SlidingContact(roughness=Roughness.named(name), modulus=5e9, radius=2e-3)
    reader = Reader(rubbed, 48_000)
    speeds, loads = 10 ** random.uniform(-4, 3, 300), 10 ** random.uniform(-9, 6, 300)
    speeds[:9], loads[5:20] = 0, 0
    loads[20] = LIGHTEST
    found, plain = reader.weights_at(speeds, loads), reader.weights_plainly(speeds, loads)
    assert np.array_equal(found == 0, plain == 0)
    assert np.abs(found - plain).max() < 1e-12 * plain.max()
    assert np.count_nonzero(plain.any(axis=1)) > 100

"""Rows of a log, parted into blows and loads, whatever the solver made of them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.scene.impact_detection import detect_impacts

Array = NDArray[np.float64]
WEIGHT = 9.81  # N of 1 kg
CHANCE = np.random.default_rng(2)


def blows(impulses: Array, step: float, approach: Array | None = None) -> tuple[int, float, Array]:
    """Return how many blows a log of steps holds, their impulse, and the load at each step."""
    some = np.flatnonzero(impulses)
    coming = None if approach is None else approach[some]
    found = detect_impacts(some * step, np.full(len(some), step), impulses[some], coming)
    load = np.zeros(len(impulses))
    load[some] = found.load
    return found.blows, float(impulses[some] @ (found.fraction * (found.blow >= 0))), load


@pytest.mark.parametrize("step", [0.25e-3, 1e-3, 2e-3, 1 / 60])
@pytest.mark.parametrize("impulse", [0.1, 1.0])
def test_a_body_that_lands_and_stays_is_a_blow_and_a_load(step: float, impulse: float) -> None:
    impulses = np.full(2000, WEIGHT * step)
    impulses[0] += impulse + WEIGHT * step
    count, found, load = blows(impulses, step)
    assert count == (1 if impulse > 3 * WEIGHT * step else 0)
    if count:
        assert found == pytest.approx(impulse, rel=0.03, abs=1.01 * WEIGHT * step)
    np.testing.assert_allclose(load[200:], WEIGHT, rtol=1e-9)


@pytest.mark.parametrize("every", [1, 2, 3])
def test_steps_that_carry_no_load_now_and_then_are_no_blows(every: int) -> None:
    step, impulses = 1e-3, np.zeros(3000)
    impulses[::every] = every * WEIGHT * step
    assert blows(impulses, step)[0] == 0
    impulses[0] += 0.5
    count, found, load = blows(impulses, step, 0.5 * (np.arange(3000) == 0))
    assert count == 1
    assert found == pytest.approx(0.5, rel=0.1)
    assert load.mean() == pytest.approx(WEIGHT / every, rel=0.1)


@pytest.mark.parametrize("sway", [0.0, 0.1])
@pytest.mark.parametrize("speed", [0.5, 0.05])
def test_a_soft_solver_spreads_a_blow_that_stays_one(sway: float, speed: float) -> None:
    step, impulses = 1e-3, WEIGHT * 1e-3 * (1 + sway * CHANCE.standard_normal(2000))
    shape = np.sin(np.pi * (np.arange(12) + 0.5) / 12)
    impulses[500:512] += 1.2 * speed * shape / shape.sum()
    approach = np.zeros(2000)
    approach[500] = speed
    count, found, _ = blows(impulses, step, approach)
    assert count == 1
    assert found == pytest.approx(1.2 * speed, rel=0.03 if not sway else 0.15)


def test_two_hits_within_three_steps_are_one_blow_and_apart_two() -> None:
    for apart, count in ((1, 1), (3, 1), (4, 2), (50, 2)):
        impulses = np.zeros(100)
        impulses[[10, 10 + apart]] = 0.1
        found = blows(impulses, 1e-3)
        assert found[0] == count
        assert found[1] == pytest.approx(0.2)


def test_rows_without_a_step_are_blows_by_themselves() -> None:
    found = detect_impacts(np.array([0.1, 0.1, 0.101]), np.zeros(3), np.ones(3))
    np.testing.assert_array_equal(found.blow, [0, 0, 1])
    assert not found.load.any()

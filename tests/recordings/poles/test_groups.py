"""Which modes are fitted together, and which are dropped."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.model.exponentials import Exponentials
from struck.recordings.noise import Noise
from struck.recordings.poles.refinement import find_groups, overlaps, refine
from struck.recordings.poles.selection import energies, prune, significance, split_pairs
from struck.recordings.segments import Segment
from tests.recordings.scenes import RATE, ringing

Complex = NDArray[np.complex128]


def some_poles(seed: int, count: int) -> Complex:
    chance = np.random.default_rng(seed)
    frequencies = np.exp(chance.uniform(np.log(100), np.log(3000), count))
    return -chance.uniform(0.5, 60, count) + 2j * np.pi * frequencies


def heard(poles: Complex, gains: Complex, noise: float, seed: int = 0) -> Segment:
    sound = ringing(poles.imag / (2 * np.pi), -poles.real, gains, 2 * RATE)
    sound += noise * np.random.default_rng(seed).standard_normal(sound.shape)
    return Segment.of(sound, RATE, Noise.white(np.full(len(gains), noise**2)))


@pytest.mark.parametrize("count", [0, 1, 7, 300])
def test_each_mode_is_in_one_group_of_at_most_40(count: int) -> None:
    groups = find_groups(some_poles(1, count), 2.0)
    assert sorted(np.concatenate([np.zeros(0, int), *groups])) == list(range(count))
    assert all(len(group) <= 40 for group in groups)


def test_overlaps_are_squared_correlations_of_the_waves() -> None:
    poles = some_poles(2, 6).real - 3 + 1j * some_poles(2, 6).imag
    times = np.arange(8 * RATE) / RATE
    waves = np.exp(np.outer(poles, times))
    waves /= np.linalg.norm(waves, axis=1)[:, None]
    assert overlaps(poles, 8.0) == pytest.approx(np.abs(waves.conj() @ waves.T) ** 2, abs=2e-3)


def test_unique_energy_is_what_the_fit_loses_without_the_mode() -> None:
    poles = np.array([-4 + 2j * np.pi * 500, -5 + 2j * np.pi * 501, -6 + 2j * np.pi * 900])
    segment = heard(poles, np.array([[1.0, 0.5, 0.3j]]), 0.05)
    whole = refine(
        [segment], Exponentials(poles=poles, gains=np.zeros((1, 3), complex)), 1, steps=0
    )
    energy, _ = energies([segment], whole)
    for mode in range(3):
        others = whole.of(np.arange(3) != mode)
        without = refine([segment], others, 1, steps=0)
        left = [(segment.residual(each) ** 2).sum() for each in (without, whole)]
        # Half of a real wave's energy is at positive frequencies; eight half widths hold 92 %.
        whole_energy = (left[0] - left[1]) / 2 / 0.05**2
        assert 0.92 * whole_energy < energy[mode] < 1.005 * whole_energy


def test_significance_is_the_chance_of_noise() -> None:
    noise = np.random.default_rng(3).standard_normal((200_000, 4, 2))
    energy = (noise**2).sum(axis=(1, 2)) / 2
    assert np.mean(energy > significance(4, 1e-2)) == pytest.approx(1e-2, rel=0.1)


def test_noise_and_excess_are_pruned_weakest_first() -> None:
    poles = np.array([-4, -5, -6, -7]) + 2j * np.pi * np.array([300, 600, 900, 1200])
    segment = heard(poles[:3], np.array([[1.0, 0.1, 0.3]], complex), 0.05)
    fitted = refine(
        [segment], Exponentials(poles=poles, gains=np.zeros((1, 4), complex)), 1, steps=0
    )
    assert np.array_equal(prune([segment], fitted).poles, poles[:3])
    assert np.array_equal(prune([segment], fitted, budget=2).poles, poles[[0, 2]])


def test_two_modes_that_passed_for_one_are_split_and_one_is_not() -> None:
    two = np.array([-2 + 2j * np.pi * 1000, -2.2 + 2j * np.pi * 1000.4])
    for poles, expected in ((two, 2), (two[:1], 1)):
        segment = heard(poles, np.ones((1, len(poles)), complex), 0.01)
        start = Exponentials(poles=two[:1], gains=np.zeros((1, 1), complex))
        found = split_pairs([segment], refine([segment], start, 6, steps=4))
        assert found.count == expected
        assert np.sort(found.frequencies) == pytest.approx(poles.imag / (2 * np.pi), abs=0.02)

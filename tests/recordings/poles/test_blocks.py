"""Groups against their bins: exact where nothing is unknown, and at least squares elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import least_squares
from scipy.sparse.csgraph import connected_components

from struck.model.exponentials import Exponentials
from struck.recordings.noise import Noise
from struck.recordings.poles.refinement import blocks_around, label_groups, refine_attempt
from struck.recordings.segments import Segment
from tests.recordings.scenes import RATE, ringing

Complex = NDArray[np.complex128]

POLES = np.array([-3, -4, -90, -0.5, -20]) + 2j * np.pi * np.array([200, 201, 205, 1500, 17000])
GROUP = np.array([0, 1, 2])


def sound(gains: Complex, seconds: float, noise: float = 0.0) -> NDArray[np.float64]:
    clean = ringing(POLES.imag / (2 * np.pi), -POLES.real, gains, round(seconds * RATE))
    return clean + noise * np.random.default_rng(1).standard_normal(clean.shape)


def some_gains(channels: int) -> Complex:
    chance = np.random.default_rng(channels)
    shape = (channels, len(POLES))
    return chance.standard_normal(shape) + 1j * chance.standard_normal(shape)


def two_segments() -> tuple[list[Segment], Exponentials]:
    """Return one channel of 1 s and three of 0.7 s, without noise, and what rings in them."""
    gains = some_gains(4)
    samples = sound(gains[:1], 1.0), sound(gains[1:], 0.7)
    noises = Noise.white([1e-4]), Noise.white([1e-4, 4e-4, 1e-4])
    rows = 0, 1
    segments = [Segment.of(s, RATE, n, r) for s, n, r in zip(samples, noises, rows, strict=True)]
    return segments, Exponentials(poles=POLES, gains=gains)


def test_known_modes_leave_nothing_and_have_their_gains() -> None:
    segments, truth = two_segments()
    blocks = blocks_around(segments, POLES, [GROUP])
    found = refine_attempt(blocks, truth, POLES[GROUP], 0)
    assert found.gains == pytest.approx(truth.gains[:, GROUP], rel=1e-6)
    without = refine_attempt(blocks, truth, POLES[GROUP[1:]], 0)
    assert found.cost < 1e-9 * without.cost


def test_poles_of_a_group_are_found_from_all_segments() -> None:
    segments, truth = two_segments()
    blocks = blocks_around(segments, POLES, [GROUP])
    off = np.array([0.3 - 0.8j, -0.5 + 0.5j, 10 - 9j])
    found = refine_attempt(blocks, truth, POLES[GROUP] + off, 40)
    assert found.poles == pytest.approx(POLES[GROUP], rel=1e-7)
    assert found.gains == pytest.approx(truth.gains[:, GROUP], rel=1e-3)
    assert found.misfit == 1


def test_poles_of_a_noisy_group_are_those_of_least_squares() -> None:
    """The reference transforms waves by NumPy and takes its steps by finite differences."""
    gains, two = some_gains(1), GROUP[:2]
    samples = sound(gains, 1.0, noise=0.02)
    segment = Segment.of(samples, RATE, Noise.white([4e-4]))
    blocks = blocks_around([segment], POLES, [two])
    length = round(float(blocks.lengths[0]) * RATE)
    bins = np.round(-np.angle(blocks.turns) * length / (2 * np.pi)).astype(int)
    times = np.arange(length) / RATE
    rest = gains.copy()
    rest[:, two] = 0
    alone = samples[0] - sound(rest, 1.0)[0]
    conjugate = np.fft.fft(np.exp(np.outer(POLES[two].conj(), times)))[:, bins]
    data = np.fft.fft(alone[:length])[bins] - (gains[0, two] / 2j).conj() @ conjugate

    def left(parts: NDArray[np.float64]) -> NDArray[np.float64]:
        waves = np.exp(np.outer(parts[:2] + 1j * parts[2:], times))
        lines = np.fft.fft(waves)[:, bins].T
        unexplained = data - lines @ np.linalg.lstsq(lines, data, rcond=None)[0]
        return np.concatenate((unexplained.real, unexplained.imag))

    start = np.concatenate((POLES[two].real, POLES[two].imag))
    best = least_squares(left, start, x_scale=[1, 1, 1, 1], xtol=1e-12, ftol=1e-12).x
    found = refine_attempt(blocks, Exponentials(poles=POLES, gains=gains), POLES[two], 40)
    assert found.poles == pytest.approx(best[:2] + 1j * best[2:], abs=2e-3)


def test_bins_are_those_within_reach_of_any_mode() -> None:
    segments, _ = two_segments()
    groups = [GROUP, np.array([3]), np.array([4])]
    blocks = blocks_around(segments, POLES, groups)
    for number, group in zip(blocks.numbers[:, 0], groups, strict=True):
        length = round(float(blocks.lengths[number]) * RATE)
        turns = blocks.turns[blocks.firsts[number] : blocks.firsts[number + 1]]
        seen = np.round(-np.angle(turns) * length / (2 * np.pi)).astype(int)
        apart = np.abs(np.arange(length // 2) * RATE / length - POLES[group, None].imag / 2 / np.pi)
        reach = np.maximum(16 * RATE / length, -8 * POLES[group, None].real / 2 / np.pi)
        near = np.flatnonzero((apart <= reach).any(axis=0))
        assert np.array_equal(seen, near[near > 0])


def test_equal_poles_do_no_harm() -> None:
    segments, truth = two_segments()
    blocks = blocks_around(segments, POLES, [GROUP])
    found = refine_attempt(blocks, truth, POLES[[0, 0, 1, 2]], 3)
    assert np.isfinite(found.poles).all()
    assert np.isfinite(found.gains).all()


@pytest.mark.parametrize("threshold", [0.01, 0.1, 0.5])
def test_coupled_modes_are_connected_components(threshold: float) -> None:
    halves = np.random.default_rng(2).random((60, 60)) ** 40
    coupling = np.maximum(halves, halves.T)
    count, labels = connected_components(coupling > threshold, directed=False)
    ours = label_groups(coupling, threshold, 60)
    assert len(set(zip(labels, ours, strict=True))) == count == ours.max() + 1

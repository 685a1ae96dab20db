"""Densities of noise whose level is known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.recordings.noise import Noise

RATE = 44100

Array = NDArray[np.float64]


def white(seconds: float, rms: float, seed: int = 0) -> Array:
    return rms * np.random.default_rng(seed).standard_normal((1, round(seconds * RATE)))


@pytest.mark.parametrize("seconds", [0.1, 0.5, 20.0])
def test_white_noise_has_its_variance_everywhere(seconds: float) -> None:
    noise = Noise.heard_in(white(seconds, 0.3), RATE)
    density = noise.at(np.linspace(200, 20000, 50))[0]
    assert abs(np.mean(density) / 0.09 - 1) < 0.1
    assert noise.energy(1000)[0] == pytest.approx(90, rel=0.1)


def test_a_tone_stays_a_line() -> None:
    times = np.arange(RATE // 2) / RATE
    noise = Noise.heard_in(white(0.5, 0.01) + 0.1 * np.sin(2 * np.pi * 1000 * times), RATE)
    there, beside = noise.at([1000.0, 1500.0])[0]
    assert there > 1000 * beside
    assert beside == pytest.approx(1e-4, rel=0.3)


def test_the_quietest_moment_tells_the_noise_of_a_take_without_lead_in() -> None:
    times = np.arange(2 * RATE) / RATE
    rung = np.sin(2 * np.pi * 700 * times) * np.exp(-6 * times)
    noise = Noise.quietest(white(2.0, 1e-3) + rung, RATE)
    assert np.median(noise.densities) == pytest.approx(1e-6, rel=0.35)


def test_digital_silence_has_the_floor_that_is_asked_for() -> None:
    assert Noise.heard_in(np.zeros((2, RATE)), RATE, 1e-10).densities == pytest.approx(1e-10)


def test_what_a_fit_left_raises_the_noise_where_it_is_more() -> None:
    times = np.arange(RATE) / RATE
    left = white(1.0, 0.01) + 0.1 * np.sin(2 * np.pi * 3000 * times)
    raised = Noise.white([1e-6]).raised(left, RATE)
    assert raised.at(10000.0)[0] == pytest.approx(1e-4, rel=0.3)
    # 0.01 RATE / 4 of energy a sample of the transform, spread over 100 Hz.
    assert raised.at(3000.0)[0] == pytest.approx(0.01 * RATE / 4 / 100, rel=0.1)
    assert Noise.white([1.0]).raised(left, RATE).at(10000.0)[0] == 1.0

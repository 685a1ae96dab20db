"""Closed forms against numerical quadrature, direct exponentials and Parseval's theorem."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import fixed_quad

from struck.synth.ring_down import Pulse, below_nyquist, pushed, released, ring_down

RATE = 48000


def convolved(pole: complex, time: float, duration: float) -> complex:
    """Integrate the half-sine force against exp(s (t - u)) by Gauss-Legendre quadrature."""
    width = np.pi / duration

    def integrand(moments: np.ndarray) -> np.ndarray:
        return width / 2 * np.sin(width * moments) * np.exp(pole * (time - moments))

    return fixed_quad(integrand, 0, min(time, duration), n=150)[0]


POLES = {
    "far below": -3 + 2j * np.pi * 20,
    "in resonance": 1j * np.pi / 1e-3,
    "a hair from resonance": -1e-7 + 1j * np.pi / 1e-3 * (1 + 1e-9),
    "near resonance": -2 + 1j * np.pi / 1e-3 * (1 + 1e-4),
    "at the first null": 3j * np.pi / 1e-3,
    "far above": -50 + 2j * np.pi * 9000,
    "heavily damped": -5000 + 2j * np.pi * 700,
    "not oscillating": -30 + 0j,
    "still": 0j,
}


@pytest.mark.parametrize("pole", POLES.values(), ids=POLES)
@pytest.mark.parametrize("fraction", [1e-3, 0.2, 0.5, 0.9, 1.0])
def test_push_is_the_convolution_integral(pole: complex, fraction: float) -> None:
    time = fraction * 1e-3
    expected = convolved(pole, time, 1e-3)
    largest = max(abs(convolved(pole, part * 1e-3, 1e-3)) for part in (0.25, 0.5, 0.75, 1.0))
    found = pushed(np.array([pole]), time, 1e-3)[0]
    assert abs(found - expected) <= 1e-12 * largest


def modes(count: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    random = np.random.default_rng(seed)
    frequencies = np.exp(random.uniform(np.log(30), np.log(20000), count))
    decays = np.exp(random.uniform(np.log(0.5), np.log(200), count))
    return frequencies, decays, random.normal(size=count) + 1j * random.normal(size=count)


def test_half_sine_from_the_first_sample_with_an_onset_between_samples() -> None:
    frequencies, decays, gains = modes(4)
    pulse = Pulse(gains=gains, onset=5.37 / RATE, duration=20.2 / RATE)
    found = ring_down(frequencies, decays, [pulse], sample_rate=RATE, length=60)
    poles = -decays + 2j * np.pi * frequencies
    expected = np.zeros(60)
    for sample in range(6, 60):
        time = sample / RATE - pulse.onset
        answers = np.array([convolved(pole, time, pulse.duration) for pole in poles])
        phase = np.pi * time / pulse.duration
        force = np.pi / (2 * pulse.duration) * np.sin(phase) * (phase < np.pi)
        expected[sample] = (gains @ (answers + force / poles)).imag
    assert not found[:6].any()
    assert found[6] != 0
    np.testing.assert_allclose(found, expected, atol=1e-11 * np.abs(expected).max(), rtol=0)


def test_a_body_that_merely_follows_a_slow_push_is_silent() -> None:
    """Its inertia, not its bending, is heard: (push frequency / mode's)^2 of the static bending."""
    frequency, duration = 1000.0, 0.1
    pulse = Pulse(gains=np.array([1.0 + 0j]), onset=0.0, duration=duration)
    found = ring_down(
        np.array([frequency]), np.array([2000.0]), [pulse], sample_rate=RATE, length=4000
    )
    bending = np.pi / (2 * duration) / (2 * np.pi * frequency)
    assert np.abs(found[500:]).max() < 0.01 * bending


@pytest.mark.parametrize("length", [6011, pytest.param(30011, marks=pytest.mark.prove)])
def test_ideal_impulses_ring_as_direct_exponentials(length: int) -> None:
    frequencies, decays, gains = modes(1500)  # more than one group of modes
    pulse = Pulse(gains=gains, onset=0.25 / RATE, duration=0.0)
    found = ring_down(frequencies, decays, [pulse], sample_rate=RATE, length=length)
    expected = np.zeros(length)
    for frequency, decay, gain in zip(frequencies, decays, gains, strict=True):
        times = np.arange(1, length) / RATE - pulse.onset
        expected[1:] += (gain * np.exp((2j * np.pi * frequency - decay) * times)).imag
    np.testing.assert_allclose(found, expected, atol=1e-10 * np.abs(expected).max(), rtol=0)


def test_a_positive_gain_is_a_sine_and_a_complex_one_starts_on_the_very_sample() -> None:
    pulse = Pulse(gains=np.array([2.0 + 0j]), onset=0.4, duration=0.0)  # 0.4 * 48000 rounds up
    sine = ring_down(np.array([1000.0]), np.array([3.0]), [pulse], sample_rate=RATE, length=24000)
    times = np.arange(24000) / RATE - 0.4
    expected = np.where(times > 0, 2 * np.exp(-3 * times) * np.sin(2000 * np.pi * times), 0)
    np.testing.assert_allclose(sine, expected, atol=1e-10)
    jump = Pulse(gains=np.array([1j]), onset=0.4, duration=0.0)
    cosine = ring_down(np.array([1000.0]), np.array([3.0]), [jump], sample_rate=RATE, length=24000)
    assert not cosine[:19200].any()
    assert cosine[19200] == pytest.approx(1.0, abs=1e-9)


def test_many_pulses_superpose() -> None:
    frequencies, decays, _ = modes(40)
    random = np.random.default_rng(5)
    pulses = [
        Pulse(gains=random.normal(size=40) + 0j, onset=onset, duration=duration)
        for onset, duration in zip(
            random.uniform(0, 0.2, 30), random.choice([0, 1e-4, 5e-3], 30), strict=True
        )
    ]
    together = ring_down(frequencies, decays, pulses, sample_rate=RATE, length=9600)
    apart = sum(
        ring_down(frequencies, decays, [pulse], sample_rate=RATE, length=9600) for pulse in pulses
    )
    np.testing.assert_allclose(together, apart, atol=1e-12 * np.abs(apart).max(), rtol=0)


def test_a_short_push_tends_to_the_ideal_impulse() -> None:
    frequencies, decays, gains = modes(50)
    ideal, short = (
        ring_down(
            frequencies,
            decays,
            [Pulse(gains=gains, onset=1.5 / RATE - duration / 2, duration=duration)],
            sample_rate=RATE,
            length=2000,
        )
        for duration in (0.0, 1e-9)
    )
    np.testing.assert_allclose(short, ideal, atol=1e-9 * np.abs(ideal).max(), rtol=0)


def test_pulses_after_the_end_and_no_modes_give_silence() -> None:
    pulse = Pulse(gains=np.ones(1, complex), onset=2.0, duration=1e-3)
    one = np.array([440.0])
    assert not ring_down(one, one, [pulse], sample_rate=RATE, length=100).any()
    none = Pulse(gains=np.ones(0, complex), onset=0.0, duration=1e-3)
    empty = np.zeros(0)
    assert not ring_down(empty, empty, [none], sample_rate=RATE, length=100).any()


def test_a_push_longer_than_the_sound_is_cut_with_it() -> None:
    pulse = Pulse(gains=np.ones(1, complex), onset=0.0, duration=1.0)
    arguments = {"frequencies": np.array([3.0]), "decays": np.array([1.0]), "pulses": [pulse]}
    short = ring_down(**arguments, sample_rate=1000, length=100)
    long = ring_down(**arguments, sample_rate=1000, length=2000)
    np.testing.assert_allclose(short, long[:100], rtol=1e-12)


def test_energy_of_the_half_sine_obeys_parseval() -> None:
    # integral of F^2 dt = J^2 pi^2 / (8 T); |c(T)| of undamped poles is |F's transform|.
    duration = 2e-3
    frequencies = np.arange(-200000, 200001) * 2.0
    spectrum = np.abs(released(2j * np.pi * frequencies, duration))
    assert spectrum[200000] == pytest.approx(1.0, abs=1e-12)
    assert np.square(spectrum).sum() * 2.0 == pytest.approx(np.pi**2 / (8 * duration), rel=1e-6)


def test_modes_at_half_the_sample_rate_are_not_carried() -> None:
    assert below_nyquist(np.array([100.0, 23999.9, 24000.0, 30000.0]), 48000).tolist() == [
        True,
        True,
        False,
        False,
    ]

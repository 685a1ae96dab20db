"""Pulses against quadrature, closed forms and their own analytic transforms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

from struck.errors import OptionError
from struck.excitation.pulses import LEAD, low_pass_spectrum, sampled
from tests.excitation.pulse_laws import SHAPES, force, transform
from tests.yardstick import transforms

RATE = 48000.0
DURATIONS = (0.0, 1e-4, 2.3e-4, 5e-4, 1e-3, 2e-3, 5e-3, 8e-3)
ONSETS = (0.0, 0.25 / RATE, 0.0123456, 0.9999 / RATE, -0.37 / RATE)
FREQUENCIES = np.linspace(0, 16000, 161)


def spectrum_of_samples(first: int, values: np.ndarray, frequencies: np.ndarray) -> np.ndarray:
    times = (first + np.arange(len(values))) / RATE
    return np.exp(-2j * np.pi * np.outer(frequencies, times)) @ values / RATE


@pytest.mark.parametrize("shape", SHAPES)
def test_transform_is_the_integral_of_the_force(shape: str) -> None:
    duration = 2e-3
    for frequency in (0.0, 31.0, 250.0, 333.3, 500.0, 1000.0, 4321.0):

        def real(t: float, f: float = frequency) -> float:
            return float(force(shape, t, duration) * np.cos(2 * np.pi * f * t))

        def imaginary(t: float, f: float = frequency) -> float:
            return float(-force(shape, t, duration) * np.sin(2 * np.pi * f * t))

        expected = complex(
            quad(real, 0, duration, limit=400)[0], quad(imaginary, 0, duration, limit=400)[0]
        )
        got = complex(transform(shape, np.array([frequency]), duration)[0])
        assert got == pytest.approx(expected, abs=1e-7)


def test_half_sine_has_the_textbook_spectrum() -> None:
    cycles = np.array([0.1, 0.7, 1.9, 2.3, 40.2])  # |cos(pi f T) / (1 - (2 f T)^2)|
    expected = np.abs(np.cos(np.pi * cycles) / (1 - 4 * cycles**2))
    assert np.abs(transform("half-sine", cycles, 1.0)) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("duration", DURATIONS)
def test_samples_carry_the_analytic_transform(shape: str, duration: float) -> None:
    expected = transform(shape, FREQUENCIES, duration)
    for onset in ONSETS:
        pulse = sampled(shape, impulse=0.02, onset=onset, duration=duration, sample_rate=RATE)
        got = spectrum_of_samples(pulse.first, pulse.force, FREQUENCIES) / 0.02
        error = np.abs(np.abs(got) - np.abs(expected))
        a_tenth_of_a_decibel = (10 ** (0.1 / 20) - 1) * np.abs(expected)
        assert np.all(error <= np.maximum(a_tenth_of_a_decibel, 1e-3))
        delayed = expected * np.exp(-2j * np.pi * FREQUENCIES * onset)
        assert np.abs(got - delayed).max() < 1e-3


@pytest.mark.parametrize("duration", DURATIONS)
def test_impulse_and_lead_are_as_said(duration: float) -> None:
    pulse = sampled("hertz", impulse=0.3, onset=0.01, duration=duration, sample_rate=RATE)
    assert pulse.force.sum() / RATE == pytest.approx(0.3, rel=1e-4)
    assert pulse.first == 480 - LEAD
    assert len(pulse.force) <= duration * RATE + 2 * LEAD + 2


def test_what_folds_below_a_third_of_the_rate_is_60_db_down() -> None:
    response = 20 * np.log10(np.abs(low_pass_spectrum(3072)) + 1e-12)
    assert np.abs(response[:1025]).max() < 0.1
    assert response[2048:].max() < -60


def test_a_pulse_takes_little_time() -> None:
    """Usually 0.07 transforms."""
    options = {"impulse": 1.0, "onset": 0.0101, "duration": 8e-3, "sample_rate": RATE}
    assert transforms(lambda: sampled("hertz", **options), turns=20) < 0.7


def test_unknown_shapes_are_refused() -> None:
    with pytest.raises(OptionError, match="shape is 'square': give one of half-sine, hertz"):
        sampled("square", impulse=1.0, onset=0.0, duration=1e-3, sample_rate=RATE)

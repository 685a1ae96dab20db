"""Sums of exponentials and their spectra, against NumPy sample by sample."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.model.exponentials import (
    Exponentials,
    best_gains,
    correlations,
    row_width,
    samples,
    samples_in_rows,
)
from struck.recordings.noise import blackman_harris, frames

RATE = 44100.0
LENGTHS = (1000, 4099)

Complex = NDArray[np.complex128]


def some_modes(seed: int, channels: int = 2) -> Exponentials:
    chance = np.random.default_rng(seed)
    decays, frequencies = chance.uniform(1, 300, 7), chance.uniform(40, 20000, 7)
    gains = chance.standard_normal((channels, 7)) + 1j * chance.standard_normal((channels, 7))
    return Exponentials(poles=-decays + 2j * np.pi * frequencies, gains=gains)


def directly(ringing: Exponentials, length: int) -> NDArray[np.float64]:
    times = np.arange(length) / RATE
    return np.imag(ringing.gains @ np.exp(np.outer(ringing.poles, times)))


@pytest.mark.parametrize("length", LENGTHS)
def test_samples_are_the_sum_of_the_modes(length: int) -> None:
    ringing = some_modes(1)
    made = samples(ringing.poles, ringing.gains, length, RATE)
    assert np.allclose(made, directly(ringing, length), rtol=0, atol=1e-11)


@pytest.mark.parametrize("length", LENGTHS)
def test_correlations_are_inner_products_with_the_exponentials(length: int) -> None:
    ringing = some_modes(2)
    noise = np.random.default_rng(3).standard_normal((2, length))
    waves = np.exp(np.outer(ringing.poles, np.arange(length) / RATE))
    assert np.allclose(correlations(ringing.poles, noise, RATE), noise @ waves.conj().T)


def test_rows_are_every_so_many_of_the_samples() -> None:
    ringing, length = some_modes(5), 4099
    rows = samples_in_rows(ringing.poles, ringing.gains, length, RATE, every=3)
    width = row_width(length)
    whole = directly(ringing, length // width * width).reshape(2, -1, width)[:, ::3]
    assert np.allclose(rows[:, : whole.shape[1]], whole, rtol=0, atol=1e-11)


def test_best_gains_are_those_of_least_squares() -> None:
    ringing = some_modes(6)
    noisy = directly(ringing, 3000) + np.random.default_rng(7).standard_normal((2, 3000))
    waves = np.exp(np.outer(ringing.poles, np.arange(3000) / RATE))
    basis = np.vstack((waves.imag, waves.real))
    solved = np.linalg.lstsq(basis.T, noisy.T, rcond=None)[0].T
    assert np.allclose(
        best_gains(ringing.poles, noisy, RATE), solved[:, :7] + 1j * solved[:, 7:], atol=1e-7
    )


def test_gains_of_slow_neighbours_are_those_of_least_squares() -> None:
    poles = np.array([-0.02 + 2j * np.pi * 400, -0.03 + 2j * np.pi * 400.8])
    ringing = Exponentials(poles=poles, gains=np.array([[1.0 + 2j, -0.5j]]))
    found = best_gains(poles, directly(ringing, 44100), RATE)
    assert found == pytest.approx(ringing.gains, abs=1e-6)


def test_a_mode_at_0_hz_takes_nothing_of_the_others() -> None:
    """Its sine is no sound at all: no gain of it is better than another."""
    ringing = some_modes(4)
    poles = np.append(ringing.poles, -0.04 + 0j)
    found = best_gains(poles, directly(ringing, 20000), RATE)
    assert np.isfinite(found).all()
    assert np.allclose(found[:, :7], ringing.gains, atol=1e-4)


def test_a_mode_is_an_exponential_from_frame_to_frame() -> None:
    pole = -40 + 2j * np.pi * 1234.5
    one = Exponentials(poles=np.array([pole]), gains=np.array([[1.0 + 0j]]))
    seen = frames(directly(one, 8192), blackman_harris(1024), 128)[0]
    nearest = round(1234.5 * 1024 / RATE)
    turn = np.exp((pole - 2j * np.pi * nearest * RATE / 1024) * 128 / RATE)
    assert np.allclose(seen[1:, nearest] / seen[:-1, nearest], turn, rtol=2e-3)
    assert np.argmax(np.abs(seen[0])) == nearest

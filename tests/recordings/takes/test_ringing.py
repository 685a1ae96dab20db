"""Sums of exponentials and their spectra, against NumPy sample by sample."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.recordings.takes.frames import blackman_harris, frames
from struck.recordings.takes.ringing import Ringing, Spectrum, best_gains, correlations, samples

RATE = 44100.0
LENGTHS = (1000, 4099)

Complex = NDArray[np.complex128]


def some_modes(seed: int, channels: int = 2) -> Ringing:
    chance = np.random.default_rng(seed)
    decays, frequencies = chance.uniform(1, 300, 7), chance.uniform(40, 20000, 7)
    gains = chance.standard_normal((channels, 7)) + 1j * chance.standard_normal((channels, 7))
    return Ringing(poles=-decays + 2j * np.pi * frequencies, gains=gains)


def directly(ringing: Ringing, length: int) -> NDArray[np.float64]:
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


@pytest.mark.parametrize("length", LENGTHS)
def test_a_spectrum_is_the_transform_of_its_modes(length: int) -> None:
    ringing = some_modes(4)
    spectrum = Spectrum.of(directly(ringing, length), length, RATE)
    bins = np.arange(1, length // 2)
    modelled = spectrum.at(bins, ringing, ringing.gains)
    assert np.allclose(modelled, spectrum.values[bins], rtol=0, atol=1e-9 * length)


def test_residues_and_gains_are_each_others_inverse() -> None:
    ringing = some_modes(5)
    spectrum = Spectrum.of(directly(ringing, 2048), 2048, RATE)
    residues = spectrum.residues(ringing.poles, ringing.gains)
    assert np.allclose(spectrum.gains(ringing.poles, residues), ringing.gains)


def test_best_gains_are_those_of_least_squares() -> None:
    ringing = some_modes(6)
    noisy = directly(ringing, 3000) + np.random.default_rng(7).standard_normal((2, 3000))
    waves = np.exp(np.outer(ringing.poles, np.arange(3000) / RATE))
    basis = np.vstack((waves.imag, waves.real))
    solved = np.linalg.lstsq(basis.T, noisy.T, rcond=None)[0].T
    assert np.allclose(
        best_gains(ringing.poles, noisy, RATE), solved[:, :7] + 1j * solved[:, 7:], atol=1e-7
    )


def test_a_mode_is_an_exponential_from_frame_to_frame() -> None:
    pole = -40 + 2j * np.pi * 1234.5
    one = Ringing(poles=np.array([pole]), gains=np.array([[1.0 + 0j]]))
    seen = frames(directly(one, 8192), blackman_harris(1024), 128)[0]
    nearest = round(1234.5 * 1024 / RATE)
    turn = np.exp((pole - 2j * np.pi * nearest * RATE / 1024) * 128 / RATE)
    assert np.allclose(seen[1:, nearest] / seen[:-1, nearest], turn, rtol=2e-3)
    assert np.argmax(np.abs(seen[0])) == nearest

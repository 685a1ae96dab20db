"""Standard errors, against the Cramer-Rao bound computed otherwise and against true errors."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, sosfilt

from struck.model.exponentials import Exponentials
from struck.recordings.noise import Noise
from struck.recordings.poles.refinement import refine, with_best_gains
from struck.recordings.poles.search import fit_poles
from struck.recordings.poles.uncertainty import between_takes, standard_errors
from struck.recordings.segments import Segment
from struck.recordings.takes import Take
from tests.recordings.bounds import bounds
from tests.recordings.scenes import LEAD, RATE, Scene, Truth, pairs, recorded, ringing
from tests.samples import sampled


def segment_of(take: Scene) -> Segment:
    return Segment.of(take.samples[:, LEAD:], RATE, Noise.white(take.truth.noise**2))


def true_modes(truth: Truth) -> Exponentials:
    return Exponentials(poles=truth.poles, gains=truth.gains)


def test_the_bound_itself_is_that_of_one_decaying_sine() -> None:
    # The integrals of t^k exp(-2 d t) leave 1 / 8 d^3 of t^2 once the gain is eliminated, and a
    # sine has half the energy: var(2 pi f) = var(d) = 16 noise^2 d^3 / (amplitude^2 rate).
    alone = Truth(
        frequencies=np.array([1000.0]),
        decays=np.array([20.0]),
        gains=np.array([[1.0 + 0j]]),
        noise=np.array([0.01]),
    )
    expected = np.sqrt(16 * 0.01**2 * 20**3 / RATE)
    frequency, decay = bounds(alone)
    assert decay[0] == pytest.approx(expected, rel=2e-3)
    assert frequency[0] == pytest.approx(expected / (2 * np.pi), rel=2e-3)


@pytest.mark.parametrize("channels", [1, 3])
def test_standard_errors_are_the_cramer_rao_bound(channels: int) -> None:
    chance = np.random.default_rng(4)
    frequencies = np.array([300.0, 301.5, 800.0, 2000.0, 2004.0, 9000.0])
    decays = np.array([2.0, 2.5, 4.0, 9.0, 12.0, 60.0])
    gains = chance.uniform(0.3, 1, (channels, 6)) * np.exp(
        2j * np.pi * chance.random((channels, 6))
    )
    take = recorded(frequencies, decays, gains, 30, chance)
    fitted = standard_errors([segment_of(take)], true_modes(take.truth))
    for ours, bound in zip((fitted.frequencies, fitted.decays), bounds(take.truth), strict=True):
        assert ours == pytest.approx(bound, rel=0.1)


@pytest.mark.parametrize("spread", sampled([0.0, 0.02], 0.02))
def test_takes_differ_by_as_much_as_their_poles_do(spread: float) -> None:
    chance, count = np.random.default_rng(6), 24
    frequencies, decays = np.array([300.0, 800, 2000, 9000]), np.array([2.0, 4, 9, 60])
    away = spread * decays * chance.standard_normal((2, count, 4))  # a share of the widths
    segments = []
    for take in range(count):
        gains = chance.uniform(0.5, 1, (2, 4)) * np.exp(2j * np.pi * chance.random((2, 4)))
        heard = recorded(
            frequencies + away[0, take], decays + away[1, take], gains, 50, chance, seconds=1.0
        )
        noise = Noise.white(heard.truth.noise**2)
        segments.append(Segment.of(heard.samples[:, LEAD:], RATE, noise, first_row=2 * take))
    poles = -decays + 2j * np.pi * frequencies
    silent = Exponentials(poles=poles, gains=np.zeros((2 * count, 4), complex))
    found = refine(segments, with_best_gains(segments, silent), sweeps=3, steps=6)
    apart = between_takes(segments, np.repeat(np.arange(count), 2), found)
    for told, true in zip(apart, away.std(axis=1, ddof=1), strict=True):
        assert told == pytest.approx(true, rel=0.15)
    assert not any(map(np.any, between_takes(segments, np.zeros(2 * count, int), found)))


@pytest.mark.prove
@pytest.mark.parametrize("spread", [0.0, 0.003])
def test_a_fit_holds_what_differs_from_take_to_take(spread: float) -> None:
    chance, takes = np.random.default_rng(7), []
    frequencies, decays = np.array([300.0, 800, 2000, 9000]), np.array([2.0, 4, 9, 20])
    away = spread * chance.standard_normal((6, 4))  # Hz
    for own in away:
        gains = chance.uniform(0.5, 1, (1, 4)) * np.exp(2j * np.pi * chance.random((1, 4)))
        heard = recorded(frequencies + own, decays, gains, 60, chance, seconds=1.5)
        takes.append(Take(samples=heard.samples, sample_rate=RATE))
    fitted = fit_poles(takes)
    assert any("from take to take" in note for note in fitted.notes) == bool(spread)
    assert fitted.frequencies == pytest.approx(frequencies, abs=0.01)
    if spread:
        assert fitted.frequency_errors == pytest.approx(away.std(axis=0, ddof=1), rel=0.5)
    else:
        assert np.all(fitted.frequency_errors < 5e-4)


def test_what_a_model_leaves_counts_as_noise() -> None:
    take = pairs(2.0, 1.0, 40, np.random.default_rng(5))
    segment = segment_of(take)
    usual = standard_errors([segment], true_modes(take.truth))
    quieter = replace(segment, noise=Noise.white(take.truth.noise**2 / 100))
    told = standard_errors([quieter], true_modes(take.truth))
    assert told.frequencies == pytest.approx(usual.frequencies, rel=0.3)
    assert told.gains == pytest.approx(usual.gains, rel=0.3)


def scaled_errors(seeds: range) -> tuple[list[float], list[float]]:
    """Return errors of refined frequencies and decays in standard errors, 6 modes a seed."""
    frequencies = np.array([300.0, 301.5, 800.0, 2000.0, 2004.0, 9000.0])
    decays = np.array([2.0, 2.5, 4.0, 9.0, 12.0, 60.0])
    clean = ringing(frequencies, decays, np.ones((1, 6), complex), 2 * RATE)
    truth = Truth(
        frequencies=frequencies,
        decays=decays,
        gains=np.ones((1, 6), complex),
        noise=np.array([0.1]),
    )
    away: tuple[list[float], list[float]] = ([], [])
    for seed in seeds:
        noise = 0.1 * np.random.default_rng(seed).standard_normal(clean.shape)
        segment = Segment.of(clean + noise, RATE, Noise.white([0.01]))
        found = refine([segment], true_modes(truth), sweeps=3, steps=6)
        errors = standard_errors([segment], found)
        away[0].extend((found.frequencies - frequencies) / errors.frequencies)
        away[1].extend((found.decays - decays) / errors.decays)
    return away


@pytest.mark.prove
def test_refined_modes_scatter_by_their_standard_errors() -> None:
    for away in scaled_errors(range(40)):
        # 240 values of a standard normal distribution: its rms is known to 5 %.
        assert np.sqrt(np.mean(np.square(away))) == pytest.approx(1, abs=0.15)
        assert abs(np.mean(away)) < 0.2


def test_gains_scatter_by_their_standard_errors() -> None:
    frequencies = np.array([300.0, 301.5, 800.0, 2000.0, 2004.0, 9000.0])
    decays = np.array([2.0, 2.5, 4.0, 9.0, 12.0, 60.0])
    gains = np.exp(1j * np.arange(12.0)).reshape(2, 6)
    clean = ringing(frequencies, decays, gains, RATE)
    truth = Truth(frequencies=frequencies, decays=decays, gains=gains, noise=np.array([0.1, 0.2]))
    away = []
    for seed in range(20):
        noise = truth.noise[:, None] * np.random.default_rng(seed).standard_normal(clean.shape)
        segment = Segment.of(clean + noise, RATE, Noise.white(truth.noise**2))
        found = with_best_gains([segment], true_modes(truth))
        errors = standard_errors([segment], found).gains
        away.append(np.abs(found.gains - gains) / errors)
    # 240 values of a standard complex normal distribution: its rms is known to 3 %.
    assert np.sqrt(np.mean(np.square(away))) == pytest.approx(1, abs=0.1)


def test_errors_follow_what_is_left_in_a_mode_s_own_band_and_time() -> None:
    """A hiss from 1 to 3 kHz, 30 dB under the modes, dies away long before they do."""
    frequencies = np.array([311.0, 702, 1150, 1291, 1720, 2217, 2700, 3405, 5120, 7800])
    decays = np.array([3.0, 4, 6, 6, 8, 9, 10, 14, 20, 30])
    band = butter(4, [1000, 3000], "band", fs=RATE, output="sos")
    times = np.arange(RATE) / RATE
    away, hissing = [], (frequencies > 1000) & (frequencies < 3000)
    for seed in range(6):
        chance = np.random.default_rng(seed)
        gains = np.exp(2j * np.pi * chance.random((1, 10)))
        clean = ringing(frequencies, decays, gains, RATE)
        hiss = np.exp(-30 * times) * sosfilt(band, chance.standard_normal(RATE))
        hiss *= 10 ** (-30 / 20) * np.linalg.norm(clean[:, :4410]) / np.linalg.norm(hiss[:4410])
        noise = 1e-4 * chance.standard_normal(clean.shape)
        segment = Segment.of(clean + hiss + noise, RATE, Noise.white([1e-8]))
        truth = Exponentials(poles=-decays + 2j * np.pi * frequencies, gains=gains)
        found = refine([segment], truth, sweeps=3, steps=6)
        errors = standard_errors([segment], found)
        away.append(np.abs(found.frequencies - frequencies) / errors.frequencies)
        away.append(np.abs(found.decays - decays) / errors.decays)
    assert np.mean(np.array(away) < 2) >= 0.8
    assert np.mean(np.array(away)[:, hissing] < 2) >= 0.8
    assert 0.3 < np.median(np.array(away)[:, hissing]) < 1.2  # 0.67 of a normal distribution

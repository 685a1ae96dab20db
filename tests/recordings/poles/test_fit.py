"""Takes in, modes out: several hits, several takes, tones of the room, and sounds of no object."""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.errors import OptionError, RecordingError
from struck.recordings.poles.search import PoleFit, fit_poles
from struck.recordings.takes import Take
from tests.recordings.scenes import LEAD, RATE, over_noise, recorded, repeated, scene, score
from tests.recordings.sounds import burst, chord, cymbal, sine, speech

Array = NDArray[np.float64]

FREQUENCIES = np.array([410.0, 1130.0, 1131.2, 2750.0, 5100.0])
DECAYS = np.array([3.0, 5.0, 5.5, 12.0, 30.0])


def take(samples: Array, rate: int = RATE) -> Take:
    return Take(samples=samples, sample_rate=rate)


def bar(seed: int = 0, channels: int = 1) -> Take:
    chance = np.random.default_rng(seed)
    gains = chance.uniform(0.3, 1, (channels, 5)).astype(complex)
    return take(recorded(FREQUENCIES, DECAYS, gains, 40, chance, seconds=1.0).samples)


def poles(fit: PoleFit) -> NDArray[np.complex128]:
    return -fit.decays + 2j * np.pi * fit.frequencies


@pytest.mark.prove
def test_hits_on_the_tails_of_others_have_gains_of_their_own() -> None:
    samples, starts, truth = repeated(8, np.random.default_rng(901))
    fit = fit_poles(take(samples), budget=None)
    late = np.array([row.time for row in fit.rows]) - starts / RATE
    gains = fit.gains * np.exp(np.outer(-late, poles(fit)))
    found = score(truth, poles(fit), gains)
    assert (found.found, found.false) == (1, 0)
    assert found.cents < 0.02
    nearest = np.abs(truth.frequencies[:, None] - fit.frequencies).argmin(axis=1)
    errors = np.abs(gains[:, nearest] - truth.gains) / np.abs(truth.gains)
    assert np.median(errors) < 0.03


def test_a_measurement_names_the_modes_that_may_be_two_and_leaves_them_out() -> None:
    frequencies = np.linspace(500.0, 6000.0, 12)
    energies = np.where(np.arange(12) % 3, 45.0, 17.0)
    heard = take(over_noise(frequencies, energies, np.random.default_rng(905)))
    measured, played = fit_poles(heard, budget=None), fit_poles(heard, budget=64)
    weak = frequencies[energies < 20]
    assert measured.frequencies == pytest.approx(frequencies[energies > 20], abs=0.05)
    (note,) = (each for each in measured.notes if "too weak" in each)
    named = [float(each) for each in re.findall(r"\d+\.\d", note)]
    assert named
    assert all(np.abs(weak - each).min() < 1 for each in named)
    assert len(measured.exponentials.poles) == len(measured.frequencies) + len(named)
    assert not any("too weak" in each for each in played.notes)


@pytest.mark.prove
def test_takes_of_several_lengths_share_their_poles() -> None:
    takes = [bar(seed) for seed in range(3)]
    shorter = take(takes[1].samples[:, : LEAD + RATE // 2])
    fit = fit_poles([takes[0], shorter, takes[2]], budget=None)
    assert fit.frequencies == pytest.approx(FREQUENCIES, abs=0.02)
    assert fit.decays == pytest.approx(DECAYS, rel=0.05)
    assert [(row.take, row.hit, row.channel) for row in fit.rows] == [
        (0, 0, 0),
        (1, 0, 0),
        (2, 0, 0),
    ]
    for place, one in enumerate(takes):
        alone = fit_poles(one, budget=None)
        levels = np.abs(fit.gains[place]) / np.abs(alone.gains[0])
        assert levels == pytest.approx(np.ones(5), rel=0.05)


def test_channels_are_rows_in_their_order() -> None:
    both = bar(3, channels=2)
    swapped = take(both.samples[::-1])
    fit, other = fit_poles(both), fit_poles(swapped)
    assert [row.channel for row in fit.rows] == [0, 1]
    assert np.abs(other.gains[::-1]) == pytest.approx(np.abs(fit.gains), rel=1e-3)


def test_gains_are_the_sound_from_their_time_on() -> None:
    heard = bar(4)
    fit = fit_poles(heard)
    start = round(fit.rows[0].time * RATE)
    times = np.arange(RATE // 2) / RATE
    model = np.imag(fit.gains[0] @ np.exp(np.outer(poles(fit), times)))
    sound = heard.samples[0, start : start + len(times)]
    assert np.sum((sound - model) ** 2) < 1e-3 * np.sum(sound**2)
    assert fit.verdict.modal
    assert fit.verdict.signal_to_residual > 30


@pytest.mark.prove
def test_tones_of_the_surroundings_are_left_out_and_named() -> None:
    fan = scene(30, 20, np.random.default_rng(5), channels=4, fan=True)
    fit = fit_poles(take(fan.samples), budget=None)
    (note,) = [each for each in fit.notes if "surroundings" in each]
    for tone in (50.0, 240.0, 1440.0):
        assert f"{tone}" in note
        assert np.abs(fit.frequencies - tone).min() > 0.3


@pytest.mark.prove
def test_a_budget_keeps_what_explains_most() -> None:
    fit = fit_poles(bar(6), budget=3)
    assert len(fit.frequencies) == 3
    assert fit.frequency_errors.shape == (3,)
    loudest = fit_poles(bar(6)).verdict.signal_to_residual
    assert 3 < fit.verdict.signal_to_residual < loudest


@pytest.mark.parametrize(
    ("rate", "seconds"),
    [(8000, 1.0), pytest.param(192_000, 1.0, marks=pytest.mark.prove)],
)
def test_low_and_high_rates_are_fitted(rate: int, seconds: float) -> None:
    times = np.arange(round(seconds * rate)) / rate
    kept = 0.45 * rate > FREQUENCIES
    waves = np.exp(np.outer(-DECAYS[kept] + 2j * np.pi * FREQUENCIES[kept], times)).imag.sum(axis=0)
    sound = np.pad(waves, (len(times) // 2, 0))
    noise = 1e-3 * np.random.default_rng(7).standard_normal(len(sound))
    fit = fit_poles(take(sound + noise, rate), budget=None)
    assert fit.frequencies == pytest.approx(FREQUENCIES[kept], abs=0.05)
    assert fit.decays == pytest.approx(DECAYS[kept], rel=0.05)


def test_a_clipped_hit_is_fitted_from_where_it_is_whole() -> None:
    samples = bar(8).samples * 1.6
    clean, cut = fit_poles(take(samples)), fit_poles(take(np.clip(samples, -1, 1)))
    assert any("clipped" in note for note in cut.notes)
    assert cut.rows[0].time > clean.rows[0].time
    assert cut.frequencies == pytest.approx(clean.frequencies, abs=0.05)


def test_the_same_takes_give_the_same_modes() -> None:
    first, again = fit_poles(bar(9)), fit_poles(bar(9))
    assert np.array_equal(first.frequencies, again.frequencies)
    assert np.array_equal(first.gains, again.gains)


def test_progress_is_told_and_grows() -> None:
    told: list[tuple[str, float]] = []
    fit_poles(bar(10), progress=lambda stage, share: told.append((stage, share)))
    assert {stage for stage, _ in told} == {"looking for modes", "refining the modes"}
    for stage in ("looking for modes", "refining the modes"):
        shares = [share for each, share in told if each == stage]
        assert shares == sorted(shares)
        assert 0 <= min(shares) <= max(shares) <= 1


STEADY, MOVING = "steady tone", "noise-like, as of a cymbal, or moves in pitch"
UNSTRUCK: dict[str, tuple[Callable[[], Array], str]] = {
    "chord": (lambda: chord(0.7), STEADY),
    "speech": (lambda: speech(np.random.default_rng(1), 0.5), MOVING),
    "cymbal": (lambda: cymbal(np.random.default_rng(2), 0.5), MOVING),
    "burst": (lambda: burst(np.random.default_rng(3), 0.4), MOVING),
}


@pytest.mark.parametrize(
    "name",
    [
        "chord",
        pytest.param("speech", marks=pytest.mark.prove),
        pytest.param("cymbal", marks=pytest.mark.prove),
        pytest.param("burst", marks=pytest.mark.prove),
    ],
)
def test_what_nobody_struck_is_called_so(name: str) -> None:
    sounding, reason = UNSTRUCK[name]
    samples = sounding()
    quiet = 1e-5 * np.random.default_rng(4).standard_normal(len(samples))
    fit = fit_poles(take(samples + quiet), budget=32)
    assert not fit.verdict.modal
    assert reason in fit.verdict.reason


def test_noise_and_a_tone_hold_no_hit() -> None:
    with pytest.raises(RecordingError, match="no hit was found in the take"):
        fit_poles(take(0.1 * np.random.default_rng(5).standard_normal(RATE)))
    with pytest.raises(RecordingError, match="no hit was found in the take"):
        fit_poles(take(sine(0.7)))


def test_noise_after_a_claimed_hit_holds_no_modes() -> None:
    fit = fit_poles(take(0.1 * np.random.default_rng(6).standard_normal(RATE)), onsets=[[0.3]])
    assert len(fit.frequencies) == 0
    assert fit.gains.shape == (1, 0)
    assert "nothing rings" in fit.verdict.reason


def test_options_outside_their_bounds_are_refused() -> None:
    with pytest.raises(OptionError, match="0 takes"):
        fit_poles([])
    with pytest.raises(OptionError, match="budget 0"):
        fit_poles(bar(), budget=0)
    with pytest.raises(OptionError, match="onsets of 2 takes"):
        fit_poles(bar(), onsets=[[0.1], [0.2]])
    with pytest.raises(OptionError, match=r"onset 9\.0 s lies outside"):
        fit_poles(bar(), onsets=[[9.0]])
    with pytest.raises(RecordingError, match="at 48000 Hz"):
        fit_poles([bar(), take(bar().samples, 48000)])

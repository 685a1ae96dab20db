"""All modes of bodies struck softly, in rooms, through coders and under automatic gain."""

from __future__ import annotations

import time
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.model.exponentials import Exponentials
from struck.recordings.fit import fit_recordings
from struck.recordings.gain_control import MAX_DECAY_ERROR, gain_control
from struck.recordings.onsets import find_hits
from struck.recordings.poles.refinement import refine, with_best_gains
from struck.recordings.poles.search import PoleFit, fit_poles
from struck.recordings.takes import Take
from tests.recordings.scenes import (
    CLEAR,
    LEAD,
    RATE,
    Scene,
    Score,
    body,
    gain_controlled,
    in_room,
    paired,
    pairs,
    ringing,
    scene,
    score,
    struck_softly,
    with_noise,
)
from tests.recordings.test_processing import coded

Array = NDArray[np.complex128]
SEEDS = pytest.mark.parametrize(
    "seed", [1, *(pytest.param(seed, marks=pytest.mark.prove) for seed in (0, 2, 3, 4))]
)
WORST = 5.0
"""Processor seconds for a second of sound."""


def take_of(heard: Scene) -> Take:
    return Take(samples=heard.samples, sample_rate=RATE)


def measured(heard: Scene) -> PoleFit:
    begun = time.thread_time()
    fit = fit_poles(take_of(heard), budget=None)
    assert time.thread_time() - begun < WORST * heard.samples.shape[1] / RATE
    return fit


def modes_of(heard: Scene, fit: PoleFit) -> tuple[Array, Array]:
    """Return poles (M,) with the true gains: rooms, coders and gain control change these."""
    nearest = np.abs(fit.frequencies[:, None] - heard.truth.frequencies).argmin(axis=1)
    return -fit.decays + 2j * np.pi * fit.frequencies, heard.truth.gains[:, nearest]


def scored(heard: Scene, fit: PoleFit) -> Score:
    return score(heard.truth, *modes_of(heard, fit))


def matches(heard: Scene, fit: PoleFit) -> tuple[NDArray[np.intp], ...]:
    """Return which true modes are found, and which fitted ones they are."""
    return paired(heard.truth, *modes_of(heard, fit))


@SEEDS
def test_a_soft_mallet_makes_no_modes(seed: int) -> None:
    """After a push of 3 ms few modes above some kHz are clear of the noise, by 19 dB."""
    heard = struck_softly(40, 50, np.random.default_rng(seed))
    fit = measured(heard)
    clear = heard.truth.detectable(CLEAR)
    found = np.isin(np.flatnonzero(clear), matches(heard, fit)[0])
    assert found.mean() >= 0.9
    assert scored(heard, fit).false <= 5


def in_a_room(distance: float, seed: int) -> Scene:
    return in_room(40, 50, np.random.default_rng(seed), seconds=0.35, distance=distance)


ROOMS = [(distance, seed) for distance in (0.3, 1.2) for seed in range(3)]


@pytest.mark.prove
@pytest.mark.parametrize(("distance", "seed"), ROOMS)
def test_a_room_makes_few_modes(distance: float, seed: int) -> None:
    heard = in_a_room(distance, seed)
    found = scored(heard, measured(heard))
    assert found.false <= 100
    assert found.decay < 0.05
    assert found.found >= 0.9


@pytest.mark.prove
@pytest.mark.parametrize(("distance", "seed"), ROOMS)
def test_a_room_that_is_told_makes_fewer(distance: float, seed: int) -> None:
    heard = in_a_room(distance, seed)
    made = fit_recordings(take_of(heard), modes=None, room=0.35, cache=False, force=True)
    found = scored(heard, made.fitted)
    assert found.false <= 20
    assert found.decay < 0.05
    assert any("left out of the model as modes of the room" in each for each in made.fitted.notes)
    assert found.found >= 0.9


@SEEDS
def test_a_dry_take_keeps_its_modes_whatever_room_is_told(seed: int) -> None:
    heard = scene(40, 50, np.random.default_rng(seed))
    made = fit_recordings(take_of(heard), modes=None, room=0.35, cache=False)
    found = scored(heard, made.fitted)
    assert found.found >= 0.9
    assert found.false == 0
    assert not any("left out" in each for each in made.fitted.notes)


UNCLEAR = pytest.mark.xfail(
    reason="36 of 40; the least squares that start from the true modes find 36, too, for the pairs "
    "at 3.8, 6.2 and 12.1 kHz are too close for their noise, and 37 of the take without a coder",
    strict=True,
)
SECOND = [pytest.param(2), *(pytest.param(seed, marks=pytest.mark.prove) for seed in (0, 3, 4))]


@pytest.mark.prove
@pytest.mark.parametrize("seed", [*SECOND, pytest.param(1, marks=(pytest.mark.prove, UNCLEAR))])
def test_a_coder_of_128_kilobits_makes_few_modes(seed: int) -> None:
    found = through_a_coder(128, seed)
    assert found.false <= 20
    assert found.found >= 0.95


@pytest.mark.prove
@pytest.mark.parametrize("seed", range(5))
def test_a_coder_of_64_kilobits_makes_few_modes(seed: int) -> None:
    found = through_a_coder(64, seed)
    assert found.false <= 20
    assert found.found >= 0.9


@pytest.mark.prove
def test_least_squares_from_the_truth_find_no_more_where_too_few_are_found() -> None:
    """What they miss is not in the sound: pairs that differ by less than the noise lets one see."""
    heard = of_a_coder(128, seed=1)
    fit, true = measured(heard), heard.truth.poles
    begun = Exponentials(poles=true, gains=np.zeros((1, len(true)), complex))
    best = refine(fit.segments, with_best_gains(fit.segments, begun), sweeps=8, steps=12)
    nearest = np.abs(best.frequencies[:, None] - heard.truth.frequencies).argmin(axis=1)
    known = score(heard.truth, best.poles, heard.truth.gains[:, nearest])
    assert scored(heard, fit).found >= known.found


def of_a_coder(kilobits: int, seed: int) -> Scene:
    clean = scene(40, 50, np.random.default_rng(seed))
    return Scene(samples=coded(0.7 * clean.samples[0], kilobits)[None], truth=clean.truth)


def through_a_coder(kilobits: int, seed: int) -> Score:
    heard = of_a_coder(kilobits, seed)
    fit = measured(heard)
    assert any("coded with loss" in note for note in fit.notes)
    return scored(heard, fit)


def phone(seed: int) -> Scene:
    chance = np.random.default_rng(seed)
    clean = scene(40, 50, chance)
    return gain_controlled(clean, chance.uniform(-40, -12), chance.choice([2.0, 3.0, 4.0, 8.0]))


@cache
def under_control(seed: int) -> tuple[Scene, PoleFit]:
    heard = phone(seed)
    return heard, fit_poles(take_of(heard), budget=None)


PHONES = [*range(10), 13]


@pytest.mark.parametrize(
    "seeds", [[3], pytest.param(PHONES, marks=pytest.mark.prove)], ids=["1", "11"]
)
def test_automatic_gain_is_undone_or_refused(seeds: list[int]) -> None:
    kept = 0
    for heard, fit in map(under_control, seeds):
        assert any("controlled automatically" in note for note in fit.notes)
        if fit.verdict.modal:
            kept += 1
            assert scored(heard, fit).decay < 0.05
            assert covered(heard, fit) >= 0.8
    assert kept >= len(seeds) / 2


ALIKE = pytest.mark.xfail(
    reason="34 of 40; of the take before its gain was controlled, 35 can be told apart by the "
    "Cramer-Rao bound",
    strict=True,
)


@pytest.mark.prove
@pytest.mark.parametrize(
    "seed", [pytest.param(seed, marks=ALIKE if seed == 13 else ()) for seed in PHONES]
)
def test_modes_are_found_under_automatic_gain(seed: int) -> None:
    heard, fit = under_control(seed)
    assert not fit.verdict.modal or scored(heard, fit).found >= 0.9


def covered(heard: Scene, fit: PoleFit) -> float:
    """Return the share of true decays within two standard errors."""
    rows, columns = matches(heard, fit)
    off = np.abs(fit.decays[columns] - heard.truth.decays[rows])
    return float(np.mean(off < 2 * fit.decay_errors[columns]))


@pytest.mark.prove
def test_gain_that_the_noise_hardly_tells_is_refused() -> None:
    """A hit that is cut off after 0.3 s: too short to average the noise."""
    heard = phone(1)
    short = Scene(samples=heard.samples[:, : LEAD + RATE * 3 // 10], truth=heard.truth)
    fit = fit_poles(take_of(short), budget=32)
    assert not fit.verdict.modal
    reason = fit.verdict.reason
    assert "its gain was controlled automatically, and the noise determines decays" in reason
    assert np.median((fit.decay_errors / fit.decays)[~fit.blow]) > MAX_DECAY_ERROR


@SEEDS
def test_beats_two_stages_and_a_hand_are_no_gain_control(seed: int) -> None:
    chance = np.random.default_rng(seed)
    frequencies, decays, gains = body(40, chance)
    own = gains[None].astype(complex)
    rung = ringing(frequencies, decays, own, 2 * RATE)
    fast = ringing(frequencies, 4 * decays, own, 2 * RATE)
    times = np.arange(2 * RATE) / RATE
    damped = rung * np.exp(-20 * np.maximum(times - 0.4, 0))
    takes = [
        with_noise(each, frequencies, decays, own, 50, chance)
        for each in (rung, 0.3 * rung + fast, damped)
    ]
    takes.append(pairs(chance.uniform(1, 6), chance.uniform(0.5, 8), 50, chance))
    for heard in map(take_of, takes):
        assert gain_control(heard, find_hits(heard)) is None


@pytest.mark.parametrize("noise", [0.0, 1e-9])
def test_digital_silence_tells_no_gain(noise: float) -> None:
    times = np.arange(RATE) / RATE
    rung = np.pad(np.exp(-5 * times) * np.sin(2 * np.pi * 700 * times), (LEAD, 0))
    rung[: LEAD // 2] += noise * np.random.default_rng(0).standard_normal(LEAD // 2)
    heard = Take(samples=rung, sample_rate=RATE)
    assert gain_control(heard, find_hits(heard)) is None

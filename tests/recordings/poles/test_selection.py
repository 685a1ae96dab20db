"""Modes that noise puts beside strong ones."""

from __future__ import annotations

import numpy as np
import pytest

from struck.model.exponentials import Exponentials
from struck.recordings.noise import Noise
from struck.recordings.poles.refinement import refine
from struck.recordings.poles.selection import drop_redundant, prune
from struck.recordings.segments import Segment
from tests.recordings.scenes import RATE, ringing

FREQUENCIES, DECAYS = np.array([410.0, 1130.0, 1131.2]), np.array([3.0, 5.0, 5.5])


def segment(frequencies: np.ndarray, decays: np.ndarray, gains: np.ndarray, seed: int) -> Segment:
    clean = ringing(frequencies, decays, gains[None].astype(complex), RATE)
    noise = 1e-3 * np.random.default_rng(seed).standard_normal(clean.shape)
    return Segment.of(clean + noise, RATE, Noise.white([1e-6]))


def started(frequencies: np.ndarray, decays: np.ndarray) -> Exponentials:
    poles = -decays + 2j * np.pi * frequencies
    return Exponentials(poles=poles, gains=np.zeros((1, len(poles)), complex))


@pytest.mark.parametrize("seed", range(4))
def test_a_satellite_that_noise_made_is_dropped(seed: int) -> None:
    given = segment(FREQUENCIES, DECAYS, np.ones(3), seed)
    crowded = started(np.append(FREQUENCIES, 1129.5), np.append(DECAYS, 7.0))
    fitted = refine([given], crowded, sweeps=4, steps=6)
    kept = drop_redundant([given], fitted)
    assert kept.count == 3
    assert np.sort(kept.frequencies) == pytest.approx(FREQUENCIES, abs=0.01)


def test_a_weak_mode_that_is_there_stays() -> None:
    tones, decays = np.append(FREQUENCIES, 1127.0), np.append(DECAYS, 4.0)
    given = segment(tones, decays, np.array([1.0, 1.0, 1.0, 0.03]), 1)
    fitted = refine([given], started(tones, decays), sweeps=4, steps=6)
    assert drop_redundant([given], fitted).count == 4


def test_nothing_is_weeded_of_nothing() -> None:
    given = segment(FREQUENCIES, DECAYS, np.ones(3), 1)
    assert drop_redundant([given], Exponentials.silence(1)).count == 0


def chosen(frequencies: list[float], gains: list[list[float]], budget: int) -> list[float]:
    """Return which modes of hits with gains (hits, M) a budget keeps, Hz."""
    poles = np.array([-20 + 2j * np.pi * each for each in frequencies])
    ringing = Exponentials(poles=poles, gains=np.array(gains, complex))
    chance = np.random.default_rng(0)
    noise = 1e-4 * chance.standard_normal((len(gains), RATE // 2))
    silent = Segment.of(noise, RATE, Noise.white(np.full(len(gains), 1e-8)))
    segment = Segment.of(
        silent.model(ringing) + noise, RATE, Noise.white(np.full(len(gains), 1e-8))
    )
    return prune([segment], ringing, budget=budget).frequencies.round().tolist()


def test_a_mode_that_all_hits_need_is_worth_more_than_a_loud_one_of_one() -> None:
    assert chosen([500, 1500], [[10, 20], [1, 0.01], [1, 0.01]], 1) == [500]
    assert chosen([500, 1500], [[10, 20]], 1) == [1500]


def test_a_mode_alone_in_its_band_is_worth_a_little_more() -> None:
    assert chosen([1000, 1030, 4000], [[1.0, 0.70, 0.67]], 2) == [1000, 4000]
    assert chosen([1000, 1030, 4000], [[1.0, 0.70, 0.50]], 2) == [1000, 1030]

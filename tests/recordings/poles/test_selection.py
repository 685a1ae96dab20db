"""Modes that noise puts beside strong ones."""

from __future__ import annotations

import numpy as np
import pytest

from struck.model.exponentials import Exponentials
from struck.recordings.noise import Noise
from struck.recordings.poles.refinement import refine
from struck.recordings.poles.selection import weed
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
    kept = weed([given], fitted)
    assert kept.count == 3
    assert np.sort(kept.frequencies) == pytest.approx(FREQUENCIES, abs=0.01)


def test_a_weak_mode_that_is_there_stays() -> None:
    tones, decays = np.append(FREQUENCIES, 1127.0), np.append(DECAYS, 4.0)
    given = segment(tones, decays, np.array([1.0, 1.0, 1.0, 0.03]), 1)
    fitted = refine([given], started(tones, decays), sweeps=4, steps=6)
    assert weed([given], fitted).count == 4


def test_nothing_is_weeded_of_nothing() -> None:
    given = segment(FREQUENCIES, DECAYS, np.ones(3), 1)
    assert weed([given], Exponentials.silence(1)).count == 0

"""Steady tones of the surroundings, taken out of takes whose modes are known."""

from __future__ import annotations

import re

import numpy as np
import pytest

from struck.recordings.disturbances import without_hum
from struck.recordings.poles.search import fit_poles
from struck.recordings.takes import Take
from tests.recordings.scenes import LEAD, RATE, hummed, scene, score


@pytest.mark.prove
@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(s, marks=pytest.mark.prove) for s in range(1, 5))]
)
def test_modes_are_found_beneath_hum(seed: int) -> None:
    chance = np.random.default_rng(seed)
    heard = hummed(scene(40, 50, chance), -20, chance)
    fit = fit_poles(Take(samples=heard.samples, sample_rate=RATE), budget=None)
    assert [round(row.onset, 2) for row in fit.rows] == [0.5]
    poles = -fit.decays + 2j * np.pi * fit.frequencies
    # Only frequencies and decays are judged: the hum has changed the scale.
    scale = np.abs(heard.truth.gains).max() / np.abs(fit.gains).max()
    found = score(heard.truth, poles, scale * fit.gains)
    assert found.found >= 0.9
    assert found.false <= 2
    assert found.decay < 0.01
    (note,) = (each for each in fit.notes if "surroundings" in each)
    assert all(f"{50.02 * harmonic:.1f}" in note for harmonic in (1, 2, 5))


def test_what_is_taken_out_is_the_hum_alone() -> None:
    clean = scene(20, 60, np.random.default_rng(7))
    heard = hummed(clean, -20, np.random.default_rng(8))
    calm, tones = without_hum(Take(samples=heard.samples, sample_rate=RATE))
    assert tones[:, 0] == pytest.approx(50.02 * np.arange(1, 9), abs=0.1)
    scale = np.vdot(calm.samples, clean.samples) / np.vdot(calm.samples, calm.samples)
    left = scale * calm.samples - clean.samples
    hum = scale * heard.samples - clean.samples
    assert np.std(left) < 0.1 * np.std(hum)
    assert np.std(left[:, :LEAD]) < 0.02 * np.std(hum)


def test_a_ringing_object_is_no_hum() -> None:
    """Also where it rang before, and goes on ringing to the end."""
    times = np.arange(3 * RATE) / RATE
    ring = np.exp(-1.5 * times) * np.sin(2 * np.pi * 200 * times)
    heard = 0.1 * np.pad(ring, (0, 0)) + np.pad(ring[: 2 * RATE], (RATE, 0))
    take = Take(samples=heard, sample_rate=RATE)
    same, tones = without_hum(take)
    assert same is take
    assert tones.size == 0


@pytest.mark.prove
def test_hum_alone_is_not_modal() -> None:
    times = np.arange(2 * RATE) / RATE
    hum = sum(np.sin(2 * np.pi * 50 * k * times + k) / k for k in range(1, 9))
    noise = 1e-3 * np.random.default_rng(1).standard_normal(len(times))
    assert not fit_poles(Take(samples=0.2 * hum + noise, sample_rate=RATE)).verdict.modal


@pytest.mark.prove
def test_no_name_is_given_twice() -> None:
    heard = scene(20, 30, np.random.default_rng(5), fan=True, seconds=1.0)
    fit = fit_poles(Take(samples=heard.samples, sample_rate=RATE), budget=32)
    (note,) = (each for each in fit.notes if "surroundings" in each)
    named = re.findall(r"\d+\.\d", note)
    assert len(set(named)) == len(named)

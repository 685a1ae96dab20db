"""An instrumented hammer's channel is told from those of microphones."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.recordings.onsets import find_hits, findings
from struck.recordings.poles.search import fit_poles
from struck.recordings.takes import Take, copied_channels, force_channels, without_force
from tests.recordings.scenes import scene

Array = NDArray[np.float64]

RATE = 44100
ONSETS = (RATE // 4, RATE)


def rung(seed: int) -> Array:
    """Return two hits of an object of three modes, in noise."""
    chance = np.random.default_rng(seed)
    times = np.arange(RATE) / RATE
    modes = [np.sin(2 * np.pi * tone * times) for tone in (410.0, 1130.0, 2750.0)]
    sound = 0.2 * np.sum(modes, axis=0) * np.exp(-12 * times)
    return sum(np.pad(sound, (each, RATE - each)) for each in ONSETS) + 1e-4 * (
        chance.standard_normal(2 * RATE)
    )


def pushed(contact: float = 0.001) -> Array:
    """Return a force: half a period of a sine at each hit, and what the sensor's filter adds."""
    times = np.arange(round(contact * RATE)) / RATE
    force = 0.01 + 1e-4 * np.random.default_rng(0).standard_normal(2 * RATE)
    for onset in ONSETS:
        force[onset : onset + len(times)] += 0.7 * np.sin(np.pi * times / contact)
        force[onset + len(times) : onset + RATE // 50] -= 0.02
    return force


@pytest.mark.parametrize("contact", [0.0002, 0.001, 0.002])
@pytest.mark.parametrize("sign", [-1, 1])
def test_pulses_of_one_sign_are_a_force(contact: float, sign: int) -> None:
    take = Take(samples=np.stack((rung(0), sign * pushed(contact), rung(1))), sample_rate=RATE)
    assert force_channels(take).tolist() == [False, True, False]
    assert np.array_equal(without_force(take).samples, take.samples[[0, 2]])


@pytest.mark.parametrize("decay", [30.0, 300.0])
def test_short_sounds_are_none(decay: float) -> None:
    times = np.arange(RATE) / RATE
    click = np.pad(np.sin(2 * np.pi * 900 * times) * np.exp(-decay * times), (RATE, 0))
    assert not force_channels(Take(samples=np.stack((rung(0), click)), sample_rate=RATE)).any()


def test_a_take_keeps_its_only_channel() -> None:
    take = Take(samples=pushed(), sample_rate=RATE)
    assert without_force(take) is take


def test_a_force_is_left_out_of_the_fit_and_named() -> None:
    fit = fit_poles(Take(samples=np.stack((pushed(), rung(2))), sample_rate=RATE))
    assert [(row.hit, row.channel) for row in fit.rows] == [(0, 1), (1, 1)]
    assert fit.frequencies == pytest.approx([410, 1130, 2750], abs=0.05)
    assert any("channel 1 of the take holds the force" in note for note in fit.notes)


def test_a_copied_channel_is_left_out_and_told() -> None:
    """Phones write one microphone twice; as two they would double the evidence of noise."""
    chance = np.random.default_rng(0)
    one = scene(8, 50, chance).samples[0]
    for scale in (1.0, 0.5):
        both = np.stack([one, scale * one]) + 1e-5 * chance.uniform(-1, 1, (2, len(one)))
        twice = Take(samples=np.round(both * 32768) / 32768, sample_rate=RATE)
        assert copied_channels(twice).tolist() == [False, True]
        notes = list(findings(twice, find_hits(twice)))
        assert any("channel 2 of the take is one before it again" in note for note in notes)
    own = scene(8, 50, chance, channels=2)
    assert not copied_channels(Take(samples=own.samples, sample_rate=RATE)).any()

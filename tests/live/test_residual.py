"""Attack and noise of recorded bodies while they are played, against their offline sound."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, correlate, sosfilt

import struck
from struck import ModalModel, Strike
from struck.excitation.pulses import LEAD
from struck.live.limiter import DELAY, limiter
from struck.recordings.fit import fit_recordings
from struck.recordings.takes import Take
from tests.live.hand import BLOCK, RATE, HandPlayer, Make, by_hand

__all__ = ["by_hand"]
Array = NDArray[np.float64]
LATE = round(limiter(sample_rate=RATE, channels=2)[DELAY])
OPENED = 10


@cache
def drum() -> ModalModel:
    """Return the fit of a synthetic drum: a membrane's tones, and the noise of its snares."""
    chance, rate = np.random.default_rng(3), 16_000
    times = np.arange(round(0.6 * rate)) / rate
    tones = 180 * np.array([1.0, 1.594, 2.136, 2.296, 2.653])  # zeros of Bessel functions
    heard = np.sin(2 * np.pi * np.outer(times, tones)) * np.exp(-np.outer(times, 12 + tones / 30))
    snares = 0.05 * chance.standard_normal(len(times)) * np.exp(-20 * times)
    rung = np.pad(0.1 * (heard.sum(axis=1) + snares), (round(0.3 * rate), 0))
    noise = 1e-5 * chance.standard_normal(len(rung))
    take = Take(samples=(rung + noise)[None], sample_rate=rate, name="drum")
    return fit_recordings(take, modes=8, cache=False).model


def apart(one: Array, other: Array) -> float:
    """Return the largest difference over the largest sample, dB."""
    count = min(len(one), len(other))
    return float(20 * np.log10(np.abs(one[:count] - other[:count]).max() / np.abs(other).max()))


def heard_after(player: HandPlayer, strike: Strike, blocks: int) -> Array:
    player.hear(OPENED)
    player.strike(strike)
    return player.hear(blocks)[BLOCK + LEAD + LATE :] / player.gain


@pytest.mark.parametrize(
    "strike", [Strike(), Strike(impulse=0.5, duration=4e-3, time=0.0113), Strike(seed=4)]
)
def test_a_played_drum_sounds_as_a_rendered_one(by_hand: Make, strike: Strike) -> None:
    residual = drum().residual
    assert residual is not None
    assert residual.levels.any()
    heard = heard_after(by_hand(drum(), volume=-30, listener=(2, 0, 0)), strike, 150)
    expected = struck.render(drum(), strike, seconds=0.4, fade=0, listener=(2, 0, 0)).samples[0]
    assert apart(heard, expected) < -60


def test_a_started_strike_brings_its_attack_as_well(by_hand: Make) -> None:
    """With a burst of noise it is an excitation of its own."""
    strike, player = Strike(transient=0.1, time=0.02), by_hand(drum(), volume=-30)
    heard = heard_after(player, strike, 100)
    expected = struck.render(drum(), strike, seconds=0.25, fade=0).samples[0]
    assert apart(heard, expected) < -60


def test_two_bare_ears_hear_what_is_rendered_for_them(by_hand: Make) -> None:
    ears = struck.Stereo(position=(0, 1, 0))
    player = by_hand(drum(), volume=-30, listener=ears)
    player.hear(OPENED)
    player.strike(Strike(time=0.01))
    heard = player.hear_both(100) / player.gain
    expected = struck.render(drum(), Strike(time=0.01), seconds=0.25, fade=0, listener=ears).samples
    # Ears are one delay line more; both are late alike.
    late = int(np.argmax(correlate(heard[0], expected[0], "full"))) - expected.shape[1] + 1
    assert BLOCK + LEAD + LATE <= late < 2 * (BLOCK + LEAD + LATE)
    for one, other in zip(heard, expected, strict=True):
        assert apart(one[late:], other) < -60


def test_two_ears_hear_the_attack_too(by_hand: Make) -> None:
    ears = struck.Stereo(position=(0, 1, 0))
    player = by_hand(drum(), volume=-30, listener=ears)
    player.hear(OPENED)
    player.strike(Strike(time=0.01))
    heard = player.hear(100) / player.gain
    bare = by_hand(replace(drum(), residual=None), volume=-30, listener=ears)
    bare.hear(OPENED)
    bare.strike(Strike(time=0.01))
    hissing, tones = (treble(each) for each in (heard, bare.hear(100) / bare.gain))
    expected = struck.render(drum(), Strike(time=0.01), seconds=0.25, fade=0, listener=ears)
    assert hissing == pytest.approx(treble(expected.samples[0]), rel=0.05)
    assert tones < 0.5 * hissing


def treble(sound: Array) -> float:
    """Return the size of what lies above 4 kHz."""
    high = butter(6, 4000, "high", fs=RATE, output="sos")
    return float(np.linalg.norm(sosfilt(high, sound)))


def test_a_late_block_lets_the_attack_die_away_without_a_click(by_hand: Make) -> None:
    player = by_hand(drum(), volume=-30, listener=(2, 0, 0))
    player.hear(OPENED)
    player.strike()
    before = player.hear(2)
    held = player.hear_late(3)
    assert np.isfinite(held).all()
    whole = np.concatenate([before, held])
    assert np.abs(np.diff(whole[-2 * BLOCK :])).max() < np.abs(np.diff(before)).max()
    after = player.hear(60)
    assert np.abs(after).max() < 2 * np.abs(before).max()


def test_a_drum_without_duration_clicks_no_louder_than_it_sounds(by_hand: Make) -> None:
    """The answer to a steady force is no part of an ideal blow; levels follow the sound itself."""
    player = by_hand(drum(), listener=(2, 0, 0))
    player.hear(OPENED)
    player.strike()
    peak = np.abs(player.hear(60)).max()
    assert 20 * np.log10(peak) == pytest.approx(-12, abs=0.5)

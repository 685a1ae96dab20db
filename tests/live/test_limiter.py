"""Nothing above the ceiling; below it, nothing but a delay."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.live import limiter
from struck.live.limiter import is_closed, limit
from tests.yardstick import transforms

RATE, BLOCK = 48000, 128
OPEN = True
Array = NDArray[np.float64]


def limited(samples: Array, *, block: int = BLOCK, **options: float) -> tuple[Array, Array]:
    """Return what comes out, the fade over before it begins, and the state afterwards."""
    samples = np.array(samples, dtype=float, ndmin=2)
    state = limiter.limiter(sample_rate=RATE, channels=len(samples), **options)
    state[limiter.OPENING] = 1
    blocks = []
    for first in range(0, samples.shape[1], block):
        some = samples[:, first : first + block].copy()
        limit(state, some, OPEN)
        blocks.append(some)
    return np.concatenate(blocks, axis=1), state


def tone(frequency: float, amplitude: float, seconds: float = 1.0) -> Array:
    return amplitude * np.sin(2 * np.pi * frequency * np.arange(round(seconds * RATE)) / RATE)


def hostile() -> dict[str, Array]:
    chance = np.random.default_rng(7)
    noise = chance.normal(size=(2, RATE // 2))
    spoiled = 3 * noise
    spoiled[0, ::977], spoiled[1, ::1013], spoiled[0, 5::1009] = np.nan, np.inf, -np.inf
    return {
        "step": np.where(np.arange(RATE // 2) > 1000, 1e6, 0.0),
        "bursts": noise * np.where(np.sin(np.arange(RATE // 2) / 700) > 0.9, 50, 0.01),
        "noise": 1e6 * noise,
        "lone peaks": np.where(chance.random(RATE // 2) < 1e-3, 1e9, 0.1),
        "largest": np.full(RATE // 2, np.finfo(float).max),
        "growth": np.exp(np.linspace(-20, 700, RATE // 2)),
        "spoiled": spoiled,
    }


@pytest.mark.parametrize("name", hostile())
@pytest.mark.parametrize("ceiling", [0.89, 0.1, 1.0])
def test_nothing_is_above_the_ceiling(name: str, ceiling: float) -> None:
    out, _ = limited(hostile()[name], ceiling=ceiling)
    assert np.abs(out).max() <= ceiling
    assert np.abs(out.astype(np.float32)).max() <= ceiling
    assert np.isfinite(out).all()
    if name in {"step", "noise"}:
        assert np.abs(out).max() > 0.95 * ceiling  # it limits, it does not mute


def test_what_is_not_finite_is_silent_and_counted_and_soon_forgotten() -> None:
    samples = tone(440, 0.5)
    spoiled = samples.copy()
    spoiled[[100, 200, 300]] = np.nan, np.inf, -np.inf
    out, state = limited(spoiled)
    delay = int(state[limiter.DELAY])
    expected = np.where(np.isfinite(spoiled), samples, 0)
    assert state[limiter.REPLACED] == 3
    assert np.array_equal(out[0, delay:], expected[:-delay])


@pytest.mark.parametrize("block", [1, 17, 128, 4096])
def test_below_the_ceiling_there_is_only_a_delay(block: int) -> None:
    samples = np.stack([tone(440, 0.88), tone(3000, 0.3)])
    out, state = limited(samples, block=block)
    delay = int(state[limiter.DELAY])
    assert delay / RATE == pytest.approx(0.0015)
    assert np.abs(out[:, delay:] - samples[:, :-delay]).max() < 1e-12
    assert not out[:, :delay].any()


def test_after_a_loud_moment_it_is_transparent_again() -> None:
    samples = tone(440, 0.5, seconds=6)
    samples[:BLOCK] *= 1e4
    out, state = limited(samples)
    delay = int(state[limiter.DELAY])
    assert np.abs(out[0, -RATE:] - samples[-RATE - delay : -delay]).max() < 1e-12


def test_blocks_do_not_matter() -> None:
    noise = hostile()["bursts"]
    assert np.array_equal(limited(noise, block=17)[0], limited(noise, block=4096)[0])


def test_the_gain_moves_without_a_jump_and_alike_in_all_channels() -> None:
    # One channel carries the peak, the other shows the gain.
    peak = np.zeros(RATE)
    peak[1000] = 100
    out, state = limited(np.stack([peak, np.full(RATE, 0.5)]))
    delay = int(state[limiter.DELAY])
    gain = out[1, delay:] / 0.5
    assert gain[1000] == pytest.approx(0.0089, rel=1e-3)
    assert out[0, 1000 + delay] == pytest.approx(0.89, rel=1e-3)
    fall = 2 / (delay + 2)  # of two equal moving averages, steepest where half is over
    assert np.abs(np.diff(gain)).max() <= fall * 1.01
    assert np.abs(np.diff(gain, 2)).max() <= (2 * fall / (delay + 2)) * 1.05
    rise = np.diff(gain[1000:]).max()
    assert rise == pytest.approx(1 / (0.2 * RATE), rel=0.02)


def test_it_lets_go_with_its_time_constant() -> None:
    samples = np.full(2 * RATE, 0.5)
    samples[1000] = 100
    out, state = limited(samples)
    delay = int(state[limiter.DELAY])
    gain = out[0, delay:] / 0.5
    held = 1000 + round(0.010 * RATE) + delay // 2
    assert 1 - gain[held + round(0.2 * RATE)] == pytest.approx(np.exp(-1), rel=0.02)


@pytest.mark.parametrize(
    ("frequency", "bound"), [(50, -120), (100, -120), (440, -120), (997, -120), (11025.3, -120)]
)
def test_a_loud_steady_tone_stays_a_tone(frequency: float, bound: float) -> None:
    out = limited(tone(frequency, 20, seconds=2))[0][0, RATE:]
    turns = 2 * np.pi * frequency * np.arange(RATE, 2 * RATE) / RATE
    parts = np.stack([np.sin(turns), np.cos(turns)], axis=1)
    rest = out - parts @ np.linalg.lstsq(parts, out, rcond=None)[0]
    assert 20 * np.log10(rest.std() / out.std()) < bound
    assert np.abs(out).max() > 0.85


def test_the_output_opens_and_closes_with_a_raised_cosine() -> None:
    state = limiter.limiter(sample_rate=RATE, channels=1, fade=0.02)
    length = round(0.02 * RATE)
    assert is_closed(state)
    blocks = []
    for opened in (True, False):
        samples = np.full((1, 2 * length), 0.5)
        limit(state, samples, opened)
        blocks.append(samples[0] / 0.5)
    delay = int(state[limiter.DELAY])
    ramp = np.sin(np.pi / 2 * np.arange(1, length + 1) / length) ** 2
    assert np.allclose(blocks[0][delay:length], ramp[delay:], rtol=0, atol=1e-12)
    assert np.allclose(blocks[1][:length], 1 - ramp, rtol=0, atol=1e-12)
    assert np.array_equal(blocks[1][length:], np.zeros(length))
    assert is_closed(state)


@pytest.mark.parametrize(
    "wrong",
    [
        {"channels": 0},
        {"sample_rate": 0.0},
        {"ceiling": -1.0},
        {"ceiling": np.nan},
        {"look_ahead": 0.0},
        {"hold": -1.0},
        {"release": np.inf},
        {"fade": 0.0},
    ],
    ids=str,
)
def test_impossible_options_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(OptionError, match="give"):
        limiter.limiter(**{"sample_rate": RATE, "channels": 2, **wrong})


def test_it_takes_little_time() -> None:
    """Usually 0.005 transforms."""
    state = limiter.limiter(sample_rate=RATE, channels=2)
    noise = np.random.default_rng(3).normal(size=(2, BLOCK))
    assert transforms(lambda: limit(state, noise.copy(), OPEN), turns=200) < 0.05

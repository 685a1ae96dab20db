"""Rolling: what a ball feels of two surfaces, and how far it is from round."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import welch

from struck.excitation.envelope import Envelope, Roller
from struck.excitation.roughness import Roughness
from struck.excitation.scrape import Roll
from struck.excitation.scraping_force import FOLLOWED_LENGTH, SlidingContact
from tests.excitation.bodies import SIZE
from tests.excitation.test_scrape import RATE, centroid, force

Array = NDArray[np.float64]
FINISH = Roughness(rms=2e-6, correlation_length=6e-5)
RADIUS = 0.01
TOP = SIZE[2] / 2
FAR = [(-0.15, 0.0, TOP), (0.15, 0.0, TOP)]


def heights(ways: Array) -> Array:
    return FINISH.layers(2).at(np.outer(ways, [0.0, 1.0, 0.0]))


def rolled(speed: float, ways: Array, load: float = 0.3) -> Array:
    rubbed = SlidingContact(roughness=FINISH, modulus=1.1e11, radius=RADIUS)
    envelope = Envelope(rubbed, RATE, heights, load)
    rows = len(ways) // 64 + 2
    return envelope.compressions(0, ways, ways, np.full(rows, speed), np.full(rows, load))


def test_a_ball_rests_where_it_touches_first() -> None:
    ways = np.arange(0, 0.02, 5e-6)
    found = rolled(0.2, ways)
    step = 2e-6
    grid = np.arange(-2e-3, 0.022, step)
    profile = heights(grid)
    apart = np.arange(-400, 401) * step
    lifted = np.array(
        [(profile[n : n + 801] - apart**2 / (2 * RADIUS)).max() for n in range(len(grid) - 800)]
    )
    felt = np.sqrt(3 / 5) * (3 * 0.3 * RADIUS / (4 * 1.1e11)) ** (1 / 3)

    def mean(half: float) -> Array:
        side = round(half / step)
        kernel = np.ones(2 * side + 1) / (2 * side + 1)
        return np.interp(ways, grid[400:-400], np.convolve(lifted, kernel, "same"))

    wanted = mean(felt) - mean(FOLLOWED_LENGTH / 2)
    inside = (ways > 2e-3) & (ways < 0.018)
    assert np.corrcoef(found[inside], wanted[inside])[0, 1] > 0.99


def test_it_bridges_valleys() -> None:
    ways = np.arange(0, 0.05, 4e-6)
    envelope = rolled(0.1, ways)
    waves, power = welch(envelope, 1 / 4e-6, nperseg=4096)
    _, below = welch(heights(ways), 1 / 4e-6, nperseg=4096)
    short = waves > 1 / 1e-4
    long = (waves > 1 / 1e-3) & (waves < 1 / 4e-4)
    relative = power / below
    assert relative[short].mean() < 0.05 * relative[long].mean()


def test_the_same_place_feels_the_same_in_any_order() -> None:
    rubbed = SlidingContact(roughness=FINISH, modulus=1.1e11, radius=RADIUS)
    rows = np.full(3, 0.1), np.full(3, 0.3)
    ways = [start + np.arange(1, 65) * 2e-6 for start in (0.0, 0.3, 0.1, 0.3001, 0.0)]
    envelope = Envelope(rubbed, RATE, heights, 0.3)
    found = [envelope.compressions(0, way, way, *rows) for way in ways]
    assert found[-1] == pytest.approx(found[0], rel=1e-9, abs=1e-12)
    alone = Envelope(rubbed, RATE, heights, 0.3).compressions(0, ways[1], ways[1], *rows)
    assert found[1] == pytest.approx(alone, rel=1e-6, abs=1e-9)


def test_the_roller_comes_round_and_nothing_else_does() -> None:
    ball = Roller(radius=RADIUS, layers=FINISH.layers(1), roundness=3e-6, seed=4)
    around = 2 * np.pi * RADIUS
    ways = np.random.default_rng(0).uniform(0, around, 4000)
    assert np.abs(ball.heights(ways + 7 * around) - ball.heights(ways)).max() < 1e-12
    assert ball.heights(ways).std() == pytest.approx(np.hypot(2e-6, 3e-6), rel=0.1)
    other = Roller(radius=RADIUS, layers=FINISH.layers(1), roundness=3e-6, seed=5)
    assert np.abs(other.heights(ways) - ball.heights(ways)).max() > 1e-6


@pytest.mark.prove
def test_rolling_repeats_with_the_wheel_alone() -> None:
    """A smooth wheel on a rough plane has no period, a rough one on a smooth plane its own."""
    ways = np.arange(1, 1 << 18) * (0.5 / RATE)
    rubbed = SlidingContact(roughness=FINISH, modulus=1.1e11, radius=RADIUS)
    ball = Roller(radius=RADIUS, layers=FINISH.layers(1))
    turn = round(2 * np.pi * RADIUS / 0.5 * RATE)

    def likeness(profile: object) -> Array:
        envelope = Envelope(rubbed, RATE, profile, 0.3)
        rows = np.full(len(ways) // 64 + 2, 0.5), np.full(len(ways) // 64 + 2, 0.3)
        felt = envelope.compressions(0, ways, ways, *rows)
        spectrum = np.fft.rfft(felt, 1 << 19)
        found = np.fft.irfft(np.square(np.abs(spectrum)))[: len(ways) // 2]
        return np.abs(found / found[0])

    plane = likeness(heights)
    assert plane[round(0.05 * RATE) :].max() < 0.05
    wheel = likeness(ball.heights)
    assert wheel[turn - 1 : turn + 2].max() > 0.9
    assert wheel[round(0.05 * RATE) : turn - 48].max() < 0.2


def test_faster_is_louder_and_brighter_and_too_fast_is_silent() -> None:
    slow, fast = (
        force(Roll(path=FAR, radius=RADIUS, speed=v, mass=0.03, repeat="back")) for v in (0.1, 0.2)
    )
    assert centroid(fast) == pytest.approx(2 * centroid(slow), rel=0.15)
    assert 3 < 20 * np.log10(fast.std() / slow.std()) < 6
    wild = force(Roll(path=FAR, radius=RADIUS, speed=1e6, mass=0.03, repeat="loop"), 0.1)
    assert np.all(np.isfinite(wild))
    assert np.abs(wild).max() < 1e-3


def test_rougher_and_less_round_rollers_are_louder() -> None:
    def loudness(**change: object) -> float:
        options = {"path": FAR, "radius": RADIUS, "speed": 0.3, "mass": 0.03, "repeat": "back"}
        options |= {"roughness": "glass", "roller_roughness": "glass", "roundness": 0.0}
        return float(force(Roll(**{**options, **change})).std())

    smooth = loudness()
    assert loudness(roller_roughness="steel") > 2 * smooth
    assert loudness(roughness="steel") > 2 * smooth
    assert loudness(roundness=1e-5) > 1.2 * smooth

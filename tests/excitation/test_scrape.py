"""Scrapes and rolls: brightness, loudness, repetition, and independence of block lengths."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import welch

from struck.errors import OptionError
from struck.excitation.friction import Rubbed, pressure_mean
from struck.excitation.roughness import Roughness
from struck.excitation.scrape import Roll, Scrape
from tests.excitation.bodies import SIZE, plate
from tests.yardstick import transforms

RATE = 48000.0
TOP = SIZE[2] / 2
ENDS = [(-0.15, 0.0, TOP), (0.15, 0.05, TOP)]
SMOOTH = Roughness.fractal(rms=1e-9, exponent=1.0, shortest=2e-4, longest=2e-3)
ROUGH = Roughness.fractal(rms=2e-5, exponent=1.0, shortest=2e-4, longest=2e-3)


def scrape(**changes: object) -> Scrape:
    options = {"path": ENDS, "speed": 0.1, "load": 1.0, "repeat": "back", "radius": 1e-3}
    return Scrape(**{**options, **changes})


def force(excitation: Scrape | Roll, seconds: float = 1.0, block: int = 1024) -> np.ndarray:
    pushing = excitation.begin(plate(40), RATE)
    blocks = []
    for _ in range(round(seconds * RATE) // block):
        push = pushing.advance(block)
        blocks.append(np.zeros(block) if push is None else push.force)
    return np.concatenate(blocks)


def quantiles(signal: np.ndarray) -> np.ndarray:
    """Return the frequencies below which 25, 50 and 75 % of the power lie."""
    frequencies, power = welch(signal, RATE, nperseg=8192)
    below = np.cumsum(power) / power.sum()
    return np.interp([0.25, 0.5, 0.75], below, frequencies)


@pytest.mark.parametrize("roughness", ["sandpaper", "wood", "concrete"])
@pytest.mark.parametrize("speed", [pytest.param(0.1, marks=pytest.mark.prove), 0.2])
def test_twice_the_speed_is_an_octave_higher(roughness: str, speed: float) -> None:
    # The same stretch of the surface is heard both times.
    slow = force(scrape(speed=speed, roughness=roughness), 0.4 / speed)
    fast = force(scrape(speed=2 * speed, roughness=roughness), 0.2 / speed)
    assert quantiles(fast) == pytest.approx(2 * quantiles(slow), rel=0.05)
    assert fast.std() == pytest.approx(slow.std(), rel=0.05)


def test_a_recorded_profile_is_read_at_the_speed_of_contact() -> None:
    heights = 1e-9 * np.sin(2 * np.pi * np.arange(4000) / 40)  # waves of 2 mm
    waves = Roughness(heights=heights, pitch=5e-5)
    for speed in (0.05, 0.5, 3.0):
        signal = force(scrape(speed=speed, roughness=waves), 1.0)[4096:]
        frequencies, power = welch(signal, RATE, nperseg=16384)
        assert frequencies[np.argmax(power)] == pytest.approx(speed / 2e-3, abs=3.0)


def test_what_the_samples_cannot_carry_does_not_fold() -> None:
    heights = 1e-9 * np.sin(2 * np.pi * np.arange(4000) / 20)  # waves of 1 mm
    waves = Roughness(heights=heights, pitch=5e-5)
    heard = force(scrape(speed=10.0, roughness=waves)).std()  # 10 kHz
    folded = force(scrape(speed=30.0, roughness=waves)).std()  # 30 kHz
    assert folded < 1e-3 * heard


def test_twice_the_load_on_a_smooth_surface_is_louder_by_its_cube_root() -> None:
    loads = [force(scrape(load=load, roughness=SMOOTH)).std() for load in (0.5, 1.0, 2.0)]
    assert loads[1] / loads[0] == pytest.approx(2 ** (1 / 3), rel=0.01)
    assert loads[2] / loads[1] == pytest.approx(2 ** (1 / 3), rel=0.01)


def test_twice_the_load_on_a_rough_surface_is_twice_as_loud() -> None:
    light, heavy = (force(scrape(load=load, roughness=ROUGH)).std() for load in (0.5, 1.0))
    assert heavy / light == pytest.approx(2, rel=0.03)


def test_on_a_smooth_surface_the_force_is_the_slope_of_hertz_s_law_times_the_height() -> None:
    long = Roughness.fractal(rms=1e-9, exponent=1.0, shortest=2e-3, longest=2e-2)
    rubbed = Rubbed(roughness=long, modulus=1e11, radius=1e-3)
    load = 0.7

    def pressed(dent: float) -> float:
        return 4 / 3 * 1e11 * np.sqrt(1e-3) * dent**1.5

    dent = (load / pressed(1.0)) ** (2 / 3)
    slope = (pressed(dent * 1.0001) - pressed(dent * 0.9999)) / (2e-4 * dent)
    assert rubbed.stiffness(load) == pytest.approx(slope, rel=1e-6)
    assert rubbed.contact_radius(load) == pytest.approx(np.sqrt(1e-3 * dent), rel=1e-9)
    assert rubbed.force(load)[::2] == pytest.approx(slope * long.heights, abs=0.01 * slope * 1e-9)


@pytest.mark.parametrize("turns", [0.01, 0.09, 0.11, 2.0, 9.0])
def test_a_contact_feels_the_mean_over_its_pressure(turns: float) -> None:
    def over_the_circle(x: float) -> float:  # the pressure summed across the way
        return np.pi / 2 * (1 - x**2)

    weighted = quad(lambda x: over_the_circle(x) * np.cos(turns * x), -1, 1)[0]
    total = quad(over_the_circle, -1, 1)[0]
    assert float(pressure_mean(np.array(turns))) == pytest.approx(weighted / total, abs=1e-7)


@pytest.mark.parametrize("roughness", ["sandpaper", "wood", "plywood", "fabric", "concrete"])
def test_the_force_never_pulls(roughness: str) -> None:
    signal = force(scrape(load=2.0, roughness=roughness, speed=0.3), 2.0)
    assert signal.min() >= -2.0
    assert abs(signal[4800:].mean()) < 0.05 * signal.std()


def test_a_flat_spot_comes_round_with_every_turn() -> None:
    mirror = Roughness.fractal(rms=1e-10, exponent=1.0, shortest=1e-3, longest=1e-2)
    for radius, speed in ((0.01, 0.3), (0.025, 0.8)):
        roll = Roll(
            path=ENDS,
            radius=radius,
            speed=speed,
            mass=0.05,
            flat=5e-7,
            roughness=mirror,
            roller_roughness=mirror,
            repeat="back",
        )
        signal = force(roll, 3.0)[4800:]
        spectrum = np.abs(np.fft.rfft(signal * np.hanning(len(signal)), 1 << 20))
        frequencies = np.fft.rfftfreq(1 << 20, 1 / RATE)
        turning = speed / (2 * np.pi * radius)
        for harmonic in (1, 2, 3):
            near = np.abs(frequencies - harmonic * turning) < turning / 2
            peak = frequencies[near][np.argmax(spectrum[near])]
            assert peak == pytest.approx(harmonic * turning, rel=0.01)


def test_rolling_is_duller_than_scraping_with_a_tip() -> None:
    roll = Roll(path=ENDS, radius=0.02, speed=0.2, load=1.0, roughness="wood", repeat="back")
    tip = scrape(speed=0.2, roughness="wood")
    assert np.all(quantiles(force(roll)) < 0.8 * quantiles(force(tip)))


@pytest.mark.parametrize(
    "excitation",
    [
        scrape(speed=lambda t: 0.1 + 0.05 * np.sin(9 * t), load=([0, 0.1], [0.5, 3.0]), time=0.013),
        scrape(repeat="once", path=[(0, 0, TOP), (0.01, 0, TOP)], speed=([0, 0.1], [0.0, 0.2])),
        Roll(path=ENDS, radius=0.01, mass=0.02, speed=0.2, seconds=0.1),
    ],
)
@pytest.mark.parametrize(
    ("block", "samples"),
    [(1, 1000), (17, 8192), (128, 8192), pytest.param(1, 8192, marks=pytest.mark.prove)],
)
def test_force_does_not_depend_on_the_blocks(
    excitation: Scrape | Roll, block: int, samples: int
) -> None:
    whole = force(excitation, 4096 * 2 / RATE, 4096)
    assert np.abs(whole[:samples]).max() > 0
    parts = force(excitation, samples / RATE, block)
    assert np.array_equal(parts, whole[: len(parts)])


def test_a_later_start_joins_in() -> None:
    whole = force(scrape(time=0.01), 0.5)
    pushing = scrape(time=0.01).begin(plate(40), RATE, start=5000)
    late = np.concatenate([pushing.advance(100).force for _ in range(50)])
    assert np.array_equal(late, whole[5000:10000])


def test_it_ends_where_the_path_ends_and_comes_and_goes_softly() -> None:
    short = scrape(path=[(0, 0, TOP), (0.02, 0, TOP)], repeat="once", speed=0.2)
    pushing = short.begin(plate(40), RATE)
    signal = np.zeros(9600)
    for begin in range(0, 9600, 128):
        push = pushing.advance(128)
        if push is not None:
            signal[begin : begin + 128] = push.force
    assert pushing.finished
    assert np.flatnonzero(signal)[-1] == pytest.approx(0.105 * RATE, abs=10)
    assert np.abs(signal[:24]).max() < 0.1 * np.abs(signal).max()


def test_the_drive_moves_along_the_path() -> None:
    pushing = scrape(path=[(-0.1, 0, TOP), (0.1, 0, TOP)], speed=1.0).begin(plate(40), RATE)
    for block in range(1, 20):
        place = np.array([-0.1 + block * 128 / RATE, 0, TOP])
        expected = plate(40).gains.at(place[None], np.array([[0, 0, -1.0]]))[0, 0]
        assert pushing.advance(128).drive == pytest.approx(expected, abs=1e-4)


def test_seeds_repeat() -> None:
    one, same, other = (force(scrape(seed=seed), 0.2) for seed in (1, 1, 2))
    assert np.array_equal(one, same)
    assert not np.allclose(one, other)


def test_a_block_takes_little_time() -> None:
    """Usually 0.05 transforms."""
    pushing = scrape().begin(plate(40), RATE)
    pushing.advance(128)
    assert transforms(lambda: pushing.advance(128), turns=100) < 0.3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"speed": -0.1}, r"speed is -0\.1: .* at least 0"),
        ({"speed": np.nan}, "speed is nan"),
        ({"speed": ([0, 1], [0.1])}, "as many each"),
        ({"speed": ([1, 0], [0.1, 0.2])}, "ascend"),
        ({"speed": "fast"}, "speed is 'fast'"),
        ({"load": np.inf}, "load is inf"),
        ({"load": ([0, 1], [1.0, -1.0])}, r"load is -1\.0"),
        ({"radius": 0.0}, r"radius is 0\.0"),
        ({"seconds": -1.0}, r"seconds is -1\.0"),
        ({"patch": -1e-3}, r"patch is -0\.001"),
        ({"time": np.nan}, "time is nan"),
        ({"roughness": "sand"}, "no roughness is called"),
        ({"striker": "stel"}, "did you mean steel"),
        ({"repeat": "twice"}, "repeat is 'twice'"),
        ({"path": [(0, 0, TOP)]}, "two places or more"),
        ({"path": [(0, 0, TOP), (np.nan, 0, 0)]}, "finite"),
    ],
)
def test_impossible_scrapes_are_refused(changes: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        scrape(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mass": None}, "give one of them"),
        ({"load": 1.0}, "give one of them"),
        ({"mass": -1.0}, r"mass is -1\.0"),
        ({"radius": 0.0}, r"radius is 0\.0"),
        ({"flat": 0.01}, "below the radius"),
        ({"flat": -1e-6}, "flat is"),
    ],
)
def test_impossible_rolls_are_refused(changes: dict[str, object], message: str) -> None:
    options = {"path": ENDS, "radius": 0.01, "speed": 0.1, "mass": 0.02}
    with pytest.raises(OptionError, match=message):
        Roll(**{**options, **changes})


def test_a_speed_that_goes_bad_on_the_way_is_an_error_and_no_sample() -> None:
    pushing = scrape(speed=lambda t: 0.1 if t < 0.01 else np.nan).begin(plate(40), RATE)
    assert np.isfinite(pushing.advance(384).force).all()
    with pytest.raises(OptionError, match="speed is nan"):
        pushing.advance(384)

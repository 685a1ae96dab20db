"""Scrapes and rolls: brightness, loudness, repetition, and independence of block lengths."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.signal import welch

from struck.errors import OptionError
from struck.excitation.roughness import Profile, Roughness
from struck.excitation.scrape import Roll, Scrape
from struck.excitation.scraping_force import SlidingContact, patch_mean, pressure_mean
from tests.excitation.bodies import SIZE, plate
from tests.yardstick import transforms

RATE = 48000.0
TOP = SIZE[2] / 2
ENDS = [(-0.15, 0.0, TOP), (0.15, 0.05, TOP)]
SMOOTH = Roughness(rms=1e-11, correlation_length=2e-4, slope=-4.0, shortest=2e-4)
ROUGH = Roughness(rms=3e-4, correlation_length=2e-4, slope=-4.0, shortest=2e-4)
LADDER = ["sandpaper p80", "rough wood", "wood", "steel", "glass"]


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
    frequencies, power = welch(signal, RATE, nperseg=32768)
    below = np.cumsum(power) / power.sum()
    return np.interp([0.25, 0.5, 0.75], below, frequencies)


def level(signal: np.ndarray) -> float:
    """Return the level of a force from 100 Hz to 10 kHz, dB re 1 N."""
    frequencies, power = welch(signal, RATE, nperseg=8192)
    inside = (frequencies >= 100) & (frequencies <= 10_000)
    return float(10 * np.log10(power[inside].sum() * frequencies[1]))


@pytest.mark.parametrize("roughness", ["sandpaper", "wood", "steel"])
@pytest.mark.parametrize("speed", [pytest.param(0.05, marks=pytest.mark.prove), 0.1])
def test_twice_the_speed_is_an_octave_higher(roughness: str, speed: float) -> None:
    # The same stretch of the surface is heard both times.
    slow = force(scrape(speed=speed, roughness=roughness), 0.4 / speed)
    fast = force(scrape(speed=2 * speed, roughness=roughness), 0.2 / speed)
    assert quantiles(fast) == pytest.approx(2 * quantiles(slow), rel=0.05)
    assert fast.std() / slow.std() == pytest.approx(2**0.75, rel=0.05)
    assert centroid(fast) == pytest.approx(2 * centroid(slow), rel=0.06)


def centroid(signal: np.ndarray) -> float:
    frequencies, power = welch(signal, RATE, nperseg=8192)
    return float(frequencies @ power / power.sum())


@pytest.mark.parametrize(
    "speed", [0.1, *(pytest.param(v, marks=pytest.mark.prove) for v in (0.02, 1))]
)
@pytest.mark.parametrize(
    "load", [1.0, *(pytest.param(n, marks=pytest.mark.prove) for n in (0.1, 10))]
)
def test_rougher_surfaces_are_louder(speed: float, load: float) -> None:
    levels = [level(force(scrape(speed=speed, load=load, roughness=name))) for name in LADDER]
    assert np.all(np.diff(levels) < -3)


@pytest.mark.parametrize("roughness", LADDER)
def test_the_level_rises_with_speed_as_measured(roughness: str) -> None:
    """Of rubbing noise by the power 3/4 of speed, 4.5 dB a doubling: see friction.py."""
    speeds = np.array([0.02, 0.08, 0.3, 1.0])
    levels = [level(force(scrape(speed=v, roughness=roughness))) for v in speeds.tolist()]
    assert np.all(np.diff(levels) > 0)
    assert 4 < np.polyfit(np.log2(speeds), levels, 1)[0] < 6


@pytest.mark.parametrize("roughness", LADDER)
def test_the_level_rises_with_load(roughness: str) -> None:
    levels = [level(force(scrape(load=n, roughness=roughness))) for n in (0.1, 1.0, 10.0)]
    assert np.all(np.diff(levels) > 4)


def test_a_recorded_profile_is_read_at_the_speed_of_contact() -> None:
    heights = 1e-9 * np.sin(2 * np.pi * np.arange(4000) / 40)  # waves of 2 mm
    waves = Profile(heights=heights, pitch=5e-5)
    for speed in (0.05, 0.5, 3.0):
        signal = force(scrape(speed=speed, roughness=waves), 1.0)[4096:]
        frequencies, power = welch(signal, RATE, nperseg=16384)
        assert frequencies[np.argmax(power)] == pytest.approx(speed / 2e-3, abs=3.0)


def test_what_the_samples_cannot_carry_does_not_fold() -> None:
    heights = 1e-9 * np.sin(2 * np.pi * np.arange(4000) / 20)  # waves of 1 mm
    waves = Profile(heights=heights, pitch=5e-5)
    heard = force(scrape(speed=10.0, roughness=waves)).std()  # 10 kHz
    folded = force(scrape(speed=30.0, roughness=waves)).std()  # 30 kHz
    assert folded < 1e-3 * heard


def test_twice_the_load_on_a_smooth_surface_is_louder_by_its_cube_root() -> None:
    loads = [force(scrape(load=load, roughness=SMOOTH)).std() for load in (0.05, 0.1, 0.2)]
    assert loads[1] / loads[0] == pytest.approx(2 ** (1 / 3), rel=0.03)
    assert loads[2] / loads[1] == pytest.approx(2 ** (1 / 3), rel=0.03)


def test_twice_the_load_on_a_rough_surface_is_louder_by_0_73_powers() -> None:
    loads = [force(scrape(load=load, roughness=ROUGH)).std() for load in (0.05, 0.1)]
    assert loads[1] / loads[0] == pytest.approx(2 ** (1 - 0.4 * 2 / 3), rel=0.05)


def test_on_a_smooth_surface_the_force_is_a_share_of_hertz_s_law_times_the_height() -> None:
    rubbed = SlidingContact(roughness=SMOOTH, modulus=1e11, radius=1e-3)
    load = 0.7

    def pressed(dent: float) -> float:
        return 4 / 3 * 1e11 * np.sqrt(1e-3) * dent**1.5

    dent = (load / pressed(1.0)) ** (2 / 3)
    slope = (pressed(dent * 1.0001) - pressed(dent * 0.9999)) / (2e-4 * dent)
    held = np.array(load)
    assert rubbed.stiffness(held) == pytest.approx(slope, rel=1e-6)
    assert rubbed.contact_radius(held) == pytest.approx(np.sqrt(1e-3 * dent), rel=1e-9)
    share = rubbed.scale(np.array(1e-15), np.array([0.0, 1.0, 1e9]), held) * load / slope
    assert share == pytest.approx([0, 0.05, 1], rel=1e-3)


def test_a_wide_contact_averages_a_layer_away() -> None:
    shares = patch_mean(np.log([1e-6, 0.01, 0.3, 1.0, 10.0, 1e9]))
    assert shares[:2] == pytest.approx(1, abs=1e-3)
    assert np.all(np.diff(shares[1:]) < 0)
    assert shares[-1] < 0.03


@pytest.mark.parametrize("turns", [0.01, 0.09, 0.11, 2.0, 9.0])
def test_a_contact_feels_the_mean_over_its_pressure(turns: float) -> None:
    def over_the_circle(x: float) -> float:  # the pressure summed across the way
        return np.pi / 2 * (1 - x**2)

    weighted = quad(lambda x: over_the_circle(x) * np.cos(turns * x), -1, 1)[0]
    total = quad(over_the_circle, -1, 1)[0]
    assert float(pressure_mean(np.array(turns))) == pytest.approx(weighted / total, abs=1e-7)


@pytest.mark.parametrize("roughness", ["sandpaper p40", "rough wood", "fabric", "concrete"])
def test_the_force_never_pulls(roughness: str) -> None:
    signal = force(scrape(load=2.0, roughness=roughness, speed=2.0), 2.0)
    assert -2.0 <= signal.min() < -0.3
    assert abs(signal[4800:].mean()) < 0.1 * signal.std()


@pytest.mark.prove
def test_a_flat_spot_comes_round_with_every_turn() -> None:
    mirror = Roughness(rms=1e-12, correlation_length=1e-3)
    for radius, speed in ((0.01, 0.3), (0.025, 0.8)):
        roll = Roll(
            path=ENDS,
            radius=radius,
            speed=speed,
            mass=0.05,
            flat=5e-7,
            roundness=0.0,
            roughness=mirror,
            roller_roughness=mirror,
            repeat="back",
        )
        signal = force(roll, 3.0)[4800:]
        spectrum = np.abs(np.fft.rfft(signal * np.hanning(len(signal)), 1 << 20))
        frequencies = np.fft.rfftfreq(1 << 20, 1 / RATE)
        turning = speed / (2 * np.pi * radius)
        for harmonic in (10, 20, 50):  # lower ones are followed
            near = np.abs(frequencies - harmonic * turning) < turning / 2
            peak = frequencies[near][np.argmax(spectrum[near])]
            assert peak == pytest.approx(harmonic * turning, rel=0.01)


def test_rolling_is_duller_than_scraping_with_a_tip() -> None:
    roll = Roll(path=ENDS, radius=0.02, speed=0.2, load=1.0, roughness="wood", repeat="back")
    tip = scrape(speed=0.2, roughness="wood")
    assert centroid(force(roll)) < 0.7 * centroid(force(tip))


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
        ({"roughness": "sand"}, "roughness is"),
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
        ({"roundness": 0.02}, r"roundness is 0\.02 m: it must lie below the radius"),
        ({"roughness": Profile.named("wood")}, "takes text or a Roughness"),
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


@pytest.mark.parametrize("seconds", [2**63, 1e99])
def test_an_end_beyond_all_samples_changes_nothing(seconds: float) -> None:
    for kind in (scrape, lambda **end: Roll(path=ENDS, speed=0.1, radius=0.01, mass=0.05, **end)):
        np.testing.assert_array_equal(force(kind(seconds=seconds), 0.1), force(kind(), 0.1))

"""Force tracks whose contact is soft or rough: impulse, spectrum, level, bad input."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from struck.errors import OptionError
from struck.excitation.force_track import ForceTrack
from struck.excitation.pulses import LEAD, SOFTNESS
from struck.excitation.roughness import Profile
from struck.excitation.scraping_force import Reader, Tool, force_variation
from struck.excitation.texture import CHUNK
from struck.excitation.touch import DEFAULT_RATE, TouchLog
from struck.model.arrays import Array
from tests.excitation.bodies import SIZE, plate

RATE = 48000.0
PLACE = (0.05, 0.03, SIZE[2] / 2)
BLOWS = np.where(np.random.default_rng(7).random(4800) < 0.01, 30.0, 0.0)


def track(force: Array, **options: object) -> ForceTrack:
    return ForceTrack(at=PLACE, force=force, sample_rate=RATE, **options)


def heard(given: ForceTrack, length: int) -> Array:
    """Return the force from `LEAD` samples before the first one on."""
    push = given.begin(plate(8), RATE, start=-LEAD).advance(length + LEAD)
    assert push is not None
    return push.force


@pytest.mark.parametrize("kernel", ["gaussian", "half-sine", "hertz"])
@pytest.mark.parametrize("softness", [1e-6, 1e-3, 0.0213])
def test_a_kernel_keeps_the_impulse(kernel: str, softness: float) -> None:
    soft = heard(track(BLOWS, kernel=kernel, softness=softness), 8192)
    assert soft.sum() == pytest.approx(BLOWS.sum(), rel=1e-12)
    # Nor does it move: the middle of the force is later by half the kernel.
    middle = soft @ np.arange(-LEAD, 8192) / soft.sum()
    late = BLOWS @ np.arange(4800) / BLOWS.sum() + softness / 2 * RATE
    assert middle == pytest.approx(late, abs=0.01)


def test_the_kernel_has_the_spectrum_of_a_gaussian() -> None:
    frequencies = np.linspace(0, 700, 71)
    times = np.arange(-LEAD, 8192) / RATE
    soft = heard(track(np.eye(1, 100, 40)[0], kernel="Gaussian"), 8192)
    found = np.abs(np.exp(-2j * np.pi * np.outer(frequencies, times)) @ soft)
    # The transform of a Gaussian of deviation T / 6, cut at three of them.
    edge = 3 / np.sqrt(2)
    turns = np.sqrt(2) * np.pi * frequencies * SOFTNESS / 6
    law = np.exp(-(turns**2)) * erf(edge + 1j * turns).real / erf(edge)
    assert law[-1] < 0.1
    assert 20 * np.log10(found / law) == pytest.approx(np.zeros(71), abs=0.1)


@pytest.mark.parametrize("roughness", ["wood", Profile.named("wood")])
def test_a_surface_sounds_as_its_reader_says(roughness: str | Profile) -> None:
    count, speed, load = 50_000, 0.15, 2.0  # longer than is read at once
    given = track(np.full(count, load), roughness=roughness, speed=speed, seed=3)
    noise = heard(given, count)[LEAD:] - load
    ways = np.arange(1, count + 1) * (speed / RATE)
    rows = -(-count // CHUNK) + 1
    reader = Reader(Tool(roughness=roughness, striker="steel", seed=3).on(plate(8)), RATE)
    places = np.column_stack([ways, np.zeros((count, 2))])
    looks = np.full(rows, speed), np.full(rows, load)
    expected = force_variation(reader.compressions(0, places, ways, *looks), np.full(count, load))
    assert expected.std() > 1e-4
    assert noise == pytest.approx(expected, abs=1e-6 * expected.std())


def test_the_noise_follows_force_and_speed() -> None:
    count = 48_000
    moments = np.arange(count) / RATE
    swell = np.where(moments < 0.5, 1.0, -1.0)
    rough = track(swell, roughness="wood", speed=((0.0, 0.25, 0.26), (0.1, 0.1, 0.0)))
    noise = heard(rough, count)[LEAD:] - swell
    assert noise[:12_000].std() > 1e-4
    assert np.abs(noise[12_600:]).max() == 0  # at rest, and where the force pulls
    # A blow that is shorter than the time between two looks is rough too, and never pulls.
    blow = np.zeros(640)
    blow[230] = 50.0
    force = heard(track(blow, roughness="sandpaper", speed=0.5), 640)[LEAD:]
    assert force[230] != 50.0
    assert force[230] > 0
    assert not np.delete(force, 230).any()


def test_blows_of_a_kernel_are_rough_under_it() -> None:
    soft = heard(track(BLOWS, kernel="gaussian"), 6000)
    both = heard(track(BLOWS, kernel="gaussian", roughness="sandpaper", speed=0.3), 6000)
    # The noise is less than the load, so both are pushes wherever the kernel pushes.
    assert np.abs(both - soft).max() > 0.01 * soft.max()
    assert np.all(np.abs(both - soft) <= 0.8 * np.maximum(soft, 0))


def test_a_track_of_itself_is_what_it_was() -> None:
    assert np.array_equal(heard(track(BLOWS), 4800)[LEAD:], BLOWS)
    other = track(BLOWS).sampled(44100.0)
    given = ForceTrack(force=BLOWS, sample_rate=RATE, kernel="gaussian", softness=0.01)
    assert given.sampled(44100.0).force.sum() == pytest.approx(other.force.sum(), rel=1e-12)


@pytest.mark.parametrize("kernel", ["gaussian", "half-sine", "hertz"])
def test_loads_of_a_log_are_spread_over_the_kernel_of_its_tool(kernel: str) -> None:
    tool = Tool(kernel=kernel, softness=2e-3)
    log = TouchLog(times=[0.0, 0.05], points=[PLACE] * 2, forces=[3.0, 3.0], tool=tool)
    push = log.begin(plate(8), RATE).advance(2400)
    # The first touch is pressed on in a straight line, as long as updates usually lie apart.
    ramp = 3.0 * np.minimum(np.arange(1, 2401) / (RATE / DEFAULT_RATE), 1.0)
    assert push is not None
    wanted = heard(track(ramp, kernel=kernel, softness=2e-3), 2400 - LEAD)
    assert push.force == pytest.approx(wanted, abs=1e-12)


def test_a_kernel_of_a_tool_is_short() -> None:
    with pytest.raises(OptionError, match=r"softness is 0\.2 s: it must be at most 0\.1 s"):
        Tool(kernel="gaussian", softness=0.2)
    with pytest.raises(OptionError, match="did you mean gaussian"):
        Tool(kernel="gausian")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"kernel": "gausian"}, "kernel is 'gausian': did you mean gaussian"),
        ({"kernel": "gaussian", "softness": 0.0}, r"softness is 0\.0: .*above 0"),
        ({"kernel": "gaussian", "softness": -1e-3}, r"softness is -0\.001"),
        ({"kernel": "gaussian", "softness": np.nan}, "softness is nan"),
        ({"kernel": "gaussian", "softness": 1e6}, "must be at most 60"),
        ({"softness": 1e-3}, r"softness is 0\.001 s, but of what"),
        ({"roughness": "wood"}, "roughness is 'wood' and nothing moves: give the speed="),
        ({"roughness": "wod", "speed": 0.1}, "did you mean wood"),
        ({"roughness": "wood", "speed": -0.1}, r"speed is -0\.1"),
        ({"speed": 0.1}, r"speed is 0\.1, but on which surface"),
        ({"radius": 0.1}, r"radius is 0\.1, but on which surface"),
        ({"roughness": "wood", "speed": 0.1, "striker": "stel"}, "did you mean steel"),
    ],
)
def test_impossible_contacts_are_refused(options: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        track(BLOWS, **options)

"""A touch that is told from outside what to do."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.errors import ContactError, OptionError
from struck.excitation.scrape import Scrape
from struck.excitation.scraping_force import Tool
from struck.excitation.touch import Touching, TouchLog
from tests.excitation.bodies import plate

Array = NDArray[np.float64]
RATE = 48000
DELAY = round(1e-3 * RATE)  # half the window that smooths
TOP = (0.05, 0.0, 0.01)


def forces(
    loads: Array, *, rate: float, speed: float = 0.0, blocks: tuple[int, ...] = (512,)
) -> Array:
    """Return the force of loads told `rate` times a second, made in blocks of these lengths."""
    log = TouchLog(
        times=np.arange(len(loads)) / rate,
        points=np.tile(TOP, (len(loads), 1)),
        forces=loads,
        speeds=speed,
    )
    pushing = log.begin(plate(8), RATE)
    made, number, length = [], 0, round(len(loads) / rate * RATE)
    while sum(map(len, made)) < length:
        block = blocks[number % len(blocks)]
        push = pushing.advance(block)
        made.append(np.zeros(block) if push is None else push.force)
        number += 1
    return np.concatenate(made)[:length]


@pytest.mark.parametrize("rate", [60.0, 100.0, 333.0, 1000.0])
def test_the_force_follows_the_load_an_update_later(rate: float) -> None:
    times = np.arange(int(rate)) / rate
    loads = 2 + np.sin(2 * np.pi * 3 * times)
    force = forces(loads, rate=rate)
    late = DELAY + RATE / rate
    expected = 2 + np.sin(2 * np.pi * 3 * (np.arange(RATE) - late) / RATE)
    settled = slice(RATE // 4, None)
    # Straight lines between samples of a sine miss it by (2 pi f / rate)^2 / 8.
    bound = (2 * np.pi * 3 / rate) ** 2 / 8 + 0.01
    assert np.abs(force - expected)[settled].max() < bound


def test_a_steady_load_is_what_it_is() -> None:
    force = forces(np.full(50, 3.0), rate=100.0)
    assert np.ptp(force[RATE // 10 :]) < 1e-12
    assert force[-1] == pytest.approx(3.0, rel=1e-12)
    assert np.all(np.diff(force) >= -1e-12)


def test_nothing_of_the_rate_of_updates_is_heard_above_two_kilohertz() -> None:
    chance = np.random.default_rng(2)
    force = forces(chance.uniform(0.1, 5, 400), rate=100.0)
    spectrum = np.abs(np.fft.rfft(force * np.hanning(len(force)))) ** 2
    frequencies = np.fft.rfftfreq(len(force), 1 / RATE)
    heard = spectrum[frequencies > 2000].sum() / spectrum[frequencies > 5].sum()
    assert 10 * np.log10(heard) < -100


def test_the_force_does_not_depend_on_blocks() -> None:
    chance = np.random.default_rng(3)
    loads = chance.uniform(0.5, 4, 60) * (chance.random(60) > 0.2)
    loads[20:30] = 0
    expected = forces(loads, rate=100.0, speed=0.3)
    for blocks in ((64,), (1000,), (1, 17, 128, 300)):
        force = forces(loads, rate=100.0, speed=0.3, blocks=blocks)
        assert np.abs(force - expected).max() < 1e-9 * np.abs(expected).max()


def test_it_rubs_as_a_scrape_does() -> None:
    model, tool = plate(8), Tool()
    force = forces(np.full(200, 2.0), rate=100.0, speed=0.2)[RATE // 5 :] - 2.0
    scrape = Scrape(
        path=[(-0.1, 0.0, 0.01), (0.1, 0.0, 0.01)], speed=0.2, load=2.0, repeat="back",
        roughness=tool.roughness, striker=tool.striker,
    ).begin(model, RATE)  # fmt: skip
    pushes = [scrape.advance(480) for _ in range(180)]
    scraped = np.concatenate([push.force for push in pushes if push])[RATE // 5 :]
    assert np.std(force) == pytest.approx(np.std(scraped), rel=0.1)
    assert spread(force) == pytest.approx(spread(scraped), rel=0.1)


def spread(force: Array) -> float:
    """Return the mean frequency of the power spectrum, Hz."""
    power = np.abs(np.fft.rfft(force * np.hanning(len(force)))) ** 2
    return float(power @ np.fft.rfftfreq(len(force), 1 / RATE) / power.sum())


def test_let_go_it_is_silent_and_a_log_that_lets_go_ends() -> None:
    log = TouchLog(times=[0.0, 0.1, 0.2], points=[TOP] * 3, forces=[1, 1, 0], speeds=0.1)
    pushing = log.begin(plate(8), RATE)
    heard = [pushing.advance(128) for _ in range(400)]
    assert heard[10] is not None
    assert heard[-1] is None
    assert pushing.finished
    assert np.abs([push.force[-1] for push in heard if push][-1]) < 1e-12


def test_rest_may_be_left_out() -> None:
    asked, spared = Touching(plate(8), RATE), Touching(plate(8), RATE)
    assert asked.advance(130) is None
    spared.resume(130)
    for touching in (asked, spared):
        assert touching.at_rest
        touching.update(TOP, 2.0, 0.3)
        assert not touching.at_rest
        for _ in range(10):
            touching.advance(100)
        touching.update(TOP, 0.0)
        while touching.advance(100) is not None:
            pass
        assert touching.at_rest
    for _ in range(7):
        assert asked.advance(100) is None
    spared.resume(asked.now)
    for touching in (asked, spared):
        touching.update(TOP, 1.0, 0.2)
    for _ in range(20):
        one, other = asked.advance(100), spared.advance(100)
        assert one is not None
        assert other is not None
        assert np.array_equal(one.force, other.force)
        assert np.array_equal(one.drive, other.drive)


def test_the_drive_goes_to_the_new_place_in_a_straight_line() -> None:
    model = plate(20)
    touching = Touching(model, RATE)
    places = [(-0.1, 0.0, 0.01), (0.1, 0.02, 0.01)]
    ends = [
        model.gains.at(np.array([place]), np.array([[0.0, 0.0, -1.0]]))[0, 0] for place in places
    ]
    touching.update(places[0], 1.0)
    drives = [push.drive for push in (touching.advance(48) for _ in range(40)) if push]
    assert all(drive is drives[0] for drive in drives)
    assert drives[0] == pytest.approx(ends[0], rel=1e-6)
    touching.update(places[1], 1.0)
    moved = np.array([push.drive for push in (touching.advance(48) for _ in range(20)) if push])
    shares = np.minimum((np.arange(20) + 1) / 10, 1)[:, None]  # an update is 10 ms unless known
    expected = ends[0] + shares * (ends[1] - ends[0])
    assert moved == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_a_log_is_rendered_like_any_excitation() -> None:
    count = 50
    points = np.column_stack([np.linspace(-0.1, 0.1, count), np.zeros(count), np.full(count, 0.01)])
    log = TouchLog(times=np.arange(count) / 100, points=points, forces=2.0, speeds=0.4)
    sound = struck.render(plate(8), log, seconds=0.5)
    assert np.isfinite(sound.samples).all()
    assert np.abs(sound.samples).max() > 0


def test_a_log_that_leaves_the_body_says_so_when_it_does() -> None:
    points = [TOP, TOP, TOP, (1.0, 0.0, 0.0)]
    pushing = TouchLog(times=[0.0, 0.01, 0.02, 0.03], points=points, forces=1.0).begin(
        plate(8), RATE
    )
    for _ in range(11):  # blocks before 30 ms
        assert pushing.advance(128) is not None
    with pytest.raises(ContactError, match="off the body"):
        pushing.advance(128)


def test_drives_of_a_log_do_not_depend_on_blocks_and_are_those_of_its_places() -> None:
    times = np.arange(60) / 500
    points = np.column_stack([np.linspace(-0.1, 0.1, 60), np.zeros(60), np.full(60, 0.01)])
    log = TouchLog(times=times, points=points, forces=1.0, speeds=0.8)
    model = plate(8)
    even, uneven = log.begin(model, RATE), log.begin(model, RATE)
    for _ in range(20):
        push = even.advance(240)
        parts = [uneven.advance(length) for length in (100, 17, 123)]
        assert push is not None
        assert parts[-1] is not None
        assert parts[-1].drive == pytest.approx(push.drive, rel=1e-12, abs=1e-15)
        whole = np.concatenate([part.force for part in parts if part is not None])
        assert np.abs(whole - push.force).max() < 1e-9
    way = np.array([[0.0, 0.0, -1.0]])
    # An update is 10 ms unless known, then 2: in the end the last place but one is reached.
    ends = [model.gains.at(points[n : n + 1], way)[0, 0] for n in (46, 50)]
    low, high = np.minimum(*ends), np.maximum(*ends)
    assert np.all((push.drive >= low - 1e-9) & (push.drive <= high + 1e-9))


def test_where_the_point_stands_the_surface_moves_past() -> None:
    """A place that moves is felt where it is, one that stands at a speed all along a line."""
    model, count = plate(8), 400
    standing = TouchLog(
        times=np.arange(count) / 200, points=np.tile(TOP, (count, 1)), forces=1.0, speeds=0.3
    ).begin(model, RATE)
    force = np.concatenate([standing.advance(480).force for _ in range(190)])[RATE // 5 :]
    assert force.std() > 1e-3
    found = np.fft.irfft(np.abs(np.fft.rfft(force - force.mean(), 1 << 18)) ** 2)
    assert np.abs(found[2400:60_000]).max() < 0.15 * found[0]


@pytest.mark.parametrize("force", [np.nan, np.inf, -1.0, 1e7])
def test_impossible_loads_are_refused(force: float) -> None:
    with pytest.raises(OptionError, match="force"):
        Touching(plate(8), RATE).update(TOP, force)


def test_impossible_places_and_velocities_are_refused() -> None:
    touching = Touching(plate(8), RATE)
    with pytest.raises(ContactError, match="off the body"):
        touching.update((1.0, 0.0, 0.0), 1.0)
    with pytest.raises(OptionError, match="velocity"):
        touching.update(TOP, 1.0, (0.0, np.nan, 0.0))


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("times", [0.0, -1.0]),
        ("times", [0.2, 0.1]),
        ("times", []),
        ("points", [TOP]),
        ("forces", [1.0, np.nan]),
        ("forces", [1.0, -1.0]),
        ("forces", [1.0, 1.0, 1.0]),
        ("speeds", [0.0, np.inf]),
        ("directions", [(0.0, 0.0, 1.0)]),
    ],
)
def test_impossible_logs_are_refused(name: str, value: Any) -> None:  # noqa: ANN401 - whatever
    given: dict[str, Any] = {"times": [0.0, 0.1], "points": [TOP, TOP], "forces": [1.0, 1.0]}
    with pytest.raises(OptionError, match=name):
        TouchLog(**{**given, name: value})

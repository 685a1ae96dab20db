"""Scrapes, rolls, touches, holds and force tracks on recorded bodies, in their own coordinates."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.errors import ContactError, OptionError
from struck.excitation.excitation import Hold, Push
from struck.excitation.force_track import ForceTrack
from struck.excitation.path import Path
from struck.excitation.pulses import LEAD
from struck.excitation.scrape import Roll, Scrape
from struck.excitation.strike import Strike
from struck.excitation.touch import TouchLog
from struck.live.limiter import DELAY, limiter
from struck.model.model import ModalModel
from struck.synth.resonators import Resonators
from tests.excitation.recordings import HEARD, KINDS, PITCH, metres, path, recorded, shapes
from tests.live.hand import BLOCK, RATE, Make, by_hand

__all__ = ["by_hand"]
Array = NDArray[np.float64]
LATE = round(limiter(sample_rate=RATE, channels=2)[DELAY])
SPEED, NOWHERE = 0.4, np.zeros((1, 3))
MOVING = {
    "scrape": lambda ends: Scrape(path=ends, speed=SPEED, load=1.0, repeat="back"),
    "roll": lambda ends: Roll(path=ends, speed=SPEED, radius=0.01, mass=0.02, repeat="back"),
}


def sample(*chosen: tuple[str, str], kinds: tuple[str, ...], names: Iterable[str]) -> list[Any]:
    """Return all pairs of kind and name, but for the chosen ones for proofs alone."""
    return [
        pytest.param(*pair, marks=() if pair in chosen else pytest.mark.prove)
        for pair in itertools.product(kinds, names)
    ]


def drives_at(model: ModalModel, points: Array) -> Array:
    """Return what resonators are driven by at contacts (K, D): (K, R M)."""
    return model.gains.at(points, np.zeros((len(points), 3))).reshape(len(points), -1)


def log(kind: str, *, updates: int = 40, rate: float = 100.0) -> TouchLog:
    """Return a hand that goes there and back over a body, pressing harder and softer."""
    begin, end = path(kind)
    turns = np.arange(updates) / updates
    points = begin + np.abs(np.sin(np.pi * turns))[:, None] * (end - begin)
    return TouchLog(
        times=np.arange(updates) / rate,
        points=None if kind == "one" else points,
        forces=2 + np.sin(9 * turns),
        speeds=0.2,
    )


@pytest.mark.parametrize(
    ("kind", "name"),
    sample(
        ("one", "scrape"), ("field", "scrape"), ("plane", "scrape"), ("round", "scrape"),
        ("table", "scrape"), ("table", "roll"), kinds=KINDS, names=MOVING,
    ),
)  # fmt: skip
def test_scrapes_and_rolls_drive_as_the_gains_along_their_way(kind: str, name: str) -> None:
    model, ends = recorded(kind), path(kind)
    begun = MOVING[name](ends).begin(model.expanded(), RATE)
    pushes = [begun.advance(BLOCK) for _ in range(280)]
    ways = SPEED * BLOCK / RATE * np.arange(1, 281)
    whole = Path.over(model, ends, repeat="back")
    length = np.linalg.norm((ends[1] - ends[0]) * metres(kind))
    assert whole.length == pytest.approx(length, rel=1e-6)  # a cylinder's arc is of short chords
    shares = 1 - np.abs(ways / whole.length % 2 - 1)
    straight = ends[0] + shares[:, None] * (ends[1] - ends[0])
    points = np.stack([whole.at(way) for way in ways])
    assert np.abs(points - straight).max() < 1e-12
    assert ways[-1] > 1.2 * whole.length  # it turned
    expected = drives_at(model, points)
    found = np.stack([push.drive for push in pushes if push])
    assert np.abs(found - expected).max() < 1e-12
    assert kind == "one" or np.ptp(expected, axis=0).max() > 0.1


@pytest.mark.parametrize("kind", KINDS)
def test_touches_drive_as_the_gains_where_they_were_told(kind: str) -> None:
    model, touch = recorded(kind), log(kind)
    begun = touch.begin(model.expanded(), RATE)
    told = [model.contact().point] * 40 if touch.points is None else np.asarray(touch.points)
    found = [begun.advance(round(RATE / 100)).drive for _ in range(40)]
    assert np.abs(found - drives_at(model, np.stack(told))).max() < 1e-12


@pytest.mark.parametrize("kind", KINDS)
def test_holds_and_force_tracks_drive_as_the_gains_at_their_place(kind: str) -> None:
    model, place = recorded(kind), None if kind == "one" else path(kind)[0]
    where = model.contact(place).point
    track = ForceTrack(at=place, force=np.ones(300), sample_rate=RATE)
    push = track.begin(model.expanded(), RATE).advance(BLOCK)
    assert np.abs(push.drive - drives_at(model, where[None])[0]).max() < 1e-12
    raised = Hold(at=place, grip=3.0).raised(model)
    expected = 1.5 * drives_at(model, where[None])[0] ** 2
    if kind == "table":  # whose drives are weights, while a hand acts on what modes do there
        moved = shapes(np.linspace(0, 1, 5)[:, None])
        moved /= np.abs(moved).max(axis=0)
        weights = model.gains.at(where[None], NOWHERE)[0, :, 0]
        expected = np.tile(1.5 * (weights @ moved) ** 2, 5)
    assert np.abs(raised - expected).max() < 1e-12


def test_a_hand_takes_a_mode_of_a_table_away_by_its_decay() -> None:
    model = recorded("table")
    place = np.array([0.3])
    ringing = [Strike(at=(0.5,), time=0.05), Hold(at=place, grip=8.0)]
    sound = struck.render(model, ringing, seconds=1.2, fade=0, listener=HEARD)
    times = np.arange(round(0.2 * RATE), round(1.2 * RATE)) / RATE - 0.05
    drives = model.gains.at(np.array([[0.5]]), NOWHERE)[0]
    gains = (drives * model.gains.toward(np.array([HEARD]))[0]).sum(axis=0)
    raised = Hold(at=place, grip=8.0).raised(model)[: len(gains)]
    poles = -(model.decays + raised) + 2j * np.pi * model.frequencies
    expected = np.imag(np.exp(np.outer(times, poles)) @ gains)
    heard = sound.samples[0, round(0.2 * RATE) :]
    assert np.abs(heard - expected).max() < 2e-3 * np.abs(expected).max()
    assert any("a grip acts as on 1 kg" in note for note in sound.notes)


def test_a_hand_holds_a_body_of_one_place_live(by_hand: Make) -> None:
    ringing = []
    for grip in (0.0, 30.0):
        player = by_hand(recorded("one"), volume=-40, listener=HEARD)
        player.dampen(None, grip)
        player.hear(10)
        player.strike(impulse=1.0)
        ringing.append(np.abs(player.hear(100)[-BLOCK:]).max())
    assert 0 < ringing[1] < 0.1 * ringing[0]


@pytest.mark.parametrize("kind", KINDS)
def test_a_live_touch_sounds_as_its_log_offline(kind: str, by_hand: Make) -> None:
    model, touch = recorded(kind), log(kind)
    player = by_hand(model, volume=-40, listener=HEARD)
    player.hear(10)
    told, blocks = iter(range(40)), round(RATE / 100 / BLOCK)

    def move(block: int) -> None:
        number = next(told, None) if block % blocks == 0 else None
        if number is not None:
            force = float(np.asarray(touch.forces)[number])
            player.touch(touch.place(number)[0], force, 0.2)

    heard = player.hear(200, move)[LATE:] / player.gain
    again = struck.render(model, player.touch_log, seconds=0.6, fade=0, listener=HEARD)
    late = 10 * BLOCK
    assert_same(heard, again.samples[0][late:])
    assert "it was recorded at one place" in "".join(player.notes) or kind != "one"
    assert set(player.notes) == set(again.notes)


@pytest.mark.parametrize(
    ("kind", "name"),
    sample(("table", "scrape"), ("field", "roll"), kinds=KINDS, names=MOVING),
)
def test_live_scrapes_and_rolls_sound_as_offline(kind: str, name: str, by_hand: Make) -> None:
    model, moving = recorded(kind), MOVING[name](path(kind))
    player = by_hand(model, volume=-40, listener=HEARD)
    player.hear(10)
    player.start(moving)
    heard = player.hear(250)[BLOCK + LEAD + LATE :] / player.gain
    expected = struck.render(model, moving, seconds=0.6, fade=0, listener=HEARD).samples[0]
    assert_same(heard, expected)


def assert_same(heard: Array, expected: Array) -> None:
    count = min(len(heard), len(expected))
    assert np.abs(expected[:count]).max() > 0
    apart = np.abs(heard[:count] - expected[:count]).max() / np.abs(expected[:count]).max()
    assert 20 * np.log10(apart) < -60


@pytest.mark.parametrize(
    ("kind", "name"),
    sample(
        ("round", "scrape"), ("field", "touch"), kinds=KINDS[1:], names=(*MOVING, "touch")
    ),
)  # fmt: skip
def test_a_moving_tip_bends_the_sound_no_more_than_one_that_stands(kind: str, name: str) -> None:
    model = recorded(kind).expanded()
    making = log(kind) if name == "touch" else MOVING[name](path(kind))
    begun = making.begin(model, RATE)
    pushes = [push for push in (begun.advance(BLOCK) for _ in range(150)) if push]
    moving = bend(model, pushes)
    standing = [
        bend(model, [Push(force=push.force, drive=stopped.drive) for push in pushes])
        for stopped in pushes[::15]
    ]
    assert 0 < moving <= 1.5 * max(standing)


def bend(model: ModalModel, pushes: list[Push]) -> float:
    """Return the greatest second difference of what pushes sound like."""
    modes = Resonators([model], block=BLOCK, voices=1)
    outputs = [model.gains.toward(np.array([HEARD]))[0]]
    sound = np.concatenate([modes.process([push], outputs)[0, 0].copy() for push in pushes])
    return float(np.abs(np.diff(sound, 2)).max())


def test_what_was_not_told_is_asked_for() -> None:
    scrape = MOVING["scrape"](path("field"))
    with pytest.raises(ContactError, match=r"how long a unit of height is.*charted\(pitch=0.25\)"):
        struck.render(recorded("field", charted=False), scrape)
    with pytest.raises(ContactError, match=r"height and of azimuth \(rad\) is"):
        struck.render(recorded("round", charted=False), MOVING["scrape"](path("round")))
    with pytest.raises(ContactError, match="recorded at one place, which sounds alike"):
        struck.render(recorded("one"), Scrape(path=["recorded"] * 2, speed=0.1, load=1.0))
    with pytest.raises(OptionError, match="recorded and has no surface: leave patch= out"):
        struck.render(recorded("field"), Scrape(path=path("field"), speed=1, load=1, patch=0.01))
    for action in (
        Strike(direction=(0, 0, 1)),
        ForceTrack(force=np.ones(9), sample_rate=RATE, direction=(0, 0, 1)),
        TouchLog(times=[0], points=[(0.5,)], forces=[1], directions=[(0, 0, 1)]),
    ):
        with pytest.raises(ContactError, match="knows no other way to push; leave direction= out"):
            struck.render(recorded("field"), action)


@pytest.mark.parametrize("kind", ["field", "plane", "table"])
def test_a_way_beyond_what_was_recorded_is_refused(kind: str) -> None:
    model, (begin, end) = recorded(kind), path(kind)
    beyond = end + [0.3, 0.0][: len(end)]
    with pytest.raises(ContactError, match="outside of what was recorded: the nearest is"):
        struck.render(model, MOVING["scrape"]([begin, beyond]))
    with pytest.raises(ContactError, match="outside of what was recorded"):
        struck.render(model, TouchLog(times=[0, 0.1], points=[begin, beyond], forces=[1, 1]))
    with pytest.raises(OptionError, match="one and the same"):
        Path.over(model, [begin, begin])
    wide = np.append(begin, [0.5] * (3 - len(begin)))
    with pytest.raises(ContactError, match="give a finite number for each of"):
        struck.render(model, TouchLog(times=[0], points=[wide], forces=[1]))


def test_what_was_not_recorded_is_said() -> None:
    scrape = Scrape(path=[(0.0,), (0.1,)], speed=0.5, load=1.0, seconds=0.1)
    notes = " / ".join(struck.render(recorded("one"), scrape).notes)
    for said in ("hold the blow that was recorded", "all of the dent", "recorded at one place"):
        assert said in notes
    struck_alone = struck.render(recorded("field"), Strike(at=(0.2,)), seconds=0.1, fade=0)
    assert not struck_alone.notes


def test_a_stopped_tip_is_still_and_turns_back() -> None:
    still = Scrape(path=path("field"), speed=([0, 0.1, 0.1001], [0.3, 0.3, 0.0]), load=1.0)
    begun = still.begin(recorded("field"), RATE)
    pushes = [begun.advance(BLOCK) for _ in range(80)]
    assert np.array_equal(pushes[-1].drive, pushes[-2].drive)
    assert not pushes[-1].force.any() or np.ptp(pushes[-1].force) < 1e-9
    far = 0.03 / PITCH
    expected = drives_at(recorded("field"), path("field")[0][None] + far)
    assert pushes[-1].drive == pytest.approx(expected[0], abs=1e-2)

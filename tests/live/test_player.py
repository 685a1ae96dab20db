"""The player, without a device where that is possible, and on one."""

from __future__ import annotations

import subprocess
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck.errors import ArgumentError, ContactError, DeviceError, OptionError
from struck.excitation.excitation import Hold, Push
from struck.excitation.pulses import LEAD
from struck.excitation.scrape import Roll, Scrape
from struck.excitation.strike import Strike
from struck.live.limiter import DELAY, limiter
from struck.model.material import Material
from struck.model.model import ModalModel
from struck.synth.resonators import Resonators
from tests.live.hand import BLOCK, CEILING, RATE, HandPlayer, Make, ball, by_hand

__all__ = ["by_hand"]
Array = NDArray[np.float64]
LATE = round(limiter(sample_rate=RATE, channels=2)[DELAY])
ALUMINIUM = Material(density=2700.0, youngs_modulus=70e9, poisson_ratio=0.3)
OPENED = 10  # blocks after which the fade-in is over


def decibels(one: Array, other: Array) -> float:
    """Return the greatest difference over the greatest value."""
    return 20 * np.log10(np.abs(one - other).max() / np.abs(other).max() + 1e-30)


def test_the_default_strike_peaks_at_twelve_decibels_below_full_scale(by_hand: Make) -> None:
    for volume in (0.0, -20.0):
        player = by_hand([ball(), ball(seed=1)], volume=volume)
        player.hear(OPENED)
        peaks = []
        for body in (0, 1):
            player.strike(body=body)
            peaks.append(np.abs(player.hear(100)).max())
            player.dampen("top", 1e6, body=body)
            player.hear(100)
        assert 20 * np.log10(max(peaks)) == pytest.approx(-12 + volume, abs=0.3)


def test_a_strike_sounds_as_its_closed_form(by_hand: Make) -> None:
    model, blow = ball(), Strike(at="top", impulse=1e-3, duration=1e-3)
    player = by_hand(model, volume=-20, listener=(1, 0, 0))
    player.hear(OPENED)
    player.strike(blow)
    waiting = BLOCK + LEAD + LATE
    heard = player.hear(60)[waiting:] / player.gain
    late = Strike(at="top", impulse=1e-3, duration=1e-3)
    expected = struck.render(model, late, seconds=0.15, fade=0, listener=(1, 0, 0)).samples[0]
    count = min(len(heard), len(expected))
    assert decibels(heard[:count], expected[:count]) < -35  # the band-limiting of the pulse


def test_strikes_at_one_place_share_a_voice_and_others_take_their_own(by_hand: Make) -> None:
    player = by_hand(ball(), voices=3)
    for _ in range(50):
        player.strike(at="top")
    player.strike(at="side")
    player.strike(at="vertex:7")
    player.hear(5)
    assert player.dropped == 0
    for number in range(10, 15):
        player.strike(at=f"vertex:{number}")
    player.hear(5)
    assert player.dropped == 2


@pytest.mark.parametrize("count", [10_000, pytest.param(1_000_000, marks=pytest.mark.prove)])
def test_too_many_strikes_in_a_block_are_dropped_and_counted(by_hand: Make, count: int) -> None:
    player = by_hand(ball())
    player.hear(OPENED)
    blow = Strike(at="top")
    begun = time.process_time()
    for _ in range(count):
        player.strike(blow)
    heard = player.hear(20)
    assert time.process_time() - begun < 30
    assert count - 1024 <= player.dropped < count
    assert np.abs(heard).max() <= CEILING
    player.hear(2000)
    player.strike(blow)
    assert np.isfinite(player.hear(20)).all()


def test_the_sound_ends_as_resonators_make_it(by_hand: Make) -> None:
    # 2 bodies, a scrape and a roll: what the callback does is what `Resonators` does.
    bodies = [ball(), ball(30, seed=1)]
    makings = [
        Scrape(path=["top", "side"], speed=0.1, load=1.0, repeat="back"),
        Roll(path=["top", "side"], radius=0.01, speed=0.1, mass=0.05, repeat="back"),
    ]
    player = by_hand(bodies, volume=-30, listener=(2, 0, 0))
    player.hear(OPENED)
    for body, making in enumerate(makings):
        player.start(making, body=body)
    heard = player.hear(80)[BLOCK + LATE :] / player.gain
    modes = Resonators(bodies, block=BLOCK, voices=2)
    pushings = [
        making.begin(body, RATE, start=-LEAD) for making, body in zip(makings, bodies, strict=True)
    ]
    outputs = [body.gains.toward(np.array([[2.0, 0, 0]]))[0] for body in bodies]
    made = []
    for _ in range(80):
        pushes = [(body, pushing.advance(BLOCK)) for body, pushing in enumerate(pushings)]
        chosen = [
            Push(force=push.force, drive=push.drive, body=body) for body, push in pushes if push
        ]
        made.append(modes.process(chosen, outputs).sum(axis=0)[0].copy())
    expected = np.concatenate(made)[: len(heard)]
    assert np.abs(expected).max() > 0
    assert decibels(heard, expected) < -100  # the device's samples are float32


def test_a_touch_sounds_as_its_log(by_hand: Make) -> None:
    model, chance = ball(), np.random.default_rng(4)
    player = by_hand(model, volume=-30, listener=(2, 0, 0))
    points = model.geometry.points[chance.integers(0, 162, 12)]

    def move(block: int) -> None:
        if block % 4 == 0:
            player.touch(points[block // 60 % 12], 2 + np.sin(block), 0.2)
        if block == 700:
            player.touch(points[11], 0)

    heard = player.hear(800, move)[LATE:] / player.gain
    expected = replayed(model, player.touch_log, len(heard))
    begin = OPENED * BLOCK
    assert decibels(heard[begin:], expected[begin : len(heard)]) < -90


def replayed(model: ModalModel, log: Any, length: int) -> Array:  # noqa: ANN401 - an excitation
    """Return the offline sound of a touch."""
    modes, touch = Resonators([model], block=BLOCK, voices=1), log.begin(model, RATE)
    outputs = [model.gains.toward(np.array([[2.0, 0, 0]]))[0]]
    made = []
    for _ in range(length // BLOCK + 1):
        push = touch.advance(BLOCK)
        made.append(modes.process([push] if push else [], outputs)[0, 0].copy())
    return np.concatenate(made)[:length]


SENDER = """
import math, sys, time
count = int(sys.argv[1])
for number in range(count):
    angle = number / 40
    force = 2 + math.sin(number / 5) if number < count - 20 else 0
    point = 0.1 * math.cos(angle), 0.1 * math.sin(angle), 0.0
    print(*point, force, 0.1 / 0.4, flush=True)
    time.sleep(0.01)
"""


@pytest.mark.parametrize("count", [80, pytest.param(200, marks=pytest.mark.prove)])
@pytest.mark.timed
def test_a_touch_of_another_process_sounds_as_its_log(by_hand: Make, count: int) -> None:
    model = ball()
    player = by_hand(model, volume=-30, listener=(2, 0, 0))
    heard: list[NDArray[np.float32]] = []
    command = [sys.executable, "-c", SENDER, str(count)]
    ended = threading.Event()

    def follow() -> None:
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as sender:
            for line in sender.stdout or ():
                *point, force, speed = map(float, line.split())
                player.touch(point, force, speed)
        ended.set()

    follower = threading.Thread(target=follow)
    follower.start()
    while not ended.is_set():  # in real time, as a device would
        begun = time.perf_counter()
        heard.append(player.hear(1))
        time.sleep(max(0.0, BLOCK / RATE - (time.perf_counter() - begun)))
    follower.join()
    heard.append(player.hear(200))
    log = player.touch_log
    assert len(np.asarray(log.times)) == count
    samples = np.concatenate(heard)[LATE:] / player.gain
    expected = replayed(model, log, len(samples))
    begin = OPENED * BLOCK
    assert np.abs(expected).max() > 0
    assert decibels(samples[begin:], expected[begin:]) < -60


def test_a_late_record_holds_the_load_and_is_counted(by_hand: Make) -> None:
    player = by_hand(ball())
    player.hear(300, lambda _: player.touch("top", 3.0))
    player.start(Scrape(path=["top", "side"], speed=0.3, load=2.0, repeat="back"))
    player.hear(50)
    player.hear_late(1)  # which was ready
    before = player.bank.memory.forces.copy()
    heard = player.hear_late(40)
    assert player.late == 40
    assert np.isfinite(heard).all()
    assert before.any()
    after = player.bank.memory.forces
    active = player.bank.memory.voices[:, 1] > 0
    assert np.allclose(
        np.sort(after[active][:, -1]), [0, 3], atol=1e-9
    )  # the scrape's is its change
    assert np.ptp(after[active], axis=1).max() < 1e-9
    player.hear(20)
    assert player.late == 40


def test_a_hand_raises_decays_as_a_hold_does(by_hand: Make) -> None:
    model = ball()
    player = by_hand(model)
    player.strike(at="top")
    player.hear(10)
    before = np.abs(player.bank.states(0))
    player.dampen("side", 5.0)
    player.hear(2)
    begun = np.abs(player.bank.states(0))
    player.hear(50)
    after = np.abs(player.bank.states(0))
    raised = Hold(at="side", grip=5.0).raised(model)
    seconds = 50 * BLOCK / RATE
    assert np.all(begun <= before)
    expected = begun * np.exp(-(model.decays + raised) * seconds)
    assert after == pytest.approx(expected, rel=1e-6, abs=1e-12 * begun.max())
    player.dampen("side", 0)
    player.hear(2)
    begun = np.abs(player.bank.states(0))
    player.hear(50)
    freed = begun * np.exp(-model.decays * seconds)
    assert np.abs(player.bank.states(0)) == pytest.approx(freed, rel=1e-6, abs=1e-12 * begun.max())


def test_moves_and_live_changes_do_not_click(by_hand: Make) -> None:
    model = ball()
    other = model.made_of(ALUMINIUM)

    def heard(change: Callable[[HandPlayer, int], None], begun: ModalModel = model) -> float:
        player = by_hand(begun, volume=-20, listener=(1, 0, 0))
        player.hear(OPENED)
        player.strike(at="top")
        player.hear(20)
        sound = player.hear(200, lambda block: change(player, block)).astype(float)
        return float(np.abs(np.diff(sound, 2)).max())

    def move(player: HandPlayer, block: int) -> None:
        player.listener = np.array([1 + 0.2 * np.sin(block / 9), 0.3 * np.cos(block / 7), 0.2])

    def hold(player: HandPlayer, block: int) -> None:
        player.dampen("side", 20.0 * (block % 2))

    def remake(player: HandPlayer, block: int) -> None:
        player.change(other if block % 20 < 10 else model)

    def turn(player: HandPlayer, block: int) -> None:
        player.volume = -20 - block % 3

    still = heard(lambda _player, _block: None)
    lighter = heard(lambda _player, _block: None, other) * player_ratio(model, other, by_hand)
    for change in (move, hold, turn):
        assert heard(change) <= 1.5 * still, change
    assert heard(remake) <= 1.5 * max(still, lighter)


def player_ratio(model: ModalModel, other: ModalModel, by_hand: Make) -> float:
    """Return by how much a player of one model is louder than a player of another for each Pa."""
    return by_hand(model).gain / by_hand(other).gain


class Broken:
    """An excitation that goes wrong in its fourth block."""

    def __init__(self, wrong: float | None) -> None:
        self._wrong, self._blocks = wrong, 0
        self.finished = False

    def begin(self, model: ModalModel, _rate: float, *, start: int = 0) -> Broken:
        self._drive = np.full(len(model.frequencies), 0.1 + 0 * start)
        return self

    def advance(self, length: int) -> Push:
        self._blocks += 1
        force = np.full(length, 0.01)
        if self._blocks == 4:
            if self._wrong is None:
                raise ContactError("it left the body")
            force[5] = self._wrong
        return Push(force=force, drive=self._drive)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, 1e300, None])
def test_a_broken_excitation_is_stopped_and_told_of_once(
    by_hand: Make, wrong: float | None
) -> None:
    player = by_hand(ball())
    player.start(Broken(wrong))
    player.hear(10)
    with pytest.raises((OptionError, ContactError)):
        player.strike()
    player.strike()
    heard = player.hear(50)
    assert np.isfinite(player.bank.states(0)).all()
    assert 0 < np.abs(heard).max() <= CEILING


WRONG: dict[str, Callable[[HandPlayer], object]] = {
    "a force that is no number": lambda p: p.touch("top", np.nan),
    "a pull": lambda p: p.touch("top", -1.0),
    "a velocity without bounds": lambda p: p.touch("top", 1.0, (np.inf, 0, 0)),
    "a place off the body": lambda p: p.touch((9, 9, 9), 1.0),
    "no such body": lambda p: p.strike(body=3),
    "no such place": lambda p: p.strike(at="nowhere"),
    "a strike twice": lambda p: p.strike(Strike(), at="top"),
    "a listener inside": lambda p: setattr(p, "listener", (0, 0, 0)),
    "a listener nowhere": lambda p: setattr(p, "listener", (0, np.nan, 0)),
    "a volume that is no number": lambda p: setattr(p, "volume", np.nan),
    "a volume in words": lambda p: setattr(p, "volume", "loud"),
    "no excitation": lambda p: p.start("scrape"),
    "a hold as an excitation": lambda p: p.start(Hold(at="top", grip=3.0)),
    "a negative grip": lambda p: p.dampen("top", -1.0),
    "another number of modes": lambda p: p.change(ball(7)),
    "a log of nothing": lambda p: p.touch_log,
}


@pytest.mark.parametrize("wrong", WRONG)
def test_bad_input_is_refused_and_changes_nothing(by_hand: Make, wrong: str) -> None:
    player, model = by_hand(ball()), ball()
    player.strike(at="top")
    player.hear(20)
    before = np.abs(player.bank.states(0))
    with pytest.raises((ArgumentError, OptionError, ContactError)):
        WRONG[wrong](player)
    player.hear(10)
    expected = before * np.exp(-model.decays * 10 * BLOCK / RATE)
    assert np.abs(player.bank.states(0)) == pytest.approx(expected, rel=1e-6)
    assert player.dropped == 0


def test_a_device_that_goes_is_told_of(by_hand: Make) -> None:
    player = by_hand(ball())
    player.hear(5)
    player.hand.active = False
    assert not player.active
    for call in (player.strike, lambda: player.touch("top", 1.0), lambda: player.dampen("top", 1)):
        with pytest.raises(DeviceError, match=r"a hand no longer plays.*struck render"):
            call()
    player.stop()
    player.stop()


@pytest.mark.parametrize(
    ("name", "value"), [("volume", np.inf), ("block", 0), ("voices", 0), ("ahead", 0)]
)
def test_bad_sessions_are_refused(by_hand: Make, name: str, value: float) -> None:
    with pytest.raises(OptionError):
        by_hand(ball(), **{name: value})
    with pytest.raises(OptionError, match="nothing to play"):
        by_hand([])


@pytest.mark.parametrize(
    ("rate", "block"),
    [
        (8000.0, 1),
        pytest.param(192000.0, 1, marks=pytest.mark.prove),
        *((rate, block) for rate in (8000.0, 192000.0) for block in (100, 4096)),
    ],
)
def test_any_rate_and_block_plays(
    by_hand: Make, monkeypatch: pytest.MonkeyPatch, rate: float, block: int
) -> None:
    monkeypatch.setattr("tests.live.hand.Hand.sample_rate", rate)
    player = by_hand(ball(), block=block)
    player.strike()
    player.touch("side", 1.0, 0.2)
    heard = player.hear(4 + int(0.1 * rate / block))
    assert np.isfinite(heard).all()
    assert 0 < np.abs(heard).max() <= CEILING

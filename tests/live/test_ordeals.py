"""What a player must bear: anything at random for long, and a busy machine."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import multiprocessing
import sys
import time
from typing import Any

import numpy as np
import pytest

import struck
from struck.excitation.scrape import Roll, Scrape
from struck.live import limiter
from struck.live.keys import Robot, busy_thread, repeat_models
from struck.model.material import Material
from struck.model.model import ModalModel
from tests.live.hand import BLOCK, CEILING, RATE, HandPlayer, Make, ball, by_hand
from tests.live.servers import Server, judge
from tests.live.watchdog import stalls

__all__ = ["by_hand"]


class Monkey:
    """Does anything at random."""

    def __init__(self, player: HandPlayer, models: list[ModalModel]) -> None:
        self._player, self._models = player, models
        self._chance = np.random.default_rng(8)
        self._started: list[Any] = []
        self.asked = 0

    def act(self, _block: int) -> None:
        player, chance = self._player, self._chance
        if chance.random() < 0.75:
            return
        self.asked += 1
        body = int(chance.integers(len(self._models)))
        place = f"vertex:{chance.integers(162)}"
        kind = chance.random()
        if kind < 0.3:
            player.strike(at=place, impulse=10 ** chance.uniform(-5, 0.5), body=body)
        elif kind < 0.5:
            player.touch(place, float(chance.choice([0, 1, 10])), chance.random(), body=body)
        elif kind < 0.51:
            self._start(body, place)
        elif kind < 0.56 and self._started:
            self._started.pop(0).stop()
        elif kind < 0.62:
            player.dampen(place, float(chance.choice([0, 0, 0, 3, 100])), body=body)
        elif kind < 0.66:
            player.listener = chance.normal(size=3) * 0.1 + np.array([1, 0, 0])
        elif kind < 0.67:
            stiffness = 10 ** chance.uniform(10, 11.4)
            material = Material(density=5e3, youngs_modulus=stiffness, poisson_ratio=0.3)
            player.change(self._models[body].made_of(material), body=body)

    def _start(self, body: int, place: str) -> None:
        path, chance = [place, "vertex:99" if place != "vertex:99" else "side"], self._chance
        speed = 10 ** chance.uniform(-2, 0)
        making = (
            Scrape(path=path, speed=speed, load=2.0, repeat="back")
            if chance.random() < 0.5
            else Roll(path=path, radius=0.01, speed=speed, mass=0.1, repeat="back")
        )
        self._started.append(self._player.start(making, body=body))

    def leave(self) -> None:
        for started in self._started:
            started.stop()
        for body in range(len(self._models)):
            self._player.touch("top", 0.0, body=body)


DROPPED = 0.05
"""The share of what is asked that there may be no voice for."""
LATE = 0.05
"""The share of blocks for which a shared machine may leave no time."""

GIVEN = 0.9
"""The share of a processor's time without which late blocks are other programs' doing."""


def resident() -> int:
    """Return the memory of this process, bytes; 0 where the system does not tell so easily."""
    try:
        with open("/proc/self/statm", encoding="ascii") as file:  # noqa: PTH123 - no file of ours
            return int(file.read().split()[1]) * 4096
    except OSError:
        return 0


def lasting() -> int:
    """Return the memory of this process, bytes."""
    gc.collect()
    with contextlib.suppress(AttributeError):  # only one C library has it
        ctypes.CDLL(None).malloc_trim(0)
    return resident()


def energy(player: HandPlayer, bodies: int) -> list[float]:
    return [float(np.square(np.abs(player.bank.states(n))).sum()) for n in range(bodies)]


def ordeal(by_hand: Make, seconds: float, warm: float) -> int:
    """Do anything for so long; return by how many bytes memory has grown after warming up."""
    models = [ball(), ball(25, seed=1), ball(60, seed=2)]
    player = by_hand(models, volume=10)
    monkey = Monkey(player, models)
    before, loudest = 0, 0.0
    for block in range(round(seconds * RATE / BLOCK)):
        if block == round(warm * RATE / BLOCK):
            before = lasting()
        heard = player.hear(1, monkey.act)
        assert np.isfinite(heard).all()
        loudest = max(loudest, float(np.abs(heard).max()))
        assert loudest <= CEILING
    grown = lasting() - before
    assert loudest > 0.1
    assert player.dropped <= DROPPED * monkey.asked
    assert player.late == 0
    monkey.leave()
    player.hear(60)
    last = energy(player, len(models))
    for _ in range(300):
        player.hear(1)
        now = energy(player, len(models))
        assert all(new <= old * (1 + 1e-12) for new, old in zip(now, last, strict=True))
        last = now
    assert player._limiter_state[limiter.REPLACED] == 0
    return grown


@pytest.mark.parametrize("seconds", [1, pytest.param(3, marks=pytest.mark.prove)])
def test_seconds_of_anything(by_hand: Make, seconds: float) -> None:
    assert ordeal(by_hand, seconds, seconds / 2) < 20 * 2**20


@pytest.mark.prove
def test_two_minutes_of_anything(by_hand: Make) -> None:
    """What grows once, in a process that other tests used, does not grow again; a leak does."""
    assert any(ordeal(by_hand, 120, 30) < 5 * 2**20 for _ in range(2))


def soak(jack: Server, seconds: float) -> tuple[int, int, int, int]:
    """Play 2,000 modes, 200 strikes a second and two scrapes beside a busy thread.

    Return underflows, those that were the server's own doing, late blocks, and strikes. It was
    heard, and hardly a strike was left out.
    """
    models = repeat_models([ball(100, seed=n) for n in range(4)], 2000)
    before = jack.late()
    with struck.play(models) as player, busy_thread():
        robot = Robot(player, models, strikes=200, scrapes=2)
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            robot.go_on()
            time.sleep(0.004)
        assert player.peak > 0.01
        assert player.dropped <= DROPPED * robot.strikes
        return player.underflows, jack.late() - before, player.late, robot.strikes


@pytest.mark.prove
@pytest.mark.timed
def test_a_soak_of_two_seconds(jack: Server, capsys: pytest.CaptureFixture[str]) -> None:
    # A shared machine now and then stops everybody, the server's clock too: three attempts.
    blocks = round(2 * RATE / BLOCK)
    for _ in range(3):
        worked, begun = time.process_time(), time.perf_counter()
        underflows, stopped, late, strikes = soak(jack, 2)
        given = (time.process_time() - worked) / (time.perf_counter() - begun)
        with capsys.disabled():
            sys.stdout.write(
                f"{underflows} underflows ({stopped} of the server's clock), {late} late blocks, "
                f"{strikes} strikes, {given:.0%} of a processor\n"
            )
        if not underflows and late <= LATE * blocks:
            break
    if late > LATE * blocks and given < GIVEN:  # the busy thread alone would have taken it whole
        pytest.skip(
            f"{late} of {blocks} blocks late: other programs took {1 - given:.0%} of the time"
        )
    assert strikes > 2 * 200 * 0.5
    assert late <= LATE * blocks
    judge(underflows, blocks)


@pytest.mark.prove
@pytest.mark.timed
def test_a_soak_of_a_minute(jack: Server, capsys: pytest.CaptureFixture[str]) -> None:
    with stalls() as late_wakes:
        underflows, stopped, late, strikes = soak(jack, 60)
    with capsys.disabled():
        sys.stdout.write(
            f"{underflows} underflows ({stopped} of the server's clock), {late} late blocks, "
            f"{strikes} strikes on {multiprocessing.cpu_count()} processors; the machine stood "
            f"still {len(late_wakes)} times, {max(late_wakes, default=0.0):.0f} ms at most\n"
        )
    # None but where the machine gave no thread its time.
    assert underflows <= len(late_wakes)
    still = sum(late_wakes) / 60e3
    enough, in_time = strikes > 60 * 200 * 0.9, late <= LATE * 60 * RATE / BLOCK
    if still > 0.01 and not (enough and in_time):
        pytest.skip(f"{late} late blocks, {strikes} strikes: the machine stood still {still:.1%}")
    assert enough
    assert in_time

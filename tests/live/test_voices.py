"""What goes wrong beside the caller: it is told, and nothing else suffers."""

from __future__ import annotations

import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest

from struck.errors import ContactError, DeviceError, OptionError
from struck.excitation.scrape import Scrape
from struck.excitation.touch import Touching
from struck.live.commands import MAX_COMMANDS, CommandQueue
from struck.live.player import Player
from struck.live.voices import LastError
from struck.model.model import ModalModel
from tests.live.hand import RATE, STEEL, Hand, Make, ball, by_hand

__all__ = ["by_hand"]


def break_off(time: float) -> float:
    """Return a speed for 10 ms, and then fail."""
    return 0.1 if time < 0.01 else 1 / 0


def test_a_function_that_fails_stops_its_excitation_alone(by_hand: Make) -> None:
    player = by_hand(ball())
    started = player.start(Scrape(path=["top", "side"], speed=break_off, load=2.0, repeat="back"))
    other = player.start(Scrape(path=["top", "side"], speed=0.1, load=2.0, repeat="back"))
    player.hear(20)
    assert started.finished
    assert not other.finished
    with pytest.raises(OptionError, match="it raised ZeroDivisionError") as caught:
        player.strike()
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    player.strike()
    assert np.abs(player.hear(20)).max() > 0


def fail(_sample: int) -> None:
    raise KeyError("gone")


def test_a_wish_that_fails_keeps_no_other_from_being_done() -> None:
    error, done = LastError(), []
    queue = CommandQueue(lambda: 0.0, block=128, sample_rate=48000.0, error=error)
    assert queue.add(fail)
    assert queue.add(done.append)
    queue.run(256)
    assert done == [256]
    with pytest.raises(OptionError, match="KeyError"):
        error.raise_again()
    error.raise_again()


def test_what_changes_a_state_always_has_room_and_the_last_wins() -> None:
    done: list[int] = []
    queue = CommandQueue(lambda: 0.0, block=128, sample_rate=48000.0, error=LastError())
    for number in range(MAX_COMMANDS + 10):
        queue.add(lambda _, number=number: done.append(number))
    assert queue.refused == 10
    for number in (-1, -2, -3):
        queue.put("state", lambda _, number=number: done.append(number))
    queue.run(0)
    assert done == [*range(MAX_COMMANDS), -3]
    assert queue.refused == 10


def test_a_full_queue_loses_neither_changes_nor_the_listener(by_hand: Make) -> None:
    player = by_hand(ball(), listener=(1.0, 0.0, 0.0), volume=-20)
    player.hear(10)
    player.strike()
    near = np.abs(player.hear(30)).max()
    for _ in range(MAX_COMMANDS):
        player.touch("top", 0.0)
    player.listener = (100.0, 0.0, 0.0)
    left_out = player.start(Scrape(path=["top", "side"], speed=0.1, load=2.0, repeat="back"))
    assert player.dropped == 1
    assert left_out.finished
    player.hear(5)
    player.strike()
    assert 0 < np.abs(player.hear(30)).max() < near / 50


def test_a_full_queue_does_not_lose_a_change(by_hand: Make) -> None:
    model = ball()
    player = by_hand(model)
    player.hear(3)
    for _ in range(MAX_COMMANDS):
        player.touch("top", 0.0)
    player.change(model.made_of(replace(STEEL, youngs_modulus=4 * STEEL.youngs_modulus)))
    player.hear(5)
    player.strike()
    heard = player.hear(400)[40 * 128 :]
    spectrum = np.abs(np.fft.rfft(heard * np.hanning(len(heard))))
    strongest = np.argmax(spectrum) * RATE / len(heard)
    assert np.abs(2 * model.frequencies - strongest).min() < RATE / len(heard)
    assert np.abs(model.frequencies - strongest).min() > RATE / len(heard)


def test_what_finds_no_voice_has_finished(by_hand: Make) -> None:
    player = by_hand(ball(), voices=1)
    scrape = Scrape(path=["top", "side"], speed=0.1, load=2.0, repeat="back")
    first, second = player.start(scrape), player.start(scrape)
    player.hear(3)
    assert (first.finished, second.finished) == (False, True)
    assert player.dropped == 1


def test_fingers_that_let_go_give_their_voices_back(by_hand: Make) -> None:
    player = by_hand(ball(), voices=4)
    for finger in range(4):
        player.touch("top", 2.0, 0.1, finger=finger)
    player.hear(20)
    for finger in range(4):
        player.touch("top", 0.0, finger=finger)
    player.hear(40)
    for place in ("top", "side", "vertex:7", "vertex:9"):
        player.strike(at=place)
    player.hear(2)
    assert player.dropped == 0
    player.hear(100)
    for finger in range(4):
        player.touch("side", 2.0, 0.1, finger=finger)
    player.hear(10)
    assert player.dropped == 0
    assert player._host._voices.free == 0


def test_a_touch_may_begin_while_a_body_changes(
    by_hand: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    model, whole = ball(), Touching.change
    player = by_hand(model)
    host = player._host

    def change(touching: Touching, other: ModalModel) -> None:
        host.touching(0, 2, None)  # as another thread may do at any moment
        whole(touching, other)

    for finger in (0, 1):
        host.touching(0, finger, None)
    monkeypatch.setattr(Touching, "change", change)
    player.change(model)
    player.hear(5)
    player.strike()  # which tells of failure
    assert player._host.notes(0, 2)


@pytest.mark.prove
def test_hands_from_several_threads_do_not_disturb_each_other(by_hand: Make) -> None:
    model, failures = ball(5), []
    player = by_hand(model)

    def hold(first: int) -> None:
        try:
            for number in range(400):
                player.dampen(f"vertex:{first + number % 20}", float(number % 2))
        except RuntimeError as failure:
            failures.append(failure)

    usual = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    threads = [threading.Thread(target=hold, args=(20 * n,)) for n in range(4)]
    try:
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    finally:
        sys.setswitchinterval(usual)
    assert not failures
    player.hear(1)


class Deaf(Hand):
    """An outlet that refuses to start."""

    def __init__(self) -> None:
        self.closed = False

    def start(self) -> None:
        raise DeviceError("refused")

    def close(self) -> None:
        self.closed = True


def test_a_player_whose_device_does_not_start_leaves_nothing_behind() -> None:
    usual, outlet = sys.getswitchinterval(), Deaf()
    player = Player([ball(3)], outlet=outlet)
    with pytest.raises(DeviceError, match="refused"):
        player.begin()
    assert outlet.closed
    assert sys.getswitchinterval() == usual
    assert not any(thread.name == "struck feeder" for thread in threading.enumerate())


def test_a_feeder_that_failed_is_named_as_the_cause() -> None:
    outlet = Hand()
    player = Player([ball(3)], outlet=outlet)
    player.begin()
    player._host._layout = None  # type: ignore[assignment] # the next block will fail
    give_up = time.monotonic() + 5
    while player.active and time.monotonic() < give_up:
        outlet.play()
        time.sleep(0.001)
    with pytest.raises(DeviceError, match="what fills its blocks failed") as caught:
        player.strike()
    assert isinstance(caught.value.__cause__, AttributeError)
    with pytest.raises(AttributeError):
        player.stop()


def test_trouble_of_struck_is_raised_as_it_was() -> None:
    error, failure = LastError(), ContactError("off the body")
    error.keep(failure)
    with pytest.raises(ContactError) as caught:
        error.raise_again()
    assert caught.value is failure

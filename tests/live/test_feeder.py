"""The thread that fills the ring: ahead, no further, and honest about what went wrong."""

from __future__ import annotations

import sys
import time

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.live.player import Feeder
from struck.live.ring import Ring
from tests.live.records import pop

SECONDS = 128 / 48000


class Numbers:
    """Fills records with 0, 1, 2 ...; the one at `broken` fails."""

    def __init__(self, broken: int = -1) -> None:
        self.next = 0
        self._broken = broken

    def __call__(self, integers: NDArray[np.int64], reals: NDArray[np.float64]) -> None:
        if self.next == self._broken:
            raise ZeroDivisionError
        integers[0], reals[:] = self.next, self.next / 2
        self.next += 1


def take(records: Ring, patience: float = 1) -> int:
    """Return the number of the next record, waiting for it; -1 if it does not come."""
    integers, reals = np.zeros(1, dtype=np.int64), np.zeros(2)
    give_up = time.monotonic() + patience
    while time.monotonic() < give_up:
        if pop(records.memory, integers, reals):
            assert np.all(reals == integers[0] / 2)
            return int(integers[0])
        time.sleep(SECONDS / 4)
    return -1


def test_it_fills_as_far_ahead_as_told_and_goes_on() -> None:
    records = Ring(capacity=8, integers=1, reals=2)
    numbers = Numbers()
    feeder = Feeder(records, numbers, seconds=SECONDS, ahead=2)
    usual = sys.getswitchinterval()
    assert take(records, SECONDS) == -1  # compiles, which would keep the feeder waiting
    feeder.start()
    assert sys.getswitchinterval() <= min(usual, 0.0005)
    time.sleep(5 * SECONDS)
    assert numbers.next == 3  # two ahead of the one being heard
    assert [take(records) for _ in range(50)] == list(range(50))
    feeder.stop()
    assert sys.getswitchinterval() == usual
    assert not feeder.running
    assert SECONDS / 2 <= feeder.longest < 1


def feeder_of(numbers: Numbers) -> Feeder:
    return Feeder(Ring(capacity=8, integers=1, reals=2), numbers, seconds=SECONDS)


def test_two_at_once_leave_the_switch_interval_as_it_was() -> None:
    usual = sys.getswitchinterval()
    one = feeder_of(Numbers())
    one.start()
    other = feeder_of(Numbers())
    other.start()
    short = sys.getswitchinterval()
    one.stop()
    assert sys.getswitchinterval() == short < usual
    one.stop()
    assert sys.getswitchinterval() == short
    other.stop()
    assert sys.getswitchinterval() == usual


def test_one_that_could_not_begin_may_be_stopped() -> None:
    feeder = feeder_of(Numbers(broken=0))
    with pytest.raises(ZeroDivisionError):
        feeder.start()
    feeder.stop()


def test_a_failure_ends_it_and_is_raised_by_stop() -> None:
    records = Ring(capacity=8, integers=1, reals=2)
    feeder = Feeder(records, Numbers(broken=5), seconds=SECONDS)
    usual = sys.getswitchinterval()
    feeder.start()
    assert [take(records) for _ in range(5)] == [0, 1, 2, 3, 4]
    assert take(records, 40 * SECONDS) == -1
    assert not feeder.running
    with pytest.raises(ZeroDivisionError):
        feeder.stop()
    assert sys.getswitchinterval() == usual

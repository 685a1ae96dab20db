"""Records pass from Python to compiled code without loss, tear or lock."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.live.ring import Ring
from tests.live.records import pop, push

Integers = NDArray[np.int64]
Reals = NDArray[np.float64]
MANY = 10**6
FEW = 10**4


def count_spoiled(
    memory: Integers, records: int, integers: Integers, reals: Reals
) -> tuple[int, int]:
    """Return how many records are not those written, in order, and how often there was none."""
    spoiled = empty = 0
    for number in range(records):
        while not pop(memory, integers, reals):
            empty += 1
        whole = integers[0] == number and integers[1] == -3 * number
        spoiled += not (whole and (reals == 0.5 * number).all())
    return spoiled, empty


def write(records: Ring, number: int, integers: Integers, reals: Reals) -> int:
    """Write a record; return how often the ring was full."""
    integers[0], integers[1] = number, -3 * number
    reals.fill(0.5 * number)
    full = 0
    while not push(records, integers, reals):
        full += 1
        time.sleep(0)
    return full


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.prove)])
def test_records_arrive_whole_and_in_order(count: int) -> None:
    records = Ring(capacity=1024, integers=2, reals=6)
    counted: list[tuple[int, int]] = []
    taken = np.zeros(2, dtype=np.int64), np.zeros(6)
    reader = threading.Thread(
        target=lambda: counted.append(count_spoiled(records.memory, count, *taken))
    )
    reader.start()
    integers, reals = np.zeros(2, dtype=np.int64), np.zeros(6)
    full = sum(write(records, number, integers, reals) for number in range(count))
    reader.join()
    [(spoiled, empty)] = counted
    assert spoiled == 0
    assert records.waiting == 0
    assert full + empty > 0  # they met


def test_a_full_ring_refuses_and_an_empty_one_has_nothing() -> None:
    records = Ring(capacity=2, integers=1, reals=0)
    nothing = np.zeros(0)
    accepted = [push(records, np.array([n]), nothing) for n in range(4)]
    assert (accepted, records.waiting) == ([True, True, False, False], 2)
    taken = np.zeros(1, dtype=np.int64)
    got = [pop(records.memory, taken, nothing) and int(taken[0]) for _ in range(3)]
    assert got == [0, 1, False]


def test_a_slot_is_written_in_place_and_not_seen_before_it_is_published() -> None:
    records = Ring(capacity=1, integers=1, reals=2)
    slot = records.reserve()
    assert slot is not None
    slot[0][:], slot[1][:] = 7, (1.5, -2.5)
    assert records.waiting == 0
    records.publish()
    assert records.waiting == 1
    assert records.reserve() is None
    integers, reals = np.zeros(1, dtype=np.int64), np.zeros(2)
    assert pop(records.memory, integers, reals)
    assert (integers.tolist(), reals.tolist()) == ([7], [1.5, -2.5])


@pytest.mark.parametrize("sizes", [(0, 1, 1), (1, -1, 1), (1, 1, -1)])
def test_impossible_sizes_are_refused(sizes: tuple[int, int, int]) -> None:
    with pytest.raises(OptionError, match="at least 1 record"):
        Ring(capacity=sizes[0], integers=sizes[1], reals=sizes[2])

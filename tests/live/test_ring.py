"""Records pass from Python to compiled code without loss, tear or lock."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.live import ring
from struck.live.ring import Ring
from struck.synth import memory

Integers = NDArray[np.int64]
Reals = NDArray[np.float64]
MANY = 10**6
FEW = 2 * 10**5


@njit(nogil=True)
def count_spoiled(memory: Integers, records: int, integers: Integers, reals: Reals) -> int:
    """Return how many records are not those that `write` wrote, in their order."""
    spoiled = 0
    for number in range(records):
        while not ring.pop(memory, integers, reals):
            pass
        whole = integers[0] == number and integers[1] == -3 * number
        for place in range(reals.size):
            whole = whole and reals[place] == 0.5 * number
        spoiled += not whole
    return spoiled


@njit(nogil=True)
def add_repeatedly(counters: Integers, times: int) -> None:
    for _ in range(times):
        ring.add(counters, 0, 1)


def write(records: Ring, number: int, integers: Integers, reals: Reals) -> None:
    integers[0], integers[1] = number, -3 * number
    reals.fill(0.5 * number)
    while not records.push(integers, reals):
        time.sleep(0)


@pytest.mark.parametrize("count", [FEW, pytest.param(MANY, marks=pytest.mark.prove)])
def test_records_arrive_whole_and_in_order(count: int) -> None:
    records = Ring(capacity=1024, integers=2, reals=6)
    spoiled: list[int] = []
    taken = np.zeros(2, dtype=np.int64), np.zeros(6)
    count_spoiled(records.memory, 0, *taken)  # compiles
    reader = threading.Thread(
        target=lambda: spoiled.append(count_spoiled(records.memory, count, *taken))
    )
    reader.start()
    integers, reals = np.zeros(2, dtype=np.int64), np.zeros(6)
    for number in range(count):
        write(records, number, integers, reals)
    reader.join()
    assert spoiled == [0]
    assert records.waiting == 0
    assert records.refused + records.empty > 0  # they met


def test_a_full_ring_refuses_and_an_empty_one_has_nothing_and_both_count() -> None:
    records = Ring(capacity=2, integers=1, reals=0)
    nothing = np.zeros(0)
    accepted = [records.push(np.array([n]), nothing) for n in range(4)]
    assert (accepted, records.refused, records.waiting) == ([True, True, False, False], 2, 2)
    taken = np.zeros(1, dtype=np.int64)
    got = [ring.pop(records.memory, taken, nothing) and int(taken[0]) for _ in range(3)]
    assert got == [0, 1, False]
    assert records.empty == 1


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
    assert ring.pop(records.memory, integers, reals)
    assert (integers.tolist(), reals.tolist()) == ([7], [1.5, -2.5])


@pytest.mark.parametrize("sizes", [(0, 1, 1), (1, -1, 1), (1, 1, -1)])
def test_impossible_sizes_are_refused(sizes: tuple[int, int, int]) -> None:
    with pytest.raises(OptionError, match="at least 1 record"):
        Ring(capacity=sizes[0], integers=sizes[1], reals=sizes[2])


def test_additions_of_two_threads_are_not_lost() -> None:
    counters = np.zeros(1, dtype=np.int64)
    add_repeatedly(counters, 1)
    threads = [threading.Thread(target=add_repeatedly, args=(counters, MANY)) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert counters[0] == 2 * MANY + 1


@pytest.mark.parametrize(
    ("operation", "instruction"),
    [
        (lambda array: ring.load(array, 0), "load atomic i64, ptr"),
        (lambda array: ring.store(array, 0, 1), "store atomic i64 1, ptr"),
    ],
    ids=["acquire", "release"],
)
def test_loads_and_stores_are_ordered(
    operation: Callable[[Integers], int], instruction: str
) -> None:
    compiled = njit(operation)
    compiled(np.zeros(1, dtype=np.int64))
    (lines,) = compiled.inspect_llvm().values()
    (line,) = [line for line in lines.splitlines() if instruction in line]
    assert ("acquire" in line) is ("load" in instruction)
    assert ("release" in line) is ("store" in instruction)


def test_memory_is_reached_by_its_address() -> None:
    integers, reals = np.arange(4), np.linspace(0, 1, 4)
    assert np.array_equal(memory.integers_at(integers.ctypes.data, 4), integers)
    assert np.array_equal(memory.reals_at(reals.ctypes.data, 4), reals)

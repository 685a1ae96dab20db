"""A queue of fixed-size records between one writer and one reader, without a lock.

Records lie in plain memory, each of some integers and some reals. The writer fills the next slot
and then moves `WRITTEN` (release); the reader sees it move (acquire), reads the slot in place and
then moves `READ`. Each count has one owner and only grows, so neither side ever waits for the
other (L. Lamport, "Specifying concurrent program modules", ACM TOPLAS 5(2), 1983).

The functions here are compiled; they take `Ring.memory`, which a callback reaches by its address.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.live import atomics

Integers = NDArray[np.int64]
Reals = NDArray[np.float64]

# Places in the head of the memory. What different threads write is 128 bytes apart: the pair of
# cache lines that a processor fetches together.
CAPACITY, INTEGERS, REALS = 0, 1, 2
WRITTEN, REFUSED = 16, 17
READ, EMPTY = 32, 33
_HEAD = 48


@njit(cache=True, nogil=True, error_model="numpy")
def waiting(memory: Integers) -> int:
    """Return how many records are written and not yet released."""
    return atomics.load(memory, WRITTEN) - atomics.load(memory, READ)


@njit(cache=True, nogil=True, error_model="numpy")
def integers_of(memory: Integers, count: int) -> Integers:
    """Return the integers (I,) in the slot of the record of this number, counted from 0."""
    size = memory[INTEGERS]
    first = _HEAD + count % memory[CAPACITY] * size
    return memory[first : first + size]


@njit(cache=True, nogil=True, error_model="numpy")
def reals_of(memory: Integers, count: int) -> Reals:
    """Return the reals (R,) in the slot of the record of this number, counted from 0."""
    size = memory[REALS]
    first = _HEAD + memory[CAPACITY] * memory[INTEGERS] + count % memory[CAPACITY] * size
    return memory[first : first + size].view(np.float64)


@njit(cache=True, nogil=True, error_model="numpy")
def release(memory: Integers) -> None:
    """Give the slot of the oldest record back to the writer."""
    atomics.store(memory, READ, memory[READ] + 1)


@njit(cache=True, nogil=True, error_model="numpy")
def pop(memory: Integers, integers: Integers, reals: Reals) -> bool:
    """Copy out the oldest record and release it; False, and counted, where there is none."""
    if waiting(memory) == 0:
        memory[EMPTY] += 1
        return False
    integers[:] = integers_of(memory, memory[READ])
    reals[:] = reals_of(memory, memory[READ])
    release(memory)
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def has_room(memory: Integers) -> bool:
    """Return whether the next record can be written; where not, it is counted as refused."""
    if waiting(memory) < memory[CAPACITY]:
        return True
    memory[REFUSED] += 1
    return False


@njit(cache=True, nogil=True, error_model="numpy")
def publish(memory: Integers) -> None:
    """Hand the slot that was just written to the reader."""
    atomics.store(memory, WRITTEN, memory[WRITTEN] + 1)


@njit(cache=True, nogil=True, error_model="numpy")
def push(memory: Integers, integers: Integers, reals: Reals) -> bool:
    """Copy in a record; False, and counted, where the ring is full."""
    if not has_room(memory):
        return False
    integers_of(memory, memory[WRITTEN])[:] = integers
    reals_of(memory, memory[WRITTEN])[:] = reals
    publish(memory)
    return True


class Ring:
    """Memory of a ring, and its writer's side.

    Parameters
    ----------
    capacity : int
        Records that fit, at least 1.
    integers, reals : int
        Of each record; either may be 0.

    Attributes
    ----------
    memory : array, int64
        What the compiled functions take. It must live as long as anybody reads it.

    Raises
    ------
    OptionError
        On a capacity below 1 or a negative size.
    """

    def __init__(self, *, capacity: int, integers: int, reals: int) -> None:
        if capacity < 1 or integers < 0 or reals < 0:
            raise OptionError(
                f"a ring of {capacity} records of {integers} integers and {reals} reals: "
                "give at least 1 record, and sizes of at least 0"
            )
        self.memory: Integers = np.zeros(_HEAD + capacity * (integers + reals), dtype=np.int64)
        self.memory[[CAPACITY, INTEGERS, REALS]] = capacity, integers, reals
        self._integers = self.memory[_HEAD : _HEAD + capacity * integers].reshape(capacity, -1)
        self._reals = (
            self.memory[_HEAD + capacity * integers :].view(np.float64).reshape(capacity, -1)
        )
        self._capacity = capacity

    @property
    def address(self) -> int:
        """Where the memory begins."""
        return self.memory.ctypes.data

    @property
    def waiting(self) -> int:
        """Records written and not yet released."""
        return waiting(self.memory)

    @property
    def refused(self) -> int:
        """Records that found the ring full."""
        return int(self.memory[REFUSED])

    @property
    def empty(self) -> int:
        """How often `pop` found nothing."""
        return int(self.memory[EMPTY])

    def push(self, integers: Integers, reals: Reals) -> bool:
        """Copy in a record, int64 (I,) and float64 (R,); False, and counted, where it is full."""
        return push(self.memory, integers, reals)

    def reserve(self) -> tuple[Integers, Reals] | None:
        """Return the next slot, (I,) and (R,), to be written in place; None where it is full.

        It holds what was written there `capacity` records ago. `publish` hands it over.
        """
        if not has_room(self.memory):
            return None
        slot = int(self.memory[WRITTEN]) % self._capacity
        return self._integers[slot], self._reals[slot]

    def publish(self) -> None:
        """Hand over the slot that `reserve` returned."""
        publish(self.memory)

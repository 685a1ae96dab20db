"""Records by hand: into a ring as the feeder writes them, out of it as the callback reads them."""

from __future__ import annotations

from numba import njit

from struck.live import ring
from struck.live.ring import Ring
from struck.model.arrays import Array, Index


def push(records: Ring, integers: Index, reals: Array) -> bool:
    """Copy in a record; False where the ring is full."""
    slot = records.reserve()
    if slot is None:
        return False
    slot[0][:], slot[1][:] = integers, reals
    records.publish()
    return True


@njit(nogil=True)
def pop(memory: Index, integers: Index, reals: Array) -> bool:
    """Copy out the oldest record and release it; False where there is none."""
    if ring.waiting(memory) == 0:
        return False
    integers[:] = ring.integers_of(memory, memory[ring.READ])
    reals[:] = ring.reals_of(memory, memory[ring.READ])
    ring.release(memory)
    return True

"""Records by hand: into a ring as the feeder writes them, out of it as the callback reads them."""

from __future__ import annotations

from struck.core import compiled
from struck.live.ring import INTEGERS, READ, REALS, Ring
from struck.model.arrays import Array, Index


def push(records: Ring, integers: Index, reals: Array) -> bool:
    """Copy in a record; False where the ring is full."""
    slot = records.reserve()
    if slot is None:
        return False
    slot[0][:], slot[1][:] = integers, reals
    records.publish()
    return True


def pop(memory: Index, integers: Index, reals: Array) -> bool:
    """Copy out the oldest record and release it; False where there is none."""
    if compiled("queue_waiting")(memory) == 0:
        return False
    capacity, (whole, real) = memory[0], memory[[INTEGERS, REALS]]
    slot, head = memory[READ] % capacity, 48
    integers[:] = memory[head + slot * whole :][:whole]
    reals[:] = memory[head + capacity * whole + slot * real :][:real].view(float)
    compiled("queue_release")(memory)
    return True

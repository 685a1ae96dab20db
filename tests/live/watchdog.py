"""A thread of real-time priority on each processor that does nothing but wake up on time.

When it is late, no program could have made sound then: the machine itself stood still. Prints the
times by which it was late, ms, once its input is closed.
"""

from __future__ import annotations

import os
import select
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

LATE = 1e-3
_NAP = 5e-4


@contextmanager
def stalls() -> Iterator[list[float]]:
    """Watch meanwhile; the list is filled at the end."""
    found: list[float] = []
    process = subprocess.Popen(
        [sys.executable, __file__], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    yield found
    told, _ = process.communicate()
    found += [float(word) for word in told.split()]


def _watch(processor: int, late: list[float]) -> None:
    os.sched_setaffinity(0, {processor})
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(20))
    while not select.select([sys.stdin], [], [], 0)[0]:
        before = time.perf_counter()
        time.sleep(_NAP)
        over = time.perf_counter() - before - _NAP
        if over > LATE:
            late.append(1e3 * over)


def _main() -> None:
    late: list[float] = []
    watches = [
        threading.Thread(target=_watch, args=(processor, late))
        for processor in os.sched_getaffinity(0)
    ]
    for watch in watches:
        watch.start()
    for watch in watches:
        watch.join()
    sys.stdout.write(" ".join(f"{each:.1f}" for each in late))


if __name__ == "__main__":
    _main()

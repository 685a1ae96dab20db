"""The thread that keeps a ring filled a few blocks ahead of the audio device.

The callback must not wake anybody: that could make it wait. So the thread looks again after half a
block, asleep in between. What delays it is the interpreter's lock: another thread that computes
in Python lets go of it only once a switch interval, by default 5 ms, as long as two blocks of 128
samples. While the feeder runs the interval is 0.05 ms: excitations let go of the lock several
times in a block, wherever compiled code or NumPy works, and wait for it each time.
"""

from __future__ import annotations

import contextlib
import os
import sys
import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from struck.live.ring import Ring

_SWITCH_INTERVAL = 0.00005  # s


class _Haste:
    """The interpreter's switch interval: short while any feeder runs, then as it was before."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._feeders, self._usual = 0, 0.0

    def begin(self) -> None:
        with self._lock:
            if not self._feeders:
                self._usual = sys.getswitchinterval()
                sys.setswitchinterval(min(_SWITCH_INTERVAL, self._usual))
            self._feeders += 1

    def end(self) -> None:
        with self._lock:
            self._feeders -= 1
            if not self._feeders:
                sys.setswitchinterval(self._usual)


_HASTE = _Haste()  # one for the interpreter, as is the interval


class Feeder:
    """Fills a ring, block after block, until it is stopped.

    Parameters
    ----------
    records : Ring
        Of at least `ahead` + 1 records: the one being heard keeps its slot.
    fill : callable (integers, reals)
        Writes the next record in place, (I,) and (R,); called from the feeder's thread. The slot
        holds an older record before.
    seconds : float
        Of a block.
    ahead : int
        Blocks kept ready. Each is one block more between a touch and its sound.

    Attributes
    ----------
    longest : float
        The longest time between two looks at the ring, s; beyond `ahead` blocks something was late.
    failure : Exception or None
        What `fill` raised in the thread, which ended it.
    """

    def __init__(
        self,
        records: Ring,
        fill: Callable[[NDArray[np.int64], NDArray[np.float64]], None],
        *,
        seconds: float,
        ahead: int = 2,
    ) -> None:
        self.longest = 0.0
        self._records = records
        self._fill = fill
        self._nap = seconds / 2
        self._ready = ahead + 1
        self.failure: Exception | None = None
        self._stopping = self._started = False
        self._thread = threading.Thread(target=self._run, name="struck feeder", daemon=True)

    def start(self) -> None:
        """Fill the ring for the first time, and go on in a thread."""
        self._top_up()
        self._thread.start()
        _HASTE.begin()
        self._started = True

    def stop(self) -> None:
        """Return when the thread has ended, if it ever began; raise what `fill` raised, if it did.

        More than once does no harm.
        """
        self._stopping = True
        if not self._started:
            return
        self._started = False
        self._thread.join()
        _HASTE.end()
        if self.failure is not None:
            raise self.failure

    @property
    def running(self) -> bool:
        """Whether it still fills: not once `fill` raised."""
        return self._thread.is_alive()

    def _run(self) -> None:
        _hurry()
        looked = time.perf_counter()
        try:
            while not self._stopping:
                self._top_up()
                time.sleep(self._nap)
                now = time.perf_counter()
                self.longest = max(self.longest, now - looked)
                looked = now
        except Exception as failure:  # noqa: BLE001 - `stop` raises it in the caller's thread
            self.failure = failure

    def _top_up(self) -> None:
        while self._records.waiting < self._ready:
            slot = self._records.reserve()
            if slot is None:
                return
            self._fill(*slot)
            self._records.publish()


def _hurry() -> None:
    """Let this thread run before all that is not in a hurry, where the system allows that."""
    if sys.platform == "linux":
        with contextlib.suppress(OSError):
            os.sched_setscheduler(threading.get_native_id(), os.SCHED_RR, os.sched_param(1))

"""What a player was told and has not done yet.

Wishes wait in a queue until the feeder fills the next block. Within that block they take effect as
far apart as they were said: what was said just after the last block was filled comes at its first
sample, what was said just now at its last.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable

Wish = Callable[[int], object]
"""Given the number of the sample at which it takes effect."""

MOST_WISHES = 1024
"""That may wait for the next block; what is beyond is dropped and counted."""


class Wishes:
    """A queue that any thread may add to and one empties, block by block.

    Parameters
    ----------
    clock : callable
        The time, s.
    block : int
        Samples.
    sample_rate : float
        Hz.

    Attributes
    ----------
    refused : int
        Wishes that there was no room for.
    """

    def __init__(self, clock: Callable[[], float], *, block: int, sample_rate: float) -> None:
        self._clock, self._block, self._length = clock, block, block / sample_rate
        self._waiting: deque[tuple[float, Wish]] = deque()
        self._lock = threading.Lock()
        self.refused, self._obeyed = 0, clock()

    @property
    def idle(self) -> float:
        """How long ago they were last obeyed, s."""
        return self._clock() - self._obeyed

    def have_room(self) -> bool:
        """Tell whether one more may wait; where not, it counts as refused."""
        if len(self._waiting) < MOST_WISHES:
            return True
        with self._lock:
            self.refused += 1
        return False

    def add(self, wish: Wish) -> None:
        """Let one more wait."""
        if self.have_room():
            self._waiting.append((self._clock(), wish))

    def obey(self, sample: int) -> None:
        """Do what was wished since the last time, in the block that begins at this sample."""
        now, last = self._clock(), 0
        for _ in range(len(self._waiting)):
            said, wish = self._waiting.popleft()
            place = int((said - self._obeyed) / self._length * self._block)
            last = max(last, min(place, self._block - 1))
            wish(sample + last)
        self._obeyed = now

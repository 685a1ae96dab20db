"""What a player was told and has not done yet.

Wishes wait in a queue until the feeder fills the next block. Within that block they take effect as
far apart as they were said: what was said just after the last block was filled comes at its first
sample, what was said just now at its last.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable

from struck.live.troubles import Troubles

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
    troubles : Troubles
        Where it is noted that a wish failed.

    Attributes
    ----------
    refused : int
        Wishes that there was no room for.
    """

    def __init__(
        self,
        clock: Callable[[], float],
        *,
        block: int,
        sample_rate: float,
        troubles: Troubles,
    ) -> None:
        self._clock, self._block, self._length = clock, block, block / sample_rate
        self._troubles = troubles
        self._waiting: dict[Hashable, tuple[float, Wish]] = {}
        self._lock = threading.Lock()
        self.refused, self._obeyed = 0, clock()

    @property
    def idle(self) -> float:
        """How long ago they were last obeyed, s."""
        return self._clock() - self._obeyed

    def have_room(self) -> bool:
        """Tell whether one more may wait; where not, it counts as refused."""
        with self._lock:
            return self._have_room()

    def add(self, wish: Wish) -> bool:
        """Let one more wait; False where there is no room."""
        with self._lock:
            room = self._have_room()
            if room:
                self._waiting[object()] = self._clock(), wish
            return room

    def put(self, key: Hashable, wish: Wish) -> None:
        """Let a wish wait in place of an older one of the same key: there is always room."""
        with self._lock:
            self._waiting.pop(key, None)  # the new one comes last
            self._waiting[key] = self._clock(), wish

    def obey(self, sample: int) -> None:
        """Do what was wished since the last time, in the block that begins at this sample."""
        now, last = self._clock(), 0
        with self._lock:
            waiting, self._waiting = self._waiting, {}
        for said, wish in waiting.values():
            place = int((said - self._obeyed) / self._length * self._block)
            last = max(last, min(place, self._block - 1))
            try:
                wish(sample + last)
            except Exception as trouble:  # noqa: BLE001 - told to whoever plays; all else goes on
                self._troubles.note(trouble)
        self._obeyed = now

    def _have_room(self) -> bool:
        if len(self._waiting) < MOST_WISHES:
            return True
        self.refused += 1
        return False

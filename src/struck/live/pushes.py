"""What pushes while a person plays: strikes that share a place, excitations that may be stopped."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.excitation.pulses import Samples
from struck.excitation.pushing import Changing, Push, Pushing
from struck.model.model import ModalModel

Array = NDArray[np.float64]

MOST_BLOWS = 256
"""Strikes at one place that may be under way."""
_FADE = 5e-3  # s


class Blows:
    """A `Pushing` that takes ever more strikes at one place.

    Parameters
    ----------
    drive : array (M,)
        How strongly each mode answers there, kg^-1/2.
    start : int
        Number of the sample at which the first block begins.
    """

    def __init__(self, drive: Array, *, start: int) -> None:
        self.drive = drive
        self._now = start
        self._blows: list[Samples] = []

    def add(self, blow: Samples) -> bool:
        """Take one more; False where there are too many already."""
        if len(self._blows) >= MOST_BLOWS:
            return False
        self._blows.append(blow)
        return True

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, None where there is no force in them."""
        force = np.zeros(length)
        parts = [_add(blow, force, self._now) for blow in self._blows]
        self._now += length
        self._blows = [blow for blow in self._blows if blow.first + len(blow.force) > self._now]
        return Push(force=force, drive=self.drive) if any(parts) else None

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return not self._blows


def _add(blow: Samples, force: Array, now: int) -> bool:
    """Add what falls in a block; tell whether anything does."""
    begin = max(blow.first - now, 0)
    part = blow.force[max(now - blow.first, 0) : max(now + len(force) - blow.first, 0)]
    force[begin : begin + len(part)] += part
    return len(part) > 0


class Started:
    """An excitation at work; `stop` lets it go within 5 ms."""

    def __init__(self, pushing: Pushing, sample_rate: float) -> None:
        self._pushing = pushing
        self._fade = max(1, round(_FADE * sample_rate))
        self._left: int | None = None

    def stop(self) -> None:
        """Let go; more than once does no harm."""
        if self._left is None:
            self._left = self._fade

    def end(self) -> None:
        """Let nothing come any more, at once: for what found no voice, or could not go on."""
        self._left = 0

    def change(self, model: ModalModel) -> None:
        """Go on, where it can, on a body that has changed."""
        if isinstance(self._pushing, Changing):
            self._pushing.change(model)

    @property
    def finished(self) -> bool:
        """Whether no force will come any more."""
        return self._left == 0 or self._pushing.finished

    def advance(self, length: int) -> Push | None:
        """Return the push of the next `length` samples, None where there is no force in them."""
        left = self._left  # `stop` may be called from another thread
        push = self._pushing.advance(length)
        if left is None:
            return push
        self._left = max(0, left - length)
        if push is None:
            return None
        shares = np.clip((left - np.arange(1, length + 1)) / self._fade, 0.0, 1.0)
        falling = np.square(np.sin(np.pi / 2 * shares))
        return Push(force=push.force * falling, drive=push.drive)

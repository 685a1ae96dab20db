"""Straight lines between what is said now and then."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class Ramp:
    """A number that goes in straight lines, sample by sample.

    Attributes
    ----------
    value, target : float
        Where it is, and where it goes.
    """

    def __init__(self, value: float = 0.0) -> None:
        self.value = self.target = value
        self._left = 0

    def toward(self, target: float, samples: int) -> None:
        """Set out for a target, to be reached after so many samples; 0 is at once."""
        self.target, self._left = target, samples
        if samples == 0:
            self.value = target

    def take(self, count: int) -> Array:
        """Return the next values (count,)."""
        if self._left == 0 or count == 0:
            return np.full(count, self.value)
        shares = np.minimum(np.arange(1, count + 1) / self._left, 1.0)
        values = self.value + shares * (self.target - self.value)
        self._left = max(0, self._left - count)
        self.value = float(values[-1]) if self._left else self.target
        return values


class Blend:
    """An array that goes in straight lines; the same object for as long as it stays.

    Attributes
    ----------
    now : array (M,)
        Where it is.
    """

    def __init__(self) -> None:
        self.now: Array = np.zeros(0)
        self._target = self.now
        self._left = 0

    def toward(self, target: Array, samples: int) -> None:
        """Set out for a target, to be reached after so many samples; 0 is at once."""
        self._target, self._left = target, samples
        if samples == 0 or target is self.now:
            self.now, self._left = target, 0

    def go(self, count: int) -> None:
        """Move on by so many samples."""
        if not self._left or not count:
            return
        share = min(count / self._left, 1.0)
        self._left = max(0, self._left - count)
        self.now = self.now + share * (self._target - self.now) if self._left else self._target

"""What a head does to sound on its way to its two ears.

The head's own frame has x forward, y to the left and z up; ear 0 is the left one.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError

Array = NDArray[np.float64]
Single = NDArray[np.float32]
LOWEST_RATE = 4000.0
"""Hz; below, a head changes next to nothing."""


class Filters(Protocol):
    """A head at one sample rate."""

    @property
    def taps(self) -> int:
        """Length of its responses."""
        ...

    def toward(self, directions: Array, distances: Array) -> tuple[Array, Single]:
        """Tell what reaches the ears of sound from afar or near.

        Parameters
        ----------
        directions : array (n, 3)
            From the head's centre to the source, of length one, in the head's frame.
        distances : array (n,)
            m, from the head's centre.

        Returns
        -------
        delays : array (n, 2)
            How much later than at the head's centre, were there no head, s; may be negative.
        responses : array (n, 2, taps), float32
            What to convolve that sound with.
        """
        ...


class Head(Protocol):
    """A head, for any sample rate."""

    @property
    def name(self) -> str:
        """What it is called."""
        ...

    @property
    def references(self) -> tuple[str, ...]:
        """Keys of the papers behind it."""
        ...

    def prepared(self, sample_rate: float) -> Filters:
        """Return its filters; work that takes long is done here, and kept."""
        ...


def require_rate(sample_rate: float, highest: float) -> None:
    """Refuse a sample rate, Hz, for which no head can be prepared."""
    if not LOWEST_RATE <= sample_rate <= highest:
        raise OptionError(
            f"sample_rate {sample_rate:g} Hz must be between {LOWEST_RATE:g} and {highest:g} Hz; "
            "48000 Hz is enough for ears"
        )

"""Progress of long work: stages with the fraction done, told to whoever asks."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

Progress = Callable[[str, float], None]


def silent(_stage: str, _fraction: float) -> None:
    """Tell nobody."""


class TerminalProgress:
    """One line on a terminal: the stage, how much is done, and about how long the rest takes.

    Nothing where there is no terminal.
    """

    def __init__(self) -> None:
        self._stream = sys.stderr
        self._shown = self._stream.isatty()
        self._stage, self._begun = "", time.monotonic()

    def __call__(self, stage: str, fraction: float) -> None:
        """Show a stage and the fraction of it that is done."""
        now = time.monotonic()
        if stage != self._stage:
            self._stage, self._begun = stage, now
        if self._shown:
            self._stream.write(f"\r\x1b[K{stage}{_share(fraction, now - self._begun)}")
            self._stream.flush()

    def close(self) -> None:
        """Clear the line."""
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()


def _share(fraction: float, passed: float) -> str:
    """Tell the fraction done and, once it means something, the time that is left."""
    if not fraction:
        return ""
    left = passed * (1 / fraction - 1)
    known = 0.02 <= fraction < 1 and left >= 1
    return f" {100 * fraction:3.0f} %" + (f", about {left:.0f} s left" if known else "")

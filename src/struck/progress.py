"""Progress of long work: stages with the fraction done, told to whoever asks."""

from __future__ import annotations

import sys
from collections.abc import Callable

Progress = Callable[[str, float], None]


def silent(_stage: str, _fraction: float) -> None:
    """Tell nobody."""


class TerminalProgress:
    """One line on a terminal that tells the stage; nothing where there is no terminal."""

    def __init__(self) -> None:
        self._stream = sys.stderr
        self._shown = self._stream.isatty()

    def __call__(self, stage: str, fraction: float) -> None:
        """Show a stage and the fraction of it that is done."""
        if self._shown:
            share = f" {100 * fraction:3.0f} %" if fraction else ""
            self._stream.write(f"\r\x1b[K{stage}{share}")
            self._stream.flush()

    def close(self) -> None:
        """Clear the line."""
        if self._shown:
            self._stream.write("\r\x1b[K")
            self._stream.flush()

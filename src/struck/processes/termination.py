"""Orderly end of a process by SIGTERM, and by SIGHUP of a terminal that is closed."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_SIGNALS = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
# s, chosen by judgement: signals within this time of the first are one request, since a shell and
# the system may both send SIGHUP.
_REPEAT_SECONDS = 2.0


@contextmanager
def orderly_end() -> Iterator[None]:
    """Let SIGTERM and SIGHUP interrupt a block as Ctrl-C does, and end the process after it.

    By default they end a process at once, and leave files that the block would remove. Nothing
    changes in other threads than the main one, nor for a signal that the program handles or
    ignores.
    """
    signals: list[tuple[int, float]] = []

    def interrupt(number: int, _frame: FrameType | None) -> None:
        if not signals or time.monotonic() - signals[-1][1] > _REPEAT_SECONDS:
            signals.append((number, time.monotonic()))
            raise KeyboardInterrupt

    is_main_thread = threading.current_thread() is threading.main_thread()
    numbers = [n for n in _SIGNALS if is_main_thread and signal.getsignal(n) is signal.SIG_DFL]
    for number in numbers:
        signal.signal(number, interrupt)
    try:
        yield
    finally:
        for number in numbers:
            signal.signal(number, signal.SIG_DFL)
        if signals:
            signal.raise_signal(signals[0][0])
            # SIGTERM by default does not end the first process of a container.
            raise SystemExit(128 + signals[0][0])

"""Orderly end of a process by SIGTERM, and by SIGHUP of a terminal that is closed."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_SIGNALS = [getattr(signal, name) for name in ("SIGTERM", "SIGHUP") if hasattr(signal, name)]
# s, chosen by judgement: within it further ones are the same wish, as a shell and the system both
# send SIGHUP.
_REPEATED = 2.0


@contextmanager
def orderly_end() -> Iterator[None]:
    """Let SIGTERM and SIGHUP interrupt a block as Ctrl-C does, and end the process after it.

    They would end it at once, and leave what the block removes. Nothing changes in other threads
    than the main one, nor for a signal that the program handles or ignores.
    """
    came: list[tuple[int, float]] = []

    def take(number: int, _frame: FrameType | None) -> None:
        if not came or time.monotonic() - came[-1][1] > _REPEATED:
            came.append((number, time.monotonic()))
            raise KeyboardInterrupt

    in_main = threading.current_thread() is threading.main_thread()
    taken = [each for each in _SIGNALS if in_main and signal.getsignal(each) is signal.SIG_DFL]
    for number in taken:
        signal.signal(number, take)
    try:
        yield
    finally:
        for number in taken:
            signal.signal(number, signal.SIG_DFL)
        if came:
            signal.raise_signal(came[0][0])
            # It does not end the first process of a container.
            raise SystemExit(128 + came[0][0])

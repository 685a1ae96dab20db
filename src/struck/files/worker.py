"""The process that reads foreign files, so that a hostile one cannot harm the program.

Started by `guard`; asked on standard input, answers on standard output, ends with either.
"""

from __future__ import annotations

import contextlib
import faulthandler
import importlib
import json
import os
import signal
import sys
from pathlib import Path

from struck.errors import StruckError
from struck.files.messages import (
    BROKEN,
    DAMAGED,
    OUT_OF_MEMORY,
    TASKS,
    UNREADABLE,
    Answer,
    Frame,
    ReadingLimits,
    read_frame,
    write_frame,
)

_GRACE = 2.0  # s, after which a question ends the process if its parent has not


def main() -> None:
    """Answer requests one after the other, until standard input ends."""
    limits = ReadingLimits(**json.loads(sys.argv[1]))
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the program
    # Standard output is for answers: readers print to nowhere.
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    _confine(limits.memory)
    with contextlib.suppress(EOFError, OSError):
        write_frame(answers, {"ready": True})
        while True:
            frame = read_frame(sys.stdin.buffer, largest=limits.answer)
            question = frame.content
            # The asker ends this process in time, unless it has died itself.
            faulthandler.dump_traceback_later(question["wall"] + _GRACE, exit=True)
            _give(question["seconds"])
            try:
                write_frame(answers, *_answer(frame, limits))
            except MemoryError:
                os._exit(OUT_OF_MEMORY)
            _give(0)
            faulthandler.cancel_dump_traceback_later()


def _give(seconds: float) -> None:
    """End this process after `seconds` of processor time from now on; 0 for no limit."""
    if hasattr(signal, "setitimer"):
        # By the system itself: compiled code would not let Python end it.
        signal.signal(signal.SIGPROF, signal.SIG_DFL)
        signal.setitimer(signal.ITIMER_PROF, seconds)


def _confine(memory: int) -> None:
    """Limit the address space, where the system can, and leave no image of a crash."""
    with contextlib.suppress(ImportError, OSError, ValueError):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        hard_limit = resource.getrlimit(resource.RLIMIT_AS)[1]
        limit_bytes = memory if hard_limit == resource.RLIM_INFINITY else min(memory, hard_limit)
        resource.setrlimit(resource.RLIMIT_AS, (limit_bytes, limit_bytes))


def _answer(frame: Frame, limits: ReadingLimits) -> Answer:
    """Return the answer of a task, or the error that its reader raises."""
    question = frame.content
    arrays = {"arrays": frame.arrays} if frame.arrays else {}
    try:
        module, _, name = TASKS[question["task"]].partition(":")
        read = getattr(importlib.import_module(module), name)
        return read(Path(question["path"]), limits, **question["options"], **arrays)
    except StruckError as error:
        return {"error": type(error).__name__, "message": str(error)}, []
    except OSError as error:
        return {"error": UNREADABLE, "message": error.strerror or str(error)}, []
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001 - a reader of foreign bytes may raise anything
        # So C++ reports what it did not foresee, as that memory ran out; MuJoCo may hang then.
        name = BROKEN if type(error) is RuntimeError else DAMAGED
        return {"error": name, "message": f"{type(error).__name__}: {error}"}, []

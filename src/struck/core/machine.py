"""Memory, processors and threads of this machine that long work may use."""

from __future__ import annotations

import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

from struck.errors import OptionError
from struck.processes.address_space import free_address_space

GIB = 2**30
THREADS = "STRUCK_THREADS"  # variable of the environment
_Arguments = ParamSpec("_Arguments")
_Result = TypeVar("_Result")


def thread_count() -> int:
    """Return the threads of a factorisation: STRUCK_THREADS, else the cores we own, at most 4.

    Without STRUCK_THREADS, OMP_NUM_THREADS counts if it is set. Where the address space is limited
    there is one, as each takes some 100 MB of it.
    """
    setting = os.environ.get("OMP_NUM_THREADS", "")
    count = int(setting) if setting.isdigit() and int(setting) > 0 else min(cores(), 4)
    return threads_told() or (count if free_address_space() is None else 1)


def threads_told() -> int | None:
    """Return the number of threads in STRUCK_THREADS, None where it is not set."""
    setting = os.environ.get(THREADS, "")
    if setting and not (setting.isdecimal() and 0 < int(setting) <= 1024):
        raise OptionError(
            f"{THREADS} is {setting!r}: set a whole number from 1 to 1024, or unset it"
        )
    return int(setting) if setting else None


def in_few_threads(work: Callable[_Arguments, _Result]) -> Callable[_Arguments, _Result]:
    """Let matrix products within a function use one thread, or as many as STRUCK_THREADS says."""

    # Blocks of vectors are many and small: more threads mostly wait, busily (`bench/threads.py`).
    @functools.wraps(work)
    def limited(*arguments: _Arguments.args, **keywords: _Arguments.kwargs) -> _Result:
        with threadpool_limits(threads_told() or 1, user_api="blas"):
            return work(*arguments, **keywords)

    return limited


def cores() -> int:
    """Return how many processors this process may use."""
    owned = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return owned or 1


def available(root: Path = Path("/")) -> int | None:
    """Return the bytes free for this process, or None where they are unknown.

    On Linux: of the machine, of control groups, and of the address space.
    """
    limits = [_free_on_machine(root), free_address_space(root), *_free_in_groups(root)]
    return min((limit for limit in limits if limit is not None), default=None)


def _free_on_machine(root: Path) -> int | None:
    for line in _lines(root / "proc/meminfo"):
        name, _, amount = line.partition(":")
        if name == "MemAvailable":
            return 1024 * int(amount.split()[0])
    return None


def _free_in_groups(root: Path) -> list[int]:
    """Return the bytes that each control group (version 2, or version 1's memory) leaves free."""
    free = []
    for line in _lines(root / "proc/self/cgroup"):
        _, controllers, path = line.split(":", 2)
        if not controllers:
            top, names = root / "sys/fs/cgroup", ("memory.max", "memory.current")
        elif "memory" in controllers.split(","):
            top = root / "sys/fs/cgroup/memory"
            names = ("memory.limit_in_bytes", "memory.usage_in_bytes")
        else:
            continue
        group = top / path.lstrip("/")
        for folder in (group, *group.parents):
            if folder.is_relative_to(top):
                limit, usage = (_number(folder / name) for name in names)
                if limit is not None and usage is not None:
                    free.append(limit - usage + _given_back(folder))
    return free


def _given_back(folder: Path) -> int:
    """Return the bytes of cached files that the system drops when memory is needed."""
    for line in _lines(folder / "memory.stat"):
        name, _, amount = line.partition(" ")
        if name in {"inactive_file", "total_inactive_file"}:
            return int(amount)
    return 0


def _number(path: Path) -> int | None:
    text = "".join(_lines(path))
    return int(text) if text.isdigit() else None


def _lines(path: Path) -> list[str]:
    if os.name != "posix":
        return []
    try:
        return path.read_text(encoding="ascii").splitlines()
    except OSError:
        return []

"""Memory and processors of this machine that are free for long work."""

from __future__ import annotations

import os
from pathlib import Path

GIB = 2**30


def thread_count() -> int:
    """Return how many threads a factorisation may use: OMP_NUM_THREADS, else the cores we own."""
    wanted = os.environ.get("OMP_NUM_THREADS", "")
    return int(wanted) if wanted.isdigit() and int(wanted) > 0 else min(cores(), 4)


def cores() -> int:
    """Return how many processors this process may use."""
    owned = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return owned or 1


def available(root: Path = Path("/")) -> int | None:
    """Return the bytes free for this process (Linux: machine and control groups), or None."""
    limits = [_free_on_machine(root), *_free_in_groups(root)]
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
                limit, used = (_number(folder / name) for name in names)
                if limit is not None and used is not None:
                    free.append(limit - used + _given_back(folder))
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

"""Memory: what a decomposition will need, and what is free."""

from __future__ import annotations

import os
from pathlib import Path

from struck.errors import SolverError

GIB = 2**30
# Bytes for each stored entry while a matrix is put together and handed over, measured.
_ENTRY = 64
# Vectors that iterating works on, over and above those it keeps.
_WORKING_VECTORS = 64


def forecast(
    *, unknowns: int, entries: int, factor: int, kept: int, modes: int, shown: int = 0
) -> int:
    """Return the most bytes that finding modes takes on top of the assembled matrices.

    Parameters
    ----------
    unknowns : int
    entries : int
        Of the matrix's lower triangle.
    factor, kept : int
        Bytes of a factorisation at its peak, and once it is there: see `Factoriser.memory`.
    modes : int
        Found with one factorisation.
    shown : int
        Numbers that are kept of all modes: shapes on the surface.
    """
    basis = 3 * modes + _WORKING_VECTORS
    iterating = _ENTRY // 2 * entries + kept + 8 * unknowns * (basis + modes)
    return max(_ENTRY * entries + factor, iterating) + 8 * shown


def require(needed: int) -> None:
    """Refuse work that does not fit.

    Raises
    ------
    SolverError
        When more is needed than is free; nothing is raised where that is unknown.
    """
    free = available()
    if free is not None and needed > free:
        raise SolverError(
            f"finding the modes needs about {needed / GIB:.1f} GiB of memory, but "
            f"{free / GIB:.1f} GiB are free: use a coarser mesh (accuracy='standard' or "
            "'preview'), a thicker wall, a narrower band=, or a machine with more memory"
        )


def available(root: Path = Path("/")) -> int | None:
    """Return the bytes that are free for this process, None where the system does not tell.

    Linux tells what is free on the machine and in each control group around the process.
    """
    limits = [_free_on_machine(root), *_free_in_groups(root)]
    return min((limit for limit in limits if limit is not None), default=None)


def _free_on_machine(root: Path) -> int | None:
    for line in _lines(root / "proc/meminfo"):
        name, _, amount = line.partition(":")
        if name == "MemAvailable":
            return 1024 * int(amount.split()[0])
    return None


def _free_in_groups(root: Path) -> list[int]:
    """Return what each control group (version 2, and version 1's memory) leaves."""
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
    """Return the bytes of files that the system keeps only as long as nobody needs the room."""
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

"""Address space of this process, which ``ulimit -v`` limits."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path


def free_address_space(root: Path = Path("/")) -> int | None:
    """Return the bytes that the limit leaves; None without one, or on other systems than Linux."""
    with suppress(OSError):
        limits = (root / "proc/self/limits").read_text(encoding="ascii")
        limit = re.search(r"^Max address space +(\d+)", limits, re.MULTILINE)
        if limit is not None:
            status = (root / "proc/self/status").read_text(encoding="ascii", errors="replace")
            used = re.search(r"^VmSize:\s+(\d+) kB", status, re.MULTILINE)
            return None if used is None else max(int(limit[1]) - 1024 * int(used[1]), 0)
    return None

"""Address space of this process, which ``ulimit -v`` limits."""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path


def free_address_space(root: Path = Path("/")) -> int | None:
    """Return the bytes that the limit leaves; None without one, or on other systems than Linux."""
    with suppress(OSError):
        limits_text = (root / "proc/self/limits").read_text(encoding="ascii")
        limit_match = re.search(r"^Max address space +(\d+)", limits_text, re.MULTILINE)
        if limit_match is not None:
            status_text = (root / "proc/self/status").read_text("ascii", errors="replace")
            size_match = re.search(r"^VmSize:\s+(\d+) kB", status_text, re.MULTILINE)
            size = None if size_match is None else 1024 * int(size_match[1])
            return None if size is None else max(int(limit_match[1]) - size, 0)
    return None

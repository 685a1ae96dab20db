"""Address space of this process, which ``ulimit -v`` limits.

Where a limit makes requests for memory fail, Python raises a MemoryError, but OpenBLAS ends the
process without it, or requests it for ever.
"""

from __future__ import annotations

import re
from contextlib import suppress
from pathlib import Path

_ORDER = 256  # of matrices for whose product OpenBLAS takes its buffer
_BUFFERS = 2**27  # bytes: two of 33 MB with NumPy's OpenBLAS, two with SciPy's


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


def reserve_blas_buffers() -> None:
    """Make both OpenBLAS, of NumPy and of SciPy, take the buffers that they keep.

    MemoryError where a limit leaves no room for them.
    """
    import numpy as np
    from scipy.linalg import blas

    free = free_address_space()
    if free is not None and free < _BUFFERS:
        raise MemoryError(f"{free} bytes are free, and {_BUFFERS} are needed")
    matrix = np.ones((_ORDER, _ORDER))
    blas.dgemm(1.0, matrix, matrix @ matrix)

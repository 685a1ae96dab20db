"""What the core can do at most: fused multiply-adds of doubles, and cycles, by `peak.c`."""

from __future__ import annotations

import ctypes
import platform
import subprocess
import tempfile
from pathlib import Path

from struck.core.build import compiler
from struck.model.arrays import AnyArray as Array

_TURNS = 20_000


def _compiled() -> ctypes.CDLL:
    """Compile `peak.c` for this very processor."""
    source = Path(__file__).with_suffix(".c")
    with tempfile.TemporaryDirectory() as folder:
        library = Path(folder) / "peak.so"
        options = [
            "-O3",
            "-mcpu=native",
            "-mprefer-vector-width=512",
            "-ffp-contract=fast",
            "-shared",
        ]
        subprocess.run(
            [*compiler(), *options, "-fPIC", "-fno-sanitize=all", "-o", library, source], check=True
        )
        return ctypes.CDLL(str(library))


LIBRARY = _compiled()
LIBRARY.multiply_adds.restype = ctypes.c_double
WIDTH = LIBRARY.width()
MULTIPLY_ADDS = _TURNS * LIBRARY.multiply_adds_a_turn()
"""In a call of `multiply_adds`."""
CYCLES = 3 * 8 * _TURNS
"""In a call of `wait`."""


def multiply_adds() -> None:
    """Do `MULTIPLY_ADDS` of them."""
    LIBRARY.multiply_adds(ctypes.c_int64(_TURNS))


def wait() -> None:
    """Let `CYCLES` pass."""
    LIBRARY.wait_for(ctypes.c_int64(_TURNS))


def blocks(make: int, reals: Array, wholes: Array, count: int) -> None:
    """Let the function at an address make so many blocks from real and whole numbers."""
    places = (ctypes.c_void_p(each) for each in (make, reals.ctypes.data, wholes.ctypes.data))
    LIBRARY.blocks(*places, ctypes.c_int64(count))


def machine() -> str:
    """Return what the processor calls itself."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    name = names[0] if names else platform.processor() or platform.machine()
    return f"{name}, vectors of {WIDTH} doubles"

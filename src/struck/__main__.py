"""Start of the command `struck`: what must be settled before NumPy is imported."""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from pathlib import Path

_VARIABLE = "OPENBLAS_CORETYPE"
_ZEN_5 = 0x1A


def blas_kernels(processor: str, environment: Mapping[str, str]) -> str | None:
    """Return which of OpenBLAS's kernels this process should ask for, None to leave it alone.

    The OpenBLAS in NumPy's wheels does not know AMD's Zen 5 and takes kernels without AVX-512
    there, which are 1.7 times slower at products of matrices.

    Parameters
    ----------
    processor : str
        Linux's description of the processors, ``/proc/cpuinfo``.
    environment : mapping
        Of the process; what a person has set stays.
    """
    if _VARIABLE in environment:
        return None
    rows = (line.partition(":") for line in processor.partition("\n\n")[0].splitlines())
    facts = {name.strip(): value.strip() for name, _, value in rows}
    zen_5 = facts.get("vendor_id") == "AuthenticAMD" and facts.get("cpu family") == str(_ZEN_5)
    return "SkylakeX" if zen_5 and "avx512f" in facts.get("flags", "").split() else None


def main() -> int:
    """Run the command in a process of its own."""
    if sys.platform == "linux" and "numpy" not in sys.modules:
        try:
            processor = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
        except OSError:
            processor = ""
        kernels = blas_kernels(processor, os.environ)
        if kernels is not None:
            os.environ[_VARIABLE] = kernels
    from struck.cli import main as run

    return run()


if __name__ == "__main__":
    sys.exit(main())

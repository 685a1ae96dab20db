"""Python processes that struck starts: none imports a module from the current folder.

With ``-m`` or ``-c`` alone Python looks for modules in the current folder first, so that a file
``numpy.py`` beside a downloaded mesh would run.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_SAFE = "PYTHONSAFEPATH"  # variable of the environment, which does as -P
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def python_command(*arguments: str) -> list[str]:
    """Return the command line of this interpreter without the current folder among its modules."""
    return [sys.executable, "-P", *arguments]


def python_environment() -> dict[str, str]:
    """Return the environment of a child: the modules of this process, and one thread for BLAS."""
    package = Path(__file__).resolve().parents[2]
    folders = [str(Path(path).absolute()) for path in (*sys.path, package) if path]
    # A name with a separator in it would be read as two.
    modules = os.pathsep.join(each for each in dict.fromkeys(folders) if os.pathsep not in each)
    return {**os.environ, **_ONE_THREAD, "PYTHONPATH": modules}


@contextmanager
def safe_children() -> Iterator[None]:
    """Let each Python that a library starts within a block pass over the current folder, too."""
    before = os.environ.get(_SAFE)
    os.environ[_SAFE] = "1"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_SAFE]
        else:
            os.environ[_SAFE] = before

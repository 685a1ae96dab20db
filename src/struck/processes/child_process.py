"""Python processes that struck starts: none imports a module from the current folder.

With ``-m`` or ``-c`` alone Python looks for modules in the current folder first, so that a file
``numpy.py`` in the folder of a downloaded mesh would run.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

_VARIABLE_NAME = "PYTHONSAFEPATH"  # of the environment, with the effect of -P
_SINGLE_THREAD_SETTINGS = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"
)


def python_command(*arguments: str) -> list[str]:
    """Return the command line of this interpreter without the current folder among its modules."""
    return [sys.executable, "-P", *arguments]


def python_environment() -> dict[str, str]:
    """Return the environment of a child: the modules of this process, and one thread for BLAS."""
    package = Path(__file__).resolve().parents[2]
    folders = [str(Path(path).absolute()) for path in (*sys.path, package) if path]
    # A name with a separator in it would be read as two.
    modules = os.pathsep.join(
        folder for folder in dict.fromkeys(folders) if os.pathsep not in folder
    )
    return {**os.environ, **_SINGLE_THREAD_SETTINGS, "PYTHONPATH": modules}


@contextmanager
def safe_children() -> Iterator[None]:
    """Start no Python within a block that imports from the current folder, in libraries too."""
    previous = os.environ.get(_VARIABLE_NAME)
    os.environ[_VARIABLE_NAME] = "1"
    try:
        yield
    finally:
        if previous is None:
            del os.environ[_VARIABLE_NAME]
        else:
            os.environ[_VARIABLE_NAME] = previous

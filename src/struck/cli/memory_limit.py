"""Commands in little memory: refused before libraries end the process, or stopped with a reason.

What a limit does to libraries is explained in `struck.processes.address_space`.
"""

from __future__ import annotations

import errno
import os
import re

from struck.processes.address_space import free_address_space, reserve_blas_buffers

_MIB = 2**20
# Address space that Python's modules and libraries take, whatever the command: at most 500 MiB with
# one thread of OpenBLAS, measured on Linux.
_LIBRARIES = 640 * _MIB
_SIGNS = re.compile(r"can't start new thread|failed to map segment|cannot allocate memory")


def prepare() -> str:
    """Make sure that the libraries fit below a limit of address space, if there is one.

    Return why a command cannot run, "" where it can.
    """
    free = free_address_space()
    if free is None:
        return ""
    if free < _LIBRARIES:
        return (
            f"the limit of address space leaves {free // _MIB} MiB, and struck's libraries need "
            f"{_LIBRARIES // _MIB} MiB: raise the limit by ulimit -v"
        )
    # Each thread takes 100 MB. This must be set before NumPy is imported.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    reserve_blas_buffers()
    return ""


def is_shortage(error: BaseException | None) -> bool:
    """Return whether memory ran out, whatever error a library made of that."""
    while error is not None:
        if isinstance(error, MemoryError) or getattr(error, "errno", None) == errno.ENOMEM:
            return True
        if isinstance(error, ImportError | RuntimeError) and _SIGNS.search(str(error)):
            return True
        error = error.__cause__ or error.__context__
    return False


def explain(error: BaseException) -> str:
    """Return the message of an error that too little memory caused."""
    free = free_address_space()
    remedy = "choose a shorter sound, fewer modes or a lower accuracy, or "
    if free is None:
        remedy += "use a machine with more memory"
    else:
        remedy += "raise the limit by ulimit -v"
    reason = str(error).rstrip(".") or type(error).__name__
    return f"memory is short ({reason}): {remedy}"

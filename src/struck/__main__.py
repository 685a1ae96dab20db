"""Start of the command `struck`: Ctrl-C, and settings that libraries find when imported."""

from __future__ import annotations

import _thread
import os
import signal
import sys
import time
from collections.abc import Mapping
from types import FrameType

INTERRUPTED = 130  # the exit code of what SIGINT has ended, as shells have it
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


class Interruption:
    """Ctrl-C in a process that is struck's own.

    Libraries turn it into errors of their own while they are imported, and Python drops it where it
    comes amid a finalizer: so it is kept in mind that it came, and what was dropped comes again.
    """

    def __init__(self) -> None:
        self.came = False
        if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as of a job in the background
            signal.signal(signal.SIGINT, self._take)
        sys.unraisablehook = self._again

    def _take(self, _number: int, frame: FrameType | None) -> None:
        self.came = True
        if _loads_compiled(frame):
            _thread.start_new_thread(_once_more, (_thread.get_ident(),))
        else:
            raise KeyboardInterrupt

    @staticmethod
    def _again(what: sys.UnraisableHookArgs) -> None:
        if isinstance(what.exc_value, KeyboardInterrupt):
            # Not at once: Python would drop what is raised in this hook, too.
            _thread.start_new_thread(_once_more, (_thread.get_ident(),))
        else:
            sys.__unraisablehook__(what)


def _loads_compiled(frame: FrameType | None) -> bool:
    """Return whether a frame lies within the loading of a compiled module."""
    while frame is not None:
        loader = type(frame.f_locals.get("self")).__name__
        if loader == "ExtensionFileLoader" and frame.f_code.co_name.endswith("_module"):
            return True
        frame = frame.f_back
    return False


def _once_more(main_thread: int) -> None:
    """Interrupt the main thread a little later."""
    time.sleep(0.01)
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(main_thread, signal.SIGINT)  # which ends its sleep, too
    else:
        _thread.interrupt_main()


def main() -> int:
    """Run the command in a process of its own."""
    interruption = Interruption()
    try:
        _choose_kernels()
        _import_matplotlib_elsewhere()
        from struck.cli import main as run

        return run()
    except BaseException:
        if not interruption.came:
            raise
        sys.stderr.write("struck: interrupted\n")
        return INTERRUPTED
    finally:  # the work is done or told of: while Python ends, nothing is left to interrupt
        signal.signal(signal.SIGINT, signal.SIG_IGN)


def _choose_kernels() -> None:
    if sys.platform != "linux" or "numpy" in sys.modules:
        return
    try:
        with open("/proc/cpuinfo", encoding="utf-8", errors="replace") as file:  # noqa: PTH123 - pathlib costs 3 ms
            processor = file.read()
    except OSError:
        return
    kernels = blas_kernels(processor, os.environ)
    if kernels is not None:
        os.environ[_VARIABLE] = kernels


def _import_matplotlib_elsewhere() -> None:
    """Import matplotlib in another folder where the current one holds settings of it.

    They rule no picture of struck, yet matplotlib reads them as it is imported, complains of bad
    ones, and cannot be imported with those that are no text.
    """
    if not os.path.lexists("matplotlibrc"):  # pathlib costs 3 ms
        return
    try:
        here = os.getcwd()  # noqa: PTH109
        os.chdir(here)  # so that there is a way back
        os.chdir(sys.prefix)
    except OSError:
        return
    try:
        import matplotlib  # noqa: F401, ICN001
    finally:
        os.chdir(here)


if __name__ == "__main__":
    sys.exit(main())

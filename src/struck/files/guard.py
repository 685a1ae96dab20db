"""Foreign mesh files, read by a process that may crash, hang or swell without harm.

The process is started with the first file and kept for those that follow; one that fails is ended,
and the next file gets a new one. Whatever happens, the answer is sound arrays or one `MeshError`.
"""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import IO, NoReturn, Self, TypeVar, cast

from struck.errors import MeshError, MissingDependencyError
from struck.files.answers import blocks_of, surface_of
from struck.files.blocks import Blocks
from struck.files.contents import Contents
from struck.files.frames import Frame, read_frame, write_frame
from struck.files.limits import OUT_OF_MEMORY, Limits

Answer = TypeVar("Answer")

# The package as a whole would bring in the whole program: half a second that small files need not
# wait for, and memory that large ones need.
_ALMOST_EMPTY_PACKAGE = f"""
import sys, types
package = sys.modules["struck"] = types.ModuleType("struck")
package.__path__ = [{str(Path(__file__).resolve().parents[1])!r}]
"""
_PROGRAM = f"{_ALMOST_EMPTY_PACKAGE}from struck.files.worker import main; main()"
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
_LONGEST_START = 60.0
_LONGEST_MESSAGE = 500
_NO_WINDOW = getattr(subprocess, "CREATE_NO_WINDOW", 0)


def read_contents(path: str | os.PathLike[str]) -> Contents:
    """Read the parts of a mesh file: OBJ, STL, PLY, OFF, GLB or glTF, also as gz, bz2, xz or zip.

    Raises
    ------
    MeshError
        When it cannot be read within the limits, or holds no sound surface.
    """
    return _GUARD.contents(path)


def read_volume(path: str | os.PathLike[str]) -> Blocks:
    """Read the blocks of elements of a volume mesh file: vtk, vtu, msh or inp.

    Raises
    ------
    MeshError
        When it cannot be read within the limits.
    MissingDependencyError
        When meshio is not installed.
    """
    return _GUARD.blocks(path)


class Guard:
    """A process that reads files, and the terms on which it does.

    May be used from several threads, which then wait for each other; a process that forks gets a
    reader of its own.

    Parameters
    ----------
    limits : Limits, optional
        What one file may cost.
    command : list of str, optional
        Another program that speaks as the worker does.
    """

    def __init__(self, limits: Limits | None = None, *, command: list[str] | None = None) -> None:
        self.limits = limits or Limits()
        self._command = command or [
            *(sys.executable, "-P", "-W", "ignore", "-c", _PROGRAM),
            json.dumps(asdict(self.limits)),
        ]
        self._lock = threading.RLock()
        self._process: subprocess.Popen[bytes] | None = None
        self._ending: weakref.finalize | None = None
        _GUARDS.add(self)

    @property
    def process_id(self) -> int | None:
        """The reader's number in the system, None while there is none."""
        return self._process.pid if self._process else None

    def contents(self, path: str | os.PathLike[str]) -> Contents:
        """Read a surface: see `read_contents`."""
        kind, parts = self._asked("surface", path, surface_of)
        return Contents(kind=kind, parts=parts)

    def blocks(self, path: str | os.PathLike[str]) -> Blocks:
        """Read a volume mesh: see `read_volume`."""
        return self._asked("volume", path, blocks_of)

    def close(self) -> None:
        """End the reader; the next file starts another."""
        with self._lock:
            if self._ending:
                self._ending()
            self._process = self._ending = None

    def _asked(
        self, task: str, path: str | os.PathLike[str], understood: Callable[[Frame], Answer]
    ) -> Answer:
        """Ask one question, and take the answer if it makes sense."""
        with self._lock:
            frame = self._frame({"task": task, "path": str(Path(path).absolute())})
            if "error" in frame.content:
                error = _ERRORS.get(str(frame.content["error"]), MeshError)
                raise error(_printable(str(frame.content.get("message"))))
            try:
                return understood(frame)
            except (KeyError, TypeError, ValueError) as error:
                self._refuse_nonsense(f"{type(error).__name__} {error}")

    def _frame(self, question: dict[str, str]) -> Frame:
        process = self._running()
        questions, answers = _pipes(process)
        with _Deadline(process, self.limits.seconds) as deadline:
            try:
                write_frame(questions, question)
                return read_frame(answers, largest=self.limits.answer)
            except ValueError as error:
                self._refuse_nonsense(str(error))
            except (EOFError, OSError):
                self._explain(process, deadline)
            except BaseException:
                self.close()  # an answer to this question must not be taken for the next
                raise

    def _running(self) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            self.close()
            self._process = self._started()
        return self._process

    def _started(self) -> subprocess.Popen[bytes]:
        try:
            process = subprocess.Popen(  # noqa: S603 - our own module, in this interpreter
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                bufsize=0,
                env={**os.environ, **_ONE_THREAD, "PYTHONPATH": _search_path()},
                creationflags=_NO_WINDOW,
            )
        except OSError as error:
            raise MeshError(
                f"{self._command[0]} cannot be started to read it ({error.strerror or error}): "
                "free some memory or processes"
            ) from error
        self._ending = weakref.finalize(self, _end, process)
        with _Deadline(process, _LONGEST_START):
            try:
                read_frame(_pipes(process)[1], largest=0)
            except (ValueError, EOFError, OSError) as error:
                self.close()
                raise MeshError(
                    f"the process that reads files ({self._command[0]}) did not start: it needs "
                    f"{self.limits.memory} bytes of address space and Python; check both"
                ) from error
        return process

    def _explain(self, process: subprocess.Popen[bytes], deadline: _Deadline) -> NoReturn:
        """Say why the reader has gone."""
        if not deadline.passed:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(1)
        code = process.returncode
        self.close()
        if deadline.passed:
            raise MeshError(
                f"reading it took longer than {self.limits.seconds:g} s: simplify the surface "
                "(decimate it), or export it in a binary format"
            )
        if code == OUT_OF_MEMORY:
            raise MeshError(
                f"reading it takes more than {self.limits.memory} bytes of memory: simplify the "
                "surface (decimate it), or export it in a binary format"
            )
        raise MeshError(
            f"its reader crashed on it (exit code {code}): it is damaged, or made to do harm; "
            "export it again"
        )

    def _refuse_nonsense(self, reason: str) -> NoReturn:
        self.close()
        raise MeshError(
            f"its reader answered nonsense ({_printable(reason)}): it is damaged, or made to do "
            "harm; export it again"
        )

    def forget(self) -> None:
        """Leave the reader to the parent, after a fork."""
        if self._ending:
            self._ending.detach()
        if self._process:
            self._process.returncode = 0  # not ours to wait for
            _close_pipes(self._process)
        self._lock = threading.RLock()
        self._process = self._ending = None


class _Deadline:
    """Ends a process that takes too long, whatever this thread waits for."""

    def __init__(self, process: subprocess.Popen[bytes], seconds: float) -> None:
        self.passed = False
        self._process = process
        self._timer = threading.Timer(seconds, self._pass)
        self._timer.daemon = True

    def _pass(self) -> None:
        self.passed = True
        self._process.kill()

    def __enter__(self) -> Self:
        self._timer.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._timer.cancel()


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    _close_pipes(process)
    process.wait()


def _close_pipes(process: subprocess.Popen[bytes]) -> None:
    for pipe in _pipes(process):
        pipe.close()


def _search_path() -> str:
    """Return where modules are found: as by the program, and not where it was started."""
    return os.pathsep.join(str(Path(path).absolute()) for path in sys.path if path)


def _pipes(process: subprocess.Popen[bytes]) -> tuple[IO[bytes], IO[bytes]]:
    """Return where the reader is asked, and where it answers."""
    return cast("IO[bytes]", process.stdin), cast("IO[bytes]", process.stdout)


def _printable(text: str) -> str:
    """Return one line without what would steer a terminal."""
    line = " ".join(text.split())[:_LONGEST_MESSAGE]
    return "".join(letter if letter.isprintable() else "?" for letter in line)


def _forget_all() -> None:
    for guard in _GUARDS:
        guard.forget()


_ERRORS = {"MeshError": MeshError, "MissingDependencyError": MissingDependencyError}
_GUARDS: weakref.WeakSet[Guard] = weakref.WeakSet()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_all)
_GUARD = Guard()

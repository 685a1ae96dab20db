"""Foreign files, read by a process that may crash, hang or swell without harm.

The process is started with the first file and kept for those that follow; one that fails is ended,
and the next file gets a new one. Whatever happens, the answer is plain JSON with arrays, or one
`StruckError`; the caller checks their meaning.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import threading
import weakref
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import IO, NoReturn, TypeVar, cast

from struck import errors
from struck.errors import FileFormatError, MeshError, StruckError, rounded
from struck.files.messages import (
    BROKEN,
    DAMAGED,
    FORMATS,
    OUT_OF_MEMORY,
    UNREADABLE,
    ElementBlocks,
    Frame,
    Parsed,
    Part,
    ReadingLimits,
    read_frame,
    write_frame,
)
from struck.model.arrays import AnyArray
from struck.model.mesh import require_area, require_triangles, require_vertices
from struck.processes.child_process import python_command, python_environment

Answer = TypeVar("Answer")

# The package as a whole would bring in the whole program: half a second that small files need not
# wait for, and memory that large ones need.
_ALMOST_EMPTY_PACKAGE = f"""
import sys, types
package = sys.modules["struck"] = types.ModuleType("struck")
package.__path__ = [{str(Path(__file__).resolve().parents[1])!r}]
"""
# Exit code of a reader that the system has ended for its processor time.
_WORKED_TOO_LONG = -signal.SIGPROF if hasattr(signal, "SIGPROF") else None
_KILLED_CODE = (
    -signal.SIGKILL if hasattr(signal, "SIGKILL") else None
)  # as Linux ends a process when memory runs out
_PROGRAM = f"{_ALMOST_EMPTY_PACKAGE}from struck.files.worker import main; main()"
_LONGEST_START = 60.0  # s
_LONGEST_MESSAGE = 500
_NO_WINDOW = getattr(subprocess, "CREATE_NO_WINDOW", 0)


def read_contents(path: str | os.PathLike[str]) -> Contents:
    """Read the parts of a surface mesh file, packed or not; MeshError beyond the limits."""
    return _GUARD.contents(path)


def read_volume(path: str | os.PathLike[str]) -> ElementBlocks:
    """Read the elements of a vtk, vtu, msh or inp file; MeshError beyond the limits."""
    return _GUARD.blocks(path)


def read_foreign(
    task: str,
    path: str | os.PathLike[str],
    understood: Callable[[Frame], Answer],
    *,
    error: type[StruckError] = FileFormatError,
    advice: str,
    options: Mapping[str, object] = MappingProxyType({}),
    arrays: Sequence[AnyArray] = (),
    seconds: float | None = None,
    work: str = "reading it",
) -> Answer:
    """Return the answer of a task of `messages.TASKS` about a file, converted by `understood`.

    `options` and `arrays` (N, D) are further arguments of the task, `seconds` the processor time
    that it may take, if not that of all, and `work` its name in messages. `error` is raised,
    without the file's name, where the file is damaged or the task takes more than the limits;
    `advice` is the way out then.
    `understood` raises KeyError, TypeError or ValueError on an answer that has not the form of its
    task.
    """
    question = Question(
        task=task,
        path=path,
        error=error,
        advice=advice,
        options=options,
        arrays=arrays,
        seconds=seconds,
        work=work,
    )
    return _GUARD.ask(question, understood)


def close() -> None:
    """End the process that reads files; the next file starts another."""
    _GUARD.close()


@dataclass(frozen=True, slots=True, kw_only=True)
class Question:
    """A task, its file, and the error to raise where the file cannot be read."""

    task: str  # of `messages.TASKS`
    path: str | os.PathLike[str]
    error: type[StruckError] = MeshError
    advice: str = "simplify the surface (decimate it), or export it in a binary format"
    options: Mapping[str, object] = field(default_factory=dict)
    arrays: Sequence[AnyArray] = ()
    seconds: float | None = None  # of processor time, in place of the limit of all
    work: str = "reading it"  # name of the task in messages


class Guard:
    """A process that reads files, its limits, and a lock for the threads that share it."""

    def __init__(
        self, limits: ReadingLimits | None = None, *, command: list[str] | None = None
    ) -> None:
        self.limits = limits or ReadingLimits()
        self._command = command or [
            *python_command("-W", "ignore", "-c", _PROGRAM),
            json.dumps(asdict(self.limits)),
        ]
        self._lock = threading.RLock()
        self._process: subprocess.Popen[bytes] | None = None
        self._ending: weakref.finalize | None = None
        _GUARDS.add(self)

    @property
    def process_id(self) -> int | None:
        """The reading process's number in the system, None without one."""
        return self._process.pid if self._process else None

    def contents(self, path: str | os.PathLike[str]) -> Contents:
        """Read a surface: see `read_contents`."""
        surface = self.ask(Question(task="surface", path=path), surface_of)
        return Contents(
            kind=surface.kind,
            parts=surface.parts,
            beside=surface.beside,
            seconds=surface.seconds,
        )

    def blocks(self, path: str | os.PathLike[str]) -> ElementBlocks:
        """Read a volume mesh: see `read_volume`."""
        return self.ask(Question(task="volume", path=path), blocks_of)

    def close(self) -> None:
        """End the reading process; the next file starts another."""
        with self._lock:
            if self._ending:
                self._ending()
            self._process = self._ending = None

    def ask(self, question: Question, understood: Callable[[Frame], Answer]) -> Answer:
        """Send one question, and return the checked answer."""
        with self._lock:
            frame = self._frame(question)
            if "error" in frame.content:
                self._refuse(
                    question, frame.content["error"], _printable(str(frame.content.get("message")))
                )
            try:
                return understood(frame)
            except (KeyError, TypeError, ValueError) as error:
                self._refuse_nonsense(question, f"{type(error).__name__} {error}")

    def _refuse(self, question: Question, name: object, message: str) -> NoReturn:
        """Raise the error that an answer names."""
        if name == UNREADABLE:
            raise question.error(f"it cannot be read ({message}): check the disk it is on")
        if name == BROKEN:
            self.close()
        if name in {DAMAGED, BROKEN}:
            raise question.error(f"it is damaged, or another format ({message}): export it again")
        error = getattr(errors, str(name), None)
        if isinstance(error, type) and issubclass(error, StruckError):
            raise error(message)
        self._refuse_nonsense(question, f"an error called {name}")

    def _frame(self, question: Question) -> Frame:
        process = self._running(question.error)
        questions, answers = _pipes(process)
        content = {
            "task": question.task,
            "path": str(Path(question.path).absolute()),
            "options": dict(question.options),
            "seconds": self._times(question)[0],
            "wall": self._times(question)[1],
        }
        with _deadline(process, content["wall"]) as expiry:
            try:
                write_frame(questions, content, question.arrays)
                return read_frame(answers, largest=self.limits.answer)
            except ValueError as error:
                self._refuse_nonsense(question, str(error))
            except (EOFError, OSError):
                self._explain(question, process, timed_out=expiry.is_set())
            except BaseException:
                self.close()  # an answer to this question must not be taken for the next
                raise

    def _times(self, question: Question) -> tuple[float, float]:
        """Return how long a question may take, s: of the processor, and by the clock."""
        if question.seconds is None:
            return self.limits.seconds, self.limits.wall
        # A busy machine gives a process a fraction of a processor.
        return question.seconds, max(self.limits.wall, 10 * question.seconds)

    def _running(self, error: type[StruckError] = MeshError) -> subprocess.Popen[bytes]:
        if self._process is None or self._process.poll() is not None:
            self.close()
            self._process = self._started(error)
        return self._process

    def _started(self, refusal: type[StruckError]) -> subprocess.Popen[bytes]:
        try:
            process = subprocess.Popen(  # noqa: S603 - our own module, in this interpreter
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                bufsize=0,
                env=python_environment(),
                creationflags=_NO_WINDOW,
            )
        except OSError as error:
            raise refusal(
                f"{self._command[0]} cannot be started to read it ({error.strerror or error}): "
                "free some memory or processes"
            ) from error
        self._ending = weakref.finalize(self, _end, process)
        with _deadline(process, _LONGEST_START):
            try:
                read_frame(_pipes(process)[1], largest=0)
            except (ValueError, EOFError, OSError) as error:
                self.close()
                raise refusal(
                    f"the process that reads files ({self._command[0]}) did not start: it needs "
                    f"{self.limits.memory} bytes of address space and Python; check both"
                ) from error
        return process

    def _explain(
        self, question: Question, process: subprocess.Popen[bytes], *, timed_out: bool
    ) -> NoReturn:
        """Raise the question's error with the reason why the reading process ended."""
        if not timed_out:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(1)
        code = process.returncode
        self.close()
        limit = ""
        if timed_out:
            limit = f"longer than {rounded(self._times(question)[1])} s"
        elif code == _WORKED_TOO_LONG:
            limit = f"more than {rounded(self._times(question)[0])} s of the processor"
        elif code == OUT_OF_MEMORY:
            limit = f"more than {self.limits.memory} bytes of memory"
        elif code == _KILLED_CODE:
            limit = "more memory than the system has left"
        if limit:  # of this machine and hour, not the file's fault
            cause = MemoryError() if code in {OUT_OF_MEMORY, _KILLED_CODE} else TimeoutError()
            raise question.error(f"{question.work} took {limit}: {question.advice}") from cause
        raise question.error(
            f"its reader crashed on it (exit code {code}): it is damaged, or made to do harm; "
            "export it again"
        )

    def _refuse_nonsense(self, question: Question, reason: str) -> NoReturn:
        self.close()
        raise question.error(
            f"its reader answered nonsense ({_printable(reason)}): it is damaged, or made to do "
            "harm; export it again"
        )

    def forget(self) -> None:
        """Leave the reading process to the parent, after a fork."""
        if self._ending:
            self._ending.detach()
        if self._process:
            self._process.returncode = 0  # not ours to wait for
            for pipe in _pipes(self._process):
                pipe.close()
        self._lock = threading.RLock()
        self._process = self._ending = None


@contextlib.contextmanager
def _deadline(process: subprocess.Popen[bytes], seconds: float) -> Iterator[threading.Event]:
    """Kill a process after some seconds, and set the event that it yields."""
    expiry = threading.Event()

    def kill() -> None:
        expiry.set()
        process.kill()

    timer = threading.Timer(seconds, kill)
    timer.daemon = True
    timer.start()
    try:
        yield expiry
    finally:
        timer.cancel()


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    for pipe in _pipes(process):
        pipe.close()
    process.wait()


def _pipes(process: subprocess.Popen[bytes]) -> tuple[IO[bytes], IO[bytes]]:
    """Return the standard input and output of the reading process."""
    return cast("IO[bytes]", process.stdin), cast("IO[bytes]", process.stdout)


def _printable(text: str) -> str:
    """Return text as one line without control characters."""
    line = " ".join(text.split())[:_LONGEST_MESSAGE]
    return "".join(letter if letter.isprintable() else "?" for letter in line)


def surface_of(frame: Frame) -> Parsed:
    """Return the format and the parts of a surface mesh that a message holds."""
    names = texts_in(frame, "names")
    shapes = [(array.dtype.kind, array.shape[1]) for array in frame.arrays]
    if shapes != [("f", 3), ("i", 3)] * len(names):
        raise ValueError("its arrays are no surfaces")
    pairs = zip(names, frame.arrays[::2], frame.arrays[1::2], strict=True)
    parts = [Part(name=name, points=points, faces=faces) for name, points, faces in pairs]
    kind = str(frame.content["kind"])
    if kind not in FORMATS:
        raise ValueError(f"its format is {kind!r}, of none that is read")
    beside = frame.content["beside"]
    if not isinstance(beside, dict) or not all(type(count) is int for count in beside.values()):
        raise TypeError("its points and lines are not counted")
    seconds = float(frame.content.get("seconds", 0.0))
    return Parsed(kind=kind, parts=parts, beside=beside, seconds=seconds)


def blocks_of(frame: Frame) -> ElementBlocks:
    """Return the nodes and elements of a volume mesh that a message holds."""
    kinds = texts_in(frame, "kinds")
    if [array.dtype.kind for array in frame.arrays] != ["f", *"i" * len(kinds)]:
        raise ValueError("its arrays are no elements")
    nodes, *cells = frame.arrays
    return ElementBlocks(nodes=nodes, cells=list(zip(kinds, cells, strict=True)))


def texts_in(frame: Frame, name: str) -> list[str]:
    """Return the list of texts that a message holds under a name; TypeError for other values."""
    texts = frame.content[name]
    if not isinstance(texts, list) or not all(isinstance(text, str) for text in texts):
        raise TypeError(f"its {name} are no texts")
    return texts


@dataclass(frozen=True, kw_only=True, eq=False)
class Contents:
    """The parts of a mesh file, checked: finite vertices, valid indices, at least one area."""

    kind: str  # one of `FORMATS`, of what was packed as well
    parts: list[Part]  # in the file's own order and numbers
    beside: dict[str, int] = field(default_factory=dict)  # how many points, lines: left out
    seconds: float = 0.0  # processor time that reading took

    def __post_init__(self) -> None:
        if not any(len(part.faces) for part in self.parts):
            raise MeshError(
                f"no triangles can be read from it as {self.kind.upper()}: it is empty, truncated "
                "or another format; export the surface again"
            )
        for part in self.parts:
            require_vertices(part.points)
            require_triangles(part.faces, len(part.points))
        require_area(*((part.points, part.faces) for part in self.parts))


def _forget_all() -> None:
    for guard in _GUARDS:
        guard.forget()


_GUARDS: weakref.WeakSet[Guard] = weakref.WeakSet()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_all)
_GUARD = Guard()

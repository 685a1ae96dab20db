"""Jobs of the room: objects computed in separate processes, with progress.

Each process reads a line of JSON for each object it shall compute, and writes lines of its
progress, and of what it made, on standard output; it ends with its standard input.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import queue
import signal
import sys
import threading
import time
from collections.abc import AsyncIterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from struck.errors import FileFormatError, SolverError
from struck.explorer.facts import facts
from struck.explorer.objects import Thing, things
from struck.explorer.page_files import model_bytes
from struck.files import model_file
from struck.files.atomic import write_bytes
from struck.model.model import ModalModel
from struck.processes.child_process import python_command, python_environment

PROCESSES = 2
PAGE_ENDING = ".page"  # ending of what the page reads
_PROGRESS_SECONDS = 0.1  # s between two lines of progress
_MAX_LINE_BYTES = 2**20  # bytes of a line


@dataclass(slots=True, kw_only=True)
class Job:
    """One object of the room, and how far it is."""

    thing: Thing
    path: Path  # of its model file; the page's own has the ending `PAGE_ENDING`
    state: str = "waiting"  # "working", "ready" or "failed"
    stage: str = ""
    fraction: float = 0.0
    message: str = ""  # why it failed
    facts: Mapping[str, Any] = field(default_factory=dict)

    def json_values(self) -> dict[str, Any]:
        """Return the state of the job for the page, as JSON values."""
        return {
            **self.thing.json_values(),
            "state": self.state,
            "stage": self.stage,
            "fraction": self.fraction,
            "message": self.message,
            "facts": dict(self.facts),
        }


class Jobs:
    """The objects of the room while they are computed, one after the other by each process.

    Parameters
    ----------
    objects : sequence of Thing
        Of `things`, in the order of their computation.
    folder : path
        Where model files are written.
    """

    def __init__(self, objects: Sequence[Thing], folder: Path) -> None:
        self.folder = folder
        self.jobs = {
            thing.name: Job(thing=thing, path=folder / f"{thing.name}.struck") for thing in objects
        }
        self._models: dict[str, ModalModel] = {}
        self._news = asyncio.Condition()
        self._version = 0

    def give(self, thing: Thing, model: ModalModel) -> None:
        """Add an object whose model is there already."""
        job = Job(thing=thing, path=self.folder / f"{thing.name}.struck", state="ready")
        job.facts = _write_model(model, job.path)
        self.jobs[thing.name] = job
        self._models[thing.name] = model

    def model(self, name: str) -> ModalModel:
        """Return the model of an object that is ready."""
        if name not in self._models:
            self._models[name] = model_file.load(self.jobs[name].path)
        return self._models[name]

    async def run(self) -> None:
        """Compute all that wait, by processes that end with this."""
        waiting = [job for job in self.jobs.values() if job.state == "waiting"]
        async with asyncio.TaskGroup() as group:  # which waits for all of them, cancelled too
            for _ in range(min(PROCESSES, len(waiting))):
                group.create_task(self._work(waiting))

    async def news(self) -> AsyncIterator[dict[str, Any]]:
        """Yield every object, and from then on each that has changed, without an end."""
        states: dict[str, str] = {}
        while True:
            version = self._version
            for name, job in list(self.jobs.items()):
                values = job.json_values()
                text = json.dumps(values, sort_keys=True)
                if states.get(name) != text:
                    states[name] = text
                    yield values
            async with self._news:
                await self._news.wait_for(lambda seen=version: self._version != seen)

    async def _work(self, waiting: list[Job]) -> None:
        """Let one process compute one object after the other; another follows one that dies."""
        while waiting:
            process = await asyncio.create_subprocess_exec(
                *python_command("-m", "struck.explorer.jobs"),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                limit=_MAX_LINE_BYTES,
                env=python_environment(),
                start_new_session=True,  # Ctrl-C is for the server, which ends it
            )
            try:
                while waiting and process.returncode is None:
                    await self._compute(waiting.pop(0), process)
            finally:
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
                await process.wait()

    async def _compute(self, job: Job, process: asyncio.subprocess.Process) -> None:
        """Ask a process for one object, and pass on its progress until the object is there."""
        if process.stdin is None or process.stdout is None:
            raise RuntimeError("a process was started without pipes")
        job.state, job.stage = "working", "starting"
        await self._tell()
        question = {"name": job.thing.name, "path": str(job.path)}
        with contextlib.suppress(ConnectionError):
            process.stdin.write(json.dumps(question).encode() + b"\n")
            await process.stdin.drain()
        while job.state == "working":
            line = await process.stdout.readline()
            if not line:
                code = await process.wait()
                job.state = "failed"
                job.message = (
                    f"its computation was ended from outside (code {code}), perhaps for want of "
                    "memory; close other programs and start again"
                )
            else:
                for name, value in json.loads(line).items():
                    setattr(job, name, value)
            await self._tell()

    async def _tell(self) -> None:
        self._version += 1
        async with self._news:
            self._news.notify_all()


# The process


def main() -> None:
    """Compute the objects named by lines of standard input; write progress to standard output."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    objects = {thing.name: thing for thing in things()}
    answer_stream = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # libraries print elsewhere
    questions: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_listen, args=(questions,), daemon=True).start()
    while True:
        question = json.loads(questions.get())
        teller = _ProgressWriter(answer_stream)
        teller.write(**_answer(objects[question["name"]], Path(question["path"]), teller))


def _listen(questions: queue.SimpleQueue[str]) -> None:
    """Take questions from standard input; with it all ends, also amid a computation."""
    for line in sys.stdin:
        questions.put(line)
    os._exit(0)


def _write_model(model: ModalModel, path: Path) -> dict[str, Any]:
    """Write a model in full and for the page; return its facts."""
    model_file.save(model, path)
    write_bytes(path.with_suffix(PAGE_ENDING), model_bytes(model))
    return facts(model)


class _ProgressWriter:
    """Progress as lines of JSON, ten a second."""

    def __init__(self, stream: Any) -> None:  # noqa: ANN401 - a text stream
        self._stream, self._last_time, self._stage = stream, 0.0, ""

    def __call__(self, stage: str, fraction: float) -> None:
        now = time.monotonic()
        if stage != self._stage or now - self._last_time > _PROGRESS_SECONDS:
            self._stage, self._last_time = stage, now
            self.write(stage=stage, fraction=fraction)

    def write(self, **values: object) -> None:
        self._stream.write(json.dumps(values) + "\n")
        self._stream.flush()


def _answer(thing: Thing, path: Path, teller: _ProgressWriter) -> dict[str, Any]:
    """Compute an object; return its state, with its facts or the reason of a failure."""
    try:
        values = _write_model(thing.make(teller), path)
    except Exception as error:  # noqa: BLE001 - the other objects are computed all the same
        sys.stderr.write(f"{thing.title}: {type(error).__name__}: {error}\n")
        return {"message": _reason(error), "state": "failed"}
    return {"facts": values, "fraction": 1.0, "stage": "", "state": "ready"}


def _reason(error: Exception) -> str:
    """Return the reason why an object is missing, in words for a user of the page."""
    if isinstance(error, MemoryError | SolverError):
        return "it needs more memory than there is; close other programs and start again"
    if isinstance(error, OSError | FileFormatError):
        return f"its file could not be written ({error}); make room for it and start again"
    return "this is a fault of struck, whose details are in the terminal; all others can be played"


if __name__ == "__main__":
    main()

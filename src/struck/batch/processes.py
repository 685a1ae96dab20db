"""Processes of this machine that do jobs: as many at once as cores and memory together allow.

Each sends a forecast of its memory as soon as it has read the body, and waits for permission.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import queue
import signal
import subprocess
import threading
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

from struck.batch.job import BodyJob
from struck.batch.job_process import PERMISSION, Facts
from struck.errors import SolverError
from struck.processes.child_process import python_command, python_environment

_PROGRAM = "from struck.batch.job_process import main; main()"


def failure(kind: str, message: str) -> Facts:
    """Return the facts of a job that failed without writing any: an error and its message."""
    return {"failure": kind, "message": message}


class _Worker:
    """A process that does one job after the other, each in a fork of it."""

    def __init__(self, events: queue.SimpleQueue[tuple[_Worker, Facts | None]]) -> None:
        self._process = subprocess.Popen(  # noqa: S603 - our own module, in this interpreter
            python_command("-W", "ignore", "-c", _PROGRAM),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            # Models depend in their last bits on the number of threads: each job has one.
            env=python_environment(),
            start_new_session=True,  # Ctrl-C is for the program, and all it starts ends together
        )
        self._thread = threading.Thread(target=self._listen, args=(events,), daemon=True)
        self._thread.start()

    def _listen(self, events: queue.SimpleQueue[tuple[_Worker, Facts | None]]) -> None:
        """Put each line of the process's output into the queue, and None once it has ended."""
        with cast("Any", self._process.stdout) as output:
            for line in output:
                events.put((self, json.loads(line)))
        events.put((self, None))

    def tell(self, data: bytes) -> None:
        """Send bytes to the process; `_listen` reports where it has ended."""
        stdin = cast("Any", self._process.stdin)
        with contextlib.suppress(OSError):
            stdin.write(data)
            stdin.flush()

    def close(self) -> int:
        """End the worker and all processes that it has started; return its exit code."""
        if hasattr(os, "killpg"):
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.killpg(self._process.pid, signal.SIGKILL)
        self._process.kill()
        with contextlib.suppress(OSError):
            cast("Any", self._process.stdin).close()
        code = self._process.wait()
        self._thread.join()
        return code


@dataclass(slots=True, kw_only=True)
class _Running:
    """A job that a worker process has begun."""

    job: BodyJob
    forecast: float = 0.0  # bytes, once it is known
    waits: bool = False  # for memory
    facts: Facts | None = None


class Processes:
    """Processes of this machine: `count` compute at once, by forecasts within `memory` bytes."""

    def __init__(self, folder: Path, *, count: int, memory: int | None) -> None:
        self._folder, self._count, self._memory = folder, count, memory
        self._events: queue.SimpleQueue[tuple[_Worker, Facts | None]] = queue.SimpleQueue()
        self._idle: list[_Worker] = []
        self._running: dict[_Worker, _Running] = {}

    def free(self) -> bool:
        """Return whether another job can be started: one that waits for memory leaves its core."""
        waiting = sum(item.waits for item in self._running.values())
        return len(self._running) - waiting < self._count and waiting < self._count

    def start(self, job: BodyJob) -> None:
        """Begin a job."""
        try:
            worker = self._idle.pop() if self._idle else _Worker(self._events)
        except OSError as error:
            raise SolverError(f"no process can be started ({error}): end some others") from error
        self._running[worker] = _Running(job=job)
        request = pickle.dumps((job, str(self._folder), self._memory))
        worker.tell(len(request).to_bytes(8, "little") + request)

    def finished(self, seconds: float) -> tuple[BodyJob, Facts] | None:
        """Wait for a job to end for at most some seconds, and return it with its facts."""
        try:
            worker, answer = self._events.get(timeout=seconds)
        except queue.Empty:
            return None
        running = self._running.get(worker)
        if running is None:  # it ended without a job
            self._idle = [item for item in self._idle if item is not worker]
            return None
        if answer is not None and "ended" not in answer:
            running.facts = answer.get("facts")
            running.forecast, running.waits = answer.get("forecast", 0.0), "forecast" in answer
            self._allow()
            return None
        del self._running[worker]
        code = worker.close() if answer is None else answer["ended"]
        if code == 0 and running.facts is not None:
            self._idle.append(worker)
        else:
            worker.close()
        self._allow()
        return running.job, running.facts or _describe_end(code)

    def close(self) -> None:
        """End all worker processes, at once."""
        for worker in (*self._running, *self._idle):
            worker.close()

    def _allow(self) -> None:
        """Admit waiting jobs while the memory of all running ones fits; a single one always may."""
        for worker, item in self._running.items():
            memory = sum(other.forecast for other in self._running.values() if not other.waits)
            fits = self._memory is None or memory + item.forecast <= self._memory
            if item.waits and (fits or not memory):
                item.waits = False
                worker.tell(PERMISSION)


def _describe_end(code: int) -> Facts:
    """Return the facts of a job whose process ended unexpectedly."""
    reason = f"signal {-code}" if code < 0 else f"code {code}"
    return failure(
        "ProcessEnded",
        f"the process that computed it ended ({reason}): the system does so where memory is short; "
        "give it more memory, or run fewer jobs at once (processes=)",
    )

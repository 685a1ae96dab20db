"""Jobs on a Dask cluster: each is tried once, on one worker, in a separate process there.

The scheduler would give a job whose worker died to others, up to four of them: so each is bound to
its worker, and as many are given out as workers have threads. A worker that sees this run's folder
writes into it; another sends files back as bytes.
"""

from __future__ import annotations

import json
import queue
import time
import warnings
from collections import Counter
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, NoReturn

from struck.analysis.cached_steps import method
from struck.batch.batch_report import PAGES
from struck.batch.job import FACTS, BodyJob
from struck.batch.job_process import Facts, reopen
from struck.batch.processes import Processes, failure
from struck.errors import FileFormatError, MissingDependencyError, OptionError, SolverError
from struck.files.atomic import make_folder, read_bytes, write_bytes

if TYPE_CHECKING:
    from distributed import Client

_LONGEST = 20.0  # s, of an answer of the scheduler
_POLL_INTERVAL = 1.0  # s between two looks at the workers
_PATIENCE = 120.0  # s without a worker


class Cluster:
    """Workers of a Dask cluster, given by the address of its scheduler or by a client of it.

    They know the folder of the models by what this `run` has written into its report.
    """

    def __init__(self, folder: Path, scheduler: str | Client, run: str) -> None:
        self._folder, self._run = folder.absolute(), run
        self._owns_client = isinstance(scheduler, str)
        self._client: Any = _connect(scheduler) if isinstance(scheduler, str) else scheduler
        self._events: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._running: dict[Any, tuple[BodyJob, str]] = {}  # by futures, each with its worker
        self._threads: dict[str, int] = {}  # by addresses of workers
        self._last_refresh, self._last_worker_time = 0.0, time.monotonic()
        try:
            _require_same(self._client)
        except BaseException:
            self.close()
            raise

    def free(self) -> bool:
        """Return whether some worker has a thread to spare."""
        self._refresh_workers()
        return self._spare()[0] > 0

    def start(self, job: BodyJob) -> None:
        """Give a job to the worker with most threads to spare."""
        worker = self._spare()[1]
        there = replace(job, file=str(Path(job.file).absolute()))
        future = self._client.submit(
            task,
            *(there, str(self._folder), self._run),
            key=f"struck-{self._run}-{job.output}",
            workers=[worker],
            allow_other_workers=False,
            retries=0,
            pure=False,
        )
        self._running[future] = job, worker
        future.add_done_callback(self._events.put)

    def finished(self, seconds: float) -> tuple[BodyJob, Facts] | None:
        """Wait for a job to end for at most some seconds, and return it with its facts."""
        try:
            future = self._events.get(timeout=seconds)
        except queue.Empty:
            return self._lost()
        if future not in self._running:
            return None
        job, worker = self._running.pop(future)
        if future.status == "cancelled":
            self._gone()
        try:
            answer = future.result(timeout=_LONGEST)
            if answer["contents"]:
                reopen(job, self._folder)
            for name, data in answer["contents"].items():
                path = self._folder / name
                make_folder(path.parent, parents=True)
                write_bytes(path, data)
        except Exception as error:  # noqa: BLE001 - of whatever kind, it is this job's alone
            return job, failure(type(error).__name__, f"{error} (on the worker {worker})")
        return job, answer["facts"]

    def close(self) -> None:
        """Leave the cluster: cancel its waiting tasks, and do not wait for the running ones."""
        for future in self._running:
            future.cancel()
        if self._owns_client:
            self._client.close()

    def _refresh_workers(self) -> None:
        """Ask the scheduler which workers there are, once a second."""
        now = time.monotonic()
        if now - self._last_refresh < _POLL_INTERVAL:
            return
        try:
            threads = self._client.sync(self._client.scheduler.ncores, callback_timeout=_LONGEST)
        except (OSError, TimeoutError, AttributeError) as error:
            self._gone(error)
        self._threads, self._last_refresh = dict(threads), now
        self._last_worker_time = now if threads else self._last_worker_time
        if now - self._last_worker_time > _PATIENCE:
            raise SolverError(
                f"the scheduler has had no worker for {_PATIENCE:.0f} s: start some, and run it "
                "again, which keeps what is finished"
            )

    def _spare(self) -> tuple[int, str]:
        """Return the most threads that a worker has to spare, and its address."""
        job_counts = Counter(worker for _, worker in self._running.values())
        spare = ((n - job_counts[worker], worker) for worker, n in self._threads.items())
        return max(spare, default=(0, ""))

    def _lost(self) -> tuple[BodyJob, Facts] | None:
        """Return a job whose worker has gone, if any."""
        self._refresh_workers()
        for future, (job, worker) in list(self._running.items()):
            if worker not in self._threads and not future.done():
                del self._running[future]
                future.cancel()
                message = (
                    f"the worker {worker} ended while it was at it: see its log, give workers more "
                    "memory or fewer threads, and run it again"
                )
                return job, failure("WorkerEnded", message)
        return None

    def _gone(self, error: BaseException | None = None) -> NoReturn:
        raise SolverError(
            "the scheduler went away: start it and its workers, and run it again, which keeps what "
            "is finished"
        ) from error


def task(job: BodyJob, folder: str, run: str) -> dict[str, Any]:
    """Do a job on a worker; return its facts, and its files where the folder is not this run's."""
    from distributed import get_worker

    worker: Any = get_worker()
    memory_limit = worker.memory_manager.memory_limit
    memory = None if memory_limit is None else int(memory_limit) // worker.state.nthreads
    with TemporaryDirectory(prefix="struck-") as temporary_folder:
        is_shared = _is_of(run, Path(folder))
        place = Path(folder) if is_shared else Path(temporary_folder)
        with closing(Processes(place, count=1, memory=memory)) as crew:
            crew.start(job)
            while (outcome := crew.finished(_POLL_INTERVAL)) is None:
                pass
        facts, names = outcome[1], []
        if not is_shared and "key" in facts:  # the facts last, with which the job is finished
            names = [*facts.get("files", {}), f"{job.output}{FACTS}"]
        contents = {name: (place / name).read_bytes() for name in names if (place / name).exists()}
    return {"facts": facts, "contents": contents}


def _is_of(run: str, folder: Path) -> bool:
    """Return whether a folder is where this run writes."""
    try:
        return json.loads(read_bytes(folder / PAGES[0])).get("run") == run
    except (FileFormatError, ValueError, AttributeError, RecursionError):
        return False


def _connect(address: str) -> Client:
    try:
        import distributed
    except ImportError as error:
        raise MissingDependencyError(
            "a cluster needs Dask: pip install 'struck[batch]', or leave scheduler= out"
        ) from error
    try:
        return distributed.Client(address, timeout=_LONGEST, set_as_default=False)
    except (OSError, ValueError) as error:
        raise OptionError(
            f"no scheduler answers at {address!r} ({error}): give one as 'tcp://host:8786'"
        ) from error


def _require_same(client: Any) -> None:  # noqa: ANN401 - a client of distributed
    """Refuse schedulers and workers of other versions than ours."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # of versions of Dask, Python and what both need
            client.get_versions(check=True)
        methods = client.run(method)
    except Exception as error:
        raise OptionError(
            f"scheduler and workers are not as here ({error}): install the same versions everywhere"
        ) from error
    other = [worker for worker, version in methods.items() if version != method()]
    if other:
        raise OptionError(f"{other[0]} has another struck: install the same version everywhere")

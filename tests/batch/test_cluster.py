"""A Dask cluster: the same bytes, one error for one file, and deaths that cost one job each."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import struck
from struck.batch import BatchReport
from struck.errors import OptionError
from tests.batch.bodies import bar, eight
from tests.batch.test_batch import contents, run

distributed = pytest.importorskip("distributed")
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),  # of Dask's own sockets
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


class Machines:
    """A scheduler and workers, each a process of its own, as on as many machines."""

    def __init__(self, count: int, folder: Path) -> None:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{port}"
        self.folder = folder
        self.scheduler = self._started("dask_scheduler", "--port", str(port), "--no-show")
        self.workers = [self._started("dask_worker", self.address) for _ in range(count)]

    def _started(self, name: str, *words: str) -> subprocess.Popen[bytes]:
        more = ("--no-dashboard", *(("--nthreads", "1") if "worker" in name else ()))
        return subprocess.Popen(
            [sys.executable, "-m", f"distributed.cli.{name}", *words, *more],
            cwd=self.folder,
            stderr=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
        )

    def ready(self) -> None:
        """Wait for all workers."""
        with distributed.Client(self.address, timeout=60, set_as_default=False) as client:
            client.wait_for_workers(len(self.workers), timeout=60)

    def close(self) -> None:
        """End all."""
        for each in (*self.workers, self.scheduler):
            each.terminate()
        for each in (*self.workers, self.scheduler):
            try:
                each.wait(10)
            except subprocess.TimeoutExpired:
                each.kill()
                each.wait()


@contextlib.contextmanager
def machines(count: int, folder: Path) -> Iterator[Machines]:
    made = Machines(count, folder)
    try:
        made.ready()
        yield made
    finally:
        made.close()


def bars(folder: Path, count: int) -> None:
    folder.mkdir()
    for number in range(count):
        bar(folder / f"{number}.vtu", 0.08 + 0.002 * number, 0.01, 0.01, count=60)


def test_nobody_answers(tmp_path: Path) -> None:
    bars(tmp_path / "in", 1)
    with pytest.raises(OptionError, match="no scheduler answers"):
        run(tmp_path, scheduler="nonsense://x")


@pytest.mark.prove
def test_two_workers_give_the_same_bytes_and_errors(tmp_path: Path) -> None:
    eight(tmp_path / "in")
    here = run(tmp_path, cache=False, strikes=2)
    with machines(2, tmp_path) as cluster:
        there = run(tmp_path, "there", cache=False, strikes=2, scheduler=cluster.address)
        assert there.computed == here.computed
        assert contents(tmp_path / "there").keys() == contents(tmp_path / "out").keys()
        for path in (tmp_path / "out").rglob("*"):
            if path.suffix in {".struck", ".wav"} or path.name == "labels.csv":
                other = tmp_path / "there" / path.relative_to(tmp_path / "out")
                assert other.read_bytes() == path.read_bytes()
        (failed,) = there.failed
        assert (failed.failure, failed.message) == ("MeshError", here.failed[0].message)
        # Workers that do not see the folder send files back.
        with distributed.Client(cluster.address, set_as_default=False) as client:
            client.run(exec, "import struck.batch.cluster as c; c.PAGES = ('nowhere.json',)")
            far = run(tmp_path, "far", cache=False, strikes=2, scheduler=client)
            assert client.status == "running"
        assert contents(tmp_path / "far") == contents(tmp_path / "there")
        assert len(far.failed) == 1


@pytest.mark.prove
def test_a_worker_that_dies_costs_its_own_job_alone(tmp_path: Path) -> None:
    bars(tmp_path / "in", 8)
    killed: list[str] = []
    with (
        machines(2, tmp_path) as cluster,
        distributed.Client(cluster.address, set_as_default=False) as client,
    ):

        def watch(stage: str, fraction: float) -> None:
            if stage == "computing models" and fraction > 0.2 and not killed:
                worker, process = next(iter(client.run(os.getpid).items()))
                killed.append(worker)
                os.kill(process, signal.SIGKILL)

        report = run(tmp_path, cache=False, scheduler=cluster.address, progress=watch)
        (failed,) = report.failed
        assert (failed.failure, killed[0] in failed.message) == ("WorkerEnded", True)
        assert _whole(tmp_path / "out", report) == 7
        again = run(tmp_path, cache=False, scheduler=cluster.address)
        assert (again.computed, again.failed) == (1, ())


@pytest.mark.prove
def test_without_its_scheduler_what_was_finished_stays_and_the_rest_is_resumed(
    tmp_path: Path,
) -> None:
    bars(tmp_path / "in", 8)
    with machines(2, tmp_path) as cluster:

        def watch(stage: str, fraction: float) -> None:
            if stage == "computing models" and fraction > 0.4:
                cluster.scheduler.kill()

        report = run(tmp_path, cache=False, scheduler=cluster.address, progress=watch)
    assert 0 < len(report.failed) < 8
    assert all("scheduler went away" in row.message for row in report.failed)
    finished = _whole(tmp_path / "out", report)
    time.sleep(3)  # workers end what they were at, and write it whole
    there = len(list((tmp_path / "out").glob("*.struck")))
    assert there >= finished
    again = run(tmp_path, cache=False)
    assert (again.computed, again.failed) == (8 - there, ())
    assert not list((tmp_path / "out").glob(".*"))


@pytest.mark.prove
def test_a_job_too_large_for_its_worker_is_refused_there(tmp_path: Path) -> None:
    bars(tmp_path / "in", 1)
    bar(tmp_path / "in/sheet.vtu", 0.4, 0.3, 0.002, count=600)
    with distributed.LocalCluster(
        n_workers=1, threads_per_worker=2, memory_limit="2e8", dashboard_address=None
    ) as cluster:
        report = run(tmp_path, cache=False, scheduler=cluster.scheduler_address)
    told = {Path(row.file).stem: row for row in report.rows}
    assert told["0"].status == "done"
    assert told["sheet"].failure == "SolverError"
    assert re.search(r"it may take 0\.1 GiB", told["sheet"].message)


def _whole(folder: Path, report: BatchReport) -> int:
    """Return how many models there are, once each has been read."""
    done = [row for row in report.rows if row.model]
    for row in done:
        assert len(struck.load(folder / row.model).frequencies) == row.modes
    return len(done)

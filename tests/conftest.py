"""What holds for all tests: one thread a worker, no screen, no cache, repeatable examples."""

from __future__ import annotations

import gc
import os
import signal
from collections import Counter

import hypothesis
import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

from tests.parts import SECONDS, part, part_of

# Before NumPy is imported: two workers with a thread pool each would fight for the same cores.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Tests of the cache name a folder of their own; nobody's real one is touched.
os.environ["STRUCK_CACHE"] = "off"

# A run in the background may ignore Ctrl-C, and one by nohup SIGHUP: children would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)

hypothesis.settings.register_profile("struck", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("struck")

# Two sound servers at once get into each other's way: JACK then refuses clients of either.
_SOUND = "tests/live/"
# Few and long: by themselves.
_LONG = (
    "tests/test_documents.py",
    "tests/cli/test_control_c.py",
    "tests/test_hostile_calls.py",
    "tests/analysis/test_solids.py",
)
# Long together, and to be kept together.
_FIRST = (_SOUND, "tests/physics/test_errors.py", "tests/recordings/test_real_takes.py")

# Every untimed proof that was collected, before any option deselects some.
PROOFS = pytest.StashKey[list[str]]()


def group_of(nodeid: str) -> str:
    """Return the group of a test, which one worker runs: a file, as its tests use the same."""
    if nodeid.startswith(_LONG):
        return nodeid
    return _SOUND if nodeid.startswith(_SOUND) else nodeid.partition("::")[0]


class _Scheduling(LoadScopeScheduling):
    """Schedules the groups of tests in the order of their collection."""

    def __init__(self, config: pytest.Config, log: Producer) -> None:
        super().__init__(config, log)
        config.option.loadscopereorder = False  # by xdist those of one test, however long, are last

    def _split_scope(self, nodeid: str) -> str:
        return group_of(nodeid)


def _untimed_proof(item: pytest.Item) -> bool:
    return item.get_closest_marker("prove") is not None and item.get_closest_marker("timed") is None


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--part",
        type=part,
        metavar="k/n",
        help="of the untimed proofs only the k-th of n parts that take about equally long",
    )
    parser.addoption(
        "--group-seconds",
        action="store_true",
        help="list how long each group of tests takes, as in tests/parts.py",
    )


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Select the part."""
    proofs = [item for item in items if _untimed_proof(item)]
    config.stash[PROOFS] = [item.nodeid for item in proofs]
    if config.option.part is not None:
        number, parts = config.option.part
        selected = [item for item in proofs if part_of(group_of(item.nodeid), parts) == number]
        config.hook.pytest_deselected(items=list(set(items).difference(selected)))
        items[:] = selected


@pytest.hookimpl(tryfirst=True)
def pytest_collection_finish(session: pytest.Session) -> None:
    """Sort the tests, the longest first, so that no worker waits for it at the end."""
    counts = Counter(group_of(item.nodeid) for item in session.items)

    def order(item: pytest.Item) -> tuple[float, bool, bool, int]:
        nodeid, group = item.nodeid, group_of(item.nodeid)
        seconds = SECONDS.get(group, 0.0) if _untimed_proof(item) else 0.0
        return -seconds, not nodeid.startswith(_FIRST), not nodeid.startswith(_LONG), -counts[group]

    session.items.sort(key=order)
    # What was imported and collected stays: no garbage collection has to walk through it again.
    gc.collect()
    gc.freeze()


def pytest_sessionfinish() -> None:
    gc.unfreeze()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """List the seconds of each group of tests, the longest first."""
    if not terminalreporter.config.option.group_seconds:
        return
    seconds: Counter[str] = Counter()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                seconds[group_of(report.nodeid)] += report.duration
    terminalreporter.section("seconds of each group")
    for group, total in seconds.most_common():
        terminalreporter.line(f'    "{group}": {total:.0f},')


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadScopeScheduling:
    return _Scheduling(config, log)

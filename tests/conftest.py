"""What holds for all tests: one thread a worker, no screen, no cache, repeatable examples."""

from __future__ import annotations

import os
import signal

import hypothesis
import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

# Before NumPy is imported: two workers with a thread pool each would fight for the same cores.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Tests of the cache name a folder of their own; nobody's real one is touched.
os.environ["STRUCK_CACHE"] = "off"

# Whoever starts tests in the background may have switched Ctrl-C off, and children inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

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


class _Scheduling(LoadScopeScheduling):
    """A file's tests go to one worker, as they share what takes long to make."""

    def _split_scope(self, nodeid: str) -> str:
        if nodeid.startswith(_LONG):
            return nodeid
        return _SOUND if nodeid.startswith(_SOUND) else nodeid.partition("::")[0]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest first, so that no worker waits for it at the end."""
    items.sort(key=lambda item: not item.nodeid.startswith(_LONG))
    items.sort(key=lambda item: not item.nodeid.startswith(_FIRST))


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadScopeScheduling:
    return _Scheduling(config, log)

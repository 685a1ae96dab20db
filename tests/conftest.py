"""What holds for all tests: one thread a worker, no screen, no cache, repeatable examples."""

from __future__ import annotations

import os

import hypothesis
import pytest
from xdist.remote import Producer
from xdist.scheduler import LoadScopeScheduling

# Before NumPy is imported: two workers with a thread pool each would fight for the same cores.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Tests of the cache name a folder of their own; nobody's real one is touched.
os.environ["STRUCK_CACHE"] = "off"

hypothesis.settings.register_profile("struck", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("struck")

# Each of these takes loops that take long to compile: one worker does, the other need not. And two
# sound servers at once get into each other's way: JACK then refuses clients of either.
_TOGETHER = {
    "sound": (
        "tests/ears/",
        "tests/excitation/",
        "tests/live/",
        "tests/scene/test_mix",
        "tests/synth/",
    ),
    "fit": (
        "tests/cli/test_calibrate",
        "tests/cli/test_compare",
        "tests/cli/test_fit",
        "tests/model/test_",
        "tests/recordings/",
        "tests/report/",
    ),
}


class _Scheduling(LoadScopeScheduling):
    def _split_scope(self, nodeid: str) -> str:
        alike = (name for name, places in _TOGETHER.items() if nodeid.startswith(places))
        return next(alike, nodeid)


def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadScopeScheduling:
    return _Scheduling(config, log)

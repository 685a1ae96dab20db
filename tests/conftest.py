"""What holds for all tests: one thread a worker, no screen, no cache, repeatable examples."""

from __future__ import annotations

import os

import hypothesis

# Before NumPy is imported: two workers with a thread pool each would fight for the same cores.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
os.environ.setdefault("MPLBACKEND", "Agg")
# Tests of the cache name a folder of their own; nobody's real one is touched.
os.environ["STRUCK_CACHE"] = "off"

hypothesis.settings.register_profile("struck", derandomize=True, deadline=None, database=None)
hypothesis.settings.load_profile("struck")

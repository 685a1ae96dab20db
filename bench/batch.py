"""Batches: how much faster two workers are than one, and what each job costs beside its analysis.

`python bench/batch.py` takes 24 small solids as mesh files. It wants two free cores: ratios of
times by the clock mean nothing where others compute. What two processes gain that know nothing of
each other is told beside it, as two processors may be one core. What a job costs is processor time.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import resource
import subprocess
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import trimesh

import struck
from struck.batch import analyze_many

COUNT = 24
LEAST_FASTER, MOST_OVERHEAD = 1.7, 0.3  # times; s of a processor for each job


def processor() -> float:
    """Return the time of this process and of those that it waited for, s."""
    both = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(each.ru_utime + each.ru_stime for each in both)


def solids(folder: Path) -> list[str]:
    """Write bars of some sizes, and return their files."""
    files = [str(folder / f"{number:02d}.obj") for number in range(COUNT)]
    for number, file in enumerate(files):
        trimesh.creation.box(extents=(0.08 + 0.002 * number, 0.03, 0.012)).export(file)
    return files


ALONE = """
import struck, sys
for file in sys.argv[1:]:
    struck.analyze(file, "steel", accuracy="preview", cache=False)
"""


def apart(files: list[str], count: int) -> float:
    """Return how long some processes take that share the files, s."""
    begun = time.perf_counter()
    shares = [[sys.executable, "-c", ALONE, *files[n::count]] for n in range(count)]
    for process in [subprocess.Popen(words) for words in shares]:
        process.wait()
    return time.perf_counter() - begun


def main() -> None:
    """Print both figures."""
    how = {"accuracy": "preview", "cache": False}
    with TemporaryDirectory() as name:
        folder = Path(name)
        files = solids(folder)
        struck.analyze(files[0], "steel", **how)  # loads what all need
        before = processor()
        for file in files:
            struck.save(struck.analyze(file, "steel", **how), folder / "alone.struck")
        alone = processor() - before
        clock: dict[int, list[float]] = {1: [], 2: []}
        together = []
        for turn, count in enumerate((1, 2, 2, 1)):
            before, begun = processor(), time.perf_counter()
            analyze_many(files, "steel", out=folder / f"out{turn}", processes=count, **how)
            clock[count].append(time.perf_counter() - begun)
            together.append(processor() - before)
        machine = apart(files, 1) / apart(files, 2)
    faster = min(clock[1]) / min(clock[2])
    overhead = (min(together) - alone) / COUNT
    print(f"{COUNT} small solids, {alone / COUNT:.2f} s of a processor each alone")
    print(f"two workers {faster:.2f} times as fast as one (at least {LEAST_FASTER})")
    print(f"two processes without any batch {machine:.2f} times as fast as one")
    print(f"a job costs {overhead:.2f} s of a processor more (at most {MOST_OVERHEAD})")


if __name__ == "__main__":
    main()

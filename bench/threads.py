"""Threads: a preview of a bowl by number of threads, idle and with one core kept busy.

`python bench/threads.py` prints medians of nine runs, interleaved, in seconds by the clock and of
the processor, and how far the number that struck takes by itself is from the best; `--runs 3` does
less. Run it on an idle machine: whatever else runs is a busy core that nobody counted.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from statistics import median

import struck
from struck.core.machine import THREADS, cores
from struck.solids.revolution import bowl

RUNS = 9
WALL, PROCESSOR = 1.25, 1.2  # times the best, at most
OWN = "unset"
BODY = bowl(radius=0.09, height=0.08, wall=0.0025)  # 201 modes
_ENDLESS = "while True: pass"


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """Keep as many cores busy."""
    started = [subprocess.Popen([sys.executable, "-c", _ENDLESS]) for _ in range(processes)]
    try:
        yield
    finally:
        for each in started:
            each.kill()
            each.wait()


def taken(setting: str) -> tuple[float, float]:
    """Return seconds by the clock and of the processor for one preview."""
    os.environ.pop(THREADS, None)
    if setting != OWN:
        os.environ[THREADS] = setting
    clock, processor = time.perf_counter(), time.process_time()
    struck.analyze(BODY, "bronze", accuracy="preview", cache=False)
    return time.perf_counter() - clock, time.process_time() - processor


def measured(settings: list[str], runs: int) -> Mapping[str, tuple[float, float]]:
    """Return the medians of interleaved runs by setting."""
    found: dict[str, list[tuple[float, float]]] = {each: [] for each in settings}
    for run in range(runs):
        order = settings[run % len(settings) :] + settings[: run % len(settings)]
        for setting in order:
            found[setting].append(taken(setting))
    return {
        setting: (median(clock for clock, _ in each), median(used for _, used in each))
        for setting, each in found.items()
    }


def shown(load: str, medians: Mapping[str, tuple[float, float]]) -> bool:
    """Print a table, and return whether the own choice is near enough to the best."""
    print(f"{load}:")
    for setting, (clock, used) in medians.items():
        print(f"  {THREADS} {setting:>5s}  {clock:6.2f} s by the clock  {used:6.2f} s processor")
    best = [min(each[which] for each in medians.values()) for which in (0, 1)]
    clock, used = (own / least for own, least in zip(medians[OWN], best, strict=True))
    kept = clock <= WALL and used <= PROCESSOR
    print(
        f"  {OWN} over the best: {clock:.2f} by the clock (at most {WALL:g}), {used:.2f} of the "
        f"processor (at most {PROCESSOR:g}){'' if kept else ': too much'}"
    )
    return kept


def main() -> int:
    """Measure idle, then beside a process that never rests."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=RUNS, help=f"of each setting ({RUNS})")
    runs = parser.parse_args().runs
    settings = [OWN, *dict.fromkeys(map(str, (1, 2, cores())))]
    taken(OWN)  # what is loaded and compiled once
    kept = []
    for load, processes in (("idle", 0), ("one core kept busy", 1)):
        with busy(processes):
            kept.append(shown(load, measured(settings, runs)))
    return 0 if all(kept) else 1


if __name__ == "__main__":
    sys.exit(main())

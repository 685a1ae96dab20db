"""Processor time of boundary elements: a frequency, a hundred modes, and two threads.

python bench/radiation.py          on one core: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1
python bench/radiation.py threads  wall time of one thread and of two
"""

from __future__ import annotations

import os
import subprocess
import sys
import time

import numpy as np

from struck.radiation.boundary_elements import solved
from tests.radiation import bodies

RUNS = 5


def best(clock: object) -> float:
    """Return the least time of a solution on 1,152 triangles, s."""
    mesh = bodies.bowl(0.06, 0.004, 24, 12)
    velocities = np.random.default_rng(0).standard_normal((len(mesh.faces), 2))
    times = []
    for run in range(RUNS):
        begun = clock()
        solved(mesh, 20.0 + run, velocities, np.arange(2))
        times.append(clock() - begun)
    return min(times)


def main() -> None:
    """Print the figures."""
    if sys.argv[1:] == ["wall"]:
        print(best(time.perf_counter))
        return
    if sys.argv[1:] == ["threads"]:
        found = []
        for count in ("1", "2"):
            own = {"OMP_NUM_THREADS": count, "OPENBLAS_NUM_THREADS": count}
            done = subprocess.run(
                [sys.executable, __file__, "wall"],
                env={**os.environ, **own},
                capture_output=True,
                text=True,
                check=True,
            )
            found.append(float(done.stdout))
        print(f"one thread {found[0]:.3f} s, two {found[1]:.3f} s: {found[0] / found[1]:.2f} times")
        return
    each = best(time.process_time)
    print(
        f"1,152 triangles: {each:.3f} s of a processor a frequency; 100 of them {100 * each:.0f} s"
    )


if __name__ == "__main__":
    main()

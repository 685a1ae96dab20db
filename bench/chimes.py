"""Wind chimes of 2002: how much faster than real time simulation and sound are, stage by stage.

`python bench/chimes.py` prints processor seconds for 8 s of chimes, once their modes are known.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import tempfile
import time
from itertools import pairwise
from pathlib import Path

import struck
from struck.report.obrien2002 import SCENES, ready
from struck.scene import events_of

LEAST = 5.0  # times real time


def main() -> None:
    """Measure each stage."""
    with tempfile.TemporaryDirectory() as folder:
        staged = SCENES["chimes"](Path(folder), "preview")
        simulation = ready(staged, Path(folder), "preview")
    begun = time.process_time()
    staged.ears.filters(48_000)
    clock = [time.process_time()]
    once = clock[0] - begun
    scene, contacts = simulation.run(staged.seconds, control=staged.control)
    clock.append(time.process_time())
    excited = events_of(scene, contacts).on()
    clock.append(time.process_time())
    bodies = [body for body in excited.bodies.values() if not body.silent]
    struck.render(bodies, listener=staged.ears, seconds=staged.seconds)
    clock.append(time.process_time())
    stages = [late - early for early, late in pairwise(clock)]
    for name, taken in zip(("simulation", "events", "two ears"), stages, strict=True):
        print(f"{name:12s} {taken:6.2f} s")
    print(f"{'a head, once':12s} {once:6.2f} s: all directions between those measured")
    faster, alone = staged.seconds / sum(stages), staged.seconds / (sum(stages) + once)
    print(
        f"{len(contacts)} rows; {faster:.1f} times faster than real time (wanted: {LEAST:g}), "
        f"{alone:.1f} with the head"
    )


if __name__ == "__main__":
    main()

"""Reading 1,000 small meshes and 1,000 small contact logs: what the guarded process costs a file.

`python bench/reading.py` reads each file by the process that reads foreign files, and by the same
reader within the program, in turn. What the former takes longer is one message to the process and
back, and the start of that process once; it must stay below the larger of 5 % and 10 ms a file.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import trimesh

from struck.files import contact_log, guard, mesh_formats
from struck.files.messages import ReadingLimits
from struck.scene import Contacts, save_contacts

COUNT = 1000
MAX_RATIO, MAX_ADDED = 1.05, 0.01  # of the time within the program; s a file
LIMITS = ReadingLimits()


def write_files(folder: Path) -> dict[str, list[Path]]:
    """Write small meshes and contact logs, and return their paths by kind."""
    rng = np.random.default_rng(0)
    meshes, logs = [], []
    for number in range(COUNT):
        meshes.append(folder / f"{number}.stl")
        trimesh.creation.box(rng.uniform(0.02, 0.1, 3)).export(meshes[-1])
        logs.append(folder / f"{number}.csv")
        rows = {"time": np.arange(20) * 0.01, "body0": np.zeros(20), "body1": np.ones(20)}
        vectors = {"position": rng.random((20, 3)), "impulse": rng.random((20, 3))}
        save_contacts(Contacts(names=["floor", "block"], **rows, **vectors), logs[-1])
    return {"meshes": meshes, "contact logs": logs}


def read_guarded(kind: str, path: Path) -> None:
    """Read a file by the guarded process."""
    if kind == "meshes":
        guard.read_contents(path)
    else:
        options = {"kind": "csv"}
        guard.read_foreign("contacts", path, contact_log.columns_of, advice="", options=options)


def read_within(kind: str, path: Path) -> None:
    """Read a file by the same reader within the program."""
    if kind == "meshes":
        mesh_formats.answer_surface(path, LIMITS)
    else:
        contact_log.answer(path, LIMITS, kind="csv")


def main() -> int:
    """Run the benchmark."""
    failures = 0
    with TemporaryDirectory() as folder:
        for kind, paths in write_files(Path(folder)).items():
            guard.close()  # its start counts
            guarded_time = time_within = 0.0
            for path in paths:
                start = time.perf_counter()
                read_guarded(kind, path)
                middle = time.perf_counter()
                read_within(kind, path)
                guarded_time += middle - start
                time_within += time.perf_counter() - middle
            added = (guarded_time - time_within) / COUNT
            ratio = guarded_time / time_within
            is_met = ratio <= MAX_RATIO or added <= MAX_ADDED
            failures += not is_met
            print(
                f"{COUNT} {kind}: {1e3 * guarded_time / COUNT:.2f} ms each, {ratio:.2f} times the "
                f"reader within the program, {1e3 * added:.2f} ms more (at most {MAX_RATIO} times "
                f"or 10 ms): {'met' if is_met else 'NOT MET'}"
            )
    return bool(failures)


if __name__ == "__main__":
    sys.exit(main())

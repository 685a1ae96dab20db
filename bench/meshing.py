"""How long the wall of a hollow body takes to fill with tetrahedra, and how long fTetWild takes.

Both get the same closed surface, outer and inner face of the wall, and make linear tetrahedra
with about as many nodes; ours then also does all that vibration needs, from the outer face on:
the cavity, curved quadratic elements, checks. They take turns in processes of their own, on one
thread; ratios are of processor time within a round.
"""

from __future__ import annotations

import argparse
import importlib.util
import multiprocessing
import os
import statistics
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace

# Before NumPy is imported: one thread each.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import numpy as np
from numpy.typing import NDArray

from struck import Mesh
from struck.files.meshes import load_body
from struck.report.gallery import bird
from struck.solids.filling import filling
from struck.solids.lattice import stuff_body
from struck.solids.surface.distance import FilledBody

Array = NDArray[np.float64]
Index = NDArray[np.int64]
TARGET, LIKENESS, TRIALS = 20.0, 0.1, 6
WALL = 0.0063
MISSING = "fTetWild is not here: pip install pytetwild pyvista"
LINEAR, WHOLE, PEER = "struck, tetrahedra", "struck, checked", "fTetWild"
# Of the surface that both get: triangles a wall, fine enough to be no limit.
_FINENESS = 0.375


@dataclass(frozen=True, slots=True, kw_only=True)
class Job:
    """What to fill: the outer face with its wall, and both faces as one surface."""

    outer: Mesh
    wall: float
    faces: Mesh


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """Processor and wall time, s, and the tetrahedra: corners (N, 3) and their numbers (T, 4)."""

    processor: float
    wall: float
    points: Array
    tetrahedra: Index

    @property
    def angles(self) -> Array:
        """Dihedral angles, degrees (T, 6)."""
        corners = self.points[self.tetrahedra]
        normals = [
            np.cross(corners[:, b] - corners[:, a], corners[:, c] - corners[:, a])
            for a, b, c in ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))
        ]
        unit = [each / np.linalg.norm(each, axis=1, keepdims=True) for each in normals]
        cosines = [-(unit[i] * unit[j]).sum(axis=1) for i in range(4) for j in range(i)]
        return np.degrees(np.arccos(np.clip(np.stack(cosines, axis=1), -1, 1)))


def timed(work: Callable[[], tuple[Array, Index]]) -> Run:
    """Run and measure."""
    processor, wall = time.process_time(), time.perf_counter()
    points, tetrahedra = work()
    return Run(
        processor=time.process_time() - processor,
        wall=time.perf_counter() - wall,
        points=points,
        tetrahedra=tetrahedra,
    )


def by_ftetwild(job: Job, _wanted: float) -> Run:
    """Let fTetWild fill the surface as it does by itself."""
    import pytetwild  # pyright: ignore[reportMissingImports]

    faces = job.faces.faces.astype(np.int32)
    return timed(lambda: pytetwild.tetrahedralize(job.faces.points, faces, num_threads=1))


def as_tetrahedra(job: Job, spacing: float) -> Run:
    """Fill the same surface on a lattice of `spacing`, m."""

    def work() -> tuple[Array, Index]:
        body = FilledBody(mesh=job.faces)
        mesh = stuff_body(body.depths, body.bounds, spacing)
        return mesh.nodes, mesh.elements

    return timed(work)


def checked(job: Job, nodes: float) -> Run:
    """Go the whole way from the outer face, beginning with about so many quadratic nodes."""
    goal = replace(filling.ACCURACIES["fine"], nodes=int(nodes), max_nodes=300_000)
    filling.ACCURACIES = {**filling.ACCURACIES, "fine": goal}

    def work() -> tuple[Array, Index]:
        mesh = filling.fill_body(FilledBody(mesh=job.outer, wall=job.wall), "fine").mesh
        numbers, local = np.unique(mesh.corners, return_inverse=True)
        return mesh.nodes[numbers], local.reshape(-1, 4)

    return timed(work)


CONTENDERS = {PEER: by_ftetwild, LINEAR: as_tetrahedra, WHOLE: checked}


def job_of(path: str | None, size: float, wall: float) -> Job:
    """Return the bird, or the body of a file scaled to `size`, with its wall, m."""
    outer = bird() if path is None else load_body(path, size=size).mesh
    body = FilledBody(mesh=outer, wall=wall)
    faces, _ = stuff_body(body.depths, body.bounds, _FINENESS * wall, outer.up).surface()
    return Job(outer=outer, wall=wall, faces=faces)


def contend(name: str, job: Job, setting: float) -> Run:
    """Run one contender."""
    return CONTENDERS[name](job, setting)


def setting_for(
    pool: ProcessPoolExecutor, name: str, job: Job, wanted: int, guess: float, power: float
) -> float:
    """Return the setting that makes about `wanted` nodes, their count going as its power."""
    for _ in range(TRIALS):
        made = len(pool.submit(contend, name, job, guess).result().points)
        if abs(made / wanted - 1) < LIKENESS:
            break
        guess *= (wanted / made) ** (1 / power)
    return guess


def rounds(pool: ProcessPoolExecutor, job: Job, count: int) -> dict[str, list[Run]]:
    """Let fTetWild say how many nodes it makes; then take turns."""
    runs = {PEER: [pool.submit(contend, PEER, job, 0.0).result()]}
    wanted = len(runs[PEER][0].points)
    settings = {
        LINEAR: setting_for(pool, LINEAR, job, wanted, 0.6 * job.wall, -3),
        WHOLE: setting_for(pool, WHOLE, job, wanted, 5 * wanted, 1),
    }
    runs |= {name: [] for name in settings}
    for turn in range(count):
        if turn:
            runs[PEER].append(pool.submit(contend, PEER, job, 0.0).result())
        for name, setting in settings.items():
            runs[name].append(pool.submit(contend, name, job, setting).result())
        print(f"  round {turn + 1} of {count}", file=sys.stderr, flush=True)
    return runs


def show(runs: dict[str, list[Run]]) -> None:
    """Print what each took and made, and whether we are as much faster as we mean to be."""
    head = "dihedral angles: least, 1 %, most"
    print(
        f"{'median':20} {'processor s':>12} {'wall s':>8} {'nodes':>8} {'tetrahedra':>11}  {head}"
    )
    for name, turns in runs.items():
        processor = statistics.median(run.processor for run in turns)
        wall = statistics.median(run.wall for run in turns)
        counts = f"{len(turns[0].points):8} {len(turns[0].tetrahedra):11}"
        least, low, most = np.percentile(turns[0].angles, [0, 1, 100])
        angles = f"{least:.1f}, {low:.1f}, {most:.1f} degrees"
        print(f"{name:20} {processor:12.2f} {wall:8.2f} {counts}  {angles}")
    for name in (LINEAR, WHOLE):
        pairs = zip(runs[PEER], runs[name], strict=True)
        ratio = statistics.median(peer.processor / ours.processor for peer, ours in pairs)
        verdict = "met" if ratio >= TARGET else "MISSED"
        print(f"at least {TARGET:g} times faster than {PEER} ({name}): {ratio:.1f}, {verdict}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--surface", help="mesh file of the outer face (a bird)")
    parser.add_argument("--size", type=float, default=0.15, help="its longest extent, m (0.15)")
    parser.add_argument("--wall", type=float, default=WALL, help=f"thickness, m ({WALL})")
    parser.add_argument("--rounds", type=int, default=3, help="turns of each contender (3)")
    arguments = parser.parse_args()
    if any(importlib.util.find_spec(name) is None for name in ("pytetwild", "pyvista")):
        print(MISSING)
        return
    job = job_of(arguments.surface, arguments.size, arguments.wall)
    print(f"wall of {1e3 * job.wall:g} mm, {len(job.faces.faces)} triangles\n")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context, max_tasks_per_child=1) as pool:
        show(rounds(pool, job, arguments.rounds))


if __name__ == "__main__":
    main()

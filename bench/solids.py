"""How long the modes of a hollow body take, and how long they take others on the same mesh.

The contenders take turns, each run in a process of its own and on one thread, so that memory is
each one's own and whatever else the machine does falls on all of them; ratios are within a round.
"""

from __future__ import annotations

import argparse
import importlib.metadata
import multiprocessing
import os
import platform
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

# Before NumPy is imported: one thread each.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", RAYON_NUM_THREADS="1")

import calculix
import numpy as np
import starting
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import LinearOperator, eigsh

from struck import Material
from struck.report.gallery import bird
from struck.solids import Block, VolumeMesh
from struck.solids.fem.assembly import System, assemble
from struck.solids.fem.factorisation import factorise
from struck.solids.fem.lanczos import Mass, block_lanczos, rigid_motions
from struck.solids.fem.vibration import vibration_modes
from struck.solids.filling import filling
from struck.solids.surface.distance import FilledBody

Array = NDArray[np.float64]
WALL, BAND, COUNT = 0.0063, 47e3, 50
SHIFT = -((2 * np.pi * BAND) ** 2) / 400
MATERIAL = Material.named("ceramic")
CERTIFIED, MODES, SUPERLU = "struck, certified", "struck", "struck by SuperLU"
ARPACK, SCIPY, CALCULIX = "ARPACK, our factor", "scipy's default", "CalculiX"


@dataclass(frozen=True, slots=True, kw_only=True)
class Case:
    """A hollow bird by how many nodes are asked for, and how much faster we mean to be."""

    asked: int
    target: float
    contenders: tuple[str, ...]


SMALL = Case(
    asked=40_000,  # makes about 31,000
    target=8.0,
    contenders=(MODES, CERTIFIED, ARPACK, SCIPY, CALCULIX, SUPERLU),
)
LARGE = Case(asked=82_000, target=10.0, contenders=(MODES, CERTIFIED, SCIPY))  # about 60,000


@dataclass(frozen=True, slots=True, kw_only=True)
class Cost:
    """Processor and wall time, s, and the largest memory of the process so far, bytes."""

    processor: float
    wall: float
    memory: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Run:
    """What one contender took and found."""

    cost: Cost
    frequencies: Array


class Stopwatch:
    """Adds up what each stage takes; tell it when one begins."""

    def __init__(self) -> None:
        self.stages: dict[str, Cost] = {}
        self._current, self._begun = "", _spent()

    def __call__(self, stage: str, _fraction: float = 0.0) -> None:
        """Begin a stage."""
        now, before = _spent(), self.stages.get(self._current, Cost(processor=0, wall=0, memory=0))
        self.stages[self._current] = Cost(
            processor=before.processor + now.processor - self._begun.processor,
            wall=before.wall + now.wall - self._begun.wall,
            memory=now.memory,
        )
        self._current, self._begun = stage, now

    def within(self, stage: str, work: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function whose time counts for `stage` and not for the one around it."""

        def watched(*arguments: Any) -> Any:  # noqa: ANN401 - numba has no types
            around = self._current
            self(stage)
            result = work(*arguments)
            self(around)
            return result

        return watched


def _spent() -> Cost:
    mine, children = map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    unit = 1 if sys.platform == "darwin" else 1024
    return Cost(
        processor=sum(used.ru_utime + used.ru_stime for used in (mine, children)),
        wall=time.perf_counter(),
        memory=unit * max(mine.ru_maxrss, children.ru_maxrss),
    )


def stages(case: Case, path: Path) -> tuple[str, dict[str, Cost]]:
    """Go the whole way from surface to certified modes; keep the mesh for the contenders."""
    watch, surface = Stopwatch(), bird()
    FilledBody.depths = watch.within("distance", FilledBody.depths)
    watch("mesh")
    most = dict.fromkeys(("max_nodes", "max_thin_nodes", "simplify_above"), 200_000)
    goal = filling.Accuracy(nodes=case.asked, error=1.0, **most)
    filling.ACCURACIES = {**filling.ACCURACIES, "fine": goal}
    mesh = filling.fill_body(FilledBody(mesh=surface, wall=WALL), "fine")
    # The contenders know quadratic displacements alone.
    mesh = replace(mesh, mesh=replace(mesh.mesh, cubic=False))
    modes = vibration_modes(mesh.mesh, MATERIAL, BAND, progress=watch)
    watch("")
    np.savez(path, nodes=mesh.mesh.nodes, elements=mesh.mesh.elements)
    story = (
        f"Bird {surface.extent:.3g} m long, {len(surface.faces)} triangles, wall "
        f"{1e3 * WALL:g} mm; lattice {1e3 * mesh.spacing:.4g} mm, "
        f"{len(mesh.mesh.nodes)} nodes, {len(mesh.mesh.elements)} {mesh.mesh.kind}, "
        f"volume {100 * mesh.volume_error:+.3f} %; {len(modes.frequencies)} modes from "
        f"{modes.frequencies[0]:.0f} to {modes.frequencies[-1]:.0f} Hz"
    )
    return story, {stage: cost for stage, cost in watch.stages.items() if stage}


def measured(work: Callable[[], Array]) -> Run:
    """Run and measure."""
    watch = Stopwatch()
    watch("work")
    frequencies = work()
    watch("")
    return Run(cost=watch.stages["work"], frequencies=frequencies[:COUNT])


def certified(mesh: VolumeMesh) -> Run:
    """Take all modes of the band, from the mesh to the proof that none is missing."""
    return measured(lambda: vibration_modes(mesh, MATERIAL, BAND).frequencies)


def modes_alone(mesh: VolumeMesh, backend: str = "auto") -> Run:
    """Assemble, factorise and iterate to a given count of modes, as the others do."""

    def work() -> Array:
        system = assemble(mesh, MATERIAL)
        solve = factorise(system.shifted(SHIFT), backend).solve
        mass = Mass(system.mass_matrix())
        pairs = block_lanczos(solve, mass, SHIFT, COUNT, rigid_motions(mesh.nodes))
        return np.sqrt(pairs.values) / (2 * np.pi)

    return measured(work)


def by_superlu(mesh: VolumeMesh) -> Run:
    """Do the same without rslab."""
    return modes_alone(mesh, "superlu")


def scipy_default(mesh: VolumeMesh) -> Run:
    """Let eigsh shift and invert as it does by itself; assembly not counted."""
    stiffness, mass = matrices(assemble(mesh, MATERIAL))
    return measured(lambda: elastic(eigsh(stiffness, COUNT + 6, mass, sigma=SHIFT)[0]))


def arpack_on_our_factor(mesh: VolumeMesh) -> Run:
    """Let ARPACK iterate on our factorisation; assembly not counted."""
    system = assemble(mesh, MATERIAL)
    stiffness, mass = matrices(system)

    def work() -> Array:
        solve = factorise(system.shifted(SHIFT)).solve
        inverse = LinearOperator(
            stiffness.shape, matvec=lambda right: solve(right.reshape(-1, 1)), dtype=float
        )
        return elastic(eigsh(stiffness, COUNT + 6, mass, sigma=SHIFT, OPinv=inverse)[0])

    return measured(work)


def by_calculix(mesh: VolumeMesh) -> Run:
    """Run ccx, its own assembly included."""
    with tempfile.TemporaryDirectory() as folder:
        return measured(lambda: calculix.frequencies(mesh, MATERIAL, COUNT, Path(folder)))


CONTENDERS = {
    MODES: modes_alone,
    CERTIFIED: certified,
    ARPACK: arpack_on_our_factor,
    SCIPY: scipy_default,
    CALCULIX: by_calculix,
    SUPERLU: by_superlu,
}


def matrices(system: System) -> tuple[sparse.csc_matrix, sparse.csc_matrix]:
    """Return stiffness and mass in full, as scipy wants them."""
    lower = system.shifted(0.0)
    full = (lower + sparse.tril(lower, -1).T).tocsc()
    return full, sparse.kron(system.mass_matrix(), sparse.eye_array(3)).tocsc()


def elastic(values: Array) -> Array:
    """Return the frequencies above the six rigid motions, Hz."""
    return np.sqrt(np.sort(values)[6:]) / (2 * np.pi)


def contend(name: str, path: Path) -> Run:
    """Run one contender on the mesh kept in a file."""
    kept = np.load(path)
    mesh = VolumeMesh(nodes=kept["nodes"], elements=kept["elements"], kind="tet10")
    return CONTENDERS[name](mesh)


def rounds(pool: ProcessPoolExecutor, case: Case, path: Path, count: int) -> dict[str, list[Run]]:
    """Let the contenders take turns; SuperLU, there for its answers, runs once."""
    runs: dict[str, list[Run]] = {name: [] for name in case.contenders}
    if CALCULIX in runs and not calculix.installed():
        print(f"{calculix.MISSING}\n")
        del runs[CALCULIX]
    for turn in range(count):
        for name, done in runs.items():
            if name != SUPERLU or turn == 0:
                done.append(pool.submit(contend, name, path).result())
                cost = done[-1].cost
                print(f"  round {turn + 1}, {name}: {cost.wall:.1f} s", file=sys.stderr, flush=True)
    return runs


def show_stages(costs: dict[str, Cost]) -> None:
    """Print what each stage took."""
    print(f"{'stage':22} {'processor s':>12} {'wall s':>8} {'peak GiB so far':>16}")
    for stage, cost in costs.items():
        print(f"{stage:22} {cost.processor:12.2f} {cost.wall:8.2f} {cost.memory / 2**30:16.2f}")
    total = [sum(getattr(cost, what) for cost in costs.values()) for what in ("processor", "wall")]
    print(f"{'total':22} {total[0]:12.2f} {total[1]:8.2f}\n")


def show_runs(runs: dict[str, list[Run]]) -> None:
    """Print what each contender took, also as multiples of ours in the same round."""
    heads = ("processor s", "wall s", "x struck", "x certified")
    print(f"{'median (least-most)':20}", *(f"{head:>17}" for head in heads), "   GiB  frequencies")
    reference = runs[CERTIFIED][0].frequencies
    for name, turns in runs.items():
        costs = [run.cost for run in turns]
        cells = [
            spread([cost.processor for cost in costs]),
            spread([cost.wall for cost in costs]),
            *(spread(ratios(runs, name, ours)) for ours in (MODES, CERTIFIED)),
        ]
        memory = max(cost.memory for cost in costs) / 2**30
        difference = max(np.abs(run.frequencies / reference - 1).max() for run in turns)
        print(f"{name:20}", *(f"{c:>17}" for c in cells), f"{memory:6.2f}  within {difference:.0e}")


def ratios(runs: dict[str, list[Run]], name: str, ours: str) -> list[float]:
    """Return processor times as multiples of ours, round by round."""
    pairs = zip(runs[name], runs[ours], strict=name != SUPERLU)
    return [theirs.cost.processor / mine.cost.processor for theirs, mine in pairs]


def spread(values: Iterable[float]) -> str:
    """Return median, least and most."""
    every = sorted(values)
    return f"{statistics.median(every):.1f} ({every[0]:.1f}-{every[-1]:.1f})"


def show_targets(case: Case, runs: dict[str, list[Run]]) -> None:
    """Print whether we are as much faster as we mean to be."""
    print()
    for name in (SCIPY, CALCULIX):
        for ours in (MODES, CERTIFIED):
            if name in runs:
                ratio = statistics.median(ratios(runs, name, ours))
                verdict = "met" if ratio >= case.target else "MISSED"
                claim = f"at least {case.target:g} times faster than {name} ({ours})"
                print(f"{claim}: {ratio:.1f}, {verdict}")


def compare(pool: ProcessPoolExecutor, case: Case, count: int) -> None:
    """Measure one case and print."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "mesh.npz"
        story, costs = pool.submit(stages, case, path).result()
        print(f"{story}\n")
        show_stages(costs)
        runs = rounds(pool, case, path, count)
    show_runs(runs)
    show_targets(case, runs)
    print()


def many_modes() -> tuple[str, dict[str, Cost]]:
    """Find the hundreds of modes of a table top of oak, slice by slice."""
    watch = Stopwatch()
    watch("mesh")
    top = Block(size=(1.0, 0.9, 0.02), elements=(60, 54, 1)).volume_mesh()
    modes = vibration_modes(top, Material.named("oak"), 20e3, progress=watch)
    watch("")
    details = modes.provenance.details
    story = (
        f"Table top of oak, 1 m x 0.9 m x 2 cm, {len(top.nodes)} nodes: "
        f"{len(modes.frequencies)} modes to 20 kHz, memory forecast {details['memory_forecast']}"
    )
    return story, {stage: cost for stage, cost in watch.stages.items() if stage}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3, help="turns of each contender (3)")
    arguments = parser.parse_args()
    names = ("numpy", "scipy", "rslab")
    versions = (f"{name} {importlib.metadata.version(name)}" for name in names)
    print(f"Python {platform.python_version()}, {', '.join(versions)}; one thread each\n")
    starting.show()
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, context, max_tasks_per_child=1) as pool:
        compare(pool, SMALL, arguments.rounds)
        # scipy takes minutes a turn here.
        compare(pool, LARGE, 1)
        story, costs = pool.submit(many_modes).result()
        print(f"{story}\n")
        show_stages(costs)


if __name__ == "__main__":
    main()

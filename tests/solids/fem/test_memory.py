"""Memory: forecasts beside what is really taken, and what a system says is free."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from scipy import sparse

from struck.core import machine
from struck.core.machine import available
from struck.errors import SolverError
from struck.solids import Block
from struck.solids.fem import factorisation
from struck.solids.fem.spectrum import Solver
from struck.solids.fem.vibration import vibration_modes
from tests.physics.bodies import UNIT

# The growth of the largest resident size from the assembled matrices on, and the forecast, bytes.
MEASURING = """
import sys
from pathlib import Path
from struck import Material
from struck.solids import Block
from struck.solids.fem.spectrum import Search
from struck.solids.fem.spectrum import Solver
from struck.solids.fem.vibration import vibration_modes

def status(name):
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * next(int(line.split()[1]) for line in lines if line.startswith(name))

begun, pairs = [], Search.pairs
def watched(search):
    begun.append(status("VmRSS"))
    yield from pairs(search)
    begun.append(search.forecast)
Search.pairs = watched
size, elements, band, backend = eval(sys.argv[1])
block = Block(size=size, elements=elements).volume_mesh()
modes = vibration_modes(block, Material.named("oak"), band, solver=Solver(backend=backend))
print(status("VmHWM") - begun[0], begun[1], len(modes.frequencies))
"""


def taken_and_foretold(*case: object) -> tuple[int, int, int]:
    done = subprocess.run(
        [sys.executable, "-c", MEASURING, repr(case)], capture_output=True, text=True, check=True
    )
    taken, foretold, modes = map(int, done.stdout.split())
    return taken, foretold, modes


@pytest.mark.prove
@pytest.mark.skipif(sys.platform != "linux", reason="resident sizes are read as Linux tells them")
@pytest.mark.parametrize(
    ("elements", "band", "backend"),
    [
        ((8, 8, 8), 22e3, "rslab"),
        *(
            pytest.param(*case, marks=pytest.mark.prove)
            for case in (
                ((7, 7, 7), 12e3, "superlu"),
                ((10, 10, 10), 9e3, "rslab"),
                ((10, 10, 10), 22e3, "rslab"),
                ((40, 20, 2), 9e3, "rslab"),
                ((9, 9, 9), 9e3, "superlu"),
            )
        ),
    ],
)
def test_forecasts_are_what_is_taken_within_a_factor(
    elements: tuple[int, int, int], band: float, backend: str
) -> None:
    size = tuple(0.02 * count for count in elements)
    taken, foretold, modes = taken_and_foretold(size, elements, band, backend)
    assert modes > 5
    assert taken / 1.5 < foretold < 1.5 * taken


@pytest.mark.prove
@pytest.mark.skipif(sys.platform != "linux", reason="resident sizes are read as Linux tells them")
def test_hundreds_of_modes_of_a_table_top_in_bounded_memory() -> None:
    """1 m of oak, 2 cm thick: the matrices' factor, one slice and the shapes, nothing more."""
    taken, foretold, modes = taken_and_foretold((1.0, 0.9, 0.02), (60, 54, 1), 20e3, "rslab")
    assert modes >= 800
    assert foretold / 1.5 < taken < 1.8 * 2**30


def test_what_does_not_fit_is_refused_before_it_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    stages: list[str] = []
    monkeypatch.setattr(machine, "available", lambda: 2**20)
    block = Block(size=(1, 1, 1), elements=(4, 4, 4)).volume_mesh()
    with pytest.raises(SolverError, match=r"needs about .* GiB .* are free: use a simpler mesh"):
        vibration_modes(
            block,
            UNIT,
            1.0,
            solver=Solver(dense_limit=0),
            progress=lambda stage, _: stages.append(stage),
        )
    assert stages == ["setting up the equations of motion", "counting modes"]


def test_nothing_is_refused_where_nothing_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(machine, "available", lambda: None)
    block = Block(size=(1, 1, 1), elements=(4, 4, 4)).volume_mesh()
    modes = vibration_modes(block, UNIT, 1.0, solver=Solver(dense_limit=0))
    assert str(modes.provenance.details["memory_forecast"]).endswith(" GiB")


def written(root: Path, files: dict[str, str]) -> Path:
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


MACHINE = {"proc/meminfo": "MemTotal: 1000 kB\nMemFree: 10 kB\nMemAvailable:    600 kB\n"}
GROUP = {
    "proc/self/cgroup": "0::/slice/session\n",
    "sys/fs/cgroup/slice/memory.max": "500000\n",
    "sys/fs/cgroup/slice/memory.current": "400000\n",
    "sys/fs/cgroup/slice/memory.stat": "anon 1\ninactive_file 50000\n",
    "sys/fs/cgroup/slice/session/memory.max": "max\n",
    "sys/fs/cgroup/slice/session/memory.current": "300000\n",
}
OLD_GROUP = {
    "proc/self/cgroup": "4:cpu,cpuacct:/a\n5:memory:/a\n",
    "sys/fs/cgroup/memory/memory.limit_in_bytes": "9223372036854771712\n",
    "sys/fs/cgroup/memory/memory.usage_in_bytes": "1\n",
    "sys/fs/cgroup/memory/a/memory.limit_in_bytes": "90000\n",
    "sys/fs/cgroup/memory/a/memory.usage_in_bytes": "30000\n",
}


LIMITED = {
    "proc/self/limits": "Max data size  unlimited  unlimited  bytes\n"
    "Max address space         450000               500000               bytes\n",
    "proc/self/status": "VmPeak:      900 kB\nVmSize:      400 kB\n",
}
UNLIMITED = {
    **LIMITED,
    "proc/self/limits": "Max address space         unlimited       unlimited       bytes\n",
}


@pytest.mark.parametrize(
    ("files", "free"),
    [
        (MACHINE | LIMITED, 40_400),
        (MACHINE | UNLIMITED, 614_400),
        (LIMITED | {"proc/self/status": "VmSize: 500 kB\n"}, 0),
        ({}, None),
        (MACHINE, 614_400),
        (MACHINE | GROUP, 150_000),
        (MACHINE | OLD_GROUP, 60_000),
        ({"proc/meminfo": "MemTotal: 1000 kB\n"}, None),
    ],
)
def test_free_memory_is_the_tightest_limit(
    tmp_path: Path, files: dict[str, str], free: int | None
) -> None:
    assert available(written(tmp_path, files)) == free


@pytest.mark.skipif(sys.platform != "linux", reason="other systems tell nothing")
def test_this_machine_has_something_free() -> None:
    free = available()
    assert free is not None
    assert free > 2**20


@pytest.mark.parametrize(
    ("free", "backend"), [(None, "rslab"), (2**40, "rslab"), (2**31, "superlu")]
)
def test_little_address_space_is_for_superlu(
    free: int | None, backend: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Rslab reserves more than it uses, and ends the process where it gets less."""
    pytest.importorskip("rslab")
    monkeypatch.setattr(factorisation, "free_address_space", lambda: free)
    used = []
    monkeypatch.setattr(factorisation, "_factorise_by_superlu", lambda _: used.append("superlu"))
    monkeypatch.setattr(
        factorisation.Factoriser, "_factorise_by_rslab", lambda *_: used.append("rslab")
    )
    factorisation.Factoriser()(sparse.eye(9, format="csc"))
    assert used == [backend]


@pytest.mark.parametrize(("free", "factor", "reserve"), [(None, 1, 0), (2**30, 3, 2**28)])
def test_superlu_is_forecast_to_copy_in_little_address_space(
    free: int | None, factor: int, reserve: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    matrix = sparse.eye(1000, format="csc")
    monkeypatch.setattr(factorisation, "free_address_space", lambda: free)
    peak, remaining = factorisation.Factoriser("superlu").memory(matrix)
    assert peak - reserve == pytest.approx(factor * 12 * 1000 * 10, rel=1e-4)
    assert remaining == pytest.approx(12 * 1000 * 10 / 2, rel=1e-4)


@pytest.mark.parametrize(("free", "count"), [(None, 3), (2**30, 1)])
def test_one_thread_in_a_limited_address_space(
    free: int | None, count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.delenv(machine.THREADS, raising=False)
    monkeypatch.setattr(machine, "free_address_space", lambda: free)
    assert machine.thread_count() == count
    monkeypatch.setenv(machine.THREADS, "2")
    assert machine.thread_count() == 2

"""Everyday bodies: what struck says of them beside CalculiX on meshes of its own.

    python bench/everyday.py                      the table, against what is kept
    python bench/everyday.py --truth mug 0.003    asks CalculiX anew, on elements of about 3 mm

The truths are those of the very surface, facets and all: boxes as graded bricks of 20 nodes, the
rest as quadratic tetrahedra of TetGen that keep each facet. How far the last two meshes differ
tells their error. TetGen (AGPL) and CalculiX (GPL) are no dependencies: pip install tetgen==0.8.4,
and on Debian apt-get install calculix-ccx (2.20).
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
import time
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

# Before NumPy is imported: one thread each.
os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1")

import calculix
import numpy as np
from numpy.typing import NDArray

import struck
from struck import Material
from struck.errors import StruckError
from struck.solids import VolumeMesh
from struck.solids.fem.elements import ELEMENTS
from struck.solids.surface.distance import FilledBody

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.physics.everyday import BODIES

MATERIALS = {name: Material.named("glass" if "glass" in name else "steel") for name in BODIES}
Array = NDArray[np.float64]
KEPT = Path(__file__).parents[1] / "tests/physics/everyday.json"
COUNT = 20
# mm, symmetric about the middle: planes between bricks, closer near edges that go in
PLANES: dict[str, tuple[Sequence[float], Sequence[float], Sequence[float]]] = {
    "plate of 4 mm": ((0, 300), (0, 200), (0, 4)),
    "plate of 1 mm": ((0, 300), (0, 200), (0, 1)),
}
_NEAR_CRATE = (0, 6, 10, 11.5, 12, 12.5, 14, 18, 30)
_NEAR_CUBE = (0, 1.25, 2.1, 2.4, 2.5, 2.6, 3, 4, 7, 12)


def _both_ends(near: Sequence[float], length: float) -> tuple[float, ...]:
    return (*near, *(length - each for each in reversed(near)))


PLANES["crate"] = (
    _both_ends(_NEAR_CRATE, 400),
    _both_ends(_NEAR_CRATE, 300),
    (*_NEAR_CRATE, 250),
)
PLANES["hollow cube"] = (_both_ends(_NEAR_CUBE, 50),) * 3
_LEGS = (0, 30, 31, 34, 40, 70, 76, 79, 80, 81, 84, 92, 110)
PLANES["table"] = (
    _both_ends(_LEGS, 1000),
    _both_ends(_LEGS, 600),
    (0, 600, 670, 690, 697, 699.5, 700, 700.5, 703, 710, 720, 725),
)


def _subdivided(planes: Sequence[float], size: float) -> Array:
    """Return planes, m, no further apart than `size`."""
    parts = [0.0]
    for a, b in pairwise(planes):
        count = max(1, int(np.ceil((b - a) / 1000 / size - 1e-9)))
        parts += list((a + (b - a) * np.arange(1, count + 1) / count) / 1000)
    return np.array(parts)


def bricks(name: str, size: float) -> VolumeMesh:
    """Return a body of boxes as bricks of 20 nodes, those whose middles are in it."""
    grids = [_subdivided(planes, size) for planes in PLANES[name]]
    fine = [np.sort(np.concatenate([grid, (grid[1:] + grid[:-1]) / 2])) for grid in grids]
    counts = [len(grid) - 1 for grid in grids]
    cells = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)
    middles = np.stack([fine[k][2 * cells[:, k] + 1] for k in range(3)], axis=1)
    cells = cells[FilledBody(mesh=BODIES[name]()).distance(middles) < 0]
    steps = np.round(2 * ELEMENTS["hex20"].nodes).astype(np.int64)
    place = np.moveaxis(2 * cells[:, None] + steps, 2, 0)
    lengths = tuple(len(each) for each in fine)
    numbers, local = np.unique(np.ravel_multi_index(tuple(place), lengths), return_inverse=True)
    where = np.unravel_index(numbers, lengths)
    nodes = np.stack([each[k] for each, k in zip(fine, where, strict=True)], axis=1)
    return VolumeMesh(nodes=nodes, elements=local.reshape(-1, 20), kind="hex20")


def tetrahedra(name: str, size: float) -> VolumeMesh:
    """Return quadratic tetrahedra of TetGen with straight edges: the surface as it is."""
    import tetgen

    surface = BODIES[name]()
    generator = tetgen.TetGen(surface.points, surface.faces.astype(np.int32))
    found = generator.tetrahedralize(switches=f"pq2.0a{size**3 / 6 / np.sqrt(2):.6e}Q")
    nodes, elements = np.asarray(found[0]), np.asarray(found[1])[:, :4].astype(np.int64)
    corners = nodes[elements]
    turned = np.linalg.det(corners[:, 1:] - corners[:, :1]) < 0
    elements[turned] = elements[turned][:, [0, 2, 1, 3]]
    return VolumeMesh(nodes=nodes, elements=elements, kind="tet4").promoted()


def ask(name: str, size: float) -> None:
    """Ask CalculiX on elements of about `size`, m, and keep what it says."""
    mesh = (bricks if name in PLANES else tetrahedra)(name, size)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    with tempfile.TemporaryDirectory() as folder:
        found = calculix.frequencies(mesh, MATERIALS[name], COUNT, Path(folder))
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    record = {
        "size": size,
        "nodes": len(mesh.nodes),
        "seconds": round(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime),
        "frequencies": found.tolist(),
    }
    every = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    others = [each for each in every.get(name, []) if each["size"] != size]
    every[name] = sorted([*others, record], key=lambda each: each["nodes"])
    KEPT.write_text(json.dumps(every, indent=1) + "\n")
    print(name, size, len(mesh.nodes), record["seconds"], np.round(found[:6], 2))


def compare(name: str, accuracy: str) -> str:
    """Return a row: how far the modes are off, how many are bounded, at what cost."""
    kept = json.loads(KEPT.read_text())[name]
    truth = np.array(kept[-1]["frequencies"])
    own = np.abs(np.array(kept[-2]["frequencies"]) / truth - 1) if len(kept) > 1 else np.nan
    begun = time.process_time()
    try:
        model = struck.analyze(
            BODIES[name](),
            MATERIALS[name],
            accuracy=accuracy,
            band=(20, 1.03 * truth[-1]),
            cache=False,
        )
    except StruckError as error:
        return f"{name:18}{accuracy:10}{type(error).__name__}: {error}"
    seconds = time.process_time() - begun
    count = min(len(truth), len(model.frequencies))
    off = model.frequencies[:count] / truth[:count] - 1
    bounded = np.count_nonzero(np.abs(off) <= model.errors[:count])
    return (
        f"{name:18}{accuracy:10}{100 * np.median(off):8.2f}{100 * np.abs(off).max():8.2f}"
        f"{100 * np.max(own):8.2f}{100 * np.median(model.errors[:count]):8.2f}"
        f"{bounded:5d}/{count}{model.provenance.details['nodes']:9}{seconds:7.0f}"
        f"{kept[-1]['nodes']:9}{kept[-1]['seconds']:7}"
    )


def main() -> None:
    """Print the table, or ask CalculiX."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--truth", nargs=2, metavar=("NAME", "METRES"), help="ask CalculiX anew")
    parser.add_argument("--accuracy", default="preview,standard", help="with commas")
    parser.add_argument(
        "--only", default="", help="bodies whose names hold any of these, with commas"
    )
    given = parser.parse_args()
    if given.truth:
        ask(given.truth[0], float(given.truth[1]))
        return
    columns = "  median    most  truth's  stated bounded    nodes  CPU s  CalculiX's nodes, CPU s"
    print(f"{'body':18}{'accuracy':10}{columns}")
    for name in json.loads(KEPT.read_text()):
        wanted = any(part in name for part in given.only.split(","))
        for accuracy in given.accuracy.split(",") if wanted else ():
            print(compare(name, accuracy), flush=True)


if __name__ == "__main__":
    main()

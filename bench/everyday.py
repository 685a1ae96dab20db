"""Everyday bodies: what struck says of them beside CalculiX on meshes of its own.

    python bench/everyday.py                      the table, against what is kept
    python bench/everyday.py --truth mug 0.003    asks CalculiX anew, on elements of about 3 mm

The truths are those of the very surface, facets and all: boxes as graded bricks of 20 nodes (round
a sound hole along its 64 sides), the rest as quadratic tetrahedra of TetGen that keep each facet.
How far the last two meshes differ tells their error; where facets leave no coarser mesh, residuals
do. TetGen (AGPL) and CalculiX (GPL) are no dependencies: pip install tetgen==0.8.4, and on Debian
apt-get install calculix-ccx (2.20).
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
from numpy.typing import ArrayLike, NDArray

import struck
from struck import Material
from struck.errors import StruckError
from struck.solids import VolumeMesh
from struck.solids.fem.error_estimates import SINGLE_MESH_FACTOR
from struck.solids.surface.distance import FilledBody

sys.path.insert(0, str(Path(__file__).parents[1]))
from tests.physics.everyday import BODIES

MATERIALS = {name: Material.named("glass" if "glass" in name else "steel") for name in BODIES}
Array = NDArray[np.float64]
KEPT = Path(__file__).parents[1] / "tests/physics/everyday.json"
COUNT = 20
FACETED = ("wine glass",)  # with facets no larger than elements may be
# mm, symmetric about the middle: planes between bricks, closer near edges that go in
PLANES: dict[str, tuple[Sequence[float], Sequence[float], Sequence[float]]] = {}
_NEAR_CRATE = (0, 6, 10, 11.5, 12, 12.5, 14, 18, 30)
_NEAR_CUBE = (0, 1.25, 2.1, 2.4, 2.5, 2.6, 3, 4, 7, 12)


def _both_ends(near: Sequence[float], length: float) -> tuple[float, ...]:
    return (*near, *(length - each for each in reversed(near)))


# Twist turns within about a thickness of a plate's edges.
for _thickness in (4, 1):
    _near = [_thickness * share for share in (0, 0.25, 0.6, 1.2, 2.5)]
    _planes = (_both_ends(_near, 300), _both_ends(_near, 200), (0, _thickness / 2, _thickness))
    PLANES[f"plate of {_thickness} mm"] = _planes
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
_NEAR_BOX, _NEAR_HOLE = (0, 3, 6, 12), [7.5 * step for step in range(-8, 9)]
_HOLE, _SQUARE, _CENTRE = 0.045, 0.06, (0.25, 0.175)  # radius, half a square around it, m
PLANES["guitar box"] = (
    (*_NEAR_BOX, *(250 + each for each in _NEAR_HOLE), 438, 444, 447, 450),
    (*_NEAR_BOX, *(175 + each for each in _NEAR_HOLE), 338, 344, 347, 350),
    (*_NEAR_BOX, 88, 94, 97, 100),
)


def _plan(name: str, size: float) -> tuple[Array, NDArray[np.int64]]:
    """Return quadrilaterals seen from above: their corners (P, 2), m, and numbers (Q, 4)."""
    x, y = (subdivided(np.array(planes) / 1000, size) for planes in PLANES[name][:2])
    points = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    every = quadrilaterals(points)
    if name == "guitar box":
        away = np.abs(every.mean(axis=1) - _CENTRE).max(axis=1)
        every = np.vstack([every[away > _SQUARE], _around_a_hole(size) + _CENTRE])
    joined, number = np.unique(np.round(every.reshape(-1, 2), 9), axis=0, return_inverse=True)
    return joined, number.reshape(-1, 4)


def _around_a_hole(size: float) -> Array:
    """Return quadrilaterals of a square, with lines along a hole of 64 sides in it (Q, 4, 2)."""
    circle = _HOLE * np.exp(2j * np.pi * np.arange(65) / 64)
    sides = [(1 + 1j * np.linspace(-1, 1, 17)[:-1]) * 1j**turn for turn in range(4)]
    square = _SQUARE * np.roll(np.concatenate(sides), -8)
    square = np.append(square, square[0])
    count = 1 + max(3, int(np.ceil((_SQUARE - _HOLE) / size)))
    share = np.linspace(0, 1, count)[:, None]
    # From a square in the middle of the hole to its edge, and on to the square around it.
    lines = 0.4 * _SQUARE * np.linspace(-1, 1, 17)
    grids = [lines[:, None] + 1j * lines]
    grids += [(1 - share) * a + share * b for a, b in ((0.4 * square, circle), (circle, square))]
    return np.vstack([quadrilaterals(np.stack([g.real, g.imag], axis=-1)) for g in grids])


def subdivided(planes: ArrayLike, size: float) -> Array:
    """Return planes no further apart than `size`, the given ones among them."""
    given = np.asarray(planes, np.float64)
    counts = np.maximum(1, np.ceil(np.diff(given) / size - 1e-9)).astype(int)
    parts = [
        np.linspace(a, b, n + 1)[1:] for (a, b), n in zip(pairwise(given), counts, strict=True)
    ]
    return np.concatenate([given[:1], *parts])


def quadrilaterals(grid: Array) -> Array:
    """Return the corners of a grid's cells, anticlockwise (Q, 4, 2)."""
    corners = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    cells = np.stack(corners, axis=2).reshape(-1, 4, 2)
    x, y = np.moveaxis(cells, 2, 0)
    area = np.sum(x * np.roll(y, -1, axis=1) - np.roll(x, -1, axis=1) * y, axis=1)
    return np.where(area[:, None, None] > 0, cells, cells[:, ::-1])


def bricks(name: str, size: float) -> VolumeMesh:
    """Return a body of boxes as bricks of 20 nodes, those whose middles are in it."""
    points, quads = _plan(name, size)
    heights = subdivided(np.array(PLANES[name][2]) / 1000, size)
    count = len(points)
    nodes = np.column_stack([np.tile(points, (len(heights), 1)), np.repeat(heights, count)])
    layers = count * np.arange(len(heights) - 1)[:, None, None]
    cells = (layers + np.concatenate([quads, quads + count], axis=1)).reshape(-1, 8)
    cells = cells[FilledBody(mesh=BODIES[name]()).distance(nodes[cells].mean(axis=1)) < 0]
    used, local = np.unique(cells, return_inverse=True)
    mesh = VolumeMesh(nodes=nodes[used], elements=local.reshape(-1, 8), kind="hex8")
    return mesh.promoted()


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
    if name in FACETED:
        record["errors"] = residuals(mesh, name, 1.03 * found[-1])
    every = json.loads(KEPT.read_text()) if KEPT.exists() else {}
    others = [each for each in every.get(name, []) if each["size"] != size]
    every[name] = sorted([*others, record], key=lambda each: -each["size"])
    KEPT.write_text(json.dumps(every, indent=1) + "\n")
    print(name, size, len(mesh.nodes), record["seconds"], np.round(found[:6], 2))


def residuals(mesh: VolumeMesh, name: str, highest: float) -> list[float]:
    """Return how far each frequency on these elements is too high, by the residual of its mode."""
    # Frequencies are CalculiX's to six digits, as the elements are the same.
    model = struck.analyze(mesh, MATERIALS[name], band=(20, highest), cache=False)
    return np.round(model.errors[:COUNT] / SINGLE_MESH_FACTOR, 6).tolist()


def compare(name: str, accuracy: str) -> str:
    """Return a row: how far the modes are off, how many are bounded, at what cost."""
    kept = json.loads(KEPT.read_text())[name]
    truth = np.array(kept[-1]["frequencies"])
    coarse = np.array(kept[-2]["frequencies"]) if len(kept) > 1 else truth
    own = np.array(kept[-1].get("errors", np.abs(coarse / truth - 1)))
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

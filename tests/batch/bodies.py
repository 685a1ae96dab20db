"""Mesh files for batches: sound ones, dirty ones, and some that no reader should survive."""

from __future__ import annotations

import gzip
import zipfile
from pathlib import Path

import meshio
import numpy as np
import trimesh
from numpy.random import Generator

from struck.solids import Block

QUICK = {"accuracy": "preview"}
PAPER = {"method": "obrien2002"}  # linear elements, which cost less than others
TABLE = "table.csv"


def box(*sizes: float) -> trimesh.Trimesh:
    """Return a box of some edges, m."""
    return trimesh.creation.box(extents=sizes)


def bar(path: Path, *sizes: float, count: int = 6) -> None:
    """Write a bar as a few large elements, whose modes take a tenth of a second."""
    made = Block(size=sizes, elements=(count, 1, 1)).volume_mesh()
    meshio.Mesh(made.nodes, [("hexahedron20", made.elements)]).write(path)


def eight(folder: Path) -> Path:
    """Write eight files: bars and a copy, a dirty box, a die, two bodies in one, a broken one."""
    (folder / "below").mkdir(parents=True)
    bar(folder / "bar.vtu", 0.08, 0.01, 0.01)
    bar(folder / "below/thin.vtu", 0.09, 0.012, 0.006)
    bar(folder / "long.vtu", 0.1, 0.012, 0.008)
    (folder / "copy.vtu").write_bytes((folder / "bar.vtu").read_bytes())
    bar(folder / "die.vtu", 0.01, 0.01, 0.01, count=1)
    dirty = box(0.085, 0.035, 0.011)
    dirty.update_faces(np.arange(len(dirty.faces)) > 0)
    dirty.faces[2] = dirty.faces[2][::-1]
    dirty.export(folder / "dirty.off")
    pair = [box(0.07, 0.02, 0.01), box(0.07, 0.025, 0.01).apply_translation((0, 0.1, 0))]
    trimesh.util.concatenate(pair).export(folder / "pair.off")
    (folder / "broken.obj").write_text("v 0 0\nnonsense\n")
    rows = (f"{name},{PAPER['method']}\n" for name in ("dirty.off", "pair.off"))
    (folder / TABLE).write_text("file,method\n" + "".join(rows))
    return folder


def many(folder: Path, chance: Generator) -> Path:
    """Write 150 files: sound and dirty bodies of five kinds, fifteen broken ones, three bombs."""
    folder.mkdir()
    for number in range(132):
        _body(number, chance).export(
            folder / f"body_{number:03d}.{('obj', 'stl', 'ply')[number % 3]}"
        )
    whole = (folder / "body_001.stl").read_bytes()
    for number in range(15):
        data = (b"", b"v 1 2\nf 9 9 9\n", whole[:97], chance.bytes(500), whole[:80] + b"\xff" * 4)
        (folder / f"broken_{number:02d}.{('obj', 'stl')[number % 2]}").write_bytes(data[number % 5])
    with gzip.open(folder / "bomb_1.obj.gz", "wb", compresslevel=1) as file:
        for _ in range(300):
            file.write(bytes(2**20))
    with zipfile.ZipFile(
        folder / "bomb_2.obj.zip", "w", zipfile.ZIP_DEFLATED, compresslevel=1
    ) as file:
        file.writestr("a.obj", b"v 0 0 0\n" * 40_000_000)
    head = "ply\nformat ascii 1.0\nelement vertex 999999999999\nproperty float x\nend_header\n"
    (folder / "bomb_3.ply").write_text(head)
    return folder


def _body(number: int, chance: Generator) -> trimesh.Trimesh:
    """Return a body of one of five kinds and random size, one in three with something wrong."""
    size = 0.012 * (1 + chance.random(3)) * np.array([6, 3, 1])
    kinds = (
        lambda: box(*size),
        lambda: trimesh.creation.cylinder(radius=size[2] / 2, height=size[0], sections=10),
        lambda: trimesh.creation.cone(radius=size[1] / 2, height=size[0], sections=12),
        lambda: trimesh.creation.icosphere(subdivisions=2, radius=size[1]),
        lambda: trimesh.creation.annulus(
            r_min=size[1] / 2, r_max=size[1], height=size[2], sections=12
        ),
    )
    mesh = kinds[number % 5]()
    if number % 3 == 1:  # a hole, a face turned over, and one that is there twice
        faces = mesh.faces[1:].copy()
        faces[0] = faces[0][::-1]
        mesh = trimesh.Trimesh(mesh.vertices, np.vstack([faces, faces[5:6]]), process=False)
    return mesh

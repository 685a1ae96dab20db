"""Two hundred files as programs write them, each with what must become of it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Mapping
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from struck.errors import StruckError
from struck.files.meshes import load_body
from tests.files.test_gltf import document, of_indices, of_points
from tests.files.test_surfaces import saved
from tests.physics.bodies import box
from tests.physics.test_thin_bodies import between, turned

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Rng = np.random.Generator


class Wanted(NamedTuple):
    """A file, how it is loaded, and what is expected: a volume, m^3, and words that are said."""

    path: Path
    volume: float | None = None  # None: refused
    says: str = ""
    options: Mapping[str, Any] = MappingProxyType({})


def prism(rng: Rng) -> tuple[Array, Index, float]:
    """Return an upright prism: points, faces and volume."""
    sides, radius, height = int(rng.integers(3, 24)), rng.uniform(0.01, 0.1), rng.uniform(0.01, 0.3)
    turn = 2 * np.pi * np.arange(sides) / sides
    ring = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = np.vstack([np.c_[ring, np.zeros(sides)], np.c_[ring, np.full(sides, height)]])
    here = np.arange(sides)
    on = (here + 1) % sides
    top = [[sides, sides + k, sides + k + 1] for k in range(1, sides - 1)]
    bottom = [[0, k + 1, k] for k in range(1, sides - 1)]
    first = np.stack([here, on, here + sides], axis=1)
    second = np.stack([on, on + sides, here + sides], axis=1)
    area = sides / 2 * radius**2 * np.sin(2 * np.pi / sides)
    return points, np.vstack([bottom, top, first, second]), area * height


def of_several_materials(rng: Rng, path: Path) -> Wanted:
    """One object of glTF whose faces are shared among primitives, each with points of its own."""
    points, faces, volume = prism(rng)
    data, accessors, primitives = [], [], []
    for share in np.array_split(rng.permutation(faces), int(rng.integers(2, 5))):
        used, local = np.unique(share, return_inverse=True)
        dtype, kind = [("u1", 5121), ("u2", 5123), ("u4", 5125)][rng.integers(3)]
        data += [points[used].astype("f4").tobytes(), local.astype(dtype).tobytes()]
        data[-1] += bytes(-len(data[-1]) % 4)
        view = len(accessors)
        accessors += [of_points(len(used), view), of_indices(local.size, view + 1, kind)]
        primitives.append({"attributes": {"POSITION": view}, "indices": view + 1})
    return Wanted(document(path / "a.gltf", data, accessors, *primitives), volume)


def of_strips(rng: Rng, path: Path) -> Wanted:
    """A prism of glTF: a strip around it and a fan on each end, at times a line beside."""
    points, _, volume = prism(rng)
    sides = len(points) // 2
    around = np.stack([np.arange(sides) + sides, np.arange(sides)], axis=1).ravel()
    lists = [(5, [*around, *around[:2]]), (6, range(sides, 2 * sides)), (6, range(sides)[::-1])]
    beside = rng.random() < 0.5
    lists += [(int(rng.integers(1, 4)), [0, 1, 2])] if beside else []
    data, accessors = [points.astype("f4").tobytes()], [of_points(len(points))]
    primitives = []
    for number, (mode, row) in enumerate(lists, 1):
        data.append(np.array(row, "<u4").tobytes())
        accessors.append(of_indices(len(row), number, 5125))
        primitives.append({"attributes": {"POSITION": 0}, "indices": number, "mode": mode})
    path = document(path / "a.gltf", data, accessors, *primitives)
    return Wanted(path, volume, "beside its faces" if beside else "")


def of_text(rng: Rng, path: Path) -> Wanted:
    """A prism as OFF over several lines, OBJ with groups, PLY of strips, or STL."""
    points, faces, volume = prism(rng)
    kind = rng.choice(["off", "obj", "ply", "stl"])
    rows = [" ".join(f"{x:.9g}" for x in point) for point in points]
    if kind == "off":
        gap = ["\n", " ", "\n\n"][rng.integers(3)]
        rows += [gap.join(map(str, (3, *face))) for face in faces.tolist()]
        text = "\n".join(["OFF", f"{len(points)} {len(faces)} 0", *rows])
    elif kind == "obj":
        cut = int(rng.integers(1, len(faces)))
        lines = ["f " + " ".join(f"{v + 1}//1" for v in face) for face in faces.tolist()]
        parts = ["vn 0 0 1", "usemtl clay", *lines[:cut], "s 1", "usemtl glaze", *lines[cut:]]
        text = "\n".join([*(f"v {row}" for row in rows), *parts])
    elif kind == "ply":
        row = [v for face in faces.tolist() for v in (*face, -1)]
        head = ["ply", "format ascii 1.0", f"element vertex {len(points)}"]
        head += [f"property float {axis}" for axis in "xyz"] + ["element tristrips 1"]
        head += ["property list int int vertex_indices", "end_header"]
        text = "\n".join([*head, *rows, f"{len(row)} " + " ".join(map(str, row)), ""])
    else:
        body = trimesh.Trimesh(points, faces, process=False)
        return Wanted(saved(path / "a.stl", trimesh.exchange.stl.export_stl(body)), volume)
    return Wanted(saved(path / f"a.{kind}", text), volume)


def of_bodies(rng: Rng, path: Path) -> Wanted:
    """Several bodies that stand apart: the largest, or that named."""
    volumes, lines, first = [], [], 1
    for number in range(int(rng.integers(2, 6))):
        points, faces, volume = prism(rng)
        lines.append(f"o part{number}")
        lines += [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in points + np.array([number, 0, 0])]
        lines += [f"f {a + first} {b + first} {c + first}" for a, b, c in faces.tolist()]
        first += len(points)
        volumes.append(volume)
    path = saved(path / "a.obj", "\n".join(lines))
    if rng.random() < 0.5:
        return Wanted(path, max(volumes), "left out: part= gives another")
    chosen = int(rng.integers(len(volumes)))
    return Wanted(path, volumes[chosen], "", {"part": f"part{chosen}"})


def of_both_faces(rng: Rng, path: Path) -> Wanted:
    """Thin things by both faces: tubes, plates, hollow boxes."""
    kind, wall = rng.integers(3), rng.uniform(0.0005, 0.004)
    if kind == 0:
        radius, length, sides = rng.uniform(0.01, 0.1), rng.uniform(0.02, 0.5), 48
        bore = radius - wall
        mesh = turned([(bore, 0), (radius, 0), (radius, length), (bore, length)], sides)
        area = sides / 2 * np.sin(2 * np.pi / sides) * (radius**2 - bore**2)
        volume = area * length
    elif kind == 1:
        size = rng.uniform(0.05, 0.5, 2)
        mesh, volume = box(*size, wall), float(np.prod(size) * wall)
    else:
        size = rng.uniform(0.05, 0.5, 3)
        mesh = between(box(*size), box(*(size - 2 * wall)))
        volume = float(np.prod(size) - np.prod(size - 2 * wall))
    body = trimesh.Trimesh(mesh.points, mesh.faces, process=False)
    suffix = str(rng.choice(["obj", "ply", "stl", "glb", "off"]))
    body.export(path / f"a.{suffix}")
    return Wanted(path / f"a.{suffix}", volume)


def of_nested_shells(rng: Rng, path: Path) -> Wanted:
    """A shell within a shell: a cavity where it points inward, else told and removed."""
    size = rng.uniform(0.1, 0.5, 3)
    inner = size * rng.uniform(0.2, 0.9)
    inward = rng.random() < 0.5
    mesh = between(box(*size), box(*inner))
    faces = np.vstack([mesh.faces[:12], mesh.faces[12:][:, :: 1 if inward else -1]])
    trimesh.Trimesh(mesh.points, faces, process=False).export(path / "a.obj")
    whole, hole = float(np.prod(size)), float(np.prod(inner))
    if inward:
        return Wanted(path / "a.obj", whole - hole)
    return Wanted(path / "a.obj", whole, f"they would leave {whole - hole:.3g}".replace("+", r"\+"))


def of_sheets(rng: Rng, path: Path) -> Wanted:
    """A sheet with a square or a ragged hole, and a wall; the hole as is, kept or filled."""
    count, edge, wall = 20, rng.uniform(0.2, 1.0), rng.uniform(0.0005, 0.003)
    row, column = np.divmod(np.arange(count**2), count)
    gone = (np.abs(row - 9.5) < 3) & (np.abs(column - 9.5) < 3)
    ragged = rng.random() < 0.5
    if ragged:
        gone[np.flatnonzero(gone)[rng.permutation(36)[:12]]] = False
        gone |= (row == 5) & (column == 8)
    start = row * (count + 1) + column
    a, b, c, d = start, start + count + 1, start + count + 2, start + 1
    squares = np.stack([a, b, c, a, c, d], axis=1)[~gone].reshape(-1, 3)
    grid = np.linspace(0, edge, count + 1)
    points = np.stack(np.meshgrid(grid, grid, [0.0], indexing="ij"), axis=-1).reshape(-1, 3)
    trimesh.Trimesh(points, squares, process=False).export(path / "a.obj")
    holes = [None, "keep", "fill"][rng.integers(3)]
    whole, cut = edge**2 * wall, (edge / count) ** 2 * wall * gone.sum()
    volume = whole if holes == "fill" else whole - cut
    return Wanted(path / "a.obj", volume, "", {"wall": wall, "holes": holes})


def of_refused(rng: Rng, path: Path) -> Wanted:
    """Files without a body, each with the words that say why."""
    points, faces, _ = prism(rng)
    kind = rng.integers(5)
    if kind == 0:
        path = saved(path / "a.gltf", json.dumps({"asset": {"version": "1.0"}, "meshes": {}}))
        return Wanted(path, None, r"glTF 1\.0")
    if kind == 1:
        trimesh.Trimesh(points, faces[: len(faces) // 3], process=False).export(path / "a.obj")
        return Wanted(path / "a.obj", None, "wall=")
    if kind == 2:
        trimesh.Trimesh(points * [1, 1, 0], faces, process=False).export(path / "a.obj")
        return Wanted(path / "a.obj", None, "flat|back to back|thickness")
    if kind == 3:
        return Wanted(saved(path / "a.obj", "v 0 0 0\nv 1 0 0\nl 1 2\n"), None, "no triangles")
    text = "OFF\n4 9 0\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n"
    return Wanted(saved(path / "a.off", text), None, "announces 9 faces and only 1")


FAMILIES: dict[Callable[[Rng, Path], Wanted], int] = {
    of_several_materials: 40,
    of_strips: 35,
    of_text: 40,
    of_bodies: 25,
    of_both_faces: 20,
    of_nested_shells: 15,
    of_sheets: 15,
    of_refused: 10,
}
SAMPLED = 2  # of each family in every test


def made(family: Callable[[Rng, Path], Wanted], folder: Path) -> Iterator[Wanted]:
    for number in range(FAMILIES[family]):
        own = folder / str(number)
        own.mkdir()
        yield family(np.random.default_rng([number, FAMILIES[family]]), own)


def check(wanted: Wanted) -> None:
    volume, said = outcome(wanted)
    assert (volume is None) == (wanted.volume is None), (wanted, said)
    assert volume == (wanted.volume and pytest.approx(wanted.volume, rel=0.03)), (wanted, said)
    assert re.search(wanted.says, said), (wanted, said)
    assert wanted.says or wanted.options.get("wall") or not said, (wanted, said)
    assert "Error" not in said, (wanted, said)


def outcome(wanted: Wanted) -> tuple[float | None, str]:
    """Return the volume of the body that is loaded, m^3, and what is said of it."""
    try:
        found = load_body(wanted.path, **wanted.options)
    except StruckError as error:
        return None, str(error)
    return found.volume_after, " ".join([*found.faults, *found.changes])


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.__name__)
def test_a_few_of_each(family: Callable[[Rng, Path], Wanted], tmp_path: Path) -> None:
    for wanted in islice(made(family, tmp_path), SAMPLED):
        check(wanted)


@pytest.mark.prove
@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.__name__)
def test_all_two_hundred(family: Callable[[Rng, Path], Wanted], tmp_path: Path) -> None:
    assert sum(FAMILIES.values()) == 200
    for wanted in made(family, tmp_path):
        check(wanted)

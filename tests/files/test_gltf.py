"""glTF: what the format allows, written by hand or by trimesh, read back against closed forms."""

from __future__ import annotations

import base64
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from struck.files.guard import read_contents
from struck.files.meshes import load_body, load_mesh
from struck.scene import load_animation
from tests.files.test_surfaces import refused, saved, wedge, written

# Khronos Group, glTF-Sample-Assets, SimpleSparseAccessor (M. Hutter, CC0): a strip of six squares,
# three of whose vertices are moved. Corners of what it shows: (0, 0, 0) and (6, 4, 0).
SPARSE_SAMPLE = (
    "AAAIAAcAAAABAAgAAQAJAAgAAQACAAkAAgAKAAkAAgADAAoAAwALAAoAAwAEAAsABAAMAAsABAAFAAwABQANAAwABQAGAA0A"
    "AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAQAAAAAAAAAAAAABAQAAAAAAAAAAAAACAQAAAAAAAAAAAAACgQAAAAAAAAAAA"
    "AADAQAAAAAAAAAAAAAAAAAAAgD8AAAAAAACAPwAAgD8AAAAAAAAAQAAAgD8AAAAAAABAQAAAgD8AAAAAAACAQAAAgD8AAAAA"
    "AACgQAAAgD8AAAAAAADAQAAAgD8AAAAACAAKAAwAAAAAAIA/AAAAQAAAAAAAAEBAAABAQAAAAAAAAKBAAACAQAAAAAA="
)


def document(
    path: Path, data: list[bytes], accessors: list[dict[str, Any]], *primitives: dict[str, Any]
) -> Path:
    """Write a glTF file of one node and mesh, with a buffer view for each of `data`."""
    starts = np.cumsum([0, *(len(each) for each in data)])
    views = [
        {"buffer": 0, "byteOffset": int(start), "byteLength": len(each)}
        for start, each in zip(starts, data, strict=False)
    ]
    whole = b"".join(data)
    address = f"data:application/octet-stream;base64,{base64.b64encode(whole).decode()}"
    header = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": address, "byteLength": len(whole)}],
        "bufferViews": views,
        "accessors": accessors,
        "meshes": [{"primitives": list(primitives)}],
        "nodes": [{"mesh": 0, "name": "body"}],
        "scenes": [{"nodes": [0]}],
    }
    return saved(path, json.dumps(header))


def of_points(count: int, view: int = 0, kind: int = 5126, **more: object) -> dict[str, Any]:
    return {"bufferView": view, "componentType": kind, "count": count, "type": "VEC3", **more}


def of_indices(count: int, view: int = 1, kind: int = 5123) -> dict[str, Any]:
    return {"bufferView": view, "componentType": kind, "count": count, "type": "SCALAR"}


def test_a_sparse_sample_of_the_khronos_group(tmp_path: Path) -> None:
    data = base64.b64decode(SPARSE_SAMPLE)
    parts = [data[:72], data[72:240], data[240:248], data[248:284]]
    indices = {"bufferView": 2, "componentType": 5123}
    sparse = {"count": 3, "indices": indices, "values": {"bufferView": 3}}
    accessors = [of_indices(36, view=0), of_points(14, view=1, sparse=sparse)]
    path = document(
        tmp_path / "a.gltf", parts, accessors, {"attributes": {"POSITION": 1}, "indices": 0}
    )
    (found,) = read_contents(path).parts
    np.testing.assert_array_equal(found.points.max(axis=0), [6, 4, 0])
    np.testing.assert_array_equal(found.points[[8, 10, 12]], [[1, 2, 0], [3, 3, 0], [5, 4, 0]])
    assert len(found.faces) == 12


def test_an_accessor_of_zeros_with_some_replaced(tmp_path: Path) -> None:
    """Without a buffer view all vertices are at the origin, but for those named."""
    points, faces = wedge().vertices.astype("<f4"), wedge().faces.astype("<u2")
    places = np.arange(1, 6, dtype="<u1")
    sparse = {
        "count": 5,
        "indices": {"bufferView": 2, "componentType": 5121},
        "values": {"bufferView": 0},
    }
    positions = of_points(6, sparse=sparse)
    del positions["bufferView"]
    path = document(
        tmp_path / "a.gltf",
        [points[1:].tobytes(), faces.tobytes(), places.tobytes()],
        [positions, of_indices(24)],
        {"attributes": {"POSITION": 0}, "indices": 1},
    )
    assert load_mesh(path).volume == pytest.approx(3, rel=1e-6)


@pytest.mark.parametrize(("kind", "code", "most"), [("<i2", 5122, 32767), ("<u1", 5121, 255)])
@pytest.mark.parametrize("normalised", [False, True])
def test_quantised_vertices(
    tmp_path: Path, kind: str, code: int, most: int, *, normalised: bool
) -> None:
    """Whole numbers as they are, or as shares of the largest, in rows of eight bytes."""
    points = np.zeros((6, 4), dtype=kind)
    points[:, :3] = wedge().vertices * (most // 3)
    positions = of_points(6, kind=code, normalized=normalised)
    path = document(
        tmp_path / "a.gltf",
        [points.tobytes(), wedge().faces.astype("<u4").tobytes()],
        [positions, of_indices(24, kind=5125)],
        {"attributes": {"POSITION": 0}, "indices": 1},
    )
    header = json.loads(path.read_text())
    header["bufferViews"][0]["byteStride"] = points.strides[0]
    header["extensionsRequired"] = header["extensionsUsed"] = ["KHR_mesh_quantization"]
    path.write_text(json.dumps(header))
    edge = most // 3 / (most if normalised else 1)
    assert load_mesh(path).volume == pytest.approx(3 * edge**3, rel=1e-9)


def test_strips_fans_and_triangles_without_indices_are_one_body(tmp_path: Path) -> None:
    """A box, of which a strip makes the four sides, a fan the top and a list the bottom."""
    corners = np.array([(x, y, z) for z in (0, 5) for x, y in ((0, 0), (2, 0), (2, 3), (0, 3))])
    sides = np.array([4, 0, 5, 1, 6, 2, 7, 3, 4, 0], dtype="<u1")
    top = np.array([4, 5, 6, 7], dtype="<u1")
    bottom = corners[[0, 2, 1, 0, 3, 2]].astype("<f4")
    path = document(
        tmp_path / "a.gltf",
        [corners.astype("<f4").tobytes(), sides.tobytes(), top.tobytes(), bottom.tobytes()],
        [
            of_points(8),
            of_indices(10, kind=5121),
            of_indices(4, view=2, kind=5121),
            of_points(6, view=3),
        ],
        {"attributes": {"POSITION": 0}, "indices": 1, "mode": 5},
        {"attributes": {"POSITION": 0}, "indices": 2, "mode": 6},
        {"attributes": {"POSITION": 3}},
        {"attributes": {"POSITION": 0}, "mode": 0},
        {"attributes": {"POSITION": 0}, "indices": 2, "mode": 2},
    )
    found = load_body(path)
    assert found.mesh.volume == pytest.approx(30)
    assert found.faults == ("The file holds 1 set of points, 1 line loop beside its faces.",)
    assert "as faces alone bound a body" in found.changes[0]


def test_nodes_of_one_name_are_told_apart(tmp_path: Path) -> None:
    path = written(wedge(), tmp_path / "a.gltf")
    header = json.loads(path.read_text())
    shifted = {"mesh": 0, "name": "mug", "translation": [9, 0, 0], "scale": [2, 1, 1]}
    header["nodes"] = [{"mesh": 0, "name": "mug"}, {"children": [2]}, shifted]
    header["scenes"] = [{"nodes": [0, 1]}]
    path.write_text(json.dumps(header))
    assert load_mesh(path, part="mug").volume == pytest.approx(3, rel=1e-6)
    second = load_mesh(path, part="mug (node 2)")
    assert second.volume == pytest.approx(6, rel=1e-6)
    assert second.bounds[0, 0] == pytest.approx(9)


def test_gltf_nodes_carry_their_transforms(tmp_path: Path) -> None:
    turned = trimesh.transformations.rotation_matrix(np.pi / 2, [0, 0, 1], [1, 1, 1])
    stretched = np.diag([2.0, 1.0, 1.0, 1.0])
    mirrored = np.diag([-1.0, 1.0, 1.0, 1.0])
    mirrored[0, 3] = -10
    both = trimesh.Scene()
    both.add_geometry(wedge(), node_name="turned", geom_name="w", transform=turned @ stretched)
    both.add_geometry(wedge(), node_name="mirrored", geom_name="v", transform=mirrored)
    path = written(both, tmp_path / "a.glb")
    body = load_mesh(path, part="turned")
    assert body.volume == pytest.approx(6, rel=1e-6)
    np.testing.assert_allclose(body.bounds, [[0, 0, 0], [2, 6, 1]], atol=1e-6)
    assert load_mesh(path, part="mirrored").volume == pytest.approx(3, rel=1e-6)


def gltf_with(change: Callable[[dict], None], path: Path) -> Path:
    header = json.loads(wedge().export(file_type="gltf", embed_buffers=True)["model.gltf"])
    change(header)
    return saved(path, json.dumps(header))


def as_one_object(header: dict) -> None:
    """Make the surfaces of a glTF header one object of two materials, a line along it beside."""
    first, second = (mesh["primitives"][0] for mesh in header["meshes"])
    line = {"attributes": dict(first["attributes"]), "mode": 3, "material": 0}
    primitives = [{**first, "material": 0}, line, {**second, "material": 1}]
    header["meshes"] = [{"name": "mug", "primitives": primitives}]
    header["nodes"], header["scenes"] = [{"mesh": 0, "name": "mug"}], [{"nodes": [0]}]
    painted = {"baseColorTexture": {"index": 0}}
    header["materials"] = [{"name": "clay"}, {"name": "glaze", "pbrMetallicRoughness": painted}]
    header["textures"], header["images"] = [{"source": 0}], [{"uri": "not_there.png"}]


def edited(data: bytes, change: Callable[[dict], None]) -> bytes:
    """Return a GLB file with another header."""
    end = 20 + int.from_bytes(data[12:16], "little")
    header = json.loads(data[20:end])
    change(header)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 4)
    lengths = [len(each).to_bytes(4, "little") for each in (data[end:] + text + bytes(20), text)]
    return b"".join([data[:8], *lengths, data[16:20], text, data[end:]])


@pytest.mark.parametrize("kind", ["glb", "gltf"])
def test_gltf_of_two_materials_is_one_body(tmp_path: Path, kind: str) -> None:
    halves = trimesh.Scene()
    for faces in (wedge().faces[:3], wedge().faces[3:]):
        half = trimesh.Trimesh(wedge().vertices, faces, process=False)
        half.visual.vertex_colors = np.full((6, 4), 255, np.uint8)
        halves.add_geometry(half)
    path = written(halves, tmp_path / f"mug.{kind}")
    if kind == "gltf":
        header = json.loads(path.read_text())
        as_one_object(header)
        path.write_text(json.dumps(header))
    else:
        path.write_bytes(edited(path.read_bytes(), as_one_object))
    assert load_mesh(path).volume == pytest.approx(3, rel=1e-6)
    assert load_mesh(path, part="mug").volume == pytest.approx(3, rel=1e-6)
    if kind == "glb":
        refused(saved(tmp_path / "cut.glb", path.read_bytes()[:-40]))


BEYOND: dict[str, tuple[Callable[[dict], None], str]] = {
    "packed": (
        lambda header: header.update(extensionsRequired=["KHR_draco_mesh_compression"]),
        "it uses KHR_draco_mesh_compression, not read here",
    ),
    "huge": (lambda header: header["accessors"][0].update(count=10**12), "cannot be read as GLTF"),
    "lost": (lambda header: header["buffers"][0].update(uri="no.bin"), "'no.bin', which it names"),
    "old": (lambda header: header.update(asset={"version": "1.0"}), "it is glTF 1.0, and 2.0 is"),
}


@pytest.mark.parametrize("case", BEYOND)
def test_gltf_beyond_what_is_read(tmp_path: Path, case: str) -> None:
    change, message = BEYOND[case]
    assert message in refused(gltf_with(change, tmp_path / "a.gltf"))


def test_a_glb_file_of_the_first_version_is_named(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.glb", b"glTF" + bytes([1, 0, 0, 0, 40, 0, 0, 0]) + bytes(28))
    assert "it is glTF 1.0, and 2.0 is read" in refused(path)


def test_gltf_with_a_buffer_beside_it(tmp_path: Path) -> None:
    for name, content in wedge().export(file_type="gltf").items():
        (tmp_path / name).write_bytes(content)
    assert load_mesh(tmp_path / "model.gltf").volume == pytest.approx(3, rel=1e-6)


def test_parts_move_with_the_nodes_they_hang_on(tmp_path: Path) -> None:
    # An arm slides along x while its hand, at its own times, slides along y; a ring hangs on the
    # hand at rest. The arm itself has no surface.
    triangle = np.eye(3, dtype="<f4")
    times = [np.array([0.0, 2.0], "<f4"), np.array([0.0, 1.0, 3.0], "<f4")]
    places = [
        np.array([[0, 0, 0], [2, 0, 0]], "<f4"),
        np.array([[0, 1, 0], [0, 5, 0], [0, 5, 0]], "<f4"),
    ]
    data = [array.tobytes() for array in (triangle, times[0], places[0], times[1], places[1])]
    scalars = [{"bufferView": n, "componentType": 5126, "type": "SCALAR"} for n in (1, 3)]
    accessors = [
        of_points(3),
        {**scalars[0], "count": 2},
        of_points(2, 2),
        {**scalars[1], "count": 3},
        of_points(3, 4),
    ]
    path = document(tmp_path / "a.gltf", data, accessors, {"attributes": {"POSITION": 0}})
    header = json.loads(path.read_text(encoding="utf-8"))
    header["nodes"] = [
        {"name": "arm", "children": [1]},
        {"name": "hand", "mesh": 0, "translation": [0, 1, 0], "children": [2]},
        {"name": "ring", "mesh": 0, "translation": [0, 0, 7]},
    ]
    channels = [{"sampler": n, "target": {"node": n, "path": "translation"}} for n in (0, 1)]
    samplers = [{"input": 1, "output": 2}, {"input": 3, "output": 4}]
    header["animations"] = [{"channels": channels, "samplers": samplers}]
    path.write_text(json.dumps(header), encoding="utf-8")
    log = load_animation(path)
    assert log.names == ("hand", "ring")
    for number in (0, 1):
        moments, shifts, _ = log.poses.of(number)
        np.testing.assert_allclose(moments, [0, 1, 2, 3])
        # From where it rests, seen from the world.
        np.testing.assert_allclose(shifts, [[0, 0, 0], [1, 4, 0], [2, 4, 0], [2, 4, 0]], atol=1e-9)

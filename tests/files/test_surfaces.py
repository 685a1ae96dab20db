"""Mesh files: written by trimesh or by hand, read back against closed forms."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from struck.errors import FileFormatError, MeshError, OptionError
from struck.files.meshes import list_parts, load_body, load_mesh, load_surface

FORMATS = ["obj", "stl", "ply", "off", "glb", "gltf"]


def wedge() -> trimesh.Trimesh:
    """Half of a box of 3 x 2 x 1: volume 3, no symmetry that could hide a swapped axis."""
    points = [(0, 0, 0), (3, 0, 0), (0, 2, 0), (0, 0, 1), (3, 0, 1), (0, 2, 1)]
    faces = [(0, 2, 1), (3, 4, 5), (0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4), (2, 0, 3), (2, 3, 5)]
    return trimesh.Trimesh(points, faces, process=False)


def box(*, at: tuple[float, ...] = (0, 0, 0), edge: float = 1.0) -> trimesh.Trimesh:
    body = trimesh.creation.box((edge, edge, edge))
    body.apply_translation(at)
    return body


def written(body: trimesh.Trimesh | trimesh.Scene, path: Path) -> Path:
    """Write with trimesh; glTF in one file, its buffers inside."""
    if path.suffix == ".gltf":
        path.write_bytes(body.export(file_type="gltf", embed_buffers=True)["model.gltf"])
    else:
        body.export(path)
    return path


def refused(path: Path, **options: object) -> str:
    """Return the one line that refuses a file and names it."""
    with pytest.raises((FileFormatError, MeshError)) as caught:
        load_mesh(path, repair=False, **options)  # type: ignore[arg-type]
    if caught.type is FileFormatError:
        with pytest.raises(FileFormatError):
            load_surface(path, **options)  # type: ignore[arg-type]
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    assert not re.search(r"\w(Error|Exception)\b", message)  # which tell a person nothing
    return message


@pytest.mark.parametrize("kind", FORMATS)
def test_every_format_gives_the_same_body(tmp_path: Path, kind: str) -> None:
    body = load_mesh(written(wedge(), tmp_path / f"wedge.{kind}"))
    assert body.volume == pytest.approx(3, rel=1e-6)
    np.testing.assert_allclose(body.bounds, [[0, 0, 0], [3, 2, 1]], atol=1e-6)
    assert (len(body.points), len(body.faces)) == (6, 8)
    assert body.up == ("y" if kind in {"obj", "glb", "gltf"} else "z")


def test_ascii_and_upper_case_stl(tmp_path: Path) -> None:
    path = tmp_path / "WEDGE.STL"
    path.write_text(trimesh.exchange.stl.export_stl_ascii(wedge()))
    assert load_mesh(path).volume == pytest.approx(3, rel=1e-12)


def test_ascii_ply(tmp_path: Path) -> None:
    path = tmp_path / "a.ply"
    path.write_bytes(trimesh.exchange.ply.export_ply(wedge(), encoding="ascii"))
    assert load_mesh(path).volume == pytest.approx(3, rel=1e-12)


@pytest.mark.parametrize(
    ("units", "metre"), [("m", 1), ("cm", 100), ("mm", 1000), ("in", 39.37007874), ("ft", 3.280840)]
)
def test_units_scale_to_metres(tmp_path: Path, units: str, metre: float) -> None:
    body = load_mesh(written(wedge(), tmp_path / "a.ply"), units=units)
    assert body.extent * metre == pytest.approx(3, rel=1e-6)


def test_size_is_the_longest_edge_of_the_box(tmp_path: Path) -> None:
    body = load_mesh(written(wedge(), tmp_path / "a.stl"), size=0.15)
    assert body.extent == pytest.approx(0.15, rel=1e-12)
    assert body.volume == pytest.approx(3 * 0.05**3, rel=1e-6)


def test_up_can_be_given(tmp_path: Path) -> None:
    assert load_mesh(written(wedge(), tmp_path / "a.stl"), up="x").up == "x"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"units": "mm", "size": 0.1}, "both set the scale: give one"),
        ({"units": "mile"}, "units is 'mile': give one of m, cm, mm, in, ft"),
        ({"size": 0.0}, "size is 0.0: give the longest edge"),
        ({"size": float("nan")}, "size is nan"),
        ({"up": "-z"}, "up is '-z': did you mean z. give one of x, y, z"),
    ],
)
def test_options_out_of_bounds(tmp_path: Path, options: dict[str, object], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        load_mesh(tmp_path / "a.stl", **options)  # type: ignore[arg-type]


def test_seams_of_texture_are_sewn(tmp_path: Path) -> None:
    """Each face of this box has corners of its own, as with normals or texture coordinates."""
    body = box()
    apart = trimesh.Trimesh(
        body.vertices[body.faces].reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False
    )
    loaded = load_mesh(written(apart, tmp_path / "a.glb"))
    assert len(loaded.points) == 8


def test_negative_zero_is_zero(tmp_path: Path) -> None:
    text = trimesh.exchange.stl.export_stl_ascii(wedge())
    lines = text.split("\n")
    lines = [line.replace(" 0.0", " -0.0") if i % 2 else line for i, line in enumerate(lines)]
    path = tmp_path / "a.stl"
    path.write_text("\n".join(lines))
    assert "-0.0" in path.read_text()
    assert len(load_mesh(path).points) == 6


CUBE = "\n".join(f"v {x} {y} {z}" for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
QUADS = "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n"


def saved(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def test_obj_polygons_comments_and_continued_lines(tmp_path: Path) -> None:
    text = f"# a cube\n{CUBE}\nvn 0 0 1\nusemtl none\n" + QUADS.replace("f 4 3", "f 4//1 \\\n 3")
    assert load_mesh(saved(tmp_path / "a.obj", text)).volume == pytest.approx(1)


def test_obj_hexagonal_prism_of_polygons(tmp_path: Path) -> None:
    turn = np.arange(6) * np.pi / 3
    ring = [f"v {np.cos(a)} {np.sin(a)} {z}" for z in (0, 1) for a in turn]
    sides = [f"f {i + 1} {(i + 1) % 6 + 1} {(i + 1) % 6 + 7} {i + 7}" for i in range(6)]
    text = "\n".join([*ring, *sides, "f 6 5 4 3 2 1", "f 7 8 9 10 11 12"])
    body = load_mesh(saved(tmp_path / "a.obj", text))
    assert body.volume == pytest.approx(1.5 * np.sqrt(3))


def test_obj_relative_indices_count_from_where_they_stand(tmp_path: Path) -> None:
    relative = "f -5 -6 -7 -8\nf -4 -3 -2 -1\nf -8 -7 -3 -4\nf -7 -6 -2 -3\nf -6 -5 -1 -2\n"
    text = f"o a\n{CUBE}\n{relative}f -5 -8 -4 -1\no b\n{CUBE.replace('v ', 'v 3')}\n{relative}"
    body = load_mesh(saved(tmp_path / "a.obj", f"{text}f -5 -8 -4 -1\n"), part="a")
    np.testing.assert_array_equal(body.bounds, [[0, 0, 0], [1, 1, 1]])


def test_off_polygons(tmp_path: Path) -> None:
    points = CUBE.replace("v ", "")
    faces = [[int(n) - 1 for n in line.split()[1:]] for line in QUADS.strip().split("\n")]
    rows = "\n".join(f"4 {a} {b} {c} {d}" for a, b, c, d in faces)
    body = load_mesh(saved(tmp_path / "a.off", f"OFF # cube\n8 6 12\n{points}\n{rows}\n"))
    assert body.volume == pytest.approx(1)


# Several bodies in one file


def scene(**bodies: trimesh.Trimesh) -> trimesh.Scene:
    found = trimesh.Scene()
    for name, body in bodies.items():
        found.add_geometry(body, node_name=name, geom_name=name)
    return found


@pytest.mark.parametrize("kind", ["obj", "glb", "gltf"])
def test_parts_by_name(tmp_path: Path, kind: str) -> None:
    path = written(scene(bell=box(edge=2), clapper=box(at=(5, 0, 0))), tmp_path / f"a.{kind}")
    message = refused(path)
    assert "it holds 2 bodies: choose one with part=, of 'bell', 'clapper'" in message
    assert load_mesh(path, part="bell").volume == pytest.approx(8)
    assert load_mesh(path, part="clapper").bounds[0, 0] == pytest.approx(4.5)
    assert load_mesh(path, part="1").volume == pytest.approx(1)
    assert "no part 'rim': give one of 'bell', 'clapper'" in refused(path, part="rim")


def test_parts_are_listed_with_size_and_volume(tmp_path: Path) -> None:
    lid = wedge()
    lid.update_faces(np.arange(8) > 1)
    path = written(scene(bell=box(edge=2), lid=lid), tmp_path / "a.glb")
    bell, open_lid = list_parts(path, units="cm")[-2:]
    assert (bell.name, bell.faces, open_lid.name, open_lid.faces) == ("bell", 12, "lid", 6)
    np.testing.assert_allclose([*bell.size, *open_lid.size], [0.02] * 3 + [0.03, 0.02, 0.01])
    assert bell.volume == pytest.approx(8e-6)
    assert open_lid.volume is None


def test_bodies_without_names_are_listed_by_number(tmp_path: Path) -> None:
    both = trimesh.util.concatenate([box(edge=2), box(at=(5, 0, 0))])
    path = written(both, tmp_path / "a.stl")
    parts = list_parts(path)
    assert [part.name for part in parts] == ["0", "1"]
    assert [part.volume for part in parts] == pytest.approx([8, 1])
    for part in parts:
        assert load_mesh(path, part=part.name).volume == pytest.approx(part.volume)


def test_size_is_that_of_the_part(tmp_path: Path) -> None:
    path = written(scene(a=box(edge=2), b=box(at=(5, 0, 0))), tmp_path / "a.glb")
    assert load_mesh(path, part="b", size=0.3).extent == pytest.approx(0.3)


def test_disconnected_pieces_by_number(tmp_path: Path) -> None:
    row = trimesh.util.concatenate([box(at=(2 * i, 0, 0), edge=1 + i / 100) for i in range(15)])
    path = written(row, tmp_path / "a.stl")
    message = refused(path)
    assert "holds 15 bodies" in message
    assert message.endswith("'10', '11' ... and 3 more")
    assert load_mesh(path, part="14").extent == pytest.approx(1.14)
    assert "no part '15': give one of '0', '1'" in refused(path, part="15")


def test_obj_groups_that_are_patches_are_one_body(tmp_path: Path) -> None:
    faces = QUADS.strip().split("\n")
    text = "\n".join([CUBE, "g lid", faces[0], "g rest", *faces[1:]])
    path = saved(tmp_path / "a.obj", text)
    assert load_mesh(path).volume == pytest.approx(1)
    assert "the mesh is flat" in refused(path, part="lid")


def test_obj_groups_that_are_bodies(tmp_path: Path) -> None:
    second = QUADS.translate({ord(str(n)): str(n + 8) for n in range(1, 9)})
    text = f"{CUBE}\ng left\n{QUADS}{CUBE.replace('v ', 'v 3')}\ng right\n{second}"
    path = saved(tmp_path / "a.obj", text)
    assert "of 'left', 'right'" in refused(path)
    assert load_mesh(path, part="right").bounds[1, 0] == pytest.approx(31)


def test_touching_named_parts_stay_two_bodies(tmp_path: Path) -> None:
    path = written(scene(a=box(), b=box(at=(1, 0, 0))), tmp_path / "a.glb")
    assert "holds 2 bodies" in refused(path)
    assert load_mesh(path, part="b").volume == pytest.approx(1)


@pytest.mark.parametrize("kind", ["stl", "glb"])
def test_cavity_is_part_of_its_body(tmp_path: Path, kind: str) -> None:
    inner = box(edge=0.5)
    inner.invert()
    bodies = scene(outer=box(), inner=inner)
    path = written(bodies, tmp_path / f"a.{kind}")
    assert load_mesh(path).volume == pytest.approx(1 - 0.125)


def test_solids_of_an_ascii_stl(tmp_path: Path) -> None:
    def solid(name: str, body: trimesh.Trimesh) -> str:
        text = trimesh.exchange.stl.export_stl_ascii(body)
        lines = text.strip().split("\n")
        return "\n".join([f"solid {name}", *lines[1:-1], f"endsolid {name}\n"])

    both = solid("cup", wedge()) + solid("plate", box(at=(9, 0, 0)))
    path = saved(tmp_path / "a.stl", both)
    assert "of 'cup', 'plate'" in refused(path)
    assert load_mesh(path, part="cup").volume == pytest.approx(3)
    cut = saved(tmp_path / "cut.stl", both[:-40])
    assert "announces 20 faces and only 8 could be read" in refused(cut)


# Repair


def test_of_several_bodies_repair_takes_the_largest(tmp_path: Path) -> None:
    path = written(scene(bell=box(edge=2), clapper=box(at=(5, 0, 0))), tmp_path / "a.glb")
    assert load_surface(path).volume == pytest.approx(9)
    result = load_body(path)
    assert result.mesh.volume == pytest.approx(8)
    assert result.faults == ("2 separate bodies.",)
    assert "1 other, up to 12 % of its volume, left out: part= gives" in result.changes[0]
    assert load_body(path, part="clapper").faults == ()


def test_size_is_that_of_the_body_kept(tmp_path: Path) -> None:
    path = written(
        trimesh.util.concatenate([box(), box(at=(9, 0, 0), edge=0.1)]), tmp_path / "a.stl"
    )
    result = load_body(path, size=0.2)
    assert result.mesh.extent == pytest.approx(0.2, rel=1e-12)
    assert result.volume_after == pytest.approx(0.008)
    assert result.changes == ("1 crumb removed.",)


def test_parts_of_a_dirty_file_by_number(tmp_path: Path) -> None:
    """A hole in one body, the other in triangles that do not meet exactly."""
    ball = trimesh.creation.icosphere(3)
    ball.update_faces(np.arange(len(ball.faces)) != 7)
    other = trimesh.creation.icosphere(2, radius=2.0)
    other.apply_translation([9, 0, 0])
    corners = other.vertices[other.faces].reshape(-1, 3)
    corners += 1e-6 * np.random.default_rng(0).random(corners.shape)
    apart = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
    path = written(trimesh.util.concatenate([ball, apart]), tmp_path / "a.off")
    assert load_mesh(path, part="0").extent == pytest.approx(2, rel=1e-3)
    assert load_mesh(path, part="1").extent == pytest.approx(4, rel=1e-3)
    with pytest.raises(MeshError, match="no part '2': give one of '0', '1'"):
        load_mesh(path, part="2")


def test_hole_is_filled_or_refused(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(3)
    ball.update_faces(np.arange(len(ball.faces)) != 7)
    path = written(ball, tmp_path / "a.ply")
    assert load_mesh(path).volume == pytest.approx(trimesh.creation.icosphere(3).volume)
    assert "1 hole; close holes" in refused(path)
    assert "or leave repair on" in refused(path)


def test_sheet_asks_for_a_wall(tmp_path: Path) -> None:
    dome = trimesh.creation.icosphere(3)
    dome.update_faces(dome.triangles_center[:, 2] > 0)
    path = written(dome, tmp_path / "a.ply")
    with pytest.raises(MeshError, match=r"a\.ply: the mesh is an open sheet.*give wall="):
        load_body(path)
    assert load_body(path, wall=0.01).sheet


# Faces without area


def test_collapsed_faces_go(tmp_path: Path) -> None:
    text = f"{CUBE}\n{QUADS}f 1 2 2\nf 3 3 3\n"
    body = load_mesh(saved(tmp_path / "a.obj", text))
    assert len(body.faces) == 12


def test_isolated_line_of_three_vertices_goes(tmp_path: Path) -> None:
    text = f"{CUBE}\nv 2 0 0\nv 3 0 0\nv 4 0 0\n{QUADS}f 9 10 11\n"
    body = load_mesh(saved(tmp_path / "a.obj", text))
    assert (len(body.faces), len(body.points)) == (12, 8)


def test_line_that_holds_the_surface_together_is_refused(tmp_path: Path) -> None:
    """The middle of an edge joins one of its faces alone: a face without area fills the gap."""
    faces = [line.split()[1:] for line in QUADS.strip().split("\n")]
    triangles = [f"f {a} {b} {c}\nf {a} {c} {d}" for a, b, c, d in faces[1:]]
    split = "f 4 3 2\nf 4 2 9\nf 4 9 1\nf 9 2 1"
    text = "\n".join([CUBE, "v 0.5 0 0", split, *triangles])
    message = refused(saved(tmp_path / "a.obj", text))
    assert "1 of its 14 faces have no area and hold the surface together" in message


# Bad input


@pytest.mark.parametrize("kind", FORMATS)
def test_empty_file(tmp_path: Path, kind: str) -> None:
    assert "it is empty (0 bytes)" in refused(saved(tmp_path / f"a.{kind}", b""))


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("seed", range(3))
def test_binary_junk(tmp_path: Path, kind: str, seed: int) -> None:
    junk = np.random.default_rng(seed).bytes(5000)
    message = refused(saved(tmp_path / f"a.{kind}", junk))
    assert "read" in message or "binary data" in message


@pytest.mark.parametrize("kind", [*FORMATS, "ascii.stl", "ascii.ply"])
@pytest.mark.parametrize("share", [0.02, 0.3, 0.7, 0.9, 0.99])
def test_truncated_file(tmp_path: Path, kind: str, share: float) -> None:
    body = trimesh.creation.icosphere(subdivisions=2)
    path = tmp_path / f"a.{kind}"
    if kind == "ascii.stl":
        path.write_text(trimesh.exchange.stl.export_stl_ascii(body))
    elif kind == "ascii.ply":
        path.write_bytes(trimesh.exchange.ply.export_ply(body, encoding="ascii"))
    else:
        written(body, path)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    refused(path)


@pytest.mark.parametrize("kind", FORMATS)
@pytest.mark.parametrize("other", FORMATS)
def test_wrong_extension(tmp_path: Path, kind: str, other: str) -> None:
    path = written(wedge(), tmp_path / f"a.{kind}").rename(tmp_path / f"b.{other}")
    if kind == other:
        assert load_mesh(path).volume == pytest.approx(3, rel=1e-6)
    else:
        message = refused(path)
        if kind in {"ply", "off", "glb"}:
            assert f"its content is {kind.upper()} and not {other.upper()}: rename it" in message


def test_unknown_extension_names_the_known(tmp_path: Path) -> None:
    assert "it is a CAD file (STEP), which struck" in refused(saved(tmp_path / "a.step", b"x"))
    assert "use one of surfaces as obj, stl, ply" in refused(saved(tmp_path / "a.qqq", b"x"))
    assert "it has no extension: use one of" in refused(saved(tmp_path / "plain", b"x"))


def test_missing_file_and_folder(tmp_path: Path) -> None:
    (tmp_path / "missing.obj").touch()
    assert "no file of that name: did you mean missing.obj" in refused(tmp_path / "missing.stl")
    (tmp_path / "folder.obj").mkdir()
    assert "cannot be read (Is a" in refused(tmp_path / "folder.obj")


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e999"])
def test_numbers_that_are_not_finite(tmp_path: Path, value: str) -> None:
    obj = saved(tmp_path / "a.obj", f"{CUBE.replace('v 1 1 1', f'v 1 {value} 1')}\n{QUADS}")
    assert "1 of 8 vertices are not finite" in refused(obj)


@pytest.mark.parametrize("kind", ["stl", "ply", "glb"])
def test_nan_in_binary_files(tmp_path: Path, kind: str) -> None:
    path = written(wedge(), tmp_path / f"a.{kind}")
    three = struct.pack("<f", 3.0)
    path.write_bytes(path.read_bytes().replace(three, struct.pack("<f", float("nan"))))
    assert "not finite" in refused(path)


def ply(corners: str) -> str:
    body = trimesh.exchange.ply.export_ply(wedge(), encoding="ascii").decode()
    return body.replace("3 0 2 1", f"3 {corners}")


@pytest.mark.parametrize("corners", ["0 2 6", "0 2 -1", "0 2 999999999999", "0 2 4294967295"])
def test_index_out_of_range_in_ply(tmp_path: Path, corners: str) -> None:
    assert corners in ply(corners)
    refused(saved(tmp_path / "a.ply", ply(corners)))


@pytest.mark.parametrize(
    ("face", "message"),
    [
        ("f 1 2 9", "names vertex 9 of 8"),
        ("f 1 2 999999999999999999999999", "names vertex 999999999999999999999999 of 8"),
        ("f 1 2 0", "no vertex 0"),
        ("f 1 2 -9", "no vertex -9"),
        ("f 1 2", "a face needs 3 vertices and has 2"),
        ("f 1 2 x", "line 15"),
        ("v 1 2", "line 15"),
        ("v 1 2 y", "line 15"),
    ],
)
def test_bad_lines_in_obj(tmp_path: Path, face: str, message: str) -> None:
    assert message in refused(saved(tmp_path / "a.obj", f"{CUBE}\n{QUADS}{face}\n"))


@pytest.mark.parametrize("face", ["3 0 1 8", "3 0 1 -1", "3 0 1 99999999999999999999", "3 0 x 1"])
def test_index_out_of_range_in_off(tmp_path: Path, face: str) -> None:
    text = f"OFF\n8 1 0\n{CUBE.replace('v ', '')}\n{face}\n"
    message = refused(saved(tmp_path / "a.off", text))
    assert "cannot be read as OFF" in message or "faces name vertices" in message
    assert "damaged" in message


def test_words_among_numbers_of_an_ascii_stl(tmp_path: Path) -> None:
    text = trimesh.exchange.stl.export_stl_ascii(wedge()).replace("vertex 3.0", "vertex three", 1)
    assert "three" in text
    assert "cannot be read as STL" in refused(saved(tmp_path / "a.stl", text))


def test_huge_counts_in_headers_cost_nothing(tmp_path: Path) -> None:
    binary = trimesh.exchange.ply.export_ply(wedge())
    huge = binary.replace(b"element vertex 6", b"element vertex 99999999999999")
    assert "announces 99999999999999 vertices" in refused(saved(tmp_path / "a.ply", huge))
    facets = bytearray(trimesh.exchange.stl.export_stl(wedge()))
    facets[80:84] = b"\xff\xff\xff\xff"
    refused(saved(tmp_path / "a.stl", bytes(facets)))
    off = f"OFF\n8 99999999999 0\n{CUBE.replace('v ', '')}\n3 0 1 2\n"
    assert "announces 99999999999 vertices or faces" in refused(saved(tmp_path / "a.off", off))


@pytest.mark.parametrize("first", ["OFF\n8 6 12", "OFF 8 6 12", "# a cube\nCOFF\n8 6 0"])
def test_faces_over_several_lines_of_off_are_read(tmp_path: Path, first: str) -> None:
    faces = ["4 3 2", "1", "0", "4 4 5 6 7 255 0 0", "4 0 1 5 4", "4 1 2", "6 5", "4 2 3 7 6"]
    text = "\n".join([first, CUBE.replace("v ", ""), *faces, "4 3 0 4 7"])
    assert load_mesh(saved(tmp_path / "a.off", text)).volume == pytest.approx(1)
    cut = saved(tmp_path / "cut.off", text[:-2])
    assert "announces 6 faces and only 5 could be read" in refused(cut)


STRIPS = [[4, 0, 5, 1, 6, 2, 7, 3, 4, 0], [4, 5, 7, 6], [0, 3, 1, 2]]


@pytest.mark.parametrize("form", ["ascii", "binary_little_endian", "binary_big_endian"])
def test_strips_of_ply_are_read(tmp_path: Path, form: str) -> None:
    """A box of 1 x 2 x 3 in three strips, as scanners write them: one list, parted by -1."""
    corners = [(0, 0, 0), (1, 0, 0), (1, 2, 0), (0, 2, 0), (0, 0, 3), (1, 0, 3), (1, 2, 3)]
    points = np.array([*corners, (0, 2, 3)], dtype="f4")
    row = [index for strip in STRIPS for index in (*strip, -1)]
    lines = [
        "ply",
        f"format {form} 1.0",
        "element vertex 8",
        *(f"property float {c}" for c in "xyz"),
    ]
    lines += ["element tristrips 1", "property list int int vertex_indices", "end_header\n"]
    if form == "ascii":
        rows = [*points.tolist(), [len(row), *row]]
        body = "\n".join(" ".join(f"{word:g}" for word in each) for each in rows).encode() + b"\n"
    else:
        order = "<" if "little" in form else ">"
        body = points.astype(f"{order}f4").tobytes()
        body += np.array([len(row), *row], dtype=f"{order}i4").tobytes()
    path = saved(tmp_path / "a.ply", "\n".join(lines).encode() + body)
    assert load_mesh(path).volume == pytest.approx(6)


def test_lines_and_points_beside_faces_are_left_out_and_counted(tmp_path: Path) -> None:
    text = f"{CUBE}\n{QUADS}\nl 1 2 3\nl 4 5\np 1 2\n"
    found = load_body(saved(tmp_path / "a.obj", text))
    assert found.mesh.volume == pytest.approx(1)
    assert found.faults == ("The file holds 2 lines, 1 point beside its faces.",)
    assert found.changes == ("Left out: 2 lines, 1 point, as faces alone bound a body.",)


def test_point_cloud_has_no_triangles(tmp_path: Path) -> None:
    assert "no triangles" in refused(saved(tmp_path / "a.obj", CUBE))
    cloud = trimesh.points.PointCloud(wedge().vertices)
    cloud.export(tmp_path / "a.ply")
    assert "no triangles" in refused(tmp_path / "a.ply")


def test_plane_open_and_inside_out_name_the_file(tmp_path: Path) -> None:
    flat = saved(tmp_path / "flat.obj", f"{CUBE}\nf 1 2 3 4\n")
    assert "the mesh is flat" in refused(flat)
    opened = saved(tmp_path / "open.obj", f"{CUBE}\n{QUADS[10:]}")
    assert "4 open edges in 1 hole" in refused(opened)
    turned = wedge()
    turned.invert()
    assert "inside out" in refused(written(turned, tmp_path / "turned.stl"))
    point = "\n".join(["v 1 1 1"] * 8)
    message = refused(saved(tmp_path / "point.obj", f"{point}\n{QUADS}"))
    assert "its longest edge is 0" in message


@pytest.mark.parametrize(
    ("factor", "words"), [(1e-100, "its longest edge is 1e-100"), (1e100, "a vertex is 5e99")]
)
def test_sizes_beyond_arithmetic(tmp_path: Path, factor: float, words: str) -> None:
    lines = [f"v {factor * x} {factor * y} {factor * z}" for x, y, z in box().vertices]
    faces = [f"f {a} {b} {c}" for a, b, c in box().faces + 1]
    message = refused(saved(tmp_path / "a.obj", "\n".join(lines + faces)))
    assert words in message


def test_faces_of_one_or_two_vertices_alone(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.obj", f"{CUBE}\nf 1 2 2\nf 3 3 3\n")
    assert "all of its 2 faces are lines or points" in refused(path)


@pytest.mark.parametrize("count", [20, pytest.param(200, marks=pytest.mark.prove)])
@pytest.mark.parametrize("kind", FORMATS)
def test_damaged_files(tmp_path: Path, kind: str, count: int) -> None:
    """Whatever a flipped byte does, the answer is a closed surface or one of our errors.

    One in ten is repaired.
    """
    body = trimesh.creation.icosphere(subdivisions=1)
    content = written(body, tmp_path / f"a.{kind}").read_bytes()
    rng = np.random.default_rng(7)
    for place in rng.integers(len(content), size=count):
        damaged = bytearray(content)
        damaged[place] ^= rng.integers(1, 256)
        path = saved(tmp_path / f"b.{kind}", bytes(damaged))
        try:
            assert load_mesh(path, repair=place % 10 == 0).volume > 0
        except (FileFormatError, MeshError) as error:
            assert str(error).startswith(f"{path}: ")  # noqa: PT017

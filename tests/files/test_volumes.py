"""Volume meshes, and mode shapes for other programs: written and read back node by node."""

from __future__ import annotations

import contextlib
import io
import sys
from pathlib import Path

import meshio
import numpy as np
import pytest

import struck
from struck.cli import main
from struck.errors import MeshError, MissingDependencyError, OptionError
from struck.files.guard import Guard
from struck.files.mesh_formats import read_blocks
from struck.files.meshes import load_volume
from struck.files.messages import ReadingLimits
from struck.model.timbre_table import SinglePoint
from tests.live.hand import ball

KINDS = {
    "tetra": "tet4",
    "tetra10": "tet10",
    "hexahedron": "hex8",
    "hexahedron20": "hex20",
    "wedge": "wedge6",
    "wedge15": "wedge15",
}
FORMATS = {"vtk": "vtk", "vtu": "vtu", "msh": "gmsh", "inp": "abaqus"}
SIZE = np.array([3.0, 2.0, 1.0])

# Corners and, after them, the pairs whose midpoints follow: VTK's order, as Abaqus has it too.
CORNERS = {
    "tetra": [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)],
    "hexahedron": [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))],
    "wedge": [(x, y, z) for z in (0, 1) for x, y in ((0, 0), (1, 0), (0, 1))],
}
VTK_EDGES = {
    "tetra10": ["01", "12", "20", "03", "13", "23"],
    "hexahedron20": ["01", "12", "23", "30", "45", "56", "67", "74", "04", "15", "26", "37"],
    "wedge15": ["01", "12", "20", "34", "45", "53", "03", "14", "25"],
}
# From Gmsh's manual, "Node ordering".
GMSH_EDGES = {
    "tetra10": ["01", "12", "20", "03", "23", "13"],
    "hexahedron20": ["01", "03", "04", "12", "15", "23", "26", "37", "45", "47", "56", "67"],
    "wedge15": ["01", "02", "03", "12", "14", "25", "34", "35", "45"],
}
GMSH_NUMBERS = {"tetra10": 11, "hexahedron20": 17, "wedge15": 18}
ABAQUS_NAMES = {"tetra10": "C3D10", "hexahedron20": "C3D20R", "wedge15": "C3D15"}


def nodes(kind: str, edges: dict[str, list[str]] = VTK_EDGES) -> np.ndarray:
    corners = np.array(CORNERS[kind.rstrip("0125")], dtype=float)
    pairs = [[int(end) for end in pair] for pair in edges.get(kind, [])]
    return np.vstack([corners, *(corners[pair].mean(axis=0) for pair in pairs)]) * SIZE


def write(path: Path, *blocks: tuple[str, np.ndarray], points: np.ndarray) -> Path:
    meshio._mesh.topological_dimension.setdefault("wedge15", 3)
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        meshio.Mesh(points, list(blocks)).write(path, file_format=FORMATS[path.suffix[1:]])
    return path


def one(path: Path, kind: str) -> Path:
    return write(path, (kind, np.arange(len(nodes(kind)))[None]), points=nodes(kind))


def refused(path: Path) -> str:
    with pytest.raises(MeshError) as caught:
        load_volume(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert "\n" not in message
    return message


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("extension", FORMATS)
def test_every_kind_in_every_format(tmp_path: Path, kind: str, extension: str) -> None:
    mesh = load_volume(one(tmp_path / f"a.{extension}", kind))
    assert mesh.kind == KINDS[kind]
    np.testing.assert_array_equal(mesh.nodes[mesh.elements[0]], nodes(kind))


@pytest.mark.parametrize("kind", GMSH_EDGES)
def test_gmsh_order_of_the_manual(tmp_path: Path, kind: str) -> None:
    points = nodes(kind, GMSH_EDGES)
    lines = [f"{i + 1} {x} {y} {z}" for i, (x, y, z) in enumerate(points)]
    numbers = " ".join(str(i + 1) for i in range(len(points)))
    text = [
        *("$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(points)), *lines),
        *("$EndNodes", "$Elements", "1", f"1 {GMSH_NUMBERS[kind]} 2 0 1 {numbers}", "$EndElements"),
    ]
    path = tmp_path / "a.msh"
    path.write_text("\n".join([*text, ""]))
    mesh = load_volume(path)
    np.testing.assert_array_equal(mesh.nodes[mesh.elements[0]], nodes(kind))


@pytest.mark.parametrize("kind", ABAQUS_NAMES)
def test_abaqus_by_hand(tmp_path: Path, kind: str) -> None:
    """Numbers with gaps, a line of elements that goes on, and CalculiX's own cards around."""
    points = nodes(kind)
    rows = [f"{10 * i + 7}, {x}, {y}, {z}" for i, (x, y, z) in enumerate(points)]
    numbers = [str(10 * i + 7) for i in range(len(points))]
    text = [
        *("*HEADING", "** by hand", "*NODE, NSET=Nall", *rows),
        *(f"*ELEMENT, TYPE={ABAQUS_NAMES[kind]}, ELSET=Eall", "5, " + ", ".join(numbers[:8]) + ","),
        *(", ".join(numbers[8:]), "*NODE FILE", "U"),
    ]
    path = tmp_path / "a.inp"
    path.write_text("\n".join([*text, ""]))
    mesh = load_volume(path)
    np.testing.assert_array_equal(mesh.nodes[mesh.elements[0]], points)


def test_wedges_of_vtk_itself_stand_the_other_way(tmp_path: Path) -> None:
    """VTK's linear wedge has its first triangle's normal outward (VTK file formats, figure 2)."""
    points = nodes("wedge")[[0, 2, 1, 3, 5, 4]]
    rows = "\n".join(f"{x} {y} {z}" for x, y, z in points)
    path = tmp_path / "a.vtk"
    path.write_text(
        "# vtk DataFile Version 3.0\nby hand\nASCII\nDATASET UNSTRUCTURED_GRID\n"
        f"POINTS 6 double\n{rows}\nCELLS 1 7\n6 0 1 2 3 4 5\nCELL_TYPES 1\n13\n"
    )
    mesh = load_volume(path)
    np.testing.assert_array_equal(mesh.nodes[mesh.elements[0]], nodes("wedge"))


def test_units(tmp_path: Path) -> None:
    path = one(tmp_path / "a.vtu", "tetra")
    assert load_volume(path, units="mm").nodes.max() == pytest.approx(0.003)
    with pytest.raises(OptionError, match="units is 'km'"):
        load_volume(path, units="km")


def test_surfaces_and_spare_nodes_are_passed_over(tmp_path: Path) -> None:
    points = np.vstack([[[9.0, 9, 9]], nodes("tetra"), nodes("tetra") + 5])
    blocks = [
        ("triangle", np.array([[1, 2, 3]])),
        ("tetra", np.array([[1, 2, 3, 4]])),
        ("line", np.array([[0, 1]])),
        ("tetra", np.array([[5, 6, 7, 8]])),
    ]
    mesh = load_volume(write(tmp_path / "a.vtu", *blocks, points=points))
    assert (mesh.nodes.shape, mesh.elements.shape) == ((8, 3), (2, 4))
    np.testing.assert_array_equal(mesh.nodes[mesh.elements[1]], nodes("tetra") + 5)


def test_several_kinds_are_counted(tmp_path: Path) -> None:
    points = np.vstack([nodes("tetra"), nodes("wedge")])
    blocks = [
        ("tetra", np.array([[0, 1, 2, 3]])),
        ("wedge", np.arange(4, 10)[None]),
        ("triangle", np.array([[0, 1, 2], [0, 1, 3]])),
    ]
    message = refused(write(tmp_path / "a.vtu", *blocks, points=points))
    assert "1 tetra, 1 wedge, 2 triangle, and one kind of volume element is taken" in message


@pytest.mark.parametrize("kind", ["pyramid", "pyramid13", "hexahedron27"])
def test_other_kinds_are_named(tmp_path: Path, kind: str) -> None:
    meshio._mesh.topological_dimension.setdefault("pyramid13", 3)
    count = meshio._common.num_nodes_per_cell[kind]
    points = np.random.default_rng(1).random((count, 3))
    message = refused(write(tmp_path / "a.vtu", (kind, np.arange(count)[None]), points=points))
    assert f"its elements are 1 {kind}" in message


def test_surface_mesh_has_no_volume(tmp_path: Path) -> None:
    path = write(tmp_path / "a.vtk", ("triangle", np.array([[0, 1, 2]])), points=nodes("tetra"))
    assert "it holds no volume elements (1 triangle)" in refused(path)


@pytest.mark.parametrize("kind", KINDS)
def test_inverted_elements_are_counted(tmp_path: Path, kind: str) -> None:
    points = np.vstack([nodes(kind) + np.array([4 * i, 0, 0]) for i in range(3)])
    elements = np.arange(len(points)).reshape(3, -1)
    points[elements[1]] *= [1, 1, -1]
    message = refused(write(tmp_path / "a.vtu", (kind, elements), points=points))
    assert f"1 of its 3 {KINDS[kind]} elements are inverted" in message


@pytest.mark.parametrize("kind", ["hexahedron20", "wedge15"])
def test_middle_nodes_in_the_order_of_another_program(tmp_path: Path, kind: str) -> None:
    points = nodes(kind, GMSH_EDGES)
    path = write(tmp_path / "a.vtu", (kind, np.arange(len(points))[None]), points=points)
    assert "the format's own order" in refused(path)


def test_flat_element_is_refused(tmp_path: Path) -> None:
    points = nodes("tetra") * [1, 1, 0]
    path = write(tmp_path / "a.vtu", ("tetra", np.array([[0, 1, 2, 3]])), points=points)
    assert "1 of its 1 tet4 elements" in refused(path)


def test_nodes_that_are_not_finite(tmp_path: Path) -> None:
    points = nodes("tetra")
    points[2, 1] = np.nan
    path = write(tmp_path / "a.vtu", ("tetra", np.array([[0, 1, 2, 3]])), points=points)
    assert "not finite" in refused(path)


def test_nodes_beyond_arithmetic(tmp_path: Path) -> None:
    points = nodes("tetra") * 1e120
    path = write(tmp_path / "a.vtu", ("tetra", np.array([[0, 1, 2, 3]])), points=points)
    assert "a node is 3e120 m from the origin" in refused(path)


@pytest.mark.parametrize("index", [4, -1])
def test_index_out_of_range(tmp_path: Path, index: int) -> None:
    path = write(tmp_path / "a.vtk", ("tetra", np.array([[0, 1, 2, index]])), points=nodes("tetra"))
    assert "of 4: export the mesh again" in refused(path)


def test_several_blocks_of_nodes_are_refused(tmp_path: Path) -> None:
    path = one(tmp_path / "a.inp", "tetra")
    path.write_text(path.read_text() * 2)
    assert "it holds 2 blocks of nodes" in refused(path)


@pytest.mark.parametrize("extension", FORMATS)
@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.8])
def test_truncated_files_are_one_line_and_silent(
    tmp_path: Path, extension: str, share: float, capfd: pytest.CaptureFixture[str]
) -> None:
    path = one(tmp_path / f"a.{extension}", "tetra10")
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    refused(path)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("extension", FORMATS)
@pytest.mark.parametrize("seed", range(3))
def test_binary_junk(
    tmp_path: Path, extension: str, seed: int, capfd: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / f"a.{extension}"
    path.write_bytes(np.random.default_rng(seed).bytes(3000))
    refused(path)
    assert capfd.readouterr() == ("", "")


def test_reader_that_leaves_the_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def leave(_: str) -> None:
        print("Error: no luck")  # noqa: T201
        raise SystemExit(1)

    path = one(tmp_path / "a.vtk", "tetra")
    monkeypatch.setattr(meshio.vtk, "read", leave)
    with pytest.raises(MeshError, match=r"cannot be read as vtk \(Error: no luck\)"):
        read_blocks(path, ReadingLimits())


def test_missing_file_folder_and_extension(tmp_path: Path) -> None:
    assert "there is no file of that name: check" in refused(tmp_path / "a.vtk")
    (tmp_path / "b.inp").mkdir()
    assert "cannot be read (Is a" in refused(tmp_path / "b.inp")
    assert "volume meshes as vtk, vtu, msh, inp" in refused(tmp_path / "a.med")


def test_without_meshio_the_install_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = one(tmp_path / "a.vtk", "tetra")
    monkeypatch.setitem(sys.modules, "meshio", None)
    with pytest.raises(MissingDependencyError, match=r'pip install "struck\[volumes\]"'):
        read_blocks(path, ReadingLimits())
    with pytest.raises(MissingDependencyError, match=r'by meshio: pip install "struck\[volumes\]"'):
        struck.save(ball(), tmp_path / "shapes.vtu")
    assert list(tmp_path.iterdir()) == [path]


def test_surface_and_mode_shapes_are_read_back(tmp_path: Path) -> None:
    model, path = ball(), tmp_path / "ball.vtu"
    struck.save(model, tmp_path / "ball.struck")
    assert main(["export", str(tmp_path / "ball.struck"), "-o", str(path)]) == 0
    shapes = meshio.read(path)
    assert np.array_equal(shapes.points, model.geometry.points)
    assert [block.type for block in shapes.cells] == ["triangle"]
    assert np.array_equal(shapes.cells[0].data, model.geometry.faces)
    names = [f"mode {n:02d} ({hertz:.2f} Hz)" for n, hertz in enumerate(model.frequencies, 1)]
    assert list(shapes.point_data) == names
    assert np.array_equal(np.stack(list(shapes.point_data.values()), 2), model.gains.shapes)
    struck.save(model, tmp_path / "again.VTU")
    assert (tmp_path / "again.VTU").read_bytes() == path.read_bytes()


def test_mode_shapes_that_are_not_there_or_options_of_gains_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(OptionError, match=r"ball.vtu keeps all contacts: leave .* end in \.sofa"):
        struck.save(ball(), tmp_path / "ball.vtu", contacts=["top"])
    gains = SinglePoint(outputs=np.ones(2, complex), centre=np.zeros(3))
    recorded = struck.ModalModel(
        frequencies=np.array([100.0, 200.0]),
        natural_frequencies=np.array([100.0, 200.0]),
        decays=np.zeros(2),
        gains=gains,
        coordinates=(),
        complete_to=0.0,
    )
    with pytest.raises(OptionError, match=r"cup\.vtu .* none, as .* recorded: .*\.sofa.* a mesh"):
        struck.save(recorded, tmp_path / "cup.vtu")
    words = ["export", "x.struck", "-o", str(tmp_path / "x.vtu")]
    for option in (["--rate", "48000"], ["--contacts", "top"], ["--title", "x"]):
        assert main([*words, *option]) == 2
        assert f"{' '.join(option)} is of SOFA files" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_errors_of_the_reader_keep_their_kind(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A module named meshio that cannot be imported stands first on the reader's search path."""
    (tmp_path / "meshio.py").write_text("raise ImportError('absent')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MissingDependencyError, match="pip install"):
        Guard().blocks(one(tmp_path / "a.vtk", "tetra"))


def test_included_files_are_not_followed(tmp_path: Path) -> None:
    path = one(tmp_path / "a.inp", "tetra")
    path.write_text("*INCLUDE, INPUT=b.inp\n" + path.read_text())
    assert "put all into one file" in refused(path)


def test_header_of_a_billion_nodes(tmp_path: Path) -> None:
    path = tmp_path / "a.vtk"
    path.write_text(
        "# vtk DataFile Version 3.0\nx\nBINARY\nDATASET UNSTRUCTURED_GRID\n"
        "POINTS 10000000000 double\n"
    )
    refused(path)

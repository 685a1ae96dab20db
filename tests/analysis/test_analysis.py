"""From bodies of every kind to models."""

from pathlib import Path

import meshio
import numpy as np
import pytest
import trimesh

import struck
from struck import Mesh
from struck.errors import MeshError, OptionError
from struck.solids import Block, Tube

BAND = (20.0, 12_000.0)
BAR = Block(size=(0.2, 0.03, 0.01), elements=(12, 2, 1))
BOX = trimesh.creation.box((125, 93.75, 62.5))  # mm, exact in the single precision of PLY


@pytest.fixture(scope="module")
def bar() -> struck.ModalModel:
    return struck.analyze(BAR, "steel", band=BAND)


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> struck.ModalModel:
    path = tmp_path_factory.mktemp("box") / "box.ply"
    BOX.export(path)
    return struck.analyze(path, "glass", units="mm", accuracy="preview")


def test_a_volume_file_gives_the_modes_of_its_elements(
    tmp_path: Path, bar: struck.ModalModel
) -> None:
    mesh = BAR.volume_mesh()
    path = tmp_path / "bar.vtk"
    meshio.write(path, meshio.Mesh(mesh.nodes, [("hexahedron20", mesh.elements)]))
    read = struck.analyze(path, "steel", band=BAND)
    assert read.frequencies == pytest.approx(bar.frequencies, rel=1e-9)
    assert read.provenance.details["file"] == "bar.vtk"


def test_linear_volume_files_are_made_quadratic(tmp_path: Path, bar: struck.ModalModel) -> None:
    mesh = BAR.volume_mesh()
    path = tmp_path / "bar.vtk"
    meshio.write(path, meshio.Mesh(mesh.nodes, [("hexahedron", mesh.corners)]))
    read = struck.analyze(path, "steel", band=BAND)
    assert read.frequencies == pytest.approx(bar.frequencies, rel=1e-9)


@pytest.mark.prove
def test_a_surface_in_memory_equals_its_file(box: struck.ModalModel) -> None:
    surface = Mesh(points=BOX.vertices / 1000, faces=BOX.faces)
    memory = struck.analyze(surface, "glass", accuracy="preview")
    assert box.frequencies == pytest.approx(memory.frequencies, rel=1e-9)


@pytest.mark.prove
def test_units_and_size_scale_frequencies(tmp_path: Path, box: struck.ModalModel) -> None:
    BOX.export(tmp_path / "box.off")
    double = struck.analyze(
        tmp_path / "box.off", "glass", size=0.25, accuracy="preview", band=(10.0, 10_000.0)
    )
    assert double.frequencies == pytest.approx(box.frequencies / 2, rel=1e-6)
    assert double.mass == pytest.approx(8 * box.mass, rel=1e-9)


def test_a_support_raises_no_rigid_modes_and_lowers_the_first(bar: struck.ModalModel) -> None:
    end = ((-0.2, -1, -1), (-0.0999, 1, 1))
    held = struck.analyze(BAR, "steel", band=BAND, fixed=end)
    by_rule = struck.analyze(BAR, "steel", band=BAND, fixed=lambda p: p[:, 0] < -0.0999)
    assert held.frequencies == pytest.approx(by_rule.frequencies, rel=1e-12)
    # Euler-Bernoulli: a clamped-free bar's first mode over a free bar's, (1.8751 / 4.7300)^2.
    ratio = held.frequencies[0] / bar.frequencies[0]
    assert ratio == pytest.approx((1.875104 / 4.730041) ** 2, rel=0.02)


def test_a_band_may_be_an_array_but_not_empty(bar: struck.ModalModel) -> None:
    same = struck.analyze(BAR, "steel", band=np.array(BAND))
    assert np.array_equal(same.frequencies, bar.frequencies)
    with pytest.raises(struck.errors.OptionError, match=r"band is .*\[\].*: give two"):
        struck.analyze(BAR, "steel", band=np.zeros(0))


def test_modes_below_the_band_are_dropped_and_counted(bar: struck.ModalModel) -> None:
    lowest = float(bar.frequencies[0])
    higher = struck.analyze(BAR, "steel", band=(lowest + 1, BAND[1]))
    assert len(higher.frequencies) == len(bar.frequencies) - 1
    assert any("1 mode below" in loss for loss in higher.provenance.dropped)


@pytest.mark.prove
def test_the_papers_elements_are_stiffer() -> None:
    mesh = Tube(length=0.505, radius=0.0125, wall=0.001)
    ours = struck.analyze(mesh, "aluminium", accuracy="preview", band=(20, 3000))
    theirs = struck.analyze(
        mesh, "aluminium", accuracy="preview", band=(20, 30_000), method="obrien2002"
    )
    assert theirs.frequencies[0] > 1.05 * ours.frequencies[0]
    assert "O'Brien" in theirs.cite()
    assert "O'Brien" not in ours.cite()


@pytest.mark.prove
def test_what_is_cited_is_what_was_used(bar: struck.ModalModel, box: struck.ModalModel) -> None:
    assert "Isosurface stuffing" in box.cite()
    assert "Isosurface stuffing" not in bar.cite()
    assert "block Lanczos" in box.cite()
    by_paper = struck.analyze(BAR, "steel", band=BAND, radiation="obrien2002")
    assert "O'Brien" in by_paper.cite()
    assert not by_paper.calibrated


@pytest.mark.prove
def test_both_factorisations_give_the_same_model() -> None:
    block = Block(size=(0.2, 0.05, 0.01), elements=(16, 6, 2))
    models = [struck.analyze(block, "brass", band=BAND, backend=b) for b in ("rslab", "superlu")]
    assert models[0].frequencies == pytest.approx(models[1].frequencies, rel=1e-9)


def test_options_that_do_not_apply_are_refused() -> None:
    for options in ({"size": 1.0}, {"units": "mm"}, {"wall": 0.01}):
        with pytest.raises(OptionError):
            struck.analyze(BAR, "steel", **options)
    with pytest.raises(MeshError, match="is no body"):
        struck.analyze(3, "steel")


def test_progress_tells_every_stage() -> None:
    told: list[str] = []
    struck.analyze(BAR, "steel", band=BAND, progress=lambda stage, _share: told.append(stage))
    assert list(dict.fromkeys(stage.partition(":")[0] for stage in told))[:4] == [
        "cutting the body into elements",
        "forecast",
        "setting up the equations of motion",
        "counting modes",
    ]
    assert told[-1] == "computing how loudly modes radiate"


@pytest.mark.prove
def test_gains_of_the_same_place_agree_between_meshes() -> None:
    models = [
        struck.analyze(Block(size=(0.2, 0.03, 0.01), elements=counts), "steel", band=(20, 4000))
        for counts in ((12, 2, 2), (20, 4, 2))
    ]
    contact = models[0].contact((0.09, 0.01, 0.005))
    point, push = contact.point[None], contact.direction[None]
    drives = [model.gains.at(point, push)[0, 0] for model in models]
    outputs = [model.gains.toward(point + 1.0)[0, 0] for model in models]
    loud = np.abs(drives[1]) > 0.1 * np.abs(drives[1]).max()
    assert drives[0][loud] == pytest.approx(drives[1][loud], rel=0.01)
    # An estimate by the triangles of the surface: the same within 1 dB.
    assert outputs[0] == pytest.approx(outputs[1], rel=0.12)

"""Repair in the separate process: the same surfaces, within a bound of time that is named."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

import struck
from struck.errors import MeshError, OptionError
from struck.files.mesh_repair import repair_in_time
from struck.files.meshes import load_body
from struck.solids.surface.repair import Repair, repair_mesh


def ball(subdivisions: int = 2) -> trimesh.Trimesh:
    return trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.1)


def holed() -> struck.Mesh:
    body = ball()
    return struck.Mesh(points=np.array(body.vertices), faces=np.array(body.faces)[3:], up="x")


def tangled(subdivisions: int = 2, count: int = 31) -> struck.Mesh:
    """Return a ball that takes long to repair: vertices far astray."""
    chance = np.random.default_rng(10)
    body = ball(subdivisions)
    points = np.array(body.vertices)
    points[chance.integers(len(points), size=count)] *= chance.uniform(-3, 3, size=(count, 1))
    return struck.Mesh(points=points, faces=np.array(body.faces))


def repaired(mesh: struck.Mesh, seconds: float | None = None, time_spent: float = 0.0) -> Repair:
    return repair_in_time(mesh, wall=None, holes=None, seconds=seconds, time_spent=time_spent)[0]


def test_a_repair_returns_exactly_from_the_other_process() -> None:
    ours, theirs = repair_mesh(holed()), repaired(holed())
    np.testing.assert_array_equal(ours.mesh.points, theirs.mesh.points)
    np.testing.assert_array_equal(ours.mesh.faces, theirs.mesh.faces)
    assert theirs.mesh.up == "x"
    for name in ("faults", "changes", "volume_before", "volume_after", "sheet"):
        assert getattr(ours, name) == getattr(theirs, name)


def test_a_clean_surface_is_returned_itself() -> None:
    body = ball()
    mesh = struck.Mesh(points=np.array(body.vertices), faces=np.array(body.faces))
    assert repaired(mesh).mesh is mesh


def test_what_is_no_body_is_refused_as_before() -> None:
    points = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0.1, 0.1, 0]])
    sheet = struck.Mesh(points=points, faces=np.array([[0, 1, 2], [1, 3, 2]]))
    with pytest.raises(MeshError) as ours:
        repair_mesh(sheet)
    with pytest.raises(MeshError) as theirs:
        repaired(sheet)
    assert str(ours.value) == str(theirs.value)


def test_a_long_repair_is_ended_and_named() -> None:
    start = time.process_time()
    with pytest.raises(MeshError) as caught:
        repaired(tangled(), 0.3)
    assert time.process_time() - start < 5
    message = str(caught.value)
    assert "repairing its surface took more than 0.3 s of the processor: allow more by " in message
    for hint in ("repair_seconds=", "decimate", "repair=False"):
        assert hint in message
    assert isinstance(caught.value.__cause__, TimeoutError)
    assert repaired(holed()).faults  # by the next process


def test_reading_and_repair_share_their_time() -> None:
    with pytest.raises(MeshError, match=r"more than 0\.2 s .* after 9\.8 s for reading by repair_"):
        repaired(tangled(), time_spent=9.8)
    with pytest.raises(MeshError, match=r"more than 0\.2 s .* allow more by repair_seconds="):
        repaired(tangled(), 0.2, time_spent=9.8)


def test_options_of_a_repair(tmp_path: Path) -> None:
    mesh = tangled()
    path = tmp_path / "a.stl"
    trimesh.Trimesh(mesh.points, mesh.faces, process=False).export(path)
    words = r"a\.stl: repairing its surface took more than 0\.1 s"
    with pytest.raises(MeshError, match=words):
        load_body(path, repair_seconds=0.1)
    with pytest.raises(MeshError, match=words):
        struck.analyze(path, "steel", repair_seconds=0.1, cache=False, progress=None)
    with pytest.raises(MeshError, match=r"^repairing its surface took more than 0\.1 s"):
        struck.analyze(mesh, "steel", repair_seconds=0.1, cache=False, progress=None)
    with pytest.raises(OptionError, match="leave one of them out"):
        struck.analyze(mesh, "steel", repair_seconds=5, repair=False, progress=None)
    for seconds in (0, -1, np.inf, np.nan):
        with pytest.raises(OptionError, match="repair_seconds is"):
            load_body(path, repair_seconds=seconds)


@pytest.mark.prove
def test_a_default_repair_ends_after_ten_seconds() -> None:
    start = time.monotonic()
    with pytest.raises(MeshError, match="repairing its surface took more than 10 s of the proc"):
        repaired(tangled(subdivisions=5, count=150))  # 20 s and more
    assert time.monotonic() - start < 120

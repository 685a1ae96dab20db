"""Cells that sheets cut: those in the body are kept, on a lattice far coarser than its walls."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from manifold3d import Manifold
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from struck.errors import MeshError
from struck.model.mesh import Mesh
from struck.solids.filling.filling import fill_body, flatness, piece_count
from struck.solids.filling.membership import undo_needless_cuts
from struck.solids.filling.thin_walls import Segments, SheetedBody, ThinBody
from struck.solids.lattice import cells_in
from struck.solids.surface.distance import FilledBody
from struck.solids.volume_mesh import VolumeMesh
from tests.physics import everyday


def tee() -> Mesh:
    """Return two sheets of 2 mm that meet in the middle of one, as a T."""
    upright = Manifold.cube([2, 80, 100]).translate([49, 0, 1])
    return everyday.meshed(Manifold.cube([100, 80, 2]) + upright)


def tray() -> Mesh:
    """Return a tray of 3 mm with a wall across it."""
    body = Manifold.cube([240, 180, 60]) - Manifold.cube([234, 174, 80]).translate([3, 3, 3])
    return everyday.meshed(body + Manifold.cube([3, 176, 50]).translate([100, 2, 2]))


BODIES: dict[str, Callable[[], Mesh]] = {
    "hollow cube": everyday.hollow_cube,
    "crate": everyday.crate,
    "table": everyday.table,
    "tee": tee,
    "tray": tray,
}


def somehow_turned(mesh: Mesh, seed: int) -> Mesh:
    """Return a mesh turned at random, so that no lattice plane lies along a wall."""
    turn = Rotation.random(random_state=seed).as_matrix()
    return Mesh(points=mesh.points @ turn.T, faces=mesh.faces)


SAMPLE = {("crate", None)}
CASES = [
    pytest.param(name, seed, marks=() if (name, seed) in SAMPLE else pytest.mark.prove)
    for name in BODIES
    for seed in (None, 0)
]


@pytest.mark.parametrize(("name", "seed"), CASES)
def test_walls_that_meet_are_filled_to_their_corners(name: str, seed: int | None) -> None:
    """Volume and surface are those of the body, as manifold3d cut it: no gap, no cut inside."""
    mesh = BODIES[name]()
    mesh = mesh if seed is None else somehow_turned(mesh, seed)
    filling = fill_body(FilledBody(mesh=mesh), "preview")
    assert filling.path == "one layer"
    assert piece_count(filling.mesh) == 1
    assert flatness(filling.mesh).min() > 0
    assert filling.mesh.volume() == pytest.approx(mesh.volume, rel=2e-3)
    boundary, _ = filling.mesh.surface()  # a cut inside would add far more
    assert boundary.areas.sum() == pytest.approx(mesh.areas.sum(), rel=4e-3)


@pytest.mark.prove
def test_a_sound_hole_cuts_the_top_alone() -> None:
    """What carries its rim on would cut the back as well, which is less than two cells away."""
    mesh = everyday.guitar_box()
    filling = fill_body(FilledBody(mesh=mesh), "standard")
    middles = filling.mesh.nodes[filling.mesh.corners].mean(axis=1)
    rule = filling.mesh.element.mass_rule
    volumes = np.linalg.det(filling.mesh.jacobians(rule.points)) @ rule.weights
    back = volumes[middles[:, 2] < 0.003].sum()
    assert back == pytest.approx(0.45 * 0.35 * 0.003, rel=2e-3)
    assert filling.mesh.volume() == pytest.approx(mesh.volume, rel=2e-3)


def test_sheets_are_joined_where_walls_meet_inside() -> None:
    for name, joined in (("hollow cube", 3), ("tee", 2)):
        body = ThinBody(solid=FilledBody(mesh=BODIES[name]())).at(0.012)
        assert isinstance(body, SheetedBody)
        assert len(body.judge.joined) >= joined
    plate = ThinBody(solid=FilledBody(mesh=everyday.plate(1))).at(0.012)
    assert isinstance(plate, SheetedBody)
    assert not plate.judge.joined


@pytest.mark.prove
def test_walls_that_take_too_many_functions_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("struck.solids.filling.filling._MAX_FUNCTIONS", 5_000)
    with pytest.raises(MeshError, match=r"walls cross so closely that they take \d+ functions on"):
        fill_body(FilledBody(mesh=everyday.hollow_cube()), "preview")


def test_facets_that_a_floor_passes_are_no_rims() -> None:
    """A vase has some sheets, and not one for each facet of its foot."""
    segments = Segments.of(everyday.vase(), thin=0.02)
    assert len(segments.areas) < 10


@pytest.mark.prove
def test_needless_cuts_are_undone() -> None:
    """The same space is filled with far fewer tetrahedra, each turned as it should be."""
    body = ThinBody(solid=FilledBody(mesh=everyday.table())).at(0.157)
    assert isinstance(body, SheetedBody)
    cut = cells_in(body.depths, body.bounds, 0.157, max_halvings=1000, judge=body.judge)
    whole = undo_needless_cuts(cut)
    before, after = (
        VolumeMesh(nodes=each.points, elements=each.tetrahedra, kind="tet4")
        for each in (cut, whole)
    )
    assert len(after.elements) < 0.5 * len(before.elements)
    assert flatness(after).min() > 0
    assert piece_count(after) == 1
    assert after.volume() == pytest.approx(before.volume(), rel=1e-9)
    areas = [mesh.surface()[0].areas.sum() for mesh in (before, after)]
    assert areas[1] == pytest.approx(areas[0], rel=1e-5)
    # What lies on a sheet is on it still, so that curved sides find their surface.
    points = KDTree(cut.points).query(whole.points)[1]
    assert np.array_equal(whole.depths == 0, cut.depths[points] == 0)

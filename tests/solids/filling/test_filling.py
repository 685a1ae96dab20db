"""From surfaces to elements: closed, face-connected, of the right volume, none folded."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
import trimesh

from struck import Mesh
from struck.errors import MeshError, OptionError
from struck.report.gallery import bird
from struck.solids import VolumeMesh
from struck.solids.fem.assembly import Displacements
from struck.solids.fem.cubic_surface import surface_of
from struck.solids.filling.filling import (
    ACCURACIES,
    _require_cavity,
    curve_elements,
    fill_body,
    flatness,
    piece_count,
)
from struck.solids.lattice import cells_in, stuff_body
from struck.solids.surface.closedness import is_closed, require_closed
from struck.solids.surface.distance import FilledBody
from struck.solids.volume_mesh import unique_rows
from tests.physics.bodies import ball, box, grid

# It takes a second, and several tests want it.
cached_bird = cache(bird)
BODIES = {
    "ball": (lambda: ball(0.05, 4), None),
    "box": (lambda: box(0.1, 0.07, 0.05), None),
    "hollow box": (lambda: box(0.1, 0.08, 0.06), 0.01),
    "hollow ball": (lambda: ball(0.05, 4), 0.008),
    "thin ball": (lambda: ball(0.05, 4), 0.001),
    "hollow bird": (cached_bird, 0.006),
}
COSTLY = {"thin ball", "hollow bird"}


@cache
def made(name: str) -> tuple[FilledBody, VolumeMesh]:
    mesh, wall = BODIES[name]
    body = FilledBody(mesh=mesh(), wall=wall)
    return body, fill_body(body, "preview").mesh


@pytest.fixture(
    params=[
        pytest.param(name, marks=pytest.mark.prove)
        if name in {"thin ball", "hollow bird"}
        else name
        for name in BODIES
    ]
)
def case(request: pytest.FixtureRequest) -> tuple[FilledBody, VolumeMesh]:
    return made(request.param)


def test_the_surface_is_closed_and_two_sided(case: tuple[FilledBody, VolumeMesh]) -> None:
    body, mesh = case
    added = Displacements.of(mesh).added
    surface, _ = mesh.surface() if added is None else surface_of(mesh, added)
    assert is_closed(surface)
    require_closed(surface)
    # Its triangles are chords of the elements' curved sides.
    assert surface.volume == pytest.approx(mesh.volume(), rel=6e-3)
    assert (body.wall is None) == (surface.volume > 0.9 * body.mesh.volume)


def test_elements_hang_together_by_faces_and_none_folds(
    case: tuple[FilledBody, VolumeMesh],
) -> None:
    _, mesh = case
    assert piece_count(mesh) == 1
    assert flatness(mesh).min() > 0


def test_boundary_nodes_lie_on_the_surface(case: tuple[FilledBody, VolumeMesh]) -> None:
    body, mesh = case
    surface, _ = mesh.surface()
    depths = body.depths(surface.points)
    away = np.abs(depths.max(axis=1))
    outer = np.abs(depths[:, 0]) < (body.wall or np.inf) / 2
    assert np.mean(away[outer] > 1e-9) < 2e-3
    # The inner face of a wall has creases, where nodes stay short lest elements fold over.
    assert np.mean(away > 1e-9) < 0.05


@pytest.mark.prove
def test_volume_is_that_of_darts() -> None:
    """One in each of 40^3 cells: their share errs less than that of 400,000 thrown anywhere."""
    body, mesh = made("hollow bird")
    low, high = body.mesh.bounds
    cells = np.stack(np.unravel_index(np.arange(40**3), (40, 40, 40)), axis=1)
    darts = cells + np.random.default_rng(1).uniform(0, 1, cells.shape)
    hits = body.depths(low + darts / 40 * (high - low)).max(axis=1) < 0
    share, error = hits.mean(), hits.std() / np.sqrt(400_000)
    volume = mesh.volume() / np.prod(high - low)
    assert abs(volume - share) < 4 * error + 0.005 * share


def test_a_box_keeps_its_edges() -> None:
    mesh = fill_body(FilledBody(mesh=box(0.1, 0.07, 0.05)), "preview").mesh
    assert mesh.volume() == pytest.approx(0.1 * 0.07 * 0.05, rel=1e-12)


def test_tetrahedra_are_of_good_shape() -> None:
    body = FilledBody(mesh=ball(0.05, 4), wall=0.008)
    mesh = stuff_body(body.depths, body.bounds, 0.006)
    corners = mesh.nodes[mesh.elements]
    normals = [
        np.cross(corners[:, b] - corners[:, a], corners[:, c] - corners[:, a])
        for a, b, c in ((1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1))
    ]
    unit = [n / np.linalg.norm(n, axis=1, keepdims=True) for n in normals]
    cosines = [-(unit[i] * unit[j]).sum(axis=1) for i in range(4) for j in range(i)]
    angles = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    assert angles.min() > 10
    assert angles.max() < 160


@pytest.mark.prove
def test_a_thin_wall_gets_one_layer_and_a_thick_one_several() -> None:
    thin, thick = (
        fill_body(FilledBody(mesh=ball(0.05, 4), wall=w), "standard") for w in (0.002, 0.02)
    )
    assert (thin.path, thick.path) == ("one layer", "stuffing")
    assert "the wall of 0.002 m is thinner than the lattice" in thin.reason
    assert thin.spacing > 0.002
    assert thick.spacing < 0.02


@pytest.mark.prove
def test_a_smooth_body_has_about_the_nodes_asked_for() -> None:
    most = ACCURACIES["preview"].max_nodes
    smooth = FilledBody(mesh=ball(0.05, 4), wall=0.002)
    half, whole = (fill_body(smooth, "preview", nodes=n).mesh for n in (most // 2, 4 * most // 5))
    assert len(half.nodes) < 0.7 * most < 0.9 * most < len(whole.nodes) <= most


@pytest.mark.prove
def test_nodes_that_creases_leave_go_into_a_finer_lattice() -> None:
    most = ACCURACIES["preview"].max_nodes
    creased = FilledBody(mesh=cached_bird(), wall=0.0063)
    finest = fill_body(creased, "preview", nodes=10 * most)
    assert 0.8 * most < len(finest.mesh.nodes) <= most


@pytest.mark.parametrize(
    ("wall", "ratio"),
    [
        (0.003, 1.5),
        pytest.param(0.001, 4.0, marks=pytest.mark.prove),
        (0.001, 9.0),
        pytest.param(0.001, 1.5, marks=pytest.mark.prove),
    ],
)
def test_one_layer_follows_a_wall_of_a_sphere(wall: float, ratio: float) -> None:
    radius = 0.05
    cells = cells_in(
        (body := FilledBody(mesh=ball(radius, 5), wall=wall)).depths, body.bounds, ratio * wall
    )
    mesh, short = curve_elements(cells, body.onto, opposed=body.opposed)
    assert short == 0
    assert piece_count(mesh) == 1
    exact = 4 / 3 * np.pi * (radius**3 - (radius - wall) ** 3)
    assert mesh.volume() == pytest.approx(exact, rel=2e-3)
    radii = np.linalg.norm(mesh.surface()[0].points, axis=1)
    assert np.minimum(abs(radii - radius), abs(radii - radius + wall)).max() < 3e-5


def test_pieces_that_share_an_edge_count_apart() -> None:
    first = grid("hex8", (1, 1, 1))
    nodes = np.vstack([first.nodes, first.nodes + np.array([1.0, 1.0, 0.0])])
    elements = np.vstack([first.elements, first.elements + 8])
    assert piece_count(VolumeMesh(nodes=nodes, elements=elements, kind="hex8")) == 2
    assert piece_count(grid("wedge6", (2, 2, 2))) == 1


@pytest.mark.prove
def test_a_wall_thicker_than_the_body_is_refused() -> None:
    with pytest.raises(MeshError, match=r"a wall of 0\.06 m leaves no cavity"):
        fill_body(FilledBody(mesh=ball(0.05, 3), wall=0.06), "preview")
    # The depth in the message is the wall's limit, however far beyond it a wall is.
    made = trimesh.creation.box((0.103, 0.06, 0.0437))
    long = Mesh(points=made.vertices, faces=made.faces)
    for wall in (0.0225, 0.03, 0.05):
        with pytest.raises(MeshError, match=r"0\.0218 m deep|0\.0219 m deep"):
            _require_cavity(FilledBody(mesh=long, wall=wall))
    for wall in (0.018, 0.021, 0.0217):
        _require_cavity(FilledBody(mesh=long, wall=wall))


def test_parts_too_thin_for_the_lattice_are_refused() -> None:
    outer = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    inner = trimesh.creation.icosphere(subdivisions=4, radius=0.0496)
    inner.invert()
    both = trimesh.util.concatenate([outer, inner])
    with pytest.raises(MeshError, match="need more than 30000 nodes: use accuracy='standard', a "):
        fill_body(FilledBody(mesh=Mesh(points=both.vertices, faces=both.faces)), "preview")


@pytest.mark.prove
def test_a_wire_that_passes_between_points_of_the_lattice_is_refused_with_a_way_out() -> None:
    ring = trimesh.creation.torus(0.5, 0.003, major_sections=256, minor_sections=12)
    way = (
        r"pieces on a lattice of 0\.0088\d* m: use accuracy='standard', .* solid of struck\.solids"
    )
    with pytest.raises(MeshError, match=way):
        fill_body(FilledBody(mesh=Mesh(points=ring.vertices, faces=ring.faces)), "preview")


def test_an_unknown_accuracy_is_refused() -> None:
    with pytest.raises(OptionError, match="preview, standard, fine"):
        fill_body(FilledBody(mesh=ball(0.05, 3)), "superb")


def test_unique_rows_are_numpys() -> None:
    rows = np.random.default_rng(0).integers(0, 9, (200, 2))
    found, inverse = unique_rows(rows)
    expected, numbers = np.unique(rows, axis=0, return_inverse=True)
    assert np.array_equal(found, expected)
    assert np.array_equal(inverse, numbers.ravel())

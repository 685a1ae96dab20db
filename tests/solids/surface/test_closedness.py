"""What encloses a body, and what is wrong with what does not."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from struck.errors import MeshError
from struck.model.mesh import Mesh
from struck.model.mesh_topology import bodies, pieces, submesh
from struck.solids.surface.closedness import is_closed, require_closed


def mesh(body: trimesh.Trimesh) -> Mesh:
    return Mesh(points=body.vertices, faces=body.faces)


def joined(*bodies: trimesh.Trimesh) -> Mesh:
    return mesh(trimesh.util.concatenate(bodies))


def ball(
    radius: float = 1.0, *, at: tuple[float, ...] = (0, 0, 0), inward: bool = False
) -> trimesh.Trimesh:
    body = trimesh.creation.icosphere(subdivisions=2, radius=radius)
    body.apply_translation(at)
    if inward:
        body.invert()
    return body


def strip(count: int, *, twisted: bool) -> Mesh:
    """A closed ring of square cross-section, or the one-sided Klein bottle, as a torus grid."""
    rows, columns = np.meshgrid(np.arange(count), np.arange(count), indexing="ij")
    turn = 2 * np.pi / count
    radius = 2 + np.cos(columns * turn)
    points = np.stack(
        [radius * np.cos(rows * turn), radius * np.sin(rows * turn), np.sin(columns * turn)], axis=2
    ).reshape(-1, 3)

    def vertex(row: int, column: int) -> int:
        around = row // count
        return (row % count) * count + (-column if twisted and around else column) % count

    corners = [
        [vertex(r, c), vertex(r + 1, c), vertex(r + 1, c + 1), vertex(r, c + 1)]
        for r in range(count)
        for c in range(count)
    ]
    faces = [[a, b, c] for a, b, c, _ in corners] + [[a, c, d] for a, _, c, d in corners]
    return Mesh(points=points, faces=np.array(faces))


@pytest.mark.parametrize(
    "body",
    [
        trimesh.creation.box(),
        trimesh.creation.icosphere(subdivisions=3),
        trimesh.creation.annulus(0.4, 0.5, 1.0),
        trimesh.creation.torus(1.0, 0.2),
        trimesh.creation.cylinder(0.01, 10.0),
    ],
    ids=["box", "ball", "tube", "ring", "wire"],
)
def test_bodies_pass_and_trimesh_agrees(body: trimesh.Trimesh) -> None:
    assert body.is_volume
    require_closed(mesh(body))
    assert is_closed(mesh(body))


def test_body_far_from_the_origin_passes() -> None:
    body = trimesh.creation.box((0.1, 0.1, 0.001))
    body.apply_translation([1e5, -1e5, 1e5])
    require_closed(mesh(body))


def test_cavity_belongs_to_its_body() -> None:
    hollow = joined(ball(), ball(0.4, at=(0.3, 0, 0), inward=True), ball(0.1, inward=True))
    hollow = submesh(hollow, np.flatnonzero(pieces(hollow) != 2))
    require_closed(hollow)
    assert len(bodies(hollow)) == 1
    assert hollow.volume == pytest.approx(ball().volume - ball(0.4).volume, rel=1e-12)


def test_body_within_a_cavity_is_another_body() -> None:
    shells = joined(ball(), ball(0.2), ball(0.5, inward=True), ball(at=(5, 0, 0)))
    found = bodies(shells)
    assert [len(faces) for faces in found] == [640, 320, 320]
    outer, inner, far = (submesh(shells, faces) for faces in found)
    assert outer.volume == pytest.approx(ball().volume - ball(0.5).volume, rel=1e-12)
    assert inner.volume == pytest.approx(ball(0.2).volume, rel=1e-12)
    assert far.bounds[0, 0] == pytest.approx(4)
    with pytest.raises(MeshError, match="3 separate bodies"):
        require_closed(shells)


def test_ball_in_the_hole_of_a_ring_is_not_inside_it() -> None:
    with pytest.raises(MeshError, match="2 separate bodies"):
        require_closed(joined(trimesh.creation.torus(1.0, 0.2), ball(0.1)))


def test_open_edges_and_holes_are_counted() -> None:
    tube = trimesh.creation.cylinder(1.0, 2.0, sections=24)
    wall = tube.faces[np.abs(tube.face_normals[:, 2]) < 0.5]
    with pytest.raises(MeshError, match="48 open edges in 2 holes; close holes"):
        require_closed(Mesh(points=tube.vertices, faces=wall))


def test_one_open_face() -> None:
    box = trimesh.creation.box()
    with pytest.raises(MeshError, match="3 open edges in 1 hole;"):
        require_closed(Mesh(points=box.vertices, faces=box.faces[1:]))


def test_branching_edges_are_counted() -> None:
    box = trimesh.creation.box()
    fin = np.array([[*box.faces[0][:2], len(box.vertices)]])
    points = np.vstack([box.vertices, [2.0, 2.0, 2.0]])
    with pytest.raises(MeshError, match="2 open edges in 1 hole and 1 edge shared by more than"):
        require_closed(Mesh(points=points, faces=np.vstack([box.faces, fin])))


def test_two_boxes_on_one_edge_branch_there() -> None:
    second = trimesh.creation.box()
    second.apply_translation([1, 1, 0])
    both = trimesh.util.concatenate([trimesh.creation.box(), second])
    both.merge_vertices()
    with pytest.raises(MeshError, match="1 edge shared by more than two faces"):
        require_closed(mesh(both))


@pytest.mark.parametrize("count", [1, 7, 100])
def test_flipped_faces_are_counted(count: int) -> None:
    body = ball()
    chosen = np.random.default_rng(count).choice(len(body.faces), count, replace=False)
    body.faces[chosen] = body.faces[chosen][:, ::-1]
    with pytest.raises(MeshError, match=f"{count} faces? with flipped orientation of 320"):
        require_closed(Mesh(points=body.vertices, faces=body.faces))


def test_ring_is_two_sided_and_klein_bottle_is_not() -> None:
    require_closed(strip(12, twisted=False))
    with pytest.raises(MeshError, match="Klein bottle"):
        require_closed(strip(12, twisted=True))


@pytest.mark.parametrize("seed", range(3))
def test_plane_is_flat_whichever_way_it_lies(seed: int) -> None:
    turned = trimesh.transformations.random_rotation_matrix(np.random.default_rng(seed).random(3))
    points = np.random.default_rng(seed).random((4, 3)) * [1, 1, 0] @ turned[:3, :3]
    with pytest.raises(MeshError, match="flat: its 4 vertices lie in one plane"):
        require_closed(Mesh(points=points, faces=[[0, 1, 2], [1, 3, 2]]))


def test_thin_plate_is_not_flat() -> None:
    require_closed(mesh(trimesh.creation.box((1.0, 1.0, 1e-4))))


def test_doubled_sheet_has_no_volume() -> None:
    dome = trimesh.creation.icosphere(subdivisions=2)
    faces = dome.faces[dome.triangles_center[:, 2] > 0]
    back = faces[:, ::-1] + len(dome.vertices)
    rim = trimesh.Trimesh(
        np.vstack([dome.vertices, dome.vertices]), np.vstack([faces, back]), process=False
    )
    # Joined along the rim alone, the two sheets close around nothing.
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    single, counts = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    on_rim = np.unique(single[counts == 1])
    merged = np.arange(2 * len(dome.vertices))
    merged[on_rim + len(dome.vertices)] = on_rim
    with pytest.raises(MeshError, match="encloses no volume in 1 of its 1 piece"):
        require_closed(Mesh(points=rim.vertices, faces=merged[rim.faces]))


def test_inside_out_is_said_and_not_mended() -> None:
    with pytest.raises(MeshError, match=r"inside out \(its volume is -4.\d+ m\^3\): flip"):
        require_closed(mesh(ball(inward=True)))


def test_outward_shell_within_a_body_is_refused() -> None:
    with pytest.raises(MeshError, match="1 inner shell of the mesh with normals outward"):
        require_closed(joined(ball(), ball(0.5)))


@pytest.mark.prove
def test_thousands_of_pores_are_one_body() -> None:
    steps = np.arange(-10, 11) * 0.06
    places = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)[:8000]
    pore = trimesh.creation.box((0.02, 0.02, 0.02))
    points = (places[:, None] + pore.vertices).reshape(-1, 3)
    faces = (8 * np.arange(len(places))[:, None, None] + pore.faces[:, ::-1]).reshape(-1, 3)
    block = trimesh.creation.box((2, 2, 2))
    foam = Mesh(
        points=np.vstack([block.vertices, points]), faces=np.vstack([block.faces, faces + 8])
    )
    require_closed(foam)
    assert foam.volume == pytest.approx(8 - len(places) * 0.02**3, rel=1e-9)

"""Repair against volumes in closed form, whatever was done to the surface."""

from __future__ import annotations

import re
from functools import cache

import manifold3d
import numpy as np
import pytest
import trimesh

from struck.errors import MeshError
from struck.model.mesh import Mesh
from struck.model.mesh_topology import edges_of, submesh
from struck.solids.surface.closedness import require_closed
from struck.solids.surface.repair import Repair, repair_mesh
from struck.solids.surface.welding import close_openings, loops


def mesh(*bodies: trimesh.Trimesh) -> Mesh:
    body = trimesh.util.concatenate(bodies)
    return Mesh(points=body.vertices, faces=body.faces)


def ball(
    radius: float = 1.0, *, at: tuple[float, ...] = (0, 0, 0), fine: int = 3
) -> trimesh.Trimesh:
    body = trimesh.creation.icosphere(subdivisions=fine, radius=radius)
    body.apply_translation(at)
    return body


def box(*size: float, at: tuple[float, ...] = (0, 0, 0)) -> trimesh.Trimesh:
    body = trimesh.creation.box(size)
    body.apply_translation(at)
    return body


def inverted(body: trimesh.Trimesh) -> trimesh.Trimesh:
    body.invert()
    return body


def closed_repair(surface: Mesh, **options: float) -> Repair:
    """Repair, and check that trimesh finds the result watertight and turned outward."""
    result = repair_mesh(surface, **options)
    judge = trimesh.Trimesh(result.mesh.points, result.mesh.faces, process=False)
    assert judge.is_watertight
    assert judge.is_winding_consistent
    assert judge.volume == pytest.approx(result.volume_after, rel=1e-9)
    require_closed(result.mesh)
    return result


# Nothing wrong


@pytest.mark.parametrize("scale", [1e-3, 1.0, 100.0])
def test_clean_body_is_returned_itself(scale: float) -> None:
    hollow = mesh(ball(scale), inverted(ball(0.5 * scale)))
    result = repair_mesh(hollow)
    assert result.mesh is hollow
    assert result.faults == result.changes == ()
    assert result.volume_before == result.volume_after == pytest.approx(hollow.volume)


# Mending: faces stay where they are


@pytest.mark.parametrize("scale", [1e-3, 1.0, 100.0])
def test_one_face_missing_of_a_ball(scale: float) -> None:
    whole = mesh(ball(scale))
    result = closed_repair(Mesh(points=whole.points, faces=whole.faces[1:]))
    assert result.volume_after == pytest.approx(whole.volume, rel=1e-12)
    assert result.faults == ("1 hole in the surface.",)
    assert "1 hole filled (0.0" in result.changes[0]


def test_flat_hole_of_a_cube_is_filled_flat() -> None:
    cube = box(1, 1, 1).subdivide().subdivide().subdivide()
    gone = np.linalg.norm(cube.triangles_center - [0.5, 0.1, 0], axis=1) < 0.3
    assert 10 < gone.sum() < 100
    cube.update_faces(~gone)
    result = closed_repair(mesh(cube))
    assert result.volume_after == pytest.approx(1, rel=1e-12)
    assert result.mesh.areas.sum() == pytest.approx(6, rel=1e-9)


@pytest.mark.parametrize("share", [1e-7, 1e-6, 1e-5])
def test_soup_is_sewn(share: float) -> None:
    whole = ball()
    corners = whole.vertices[whole.faces].reshape(-1, 3)
    jitter = np.random.default_rng(1).uniform(-1, 1, corners.shape)
    faces = np.arange(len(corners)).reshape(-1, 3)
    result = closed_repair(Mesh(points=corners + share * jitter, faces=faces))
    assert len(result.mesh.points) == len(whole.vertices)
    assert result.volume_after == pytest.approx(whole.volume, rel=10 * share)


@pytest.mark.parametrize("seed", range(3))
def test_flipped_faces_are_turned(seed: int) -> None:
    whole = ball()
    chosen = np.random.default_rng(seed).random(len(whole.faces)) < 0.4
    faces = np.where(chosen[:, None], whole.faces[:, ::-1], whole.faces)
    result = closed_repair(Mesh(points=whole.vertices, faces=faces))
    assert f"{chosen.sum()} faces of 1280 flipped" in result.faults[0]
    assert result.volume_after == pytest.approx(whole.volume, rel=1e-12)


def test_both_sides_of_every_face() -> None:
    whole = ball()
    faces = np.vstack([whole.faces, whole.faces[:, ::-1]])
    result = closed_repair(Mesh(points=whole.vertices, faces=faces))
    assert result.volume_after == pytest.approx(whole.volume, rel=1e-12)


def test_inside_out_with_its_cavity() -> None:
    result = closed_repair(mesh(inverted(ball()), ball(0.5)))
    assert result.faults == ("1 piece inside out.",)
    assert result.volume_after == pytest.approx(ball().volume - ball(0.5).volume, rel=1e-12)
    assert result.volume_before == pytest.approx(-result.volume_after, rel=1e-12)


def test_face_without_area_in_a_crack() -> None:
    """A vertex halfway along an edge of one side alone: the crack closes exactly."""
    points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0.5, 0, 0)]
    faces = [(0, 2, 4), (4, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    result = closed_repair(Mesh(points=points, faces=faces))
    assert result.volume_after == pytest.approx(1 / 6, rel=1e-12)
    assert result.mesh.areas.min() > 0.1


def test_fin_and_inner_wall_go() -> None:
    cube = box(1, 1, 1)
    x = cube.vertices[:, 0]
    corners = np.flatnonzero(x > 0)
    fin = [corners[0], corners[1], len(x)]
    diagonal = np.flatnonzero(cube.vertices[:, 0] == cube.vertices[:, 1])
    low = diagonal[np.argsort(cube.vertices[diagonal, 2])]
    wall = [[low[0], low[1], low[2]], [low[1], low[3], low[2]]]
    points = np.vstack([cube.vertices, [2, 2, 2]])
    result = closed_repair(Mesh(points=points, faces=np.vstack([cube.faces, [fin], wall])))
    assert result.volume_after == pytest.approx(1, rel=1e-12)
    assert result.mesh.areas.sum() == pytest.approx(6, rel=1e-12)


def test_outward_shell_within_the_material_vanishes() -> None:
    result = closed_repair(mesh(ball(), ball(0.5)))
    assert "1 shell within the material." in result.faults
    assert result.volume_after == pytest.approx(ball().volume, rel=1e-12)


def test_cavity_and_shell_within_it() -> None:
    """Air from 0.8 to 0.4, then a loose ball."""
    result = closed_repair(mesh(ball(), inverted(ball(0.8)), ball(0.4)))
    assert result.volume_after == pytest.approx(ball().volume - ball(0.8).volume, rel=1e-12)
    assert "2 separate bodies." in result.faults


def test_of_an_inner_shell_both_volumes_are_told() -> None:
    result = closed_repair(mesh(ball(), ball(0.8)))
    told = re.search(r"volume (\S+); turned inward they would leave (\S+)\)", result.changes[0])
    assert told is not None
    solid, hollow = map(float, told.groups())
    assert solid == pytest.approx(ball().volume, rel=5e-3)
    assert hollow == pytest.approx(ball().volume - ball(0.8).volume, rel=5e-3)


def test_largest_body_is_kept_and_debris_dropped() -> None:
    crumbs = [ball(0.05, at=(3 + i, 0, 0), fine=1) for i in range(4)]
    result = closed_repair(mesh(*crumbs, ball(0.5, at=(-3, 0, 0)), ball()))
    assert result.volume_after == pytest.approx(ball().volume, rel=1e-12)
    assert "4 crumbs separate from the body, below 1 % of its volume." in result.faults
    assert any("1 other, up to 12 % of its volume" in change for change in result.changes)


def test_two_blocks_on_one_edge_are_two_bodies() -> None:
    both = trimesh.util.concatenate([box(1, 1, 1), box(2, 2, 1, at=(1.5, 1.5, 0))])
    both.merge_vertices()
    result = closed_repair(mesh(both))
    assert result.volume_after == pytest.approx(4, rel=1e-12)


# Rebuilding: faces cross


def lens(radius: float, distance: float) -> float:
    """Volume of two equal balls that overlap."""
    one = 4 / 3 * np.pi * radius**3
    return 2 * one - np.pi * (4 * radius + distance) * (2 * radius - distance) ** 2 / 12


@pytest.mark.prove
@pytest.mark.parametrize("scale", [1e-3, 100.0])
def test_two_balls_that_overlap(scale: float) -> None:
    distance = 1.3 * scale
    pair = mesh(ball(scale, fine=4), inverted(ball(scale, at=(distance, 0, 0), fine=4)))
    result = closed_repair(pair)
    assert result.volume_after == pytest.approx(lens(scale, distance), rel=0.005)
    assert result.changes[-1] == "United, each part as it is."


@pytest.mark.prove
def test_two_balls_bridged_where_they_overlap_cross_as_one_surface_and_are_rebuilt() -> None:
    first, second = ball(1.0, fine=4), ball(1.0, at=(1.3, 0, 0), fine=4)
    one, other = first.triangles_center[:, 0].argmax(), second.triangles_center[:, 0].argmin()
    a, b = first.faces[one], second.faces[other][[0, 2, 1]] + len(first.vertices)
    bridge = [[a[i], a[j], b[j]] for i, j in ((0, 1), (1, 2), (2, 0))]
    bridge += [[a[i], b[j], b[i]] for i, j in ((0, 1), (1, 2), (2, 0))]
    faces = [np.delete(first.faces, one, axis=0)]
    faces += [np.delete(second.faces, other, axis=0) + len(first.vertices), bridge]
    points = np.vstack([first.vertices, second.vertices])
    result = closed_repair(mesh(trimesh.Trimesh(points, np.vstack(faces), process=False)))
    assert result.volume_after == pytest.approx(lens(1.0, 1.3), rel=0.005)
    assert "rebuilt on a lattice of" in result.changes[-1]


@cache
def pushed_through(scale: float) -> Repair:
    rod = inverted(box(4e-4, 3e-4, 3e-3))
    return closed_repair(mesh(box(1e-3, 1e-3, 1e-3), rod).scaled(scale))


def test_rod_pushed_through_a_block() -> None:
    result = pushed_through(1.0)
    assert result.volume_after == pytest.approx(1.24e-9, rel=1e-9)
    assert result.mesh.extent == pytest.approx(3e-3, rel=1e-9)
    assert result.changes[-1] == "United, each part as it is."


def test_touching_blocks_are_one_body() -> None:
    result = closed_repair(mesh(box(1, 1, 1), box(1, 0.5, 0.5, at=(1, 0, 0))))
    assert result.volume_after == pytest.approx(1.25, rel=1e-9)


def test_a_handle_that_pierces_a_hollow_body_leaves_its_cavity() -> None:
    hollow = trimesh.util.concatenate([box(1, 1, 1), inverted(box(0.8, 0.8, 0.8))])
    result = closed_repair(mesh(hollow, box(0.2, 0.2, 0.4, at=(0, 0, 0.5))))
    assert result.volume_after == pytest.approx(1 - 0.8**3 + 0.04 * (0.4 - 0.1), rel=1e-9)


def test_halves_that_share_a_wall_are_joined_exactly() -> None:
    """The wall's faces lie back to back, so the rest is the union as it stands."""
    first, second = box(1, 1, 1), box(1, 1, 1, at=(1, 0, 0))
    second.vertices[:, 0] = 2 - (second.vertices[:, 0])
    second.vertices[:, 0] += 1 - second.vertices[:, 0].min() - 0.5
    second.invert()
    both = trimesh.util.concatenate([first, second])
    both.merge_vertices()
    result = closed_repair(mesh(both))
    assert result.volume_after == pytest.approx(2, rel=1e-9)
    assert len(result.mesh.faces) == 20


def test_four_blocks_that_share_walls_are_joined_though_a_face_is_missing() -> None:
    """The hole keeps the faces from cancelling, so the walls go as faces that repeat others."""
    both = box(1, 1, 1, at=(0.5, 0.5, 0)), box(1, 1, 1, at=(0.5, 0.5, 0))
    both[1].apply_transform(np.diag([-1, 1, 1, 1]))
    four = [*both, *(block.copy().apply_transform(np.diag([1, -1, 1, 1])) for block in both)]
    every = trimesh.util.concatenate(four)
    every.merge_vertices()
    lid = np.flatnonzero((every.triangles[:, :, 2] == 0.5).all(axis=1))[0]
    result = closed_repair(Mesh(points=every.vertices, faces=np.delete(every.faces, lid, axis=0)))
    assert result.volume_after == pytest.approx(4, rel=1e-9)
    assert len(result.mesh.faces) == 32


@pytest.mark.prove
def test_panels_with_gaps_between_them() -> None:
    """Six sides of a cube that nowhere meet: the winding number tells inside all the same."""
    cube = box(1, 1, 1)
    corners = cube.vertices[cube.faces]
    # Each panel is a side, a little smaller.
    middles = np.round(cube.face_normals) / 2
    apart = middles[:, None] + (corners - middles[:, None]) * 0.98
    panels = trimesh.Trimesh(apart.reshape(-1, 3), np.arange(36).reshape(-1, 3))
    panels.merge_vertices()
    result = closed_repair(mesh(panels))
    assert result.volume_after == pytest.approx(1, rel=0.02)
    assert "6 patches of the surface do not meet." in result.faults


# What no repair can answer


def dome() -> Mesh:
    body = ball()
    return Mesh(points=body.vertices, faces=body.faces[body.triangles_center[:, 2] > 0])


def test_open_sheet_without_a_wall() -> None:
    with pytest.raises(MeshError, match=r"open sheet: .* 3\d % of its area.*give wall=") as caught:
        repair_mesh(dome())
    assert "\n" not in str(caught.value)


def test_open_sheet_with_a_wall() -> None:
    surface = dome()
    flipped = np.arange(len(surface.faces)) % 5 == 0
    faces = np.where(flipped[:, None], surface.faces[:, ::-1], surface.faces)
    result = repair_mesh(Mesh(points=surface.points, faces=faces), wall=0.05)
    assert result.sheet
    edges = edges_of(result.mesh.faces)
    assert not edges.balance[edges.shared].any()
    assert result.volume_after == pytest.approx(0.05 * surface.areas.sum(), rel=1e-12)


def test_single_plane_takes_a_wall() -> None:
    plane = box(1, 1, 1).submesh([[0]], append=True)
    assert repair_mesh(mesh(plane), wall=0.01).sheet
    with pytest.raises(MeshError, match="give wall="):
        repair_mesh(mesh(plane))


def test_faces_back_to_back_enclose_nothing() -> None:
    surface = dome()
    back = surface.faces[:, ::-1] + len(surface.points)
    points = np.vstack([surface.points, surface.points])
    twice = Mesh(points=points, faces=np.vstack([surface.faces, back]))
    with pytest.raises(MeshError):
        repair_mesh(twice)


def test_klein_bottle() -> None:
    count = 12
    rows, columns = np.divmod(np.arange(count**2), count)
    turn = 2 * np.pi / count
    radius = 2 + np.cos(columns * turn)
    points = np.stack(
        [radius * np.cos(rows * turn), radius * np.sin(rows * turn), np.sin(columns * turn)], axis=1
    )

    def vertex(row: np.ndarray, column: np.ndarray) -> np.ndarray:
        column = np.where(row == count, -column, column)
        return (row % count) * count + column % count

    a, b = vertex(rows, columns), vertex(rows + 1, columns)
    c, d = vertex(rows + 1, columns + 1), vertex(rows, columns + 1)
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    with pytest.raises(MeshError, match="one-sided"):
        repair_mesh(Mesh(points=points, faces=faces))


@pytest.mark.prove
def test_scale_does_not_matter() -> None:
    result = pushed_through(1e-52)
    unscaled = pushed_through(1.0)
    assert result.volume_after / 1e-52**3 == pytest.approx(unscaled.volume_after, rel=1e-3)


@pytest.mark.prove
@pytest.mark.parametrize("scale", [1e-55, 1e55])
def test_scale_does_not_matter_to_balls(scale: float) -> None:
    first, second = ball(fine=2), ball(at=(1.3, 0, 0), fine=2)
    result = closed_repair(mesh(first, second).scaled(scale))
    unscaled = closed_repair(mesh(first, second))
    assert result.volume_after / scale**3 == pytest.approx(unscaled.volume_after, rel=1e-3)


def test_corner_far_away_ends_in_one_error() -> None:
    pair = mesh(ball(), box(1, 1, 1))
    points = np.array(pair.points)
    points[0, 0] = 1e30
    with pytest.raises(MeshError) as caught:
        repair_mesh(Mesh(points=points, faces=pair.faces))
    assert "\n" not in str(caught.value)


def test_thousands_of_faces_through_each_other_are_refused_soon() -> None:
    """A ball of 20,480 faces, its vertices put anywhere."""
    whole = ball(fine=5)
    points = np.random.default_rng(1).random(whole.vertices.shape)
    with pytest.raises(MeshError, match=r"too damaged: .* lies across \d+ others"):
        repair_mesh(Mesh(points=points, faces=whole.faces))


def test_faces_that_name_a_vertex_twice() -> None:
    """Of 200 points at random, so that vertices repeat within faces."""
    faces = np.random.default_rng(1).integers(0, 200, (300, 3))
    with pytest.raises(MeshError):
        repair_mesh(Mesh(points=ball(fine=3).vertices, faces=faces))


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.prove)])
def test_random_triangles_end_in_one_error(seed: int) -> None:
    points = np.random.default_rng(seed).random((150, 3))
    with pytest.raises(MeshError) as caught:
        repair_mesh(Mesh(points=points, faces=np.arange(150).reshape(-1, 3)))
    assert "\n" not in str(caught.value)


# Openings


@pytest.mark.parametrize("seed", range(5))
def test_fill_of_a_random_subset_of_faces_closes_it(seed: int) -> None:
    """Whatever is left of a ball, its faces and the fill cancel along every edge."""
    whole = ball(fine=2)
    chosen = np.random.default_rng(seed).random(len(whole.faces)) < 0.5
    part = Mesh(points=whole.vertices, faces=whole.faces[chosen])
    filled = close_openings(part)
    assert not edges_of(filled.mesh.faces).balance.any()
    assert sum(map(len, filled.rims)) == np.count_nonzero(edges_of(part.faces).balance)


def test_loops_of_a_tube() -> None:
    tube = trimesh.creation.cylinder(1.0, 2.0, sections=24)
    faces = tube.faces[np.abs(tube.face_normals[:, 2]) < 0.5]
    rims = loops(faces)
    assert [len(rim) for rim in rims] == [24, 24]
    assert {float(np.ptp(tube.vertices[rim, 2])) for rim in rims} == {0.0}


def test_more_faces_than_are_repaired_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("struck.solids.surface.repair.MAX_FACES", 1000)
    whole = mesh(trimesh.creation.icosphere(subdivisions=4))
    assert not repair_mesh(whole).faults  # one without damage may have any number
    with pytest.raises(MeshError, match=r"damaged and has 5,119 faces, and at most 1,000 are.*dec"):
        repair_mesh(Mesh(points=whole.points, faces=whole.faces[1:]))


def opened(tool: manifold3d.Manifold) -> Mesh:
    """Return the outside of a box of 0.4 x 0.3 x 0.1 m, without what a tool cuts out of it."""
    cut = (manifold3d.Manifold.cube((0.4, 0.3, 0.1), center=True) - tool).to_mesh()
    points, faces = np.array(cut.vert_properties)[:, :3], np.array(cut.tri_verts)
    middles = np.abs(points[faces].mean(axis=1)) / (0.2, 0.15, 0.05)
    return submesh(Mesh(points=points, faces=faces), np.flatnonzero(middles.max(axis=1) > 1 - 1e-5))


SOUND_HOLE = manifold3d.Manifold.cylinder(0.05, 0.045, 0.045, 48, center=True)
CUT_OUT = manifold3d.Manifold.cube((0.08, 0.05, 0.04), center=True)
BOX_AREA = 2 * (0.4 * 0.3 + 0.4 * 0.1 + 0.3 * 0.1)


@pytest.mark.parametrize(
    ("tool", "area"),
    [(SOUND_HOLE, 48 / 2 * np.sin(2 * np.pi / 48) * 0.045**2), (CUT_OUT, 0.08 * 0.05)],
)
def test_holes_that_are_meant_stay_where_there_is_a_wall(
    tool: manifold3d.Manifold, area: float
) -> None:
    box = opened(tool.translate((0.03, 0, 0.05)))
    found = repair_mesh(box, wall=0.003)
    assert found.sheet
    assert found.volume_after == pytest.approx(0.003 * (BOX_AREA - area), rel=1e-5)
    assert "1 opening up to 0.0" in " ".join(found.faults)
    assert "holes='fill' closes them" in " ".join(found.changes)
    for options in ({}, {"wall": 0.003, "holes": "fill"}):
        closed_box = repair_mesh(box, **options)
        assert not closed_box.sheet
        assert closed_box.mesh.volume == pytest.approx(0.012, rel=1e-5)


def test_ragged_holes_are_filled_and_kept_when_asked_for() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    near = np.linalg.norm(ball.triangles_center - (0, 0, 0.05), axis=1)
    chance = np.random.default_rng(0).random(len(near))
    rest = np.flatnonzero(~((near < 0.009) | ((near < 0.012) & (chance < 0.6))))
    scan = submesh(Mesh(points=ball.vertices, faces=ball.faces), rest)
    assert not repair_mesh(scan, wall=0.003).sheet
    assert repair_mesh(scan, wall=0.003, holes="keep").sheet


def test_a_tube_of_a_sheet_loses_no_rim_but_by_name() -> None:
    """An open sheet has a rim of its own; other openings are closed where that is said."""
    plate = opened(SOUND_HOLE.translate((0.03, 0, 0.05)))
    top = submesh(plate, np.flatnonzero(plate.centroids[:, 2] > 0.049))
    area = top.areas.sum()
    assert repair_mesh(top, wall=0.003).volume_after == pytest.approx(0.003 * area)
    filled = repair_mesh(top, wall=0.003, holes="fill")
    assert filled.volume_after == pytest.approx(0.003 * 0.4 * 0.3, rel=1e-5)
    assert "1 hole filled: holes='keep' leaves all open." in filled.changes

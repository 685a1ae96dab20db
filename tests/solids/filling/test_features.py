"""Crisp edges: found where they are, kept when a body is filled, none made where none are."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from struck import Mesh
from struck.solids import VolumeMesh
from struck.solids.filling.filling import Features, curve_elements, flatness
from struck.solids.lattice import cells_in
from struck.solids.surface.distance import FilledBody
from tests.physics.bodies import ball, box

TURN = Rotation.from_euler("xyz", [20, 33, 47], degrees=True)


def turned(mesh: Mesh) -> Mesh:
    return Mesh(points=TURN.apply(np.array(mesh.points)), faces=mesh.faces)


def filled(mesh: Mesh, spacing: float, *, kept: bool) -> VolumeMesh:
    body = FilledBody(mesh=mesh)
    cells = cells_in(body.depths, body.bounds, spacing)
    return curve_elements(cells, body.onto, features=Features(mesh=mesh) if kept else None)[0]


def rod(sections: int = 48) -> Mesh:
    shape = trimesh.creation.cylinder(radius=0.02, height=0.06, sections=sections)
    return Mesh(points=np.array(shape.vertices), faces=np.array(shape.faces))


def test_a_box_has_eight_corners_and_a_rod_none() -> None:
    mesh = box(0.1, 0.07, 0.05)
    found = Features(mesh=mesh).corners
    assert np.array_equal(np.unique(found, axis=0), np.unique(mesh.points, axis=0))
    assert len(Features(mesh=rod()).corners) == 0


def test_smooth_bodies_stay_as_they_are() -> None:
    mesh = ball(0.05, 4)
    kept, plain = (filled(mesh, 0.012, kept=kept) for kept in (True, False))
    assert np.array_equal(kept.nodes, plain.nodes)


@pytest.mark.prove
@pytest.mark.parametrize("mesh", [box(0.1, 0.07, 0.05), rod()], ids=["box", "rod"])
def test_most_of_the_volume_off_the_edges_comes_back(mesh: Mesh) -> None:
    mesh = turned(mesh)
    kept, plain = (filled(mesh, 0.007, kept=kept) for kept in (True, False))
    assert plain.volume() < kept.volume() < 1.001 * mesh.volume
    assert 1 - kept.volume() / mesh.volume < (1 - plain.volume() / mesh.volume) / 2
    assert np.array_equal(kept.elements, plain.elements)
    assert flatness(kept).min() > 0.02


def test_corners_of_a_turned_box_become_nodes() -> None:
    mesh = turned(box(0.1, 0.07, 0.05))
    kept, plain = (filled(mesh, 0.01, kept=kept) for kept in (True, False))
    near = KDTree(kept.nodes).query(mesh.points)[0]
    assert np.count_nonzero(near < 1e-12) >= 7
    assert np.count_nonzero(KDTree(plain.nodes).query(mesh.points)[0] < 1e-12) == 0

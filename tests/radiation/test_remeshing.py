"""Remeshing keeps the body: closed, as large, its ridges where they were, and even triangles."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from struck.model.mesh import Mesh
from struck.radiation.boundary_elements import Walls, edge_length
from struck.radiation.remeshing import remesh
from tests.radiation import bodies

BODIES = {
    "ball": (lambda: bodies.ball(1.0, 3), 0.3),
    "cube of twelve triangles": (lambda: bodies.box((1, 1, 1), (1, 1, 1)), 0.2),
    "fine cube": (lambda: bodies.box((1, 1, 1), (8, 8, 8)), 0.25),
    "plate": (lambda: bodies.box((0.2, 0.2, 0.006), (12, 12, 1)), 0.03),
    "tube": (lambda: bodies.tube(0.02, 0.004, 0.1, 24, 20), 0.01),
}


@pytest.mark.parametrize("name", BODIES)
def test_a_body_stays_what_it_is(name: str) -> None:
    make, edge = BODIES[name]
    mesh = make()
    made = remesh(mesh, edge, float(np.nanmin(Walls.of(mesh).depths)))
    before, after = (trimesh.Trimesh(each.points, each.faces) for each in (mesh, made))
    assert after.is_watertight
    assert after.is_winding_consistent
    assert after.euler_number == before.euler_number
    np.testing.assert_allclose(made.volume, mesh.volume, rtol=2e-3)
    np.testing.assert_allclose(made.bounds, mesh.bounds, atol=0.05 * edge)
    # The fine cube's own edges, 0.125, allow 0.25 or 0.375.
    assert 0.7 < edge_length(made) / edge < (1.25 if name == "fine cube" else 1.2)


def test_edges_of_a_cube_stay_sharp() -> None:
    made = remesh(bodies.box((1, 1, 1), (8, 8, 8)), 0.25, 1.0)
    assert np.allclose(np.abs(made.face_normals).max(axis=1), 1, atol=1e-9)


def test_elements_are_no_slivers() -> None:
    made: Mesh = remesh(bodies.ball(1.0, 3), 0.3, 1.0)
    corners = made.points[made.faces]
    squares = np.square(corners - np.roll(corners, 1, axis=1)).sum(axis=(1, 2))
    assert (4 * 3**0.5 * made.areas / squares).min() > 0.3  # 1 for an equilateral triangle

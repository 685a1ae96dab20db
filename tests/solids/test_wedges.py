"""One layer of wedges: both faces of the wall where they belong, and the exact volume."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from struck import Mesh
from struck.solids.curving import flatness
from struck.solids.distance import Body
from struck.solids.wedges import layered
from tests.physics.bodies import ball

RADIUS = 0.05
WALL = 0.002


def test_a_wall_of_a_sphere() -> None:
    mesh, short = layered(Body(mesh=ball(RADIUS), wall=WALL), WALL, 0.011)
    assert mesh.kind == "wedge15"
    assert short == 0
    assert flatness(mesh).min() > 0.3
    corners = np.unique(mesh.corners)
    radii = np.linalg.norm(mesh.nodes[corners], axis=1)
    outside = radii > RADIUS - WALL / 2
    assert np.count_nonzero(outside) == len(corners) // 2
    # The sphere is a polyhedron of triangles 3 mm long: up to 2e-5 m from it.
    assert radii[outside] == pytest.approx(RADIUS, abs=3e-5)
    assert radii[~outside] == pytest.approx(RADIUS - WALL, abs=3e-5)
    exact = 4 / 3 * np.pi * (RADIUS**3 - (RADIUS - WALL) ** 3)
    assert mesh.volume() == pytest.approx(exact, rel=1e-3)


def test_walls_of_a_ring_have_the_wanted_thickness() -> None:
    ring = trimesh.creation.torus(0.05, 0.02, major_sections=192, minor_sections=96)
    body = Body(mesh=Mesh(points=ring.vertices, faces=ring.faces, up="y"), wall=WALL)
    mesh, short = layered(body, WALL, 0.008)
    assert mesh.up == "y"
    assert short == 0
    count = mesh.corners.shape[1] // 2
    through = mesh.nodes[mesh.corners[:, :count]] - mesh.nodes[mesh.corners[:, count:]]
    assert np.linalg.norm(through, axis=2) == pytest.approx(WALL, rel=0.01)
    exact = 2 * np.pi**2 * 0.05 * (0.02**2 - (0.02 - WALL) ** 2)
    assert mesh.volume() == pytest.approx(exact, rel=3e-3)
    surface, _ = mesh.surface()
    assert np.ptp(surface.bounds[:, 2]) == pytest.approx(0.04, rel=1e-3)

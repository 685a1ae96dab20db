"""Surfaces from a lattice against closed forms, the inside against winding numbers."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray

from struck.model.mesh import Mesh
from struck.solids.lattice import Lattice
from struck.solids.surface.closedness import INSIDE_WINDING, winding
from struck.solids.surface.rebuilding import find_inside, isosurface

BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])


def heights(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return heights above a ball of radius 0.9."""
    return np.linalg.norm(points, axis=1) - 0.9


def every_point(lattice: Lattice) -> NDArray[np.float64]:
    count = np.prod(lattice.counts + 1) + np.prod(lattice.counts)
    return lattice.positions(np.arange(count))


@pytest.mark.parametrize("moved", [True, False])
def test_surface_of_a_ball(*, moved: bool) -> None:
    """Closed, turned outward, of one piece without handles, and its points on the ball."""
    lattice = Lattice.cover(BOX, 0.1)
    within = heights(every_point(lattice)) < 0
    found = isosurface(lattice, within, lambda p: np.abs(heights(p)), moved=moved)
    assert found is not None
    judge = trimesh.Trimesh(found.points, found.faces, process=False)
    assert judge.is_watertight
    assert judge.is_winding_consistent
    assert judge.euler_number == 2
    assert judge.volume == pytest.approx(4 / 3 * np.pi * 0.9**3, rel=0.01 if moved else 0.02)
    assert np.abs(heights(found.points)).max() < (0.004 if moved else 0.02)


def test_moved_points_leave_no_needles() -> None:
    """Labelle & Shewchuk's bound on dihedral angles keeps triangles above some 10 degrees."""
    lattice = Lattice.cover(BOX, 0.1)
    within = heights(every_point(lattice)) < 0
    found = isosurface(lattice, within, lambda p: np.abs(heights(p)))
    assert found is not None
    judge = trimesh.Trimesh(found.points, found.faces, process=False)
    assert np.rad2deg(judge.face_angles.min()) > 10


def test_unmoved_surface_is_closed_for_any_signs() -> None:
    """Random signs meet in edges and corners everywhere."""
    lattice = Lattice.cover(BOX, 0.25)
    points = every_point(lattice)
    deep = np.abs(points).max(axis=1) < 1.1
    within = deep & (np.random.default_rng(1).random(len(points)) < 0.4)
    found = isosurface(lattice, within, lambda p: np.full(len(p), 0.1), moved=False)
    assert found is not None
    judge = trimesh.Trimesh(found.points, found.faces, process=False)
    assert judge.is_watertight
    assert judge.is_winding_consistent


def test_nothing_inside() -> None:
    lattice = Lattice.cover(BOX, 0.5)
    none = np.zeros(len(every_point(lattice)), bool)
    assert isosurface(lattice, none, lambda p: np.abs(heights(p))) is None


@pytest.mark.parametrize("rims", [False, True])
@pytest.mark.parametrize("seed", [0, *(pytest.param(s, marks=pytest.mark.prove) for s in (1, 2))])
def test_inside_is_where_the_surface_winds(seed: int, *, rims: bool) -> None:
    """Balls and slabs that overlap, some inside out: as every point on its own would tell."""
    rng = np.random.default_rng(seed)
    bodies = [trimesh.creation.icosphere(2, r) for r in rng.uniform(0.1, 0.5, 5)]
    bodies += [trimesh.creation.box(size) for size in rng.uniform(0.02, 1.0, (5, 3))]
    for number, body in enumerate(bodies):
        body.apply_translation(rng.uniform(-0.5, 0.5, 3))
        if number % 5 == 4:
            body.invert()
    all_of_them = trimesh.util.concatenate(bodies)
    faces = all_of_them.faces[rng.random(len(all_of_them.faces)) < 0.9 if rims else slice(None)]
    mesh = Mesh(points=all_of_them.vertices, faces=faces)
    lattice = Lattice.cover(mesh.bounds, 0.06)
    expected = winding(mesh, every_point(lattice))
    clear = np.abs(expected - INSIDE_WINDING) > 0.05
    assert 0.05 < np.mean(expected > INSIDE_WINDING) < 0.95
    assert np.array_equal(find_inside(mesh, lattice)[clear], (expected > INSIDE_WINDING)[clear])

"""Stuffed bodies: volume, shape, gaps, and edges that do not lie on the lattice."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from struck import Mesh
from struck.errors import MeshError
from struck.solids import Extrusion, VolumeMesh
from struck.solids.fem.vibration import vibration_modes
from struck.solids.filling.filling import curve_elements, fill_body, piece_count
from struck.solids.lattice import Cells, cells_in, stuff_body
from struck.solids.surface.distance import FilledBody
from tests.physics.bodies import ALUMINIUM, ball, box, bumpy
from tests.solids.shapes import dihedral_angles, face_counts, volumes

TURN = Rotation.from_euler("xyz", [20, 33, 47], degrees=True)
# Outlines of an angle section and of a block with a slot 2 mm wide, m.
ANGLE = [(0, 0), (0.06, 0), (0.06, 0.02), (0.02, 0.02), (0.02, 0.08), (0, 0.08)]
LEFT, RIGHT, FLOOR = 0.019, 0.021, 0.01
SLOTTED = [(0, 0), (0.04, 0), (0.04, 0.03), (RIGHT, 0.03)]
SLOTTED += [(RIGHT, FLOOR), (LEFT, FLOOR), (LEFT, 0.03), (0, 0.03)]


def turned(points: np.ndarray) -> np.ndarray:
    return TURN.apply(np.array(points))


def surface_of(solid: Extrusion) -> Mesh:
    """Return the solid's surface, turned so that nothing lies along the lattice."""
    surface, _ = solid.volume_mesh("preview").surface()
    return Mesh(points=turned(surface.points), faces=surface.faces)


def filled_points(mesh: VolumeMesh, points: np.ndarray) -> np.ndarray:
    """Tell which points lie in any element, taken as straight-sided."""
    corners = mesh.nodes[mesh.elements[:, :4]]
    inverse = np.linalg.inv((corners[:, 1:] - corners[:, :1]).transpose(0, 2, 1))
    shares = np.einsum("tij,ptj->pti", inverse, points[:, None] - corners[:, 0])
    return ((shares.min(axis=2) > 0) & (shares.sum(axis=2) < 1)).any(axis=1)


def cells_of(mesh: Mesh, wall: float | None, spacing: float, halved: int = 0) -> Cells:
    body = FilledBody(mesh=mesh, wall=wall)
    return cells_in(body.depths, body.bounds, spacing, max_halvings=halved)


@pytest.mark.prove
def test_a_turned_angle_vibrates_as_one_of_hexahedra() -> None:
    solid = Extrusion(outline=ANGLE, height=0.05)
    filling = fill_body(FilledBody(mesh=surface_of(solid)), "standard")
    assert filling.mesh.volume() == pytest.approx(solid.volume, rel=5e-3)
    # Themselves up to 0.12 % above those of four times as many hexahedra.
    expected = vibration_modes(solid.volume_mesh("standard"), ALUMINIUM, 23e3).frequencies
    found = vibration_modes(filling.mesh, ALUMINIUM, 23e3).frequencies
    assert len(expected) == 5
    assert found == pytest.approx(expected, rel=5e-3)


@pytest.mark.prove
def test_a_slot_narrower_than_the_lattice_stays_open() -> None:
    solid = Extrusion(outline=SLOTTED, height=0.03)
    filling = fill_body(FilledBody(mesh=surface_of(solid)), "standard")
    assert filling.spacing > RIGHT - LEFT
    assert filling.mesh.volume() == pytest.approx(solid.volume, rel=1e-2)
    across, along = np.meshgrid(np.linspace(0.012, 0.029, 9), np.linspace(0.002, 0.028, 9))
    middle = np.full(across.size, (LEFT + RIGHT) / 2)
    slot = np.stack([middle, across.ravel(), along.ravel()], axis=1)
    beside = slot + np.array([0.004, 0.0, 0.0])
    assert not filled_points(filling.mesh, turned(slot)).any()
    assert filled_points(filling.mesh, turned(beside)).all()


def two_balls(points: np.ndarray) -> np.ndarray:
    """Two balls of radius 1, two fifths of the spacing apart."""
    way = np.array([[1.08, 0.07, 0.11]])
    centres = np.vstack([-way, way]) * 1.08 / np.linalg.norm(way)
    return (np.linalg.norm(points[:, None] - centres, axis=2) - 1.0).min(axis=1)


def test_two_balls_near_each_other_stay_two() -> None:
    bounds = np.array([[-2.3, -1.2, -1.2], [2.3, 1.2, 1.2]])
    cells = cells_in(two_balls, bounds, 0.4, max_halvings=20_000)
    mesh = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4")
    _, counts = face_counts(cells.tetrahedra)
    assert set(counts) == {1, 2}
    assert piece_count(mesh) == 2
    assert mesh.volume() == pytest.approx(8 / 3 * np.pi, rel=0.06)


@pytest.mark.parametrize("spacing", [0.012, 0.01])
def test_volume_of_a_ball_converges_quadratically(spacing: float) -> None:
    def depths(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points, axis=1) - 0.05

    bounds = np.array([[-0.05] * 3, [0.05] * 3])
    coarse, fine = (
        stuff_body(depths, bounds, h).volume() / (4 / 3 * np.pi * 0.05**3) - 1
        for h in (spacing, spacing / 2)
    )
    assert coarse < fine < 0  # chords lie inside
    assert np.log2(coarse / fine) == pytest.approx(2, abs=0.3)


@pytest.mark.parametrize(
    ("mesh", "wall", "spacing"),
    [
        (ball(0.05, 4), None, 0.012),
        (ball(0.05, 4), 0.008, 0.006),
        (bumpy(1), None, 0.011),
        (bumpy(2), 0.006, 0.0045),
        (box(0.1, 0.07, 0.05), None, 0.012),
    ],
)
def test_no_dihedral_angle_is_sharp(mesh: Mesh, wall: float | None, spacing: float) -> None:
    cells = cells_of(mesh, wall, spacing)
    angles = dihedral_angles(cells.points, cells.tetrahedra)
    # What Labelle & Shewchuk (2007) prove for a cut lattice with these shares.
    assert angles.min() > 10.7
    assert angles.max() < 164.8
    assert (volumes(cells.points, cells.tetrahedra) > 0).all()


def test_refined_and_curved_shapes_are_bounded() -> None:
    body = FilledBody(mesh=bumpy(3), wall=0.004)
    cells = cells_in(body.depths, body.bounds, 0.012, max_halvings=3000)
    angles = dihedral_angles(cells.points, cells.tetrahedra)
    mesh, short = curve_elements(cells, body.onto)
    moved = dihedral_angles(mesh.nodes, mesh.corners)
    assert short < 0.05 * len(mesh.nodes)
    assert np.percentile(angles, 1) > 12
    assert np.percentile(moved, 1) > 10
    assert np.percentile(moved, 99) < 155


def test_a_body_between_the_lattice_points_is_refused() -> None:
    def depths(points: np.ndarray) -> np.ndarray:
        return np.linalg.norm(points - 0.251, axis=1) - 1e-6

    with pytest.raises(MeshError, match="no point of a lattice of 1 m lies in the body"):
        cells_in(depths, np.array([[0.0] * 3, [1.0] * 3]), 1.0)

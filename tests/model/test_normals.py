"""Normals at contacts: of the true surface where it is curved, of the face where it is not."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from numpy.typing import ArrayLike

from struck import Mesh
from struck.model.arrays import Array
from struck.model.contact import Contact
from struck.perception.sonic_distance import contacts_over
from struck.solids import Block, Tube


def turned(normals: Array, true: ArrayLike) -> float:
    """Return by how much normals (K, 3) turn from those of the true surface at most, degrees."""
    wanted = np.asarray(true) / np.linalg.norm(true, axis=-1, keepdims=True)
    return float(np.rad2deg(np.linalg.norm(np.cross(normals, wanted), axis=1).max()))


def touched(mesh: Mesh, count: int = 500) -> tuple[Array, Array, Array]:
    """Return contacts all over a surface (K, 3), and smoothed and unsmoothed normals there."""
    points, inward = contacts_over(mesh, count)
    _, faces, nearest = mesh.locator.closest(points)
    return points, mesh.normals_at(faces, nearest), -inward


def test_a_tube_is_pushed_radially() -> None:
    tube = Tube(length=0.5, radius=0.012, wall=0.001)
    mesh = tube.volume_mesh("preview").surface()[0]
    points, normals, faceted = touched(mesh)
    radii = np.hypot(points[:, 0], points[:, 1])
    for wall, sign in ((radii > 0.0117, 1), (radii < 0.0113, -1)):
        inside = wall & (np.abs(faceted[:, 2]) < 0.5)
        true = sign * points[inside] * [1, 1, 0]
        assert turned(faceted[inside], true) > 2
        assert turned(normals[inside], true) < 0.2
    ends = np.abs(faceted[:, 2]) > 0.9
    np.testing.assert_array_equal(normals[ends], faceted[ends])
    end = Contact.on(mesh.locator, mesh, tube.places["end"])
    assert turned(end.normal[None], (end.point * [1, 1, 0])[None]) < 0.2


@pytest.mark.parametrize("subdivisions", [2, 4])
def test_a_sphere_is_pushed_to_its_middle(subdivisions: int) -> None:
    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=0.03)
    points, normals, faceted = touched(Mesh(points=ball.vertices, faces=ball.faces))
    assert turned(faceted, points) > 1
    assert turned(normals, points) < 0.2


def test_faces_of_a_block_stay_and_chamfers_too() -> None:
    block = Block(size=(0.1, 0.05, 0.03), elements=(4, 3, 2))
    _, normals, faceted = touched(block.volume_mesh().surface()[0])
    np.testing.assert_array_equal(normals, faceted)
    bar = trimesh.creation.cylinder(radius=0.01, height=0.1, sections=8)  # its faces turn by 45
    _, normals, faceted = touched(Mesh(points=bar.vertices, faces=bar.faces))
    np.testing.assert_array_equal(normals, faceted)


def test_no_jump_where_a_contact_moves_about_a_tube() -> None:
    can = trimesh.creation.cylinder(radius=0.01, height=0.1, sections=20)
    mesh = Mesh(points=can.vertices, faces=can.faces)
    angle = np.linspace(0, np.pi, 721)
    around = 0.01 * np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    _, faces, nearest = mesh.locator.closest(around)
    normals = mesh.normals_at(faces, nearest)
    assert turned(normals, around) < 0.2
    steps = np.linalg.norm(np.diff(normals, axis=0), axis=1)
    assert steps.max() < 1.2 * np.deg2rad(0.25)

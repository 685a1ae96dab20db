"""A Moebius strip with a wall: a body of one face, against hexahedra laid around it."""

from __future__ import annotations

import numpy as np
import pytest

import struck
from struck.errors import MeshError, RepairWarning
from struck.model.mesh import Mesh
from struck.solids.fem.vibration import vibration_modes
from struck.solids.filling.thin_walls import add_both_faces
from struck.solids.hexahedra import divide_breaks, lattice, merge_meshes, stack_layers
from struck.solids.surface.closedness import require_closed
from struck.solids.surface.distance import WalledSheet
from struck.solids.volume_mesh import VolumeMesh
from tests.physics.bodies import ALUMINIUM, Array

RADIUS, WIDTH, WALL = 0.05, 0.04, 0.004


def around(turn: Array, across: Array, above: Array) -> Array:
    """Return points so far across the strip's middle line, m, and above its face, m (N, 3)."""
    out = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    up = np.array([0.0, 0.0, 1.0])
    tilt = turn[:, None] / 2
    side = np.cos(tilt) * out + np.sin(tilt) * up
    along = np.cross(up, out)
    turning = (np.cos(tilt) * up - np.sin(tilt) * out) / 2 + np.cos(tilt) * along
    slope = RADIUS * along + across[:, None] * turning
    normal = np.cross(slope, side)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return RADIUS * out + across[:, None] * side + above[:, None] * normal


def strip(length: int = 120, width: int = 14) -> Mesh:
    turns = 2 * np.pi * np.arange(length) / length
    places = np.linspace(-WIDTH / 2, WIDTH / 2, width + 1)
    grid = (each.ravel() for each in np.meshgrid(turns, places, indexing="ij"))
    points = around(*grid, above=np.zeros(length * (width + 1)))
    row, column = (each.ravel() for each in np.indices((length, width)))

    def vertex(row: Array, column: Array) -> Array:
        return (row % length) * (width + 1) + np.where(row < length, column, width - column)

    a, b = vertex(row, column), vertex(row + 1, column)
    c, d = vertex(row + 1, column + 1), vertex(row, column + 1)
    return Mesh(points=points, faces=np.vstack([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))


def hexahedra(length: int, width: int) -> VolumeMesh:
    whole = np.array([-0.5, 0.5])
    nodes, cells = stack_layers(
        lattice(
            divide_breaks(np.pi * (1 + 2 * whole), length), divide_breaks(WIDTH * whole, width)
        ),
        divide_breaks(WALL * whole, 1),
    )
    nodes, cells = merge_meshes([around(*nodes.T)], [cells])
    return VolumeMesh(nodes=nodes, elements=cells, kind="hex20")


def test_its_wall_has_one_face_that_is_closed() -> None:
    sheet = strip()
    body = add_both_faces(WalledSheet(mesh=sheet, wall=WALL))
    assert body is not None
    require_closed(body.mesh)
    assert body.mesh.volume == pytest.approx(hexahedra(40, 4).volume(), rel=3e-3)
    # Once around on one face leads to the other: together they have twice the strip's area.
    rim = 2 * WALL * np.linalg.norm(np.diff(around(*_rim()), axis=0), axis=1).sum()
    assert body.mesh.areas.sum() == pytest.approx(2 * sheet.areas.sum() + rim / 2, rel=5e-3)


def _rim() -> tuple[Array, Array, Array]:
    turn = np.linspace(0, 4 * np.pi, 1000)
    return turn, np.full(1000, WIDTH / 2), np.zeros(1000)


def test_a_wall_that_crosses_itself_is_refused() -> None:
    with pytest.raises(MeshError, match=r"crosses itself: give less wall="):
        add_both_faces(WalledSheet(mesh=strip(), wall=0.2))


@pytest.mark.prove
def test_it_rings_as_hexahedra_do() -> None:
    band = (20.0, 6_000.0)
    with pytest.warns(RepairWarning, match="one side, as a Moebius strip has"):
        model = struck.analyze(strip(), ALUMINIUM, wall=WALL, band=band, accuracy="preview")
    hexes = vibration_modes(hexahedra(64, 8), ALUMINIUM, band[1]).frequencies
    coarser = vibration_modes(hexahedra(40, 5), ALUMINIUM, 1.05 * band[1]).frequencies
    assert coarser[: len(hexes)] == pytest.approx(hexes, rel=2e-3)
    assert len(hexes) >= 8
    off = np.abs(model.natural_frequencies[: len(hexes)] / hexes - 1)
    assert off.max() <= 0.03
    assert np.mean(off <= model.errors[: len(hexes)] + 2e-3) >= 0.9

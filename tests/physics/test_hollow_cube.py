"""The hollow block of O'Brien et al. 2002: by both faces, by its wall, and by hexahedra."""

from __future__ import annotations

import numpy as np
import pytest

import struck
from struck.model.mesh import Mesh
from struck.model.model import ModalModel
from struck.solids.fem.vibration import vibration_modes
from struck.solids.filling.filling import fill_body
from struck.solids.hexahedra import lattice, stack_layers
from struck.solids.surface.distance import FilledBody
from struck.solids.volume_mesh import VolumeMesh
from tests.physics import everyday
from tests.physics.bodies import ALUMINIUM

EDGE, WALL = 0.05, 0.0025
VOLUME = EDGE**3 - (EDGE - 2 * WALL) ** 3
BAND = (20.0, 9_000.0)


def outside() -> Mesh:
    block = struck.solids.Block(size=(EDGE, EDGE, EDGE), elements=(1, 1, 1)).volume_mesh()
    return block.surface()[0]


def hexahedra(along: int, through: int) -> VolumeMesh:
    """Return a lattice on the cube without those of its inside, finer toward inner edges."""
    shares = np.linspace(-1, 1, 2 * along + 1)
    inner = np.sign(shares) * (1 - (1 - np.abs(shares)) ** 1.6) * (EDGE / 2 - WALL)
    wall = np.linspace(EDGE / 2 - WALL, EDGE / 2, 2 * through + 1)
    levels = np.concatenate([-wall[:0:-1], inner, wall[1:]])
    nodes, elements = stack_layers(lattice(levels, levels), levels)
    middles = np.abs(nodes[elements[:, :8]].mean(axis=1)).max(axis=1)
    used, numbers = np.unique(elements[middles > EDGE / 2 - WALL], return_inverse=True)
    return VolumeMesh(nodes=nodes[used], elements=numbers.reshape(-1, 20), kind="hex20")


def analyzed(accuracy: str) -> ModalModel:
    return struck.analyze(outside(), ALUMINIUM, wall=WALL, band=BAND, accuracy=accuracy)


def test_one_face_with_a_wall_is_the_body_of_both_faces() -> None:
    one = fill_body(FilledBody(mesh=outside(), wall=WALL), "preview").mesh
    both = fill_body(FilledBody(mesh=everyday.hollow_cube()), "preview").mesh
    assert one.cubic
    assert len(one.elements) == pytest.approx(len(both.elements), rel=0.05)
    for mesh in (one, both):
        assert mesh.volume() == pytest.approx(VOLUME, rel=1e-5)


@pytest.mark.prove
@pytest.mark.parametrize(("accuracy", "off"), [("preview", 0.015), ("standard", 0.007)])
def test_it_rings_as_hexahedra_do(accuracy: str, off: float) -> None:
    """Whose frequencies still sink, as inner edges are singular."""
    hexes = hexahedra(*((6, 1) if accuracy == "preview" else (10, 2)))
    finer = vibration_modes(hexes, ALUMINIUM, BAND[1]).frequencies
    model = analyzed(accuracy)
    count = min(len(finer), len(model.frequencies))
    assert count >= 5
    np.testing.assert_allclose(model.frequencies[:count], finer[:count], rtol=off)
    assert model.mass == pytest.approx(ALUMINIUM.density * VOLUME, rel=0.01)
    # Across a wall both of its faces move alike: it sounds as struck when it is struck from inside.
    places = np.array([(0.004, 0.007, EDGE / 2), (0.004, 0.007, EDGE / 2 - WALL)])
    outer, inner = np.abs(model.gains.shapes_at(places)[:, 2])
    loud = outer > 0.1 * outer.max()
    np.testing.assert_allclose(inner[loud], outer[loud], rtol=0.02)


@pytest.mark.prove
def test_both_faces_and_the_wall_agree_at_standard() -> None:
    both = struck.analyze(everyday.hollow_cube(), ALUMINIUM, band=BAND)
    np.testing.assert_allclose(analyzed("standard").frequencies, both.frequencies, rtol=0.005)

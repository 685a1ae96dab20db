"""Volume meshes: quadratic nodes, boundary, volume, refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from struck.errors import MeshError
from struck.solids import Tube, VolumeMesh
from struck.solids.surface.closedness import is_closed
from tests.physics.bodies import distorted, grid

KINDS = ["tet4", "hex8", "wedge6"]
SIZE = (1.0, 2.0, 3.0)


@pytest.mark.parametrize("kind", KINDS)
def test_promotion_adds_one_node_an_edge(kind: str) -> None:
    mesh = grid(kind, (2, 3, 4), SIZE)
    quadratic = mesh.promoted()
    edges = {
        frozenset((int(element[a]), int(element[b])))
        for element in mesh.elements
        for a, b in quadratic.element.edges
    }
    assert len(quadratic.nodes) == len(mesh.nodes) + len(edges)
    assert np.array_equal(quadratic.corners, mesh.elements)
    assert np.array_equal(quadratic.nodes[: len(mesh.nodes)], mesh.nodes)
    assert quadratic.straight().all()
    assert quadratic.promoted() is quadratic


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("quadratic", [False, True])
def test_boundary_is_that_of_the_box(kind: str, quadratic: bool) -> None:  # noqa: FBT001
    mesh = distorted(grid(kind, (3, 3, 3), SIZE), 0.2)
    mesh = mesh.promoted() if quadratic else mesh
    surface, numbers = mesh.surface()
    assert is_closed(surface)
    assert surface.volume == pytest.approx(6.0, rel=1e-12)
    assert mesh.volume() == pytest.approx(6.0, rel=1e-12)
    assert surface.areas.sum() == pytest.approx(22.0, rel=1e-12)
    assert np.array_equal(surface.points, mesh.nodes[numbers])
    on_a_face = (np.isclose(mesh.nodes, 0) | np.isclose(mesh.nodes, SIZE)).any(axis=1)
    assert np.array_equal(np.sort(numbers), np.flatnonzero(on_a_face))


def test_one_moved_middle_makes_its_elements_curved() -> None:
    mesh = grid("tet4", (2, 2, 2)).promoted()
    middle = mesh.elements[7, 5]
    nodes = mesh.nodes.copy()
    nodes[middle] += [1e-6, 0, 0]
    curved = ~replace(mesh, nodes=nodes).straight()
    assert np.array_equal(curved, (mesh.elements == middle).any(axis=1))
    assert curved[7]


def test_jacobians_are_those_of_an_affine_map() -> None:
    turn = np.array([[2.0, 0.3, 0.0], [0.1, 1.0, -0.2], [0.0, 0.4, 0.5]])
    mesh = grid("hex8", (1, 1, 1)).promoted()
    moved = replace(mesh, nodes=mesh.nodes @ turn.T + 5.0)
    jacobians = moved.jacobians(np.array([[0.2, 0.7, 0.4], [0.5, 0.1, 0.9]]))
    assert jacobians == pytest.approx(np.broadcast_to(turn, (1, 2, 3, 3)), abs=1e-12)


def test_volume_of_curved_elements_converges_to_the_tubes() -> None:
    errors = []
    for around in (8, 16, 32):
        tube = Tube(length=0.2, radius=0.03, wall=0.01, elements=(around, 3, 1))
        errors.append(abs(tube.volume_mesh().volume() / tube.volume - 1))
    orders = -np.diff(np.log2(errors))
    assert orders == pytest.approx([4, 4], abs=0.1)  # parabolas instead of arcs


def test_chunks_cover_the_elements_once() -> None:
    mesh = grid("tet4", (3, 3, 3))
    numbers = np.arange(len(mesh.elements))
    parts = [numbers[chunk] for chunk in mesh.chunks(50)]
    assert [len(part) for part in parts] == [50, 50, 50, 12]
    assert np.array_equal(np.concatenate(parts), numbers)


@pytest.mark.parametrize(
    ("kind", "elements", "message"),
    [
        ("tet5", [[0, 1, 2, 3]], "elements of kind 'tet5' are unknown"),
        ("tet4", [[0, 1, 2]], r"tet4 elements have shape \(1, 3\), not \(E, 4\)"),
        ("tet4", np.zeros((0, 4)), r"tet4 elements have shape \(0, 4\)"),
        ("tet4", [[0, 1, 2, 4]], "elements name nodes outside 0 to 3"),
        ("tet4", [[0, 1, 2, -1]], "elements name nodes outside 0 to 3"),
    ],
)
def test_impossible_meshes_are_refused(kind: str, elements: list, message: str) -> None:
    nodes = np.vstack([np.zeros(3), np.eye(3)])
    with pytest.raises(MeshError, match=message):
        VolumeMesh(nodes=nodes, elements=np.array(elements, dtype=np.int64), kind=kind)

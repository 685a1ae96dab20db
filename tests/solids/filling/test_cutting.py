"""Cut tetrahedra: both sides add up, plane cuts of a box are exact, neighbours still fit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from struck.solids.lattice import Cells
from struck.solids.volume_mesh import VolumeMesh
from tests.physics.bodies import distorted, grid
from tests.solids.shapes import face_counts, volumes

SIZE = (1.0, 2.0, 3.0)


def cells_of(mesh: VolumeMesh, *depths: np.ndarray) -> Cells:
    return Cells(points=mesh.nodes, depths=np.stack(depths, axis=1), tetrahedra=mesh.elements)


def volume(cells: Cells) -> float:
    return float(np.abs(volumes(cells.points, cells.tetrahedra)).sum())


@pytest.fixture
def box() -> VolumeMesh:
    return distorted(grid("tet4", (3, 4, 5), SIZE), 0.2)


@pytest.mark.parametrize("seed", range(5))
def test_inside_and_outside_add_up(box: VolumeMesh, seed: int) -> None:
    depths = np.random.default_rng(seed).normal(size=len(box.nodes))
    # Some corners on the surface itself: every way to cut a tetrahedron occurs.
    depths[::4] = 0.0
    inside, outside = (cells_of(box, sign * depths).cut_at(0) for sign in (1, -1))
    flat = (depths[box.elements] == 0).all(axis=1)
    on_it = np.abs(volumes(box.nodes, box.elements[flat])).sum()
    assert volume(inside) + volume(outside) + on_it == pytest.approx(6.0, rel=1e-12)
    assert 0.2 < volume(inside) / 6 < 0.8


@pytest.mark.parametrize("height", [0.4, 1.0, 1.5, 2.9])
def test_a_level_cut_of_a_box_is_a_box(box: VolumeMesh, height: float) -> None:
    cut = cells_of(box, box.nodes[:, 2] - height).cut_at(0).compact()
    assert volume(cut) == pytest.approx(2.0 * height, rel=1e-12)
    assert cut.points.max(axis=0) == pytest.approx([1.0, 2.0, height], abs=1e-12)


def test_a_corner_cut_off_is_a_pyramid(box: VolumeMesh) -> None:
    # x/a + y/b + z/c < 1 holds a volume of abc/6.
    depths = box.nodes @ (1 / np.array([0.8, 1.5, 2.2])) - 1
    assert volume(cells_of(box, depths).cut_at(0)) == pytest.approx(0.8 * 1.5 * 2.2 / 6, rel=1e-12)


def test_two_cuts_leave_a_slab_thinner_than_the_elements(box: VolumeMesh) -> None:
    along = box.nodes @ np.array([0.6, 0.8, 0.0]) - 1.0
    cells = cells_of(box, along - 0.005, -along - 0.005).cut_at(0).cut_at(1).compact()
    # The line 0.6 x + 0.8 y = d crosses the rectangle from x = 0 to x = 1: 1 / 0.8 long.
    assert volume(cells) == pytest.approx(0.01 * (1 / 0.8) * 3.0, rel=1e-9)
    assert np.abs(cells.points @ np.array([0.6, 0.8, 0.0]) - 1.0).max() < 0.005 + 1e-12


@pytest.mark.parametrize("seed", range(3))
def test_cut_neighbours_share_whole_faces(box: VolumeMesh, seed: int) -> None:
    # Where the surface does not reach: only the cut itself may be open, and it is one closed cap.
    random = np.random.default_rng(seed)
    depths = np.linalg.norm(box.nodes - [0.5, 1.0, 1.5], axis=1) - 0.45
    depths *= 1 + 0.1 * random.uniform(size=len(depths))
    cut = cells_of(box, depths).cut_at(0)
    faces, counts = face_counts(cut.tetrahedra)
    assert set(counts) == {1, 2}
    outer = faces[counts == 1]
    assert (cut.depths[outer, 0] == 0).all()
    edges = np.vstack([outer[:, [0, 1]], outer[:, [1, 2]], outer[:, [0, 2]]])
    assert set(np.unique(edges, axis=0, return_counts=True)[1]) == {2}


def test_crossings_lie_where_a_linear_function_vanishes(box: VolumeMesh) -> None:
    depths = box.nodes @ np.array([0.3, -0.5, 0.7]) - 0.4
    other = box.nodes[:, 0] ** 2
    cells = cells_of(box, depths, other)
    found = cells.crossings(0, cells.edges())
    assert len(found.edges) > 50
    assert found.points @ np.array([0.3, -0.5, 0.7]) == pytest.approx(0.4, abs=1e-12)
    assert (found.depths[:, 0] == 0).all()
    first, second = other[found.edges].T
    assert found.depths[:, 1] == pytest.approx(first + found.fractions * (second - first))


def test_each_edge_counts_once() -> None:
    mesh = grid("tet4", (2, 3, 4))
    edges = cells_of(mesh, np.zeros(len(mesh.nodes))).edges()
    assert len(edges) == len({frozenset(edge) for edge in edges.tolist()})
    # Euler: a box has V - E + F - T = 1.
    faces, _ = face_counts(mesh.elements)
    assert len(mesh.nodes) - len(edges) + len(faces) - len(mesh.elements) == 1


def test_compact_turns_drops_and_renumbers(box: VolumeMesh) -> None:
    turned = box.elements.copy()
    turned[::2] = turned[::2][:, [1, 0, 2, 3]]
    flat = np.array([[0, 0, 1, 2]])
    cells = cells_of(box, np.zeros(len(box.nodes)))
    cells = replace(
        cells,
        points=np.vstack([cells.points, [[9.0, 9.0, 9.0]]]),
        depths=np.vstack([cells.depths, [[1.0]]]),
        tetrahedra=np.vstack([turned, flat]),
    )
    compact = cells.compact()
    assert (volumes(compact.points, compact.tetrahedra) > 0).all()
    assert len(compact.tetrahedra) == len(box.elements)
    assert len(compact.points) == len(compact.depths) == len(box.nodes)
    assert volume(compact) == pytest.approx(6.0, rel=1e-12)

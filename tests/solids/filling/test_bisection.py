"""Halved tetrahedra fit together, fill the same space and keep their shape."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from struck.solids.lattice import Cells, Lattice, refine
from tests.solids.shapes import dihedral_angles, face_counts, volumes

Depths = Callable[[np.ndarray], np.ndarray]
BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])


def thin_shell(points: np.ndarray) -> np.ndarray:
    return np.abs(np.linalg.norm(points, axis=1)[:, None] - 0.6) - 0.05


def two_balls(points: np.ndarray) -> np.ndarray:
    centres = np.array([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0]])
    return (np.linalg.norm(points[:, None] - centres, axis=2) - 0.45).min(axis=1)[:, None]


def wedge(points: np.ndarray) -> np.ndarray:
    """Two planes that meet at 30 degrees."""
    low = -points[:, 2]
    high = points[:, 2] * np.cos(np.pi / 6) - points[:, 0] * np.sin(np.pi / 6)
    return np.maximum(low, high)[:, None]


BODIES = {"thin shell": thin_shell, "two balls": two_balls, "wedge": wedge}


def lattice_of(depths: Depths, spacing: float) -> Cells:
    """Return all tetrahedra of a lattice over the box, whatever their depths."""
    lattice = Lattice.cover(BOX, spacing)
    corners, centres = (
        np.full((*shape, 1), -1.0) for shape in (lattice.counts + 1, lattice.counts)
    )
    tetrahedra = lattice.tetrahedra(corners, centres)
    points = lattice.positions(np.arange(corners.size + centres.size))
    return Cells(points=points, depths=depths(points), tetrahedra=tetrahedra)


@pytest.fixture(scope="module", params=list(BODIES))
def case(request: pytest.FixtureRequest) -> tuple[Cells, Cells, Depths]:
    depths = BODIES[request.param]
    before = lattice_of(depths, 0.4)
    return before, refine(before, depths, min_length=0.06, max_halvings=2000), depths


def test_every_face_is_shared_by_two_or_lies_outside(case: tuple[Cells, Cells, Depths]) -> None:
    before, after, _ = case
    assert len(after.tetrahedra) > len(before.tetrahedra)
    faces, counts = face_counts(after.tetrahedra)
    assert set(counts) == {1, 2}
    # A hanging node would make outer faces inside: their area would be too large.
    corners = after.points[faces[counts == 1]]
    area = np.linalg.norm(np.cross(*np.diff(corners, axis=1).transpose(1, 0, 2)), axis=1).sum() / 2
    outer, whole = face_counts(before.tetrahedra)
    rims = before.points[outer[whole == 1]]
    same = np.linalg.norm(np.cross(*np.diff(rims, axis=1).transpose(1, 0, 2)), axis=1).sum() / 2
    assert area == pytest.approx(same, rel=1e-12)


def test_volume_stays(case: tuple[Cells, Cells, Depths]) -> None:
    before, after, _ = case
    found = np.abs(volumes(after.points, after.tetrahedra))
    assert found.sum() == pytest.approx(np.abs(volumes(before.points, before.tetrahedra)).sum())
    assert found.min() > 0


def test_shapes_stay_good(case: tuple[Cells, Cells, Depths]) -> None:
    before, after, _ = case
    # The lattice's own are 60 and 90 degrees; halves of its tetrahedra have 45 and 30 at least.
    assert dihedral_angles(before.points, before.tetrahedra).min() == pytest.approx(60, abs=1e-6)
    angles = dihedral_angles(after.points, after.tetrahedra)
    assert angles.min() > 29.9
    assert angles.max() < 135.1


def test_new_points_have_their_own_depths(case: tuple[Cells, Cells, Depths]) -> None:
    _, after, depths = case
    assert after.depths == pytest.approx(depths(after.points), abs=1e-14)


def test_flat_surfaces_are_left_alone() -> None:
    def plane(points: np.ndarray) -> np.ndarray:
        return (points @ np.array([0.6, 0.0, 0.8]) - 0.123)[:, None]

    before = lattice_of(plane, 0.4)
    assert refine(before, plane, min_length=0.01, max_halvings=10_000) is before


def test_most_and_shortest_are_kept() -> None:
    before = lattice_of(two_balls, 0.4)
    none = refine(before, two_balls, min_length=0.04, max_halvings=0)
    few = refine(before, two_balls, min_length=0.04, max_halvings=3)
    long = refine(before, two_balls, min_length=0.25, max_halvings=1000)
    assert none is before
    assert long is before  # no edge is twice as long as 0.25
    assert len(before.points) < len(few.points) < len(before.points) + 200


def test_a_gap_narrower_than_the_lattice_is_found() -> None:
    gap = 0.1  # a quarter of the spacing
    before = lattice_of(two_balls, 0.4)
    after = refine(before, two_balls, min_length=0.04, max_halvings=4000)
    middle = np.array([0.0, 0.0, 0.0])
    assert two_balls(middle[None])[0, 0] == pytest.approx(gap / 2)
    for cells, expected in ((before, True), (after, False)):
        inside = cells.depths[cells.tetrahedra, 0] < 0
        left, right = (inside & (side * cells.points[cells.tetrahedra, 0] > 0) for side in (-1, 1))
        assert (left.any(axis=1) & right.any(axis=1)).any() == expected

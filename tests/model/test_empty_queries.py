"""Points that name no place: none at all, not three numbers, or none that a square can hold."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import struck
from struck import ModalModel, Strike
from struck.errors import ContactError, MeshError, OptionError
from struck.model.mesh import Closest, Mesh, Surface
from struck.shapes import Bar
from struck.solids import Block
from struck.solids.surface.distance import FilledBody

TETRAHEDRON = Mesh(
    points=np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]]),
    faces=np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]),
)
NONE = ([], (), np.zeros((0, 3)), np.zeros((1, 0)), [[]])


@pytest.fixture(scope="module", params=["closed form", "elements"])
def body(request: pytest.FixtureRequest) -> ModalModel:
    if request.param == "elements":
        return struck.analyze(Block(size=(0.1, 0.05, 0.02)), "steel", accuracy="preview")
    return struck.analyze(Bar(length=0.3, width=0.03, thickness=0.005), "steel")


@pytest.mark.parametrize("contacts", [*NONE, {}, "", range(0)], ids=repr)
def test_a_file_without_contacts_is_refused(
    body: ModalModel, contacts: object, tmp_path: Path
) -> None:
    with pytest.raises((ContactError, OptionError), match=r"contact.*: give"):
        struck.save(body, tmp_path / "none.sofa", contacts=contacts, listeners=[[0, 0, 1.0]])
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("points", NONE, ids=repr)
def test_no_points_get_no_answers(body: ModalModel, points: object) -> None:
    surface, count = body.gains.locator, len(body.frequencies)
    lengths, parts, nearest = surface.closest(points)
    faces, weights = surface.barycentric(points)
    assert lengths.shape == parts.shape == faces.shape == (0,)
    assert nearest.shape == weights.shape == (0, 3)
    assert body.gains.at(points, points).shape == (0, 1, count)
    assert body.gains.shapes_at(points).shape == (0, 3, count)
    assert body.gains.toward(points).shape == (0, 1, count)


@pytest.mark.parametrize(
    "points", [np.zeros((2, 2)), [[0, np.nan, 0]], [0, 0, -np.inf], [1e200] * 3]
)
def test_points_that_are_no_places_are_refused(body: ModalModel, points: object) -> None:
    queries = (
        body.gains.locator.closest,
        body.gains.locator.barycentric,
        body.gains.shapes_at,
        body.gains.toward,
    )
    for query in queries:
        with pytest.raises(ContactError, match="give"):
            query(points)


def test_a_strike_beyond_all_squares_is_refused_with_its_bound(body: ModalModel) -> None:
    with pytest.raises(ContactError, match=r"1e150 m"):
        struck.render(body, Strike(at=(1e200, 0, 0)), seconds=0.1)


def test_trees_of_nothing_are_refused_and_distances_of_nothing_are_none() -> None:
    with pytest.raises(MeshError, match="at least one"):
        Closest(TETRAHEDRON.points, np.zeros((0, 2), np.int64))
    assert FilledBody(mesh=TETRAHEDRON).distance(np.zeros((0, 3))).shape == (0,)
    inside = Surface(TETRAHEDRON).closest([0.1, 0.1, 0.1])
    assert inside[0] == pytest.approx([0.1])

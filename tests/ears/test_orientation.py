"""Orientations over time, judged by SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

from struck.ears.listeners import Trajectory
from struck.ears.orientation import Centres, MovingPoint, Orientation, Turning
from struck.errors import OptionError

CHANCE = np.random.default_rng(5)
TURNS = Rotation.random(6, rng=CHANCE)
TIMES = np.array([0.0, 0.1, 0.4, 0.5, 0.9, 1.0])
# The same rotations, some with the other sign of their quaternion.
QUATERNIONS = TURNS.as_quat()[:, [3, 0, 1, 2]] * np.array([1, -1, 1, 1, -1, 1])[:, None]
ASKED = np.linspace(0, 1, 41)


def test_a_table_of_quaternions_turns_as_scipy_does() -> None:
    found = Orientation.of("rotation", (TIMES, QUATERNIONS)).at(ASKED)
    wanted = Slerp(TIMES, TURNS)(ASKED).as_matrix()
    np.testing.assert_allclose(found, wanted, atol=1e-14)


def test_tables_are_held_beyond_their_ends() -> None:
    found = Orientation.of("rotation", (TIMES, QUATERNIONS)).at(np.array([-1.0, 3.0]))
    np.testing.assert_allclose(found, TURNS[[0, 5]].as_matrix(), atol=1e-14)


def test_half_a_turn_apart_and_hardly_apart_are_finite() -> None:
    for angle in (np.pi, np.pi - 1e-9, 1e-9, 0.0):
        ends = np.array([[1, 0, 0, 0], [np.cos(angle / 2), 0, 0, np.sin(angle / 2)]])
        (found,) = Orientation.of("rotation", ([0.0, 1.0], ends)).at(np.array([0.5]))
        assert np.arctan2(found[1, 0], found[0, 0]) == pytest.approx(angle / 2, abs=1e-9)


def test_matrices_quaternions_and_functions_are_the_same() -> None:
    matrix = TURNS[2].as_matrix()
    for turning in (matrix, QUATERNIONS[2], lambda _: matrix, lambda _: QUATERNIONS[2]):
        orientation = Orientation.of("rotation", turning)
        np.testing.assert_allclose(orientation.at(np.array([0.3]))[0], matrix, atol=1e-14)
        assert orientation.moves == callable(turning)


def test_a_point_is_carried_and_seen() -> None:
    orientation = Orientation.of("rotation", (TIMES, QUATERNIONS))
    origin = Trajectory.of("position", lambda time: (time, 2 * time, 0))
    carried = MovingPoint(origin=origin, orientation=orientation, point=np.array([0.1, 0.2, 0.3]))
    places = carried.at(ASKED)
    moved = Slerp(TIMES, TURNS)(ASKED).apply(carried.point)
    np.testing.assert_allclose(places, origin.at(ASKED) + moved, atol=1e-14)
    seen = [carried.in_body(places[k], ASKED[k : k + 1])[0] for k in (0, 7, 40)]
    np.testing.assert_allclose(seen, np.tile(carried.point, (3, 1)), atol=1e-14)


def test_bodies_of_one_table_are_placed_together_where_scipy_has_each() -> None:
    ways, points = CHANCE.standard_normal((3, 6, 3)), CHANCE.standard_normal((3, 3))
    apart = MovingPoint(  # of another table
        origin=Trajectory.of("position", (TIMES + 0.05, ways[2])),
        orientation=Orientation.of("rotation", (TIMES + 0.05, QUATERNIONS)),
        point=points[2],
    )
    together = [
        MovingPoint(
            origin=Trajectory.of("position", (TIMES, way)),
            orientation=Orientation.of("rotation", (TIMES, turned * QUATERNIONS)),
            point=point,
        )
        for way, point, turned in zip(ways, points, (1, -1, 1), strict=True)
    ]
    bodies = [together[0], Trajectory.of("position", points[0]), together[1], apart, together[2]]
    moments = CHANCE.uniform(-0.2, 1.2, (5, 30))  # before and after the tables too
    found = Centres(bodies).at(moments)
    for row, body in zip((0, 2, 4), together, strict=True):
        held = np.clip(moments[row], 0, 1)
        way = [np.interp(held, TIMES, axis) for axis in body.origin.points.T]
        wanted = np.transpose(way) + Slerp(TIMES, TURNS)(held).apply(body.point)
        np.testing.assert_allclose(found[row], wanted, atol=1e-13)
    np.testing.assert_array_equal(found[1], np.tile(points[0], (30, 1)))
    np.testing.assert_array_equal(found[3], apart.at(moments[3]))


@pytest.mark.parametrize(
    ("turning", "message"),
    [
        ((1.0, 1.0, 0.0, 0.0), "unit quaternions"),
        ((np.nan, 0.0, 0.0, 0.0), "unit quaternions"),
        (np.ones((3, 3)), "orthonormal"),
        (-np.eye(3), "mirrors"),
        (([0.0, 0.0], QUATERNIONS[:2]), "finite and ascend"),
        (([0.0, 1.0], QUATERNIONS[:3]), r"of \(3, 4\)"),
    ],
)
def test_what_is_no_rotation_is_refused(turning: Turning, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Orientation.of("rotation", turning)

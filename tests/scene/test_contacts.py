"""Contact logs: what they hold, and what becomes of rows that cannot be."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from struck.errors import OptionError
from struck.scene import Body, Contacts, Poses, RigidBody, Scene

STILL = (1.0, 0.0, 0.0, 0.0)


def log(count: int = 3, **changes: object) -> Contacts:
    columns: dict[str, Any] = {
        "names": ["floor", "ball"],
        "time": 0.1 * np.arange(count),
        "dt": 1e-3,
        "body0": np.zeros(count),
        "body1": np.ones(count),
        "position": np.outer(np.arange(count), [0.01, 0, 0]),
        "impulse": np.tile([0.0, 0.0, 0.02], (count, 1)),
    }
    return Contacts(**{**columns, **changes})


def test_rows_are_put_in_order_and_repeated_ones_are_counted() -> None:
    times = [0.2, 0.1, 0.1]
    contacts = log(time=times, position=np.zeros((3, 3)))
    np.testing.assert_array_equal(contacts.time, [0.1, 0.2])
    assert contacts.notes == (
        "the log went 1 step back in time: put in order",
        "1 row of the log as the one before: left out",
    )
    assert not log().notes


def test_rows_that_differ_in_one_number_are_all_kept() -> None:
    assert len(log(time=[0.1, 0.1, 0.1])) == 3


def test_normals_are_of_length_one_or_those_of_impulses() -> None:
    np.testing.assert_allclose(log().normal, np.tile([0, 0, 1], (3, 1)))
    np.testing.assert_allclose(log(normal=np.tile([0, 2, 0], (3, 1))).normal[:, 1], 1)
    assert np.isfinite(log(impulse=np.zeros((3, 3))).normal).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"time": [0.0, np.nan, 0.2]}, r"time is nan in row 1"),
        ({"impulse": np.full((3, 3), 1e9)}, r"not finite or beyond 1e6.*end the simulation"),
        ({"body1": [1, 1, 2]}, r"body1 is 2 in row 2.*2 names"),
        ({"body1": [1, 0, 1]}, r"row 1 and 0 others let 'floor' touch itself"),
        ({"body1": [1, 0.5, 1]}, r"body1 is .*: Contacts takes whole numbers, and 0.5 is not"),
        ({"position": np.zeros((2, 3))}, r"position has shape \(2, 3\): give \(3, 3\)"),
        ({"dt": -1.0}, r"dt is -1.0 s in row 0"),
        ({"names": ["ball", "ball"]}, "a different name"),
    ],
)
def test_rows_that_cannot_be_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        log(**changes)


def test_of_several_poses_at_one_time_the_last_counts() -> None:
    poses = Poses(
        time=[0.0, 0.0, 1.0, 0.0],
        body=[1, 1, 1, 0],
        position=[[0, 0, 0], [1, 0, 0], [2, 0, 0], [9, 0, 0]],
        rotation=np.tile(STILL, (4, 1)),
    )
    times, positions, _ = poses.of(1)
    np.testing.assert_array_equal(times, [0, 1])
    np.testing.assert_array_equal(positions[:, 0], [1, 2])
    assert log(poses=poses).notes == poses.notes
    assert "1 pose at the time of another" in poses.notes[0]
    assert len(poses.of(7)[0]) == 0


def test_poses_of_all_bodies_at_once() -> None:
    places = np.arange(12.0).reshape(2, 2, 3)
    poses = Poses.together([0.0, 0.5], places, np.tile(STILL, (2, 2, 1)))
    np.testing.assert_array_equal(poses.of(1)[1], places[:, 1])


@pytest.mark.parametrize(
    ("rotation", "message"),
    [([[2.0, 0, 0, 0]], "whose length is 2"), ([[1.0, 0, 0]], r"give \(1, 4\)")],
)
def test_what_is_no_rotation_is_refused(rotation: list[list[float]], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Poses(time=[0.0], body=[0], position=[[0, 0, 0]], rotation=rotation)


def test_a_scene_takes_the_poses_of_a_log() -> None:
    poses = Poses.together([0.0], [[[0, 0, 0], [0, 0, 1]]], np.tile(STILL, (1, 2, 1)))
    bodies = {name: Body(model=RigidBody()) for name in ("floor", "ball")}
    posed = Scene(bodies=bodies).posed(log(poses=poses))
    np.testing.assert_array_equal(posed.bodies["ball"].origin.at(np.zeros(1)), [[0, 0, 1]])


def test_names_that_a_scene_does_not_have_are_told() -> None:
    with pytest.raises(OptionError, match=r"the log names 'ball', and the scene has 'floor'"):
        Scene(bodies={"floor": Body(model=RigidBody())}).posed(log())

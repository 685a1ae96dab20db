from __future__ import annotations

import numpy as np
import pytest

from struck.ears.listeners import Trajectory
from struck.errors import OptionError


def test_a_point_stays_where_it_is() -> None:
    place = Trajectory.of("position", [1, 2, 3])
    assert not place.moves
    assert place.at(np.array([0.0, 7.0])).tolist() == [[1, 2, 3], [1, 2, 3]]


def test_a_table_goes_straight_and_stays_at_its_ends() -> None:
    table = Trajectory.of("position", ([1.0, 2.0, 4.0], [(0, 0, 0), (1, 0, 2), (1, 4, 2)]))
    assert table.moves
    times = np.array([0.0, 1.5, 2.0, 3.0, 9.0])
    wanted = [[0, 0, 0], [0.5, 0, 1], [1, 0, 2], [1, 2, 2], [1, 4, 2]]
    np.testing.assert_allclose(table.at(times), wanted, atol=1e-12)


def test_a_function_is_asked_for_each_time() -> None:
    assert Trajectory.of("position", lambda t: (t, 0, -t)).at(np.array([2.0])).tolist() == [
        [2, 0, -2]
    ]


@pytest.mark.parametrize(
    ("course", "message"),
    [
        ((1, 2), "position is"),
        ("here", "position is 'here'"),
        ((np.nan, 0, 0), "finite numbers"),
        ((1j, 0, 0), "position is"),
        (([0.0, 1.0], [(0, 0, 0), (1, 1)]), "position is"),
        ((0.0, [(0, 0, 0), (1, 1, 1)]), r"shape \(1, 3\)"),
        (([1.0, 1.0], [(0, 0, 0), (1, 1, 1)]), "ascend"),
        (([0.0, np.inf], [(0, 0, 0), (1, 1, 1)]), "finite and ascend"),
        (([0.0, 1.0, 2.0], [(0, 0, 0), (1, 1, 1)]), r"shape \(3, 3\)"),
    ],
)
def test_what_is_no_course_is_refused(course: object, message: str) -> None:
    with pytest.raises(OptionError, match=message):
        Trajectory.of("position", course)


def test_a_function_that_returns_no_point_is_refused_when_it_does() -> None:
    lost = Trajectory.of("position", lambda t: (t, np.nan, 0))
    with pytest.raises(OptionError, match="position is"):
        lost.at(np.array([0.0]))


def test_a_function_is_never_asked_for_times_before_nought() -> None:
    root = Trajectory.of("position", lambda t: (1 + t**0.5, 0, 0))
    assert root.at(np.array([-0.3, 4.0])).tolist() == [[1, 0, 0], [3, 0, 0]]

"""Errors told from two resolutions, on frequencies made up for it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import ArrayLike, NDArray

from struck import Mesh
from struck.model.modes import Modes
from struck.solids.fem.error_estimates import (
    SINGLE_MESH_FACTOR,
    add_shape_errors,
    nodes_needed,
    stated_errors,
)
from tests.physics.bodies import box

Array = NDArray[np.float64]
TRUE = np.array([100.0, 210.0, 330.0, 460.0, 500.0])
SURFACE: Mesh = box(1, 1, 1)


def modes(frequencies: ArrayLike, errors: ArrayLike) -> Modes:
    found = np.asarray(frequencies, float)
    return Modes(
        frequencies=found,
        surface=SURFACE,
        shapes=np.ones((len(SURFACE.points), 3, len(found))),
        mass=1.0,
        centre=np.zeros(3),
        inertia=np.eye(3),
        complete_to=1000.0,
        poisson_slopes=np.zeros(len(found)),
        errors=np.broadcast_to(np.asarray(errors, float), found.shape).copy(),
    )


def pair(error: float, *, ratio: float, share: float) -> tuple[Modes, Modes]:
    """Return fine and coarse modes of errors by the fourth power of the edges.

    On one mesh, `share` of each error is told.
    """
    coarse = error * ratio ** (4 / 3)
    told = SINGLE_MESH_FACTOR * share
    return (
        modes(TRUE * (1 + error), told * error),
        modes(TRUE * (1 + coarse), told * coarse),
    )


@pytest.mark.parametrize("share", [0.1, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("ratio", [1.2, 3.0, 6.0])
def test_errors_bound_the_true_ones_closely_whatever_share_one_mesh_tells(
    share: float, ratio: float
) -> None:
    fine, coarse = pair(1e-3, ratio=ratio, share=share)
    stated = stated_errors(fine, coarse, ratio ** (1 / 3))
    assert (stated >= 1e-3).all()
    assert (stated <= 5e-3).all()


def test_a_defect_that_both_meshes_share_is_told() -> None:
    # One layer of elements in both: a tenth of the error goes, the rest stays.
    fine = modes(TRUE * 1.0100, SINGLE_MESH_FACTOR * 0.0100)
    coarse = modes(TRUE * 1.0110, SINGLE_MESH_FACTOR * 0.0110)
    assert (stated_errors(fine, coarse, 1.44) >= 0.01).all()


def test_a_mode_that_crossed_another_does_not_come_out_exact() -> None:
    fine, coarse = pair(1e-3, ratio=3.0, share=0.5)
    crossed = coarse.frequencies.copy()
    crossed[2] = fine.frequencies[2]
    told = modes(crossed, coarse.errors)
    assert stated_errors(fine, told, 1.44)[2] >= 1e-3


def test_two_modes_within_their_errors_of_each_other_have_the_same_error() -> None:
    """A mesh splits such a pair by chance; a mode farther away keeps its own error."""
    true = np.array([100.0, 210.0, 330.0, 330.01, 500.0])
    apart = np.array([1, 1, 1.7, 0.3, 1])
    fine = modes(true * (1 + 1e-3 * apart), SINGLE_MESH_FACTOR * 1e-3)
    coarse = modes(true * (1 + 4e-3 * apart), SINGLE_MESH_FACTOR * 4e-3)
    stated = stated_errors(fine, coarse, 4 ** (1 / 3))
    assert stated[2] == stated[3] >= 1.7e-3
    assert stated[1] == stated[4] < stated[2]


@pytest.mark.parametrize("share", [0.1, 0.5, 2.0])
def test_modes_beyond_the_coarse_mesh_are_bounded_as_those_it_has(share: float) -> None:
    fine, coarse = pair(1e-3, ratio=3.0, share=share)
    fewer = modes(coarse.frequencies[:3], coarse.errors[:3])
    beyond = stated_errors(fine, fewer, 3 ** (1 / 3))[3:]
    assert (beyond >= np.maximum(1e-3, fine.errors[3:])).all()
    assert (beyond <= np.maximum(5e-3, fine.errors[3:])).all()


def test_without_another_resolution_each_keeps_its_own() -> None:
    fine, coarse = pair(1e-3, ratio=3.0, share=0.5)
    assert np.array_equal(stated_errors(fine, None, 1.0), fine.errors)
    assert np.array_equal(stated_errors(fine, coarse, 1.007), fine.errors)


def test_nothing_is_told_to_be_exact() -> None:
    assert stated_errors(modes(TRUE, 0.0), None, 1.0) == pytest.approx([1e-4] * len(TRUE))


def test_what_the_shape_misses_adds_in_squares() -> None:
    own = np.array([3e-3, 0.0])
    assert add_shape_errors(own, -8e-3 / 3) == pytest.approx([5e-3, 4e-3])
    assert add_shape_errors(own, 2e-3, layer=True) == pytest.approx([5e-3, 4e-3])


def test_nodes_follow_the_fourth_power_of_the_edges() -> None:
    coarse = modes(TRUE, 0.01)
    assert nodes_needed(coarse, 1000, 1e-4) == pytest.approx(
        nodes_needed(coarse, 1000, 1.6e-3) * 8, rel=0.01
    )

"""All families of a chime's modes, torsion to ovals, against Ritz's method."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.solids import Tube
from struck.solids.fem.vibration import vibration_modes
from tests.physics.bodies import CHIME
from tests.physics.reference import CHIME_RADIUS, CHIME_WALL
from tests.physics.ritz_tube import tube_frequencies

Array = NDArray[np.float64]
LENGTH = 0.505


def elastic(highest: float) -> Array:
    """Return all elastic frequencies below `highest`, each as often as it occurs, Hz."""
    lame = (CHIME.first_lame, CHIME.shear_modulus)
    found: list[float] = []
    for order in range(5):
        family = tube_frequencies(
            LENGTH,
            CHIME_RADIUS,
            CHIME_WALL,
            lame,
            CHIME.density,
            order=order,
            count=40,
            degrees=(3, 40),
        )
        assert family[-1] > highest
        pair = 2 if order else 1  # cosine and sine
        found += pair * family[(family > 10) & (family < highest)].tolist()
    return np.sort(found)


def frequencies(accuracy: str, highest: float) -> Array:
    tube = Tube(length=LENGTH, radius=CHIME_RADIUS, wall=CHIME_WALL)
    return vibration_modes(tube.volume_mesh(accuracy), CHIME, highest).frequencies


@pytest.mark.prove
def test_every_mode_of_a_chime_below_10_khz() -> None:
    # Thin curved walls are where quadratic elements lock: ovals came out 13 % high once.
    assert frequencies("standard", 9_500.0) == pytest.approx(elastic(9_500.0), rel=0.01)


@pytest.mark.prove
def test_every_mode_of_a_chime_below_20_khz_on_the_fine_mesh() -> None:
    assert frequencies("fine", 20_000.0) == pytest.approx(elastic(20_000.0), rel=0.005)

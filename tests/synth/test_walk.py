"""Resonators along a walk through a timbre field: their outputs change without clicks."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.typing import NDArray

from struck.excitation.excitation import Push
from struck.model.survey import from_spherical
from struck.model.timbre_field import TimbreField
from struck.synth.resonators import Resonators
from tests.model.vases import HEIGHTS, RADIUS, Vase, listeners

Array = NDArray[np.float64]
NOWHERE = np.zeros((1, 3))


@pytest.mark.prove
def test_a_walk_round_a_vase_is_as_smooth_as_standing_still() -> None:
    chance = default_rng(6)
    vase = Vase.drawn(chance)
    gains = vase.recorded(vase.gains(HEIGHTS[:, 0], listeners()), 20.0, chance)
    field = TimbreField.of(vase.survey(HEIGHTS, gains), radius=RADIUS)
    angles = np.linspace(0, 2 * np.pi, 345)[:, None]  # at 1.4 m/s, in blocks of 128 samples
    walk = from_spherical(np.full(1, 0.7), angles, np.full(1, 1.2))
    moving = second_difference(vase, field, walk)
    still = max(
        second_difference(vase, field, np.repeat(place[None], 345, axis=0)) for place in walk[::69]
    )
    assert moving <= 1.5 * still


def second_difference(vase: Vase, field: TimbreField, course: Array) -> float:
    """Return the largest second difference of a strike, once it is over, along a course (n, 3)."""
    resonators = Resonators([vase], sample_rate=44100, block=128)
    drive = field.at(np.array([[0.9]]), NOWHERE)[0, 0]
    outputs = field.toward(course)
    force = np.zeros(128)
    force[0] = 44100.0
    samples = []
    for block, output in enumerate(outputs):
        pushes = [Push(force=force if block == 0 else np.zeros(128), drive=drive)]
        samples.append(resonators.process(pushes, [output])[0, 0].copy())
    return float(np.abs(np.diff(np.concatenate(samples)[8:], 2)).max())

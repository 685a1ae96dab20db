"""A body that changes while it is pushed: what pushes goes on with the new drives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from struck.excitation.excitation import Excitation
from struck.excitation.force_track import ForceTrack
from struck.excitation.pluck import Pluck
from struck.excitation.scrape import Scrape
from struck.excitation.touch import TouchLog
from struck.live.voices import Started
from struck.model.model import ModalModel
from tests.excitation.bodies import STEEL, plate

RATE = 48000.0
PLACE = (0.05, 0.03, 0.01)
PATH = [PLACE, (-0.05, 0.03, 0.01)]
PUSHES = [
    Pluck(at=PLACE, force=3.0, rise=0.1),
    Pluck(at=PLACE, force=3.0, rise=0.1, patch=0.01),
    ForceTrack(at=PLACE, force=np.ones(48000), sample_rate=RATE),
    Scrape(path=PATH, speed=0.1, load=1.0, repeat="back"),
    TouchLog(times=[0.0, 0.9], points=[PLACE, PLACE], forces=1.0),
]


def heavier(model: ModalModel) -> ModalModel:
    """Return a body of four times the mass: half the drives."""
    return model.made_of(
        replace(STEEL, density=4 * STEEL.density, youngs_modulus=4 * STEEL.youngs_modulus)
    )


@pytest.mark.parametrize("excitation", PUSHES, ids=["pluck", "patch", "track", "scrape", "log"])
def test_the_drive_goes_to_that_of_the_new_body(excitation: Excitation) -> None:
    model = plate(8)
    other = heavier(model)
    pushing = Started(excitation.begin(model, RATE), RATE)
    expected = excitation.begin(other, RATE)
    for _ in range(5):
        pushing.advance(256)
        expected.advance(256)
    pushing.change(other)
    for _ in range(5):
        push, wanted = pushing.advance(256), expected.advance(256)
    assert push is not None
    assert wanted is not None
    assert push.drive == pytest.approx(wanted.drive, rel=1e-12)
    before = excitation.begin(model, RATE)
    old = [before.advance(256) for _ in range(10)][-1]
    assert old is not None
    assert np.abs(push.drive - old.drive).max() > 0.1 * np.abs(old.drive).max()

"""Everyday bodies against what CalculiX finds on finer meshes of the very same surface."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck import Material
from tests.physics.everyday import BODIES

Array = NDArray[np.float64]
KEPT = json.loads(Path(__file__).with_name("everyday.json").read_text(encoding="utf-8"))
MODES = 20


def truth(name: str) -> tuple[Array, Array]:
    """Return the frequencies of the finest mesh, and how far the one before is off."""
    coarse, fine = (np.array(run["frequencies"][:MODES]) for run in KEPT[name][-2:])
    return fine, np.abs(coarse / fine - 1)


@pytest.mark.parametrize("name", ["undercut bar", "plate of 1 mm", "coin"])
def test_preview_is_within_three_percent(name: str) -> None:
    frequencies, own = truth(name)
    model = struck.analyze(
        BODIES[name](),
        Material.named("steel"),
        accuracy="preview",
        band=(20, 1.03 * frequencies[-1]),
        cache=False,
    )
    true = np.abs(model.natural_frequencies[:MODES] / frequencies - 1)
    assert np.all(true <= np.maximum(0.03, 4 * own))

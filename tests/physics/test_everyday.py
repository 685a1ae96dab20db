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


# The bowl of the glass is known no better than by one layer of CalculiX's elements.
KNOWN = [name for name in BODIES if name != "wine glass"]
VERY_THIN = ("plate of 1 mm", "guitar box")
STEEL = Material.named("steel")


def truth(name: str) -> tuple[Array, Array]:
    """Return the frequencies of the finest mesh, and how far one 1.4 times coarser is off."""
    runs = KEPT[name]
    coarser = next(run for run in reversed(runs) if run["size"] >= 1.4 * runs[-1]["size"])
    coarse, fine = (np.array(run["frequencies"][:MODES]) for run in (coarser, runs[-1]))
    return fine, np.abs(coarse / fine - 1)


def compared(name: str, accuracy: str) -> tuple[struck.ModalModel, Array, Array]:
    """Return a model, the true errors of its first modes, and how well those are known."""
    frequencies, own = truth(name)
    model = struck.analyze(
        BODIES[name](), STEEL, accuracy=accuracy, band=(20, 1.03 * frequencies[-1]), cache=False
    )
    return model, np.abs(model.natural_frequencies[:MODES] / frequencies - 1), own


@pytest.mark.parametrize("name", ["undercut bar", "plate of 1 mm", "coin"])
def test_preview_is_within_three_percent(name: str) -> None:
    _, true, own = compared(name, "preview")
    assert np.all(true <= np.maximum(0.03, 4 * own))


@pytest.mark.prove
@pytest.mark.parametrize("name", KNOWN)
def test_standard_is_within_half_a_percent(name: str) -> None:
    """One percent where a body is 100 times as long as thick; nine of ten modes as is said."""
    model, true, own = compared(name, "standard")
    assert np.all(true <= np.maximum(0.01 if name in VERY_THIN else 0.005, 4 * own))
    assert model.errors is not None
    counted = true > 3 * own
    assert np.mean((true <= model.errors[:MODES]) | ~counted) >= 0.9
    assert int(str(model.provenance.details["nodes"])) <= 100_000

"""The same elements in CalculiX, which nobody here wrote, give the same frequencies."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bench import calculix
from struck import Material
from struck.bird import bird
from struck.solids.distance import Body
from struck.solids.meshing import filled
from struck.solids.vibration import vibration_modes

CERAMIC = Material.named("ceramic")


@pytest.mark.prove
@pytest.mark.skipif(not calculix.installed(), reason=calculix.MISSING)
def test_fifty_modes_of_a_hollow_bird_agree(tmp_path: Path) -> None:
    mesh = filled(Body(mesh=bird(), wall=0.0063)).mesh
    ours = vibration_modes(mesh, CERAMIC, 47e3).frequencies[:50]
    theirs = calculix.frequencies(mesh, CERAMIC, 50, tmp_path)
    assert len(ours) == 50
    assert np.abs(ours / theirs - 1).max() < 1e-4

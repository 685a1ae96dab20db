"""The same elements in CalculiX, which nobody here wrote, give the same frequencies.

CalculiX integrates stiffness and mass of a C3D10 at four points, which is exact for the stiffness
of straight-sided elements only; we take four there and fourteen everywhere else.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bench import calculix
from struck import Material
from struck.bird import bird
from struck.solids import VolumeMesh, volume
from struck.solids.distance import Body
from struck.solids.meshing import filled
from struck.solids.vibration import vibration_modes

CERAMIC = Material.named("ceramic")
pytestmark = [
    pytest.mark.prove,
    pytest.mark.skipif(not calculix.installed(), reason=calculix.MISSING),
]


@pytest.fixture(scope="module")
def mesh() -> VolumeMesh:
    return filled(Body(mesh=bird(), wall=0.0063)).mesh


@pytest.fixture(scope="module")
def theirs(mesh: VolumeMesh, tmp_path_factory: pytest.TempPathFactory) -> NDArray[np.float64]:
    folder: Path = tmp_path_factory.mktemp("calculix")
    return calculix.frequencies(mesh, CERAMIC, 50, folder)


def difference(mesh: VolumeMesh, theirs: NDArray[np.float64]) -> float:
    ours = vibration_modes(mesh, CERAMIC, 47e3).frequencies
    assert len(ours) == len(theirs) == 50
    return float(np.abs(ours / theirs - 1).max())


def test_fifty_modes_of_a_hollow_bird_agree(mesh: VolumeMesh, theirs: NDArray[np.float64]) -> None:
    assert not mesh.straight().all()
    assert difference(mesh, theirs) < 1e-4


def test_they_agree_to_a_millionth_when_we_integrate_at_its_four_points(
    mesh: VolumeMesh, theirs: NDArray[np.float64], monkeypatch: pytest.MonkeyPatch
) -> None:
    four = mesh.element.straight_rule
    coarse = replace(mesh.element, stiffness_rule=four, mass_rule=four)
    monkeypatch.setattr(volume, "ELEMENTS", {**volume.ELEMENTS, mesh.kind: coarse})
    assert len(four.weights) == 4
    assert difference(mesh, theirs) < 1e-6

"""The same elements in CalculiX, which nobody here wrote, give the same frequencies.

CalculiX integrates stiffness and mass of a C3D10 at four points, which is exact for the stiffness
of straight-sided elements only; we take four there and fourteen everywhere else. At four points
both agree on any mesh. At fourteen they agree as far as the elements are small against what they
curve around: to 5e-3 with 3,000 nodes of the bird, 3e-4 with 12,000 and 6e-5 with 32,000.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bench import calculix
from struck import Material
from struck.report.gallery import bird
from struck.solids import VolumeMesh, volume_mesh
from struck.solids.fem.vibration import vibration_modes
from struck.solids.filling.filling import fill_body
from struck.solids.surface.distance import FilledBody

CERAMIC = Material.named("ceramic")
_NODES = 35_000
with_calculix = pytest.mark.skipif(not calculix.installed(), reason=calculix.MISSING)


@pytest.fixture(scope="module")
def mesh() -> VolumeMesh:
    return fill_body(FilledBody(mesh=bird(), wall=0.0075), nodes=_NODES).mesh


@pytest.fixture(scope="module")
def theirs(mesh: VolumeMesh, tmp_path_factory: pytest.TempPathFactory) -> NDArray[np.float64]:
    folder: Path = tmp_path_factory.mktemp("calculix")
    return calculix.frequencies(mesh, CERAMIC, calculix.COUNT, folder)


@pytest.fixture
def four_points(monkeypatch: pytest.MonkeyPatch) -> None:
    tet = volume_mesh.ELEMENTS["tet10"]
    four = tet.straight_rule
    assert len(four.weights) == 4
    coarse = replace(tet, stiffness_rule=four, mass_rule=four)
    monkeypatch.setattr(volume_mesh, "ELEMENTS", {**volume_mesh.ELEMENTS, "tet10": coarse})


def difference(mesh: VolumeMesh, theirs: NDArray[np.float64]) -> float:
    ours = vibration_modes(mesh, CERAMIC, 1.001 * theirs[-1]).frequencies
    assert len(ours) >= len(theirs) == calculix.COUNT
    return float(np.abs(ours[: len(theirs)] / theirs - 1).max())


@pytest.mark.usefixtures("four_points")
def test_elements_of_a_hollow_bird_vibrate_as_calculix_has_found() -> None:
    mesh, theirs = calculix.kept()
    assert not mesh.straight().all()
    assert difference(mesh, theirs) < 1e-6


@pytest.mark.prove
@with_calculix
def test_fifty_modes_of_a_hollow_bird_agree(mesh: VolumeMesh, theirs: NDArray[np.float64]) -> None:
    assert not mesh.straight().all()
    assert difference(mesh, theirs) < 1e-4


@pytest.mark.prove
@with_calculix
@pytest.mark.usefixtures("four_points")
def test_they_agree_to_a_millionth_when_we_integrate_at_its_four_points(
    mesh: VolumeMesh, theirs: NDArray[np.float64]
) -> None:
    assert difference(mesh, theirs) < 1e-6

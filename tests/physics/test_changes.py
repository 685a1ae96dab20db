"""What a model says of its body changed, against decompositions of the changed body."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

import struck
from struck import Material, ModalModel, Rayleigh
from struck.solids import VolumeMesh
from struck.solids.fem.spectrum import Solver
from struck.solids.fem.vibration import vibration_modes
from tests.physics.bodies import ALUMINIUM, custom, distorted, grid

Array = NDArray[np.float64]
# No two edges alike: no two modes share a frequency.
BODY = distorted(grid("tet4", (8, 3, 3), (0.2, 0.034, 0.023)), 0.2).promoted()
HIGHEST = 20_000.0
LOSSY = custom(density=2700.0, youngs=70e9, poisson=0.25, loss=0.02)


def analyzed(mesh: VolumeMesh, material: Material, factor: float = 1.0) -> ModalModel:
    return struck.analyze(mesh, material, band=(20.0 * factor, HIGHEST * factor))


@pytest.fixture(scope="module")
def model() -> ModalModel:
    return analyzed(BODY, LOSSY)


def check_same(found: ModalModel, fresh: ModalModel) -> None:
    assert len(fresh.frequencies) >= 8
    for name in ("natural_frequencies", "frequencies", "decays"):
        assert getattr(found, name) == pytest.approx(getattr(fresh, name), rel=1e-9)
    for name in ("mass", "complete_to"):
        assert getattr(found, name) == pytest.approx(getattr(fresh, name), rel=1e-12)
    size = fresh.geometry.extent
    assert found.geometry.points == pytest.approx(fresh.geometry.points, abs=1e-12 * size)
    assert found.centre == pytest.approx(fresh.centre, abs=1e-12 * size)
    assert found.inertia == pytest.approx(fresh.inertia, abs=1e-12 * fresh.mass * size**2)
    # Shapes are stored in single precision and have either sign.
    mine, other = (np.abs(m.gains.shapes.astype(float)) for m in (found, fresh))
    assert np.abs(mine - other).max() <= 1e-4 * other.max()
    places = np.array([[0.0, 0.0, 10 * size]])
    mine, other = (np.abs(m.gains.toward(places))[0, 0] for m in (found, fresh))
    assert mine == pytest.approx(other, rel=1e-2, abs=1e-3 * other.max())


@pytest.mark.parametrize("factor", [0.5, pytest.param(3.0, marks=pytest.mark.prove)])
def test_scaled_is_the_scaled_body(model: ModalModel, factor: float) -> None:
    fresh = analyzed(replace(BODY, nodes=factor * BODY.nodes), LOSSY, 1 / factor)
    check_same(model.scaled(factor), fresh)


def test_made_of_the_same_poisson_ratio_is_the_body_of_that_material(model: ModalModel) -> None:
    other = custom(density=8900.0, youngs=120e9, poisson=0.25, loss=0.004)
    factor = float(np.sqrt(120 / 70 * 2700 / 8900))
    check_same(model.made_of(other), analyzed(BODY, other, factor))


def test_damped_is_the_body_with_those_losses(model: ModalModel) -> None:
    damping = Rayleigh(mass=30.0, stiffness=1e-7)
    check_same(model.damped(damping), analyzed(BODY, LOSSY.damped(damping)))


def test_tuned_is_the_body_of_the_size_that_rings_so(model: ModalModel) -> None:
    tuned = model.tuned(lowest=440.0)
    factor = tuned.geometry.extent / model.geometry.extent
    assert tuned.frequencies[0] == pytest.approx(440.0, rel=1e-11)
    fresh = analyzed(replace(BODY, nodes=factor * BODY.nodes), LOSSY, 1 / factor)
    assert fresh.frequencies[0] == pytest.approx(440.0, rel=1e-9)
    check_same(tuned, fresh)


def test_poisson_slopes_are_those_of_fresh_decompositions() -> None:
    step, solver = 1e-4, Solver(dense_limit=0)
    low, middle, high = (
        vibration_modes(
            BODY, replace(ALUMINIUM, poisson_ratio=0.25 + change), HIGHEST, solver=solver
        )
        for change in (-step, 0.0, step)
    )
    expected = np.log(high.frequencies / low.frequencies) / (2 * step)
    assert np.ptp(expected) > 0.3  # bending hardly follows, torsion does
    assert middle.poisson_slopes == pytest.approx(expected, abs=1e-5)


@pytest.mark.prove
@pytest.mark.parametrize("kind", ["hex8", "wedge6"])
def test_poisson_slopes_on_other_elements(kind: str) -> None:
    mesh, step = grid(kind, (6, 2, 2), (0.2, 0.034, 0.023)).promoted(), 1e-4
    low, middle, high = (
        vibration_modes(mesh, replace(ALUMINIUM, poisson_ratio=0.25 + change), HIGHEST)
        for change in (-step, 0.0, step)
    )
    expected = np.log(high.frequencies / low.frequencies) / (2 * step)
    assert middle.poisson_slopes == pytest.approx(expected, abs=1e-5)

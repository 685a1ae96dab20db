"""The free cube: accuracy and multiplicities, from 12 triangles; orders of convergence."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.solids import Block
from struck.solids.fem.spectrum import Solver
from struck.solids.fem.vibration import lowest_frequency, vibration_modes
from struck.solids.filling.filling import fill_body
from struck.solids.surface.distance import FilledBody
from struck.solids.volume_mesh import VolumeMesh
from tests.physics.bodies import UNIT, box, grid
from tests.physics.reference import CUBE

Array = NDArray[np.float64]
HIGHEST = 4.85  # above it the next modes begin
EVERY = [omega for omega, multiplicity in CUBE for _ in range(multiplicity)]


def omegas(mesh: VolumeMesh) -> Array:
    return 2 * np.pi * vibration_modes(mesh, UNIT, HIGHEST / (2 * np.pi)).frequencies


def multiplicities(found: Array) -> list[int]:
    """Return how many lie together, within 0.1 %, while the cube's own lie 1 % apart at least."""
    groups = np.split(found, np.flatnonzero(np.diff(found) > 1e-3 * found[1:]) + 1)
    return [len(group) for group in groups]


def check(mesh: VolumeMesh) -> None:
    found = omegas(mesh)
    assert found == pytest.approx(EVERY, rel=1e-3)
    assert multiplicities(found) == [multiplicity for _, multiplicity in CUBE]


@pytest.mark.prove
def test_twelve_triangles_at_preview_are_as_good_as_promised_at_fine() -> None:
    check(fill_body(FilledBody(mesh=box(1, 1, 1)), "preview").mesh)


@pytest.mark.prove
@pytest.mark.parametrize("accuracy", ["standard", "fine"])
def test_twelve_triangles(accuracy: str) -> None:
    check(fill_body(FilledBody(mesh=box(1, 1, 1)), accuracy).mesh)


def test_block_of_hexahedra() -> None:
    check(Block(size=(1, 1, 1), elements=(7, 7, 7)).volume_mesh())


def orders(cells: tuple[int, ...], *, quadratic: bool, lumped: bool = False) -> Array:
    """Return the observed orders of convergence of the lowest mode, from mesh to mesh."""
    errors = []
    for count in cells:
        mesh = grid("tet4", (count,) * 3)
        solver = Solver(lumped=lumped)
        lowest = lowest_frequency(mesh.promoted() if quadratic else mesh, UNIT, solver)
        errors.append(2 * np.pi * lowest / CUBE[0][0] - 1)
    assert min(errors) > 0
    return -np.diff(np.log(errors)) / np.diff(np.log(cells))


@pytest.mark.prove
def test_order_of_quadratic_tetrahedra() -> None:
    assert orders((4, 8), quadratic=True)[-1] >= 3.3


def test_order_of_linear_tetrahedra_with_consistent_mass() -> None:
    assert orders((6, 12), quadratic=False)[-1] >= 1.8


@pytest.mark.prove
def test_order_of_linear_tetrahedra_with_lumped_mass() -> None:
    assert orders((7, 14), quadratic=False, lumped=True)[-1] >= 1.7


@pytest.mark.prove
def test_orders_grow_towards_theory() -> None:
    # Theory: 4 for quadratic and 2 for linear elements.
    quadratic = orders((2, 4, 8, 12), quadratic=True)
    consistent = orders((4, 8, 16, 24), quadratic=False)
    lumped = orders((4, 8, 16, 24), quadratic=False, lumped=True)
    for found, least in ((quadratic, 3.3), (consistent, 1.8), (lumped, 1.7)):
        assert (np.diff(found) > 0).all()
        assert found[-1] >= least

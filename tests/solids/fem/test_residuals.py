"""Errors told on one mesh: nothing where the elements are exact, the right order where not."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.solids.fem.assembly import Displacements, Hierarchic
from struck.solids.fem.error_estimates import energies_gained, residual_errors
from struck.solids.fem.vibration import vibration_modes
from struck.solids.volume_mesh import VolumeMesh
from tests.physics.bodies import UNIT, distorted, grid
from tests.physics.reference import CUBE

Array = NDArray[np.float64]
KINDS = ["tet4", "hex8", "wedge6"]


def quadratic(kind: str, count: int) -> VolumeMesh:
    return distorted(grid(kind, (count,) * 3), 0.2).promoted()


def yielded(mesh: VolumeMesh, movement: Array, value: float = 0.0) -> float:
    """Return the energy that finer functions inside the body gain from a movement."""
    outside = np.zeros(len(mesh.nodes), bool)
    for sides in mesh.boundary_sides():
        outside[sides] = True
    # What lies on the surface is held: no load of the test's own is to be taken for an error.
    finer = Hierarchic.of(mesh, held=outside)
    basis = Displacements.of(mesh)
    gained, _ = energies_gained(basis, finer, UNIT, np.array([value]), movement[:, :, None])
    return float(gained[0])


@pytest.mark.parametrize("kind", KINDS)
def test_constant_strain_leaves_no_force(kind: str) -> None:
    mesh = quadratic(kind, 3)
    slope = np.array([[1.0, 0.2, -0.4], [0.3, -0.5, 0.1], [0.2, 0.7, 0.9]])
    assert yielded(mesh, mesh.nodes @ slope) < 1e-24


@pytest.mark.parametrize("kind", KINDS)
def test_quadratic_field_in_equilibrium_leaves_no_force(kind: str) -> None:
    # Distorted hexahedra and wedges no longer hold all quadratics.
    mesh = quadratic(kind, 3) if kind == "tet4" else grid(kind, (3, 3, 3)).promoted()
    x, y, z = mesh.nodes.T
    twist = np.stack([-y * z, x * z, 0 * x], axis=1)
    # The gradient of a harmonic cubic, x^3 - 3 x y^2 + y z^2 - y^3 / 3: its stresses balance.
    gradient = np.stack([3 * x**2 - 3 * y**2, -6 * x * y + z**2 - y**2, 2 * y * z], axis=1)
    assert yielded(mesh, twist + gradient) < 1e-24


@pytest.mark.parametrize("kind", KINDS)
def test_cubic_field_leaves_force(kind: str) -> None:
    mesh = quadratic(kind, 3)
    x, y, z = mesh.nodes.T
    movement = np.stack([x**3 - 3 * x * y**2, y**3 - 3 * y * z**2, z**3 - 3 * z * x**2], axis=1)
    assert yielded(mesh, movement) > 1e-5


@pytest.mark.parametrize("kind", KINDS)
def test_functions_are_continuous(kind: str) -> None:
    mesh = quadratic(kind, 2)
    finer = Hierarchic.of(mesh, held=np.zeros(len(mesh.nodes), bool))
    corners = mesh.element.corners
    seen: dict[tuple[int, ...], Array] = {}
    met = 0
    for number, element in enumerate(mesh.corners):
        for side in mesh.element.sides:
            chosen = sorted(side, key=lambda corner: element[corner])
            weights = np.array([0.5, 0.3, 0.15, 0.05])[: len(side)]
            if len(side) == 4:
                continue  # four corners in order of number are not in order around the side
            at = weights / weights.sum() @ corners[chosen]
            found = np.zeros(int(finer.numbers.max()) + 1)
            np.add.at(found, finer.numbers[number], finer.signs[number] * finer.values(at[None])[0])
            key = tuple(int(element[corner]) for corner in chosen)
            if key in seen:
                assert found == pytest.approx(seen[key], abs=1e-14)
                met += 1
            seen[key] = found
    assert met or kind == "hex8"


class Told(NamedTuple):
    """Errors of the lowest mode."""

    recovered: float
    true: float


def lowest(kind: str, count: int) -> Told:
    mesh = grid(kind, (count,) * 3).promoted()

    def estimate(values: Array, vectors: Array) -> Array:
        return residual_errors(mesh, UNIT, values, vectors)

    modes = vibration_modes(mesh, UNIT, 3.2 / (2 * np.pi), estimate=estimate)
    return Told(modes.errors[0], 2 * np.pi * modes.frequencies[0] / CUBE[0][0] - 1)


@pytest.mark.prove
@pytest.mark.parametrize("kind", ["wedge6", pytest.param("tet4", marks=pytest.mark.prove)])
def test_residual_errors_are_about_the_true_ones_and_fall_by_theory(kind: str) -> None:
    coarse, fine = lowest(kind, 4), lowest(kind, 8)
    for told in (coarse, fine):
        assert 0.5 < told.recovered / told.true < 2
    # Quadratic elements: the fourth power of the edges in the end, from below.
    assert 3 < np.log2(coarse.recovered / fine.recovered) < 4.1


def test_what_a_support_takes_is_no_error() -> None:
    # A bar held at one end: nothing but the support pushes there.
    mesh = grid("tet4", (8, 2, 2), (4, 1, 1)).promoted()
    held = mesh.nodes[:, 0] == 0
    told: dict[str, Array] = {}

    def estimate(values: Array, vectors: Array) -> Array:
        told["held"] = residual_errors(mesh, UNIT, values, vectors)
        freed = vectors.copy()
        freed[held] = 1e-300  # as good as still, but not taken for held
        told["free"] = residual_errors(mesh, UNIT, values, freed)
        return told["held"]

    vibration_modes(mesh, UNIT, 0.05, fixed=held, estimate=estimate)
    assert (told["held"] < 0.5 * told["free"]).all()

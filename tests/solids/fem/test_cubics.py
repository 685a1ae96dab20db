"""Cubic displacements on quadratic tetrahedra: what they hold exactly, and how they converge."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse.linalg

from struck.errors import MeshError
from struck.model.arrays import Array
from struck.solids.fem.assembly import Displacements, System, assemble
from struck.solids.fem.cubic_surface import surface_of
from struck.solids.fem.vibration import lowest_frequency, vibration_modes
from struck.solids.surface.closedness import is_closed
from struck.solids.volume_mesh import VolumeMesh
from tests.physics.bodies import UNIT, distorted, grid
from tests.physics.reference import CUBE


def cubic(count: int, share: float = 0.2) -> VolumeMesh:
    mesh = distorted(grid("tet4", (count,) * 3), share).promoted()
    return VolumeMesh(nodes=mesh.nodes, elements=mesh.elements, kind="tet10", cubic=True)


def energy(system: System, vector: Array) -> float:
    lower = system.shifted(0.0)
    full = lower + scipy.sparse.tril(lower, -1).T
    return float(vector @ full @ vector)


def field(mesh: VolumeMesh, system: System) -> Array:
    """Return (x^3, 0, 0) as a sum of the functions, by the mass matrix."""
    # What is projected stands as the load of another field: its nodes hold x^3 but for cubics.
    basis = Displacements.of(mesh)
    rule = basis.mass_rule
    loads = np.zeros(basis.count)
    for chunk in mesh.chunks():
        at = np.einsum("qn,end->eqd", mesh.element.values(rule.points), mesh.nodes[mesh.elements])
        weights = np.linalg.det(mesh.jacobians(rule.points, chunk)) * rule.weights
        values = basis.values(rule.points, chunk)
        np.add.at(
            loads, basis.numbers, np.einsum("eq,eq,eqn->en", weights, at[..., 0] ** 3, values)
        )
    moved = scipy.sparse.linalg.spsolve(system.mass_matrix().tocsc(), loads)
    return np.stack([moved, 0 * moved, 0 * moved], axis=1).ravel()


def test_a_cubic_field_has_its_exact_energy() -> None:
    mesh = cubic(2)
    system = assemble(mesh, UNIT)
    wanted = 9 / 5 * (UNIT.first_lame + 2 * UNIT.shear_modulus)  # of strains 3 x^2 in a unit cube
    assert energy(system, field(mesh, system)) == pytest.approx(wanted, rel=1e-9)


def test_rigid_motions_cost_nothing_and_weigh_what_the_body_does() -> None:
    mesh = cubic(2)
    basis, system = Displacements.of(mesh), assemble(mesh, UNIT)
    motion = np.tile([1.0, 0.0, 0.0], len(mesh.nodes))[:, None]
    moved = basis.pad(motion)[:, 0]
    assert abs(energy(system, moved)) < 1e-10
    along = moved.reshape(-1, 3)[:, 0]
    assert along @ system.mass_matrix() @ along == pytest.approx(1.0)
    modes = vibration_modes(mesh, UNIT, 1.0)
    assert modes.mass == pytest.approx(1.0)
    assert modes.centre == pytest.approx([0.5, 0.5, 0.5])
    assert modes.inertia == pytest.approx(np.eye(3) / 6)


def test_the_lowest_frequency_of_a_cube() -> None:
    def error(mesh: VolumeMesh) -> float:
        return 2 * np.pi * lowest_frequency(mesh, UNIT) / CUBE[0][0] - 1

    coarse, fine = error(cubic(2, 0.0)), error(cubic(4, 0.0))
    assert 0 < fine < coarse
    assert np.log2(coarse / fine) > 3.5  # edges and corners hold it below 6
    assert fine < 0.1 * error(grid("tet4", (4, 4, 4)).promoted())


def test_the_surface_moves_as_the_functions_do() -> None:
    mesh = cubic(2)
    basis, system = Displacements.of(mesh), assemble(mesh, UNIT)
    assert basis.added is not None
    surface, matrix = surface_of(mesh, basis.added)
    assert is_closed(surface)
    assert surface.volume == pytest.approx(1.0)
    moved = field(mesh, system).reshape(-1, 3)
    assert (matrix @ moved)[:, 0] == pytest.approx(surface.points[:, 0] ** 3, abs=1e-9)
    assert matrix[:, : len(mesh.nodes)] @ mesh.nodes == pytest.approx(surface.points)


def test_what_is_held_does_not_move_between_its_nodes() -> None:
    mesh = cubic(2, 0.0)
    held = mesh.nodes[:, 0] == 0
    modes = vibration_modes(mesh, UNIT, 1.0, fixed=held)
    still = modes.surface.points[:, 0] == 0
    assert still.sum() > held.sum()
    assert not modes.shapes[still].any()
    assert modes.supported


def test_only_quadratic_tetrahedra_carry_cubics() -> None:
    mesh = grid("hex8", (1, 1, 1)).promoted()
    with pytest.raises(MeshError, match="hex20 are not cubic"):
        VolumeMesh(nodes=mesh.nodes, elements=mesh.elements, kind="hex20", cubic=True)

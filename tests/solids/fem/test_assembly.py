"""Matrices of elements against scikit-fem's, which share no line with ours."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import skfem
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity

from struck.errors import MeshError
from struck.solids import VolumeMesh
from struck.solids.fem.assembly import assemble
from struck.solids.volume_mesh import linear_tetrahedra
from tests.physics.bodies import UNIT, distorted, grid

ELEMENTS = {"tet4": skfem.ElementTetP1, "tet10": skfem.ElementTetP2}


def spectrum(mesh: VolumeMesh, *, lumped: bool = False) -> np.ndarray:
    system = assemble(mesh, UNIT, lumped=lumped)
    lower = system.shifted(0.0).toarray()
    mass = np.kron(system.mass_matrix().toarray(), np.eye(3))
    return scipy.linalg.eigh(lower + np.tril(lower, -1).T, mass, eigvals_only=True)


def independent(mesh: VolumeMesh, kind: str, *, lumped: bool = False) -> np.ndarray:
    other = skfem.MeshTet(mesh.nodes.T.copy(), mesh.corners.T.copy())
    basis = skfem.Basis(other, skfem.ElementVector(ELEMENTS[kind]()), intorder=4)
    stiffness = linear_elasticity(UNIT.first_lame, UNIT.shear_modulus).assemble(basis)
    mass = skfem.BilinearForm(lambda u, v, _: UNIT.density * dot(u, v)).assemble(basis).toarray()
    if lumped:
        mass = np.diag(mass.sum(axis=1))
    return scipy.linalg.eigh(stiffness.toarray(), mass, eigvals_only=True)


@pytest.mark.parametrize(("kind", "lumped"), [("tet4", False), ("tet4", True), ("tet10", False)])
def test_all_eigenvalues_are_those_of_scikit_fem(kind: str, lumped: bool) -> None:  # noqa: FBT001
    linear = distorted(grid("tet4", (2, 3, 2)), 0.2)
    mesh = linear.promoted() if kind == "tet10" else linear
    ours = spectrum(mesh, lumped=lumped)
    theirs = independent(linear, kind, lumped=lumped)
    assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-9 * theirs.max())


def test_mass_sums_to_density_times_volume() -> None:
    for kind in ("tet4", "hex8", "wedge6"):
        for mesh in (grid(kind, (2, 2, 3), (1, 2, 3)), grid(kind, (2, 2, 3), (1, 2, 3)).promoted()):
            total = assemble(mesh, UNIT).mass_matrix().sum()
            assert total == pytest.approx(6.0, rel=1e-12)
            assert mesh.volume() == pytest.approx(6.0, rel=1e-12)


def test_only_linear_tetrahedra_are_lumped() -> None:
    with pytest.raises(MeshError, match="tet4 elements only"):
        assemble(grid("hex8", (1, 1, 1)), UNIT, lumped=True)


@pytest.mark.parametrize("kind", ["hex8", "wedge6"])
def test_linear_tetrahedra_fill_other_elements(kind: str) -> None:
    mesh = grid(kind, (2, 2, 2), (1, 2, 3))
    tetrahedra = linear_tetrahedra(mesh)
    assert tetrahedra.volume() == pytest.approx(6.0, rel=1e-12)
    corners = tetrahedra.nodes[tetrahedra.elements]
    assert np.linalg.det(corners[:, 1:] - corners[:, :1]).min() > 0
    surface, _ = tetrahedra.surface()
    assert surface.volume == pytest.approx(6.0, rel=1e-12)

"""The paper's own method, linear tetrahedra with lumped mass, against scikit-fem's."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import skfem
from numpy.typing import NDArray
from skfem.helpers import dot
from skfem.models.elasticity import linear_elasticity

import struck
from struck.solids import Block, VolumeMesh
from struck.solids.volume_mesh import linear_tetrahedra
from tests.physics.bodies import ALUMINIUM, grid

Array = NDArray[np.float64]
BODIES = {
    "tetrahedra": grid("tet4", (8, 2, 2), (0.2, 0.03, 0.02)),
    "quadratic tetrahedra": grid("tet4", (8, 2, 2), (0.2, 0.03, 0.02)).promoted(),
    "block": Block(size=(0.2, 0.03, 0.02), elements=(5, 1, 1)),
}
METHODS = {"obrien2002": True, "obrien2002-consistent": False}


def independent(mesh: VolumeMesh, *, lumped: bool) -> Array:
    """Return all frequencies of linear tetrahedra by scikit-fem and LAPACK, Hz."""
    other = skfem.MeshTet(mesh.nodes.T.copy(), mesh.elements.T.copy())
    basis = skfem.Basis(other, skfem.ElementVector(skfem.ElementTetP1()), intorder=2)
    form = linear_elasticity(ALUMINIUM.first_lame, ALUMINIUM.shear_modulus)
    stiffness = form.assemble(basis).toarray()
    weight = skfem.BilinearForm(lambda u, v, _: ALUMINIUM.density * dot(u, v))
    mass = weight.assemble(basis).toarray()
    if lumped:  # eq. 15: a quarter of each tetrahedron at each corner
        mass = np.diag(mass.sum(axis=1))
    values = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
    return np.sqrt(values[6:]) / (2 * np.pi)


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("method", METHODS)
def test_modes_are_those_of_linear_tetrahedra(name: str, method: str) -> None:
    body = BODIES[name]
    model = struck.analyze(body, ALUMINIUM, method=method, band=(20, 12_000))
    mesh = body if isinstance(body, VolumeMesh) else body.volume_mesh()
    expected = independent(linear_tetrahedra(mesh), lumped=METHODS[method])
    count = int(np.count_nonzero(expected < 12_000))
    assert count >= 3
    assert model.natural_frequencies == pytest.approx(expected[:count], rel=1e-9)
    assert "O'Brien" in model.cite()


def test_lumping_lowers_every_mode() -> None:
    lumped, consistent = (
        struck.analyze(BODIES["tetrahedra"], ALUMINIUM, method=method, band=(20, 12_000))
        for method in METHODS
    )
    count = len(consistent.frequencies)
    assert (lumped.natural_frequencies[:count] < consistent.natural_frequencies).all()

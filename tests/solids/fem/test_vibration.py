"""The solver: sparse against dense, one factorisation against another, and its certificate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse.linalg
from numpy.typing import NDArray
from scipy import sparse

from struck.errors import MeshError, OptionError, SolverError
from struck.solids import Block, VolumeMesh
from struck.solids.fem.assembly import System, assemble
from struck.solids.fem.factorisation import factorise
from struck.solids.fem.lanczos import Eigenpairs
from struck.solids.fem.spectrum import Solver, largest_residual, require_complete
from struck.solids.fem.vibration import lowest_frequency, vibration_modes
from tests.physics.bodies import UNIT, grid

Array = NDArray[np.float64]
HIGHEST = 1.0
BODY = grid("tet4", (2, 3, 4), (0.8, 1.0, 1.3)).promoted()


def full(system: System) -> tuple[Array, Array]:
    lower = system.shifted(0.0).toarray()
    return lower + np.tril(lower, -1).T, np.kron(system.mass_matrix().toarray(), np.eye(3))


@pytest.fixture(scope="module")
def lapack() -> Array:
    """Frequencies of the body by LAPACK on whole matrices."""
    values = scipy.linalg.eigh(*full(assemble(BODY, UNIT)), eigvals_only=True)
    frequencies = np.sqrt(np.maximum(values, 0)) / (2 * np.pi)
    return frequencies[6 : np.searchsorted(frequencies, HIGHEST)]


@pytest.mark.parametrize("backend", ["rslab", "superlu"])
@pytest.mark.parametrize("dense_limit", [0, 10**6])
def test_every_solver_finds_what_lapack_finds(
    backend: str, dense_limit: int, lapack: Array
) -> None:
    solver = Solver(backend=backend, dense_limit=dense_limit)
    modes = vibration_modes(BODY, UNIT, HIGHEST, solver=solver)
    assert modes.frequencies == pytest.approx(lapack, rel=1e-9)
    assert modes.provenance.details["sturm_count"] == len(lapack)
    assert modes.provenance.details["largest_residual"] < 1e-3


def test_arpack_agrees() -> None:
    system = assemble(BODY, UNIT)
    lower = system.shifted(0.0)
    stiffness = (lower + sparse.tril(lower, -1).T).tocsc()
    mass = sparse.kron(system.mass_matrix(), sparse.eye(3)).tocsc()
    values = scipy.sparse.linalg.eigsh(stiffness, 20, mass, sigma=-1.0, return_eigenvectors=False)
    expected = np.sqrt(np.sort(values)[6:]) / (2 * np.pi)
    modes = vibration_modes(BODY, UNIT, HIGHEST, solver=Solver(dense_limit=0))
    assert modes.frequencies[: len(expected)] == pytest.approx(expected, rel=1e-9)
    assert lowest_frequency(BODY, UNIT) == pytest.approx(expected[0], rel=1e-9)


def test_shapes_are_mass_normalised() -> None:
    block = Block(size=(0.5, 0.3, 0.2), elements=(3, 2, 2)).volume_mesh()
    modes = vibration_modes(block, UNIT, 3.0, solver=Solver(dense_limit=0))
    surface, numbers = block.surface()
    assert len(numbers) == len(surface.points)
    system = assemble(block, UNIT)
    stiffness, mass = full(system)
    values, vectors = scipy.linalg.eigh(stiffness, mass)
    expected = vectors.reshape(-1, 3, len(values))[numbers][:, :, 6 : 6 + len(modes.frequencies)]
    assert np.abs(modes.shapes) == pytest.approx(np.abs(expected), abs=2e-4)


@pytest.mark.parametrize("backend", ["rslab", "superlu"])
def test_sturm_count_is_that_of_the_eigenvalues(backend: str) -> None:
    system = assemble(grid("tet4", (2, 2, 2)).promoted(), UNIT)
    values = scipy.linalg.eigh(*full(system), eigvals_only=True)
    for bound in (-1.0, 5.0, 30.0, 100.0, 400.0):
        assert factorise(system.shifted(bound), backend).negative == np.count_nonzero(
            values < bound
        )


def test_a_missing_mode_is_noticed() -> None:
    system = assemble(BODY, UNIT)
    stiffness, mass = full(system)
    values, vectors = scipy.linalg.eigh(stiffness, mass)
    bound = (2 * np.pi * HIGHEST) ** 2
    counted = factorise(system.shifted(bound)).negative - 6
    chosen = slice(6, 6 + counted)
    pairs = Eigenpairs(values=values[chosen], vectors=vectors[:, chosen])
    require_complete(pairs.values, bound, counted)
    assert largest_residual(system, pairs) < 1e-6
    with pytest.raises(SolverError, match=f"{counted - 1} modes were found but {counted} exist"):
        require_complete(pairs.values[1:], bound, counted)
    wrong = replace(pairs, values=1.01 * pairs.values)
    assert largest_residual(system, wrong) == pytest.approx(0.01, rel=0.05)


def test_a_hinge_is_refused() -> None:
    """Two blocks that share an edge only swing about it."""
    first = grid("hex8", (2, 2, 2)).promoted()
    nodes = np.vstack([first.nodes, first.nodes + np.array([1.0, 1.0, 0.0])])
    elements = np.vstack([first.elements, first.elements + len(first.nodes)])
    _, unique, inverse = np.unique(
        np.round(nodes, 9), axis=0, return_index=True, return_inverse=True
    )
    hinged = VolumeMesh(nodes=nodes[unique], elements=inverse.ravel()[elements], kind="hex20")
    for limit in (0, 10**6):
        with pytest.raises(MeshError, match="swing freely"):
            vibration_modes(hinged, UNIT, HIGHEST, solver=Solver(dense_limit=limit))


def test_inverted_elements_are_refused() -> None:
    wrong = BODY.elements.copy()
    wrong[0, [0, 1]] = wrong[0, [1, 0]]
    with pytest.raises(MeshError, match="1 of 144 elements are turned inside out"):
        vibration_modes(replace(BODY, elements=wrong), UNIT, HIGHEST)


def test_a_band_without_modes_tells_the_lowest() -> None:
    with pytest.raises(OptionError, match=r"no mode lies below 0\.1 Hz: the lowest is at 0\.\d+"):
        vibration_modes(BODY, UNIT, 0.1)


def test_a_held_body_has_no_rigid_motions() -> None:
    held = BODY.nodes[:, 2] < 1e-9
    free, fixed = (
        vibration_modes(BODY, UNIT, HIGHEST, fixed=f, solver=Solver(dense_limit=0))
        for f in (None, held)
    )
    assert fixed.supported
    assert not free.supported
    assert fixed.frequencies[0] < free.frequencies[0]
    bottom = np.abs(fixed.surface.points[:, 2]) < 1e-9
    assert np.abs(fixed.shapes[bottom]).max() == 0
    stiffness, mass = full(assemble(BODY, UNIT).free(~held))
    values = scipy.linalg.eigh(stiffness, mass, eigvals_only=True)
    expected = np.sqrt(values[: len(fixed.frequencies)]) / (2 * np.pi)
    assert fixed.frequencies == pytest.approx(expected, rel=1e-9)

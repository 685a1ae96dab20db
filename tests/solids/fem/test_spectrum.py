"""Slices of the spectrum: together they are what one decomposition gives, and nothing twice."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from struck.errors import SolverError
from struck.solids import Block, VolumeMesh
from struck.solids.fem.assembly import System, assemble
from struck.solids.fem.factorisation import Factoriser, factorise
from struck.solids.fem.lanczos import Eigenpairs, rigid_motions
from struck.solids.fem.spectrum import Shift, Solver, Spectrum
from struck.solids.fem.vibration import vibration_modes
from tests.physics.bodies import UNIT, grid
from tests.samples import sampled

Array = NDArray[np.float64]
BODY = grid("tet4", (2, 3, 3), (0.8, 1.0, 1.3)).promoted()
CUBE = Block(size=(1.0, 1.0, 1.0), elements=(3, 3, 3)).volume_mesh()
HIGHEST = 2.2


def springs(values: Array) -> System:
    """Return masses of 1 kg, each on a spring of its own along x, y and z: M = 1, K diagonal."""
    stiffness = np.zeros((3, 3, len(values) // 3))
    stiffness[(0, 1, 2), (0, 1, 2)] = values.reshape(-1, 3).T
    count = stiffness.shape[2]
    return System(
        starts=np.arange(count + 1),
        rows=np.arange(count),
        stiffness=stiffness,
        mass=np.ones(count),
    )


def sliced(values: Array, bound: float, limit: int) -> list[Eigenpairs]:
    spectrum = Spectrum(springs(values), np.zeros((len(values), 0)), Factoriser(), limit)
    return list(spectrum.up_to(spectrum.shift(bound)))


@pytest.mark.parametrize("limit", sampled([8, 20, 75], 8))
@pytest.mark.parametrize("power", [0.4, 1.0, 3.0])
def test_slices_hold_every_eigenvalue_once(limit: int, power: float) -> None:
    random = np.random.default_rng(3)
    values = np.sort(1e6 * random.uniform(0, 1, 450) ** (1 / power) + 1)
    bound = (values[149] + values[150]) / 2
    parts = sliced(random.permutation(values), bound, limit)
    assert np.concatenate([part.values for part in parts]) == pytest.approx(values[:150], rel=1e-9)
    assert len(parts) > 1
    assert max(len(part.values) for part in parts) <= limit


@pytest.mark.parametrize("bound", [101.0, 115.0, 130.0, 145.0])
def test_a_gap_below_the_bound_leaves_no_empty_slice(bound: float) -> None:
    values = np.concatenate([np.linspace(1, 100, 100), np.linspace(400, 900, 200)])
    parts = sliced(values, bound, 30)
    assert np.concatenate([part.values for part in parts]) == pytest.approx(values[:100], rel=1e-9)
    assert all(len(part.values) for part in parts)


@pytest.mark.parametrize(
    "times", [2, *(pytest.param(times, marks=pytest.mark.prove) for times in (5, 9, 13))]
)
def test_equal_eigenvalues_stay_in_one_slice(times: int) -> None:
    values = np.repeat(np.linspace(10, 1000, 450 // times), times)
    values = values[: len(values) // 3 * 3]
    parts = sliced(np.random.default_rng(4).permutation(values), 504.0, 30)
    found = np.concatenate([part.values for part in parts])
    assert found == pytest.approx(values[values < 504], rel=1e-9)
    vectors = np.hstack([part.vectors for part in parts])
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(len(found)), rtol=0, atol=1e-7)


def test_what_a_slice_missed_is_found_by_the_next(monkeypatch: pytest.MonkeyPatch) -> None:
    values = np.linspace(1.0, 300.0, 300)
    whole = Spectrum.near

    def forgetful(spectrum: Spectrum, shift: Shift, below: int, above: int, *rest: float) -> object:
        """Miss the second one above the shift, as if it were the copy of a degenerate mode."""
        found = whole(spectrum, shift, below, above + 1 if above > 2 else above, *rest)
        if above <= 2:
            return found
        kept = np.delete(np.arange(len(found.values)), below + 1)
        return Eigenpairs(values=found.values[kept], vectors=found.vectors[:, kept])

    monkeypatch.setattr(Spectrum, "near", forgetful)
    found = np.concatenate([part.values for part in sliced(values, 100.5, 20)])
    assert found == pytest.approx(values[:100], rel=1e-9)


def test_a_count_that_contradicts_the_modes_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    values, told = np.linspace(1.0, 450.0, 450), iter([200, 10, 3])
    counted = Spectrum.shift

    def wrong(spectrum: Spectrum, value: float) -> Shift:
        shift = counted(spectrum, value)
        return Shift(value=shift.value, below=next(told), factor=shift.factor)

    monkeypatch.setattr(Spectrum, "shift", wrong)
    with pytest.raises(SolverError, match=r"modes were found up to .* but 3 counted"):
        sliced(values, 200.5, 20)


@pytest.mark.prove
@pytest.mark.parametrize(
    "mesh",
    [pytest.param(BODY, id="box"), pytest.param(CUBE, id="cube")],
)
@pytest.mark.parametrize("slice_limit", [20, 45])
def test_sliced_is_unsliced_is_dense(mesh: VolumeMesh, slice_limit: int) -> None:
    whole, parts, dense = (
        vibration_modes(mesh, UNIT, HIGHEST, solver=solver)
        for solver in (
            Solver(dense_limit=0, slice_limit=10**6),
            Solver(dense_limit=0, slice_limit=slice_limit),
            Solver(dense_limit=10**6),  # LAPACK on whole matrices
        )
    )
    exact = dense.frequencies
    assert len(exact) > 2 * slice_limit
    for modes in (whole, parts):
        assert modes.frequencies == pytest.approx(exact, rel=1e-9)
        assert modes.provenance.details["largest_residual"] < 1e-6
        assert modes.poisson_slopes == pytest.approx(dense.poisson_slopes, abs=1e-4)
    assert parts.provenance.details["sturm_count"] == len(exact)
    assert counted(mesh, HIGHEST) == len(exact)
    same_shapes(parts.shapes, dense.shapes, exact)
    same_shapes(whole.shapes, dense.shapes, exact)


def counted(mesh: VolumeMesh, highest: float) -> int:
    bound = (2 * np.pi * highest) ** 2
    return factorise(assemble(mesh, UNIT).shifted(bound), "superlu").negative - 6


def same_shapes(found: Array, expected: Array, frequencies: Array) -> None:
    """Compare what the modes of one frequency span, by x x' summed over them."""
    apart = np.flatnonzero(np.diff(frequencies) > 1e-7 * frequencies[1:]) + 1
    for group in np.split(np.arange(len(frequencies)), apart):
        one, other = (shapes[:, :, group].reshape(-1, len(group)) for shapes in (found, expected))
        difference = one @ one.T - other @ other.T
        assert np.abs(difference).max() < 1e-4 * np.abs(other).max() ** 2


def test_vectors_of_all_slices_are_orthonormal() -> None:
    system = assemble(CUBE, UNIT)
    known = rigid_motions(CUBE.nodes)
    spectrum = Spectrum(system, known, Factoriser(), 20)
    bound = (2 * np.pi * HIGHEST) ** 2
    parts = list(spectrum.up_to(spectrum.shift(bound)))
    vectors = np.hstack([part.vectors for part in parts])
    mass = np.kron(system.mass_matrix().toarray(), np.eye(3))
    products = vectors.T @ mass @ vectors
    np.testing.assert_allclose(products, np.eye(len(products)), rtol=0, atol=1e-6)
    assert np.abs(known.T @ mass @ vectors).max() < 1e-8


def test_errors_are_asked_for_slice_by_slice() -> None:
    asked: list[int] = []

    def estimate(values: Array, vectors: Array) -> Array:
        assert vectors.shape == (len(BODY.nodes), 3, len(values))
        asked.append(len(values))
        return np.sqrt(values)

    modes = vibration_modes(
        BODY, UNIT, HIGHEST, solver=Solver(dense_limit=0, slice_limit=20), estimate=estimate
    )
    assert modes.errors == pytest.approx(2 * np.pi * modes.frequencies)
    assert max(asked) <= 20
    assert sum(asked) == len(modes.frequencies)


def test_progress_only_grows_over_the_slices() -> None:
    told: list[tuple[str, float]] = []
    vibration_modes(
        BODY,
        UNIT,
        HIGHEST,
        solver=Solver(dense_limit=0, slice_limit=20),
        progress=lambda stage, fraction: told.append((stage, fraction)),
    )
    fractions = [fraction for stage, fraction in told if stage == "solving for modes"]
    assert fractions == sorted(fractions)
    assert 0.9 < fractions[-1] <= 1

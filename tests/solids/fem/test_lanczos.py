"""Block Lanczos on problems whose eigenvalues are known."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial.transform import Rotation

from struck.errors import SolverError
from struck.solids.fem.lanczos import Mass, block_lanczos, rigid_motions, solve_dense

Array = NDArray[np.float64]
NODES = 300
UNIT_MASS = Mass(sparse.identity(NODES, format="csr"))
FREE = np.zeros((3 * NODES, 0))


def diagonal(values: Array, shift: float, count: int, known: Array = FREE) -> Array:
    found = block_lanczos(lambda b: b / (values - shift)[:, None], UNIT_MASS, shift, count, known)
    products = found.vectors.T @ found.vectors
    np.testing.assert_allclose(products, np.eye(count), rtol=0, atol=1e-9)
    rest = values[:, None] * found.vectors - found.values * found.vectors
    assert np.abs(rest).max() <= 1e-5 * found.values.max()
    return found.values


@pytest.mark.parametrize("count", [1, 3, 40, 150])
def test_the_lowest_eigenvalues_are_found(count: int) -> None:
    values = np.sort(np.random.default_rng(1).uniform(1, 1000, 3 * NODES))
    found = diagonal(values, -1.0, count)
    assert found == pytest.approx(values[:count], rel=1e-9)


def test_eigenvalues_that_repeat_are_found_as_often_as_they_occur() -> None:
    values = np.concatenate([[1.0] * 2, [2.0] * 7, [3.0] * 5, np.linspace(4, 500, 886)])
    assert diagonal(values, -0.5, 16) == pytest.approx(values[:16], rel=1e-9)


def test_known_directions_stay_out() -> None:
    values = np.concatenate([np.zeros(6), np.linspace(1, 90, 894)])
    known = np.eye(3 * NODES)[:, :6]
    assert diagonal(values, -0.5, 10, known) == pytest.approx(values[6:16], rel=1e-9)


def test_a_mass_matrix_between_nodes_serves_three_directions() -> None:
    random = np.random.default_rng(2)
    between = sparse.random(NODES, NODES, 0.02, random_state=1)
    between = (between + between.T + 5 * sparse.identity(NODES)).tocsr()
    block = random.normal(size=(3 * NODES, 4))
    expected = np.kron(between.toarray(), np.eye(3)) @ block
    assert Mass(between) @ block == pytest.approx(expected, rel=1e-12)


def test_all_of_a_small_problem_may_be_asked_for_but_no_more() -> None:
    values = np.arange(1.0, 31.0)
    mass, none = Mass(sparse.identity(10, format="csr")), np.zeros((30, 0))

    def solve(block: Array) -> Array:
        return block / (values + 1)[:, None]

    found = block_lanczos(solve, mass, -1.0, 30, none)
    assert found.values == pytest.approx(values, rel=1e-9)
    with pytest.raises(SolverError, match="only 30 of 31 modes exist on this mesh"):
        block_lanczos(solve, mass, -1.0, 31, none)


def test_progress_ends_at_one() -> None:
    told: list[float] = []
    values = np.linspace(1, 90, 3 * NODES)
    block_lanczos(
        lambda b: b / (values + 1)[:, None], UNIT_MASS, -1.0, 12, FREE, progress=told.append
    )
    assert told[-1] == 1
    assert told == sorted(told)


def test_rigid_motions_keep_all_distances() -> None:
    points = np.random.default_rng(6).normal(size=(20, 3)) + 50
    motions = rigid_motions(points).reshape(20, 3, 6)
    between = points[:, None] - points
    relative = motions[:, None] - motions
    assert np.abs(np.einsum("ijd,ijdm->ijm", between, relative)).max() < 1e-10
    # A small turn about an axis moves points as a combination of them.
    turned = Rotation.from_rotvec([1e-7, -2e-7, 1.5e-7]).apply(points) - points
    rest = np.linalg.lstsq(motions.reshape(60, 6), turned.ravel(), rcond=None)[1]
    assert np.sqrt(rest[0]) < 1e-5 * np.linalg.norm(turned)


def test_dense_takes_what_the_band_holds_and_at_least_one() -> None:
    values = np.diag(np.arange(10.0))
    mass = np.eye(10)
    assert solve_dense(values, mass, 6.5, 2).values == pytest.approx([2, 3, 4, 5, 6])
    assert solve_dense(values, mass, 0.5, 2).values == pytest.approx([2])

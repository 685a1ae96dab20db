"""Factorisations: both give the same counts and solutions as LAPACK."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy import sparse

from struck.errors import OptionError, SolverError
from struck.solids.fem.factorisation import Factoriser, factorise, thread_count

Array = NDArray[np.float64]
BACKENDS = ["rslab", "superlu"]


def laplacian(count: int, shift: float) -> sparse.csc_matrix:
    """Return second differences in a square of count x count points less a shift."""
    line = sparse.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(count, count))
    one = sparse.identity(count)
    return (
        sparse.kron(line, one) + sparse.kron(one, line) - shift * sparse.identity(count**2)
    ).tocsc()


def exact_eigenvalues(count: int) -> Array:
    line = 4 * np.sin(np.arange(1, count + 1) * np.pi / (2 * (count + 1))) ** 2
    return np.sort((line[:, None] + line).ravel())


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("shift", [-1.0, 0.5, 2.03, 3.9, 6.6, 9.0])
def test_negative_counts_the_exact_eigenvalues_below(backend: str, shift: float) -> None:
    lower = sparse.tril(laplacian(17, shift)).tocsc()
    expected = np.count_nonzero(exact_eigenvalues(17) < shift)
    assert factorise(lower, backend).negative == expected


@pytest.mark.parametrize("backend", BACKENDS)
@pytest.mark.parametrize("columns", [1, 5, 16])
def test_solutions_are_those_of_lapack(backend: str, columns: int) -> None:
    matrix = laplacian(17, -1.0)
    right = np.random.default_rng(0).normal(size=(289, columns))
    before = right.copy()
    found = factorise(sparse.tril(matrix).tocsc(), backend).solve(right)
    np.testing.assert_allclose(found, np.linalg.solve(matrix.toarray(), right), 1e-11, 1e-13)
    assert np.array_equal(right, before)


def test_pivots_keep_indefinite_systems_accurate() -> None:
    matrix = laplacian(17, 2.03)
    right = np.random.default_rng(0).normal(size=(289, 4))
    found = factorise(sparse.tril(matrix).tocsc(), "rslab").solve(right)
    assert np.abs(matrix @ found - right).max() <= 1e-11 * np.abs(found).max()


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_pattern_is_factorised_again_with_other_numbers(backend: str) -> None:
    factoriser = Factoriser(backend)
    for shift in (-1.0, 2.03, 6.6):
        factor = factoriser(sparse.tril(laplacian(17, shift)).tocsc())
        assert factor.negative == np.count_nonzero(exact_eigenvalues(17) < shift)


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_singular_matrix_is_refused(backend: str) -> None:
    # Two separate chains of springs; one of them floats.
    chain = sparse.diags([2.0, -1.0, -1.0], [0, 1, -1], shape=(6, 6)).tolil()
    floating = chain.copy()
    floating[0, 0] = floating[5, 5] = 1.0
    matrix = sparse.block_diag([chain, floating]).tocsc()
    with pytest.raises(SolverError, match="cannot be factorised"):
        factorise(sparse.tril(matrix).tocsc(), backend)


def test_superlu_takes_over_where_rslab_is_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rslab", None)
    lower = sparse.tril(laplacian(9, 2.1)).tocsc()
    expected = np.count_nonzero(exact_eigenvalues(9) < 2.1)
    assert factorise(lower, "auto").negative == expected
    with pytest.raises(ImportError):
        factorise(lower, "rslab")


def test_an_unknown_backend_is_refused() -> None:
    with pytest.raises(OptionError, match="backend is 'mumps'"):
        factorise(sparse.identity(3).tocsc(), "mumps")


def test_threads_follow_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    assert thread_count() == 3
    for nonsense in ("", "0", "many"):
        monkeypatch.setenv("OMP_NUM_THREADS", nonsense)
        assert 1 <= thread_count() <= 4


FORKED = """
import multiprocessing, os, sys
import numpy as np
import struck
from struck.solids import Block

def analysed(backend):
    block = Block(size=(0.11, 0.07, 0.043), elements=(2, 2, 1))
    model = struck.analyze(block, "steel", band=(20.0, 20e3), backend=backend)
    struck.render(model, struck.Strike(impulse=0.01), seconds=0.01)
    return model.frequencies, model

def agrees(backend):
    return bool(np.allclose(analysed(backend)[0], here, rtol=1e-9, atol=0.0))

here, model = analysed("auto")
child = os.fork()
if not child:
    same = agrees("auto")
    grandchild = os.fork()
    if not grandchild:
        os._exit(0 if agrees("rslab") else 1)
    os._exit(0 if same and os.waitpid(grandchild, 0)[1] == 0 else 1)
assert os.waitpid(child, 0)[1] == 0
with multiprocessing.get_context("fork").Pool(2) as pool:
    found = pool.map(analysed, ["auto", "auto"])
assert all(np.allclose(each, here, rtol=1e-9, atol=0.0) for each, _ in found)
assert agrees("auto")
"""


@pytest.mark.prove
@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
@pytest.mark.parametrize("threads", ["1", pytest.param("2", marks=pytest.mark.prove)])
def test_forked_processes_find_the_modes_that_their_parent_found(threads: str) -> None:
    """Child, grandchild, a pool: the threads of the parent's factorisation are not theirs."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", FORKED],
        env={**os.environ, "OMP_NUM_THREADS": threads},
        capture_output=True,
        timeout=300,  # it takes seconds; a busy machine takes longer, and locked threads for ever
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")

"""Sparse factorisation K - shift M = L D L^T, by rslab or, with the same answers, by SuperLU.

Also the memory that it takes.

The signs of D count the eigenvalues below the shift (Sylvester's law of inertia; Parlett 1998,
section 3.3), which is what proves that no mode is missing.
"""

from __future__ import annotations

import importlib
import itertools
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np
from scipy import sparse

from struck.core.machine import GIB, thread_count
from struck.errors import SolverError, require_choice, rounded
from struck.model.arrays import Array
from struck.processes.address_space import free_address_space

if TYPE_CHECKING:
    from rslab import LdltSymbolic


_ENTRY = 64  # bytes of a stored entry while a matrix is put together and handed over, measured
_WORKING_VECTORS = 64  # that iterating works on, over and above those it keeps


def forecast(
    *,
    unknowns: int,
    entries: int,
    factor: int,
    resident_bytes: int,
    modes: int,
    shown_numbers: int = 0,
) -> int:
    """Return the most bytes that finding modes takes on top of the assembled matrices."""
    # `factor`, `resident_bytes`: bytes of a factorisation at its peak and afterwards; `modes`: of
    # one slice; `entries`: of the lower triangle; `shown_numbers`: stored for all modes, their
    # shapes on the surface.
    basis = 3 * modes + _WORKING_VECTORS
    iterating = _ENTRY // 2 * entries + resident_bytes + 8 * unknowns * (basis + modes)
    return max(_ENTRY * entries + factor, iterating) + 8 * shown_numbers


def require(needed_bytes: int, free: int | None, coarser: str = "") -> None:
    """Raise SolverError when more bytes are needed than are known to be free.

    The message offers the `coarser` settings, if there are any.
    """
    if free is not None and needed_bytes > free:
        raise SolverError(
            f"finding the modes needs about {rounded(needed_bytes / GIB, 3)} GiB of memory, but "
            f"{rounded(free / GIB, 3)} GiB are free: use {coarser}{', ' if coarser else ''}a "
            "simpler mesh, a thicker wall, a narrower band=, or a machine with more memory"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Factor:
    """A factorised symmetric matrix: how many eigenvalues are negative, and how it is solved."""

    negative: int
    solve: Callable[[Array], Array]  # from a block of right-hand sides (n, b) to solutions


class Factoriser:
    """Factorises symmetric matrices of one pattern of entries; rslab orders them only once."""

    def __init__(self, backend: str = "auto") -> None:
        require_choice("backend", backend, _BACKENDS)
        self._backend = backend
        self._analysis: LdltSymbolic | None = None

    def __call__(self, lower: sparse.csc_matrix) -> Factor:
        """Factorise a matrix given by its lower triangle; SolverError when it is singular."""
        return (
            _factorise_by_superlu(lower)
            if self._choose(lower) == "superlu"
            else self._factorise_by_rslab(lower)
        )

    def memory(self, lower: sparse.csc_matrix) -> tuple[int, int]:
        """Return the bytes that a factorisation will take: at its peak, and afterwards."""
        # rslab knows; for SuperLU, fill grows as the diameter of bodies, solid or hollow.
        if self._choose(lower) == "superlu":
            peak = int(_SUPERLU_BYTES * lower.nnz * lower.shape[0] ** (1 / 3))
            is_limited = free_address_space() is not None
            growth, reserve = (_SUPERLU_GROWTH, _SUPERLU_RESERVE) if is_limited else (1, 0)
            return peak * growth + reserve, peak // 2
        plan = self._analyse(lower).memory_plan(threads=thread_count(), nrhs=_RIGHT_HAND_SIDES)
        return int(plan["peak_bytes"]), int(plan["resident_bytes"] + plan["solve_bytes"])

    def _choose(self, lower: sparse.csc_matrix) -> str:
        """Return the backend for matrices of this size; the first choice stays."""
        if self._backend == "auto":
            self._backend = _find_backend(lower.shape[0])
        return self._backend

    def _factorise_by_rslab(self, lower: sparse.csc_matrix) -> Factor:
        # Bunch-Kaufman pivots, supernodal.
        analysis = self._analyse(lower)
        try:
            factor = analysis.factor(lower, threads=_find_live_pool())
        except RuntimeError as error:
            raise SolverError(_describe_singular(str(error))) from error
        return Factor(
            negative=int(factor.inertia[1]),
            solve=lambda right: np.asarray(factor.solve_many(np.ascontiguousarray(right))),
        )

    def _analyse(self, lower: sparse.csc_matrix) -> LdltSymbolic:
        import rslab

        if self._analysis is None:
            analysis = rslab.analyze(lower, path="ldlt", threads=_find_live_pool())
            self._analysis = cast("LdltSymbolic", analysis)
        return self._analysis


def _factorise_by_superlu(lower: sparse.csc_matrix) -> Factor:
    """Factorise without row exchanges, so that U's diagonal has the signs of D."""
    from scipy.sparse.linalg import splu

    full_matrix = (lower + sparse.tril(lower, -1).T).tocsc()
    try:
        factor = splu(
            full_matrix,
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
    except RuntimeError as error:
        raise SolverError(_describe_singular(str(error))) from error
    if np.any(factor.perm_r != factor.perm_c):
        raise SolverError(_describe_singular("a pivot vanished"))
    return Factor(
        negative=int(np.count_nonzero(factor.U.diagonal() < 0)),
        solve=lambda right: np.ascontiguousarray(factor.solve(np.asfortranarray(right))),
    )


_BACKENDS = ("auto", "rslab", "superlu")
_RIGHT_HAND_SIDES = 8
_SUPERLU_BYTES = 12
# In a limited address space SuperLU copies an array that grows before it frees the old one. If
# memory is short there, it prints an error and fails.
_SUPERLU_GROWTH = 3
# Bytes of address space there in addition to the factor: heaps of 64 MiB, and buffers that OpenBLAS
# requests for ever if it gets none. Measured: 200 MB with 3,315 unknowns.
_SUPERLU_RESERVE = 2**28
# Address space of rslab 1.7, measured: its allocator reserves 1 GiB and more; the analysis takes
# 32 KiB per unknown, rounded up to a power of two, and keeps it for a coarser and a finer mesh.
_RSLAB_BYTES = 2**31
_RSLAB_BYTES_PER_UNKNOWN = 2**17


def _find_backend(unknowns: int) -> str:
    """Return rslab where it is installed, and where it gets the address space that it reserves.

    It ends the process where it gets none; SuperLU raises a MemoryError.
    """
    room = free_address_space()
    if room is not None and room < _RSLAB_BYTES + _RSLAB_BYTES_PER_UNKNOWN * unknowns:
        return "superlu"
    try:
        importlib.import_module("rslab")
    except ImportError:
        return "superlu"
    return "rslab"


def factorise(lower: sparse.csc_matrix, backend: str = "auto") -> Factor:
    """Factorise one symmetric matrix given by its lower triangle (n, n)."""
    return Factoriser(backend)(lower)


# rslab keeps a pool for each number of threads, and a fork leaves the threads of all of them in the
# parent. A child uses a number that is new to it: SuperLU would take twice as long, and the
# answers do not depend on how many threads there are.
_POOLS: set[int] = set()  # numbers of threads that were used here or before a fork
_LOST_POOLS: set[int] = set()  # numbers whose threads stayed in a parent


def _find_live_pool() -> int:
    """Return `thread_count`, or the lowest number of threads whose pool no fork has emptied."""
    choices = itertools.chain([thread_count()], itertools.count(1))
    count = next(count for count in choices if count not in _LOST_POOLS)
    _POOLS.add(count)
    return count


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=lambda: _LOST_POOLS.update(_POOLS))


def _describe_singular(reason: str) -> str:
    return (
        f"the shifted stiffness matrix cannot be factorised ({reason}): the body may hang "
        "together by a point, or the band may end exactly on a mode; change band= slightly"
    )

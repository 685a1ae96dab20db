"""Proof that the modes are right: none missing, small residuals, no loose part."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from struck.errors import MeshError, SolverError
from struck.solids.fem.assembly import System
from struck.solids.fem.lanczos import Eigenpairs, Mass

Array = NDArray[np.float64]


def require_complete(values: Array, highest: float, counted: int) -> None:
    """Compare eigenvalues with how many inertia counts up to `highest`.

    Raises
    ------
    SolverError
        When they are not as many, or not in order.
    """
    found = int(np.count_nonzero(values <= highest))
    if found != counted or np.any(np.diff(values) < 0):
        raise SolverError(
            f"{found} modes were found but {counted} exist up to the band's end: "
            "change band= slightly, or report this body"
        )


def require_one_piece(values: Array, highest: float) -> None:
    """Refuse motions without a restoring force.

    Raises
    ------
    MeshError
        When part of the body swings freely.
    """
    loose = int(np.count_nonzero(values < 1e-10 * highest))
    if loose:
        raise MeshError(
            f"{loose} parts of the body hang together by a point or an edge and swing freely: "
            "use a finer lattice (accuracy=), or a thicker wall"
        )


def largest_residual(system: System, pairs: Eigenpairs) -> float:
    """Return the largest |K x - lambda M x| / |K x| of the pairs."""
    lower, mass = system.shifted(0.0), Mass(system.mass_matrix())
    upper = sparse.tril(lower, -1).T
    worst = 0.0
    # A few at a time: a slice's vectors are large enough once.
    for start in range(0, len(pairs.values), 16):
        some = slice(start, start + 16)
        vectors = np.ascontiguousarray(pairs.vectors[:, some])
        push = lower @ vectors + upper @ vectors
        rest = push - (mass @ vectors) * pairs.values[some]
        ratios = np.linalg.norm(rest, axis=0) / np.linalg.norm(push, axis=0)
        worst = max(worst, float(ratios.max()))
    return worst

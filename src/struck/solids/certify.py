"""Proof that the modes are right: none missing, small residuals, no loose part."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from struck.errors import MeshError, SolverError
from struck.solids.assembly import System
from struck.solids.eigen import Eigenpairs
from struck.solids.factor import Factoriser

Array = NDArray[np.float64]


def counted_below(system: System, highest: float, rigid: int, factorise: Factoriser) -> int:
    """Count the elastic eigenvalues up to `highest` by Sturm's count (Parlett 1998, section 3.3).

    Raises
    ------
    SolverError
        When `highest` lies on an eigenvalue too exactly to tell the sides apart.
    """
    for nudge in (0.0, 1e-6, -1e-6):
        try:
            return factorise(system.shifted(highest * (1 + nudge))).negative - rigid
        except SolverError as error:
            last = error
    raise last


def certify(system: System, pairs: Eigenpairs, highest: float, counted: int) -> float:
    """Return the largest relative residual |K x - lambda M x| / |K x| of pairs up to `highest`.

    Raises
    ------
    SolverError
        When the pairs up to `highest` are not as many as `counted`.
    MeshError
        When part of the body swings freely.
    """
    found = int(np.count_nonzero(pairs.values <= highest))
    if found != counted:
        raise SolverError(
            f"{found} modes were found but {counted} exist up to the band's end: "
            "change band= slightly, or report this body"
        )
    loose = int(np.count_nonzero(pairs.values < 1e-10 * max(pairs.values[-1], highest)))
    if loose:
        raise MeshError(
            f"{loose} parts of the body hang together by a point or an edge and swing freely: "
            "use a finer lattice (accuracy=), or a thicker wall"
        )
    return _largest_residual(system, pairs)


def _largest_residual(system: System, pairs: Eigenpairs) -> float:
    lower = system.shifted(0.0)
    push = lower @ pairs.vectors + sparse.tril(lower, -1).T @ pairs.vectors
    count = pairs.vectors.shape[1]
    inertial = system.mass_matrix() @ pairs.vectors.reshape(system.node_count, 3 * count)
    rest = push - inertial.reshape(push.shape) * pairs.values
    return float((np.linalg.norm(rest, axis=0) / np.linalg.norm(push, axis=0)).max())

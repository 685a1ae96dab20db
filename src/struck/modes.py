"""Modes: how an undamped body vibrates, and the shapes as seen on its surface."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from struck.mesh import Mesh
from struck.provenance import Provenance


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Modes:
    """Undamped modes of a body with its surface.

    Parameters
    ----------
    frequencies : array (M,)
        Natural frequencies, ascending, Hz.
    surface : Mesh
        The body's surface, where the shapes are given.
    shapes : array (V, 3, M)
        Mass-normalised mode shapes at the surface's vertices, kg^-1/2.
    mass : float
        kg.
    centre : array (3,)
        Centre of mass, m.
    inertia : array (3, 3)
        Moments of inertia about `centre`, kg m^2.
    complete_to : float
        No mode below this frequency is missing, Hz.
    poisson_slopes : array (M,)
        d ln f / d(Poisson's ratio) at constant Young's modulus.
    errors : array (M,)
        Relative discretisation error of each frequency; NaN where unknown.
    supported : bool
        Whether the body is held somewhere, so that it cannot move as a rigid one.
    provenance : Provenance
        How the modes were made.
    """

    frequencies: NDArray[np.float64]
    surface: Mesh
    shapes: NDArray[np.float64]
    mass: float
    centre: NDArray[np.float64]
    inertia: NDArray[np.float64]
    complete_to: float
    poisson_slopes: NDArray[np.float64]
    errors: NDArray[np.float64]
    supported: bool = False
    provenance: Provenance = field(default_factory=Provenance)

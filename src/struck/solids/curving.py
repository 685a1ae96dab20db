"""Boundary nodes moved onto the true surface, as far as no element folds over.

Straight-sided quadratic tetrahedra are worse than linear hexahedra on curved walls: the
geometry must be quadratic too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from struck.solids.volume import VolumeMesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# Smallest allowed ratio of an element's least Jacobian determinant to its mean.
_FLATTEST = 0.02


def curved(mesh: VolumeMesh, projected: Callable[[Array], Array]) -> tuple[VolumeMesh, int]:
    """Return the quadratic mesh with its boundary on the true surface.

    Parameters
    ----------
    mesh : VolumeMesh
        Linear elements whose boundary nodes lie near the surface.
    projected : callable
        Moves points (K, 3) onto the surface.

    Returns
    -------
    VolumeMesh
        Quadratic elements, none folded.
    int
        Count of boundary nodes that had to stay short of the surface.
    """
    corners = np.unique(np.concatenate([side.ravel() for side in mesh.boundary_sides()]))
    linear, held = _moved(mesh, corners, projected)
    quadratic = linear.promoted()
    every = np.unique(np.concatenate([side.ravel() for side in quadratic.boundary_sides()]))
    result, short = _moved(quadratic, every[every >= len(linear.nodes)], projected)
    return result, held + short


def _moved(
    mesh: VolumeMesh, chosen: Index, projected: Callable[[Array], Array]
) -> tuple[VolumeMesh, int]:
    """Move the `chosen` nodes onto the surface, or part of the way where elements would fold."""
    way = projected(mesh.nodes[chosen]) - mesh.nodes[chosen]
    share = np.ones(len(chosen))
    for step in (0.5, 0.5, 0.5, 0.0):
        nodes = mesh.nodes.copy()
        nodes[chosen] += share[:, None] * way
        result = replace(mesh, nodes=nodes)
        folded = result.elements[flatness(result) < _FLATTEST]
        if not len(folded):
            break
        share[np.isin(chosen, folded)] *= step
    return result, int(np.count_nonzero(share < 1))


def flatness(mesh: VolumeMesh) -> Array:
    """Return least over mean Jacobian determinant of each element, at nodes and points (E,)."""
    points = np.vstack([mesh.element.nodes, mesh.element.mass_rule.points])
    parts = []
    for chunk in mesh.chunks():
        determinants = np.linalg.det(mesh.jacobians(points, chunk))
        mean = np.abs(determinants).mean(axis=1)
        parts.append(determinants.min(axis=1) / np.maximum(mean, np.finfo(float).tiny))
    return np.concatenate(parts)

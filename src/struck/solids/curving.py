"""Boundary nodes moved onto the true surface, as far as no element folds over.

Straight-sided quadratic tetrahedra are worse than linear hexahedra on curved walls: the
geometry must be quadratic too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from struck.solids.cutting import Cells
from struck.solids.volume import VolumeMesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
Onto = Callable[[float, Array], Array]
HALFWAY = 0.5
# Smallest allowed ratio of an element's least Jacobian determinant to its mean.
_FLATTEST = 0.02
_HALVINGS = 3


def curved(cells: Cells, onto: Onto, up: str = "z") -> tuple[VolumeMesh, int]:
    """Return quadratic tetrahedra with their boundary on the true surface.

    Parameters
    ----------
    cells : Cells
        Linear tetrahedra; which surface a node lies near is where its depth is 0.
    onto : callable
        Moves points (K, 3) onto the surface of a number; 0.5 is halfway from surface 0 to 1.
    up : str
        The axis that points up.

    Returns
    -------
    VolumeMesh
        Quadratic elements, none folded.
    int
        Count of boundary nodes that had to stay short of the surface.
    """
    linear = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4", up=up)
    on = {surface: cells.depths[:, surface] == 0 for surface in range(cells.depths.shape[1])}
    linear, held = _moved(linear, on, onto)
    quadratic = linear.promoted()
    result, short = _moved(quadratic, _middles(quadratic, on), onto)
    return result, held + short


def _middles(mesh: VolumeMesh, on: dict[float, Flags]) -> dict[float, Flags]:
    """Tell which mid-edge nodes lie near which surface: those of the boundary, and of the wall.

    Edges through a thin wall must bow as its faces do, or the faces would pass them.
    """
    found = {surface: np.zeros(len(mesh.nodes), bool) for surface in on}
    for sides in mesh.boundary_sides():
        corners, middles = sides[:, :3], sides[:, 3:]
        for surface, flags in on.items():
            along = flags[corners] & flags[np.roll(corners, -1, axis=1)]
            found[surface][middles[along]] = True
    if 1 in on:
        first, second = mesh.elements[:, np.array(mesh.element.edges)].transpose(2, 0, 1)
        through = (on[0][first] & on[1][second]) | (on[1][first] & on[0][second])
        found[HALFWAY] = np.zeros(len(mesh.nodes), bool)
        found[HALFWAY][mesh.elements[:, len(mesh.element.corners) :][through]] = True
    return found


def _moved(mesh: VolumeMesh, on: dict[float, Flags], onto: Onto) -> tuple[VolumeMesh, int]:
    """Move nodes onto their surfaces, or part of the way where elements would fold."""
    chosen = np.flatnonzero(np.any(list(on.values()), axis=0))
    goal = mesh.nodes[chosen]
    for surface, flags in on.items():
        near = flags[chosen]
        goal[near] = onto(surface, goal[near])
    way = goal - mesh.nodes[chosen]
    share, halvings = np.ones(len(chosen)), 0
    while True:
        nodes = mesh.nodes.copy()
        nodes[chosen] += share[:, None] * way
        result = replace(mesh, nodes=nodes)
        folded = np.isin(chosen, result.elements[flatness(result) < _FLATTEST])
        if not share[folded].any():
            break
        share[folded] *= 0.5 if halvings < _HALVINGS else 0.0
        halvings += 1
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

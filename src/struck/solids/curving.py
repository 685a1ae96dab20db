"""Boundary nodes moved onto the true surface, as far as no element folds over.

Straight-sided quadratic tetrahedra are worse than linear hexahedra on curved walls: the
geometry must be quadratic too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from struck.solids.cutting import PAIRS, Cells
from struck.solids.filling.creases import Features
from struck.solids.volume_mesh import VolumeMesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
Onto = Callable[[float, Array], Array]
HALFWAY = 0.5
# Smallest allowed ratio of an element's least Jacobian determinant to its mean.
_FLATTEST = 0.02
_HALVINGS = 3
# No tetrahedron gets flatter than this by moving, unless half as flat as it was.
_LEAST_SHAPE = 0.05
_CHUNK = 4096


def curved(
    cells: Cells, onto: Onto, up: str = "z", features: Features | None = None
) -> tuple[VolumeMesh, int]:
    """Return quadratic tetrahedra with their boundary on the true surface.

    Parameters
    ----------
    cells : Cells
        Linear tetrahedra; which surface a node lies near is where its depth is 0.
    onto : callable
        Moves points (K, 3) onto the surface of a number; 0.5 is halfway from surface 0 to 1.
    up : str
        The axis that points up.
    features : Features, optional
        Crisp edges of surface 0 that the body shall keep.

    Returns
    -------
    VolumeMesh
        Quadratic elements, none folded.
    int
        Count of boundary nodes that had to stay short of the surface.
    """
    linear = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4", up=up)
    surfaces = range(cells.depths.shape[1])
    on: dict[float, Flags] = {number: cells.depths[:, number] == 0 for number in surfaces}
    linear, held = _moved(linear, on, onto)
    linear = linear if features is None else features.kept(linear, on[0])
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


def _any(on: dict[float, Flags]) -> Flags:
    return np.asarray(np.any(list(on.values()), axis=0))


def _ways(mesh: VolumeMesh, on: dict[float, Flags], onto: Onto) -> Array:
    """Return how far each node is from the surfaces it belongs on, one after the other (N, 3)."""
    goal = mesh.nodes.copy()
    for surface, flags in on.items():
        goal[flags] = onto(surface, goal[flags])
    return goal - mesh.nodes


def _moved(mesh: VolumeMesh, on: dict[float, Flags], onto: Onto) -> tuple[VolumeMesh, int]:
    """Move nodes onto their surfaces, or part of the way where elements would fold."""
    way = _ways(mesh, on, onto)
    least = np.minimum(_LEAST_SHAPE, shapes(mesh) / 2)
    share, halvings = _any(on).astype(float), 0
    flat, stirred = np.zeros(len(mesh.elements), bool), share > 0
    while True:
        nodes = mesh.nodes + share[:, None] * way
        again = np.flatnonzero(stirred[mesh.elements].any(axis=1))
        moved = replace(mesh, nodes=nodes)
        flat[again] = flatness(moved, again) < _FLATTEST
        flat[again] |= shapes(moved, again) < least[again]
        stirred = np.zeros(len(share), bool)
        stirred[mesh.elements[flat]] = True
        stirred &= share > 0
        if not stirred.any():
            break
        share[stirred] *= 0.5 if halvings < _HALVINGS else 0.0
        halvings += 1
    return replace(mesh, nodes=nodes), int(np.count_nonzero(share[_any(on)] < 1))


def flatness(mesh: VolumeMesh, chosen: Index | slice = slice(None)) -> Array:
    """Return least over mean Jacobian determinant of the chosen elements, at nodes and points.

    Returns
    -------
    array (E,)
        1 in straight-sided tetrahedra, negative in folded elements.
    """
    points = np.vstack([mesh.element.nodes, mesh.element.mass_rule.points])
    gradients = mesh.element.gradients(points).transpose(2, 1, 0)
    elements = mesh.elements[chosen]
    parts = []
    for start in range(0, len(elements), _CHUNK):
        corners = mesh.nodes[elements[start : start + _CHUNK]].transpose(2, 0, 1)
        found = _determinants(corners[:, None] @ gradients)
        mean = np.abs(found).mean(axis=1)
        parts.append(found.min(axis=1) / np.maximum(mean, np.finfo(float).tiny))
    return np.concatenate(parts) if parts else np.empty(0)


def shapes(mesh: VolumeMesh, chosen: Index | slice = slice(None)) -> Array:
    """Return the volume of tetrahedra between the corners over that of edges all alike (E,).

    1 in the regular one; the edges' mean square stands for their length (Liu & Joe 1994).
    """
    corners = mesh.nodes[mesh.corners[chosen]].transpose(2, 1, 0)
    edges = np.stack([corners[:, b] - corners[:, a] for a, b in PAIRS])
    square = (edges**2).sum(axis=1).mean(axis=0)
    return np.sqrt(2) * _determinants(edges[:3].transpose(1, 0, 2)) / square**1.5


def _determinants(matrices: Array) -> Array:
    """Return the determinants of matrices (3, 3, ...): many small ones, far faster than LU."""
    (a, b, c), (d, e, f), (g, h, i) = matrices
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)

"""Linear tetrahedra on the corners of any elements: what the paper of 2002 computes with."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.solids.volume_mesh import VolumeMesh

Index = NDArray[np.int64]


def linear_tetrahedra(mesh: VolumeMesh) -> VolumeMesh:
    """Return tetrahedra between the corners of the elements.

    Hexahedra and wedges get a node in each side and one within, so that neighbours agree on
    every side without a rule for diagonals.
    """
    corners = mesh.corners
    if corners.shape[1] == 4:
        return _compact(mesh, mesh.nodes, corners)
    middles = mesh.nodes[corners].mean(axis=1)
    within = len(mesh.nodes) + np.arange(len(corners))
    nodes, parts = [mesh.nodes, middles], []
    start = len(mesh.nodes) + len(corners)
    for count in sorted({len(side) for side in mesh.element.sides}):
        sides = np.array([side for side in mesh.element.sides if len(side) == count])
        every = corners[:, sides].reshape(-1, count)
        _, first, number = np.unique(
            np.sort(every, axis=1), axis=0, return_index=True, return_inverse=True
        )
        nodes.append(mesh.nodes[every[first]].mean(axis=1))
        hub = start + number.ravel()
        start += len(first)
        ring = zip(every.T, np.roll(every, -1, axis=1).T, strict=True)
        apex = np.repeat(within, len(sides))
        parts += [np.stack([b, a, hub, apex], axis=1) for a, b in ring]
    return _compact(mesh, np.vstack(nodes), np.vstack(parts))


def _compact(mesh: VolumeMesh, nodes: NDArray[np.float64], elements: Index) -> VolumeMesh:
    used, local = np.unique(elements, return_inverse=True)
    return VolumeMesh(nodes=nodes[used], elements=local.reshape(-1, 4), kind="tet4", up=mesh.up)

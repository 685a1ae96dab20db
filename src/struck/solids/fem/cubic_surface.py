"""Surface of cubic elements: sixteen triangles a side, and the displacements of their corners.

Cubic elements are few and large, so triangles through their nodes alone would show neither their
form nor the shapes of their modes.
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from struck.model.arrays import Array, Index
from struck.model.mesh import Mesh
from struck.solids.fem.assembly import Hierarchic, edge_or_side_keys
from struck.solids.volume_mesh import VolumeMesh

_CUTS = 4  # of each edge
_EDGES = ((0, 1), (1, 2), (2, 0))  # of a side; their midside nodes are 3, 4 and 5


def surface_of(mesh: VolumeMesh, added: Hierarchic) -> tuple[Mesh, sparse.csr_array]:
    """Return the boundary as triangles, and the matrix from all functions to its vertices."""
    (sides,) = mesh.boundary_sides()
    steps, triangles = _lattice()
    names = _names(sides, steps, len(mesh.nodes))
    _, first, numbers = np.unique(names, return_index=True, return_inverse=True)
    side, place = np.divmod(first, len(steps))
    nodal_values, cubic_values = _values(steps / _CUTS)
    points = np.einsum("vn,vnd->vd", nodal_values[place], mesh.nodes[sides[side]])
    columns, signs = _cubics(mesh, added, sides)
    weights = np.hstack([nodal_values[place], cubic_values[place] * signs[side]])
    matrix = sparse.csr_array(
        (
            weights.ravel(),
            np.hstack([sides[side], columns[side]]).ravel(),
            np.arange(len(points) + 1) * weights.shape[1],
        ),
        shape=(len(points), len(mesh.nodes) + added.count),
    )
    matrix.eliminate_zeros()
    faces = numbers.reshape(names.shape)[:, triangles].reshape(-1, 3)
    return Mesh(points=points, faces=faces, up=mesh.up), matrix


def _lattice() -> tuple[Index, Index]:
    """Return points of a triangle in steps along its coordinates (p, 3), and small triangles."""
    steps = [(_CUTS - i - j, i, j) for j in range(_CUTS + 1) for i in range(_CUTS + 1 - j)]
    at = {(i, j): number for number, (_, i, j) in enumerate(steps)}
    upright_triangles = [(at[i, j], at[i + 1, j], at[i, j + 1]) for left, i, j in steps if left > 0]
    inverted_triangles = [
        (at[i + 1, j], at[i + 1, j + 1], at[i, j + 1]) for left, i, j in steps if left > 1
    ]
    return np.array(steps), np.array(upright_triangles + inverted_triangles)


def _names(sides: Index, steps: Index, nodes: int) -> Index:
    """Return a number for each point of each side (S, p) that only the same points share."""
    names = np.empty((len(sides), len(steps)), np.int64)
    for place, step in enumerate(steps):
        ends = np.flatnonzero(step)
        if len(ends) == 1:
            names[:, place] = sides[:, ends[0]] * _CUTS
        elif len(ends) == 2:
            midside_node = 3 + next(
                k for k, edge in enumerate(_EDGES) if set(edge) == set(ends.tolist())
            )
            # Counted from the end with the lower number, as the neighbour does too.
            low, high = sides[:, ends[0]] < sides[:, ends[1]], step[ends]
            names[:, place] = sides[:, midside_node] * _CUTS + np.where(low, high[1], high[0])
        else:
            names[:, place] = (nodes + np.arange(len(sides)) * len(steps) + place) * _CUTS
    return names


def _values(at: Array) -> tuple[Array, Array]:
    """Return the functions of a side's nodes (p, 6), and its cubics (p, 4): edges, then itself."""
    nodal_values = [at[:, k] * (2 * at[:, k] - 1) for k in range(3)]
    nodal_values += [4 * at[:, a] * at[:, b] for a, b in _EDGES]
    cubic_values = [at[:, a] * at[:, b] * (at[:, b] - at[:, a]) for a, b in _EDGES]
    return np.stack(nodal_values, axis=1), np.stack([*cubic_values, at.prod(axis=1)], axis=1)


def _cubics(mesh: VolumeMesh, added: Hierarchic, sides: Index) -> tuple[Index, Array]:
    """Return the numbers (S, 4) and signs of the cubics on the edges of sides, and on a side."""
    member_keys = [_make_keys(mesh.corners[:, member], len(mesh.nodes)) for member in added.members]
    keys, first = np.unique(np.stack(member_keys, axis=1), return_index=True)
    numbers = added.numbers.ravel()[first]
    parts = [sides[:, edge] for edge in _EDGES] + [sides[:, :3]]
    side_keys = np.stack([_make_keys(part, len(mesh.nodes)) for part in parts], axis=1)
    signs = np.ones(side_keys.shape)
    for k, (a, b) in enumerate(_EDGES):
        signs[:, k] = np.sign(sides[:, b] - sides[:, a])
    return len(mesh.nodes) + numbers[np.searchsorted(keys, side_keys)], signs


def _make_keys(corners: Index, nodes: int) -> Index:
    return edge_or_side_keys(np.sort(corners, axis=1), nodes)

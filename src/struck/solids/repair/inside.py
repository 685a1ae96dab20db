"""Which points of a lattice lie within the material that a surface winds around.

The winding number (Barill et al. 2018) of a surface without rims only changes across faces: one
value serves all points that faces do not part.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from struck.model.mesh import Mesh
from struck.model.mesh_topology import edges_of
from struck.solids.filling.lattice import Lattice
from struck.solids.repair.exposure import INSIDE, halves, winding

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
# Of pieces of faces, in voxels: their boxes reach into three along each axis.
_LONGEST = 1.99
_STEPS = np.stack(np.meshgrid(*[range(3)] * 3), axis=-1).reshape(-1, 3)
_MOST = 1_000_000
_ROUNDING = 1e-9


def inside(mesh: Mesh, lattice: Lattice) -> Flags:
    """Tell which lattice points the surface winds around (N,): corners first, then centres."""
    region = _regions(mesh, lattice)
    asked, answer = np.arange(len(region)), np.arange(len(region))
    free = region > 0
    if free.any():
        _, first, inverse = np.unique(region[free], return_index=True, return_inverse=True)
        beside = np.flatnonzero(~free)
        asked = np.concatenate([np.flatnonzero(free)[first], beside])
        answer[free] = inverse
        answer[beside] = len(first) + np.arange(len(beside))
    return (winding(mesh, lattice.positions(asked)) > INSIDE)[answer]


def has_rims(mesh: Mesh) -> bool:
    """Tell whether faces do not cancel along some edge, so that the winding number drifts."""
    return bool(edges_of(mesh.faces).balance.any())


def _regions(mesh: Mesh, lattice: Lattice) -> Index:
    """Return the region of each lattice point (N,), from 1; 0 beside faces and where unknown.

    Voxels half as wide as cells, each around a point where corners or centres may be.
    """
    shape = 2 * lattice.counts + 1
    points = int(np.prod(lattice.counts + 1) + np.prod(lattice.counts))
    origin, edge = lattice.origin - lattice.cell / 4, lattice.cell / 2
    triangles = ((mesh.points - origin) / edge)[mesh.faces]
    parts = None if has_rims(mesh) else _small(triangles, shape)
    if parts is None:
        return np.zeros(points, np.int64)
    free = np.ones(shape, bool)
    for voxels in _passed(parts):
        free[tuple(voxels[((voxels >= 0) & (voxels < shape)).all(axis=1)].T)] = False
    regions = np.asarray(ndimage.label(free)[0])  # pyright: ignore[reportIndexIssue]
    grids = regions[::2, ::2, ::2], regions[1::2, 1::2, 1::2]
    return np.concatenate([grid.ravel() for grid in grids]).astype(np.int64)


def _passed(triangles: Array) -> Iterator[Index]:
    """Yield the voxels (V, 3) that small triangles (T, 3, 3) pass through, and some beside."""
    lowest = np.floor(triangles.min(axis=1) - _ROUNDING)
    highest = np.floor(triangles.max(axis=1) + _ROUNDING)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    heights = np.einsum("td,td->t", normals, lowest + 0.5 - triangles[:, 0])
    reach = (0.5 + _ROUNDING) * np.abs(normals).sum(axis=1)
    for step in _STEPS:
        in_box = (lowest + step <= highest).all(axis=1)
        chosen = in_box & (np.abs(heights + normals @ step) <= reach)
        yield (lowest[chosen] + step).astype(np.int64)


def _small(triangles: Array, shape: Index) -> Array | None:
    """Halve triangles (T, 3, 3) down to the size of voxels; None where that takes too many."""
    done, count = [], 0
    while len(triangles):
        near = (triangles.max(axis=1) > -1) & (triangles.min(axis=1) < shape + 1)
        triangles = triangles[near.all(axis=1)]
        small, rest = halves(triangles, _LONGEST)
        done.append(small)
        count += len(small)
        if count + len(rest) > _MOST:
            return None
        triangles = rest
    return np.concatenate([np.empty((0, 3, 3)), *done])

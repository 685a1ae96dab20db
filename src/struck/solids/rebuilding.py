"""A new surface of the material, where the old one crosses itself.

The sign of the distance is that of the winding number (Barill et al. 2018); the new surface is
the boundary of tetrahedra that fill the material (Labelle & Shewchuk 2007), moved onto the faces
of the old one that part material from air.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from struck.closed import is_closed
from struck.errors import MeshError
from struck.geometry import Surface
from struck.mesh import Mesh
from struck.pieces import pieces, submesh, volumes_of
from struck.solids.exposure import INSIDE, winding
from struck.solids.tetrahedra import stuffed
from struck.solids.volume import VolumeMesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# Cells of the lattice on the surface, from coarse to fine, until the volume stays.
_CELLS = (4_000, 9_000, 20_000)
# A long way through air takes more of them than memory holds.
_MOST_CELLS = 2_000_000
_LARGEST_CHANGE = 0.003
_CRUMB = 1e-3
# Of distances that need not be exact.
_SLACK = 0.2
# Lattice planes that graze a flat face can leave pieces joined by an edge: look beside.
_BESIDE = (1.0, 0.93, 0.87)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rebuilt:
    """A new surface.

    Parameters
    ----------
    mesh : Mesh
    spacing : float
        Of the lattice, m.
    change : float
        Of the volume since the lattice before, relative.
    """

    mesh: Mesh
    spacing: float
    change: float


def rebuilt(mesh: Mesh, bounding: Mesh | None, *, roughly: bool = False) -> Rebuilt:
    """Return the boundary of where the surface winds around more than half a time.

    Parameters
    ----------
    mesh : Mesh
        Faces whose normals mostly point outward.
    bounding : Mesh, optional
        Those parts of faces that part material from air: see `exposed`.
    roughly : bool
        On the coarsest lattice alone.

    Raises
    ------
    MeshError
        When the surface winds around nothing, or around parts too thin for the lattice.
    """
    if bounding is None or bounding.volume <= 0:
        raise MeshError(
            "the mesh encloses nothing that could be told from air: its faces point every way; "
            "make the normals consistent in a mesh editor"
        )
    area = float(bounding.areas.sum())
    finest = float(np.cbrt(np.prod(mesh.bounds[1] - mesh.bounds[0]) / _MOST_CELLS))
    spacings = [max(np.sqrt(area / cells), finest) for cells in (_CELLS[:1] if roughly else _CELLS)]
    limits = Limits(bounding, spacings[-1])
    made = [_boundary(mesh, limits, spacings[0])]
    change = np.inf
    for spacing in spacings[1:]:
        made.append(_boundary(mesh, limits, spacing))
        before, after = (each.volume for each in made[-2:])
        change = after / before - 1
        if abs(change) <= _LARGEST_CHANGE:
            break
    return Rebuilt(mesh=made[-1], spacing=float(spacings[len(made) - 1]), change=float(change))


def _boundary(mesh: Mesh, limits: Limits, spacing: float) -> Mesh:
    def depth(points: Array) -> Array:
        length = limits.distances(points, 3 * spacing)
        return np.where(winding(mesh, points) > INSIDE, -length, length)

    for share in _BESIDE:
        found = _outside(stuffed(depth, mesh.bounds, share * spacing))
        if is_closed(found):
            return _largest(
                Mesh(points=limits.nearest(found.points), faces=found.faces, up=mesh.up)
            )
    raise MeshError(
        f"the body is too thin for a lattice of {spacing:.3g} m in parts of it: join its pieces "
        "in a mesh editor"
    )


def _outside(mesh: VolumeMesh) -> Mesh:
    """Return the sides of tetrahedra that belong to one of them alone."""
    sides = mesh.elements[:, np.array(mesh.element.sides)].reshape(-1, 3)
    a, b, c = np.sort(sides, axis=1).T
    count = len(mesh.nodes)
    _, first, shared = np.unique((a * count + b) * count + c, return_index=True, return_counts=True)
    used, faces = np.unique(sides[first[shared == 1]], return_inverse=True)
    return Mesh(points=mesh.nodes[used], faces=faces.reshape(-1, 3))


class Limits:
    """Faces that part material from air, prepared for many distances to them."""

    def __init__(self, mesh: Mesh, cell: float) -> None:
        self._surface = Surface(mesh)
        _, first = np.unique(np.floor(mesh.centroids / cell), axis=0, return_index=True)
        self._samples = KDTree(mesh.centroids[first])
        offsets = mesh.points[mesh.faces] - mesh.centroids[:, None]
        self._reach = float(np.linalg.norm(offsets, axis=2).max()) + np.sqrt(3) * cell

    def distances(self, points: Array, within: float) -> Array:
        """Return distances to the faces, m (K,): up to `within` exact, beyond it less than true.

        Only those near the surface have to be exact, and they cost the most.
        """
        length = self._samples.query(points, eps=_SLACK)[0] / (1 + _SLACK) - self._reach
        near = length < within
        if near.any():
            length[near], _, _ = self._surface.closest(points[near])
        return length

    def nearest(self, points: Array) -> Array:
        """Return the nearest points on the faces (K, 3)."""
        return self._surface.closest(points)[2]


def _largest(mesh: Mesh) -> Mesh:
    """Return the mesh without crumbs of the lattice."""
    labels = pieces(mesh)
    volumes = np.abs(volumes_of(mesh, labels))
    return submesh(mesh, np.flatnonzero((volumes > _CRUMB * volumes.max())[labels]))


def lost_share(old: Mesh, new: Rebuilt) -> float:
    """Return how much of the old faces' area lies outside the new surface, far from it."""
    length, _, _ = Surface(new.mesh).closest(old.centroids)
    far = length > 2 * new.spacing
    far[far] = winding(new.mesh, old.centroids[far]) < INSIDE
    return float(old.areas[far].sum() / old.areas.sum())


def invented_share(old: Mesh, new: Rebuilt) -> float:
    """Return how much of the new surface's area lies far from all old faces."""
    length, _, _ = Surface(old).closest(new.mesh.centroids)
    return float(new.mesh.areas[length > 2 * new.spacing].sum() / new.mesh.areas.sum())

"""A new surface of the material, where the old one crosses itself.

The sign of the distance is that of the winding number (Barill et al. 2018); the new surface is
the boundary of tetrahedra that fill the material (Labelle & Shewchuk 2007), moved onto the faces
of the old one that part material from air.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError
from struck.geometry import Surface
from struck.model.mesh import Mesh
from struck.model.mesh_topology import pieces, submesh, volumes_of
from struck.solids.filling.lattice import Lattice
from struck.solids.repair.exposure import INSIDE, winding
from struck.solids.repair.inside import has_rims, inside
from struck.solids.surface.closedness import is_closed
from struck.solids.surface.rebuilding import isosurface

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# Cells of the lattice on the surface, from coarse to fine, until the volume stays.
_CELLS = (4_000, 9_000, 16_000)
# A long way through air takes more of them than memory holds.
_MOST_CELLS, _MOST_CELLS_WITH_RIMS = 1_000_000, 100_000
_WIDER = 1.05
# Faces within the material cost as those in the open do: from here on, cells grow with their area.
_MOST_LAYERS = 4
_LARGEST_CHANGE = 0.003
_CRUMB = 1e-3


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
    area = max(float(bounding.areas.sum()), float(mesh.areas.sum()) / _MOST_LAYERS)
    most = _MOST_CELLS_WITH_RIMS if has_rims(mesh) else _MOST_CELLS
    spacings = [
        _affordable(float(np.sqrt(area / cells)), bounding.bounds, most)
        for cells in (_CELLS[:1] if roughly else _CELLS)
    ]
    limits = Limits(bounding)
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
    lattice = Lattice.over(limits.bounds, spacing)
    within = inside(mesh, lattice)
    for moved in (True, False):
        found = isosurface(lattice, within, limits.distances, moved=moved)
        if found is not None and is_closed(found):
            return _largest(
                Mesh(points=limits.nearest(found.points), faces=found.faces, up=mesh.up)
            )
    raise MeshError(
        f"the body is too thin for a lattice of {spacing:.3g} m: join its pieces in a mesh editor"
    )


def _affordable(spacing: float, bounds: Array, most: int) -> float:
    """Return `spacing`, or a wider one that takes no more than `most` cells to fill the box."""
    while (np.maximum((bounds[1] - bounds[0]) / spacing, 1) + 2).prod() > most:
        spacing *= _WIDER
    return spacing


class Limits:
    """Faces that part material from air, prepared for many distances to them."""

    def __init__(self, mesh: Mesh) -> None:
        self.bounds = mesh.bounds
        self._surface = Surface(mesh)

    def distances(self, points: Array) -> Array:
        """Return distances to the faces, m (K,)."""
        return self._surface.closest(points)[0]

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

"""The skin of a body: what of its surface meets free air, and how it moves there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError
from struck.model.mesh import Mesh
from struck.model.mesh_topology import pieces, submesh

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Skin:
    """The part of a surface that meets free air: all but the walls of closed cavities.

    Parameters
    ----------
    mesh : Mesh
        That part, F faces, none without area, and the vertices that they use.
    faces : array (F,)
        The number of each face in the whole surface.
    """

    mesh: Mesh
    faces: NDArray[np.int64]

    @classmethod
    def of(cls, surface: Mesh, centre: Array) -> Skin:
        """Find the skin of a surface.

        Raises
        ------
        MeshError
            When no piece of the surface encloses a positive volume.
        """
        cones = np.einsum("fd,fd->f", surface.centroids - centre, surface.area_vectors)
        labels = pieces(surface)
        exposed = np.bincount(labels, weights=cones)[labels] > 0
        faces = np.flatnonzero(exposed & (surface.areas > 0))
        if not len(faces):
            raise MeshError(
                f"none of the {labels.max() + 1} pieces of the surface encloses a volume: flip "
                "the normals so that they point out of the material"
            )
        return cls(mesh=submesh(surface, faces), faces=faces)

    @property
    def radius(self) -> float:
        """Radius of the sphere of the same area, m."""
        return float(np.sqrt(self.mesh.areas.sum() / (4 * np.pi)))


def normal_velocities(surface: Mesh, shapes: NDArray[np.floating]) -> Array:
    """Return the normal component of `shapes` (V, 3, M) at each face, mean of its corners (F, M).

    Parameters
    ----------
    surface : Mesh
        A surface of V vertices and F faces.
    shapes : array (V, 3, M)
        Displacements or velocities.

    Returns
    -------
    array (F, M)
        In the unit of `shapes`.
    """
    faces = surface.faces
    columns = (3 * faces[:, :, None] + np.arange(3)).ravel()
    weights = np.repeat(surface.face_normals[:, None] / 3, 3, axis=1).ravel()
    starts, count = np.arange(0, len(columns) + 1, 9), 3 * len(surface.points)
    from scipy.sparse import csr_array  # SciPy takes its time to import

    projection = csr_array((weights, columns, starts), shape=(len(faces), count))
    return np.asarray(projection @ shapes.reshape(count, shapes.shape[2]))

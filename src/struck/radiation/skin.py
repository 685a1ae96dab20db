"""The skin of a body: what of its surface meets free air, and how it moves there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from struck.errors import MeshError
from struck.mesh import Mesh
from struck.pieces import pieces
from struck.radiation.spherical import split_by_order

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Orders:
    """Mean square normal velocity by spherical order.

    Parameters
    ----------
    numbers : array (N + 2, M)
        The orders 0 to N, then a real order above N that stands for all the rest.
    powers : array (N + 2, M)
        Their shares of the mean square, which they add up to, (m/s)^2.
    """

    numbers: Array
    powers: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Skin:
    """The outward-looking part of a surface.

    Parameters
    ----------
    surface : Mesh
        The whole surface.
    centre : array (3,)
        Where directions start, m.
    exposed : array (F,), bool
        Faces that are not the wall of a closed cavity.
    outward : array (F,), bool
        Exposed faces that look away from the centre. The others face an open cavity, such as the
        inside of a bowl, whose air moves to and fro and hardly radiates.
    """

    surface: Mesh
    centre: Array
    exposed: Mask
    outward: Mask

    @classmethod
    def of(cls, surface: Mesh, centre: Array) -> Skin:
        """Find the skin of a surface.

        Raises
        ------
        MeshError
            When no face looks away from `centre`.
        """
        cones = np.einsum("fd,fd->f", surface.centroids - centre, surface.area_vectors)
        labels = pieces(surface)
        exposed = np.bincount(labels, weights=cones)[labels] > 0
        outward = exposed & (cones > 0)
        if not outward.any():
            raise MeshError(
                f"none of the {len(surface.faces)} faces looks away from the centre: flip the "
                "normals so that they point out of the material"
            )
        return cls(surface=surface, centre=centre, exposed=exposed, outward=outward)

    @property
    def area(self) -> float:
        """Area that looks outward, m^2."""
        return float(self.surface.areas[self.outward].sum())

    @property
    def radius(self) -> float:
        """Radius of the sphere of the same area, m."""
        return float(np.sqrt(self.area / (4 * np.pi)))

    def orders(self, velocities: Array) -> Orders:
        """Split the mean square of normal velocities (F, M) into spherical orders."""
        weights = self.surface.areas[self.outward] / self.area
        directions = self.surface.centroids[self.outward] - self.centre
        powers, rest = split_by_order(directions, weights, velocities[self.outward])
        steepness = steepnesses(self.surface.points, self.surface.faces[self.outward], rest)
        above = np.sqrt(self.radius**2 * steepness + 0.25) - 0.5  # nu (nu + 1) on the sphere
        known = np.broadcast_to(np.arange(float(len(powers)))[:, None], powers.shape)
        return Orders(
            numbers=np.vstack([known, np.maximum(above, len(powers))]),
            powers=np.vstack([self._with_volume_flow(powers, velocities), weights @ rest**2]),
        )

    def _with_volume_flow(self, powers: Array, velocities: Array) -> Array:
        """Leave order 0 no more than all exposed faces displace; the excess is a dipole.

        Between the prongs of a fork or inside a bowl, the faces left out take back the air that
        the outward ones push away.
        """
        flow = self.surface.areas[self.exposed] @ velocities[self.exposed] / self.area
        excess = np.maximum(powers[0] - np.square(flow), 0.0)
        return np.vstack([powers[0] - excess, powers[1] + excess, powers[2:]])


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
    projection = csr_array((weights, columns, starts), shape=(len(faces), count))
    return np.asarray(projection @ shapes.reshape(count, shapes.shape[2]))


def steepnesses(points: Array, faces: NDArray[np.int64], values: Array) -> Array:
    """Return the mean squared surface gradient over the mean square (Rayleigh's quotient).

    Parameters
    ----------
    points : array (V, 3)
        m.
    faces : array (F, 3)
        Vertex indices; no face without area.
    values : array (F, M)
        Functions on the faces. They are averaged at the vertices and taken as linear in between,
        in the gradient as in the square, so that the averaging cancels.

    Returns
    -------
    array (M,)
        1/m^2; 0 for a function that vanishes.
    """
    slopes, areas = _slopes(points[faces])
    starts, shape = np.arange(0, faces.size + 1, 3), (len(faces), len(points))
    shares = csr_array((np.repeat(areas / 3, 3), faces.ravel(), starts), shape=shape)
    around = np.maximum(np.asarray(shares.sum(axis=0)), np.finfo(float).tiny)
    averages = np.asarray(shares.T @ values) / around[:, None]
    gradients = (csr_array((part.ravel(), faces.ravel(), starts), shape) for part in slopes)
    energies = sum(areas @ np.square(np.asarray(gradient @ averages)) for gradient in gradients)
    return energies / np.maximum(around @ np.square(averages), np.finfo(float).tiny)


def _slopes(corners: Array) -> tuple[Array, Array]:
    """Return the gradients (3, F, 3) of the functions that are 1 at one corner, and areas (F,)."""
    opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    normals = np.cross(opposite[:, 0], opposite[:, 1])
    doubled = np.linalg.norm(normals, axis=1)
    slopes = np.cross(normals[:, None], opposite) / np.square(doubled)[:, None, None]
    return np.moveaxis(slopes, 2, 0), doubled / 2

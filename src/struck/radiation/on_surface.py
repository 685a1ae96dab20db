"""Surface harmonics: what spherical harmonics are to a sphere, for any surface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh

from struck.model.mesh import Mesh

Array = NDArray[np.float64]

COUNT = 64
"""Harmonics that are told apart, on a sphere those of the orders 0 to 7."""

# Up to so many vertices a full decomposition costs less than an iteration.
_SMALL = 400
_SEED = 1  # of the vector that the iteration starts from


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Split:
    """Normal velocities, split into surface harmonics and a rest.

    Parameters
    ----------
    parts : array (H, M)
        Coefficients of the harmonics, m^2/s; their squares are the share in the integral of the
        square, m^4/s^2.
    rest : array (V, M)
        What the harmonics leave, at the vertices, m/s.
    rest_orders : array (M,)
        The order that stands for all of the rest.
    rest_powers : array (M,)
        Its share in the integral of the square, m^4/s^2.
    """

    parts: Array
    rest: Array
    rest_orders: Array
    rest_powers: Array


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceHarmonics:
    """Eigenfunctions of the surface Laplacian, the smoothest ones.

    On a sphere of radius a, they are the spherical harmonics, and the eigenvalue is
    n (n + 1) / a^2. Elsewhere the same formula with the radius of the sphere of the same area
    gives each its order, a real number.

    Parameters
    ----------
    mesh : Mesh
        V vertices, all of them used, and F faces, none without area.
    stiffness : sparse (V, V)
        Integral of the product of gradients, for linear functions on the faces.
    masses : array (V,)
        Area that belongs to each vertex, m^2.
    functions : array (V, H)
        Orthonormal, 1/m: their squares integrate to 1.
    orders : array (H,)
        From 0 on.
    radius : float
        Of the sphere of the same area, m.
    """

    mesh: Mesh
    stiffness: sparse.csc_array
    masses: Array
    functions: Array
    orders: Array
    radius: float

    @classmethod
    def of(cls, mesh: Mesh, radius: float) -> SurfaceHarmonics:
        """Find the harmonics of a surface."""
        stiffness, masses = laplacian(mesh)
        eigenvalues, functions = _smoothest(stiffness, masses, radius)
        return cls(
            mesh=mesh,
            stiffness=stiffness,
            masses=masses,
            functions=functions,
            orders=_orders(eigenvalues, radius),
            radius=radius,
        )

    def split(self, velocities: Array) -> Split:
        """Split normal velocities of the faces (F, M).

        The order of the rest is that of its mean squared gradient over its mean square
        (Rayleigh's quotient), for which it is averaged at the vertices and linear in between.
        """
        flows = _at_corners(self.mesh) @ velocities
        parts = self.functions.T @ flows
        rest = flows / self.masses[:, None] - self.functions @ parts
        steepness = np.einsum("vm,vm->m", rest, self.stiffness @ rest)
        smooth = np.maximum(self.masses @ np.square(rest), np.finfo(float).tiny)
        whole = self.mesh.areas @ np.square(velocities)
        return Split(
            parts=parts,
            rest=rest,
            rest_orders=np.maximum(_orders(steepness / smooth, self.radius), self.orders.max()),
            rest_powers=np.maximum(whole - np.square(parts).sum(axis=0), 0.0),
        )


def laplacian(mesh: Mesh) -> tuple[sparse.csc_array, Array]:
    """Return the stiffness (V, V) and the lumped mass (V,) of the surface Laplacian.

    Linear finite elements on the faces (the cotangent Laplacian; Pinkall & Polthier 1993).

    Parameters
    ----------
    mesh : Mesh
        No face without area.

    Returns
    -------
    stiffness : sparse (V, V)
        Of no unit.
    masses : array (V,)
        m^2.
    """
    corners = mesh.points[mesh.faces]
    opposite = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    products = np.einsum("fid,fjd->fij", opposite, opposite) / (4 * mesh.areas)[:, None, None]
    rows, columns = np.repeat(mesh.faces, 3, axis=1), np.tile(mesh.faces, (1, 3))
    shape = (len(mesh.points), len(mesh.points))
    stiffness = sparse.coo_array((products.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
    return stiffness.tocsc(), _at_corners(mesh) @ np.ones(len(mesh.faces))


def _at_corners(mesh: Mesh) -> sparse.csc_array:
    """Return the matrix (V, F) that gives each corner of a face a third of its integral."""
    starts = np.arange(0, mesh.faces.size + 1, 3)
    shape = (len(mesh.points), len(mesh.faces))
    return sparse.csc_array((np.repeat(mesh.areas / 3, 3), mesh.faces.ravel(), starts), shape)


def _orders(eigenvalues: Array, radius: float) -> Array:
    """Return the real order nu with nu (nu + 1) = radius^2 eigenvalue."""
    return np.sqrt(radius**2 * np.maximum(eigenvalues, 0.0) + 0.25) - 0.5


def _smoothest(stiffness: sparse.csc_array, masses: Array, radius: float) -> tuple[Array, Array]:
    """Return the lowest eigenvalues (H,) and the functions (V, H)."""
    if len(masses) <= _SMALL:
        eigenvalues, functions = eigh(stiffness.toarray(), np.diag(masses))
    else:
        eigenvalues, functions = eigsh(
            stiffness,
            k=COUNT,
            M=sparse.diags_array(masses).tocsc(),
            sigma=-1 / radius**2,  # below all of them, where the matrix is regular
            v0=np.random.default_rng(_SEED).normal(size=len(masses)),
        )
    return eigenvalues[:COUNT], functions[:, :COUNT]

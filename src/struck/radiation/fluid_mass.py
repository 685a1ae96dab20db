"""Added mass: the inertia of a fluid that the modes of a body move.

A mode with the normal velocity v_n makes the pressure rho p_n per acceleration, and

    A_mn = rho * integral of v_m p_n over the wet faces

is added to the mass matrix, which is the unit matrix of mass-normalised modes. Two surfaces have
such a matrix here: a wet surface of a solid body, where the fluid is incompressible, and a flat
sheet, whose two sides are too close for boundary elements on each. Derivation: docs,
"Fluid loading".
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.spatial.distance import cdist

from struck.model.arrays import Array, Complex, Index
from struck.model.mesh import Mesh
from struck.radiation.boundary_elements import (
    BoundaryElements,
    row_blocks,
    run_in_threads,
)
from struck.radiation.on_surface import face_means, opposite_edges, weigh_corners


def surface_mass(
    mesh: Mesh, velocities: Array, density: float, level: float | None = None
) -> Array:
    """Compute the added mass (M, M) of an incompressible fluid that meets a surface.

    Collocation at the centres of triangles of constant pressure p and acceleration v, whose normals
    point into the fluid: p / 2 - D p = S v, with the double layer D and the single layer S of
    Laplace's equation. At a free surface the pressure is 0, which the images of both layers with
    the opposite sign provide.

    Parameters
    ----------
    mesh : Mesh
        The wet faces, F triangles, all of them below `level`.
    velocities : array (F, M)
        Normal velocities of the faces for unit modal velocity, kg^-1/2.
    density : float
        Density of the fluid, kg/m^3.
    level : float, optional
        Height of the free surface along the axis `mesh.up`, m. Default: the fluid has none.
    """
    elements = BoundaryElements.of(mesh)
    count, centres = len(mesh.faces), mesh.centroids
    images = centres.copy()
    if level is not None:
        axis = "xyz".index(mesh.up)
        images[:, axis] = 2 * level - centres[:, axis]
    matrix, sources = np.empty((count, count)), np.empty((count, velocities.shape[1]))

    def fill(rows: slice) -> None:
        doubles = np.empty((len(centres[rows]), count), np.complex128)
        singles = elements.layers(centres[rows], 0.0, doubles, rows.start)
        if level is not None:
            image_doubles = np.empty_like(doubles)
            singles -= elements.layers(images[rows], 0.0, image_doubles)
            doubles -= image_doubles
        np.negative(doubles.real, out=matrix[rows])
        # Not by a matrix product, see `layer_sums`.
        sources[rows] = np.einsum("pf,fm->pm", singles.real, velocities)

    run_in_threads(fill, row_blocks(0, count))
    matrix[np.arange(count), np.arange(count)] += 0.5
    pressures = np.linalg.solve(matrix, sources)
    mass = density * velocities.T @ (mesh.areas[:, None] * pressures)
    return (mass + mass.T) / 2


@dataclass(frozen=True, slots=False, kw_only=True, eq=False)
class SheetInFluid:
    """A flat body without thickness, in fluid on both sides."""

    mesh: Mesh  # V vertices in a plane across z, and F triangles whose normals point along z

    @cached_property
    def vertices_inside(self) -> Index:
        """Vertices off the edge (N,), where the pressures of the two sides may differ."""
        sides = np.sort(self.mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        ends, counts = np.unique(sides, axis=0, return_counts=True)
        return np.setdiff1d(self.mesh.faces, ends[counts == 1])

    @cached_property
    def gradients(self) -> tuple[sparse.csr_array, sparse.csr_array]:
        """Derivatives along x and y of functions linear on the triangles, each (F, V), 1/m."""
        normals = np.cross([0.0, 0.0, 1.0], opposite_edges(self.mesh))
        slopes = normals / (2 * self.mesh.areas)[:, None, None]
        return weigh_corners(self.mesh, slopes[:, :, 0]), weigh_corners(self.mesh, slopes[:, :, 1])

    @cached_property
    def means(self) -> sparse.csr_array:
        """Means over the triangles of functions that are linear on them (F, V)."""
        return face_means(self.mesh)

    @cached_property
    def products(self) -> sparse.csr_array:
        """Integrals of products of functions that are linear on the triangles (V, V), m^2."""
        weights = self.mesh.areas[:, None, None] * (np.eye(3) + 1) / 12
        rows = np.repeat(self.mesh.faces, 3, axis=1)
        columns = np.tile(self.mesh.faces, 3)
        size = len(self.mesh.points)
        return sparse.csr_array(
            (weights.ravel(), (rows.ravel(), columns.ravel())), shape=(size, size)
        )

    @cached_property
    def laplace_layer(self) -> Array:
        """Integrals of 1 / (4 pi r) over pairs of triangles (F, F), m^3."""
        elements = BoundaryElements.of(self.mesh)
        # Three points in the outer triangle: at its centre alone the inner integral is largest.
        points = np.ascontiguousarray(np.moveaxis(elements.nodes, 2, 0)).reshape(-1, 3)
        count = len(self.mesh.faces)
        layer = np.empty((count, count))

        def fill(rows: slice) -> None:
            places = points[3 * rows.start : 3 * rows.stop]
            doubles = np.empty((len(places), count), np.complex128)
            singles = elements.layers(places, 0.0, doubles)
            layer[rows] = singles.real.reshape(-1, 3, count).mean(axis=1)

        run_in_threads(fill, row_blocks(0, count))
        layer *= self.mesh.areas[:, None]
        return (layer + layer.T) / 2

    @cached_property
    def distances(self) -> Array:
        """Distances of the centres of the triangles from each other (F, F), m."""
        return cdist(self.mesh.centroids, self.mesh.centroids)

    def compute_layer(self, wave_number: float) -> Complex:
        """Return the integrals of exp(-i k r) / (4 pi r) over pairs of triangles (F, F), m^3.

        Their difference from the static ones is smooth: the centres represent the triangles.
        """
        phases = wave_number * self.distances
        # (exp(-i x) - 1) / x without a division by 0: its limit is -i.
        waves = np.sinc(phases / (2 * np.pi)) * np.exp(-0.5j * phases)
        areas = self.mesh.areas
        return self.laplace_layer - 1j * wave_number / (4 * np.pi) * waves * np.outer(areas, areas)

    def mass(self, velocities: Array, density: float, wave_number: float) -> Array:
        """Compute the added mass (M, M) of a fluid all around the sheet.

        The difference p of the pressures on its sides is the strength of a double layer, and is 0
        at the edge. With functions q that are linear on the triangles (Maue's identity, which
        leaves a single layer of slopes):

            integral G (grad q . grad p - k^2 q p) = integral q v .

        Parameters
        ----------
        velocities : array (V, M)
            Velocities along z at the vertices for unit modal velocity, kg^-1/2.
        density : float
            Density of the fluid, kg/m^3.
        wave_number : float
            Wave number k of the sound in it, 1/m; 0 for an incompressible fluid.
        """
        layer, vertices = self.compute_layer(wave_number), self.vertices_inside
        means = self.means[:, vertices]
        matrix = np.asarray(-(wave_number**2) * (means.T @ (means.T @ layer).T))
        for slopes in self.gradients:
            inner_slopes = slopes[:, vertices]
            matrix += inner_slopes.T @ (inner_slopes.T @ layer).T
        loads = self.products[vertices] @ velocities
        pressures = np.linalg.solve(matrix, loads.astype(np.complex128))
        return np.asarray(density * (loads.T @ pressures).real, np.float64)

    def mass_in_wall(self, velocities: Array, density: float, wave_number: float) -> Array:
        """Compute the added mass (M, M) of a half-space of fluid before a sheet in a rigid wall.

        Rayleigh's integral: p = 2 S v. The arguments are those of `mass`.
        """
        means = self.means @ velocities
        return 2 * density * means.T @ self.compute_layer(wave_number).real @ means

"""Losses in the boundary layers of the air on a vibrating skin, by viscosity and heat conduction.

Outside of thin layers the air slides along the skin and is compressed without losses, as the
pressure on the skin says. In the layers it sticks to the skin and keeps its temperature; the power
lost there is, for each area, that of a plane wall (Landau & Lifshitz 1987, sections 24 and 79;
Berggren, Bernland & Noreland 2018).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from struck.model.arrays import Array, Complex
from struck.model.material import Air
from struck.model.mesh import Mesh
from struck.radiation.on_surface import opposite_edges


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoundaryLayers:
    """Skin of V vertices and F faces, prepared for the losses of many modes."""

    areas: Array  # (F,), m^2
    normals: Array  # (F, 3)
    stiffness: sparse.csr_array  # (V, V), integrals of products of gradients
    masses: Array  # (V,), area that belongs to each vertex, m^2
    # (V, 3 F) matrix from velocities of the faces to the integrals of their products with the
    # gradient of each vertex' linear function, m
    slides: sparse.csr_array

    @classmethod
    def of(cls, mesh: Mesh, stiffness: sparse.csc_array, masses: Array) -> BoundaryLayers:
        """Prepare a skin with the surface Laplacian `stiffness` (V, V) and `masses` (V,)."""
        gradients = np.cross(mesh.face_normals[:, None], opposite_edges(mesh)) / 2  # times area, m
        columns = np.repeat(np.arange(mesh.faces.size).reshape(-1, 1, 3), 3, axis=1)
        rows = np.repeat(mesh.faces[:, :, None], 3, axis=2)
        entries = (gradients.ravel(), (rows.ravel(), columns.ravel()))
        shape = (len(mesh.points), mesh.faces.size)
        return cls(
            areas=mesh.areas,
            normals=mesh.face_normals,
            stiffness=stiffness.tocsr(),
            masses=masses,
            slides=sparse.coo_array(entries, shape=shape).tocsr(),
        )

    def powers(self, pressures: Complex, velocities: Array, frequencies: Array, air: Air) -> Array:
        """Return the power that modes lose in the layers (M,), W.

        Parameters
        ----------
        pressures : array (V, M), complex
            Pressures at the vertices over rho c, m/s, with the time dependence exp(-i omega t).
        velocities : array (F, 3, M)
            Velocities of the faces, m/s.
        frequencies : array (M,)
            Hz.
        air : Air
            The air.
        """
        rates = 2 * np.pi * frequencies
        wave_numbers = rates / air.sound_speed
        normal_velocities = np.einsum("fd,fdm->fm", self.normals, velocities)
        wall_squares = self.areas @ (
            np.square(velocities).sum(axis=1) - np.square(normal_velocities)
        )
        real, imaginary = pressures.real, pressures.imag
        air_squares = sum(
            np.einsum("vm,vm->m", part, self.stiffness @ part) for part in (real, imaginary)
        )
        # The air moves at -i grad p / k, of which the real part is in phase with the wall.
        flat = velocities.reshape(-1, velocities.shape[2])
        products = np.einsum("vm,vm->m", imaginary, self.slides @ flat)
        slip_squares = (
            air_squares / np.square(wave_numbers) - 2 * products / wave_numbers + wall_squares
        )
        viscous_coefficient = 0.5 * np.sqrt(rates * air.density * air.viscosity / 2)
        depth = np.sqrt(2 * air.conductivity / (air.density * air.heat_capacity * rates))
        # The pressure rho c p has the loss (gamma - 1) / (rho c^2) |rho c p|^2 omega depth / 4.
        thermal_coefficient = 0.25 * (air.heat_ratio - 1) * air.density * rates * depth
        compression = self.masses @ (np.square(real) + np.square(imaginary))
        return (
            viscous_coefficient * np.maximum(slip_squares, 0.0) + thermal_coefficient * compression
        )

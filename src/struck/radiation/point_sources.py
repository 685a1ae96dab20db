"""Point sources: a vibrating skin, bundled, and the power that it sends to all sides."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from struck.model.arrays import Array, Complex, Index
from struck.model.mesh import Mesh

COUNT = 512  # bundles of faces, which limit the wave number that they resolve
DIRECTIONS = 128  # pairs of opposite ones


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointSources:
    """Bundles of neighbouring faces, each a source and a dipole at one point."""

    positions: Array  # (K, 3), centres of area, m
    # (K, F), from normal velocities of the faces to volume flows of the bundles, m^2
    flows: sparse.csr_array
    # (3 K, F), to the first moments of these flows about the centres, m^3
    moments: sparse.csr_array
    # (3 K, V), from pressures at the vertices to forces on the bundles, m^2
    forces: sparse.csr_array

    @classmethod
    def of(cls, mesh: Mesh) -> PointSources:
        """Bundle the faces of a mesh."""
        labels = bundles(mesh.centroids, mesh.areas, COUNT)
        flows = _gathering(labels, mesh.areas[:, None])
        areas = flows.sum(axis=1)[:, None]
        positions = np.asarray(flows @ mesh.centroids) / areas
        arms = mesh.centroids - positions[labels]
        starts = np.arange(0, mesh.faces.size + 1, 3)
        thirds = np.full(mesh.faces.size, 1 / 3)
        shape = (len(mesh.faces), len(mesh.points))
        means = sparse.csr_array((thirds, mesh.faces.ravel(), starts), shape)
        return cls(
            positions=positions,
            flows=flows,
            moments=_gathering(labels, mesh.areas[:, None] * arms),
            forces=_gathering(labels, mesh.area_vectors) @ means,
        )

    def mean_square(self, wave_number: float, flows: Array, dipoles: Complex) -> float:
        """Return the mean square over all directions of what the sources send there.

        That is the sum of (flow + direction . dipole) exp(-i k direction . position) with the wave
        number k, 1/m, flows (K,) and dipoles (K, 3) in one unit.
        """
        directions = _half_of_all_directions(DIRECTIONS)
        phases = wave_number * directions @ self.positions.T
        strengths = np.column_stack([flows, dipoles.real, dipoles.imag])
        sent = np.cos(phases) @ strengths - 1j * (np.sin(phases) @ strengths)
        real = np.einsum("nd,nd->n", sent[:, 1:4], directions)
        imaginary = np.einsum("nd,nd->n", sent[:, 4:], directions)
        # In the opposite direction, phases and dipoles change their signs: what the flows and
        # the real dipoles have in common cancels between the two.
        both = np.square(np.abs(sent[:, 0] + 1j * imaginary)) + np.square(np.abs(real))
        return float(both.mean())


def bundles(points: Array, weights: Array, count: int) -> Index:
    """Return the group of each point: at most `count` (a power of two) groups of equal weight.

    Groups are halved across their longest extent, whichever way the points are turned.
    """
    # Rounded, so that neither the body's size nor its place decides between equals.
    arms = points - points.mean(axis=0)
    places = np.round(arms / np.abs(arms).max(), 6)
    shares = (weights / weights.sum()).astype(np.float32)
    groups = [np.arange(len(points))]
    while len(groups) < count and any(len(group) > 1 for group in groups):
        groups = [half for group in groups for half in _halves(group, places, shares)]
    labels = np.empty(len(points), np.int64)
    for label, group in enumerate(groups):
        labels[group] = label
    return labels


def _halves(group: Index, points: Array, weights: NDArray[np.floating]) -> list[Index]:
    if len(group) == 1:
        return [group]
    heavy = weights[group]
    arms = points[group] - np.average(points[group], axis=0, weights=heavy)
    axis = np.linalg.eigh((arms * heavy[:, None]).T @ arms)[1][:, -1]
    order = np.argsort(arms @ axis, kind="stable")
    before = np.cumsum(heavy[order])
    middle = np.clip(np.searchsorted(before, before[-1] / 2), 1, len(group) - 1)
    return [group[order[:middle]], group[order[middle:]]]


def _gathering(labels: Index, weights: Array) -> sparse.csr_array:
    """Return the matrix (D K, F) that sums by label with D `weights` (F, D) a face."""
    count, dimensions = weights.shape
    rows = dimensions * labels[:, None] + np.arange(dimensions)
    columns = np.repeat(np.arange(count), dimensions)
    shape = (dimensions * (labels.max() + 1), count)
    return sparse.coo_array((weights.ravel(), (rows.ravel(), columns)), shape=shape).tocsr()


def _half_of_all_directions(count: int) -> Array:
    """Return unit vectors (count, 3), spread evenly over the upper hemisphere (a golden spiral)."""
    steps = np.arange(count) + 0.5
    height, azimuth = steps / count, np.pi * (1 + np.sqrt(5)) * steps
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=1)

"""Signed distance to a surface, and the body it bounds: solid, hollow, or a sheet with a wall."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial import KDTree

from struck.model.arrays import Array
from struck.model.mesh import Closest, Mesh, Surface, barycentric
from struck.model.mesh_topology import edges_of
from struck.solids.lattice import Lattice
from struck.solids.surface.closedness import INSIDE_WINDING

if TYPE_CHECKING:
    import igl

MAX_SPACING_RATIO = 0.75
"""Spacing of a lattice over the thickness of a solid part, above which the lattice tears there."""
# The same over MAX_SPACING_RATIO, above which a part gets elements sized by its thickness.
_SLENDER_FACTOR = 1.5
_FACING_COSINE = -0.87  # cosine between the normals of two faces that face each other across a part
_INWARD = 1e-6  # of the body's extent, by which rays start below the surface
# Depth over the median thickness above which a place is a rim, as the ray runs along a wall.
_RIM_DEPTH_RATIO = 3.0
_PLACES = 5_000  # on a surface, at which the body is sounded
_ORDER, _ACCURACY = 2, 2.0  # of the expansion far away, and how many radii away: libigl's own


@dataclass(frozen=True, kw_only=True, eq=False)
class FilledBody:
    """Material in a closed surface: the whole inside, or a wall along it."""

    mesh: Mesh
    wall: float | None = None  # thickness, m; without it the body is solid

    @cached_property
    def _surface(self) -> Surface:
        return Surface(self.mesh)

    @cached_property
    def _winding(self) -> igl.FastWindingNumberBVH:
        import igl

        hierarchy = igl.FastWindingNumberBVH()
        hierarchy.init(
            np.ascontiguousarray(self.mesh.points), np.ascontiguousarray(self.mesh.faces), _ORDER
        )
        return hierarchy

    def __getstate__(self) -> dict[str, object]:
        """Return the state for pickles and copies, without libigl's hierarchy, which is rebuilt."""
        return {name: value for name, value in vars(self).items() if name != "_winding"}

    @cached_property
    def bounds(self) -> Array:
        """Corners of a box around the body, m (2, 3)."""
        return self.mesh.bounds

    @cached_property
    def thickness(self) -> float:
        """Thickness of the wall, or of a plate with the same volume and surface, m."""
        total_volume = self.mesh.volume
        plate_thickness = 2 * total_volume / float(self.mesh.areas.sum())
        return plate_thickness if self.wall is None else min(self.wall, plate_thickness)

    @property
    def is_solid(self) -> bool:
        """Whether the body has no wall, so that a lattice must be finer than its parts."""
        return self.wall is None

    @property
    def both_faces(self) -> bool:
        """Whether the surface bounds all of the body."""
        return self.wall is None

    def at(self, _spacing: float) -> FilledBody:
        """Return the body as any lattice is to see it."""
        return self

    @property
    def rough_volume(self) -> float:
        """Volume of the material, a wall's about, m^3."""
        total_volume = self.mesh.volume
        return (
            total_volume
            if self.wall is None
            else min(total_volume, float(self.mesh.areas.sum()) * self.wall)
        )

    def distance(self, points: Array) -> Array:
        """Return the signed distance to the surface, negative inside, m (K,)."""
        # The sign is that of the winding number (Barill et al. 2018).
        winding = self._winding.winding_number(np.ascontiguousarray(points), _ACCURACY)
        length, _, _ = self._surface.closest(points)
        return np.where(np.atleast_1d(winding) > INSIDE_WINDING, -length, length)

    def depths(self, points: Array) -> Array:
        """Return 1-Lipschitz functions, all negative in the material alone, m (K, 1 or 2)."""
        distance = self.distance(points)
        surfaces = [distance] if self.wall is None else [distance, -distance - self.wall]
        return np.stack(surfaces, axis=1)

    judge = None  # the body is where all depths are negative

    @cached_property
    def _thicknesses(self) -> tuple[Array, Array, Array]:
        """Return places on the surface, m (S, 3), their areas, m^2, and thicknesses, m (S,)."""
        # Infinite where the face that a ray inward meets does not face the place.
        places, vectors = self.mesh.spread(_PLACES)
        areas = np.linalg.norm(vectors, axis=1)
        inward = -vectors / areas[:, None]
        origins = places + _INWARD * self.mesh.extent * inward
        hit_faces, depths = self._surface.first_below(origins, inward)
        cosines = -np.einsum("sd,sd->s", inward, self.mesh.face_normals[hit_faces])
        return places, areas, np.where(cosines < _FACING_COSINE, depths, np.inf)

    @property
    def rims(self) -> float:
        """Area of the surface where the body is far deeper than it is mostly, over the other's."""
        _, areas, thicknesses = self._thicknesses
        is_facing = np.isfinite(thicknesses)
        if not is_facing.any():
            return 0.0
        is_rim = is_facing & (thicknesses > _RIM_DEPTH_RATIO * np.median(thicknesses[is_facing]))
        return float(areas[is_rim].sum() / areas[~is_rim].sum())

    def max_edges(self, spacing: float) -> Callable[[Array], Array] | None:
        """Return the longest edges required at points (K, 3), m (K,), by the thickness there.

        None where no part of a solid body is slender against a lattice of this spacing, m.
        """
        if not self.is_solid:
            return None
        places, _, thicknesses = self._thicknesses
        is_slender = _SLENDER_FACTOR * MAX_SPACING_RATIO * thicknesses < spacing
        if not is_slender.any():
            return None
        tree = KDTree(places[is_slender])
        edges = MAX_SPACING_RATIO * thicknesses[is_slender]

        def max_edges_at(points: Array) -> Array:
            distances, nearest_places = tree.query(points)
            # Half a thickness below the surface is the middle of the part.
            return np.where(distances < edges[nearest_places], edges[nearest_places], np.inf)

        return max_edges_at

    @property
    def opposed(self) -> tuple[tuple[int, int], ...]:
        """Numbers of the surfaces that have a wall between them."""
        return () if self.wall is None else ((0, 1),)

    def onto(self, surfaces: tuple[int, ...], points: Array) -> Array:
        """Return points (K, 3) moved onto the outer (0) or inner face (1), or halfway (0, 1)."""
        surface = float(np.mean(surfaces))
        length, _, nearest_points = self._surface.closest(points)
        if surface == 0 or self.wall is None:
            return nearest_points
        fractions = np.divide(
            surface * self.wall, length, out=np.zeros_like(length), where=length > 0
        )
        return nearest_points + (points - nearest_points) * fractions[:, None]

    def volume(self, spacing: float) -> float:
        """Return the volume of the material, m^3: a wall's by samples `spacing` m apart."""
        return self.mesh.volume if self.wall is None else sampled_volume(self, spacing)


@dataclass(frozen=True, kw_only=True, eq=False)
class WalledSheet:
    """A wall around an open surface: half of it on either side, square at the rim."""

    mesh: Mesh  # with a rim, its faces oriented consistently
    wall: float  # thickness, m

    @property
    def bounds(self) -> Array:
        """Corners of a box around the body, m (2, 3)."""
        return self.mesh.bounds + np.array([[-0.5], [0.5]]) * self.wall

    @property
    def thickness(self) -> float:
        """Thickness of the wall, m."""
        return self.wall

    @cached_property
    def _surface(self) -> Surface:
        return Surface(self.mesh)

    @property
    def rough_volume(self) -> float:
        """Volume of the material, estimated, m^3."""
        return float(self.mesh.areas.sum()) * self.wall

    @cached_property
    def _rim(self) -> Rim:
        return Rim(self.mesh)

    def _height(self, points: Array) -> tuple[Array, Array]:
        """Return the heights above the surface, m (K,), and the nearest points on it."""
        length, faces, nearest_points = self._surface.closest(points)
        weights = barycentric(self.mesh.points[self.mesh.faces[faces]], nearest_points)
        # Blended normals: normals of single faces jump at edges, and the sides with them.
        normals = self.mesh.vertex_normals[self.mesh.faces[faces]]
        heights = np.einsum("kc,kcd,kd->k", weights, normals, points - nearest_points)
        return np.where(heights < 0, -length, length), nearest_points

    def depths(self, points: Array) -> Array:
        """Return depths below the upper face, the lower face and the rim, m (K, 3)."""
        height, nearest_points = self._height(points)
        rim_distances = self._rim.distance_past(points, nearest_points)
        return np.stack([height - self.wall / 2, -height - self.wall / 2, rim_distances], axis=1)

    opposed = ((0, 1),)
    judge = None
    is_solid = both_faces = False

    def at(self, _spacing: float) -> WalledSheet:
        """Return the body as any lattice is to see it."""
        return self

    def onto(self, surfaces: tuple[int, ...], points: Array) -> Array:
        """Return points moved onto the upper (0), lower (1) or middle (0, 1) face, or the rim."""
        surface = float(np.mean(surfaces))
        height, nearest_points = self._height(points)
        if surface == 2:
            return points - self._rim.displacement(points, nearest_points)
        fractions = np.divide(
            (0.5 - surface) * self.wall, height, out=np.zeros_like(height), where=height != 0
        )
        return nearest_points + (points - nearest_points) * fractions[:, None]

    def volume(self, spacing: float) -> float:
        """Return the volume of the material, m^3, by samples `spacing` m apart."""
        return sampled_volume(self, spacing)


class Rim:
    """The open edges of a surface whose faces are oriented consistently."""

    def __init__(self, mesh: Mesh) -> None:
        edges = edges_of(mesh.faces)
        face, side = np.divmod(np.flatnonzero(edges.faces_at[edges.owner] == 1), 3)
        first, last = mesh.faces[face, side], mesh.faces[face, (side + 1) % 3]
        self._starts, ends = mesh.points[first], mesh.points[last]
        self._directions = _unit(ends - self._starts)
        self._lengths = np.linalg.norm(ends - self._starts, axis=1)
        self._outward = _unit(np.cross(self._directions, mesh.face_normals[face]))
        self._next_edges = np.argsort(first)[np.argsort(np.argsort(last))]
        self._previous_edges = np.argsort(self._next_edges)
        self._tree = Closest(mesh.points, np.stack([first, last], axis=1))

    def distance_past(self, points: Array, on_surface: Array) -> Array:
        """Return how far points lie past the rim, negative on the surface's side, m (K,)."""
        _, edge, nearest_points = self._tree.closest(on_surface)
        positions = (
            np.linalg.norm(nearest_points - self._starts[edge], axis=1) / self._lengths[edge]
        )
        neighbours = np.where(positions < _END_TOLERANCE, self._previous_edges[edge], edge)
        neighbours = np.where(positions > 1 - _END_TOLERANCE, self._next_edges[edge], neighbours)
        edge_heights, neighbour_heights = (
            np.einsum("kd,kd->k", points - nearest_points, self._outward[e])
            for e in (edge, neighbours)
        )
        # A corner that sticks out ends at either edge, one that goes in at both.
        back = (
            np.where(positions < _END_TOLERANCE, -1.0, 1.0)[:, None] * self._directions[neighbours]
        )
        is_convex = np.einsum("kd,kd->k", self._outward[edge], back) <= 0
        return np.where(
            is_convex,
            np.maximum(edge_heights, neighbour_heights),
            np.minimum(edge_heights, neighbour_heights),
        )

    def displacement(self, points: Array, on_surface: Array) -> Array:
        """Return the vectors from the rim to points, along the surface there, m (K, 3)."""
        _, edge, nearest_points = self._tree.closest(on_surface)
        plane = np.stack([self._outward[edge], self._directions[edge]], axis=1)
        return np.einsum("kad,kae,ke->kd", plane, plane, points - nearest_points)


_END_TOLERANCE = 1e-9  # fraction of an edge that counts as its end


def _unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def sampled_volume(body: FilledBody | WalledSheet, spacing: float) -> float:
    """Return the volume where all depths are negative, m^3, by samples `spacing` m apart."""
    # Each surface counts by a step that rises over one cell, so its place is known far better
    # than the spacing; a thin wall, as their difference, takes samples about as close.
    area = float(body.mesh.areas.sum())
    fine = max(
        min(spacing, _SAMPLES_OF_WALL * body.thickness), np.sqrt(_COST * area / _MAX_SAMPLES)
    )
    lattice = Lattice.cover(body.bounds, fine)
    width = float(np.cbrt(np.prod(lattice.cell)))
    slab_sum = 0.0
    for depths in lattice.sample(body.depths):
        outside_parts = np.clip(0.5 + depths / width, 0.0, 1.0)
        # A slab may be thinner than the step, so its two faces add; a rim cuts it across.
        slab = np.maximum(1.0 - outside_parts[..., :2].sum(axis=-1), 0.0)
        slab_sum += float((slab * (1.0 - outside_parts[..., 2:]).prod(axis=-1)).sum())
    return slab_sum * float(np.prod(lattice.cell)) / 2


_SAMPLES_OF_WALL = 1.5  # spacing over the wall
_COST, _MAX_SAMPLES = 32, 600_000  # samples per square of the spacing, and their maximum

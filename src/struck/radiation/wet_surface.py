"""Wet faces: the part of a surface below a level, outside of a body or in a vessel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from struck.errors import OptionError, rounded
from struck.model.arrays import Array, Index, Mask
from struck.model.mesh import Mesh, part_mesh
from struck.model.mesh_topology import components, edges_of, submesh
from struck.radiation.boundary_elements import Walls, edge_length
from struck.radiation.remeshing import remesh

# Distance of vertices from the level, over the extent of the body, below which they lie on it:
# rounding of coordinates that were stored with six digits.
_ON_LEVEL = 1e-6
_WALL_QUANTILE = 0.02  # fraction of the faces whose depth may be less than the wall, as of fields
_TRIALS = 200  # levels among which a message finds the lowest and the highest


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WetSurface:
    """Faces below a level, and the weights that values at the body's vertices have at theirs."""

    mesh: Mesh  # W vertices
    weights: sparse.csr_array  # (W, V), rows sum to 1

    def normal_velocities(self, shapes: Array) -> Array:
        """Return normal velocities of the faces (F, M) of shapes (V, 3, M) of the body."""
        vertex_shapes = (self.weights @ shapes.reshape(len(shapes), -1)).reshape(
            -1, *shapes.shape[1:]
        )
        face_shapes = vertex_shapes[self.mesh.faces].mean(axis=1)
        return np.einsum("fd,fdm->fm", self.mesh.face_normals, face_shapes)

    def part(self, faces: Index) -> WetSurface:
        """Return some of the faces, with the vertices that they use."""
        vertices = np.unique(self.mesh.faces[faces])
        return WetSurface(mesh=submesh(self.mesh, faces), weights=self.weights[vertices])


def cut_below(surface: Mesh, level: float) -> WetSurface:
    """Cut a surface at a level, m, along its axis `up`, and return the part below.

    Triangles that cross the level are divided there.
    """
    heights = surface.points[:, "xyz".index(surface.up)] - level
    heights = np.where(np.abs(heights) <= _ON_LEVEL * surface.extent, 0.0, heights)
    points, faces = surface.points, surface.faces
    is_low, is_high = heights < 0, heights > 0
    low_faces = faces[~is_high[faces].any(axis=1) & is_low[faces].any(axis=1)]
    crossed_faces = faces[is_high[faces].any(axis=1) & is_low[faces].any(axis=1)]
    # Each crossed edge gets one new vertex, whichever of its faces is cut.
    sides = np.stack([crossed_faces, np.roll(crossed_faces, -1, axis=1)], axis=2).reshape(-1, 2)
    ends = np.unique(np.sort(sides[heights[sides].prod(axis=1) < 0], axis=1), axis=0)
    fractions = heights[ends[:, 0]] / (heights[ends[:, 0]] - heights[ends[:, 1]])
    rows = np.repeat(np.arange(len(ends)), 2)
    parts = np.stack([1 - fractions, fractions], axis=1)
    new_weights = sparse.csr_array(
        (parts.ravel(), (rows, ends.ravel())), shape=(len(ends), len(heights))
    )
    weights = sparse.csr_array(
        sparse.vstack([sparse.csr_array(sparse.eye_array(len(heights))), new_weights])
    )
    new_vertices = {
        (int(first), int(second)): len(points) + number
        for number, (first, second) in enumerate(ends)
    }
    cut_faces = [
        triangle
        for face in crossed_faces.tolist()
        for triangle in _divide(face, heights, new_vertices)
    ]
    all_faces = np.concatenate([low_faces, np.reshape(cut_faces, (-1, 3)).astype(np.int64)])
    if not len(all_faces):
        raise OptionError(_describe_range(surface, level, "the body", _heights_of(surface)))
    all_points = np.concatenate([points, np.asarray(new_weights @ points)])
    mesh = part_mesh(all_points, all_faces, surface.up)
    return WetSurface(mesh=mesh, weights=weights).part(np.flatnonzero(mesh.areas > 0))


def _divide(
    face: list[int], heights: Array, new_vertices: dict[tuple[int, int], int]
) -> list[list[int]]:
    """Return the triangles of the part of a face below the level."""
    polygon = []
    for start, end in zip(face, [*face[1:], face[0]], strict=True):
        if heights[start] <= 0:
            polygon.append(start)
        if heights[start] * heights[end] < 0:
            polygon.append(new_vertices[min(start, end), max(start, end)])
    return [[polygon[0], polygon[k], polygon[k + 1]] for k in range(1, len(polygon) - 1)]


def find_cavity_walls(surface: Mesh, level: float) -> WetSurface:
    """Return the faces that a fluid wets in the vessel that a surface makes, up to a level.

    Below the level, the wall of a cavity is not connected with the outside of the body: it is a
    separate part of the surface, whose normals point into the volume that it encloses
    together with the level. A vessel that leaks below the level has no such part.

    Raises
    ------
    OptionError
        If the surface holds no fluid up to this level.
    """
    cavities = _cavities(surface, level)
    if cavities is None:
        low, high = _heights_of(surface)
        levels = np.linspace(low, high, _TRIALS + 2)[1:-1].tolist()
        ends = [
            next((trial for trial in trials if _cavities(surface, trial) is not None), None)
            for trials in (levels, levels[::-1])
        ]
        if ends[0] is None or ends[1] is None:
            raise OptionError(
                f"the body holds no fluid up to {rounded(level, 4)} m, nor up to any other level: "
                "its surface has no cavity that is closed at the bottom and the sides; check which "
                f"direction is up ({surface.up!r}), or take `immerse`"
            )
        raise OptionError(_describe_range(surface, level, "fluid in the body", (ends[0], ends[1])))
    return cavities


def _cavities(surface: Mesh, level: float) -> WetSurface | None:
    """Return the walls of all cavities below a level, or None without any."""
    low, high = _heights_of(surface)
    if not low < level < high:
        return None
    wet_surface = cut_below(surface, level)
    faces = np.flatnonzero(_is_cavity_wall(wet_surface, level))
    return wet_surface.part(faces) if len(faces) else None


def find_outer_walls(surface: Mesh, level: float) -> WetSurface:
    """Return the faces that a fluid around a body wets up to a level.

    A vessel whose rim is above the level stays dry inside.
    """
    wet_surface = cut_below(surface, level)
    if not np.isfinite(level):
        return wet_surface
    return wet_surface.part(np.flatnonzero(~_is_cavity_wall(wet_surface, level)))


def _is_cavity_wall(wet_surface: WetSurface, level: float) -> Mask:
    """Return which faces below a level (F,) are walls of cavities that are open at the level."""
    edges = edges_of(wet_surface.mesh.faces)
    pairs, _ = edges.pairs()
    labels = components(pairs, len(wet_surface.mesh.faces))
    origin = wet_surface.mesh.centroids.mean(axis=0)
    origin["xyz".index(wet_surface.mesh.up)] = level  # then the lid adds no volume
    cones = np.einsum(
        "fd,fd->f", wet_surface.mesh.centroids - origin, wet_surface.mesh.area_vectors
    )
    is_hollow = np.bincount(labels, weights=cones) < 0
    # A closed cavity below the level would be full, without a free surface.
    is_open = np.bincount(
        labels, weights=(edges.faces_at == 1)[edges.owner].reshape(-1, 3).sum(axis=1)
    ).astype(bool)
    return (is_hollow & is_open)[labels]


def _heights_of(surface: Mesh) -> tuple[float, float]:
    """Return the lowest and the highest coordinate of a surface along its axis `up`, m."""
    low, high = surface.bounds[:, "xyz".index(surface.up)]
    return float(low), float(high)


def _describe_range(surface: Mesh, level: float, content: str, heights: tuple[float, float]) -> str:
    """Return the message on a level outside a range of heights, m."""
    low, high = heights
    return (
        f"level is {rounded(level, 4)} m along {surface.up}: {content} reaches from "
        f"{rounded(low, 3)} m to {rounded(high, 3)} m in the coordinates of the body; give a level "
        "between"
    )


def coarsen(surface: Mesh, wet_surface: WetSurface, max_faces: int) -> WetSurface:
    """Return a closed surface with as large triangles as `max_faces` on its wet part need.

    Weights are those of its vertices on the old surface, which has the finer triangles.
    """
    walls = Walls.of(surface)
    edge = edge_length(wet_surface.mesh) * np.sqrt(len(wet_surface.mesh.faces) / max_faces)
    mesh = remesh(surface, edge, float(np.nanquantile(walls.depths, _WALL_QUANTILE)))
    faces, parts = surface.locator.barycentric(mesh.points)
    rows = np.repeat(np.arange(len(faces)), 3)
    columns = surface.faces[faces].ravel()
    shape = (len(mesh.points), len(surface.points))
    weights = sparse.csr_array((parts.ravel(), (rows, columns)), shape=shape)
    return WetSurface(mesh=mesh, weights=weights)

"""A new surface on a lattice, where the old one crosses itself.

It is the boundary of tetrahedra that fill the material (Labelle & Shewchuk 2007), moved onto those
old faces that part it from air.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from scipy import ndimage

from struck.errors import MeshError, rounded
from struck.model.arrays import Array, Index, Mask
from struck.model.mesh import Mesh, Surface
from struck.model.mesh_topology import edges_of, extremes, pieces, submesh, volumes_of
from struck.solids.lattice import Cells, Lattice, warp
from struck.solids.surface.closedness import (
    INSIDE_WINDING,
    Shells,
    halves,
    is_closed,
    unit_factor,
    winding,
)
from struck.solids.volume_mesh import side_keys

_CELLS = (4_000, 9_000, 16_000)  # on the surface, from coarse to fine, until the volume stays
_MAX_CELLS, _MAX_CELLS_WITH_RIMS = 1_000_000, 100_000  # a long way through air takes more
_WIDENING = 1.05
_MAX_LAYERS = 4  # area of all faces over that in the open from which on cells grow with it
_MAX_CHANGE = 0.003
_CRUMB = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rebuilt:
    """A surface made from winding numbers, with its errors."""

    mesh: Mesh
    spacing: float  # of the lattice, m
    change: float  # of the volume since the lattice before, relative


def rebuild(mesh: Mesh, bounding: Mesh | None, *, coarse_only: bool = False) -> Rebuilt:
    """Return the boundary of where the surface winds around more than half a time."""
    # `bounding`: the parts of faces between material and air, see `expose_faces`; `coarse_only`: on
    # the coarsest lattice alone.
    if bounding is None or bounding.volume <= 0:
        raise MeshError(
            "the mesh encloses no material: its faces point in all directions; "
            "make the normals consistent in a mesh editor"
        )
    area = max(float(bounding.areas.sum()), float(mesh.areas.sum()) / _MAX_LAYERS)
    max_cells = _MAX_CELLS_WITH_RIMS if has_rims(mesh) else _MAX_CELLS
    spacings = [
        _affordable(float(np.sqrt(area / cells)), bounding.bounds, max_cells)
        for cells in (_CELLS[:1] if coarse_only else _CELLS)
    ]
    limits = Surface(bounding)
    surfaces = [_boundary(mesh, bounding.bounds, limits, spacings[0])]
    change = np.inf
    for spacing in spacings[1:]:
        surfaces.append(_boundary(mesh, bounding.bounds, limits, spacing))
        old_volume, new_volume = (surface.volume for surface in surfaces[-2:])
        change = new_volume / old_volume - 1
        if abs(change) <= _MAX_CHANGE:
            break
    return Rebuilt(
        mesh=surfaces[-1], spacing=float(spacings[len(surfaces) - 1]), change=float(change)
    )


def _boundary(mesh: Mesh, bounds: Array, limits: Surface, spacing: float) -> Mesh:
    lattice = Lattice.cover(bounds, spacing)
    is_inside = find_inside(mesh, lattice)
    for points_move in (True, False):
        surface = isosurface(
            lattice, is_inside, lambda at: limits.closest(at)[0], moved=points_move
        )
        if surface is not None and is_closed(surface):
            points = limits.closest(surface.points)[2]
            return _remove_crumbs(Mesh(points=points, faces=surface.faces, up=mesh.up))
    raise MeshError(
        f"the body is too thin for a lattice of {rounded(spacing, 3)} m: join its pieces in a mesh "
        "editor"
    )


def _affordable(spacing: float, bounds: Array, max_cells: int) -> float:
    """Return `spacing`, or a wider one that takes no more than `max_cells` to fill the box."""
    while (np.maximum((bounds[1] - bounds[0]) / spacing, 1) + 2).prod() > max_cells:
        spacing *= _WIDENING
    return spacing


def _remove_crumbs(mesh: Mesh) -> Mesh:
    """Return the mesh without crumbs of the lattice."""
    labels = pieces(mesh)
    volumes = np.abs(volumes_of(mesh, labels))
    return submesh(mesh, np.flatnonzero((volumes > _CRUMB * volumes.max())[labels]))


def measure_lost(old: Mesh, new: Rebuilt) -> float:
    """Return the fraction of the old faces' area that lies outside the new surface, far from it."""
    length, _, _ = Surface(new.mesh).closest(old.centroids)
    is_far = length > 2 * new.spacing
    is_far[is_far] = winding(new.mesh, old.centroids[is_far]) < INSIDE_WINDING
    return float(old.areas[is_far].sum() / old.areas.sum())


def measure_invented(old: Mesh, new: Rebuilt) -> float:
    """Return the fraction of the new surface's area that lies far from all old faces."""
    length, _, _ = Surface(old).closest(new.mesh.centroids)
    return float(new.mesh.areas[length > 2 * new.spacing].sum() / new.mesh.areas.sum())


Distances = Callable[[Array], Array]
_MIN_DEPTH = 0.1  # depth of points that do not move, in cells


def isosurface(
    lattice: Lattice, is_inside: Mask, distances: Distances, *, moved: bool = True
) -> Mesh | None:
    """Return the surface around the lattice points inside (N,), normals outward, or None."""
    # `distances` from points (K, 3) to the surface, m (K,), is called for points near it. Where it
    # grazes `moved` points, parts of it can meet in an edge; otherwise some triangles are needles.
    depths = np.where(is_inside, -1.0, 1.0)
    near_points = np.unique(_find_astride(lattice, depths))
    if not len(near_points):
        return None
    min_depth = 0.0 if moved else _MIN_DEPTH * float(lattice.cell.min())
    depths[near_points] *= np.maximum(distances(lattice.positions(near_points)), min_depth)
    cells, numbers = _find_cells_astride(lattice, depths)
    if moved:
        warped_cells = warp(cells, numbers >= np.prod(lattice.counts + 1))
        depths[numbers] = warped_cells.depths[:, 0]
        cells, new_numbers = _find_cells_astride(lattice, depths)
        _, old_indices, new_indices = np.intersect1d(
            numbers, new_numbers, assume_unique=True, return_indices=True
        )
        cells.points[new_indices] = warped_cells.points[old_indices]
    return _skin(cells.cut_at(0))


def _find_astride(lattice: Lattice, depths: Array) -> Index:
    """Return the tetrahedra with points within and others on the surface or outside (T, 4)."""
    depth_pairs = np.stack([depths, np.where(depths < 0, 1.0, -1.0)], axis=1)
    first = int(np.prod(lattice.counts + 1))
    corners, centres = depth_pairs[:first], depth_pairs[first:]
    return lattice.tetrahedra(
        corners.reshape(*(lattice.counts + 1), 2), centres.reshape(*lattice.counts, 2)
    )


def _find_cells_astride(lattice: Lattice, depths: Array) -> tuple[Cells, Index]:
    """Return the tetrahedra on the surface, and the lattice numbers of their points."""
    numbers, local = np.unique(_find_astride(lattice, depths), return_inverse=True)
    points, local = lattice.positions(numbers), local.reshape(-1, 4)
    return Cells(points=points, depths=depths[numbers, None], tetrahedra=local), numbers


def _skin(cells: Cells) -> Mesh | None:
    """Return the sides of tetrahedra on surface 0 that belong to one of them, turned outward."""
    is_on_surface = (cells.depths[:, 0] == 0)[cells.tetrahedra]
    rows, inner_corners = np.nonzero(~is_on_surface & (is_on_surface.sum(axis=1) == 3)[:, None])
    faces = cells.tetrahedra[rows][is_on_surface[rows]].reshape(-1, 3)
    # Triangles between two tetrahedra within come from both.
    _, first, times = np.unique(
        side_keys(faces, len(cells.points)), return_index=True, return_counts=True
    )
    first = first[times == 1]
    if not len(first):
        return None
    faces, apex = faces[first], cells.points[cells.tetrahedra[rows[first], inner_corners[first]]]
    a, b, c = cells.points[faces].transpose(1, 0, 2)
    is_inward = np.einsum("fd,fd->f", np.cross(b - a, c - a), a - apex) < 0
    used_points, local = np.unique(
        np.where(is_inward[:, None], faces[:, ::-1], faces), return_inverse=True
    )
    return Mesh(points=cells.points[used_points], faces=local.reshape(-1, 3))


# The winding number of a surface without rims only changes across faces: one value serves all
# lattice points that faces do not part.

_MAX_LENGTH = 1.99  # of pieces of faces, in voxels: their boxes reach into three along each axis
_STEPS = np.stack(np.meshgrid(*[range(3)] * 3), axis=-1).reshape(-1, 3)
_MAX_TRIANGLES = 1_000_000
_ROUNDING = 1e-9


def find_inside(mesh: Mesh, lattice: Lattice) -> Mask:
    """Return which lattice points the surface winds around (N,): corners first, then centres."""
    region = _regions(mesh, lattice)
    sample_points, answer_numbers = np.arange(len(region)), np.arange(len(region))
    is_free = region > 0
    if is_free.any():
        _, first, region_numbers = np.unique(
            region[is_free], return_index=True, return_inverse=True
        )
        near_points = np.flatnonzero(~is_free)
        sample_points = np.concatenate([np.flatnonzero(is_free)[first], near_points])
        answer_numbers[is_free] = region_numbers
        answer_numbers[near_points] = len(first) + np.arange(len(near_points))
    return (winding(mesh, lattice.positions(sample_points)) > INSIDE_WINDING)[answer_numbers]


def has_rims(mesh: Mesh) -> bool:
    """Return whether faces do not cancel along some edge, so that the winding number drifts."""
    return bool(edges_of(mesh.faces).balance.any())


def _regions(mesh: Mesh, lattice: Lattice) -> Index:
    """Return the region of each lattice point (N,), from 1; 0 near faces and where unknown."""
    # Voxels half as wide as cells, each around a point where corners or centres may be.
    shape = 2 * lattice.counts + 1
    points = int(np.prod(lattice.counts + 1) + np.prod(lattice.counts))
    origin, edge = lattice.origin - lattice.cell / 4, lattice.cell / 2
    triangles = ((mesh.points - origin) / edge)[mesh.faces]
    parts = None if has_rims(mesh) else _small(triangles, shape)
    if parts is None:
        return np.zeros(points, np.int64)
    is_free = np.ones(shape, bool)
    for voxels in _voxels(parts):
        is_free[tuple(voxels[((voxels >= 0) & (voxels < shape)).all(axis=1)].T)] = False
    regions = np.asarray(ndimage.label(is_free)[0])  # pyright: ignore[reportIndexIssue]
    grids = regions[::2, ::2, ::2], regions[1::2, 1::2, 1::2]
    return np.concatenate([grid.ravel() for grid in grids]).astype(np.int64)


def _voxels(triangles: Array) -> Iterator[Index]:
    """Yield the voxels (V, 3) that small triangles (T, 3, 3) pass through, and some neighbours."""
    low, high = extremes(triangles)
    low, high = np.floor(low - _ROUNDING), np.floor(high + _ROUNDING)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    heights = np.einsum("td,td->t", normals, low + 0.5 - triangles[:, 0])
    reach = (0.5 + _ROUNDING) * np.abs(normals).sum(axis=1)
    x, y, z = (high - low).T
    for step in _STEPS:
        in_box = np.flatnonzero((x >= step[0]) & (y >= step[1]) & (z >= step[2]))
        chosen = in_box[np.abs(heights[in_box] + normals[in_box] @ step) <= reach[in_box]]
        yield (low[chosen] + step).astype(np.int64)


def _small(triangles: Array, shape: Index) -> Array | None:
    """Halve triangles (T, 3, 3) down to the size of voxels; None where that takes too many."""
    small_parts, count = [], 0
    while len(triangles):
        low, high = extremes(triangles)
        is_near = (high > -1) & (low < shape + 1)
        triangles = triangles[is_near.all(axis=1)]
        small, large_parts = halves(triangles, _MAX_LENGTH)
        small_parts.append(small)
        count += len(small)
        if count + len(large_parts) > _MAX_TRIANGLES:
            return None
        triangles = large_parts
    return np.concatenate([np.empty((0, 3, 3)), *small_parts])


def unite(shells: Shells, pairs: Index) -> Mesh | None:
    """Return the union of bodies whose faces cross (pairs of faces (K, 2)), edges left crisp.

    None where a body crosses itself, as no union can tell what is inside it.
    """
    first, second = shells.labels[pairs].T
    if (first == second).any():
        return None
    from manifold3d import Error, Manifold, Mesh64, OpType

    mesh, factor = shells.mesh, unit_factor(shells.mesh)
    body = shells.bodies(np.empty((0, 2), np.int64))
    parts = []
    for number in np.unique(body):
        part = submesh(mesh, np.flatnonzero(body[shells.labels] == number))
        parts.append(Manifold(Mesh64(part.points * factor, part.faces.astype(np.uint64))))
    union = Manifold.batch_boolean(parts, OpType.Add)
    result = union.to_mesh64()
    if union.status() != Error.NoError or not len(result.tri_verts):
        return None
    points = result.vert_properties[:, :3] / factor
    return Mesh(points=points, faces=result.tri_verts.astype(np.int64), up=mesh.up)

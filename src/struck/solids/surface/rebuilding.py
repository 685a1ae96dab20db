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
from struck.solids.lattice import Cells, Lattice, warped
from struck.solids.surface.closedness import INSIDE, Shells, halves, is_closed, unit_factor, winding
from struck.solids.volume_mesh import side_keys

_CELLS = (4_000, 9_000, 16_000)  # on the surface, from coarse to fine, until the volume stays
_MOST_CELLS, _MOST_CELLS_WITH_RIMS = 1_000_000, 100_000  # a long way through air takes more
_WIDER = 1.05
_MOST_LAYERS = 4  # area of all faces over that in the open from which on cells grow with it
_LARGEST_CHANGE = 0.003
_CRUMB = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Rebuilt:
    """A surface made anew from winding numbers, with its errors."""

    mesh: Mesh
    spacing: float  # of the lattice, m
    change: float  # of the volume since the lattice before, relative


def rebuilt(mesh: Mesh, bounding: Mesh | None, *, roughly: bool = False) -> Rebuilt:
    """Return the boundary of where the surface winds around more than half a time."""
    # `bounding`: the parts of faces that part material from air, see `exposed`; `roughly`: on the
    # coarsest lattice alone.
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
    limits = Surface(bounding)
    made = [_boundary(mesh, bounding.bounds, limits, spacings[0])]
    change = np.inf
    for spacing in spacings[1:]:
        made.append(_boundary(mesh, bounding.bounds, limits, spacing))
        before, after = (each.volume for each in made[-2:])
        change = after / before - 1
        if abs(change) <= _LARGEST_CHANGE:
            break
    return Rebuilt(mesh=made[-1], spacing=float(spacings[len(made) - 1]), change=float(change))


def _boundary(mesh: Mesh, bounds: Array, limits: Surface, spacing: float) -> Mesh:
    lattice = Lattice.over(bounds, spacing)
    within = inside(mesh, lattice)
    for moved in (True, False):
        found = isosurface(lattice, within, lambda at: limits.closest(at)[0], moved=moved)
        if found is not None and is_closed(found):
            points = limits.closest(found.points)[2]
            return _without_crumbs(Mesh(points=points, faces=found.faces, up=mesh.up))
    raise MeshError(
        f"the body is too thin for a lattice of {rounded(spacing, 3)} m: join its pieces in a mesh "
        "editor"
    )


def _affordable(spacing: float, bounds: Array, most: int) -> float:
    """Return `spacing`, or a wider one that takes no more than `most` cells to fill the box."""
    while (np.maximum((bounds[1] - bounds[0]) / spacing, 1) + 2).prod() > most:
        spacing *= _WIDER
    return spacing


def _without_crumbs(mesh: Mesh) -> Mesh:
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


Distances = Callable[[Array], Array]
_LEAST = 0.1  # depth of points that do not move, in cells


def isosurface(
    lattice: Lattice, inside: Mask, distances: Distances, *, moved: bool = True
) -> Mesh | None:
    """Return the surface around lattice points `inside` (N,), normals outward, or None."""
    # Distances of points (K, 3) from the surface, m (K,), are asked for beside it alone. Where it
    # grazes `moved` points, parts of it can meet in an edge; otherwise some triangles are needles.
    depths = np.where(inside, -1.0, 1.0)
    near = np.unique(_astride(lattice, depths))
    if not len(near):
        return None
    least = 0.0 if moved else _LEAST * float(lattice.cell.min())
    depths[near] *= np.maximum(distances(lattice.positions(near)), least)
    cells, numbers = _cells_astride(lattice, depths)
    if moved:
        warp = warped(cells, numbers >= np.prod(lattice.counts + 1))
        depths[numbers] = warp.depths[:, 0]
        cells, fresh = _cells_astride(lattice, depths)
        _, before, after = np.intersect1d(numbers, fresh, assume_unique=True, return_indices=True)
        cells.points[after] = warp.points[before]
    return _skin(cells.within(0))


def _astride(lattice: Lattice, depths: Array) -> Index:
    """Return the tetrahedra with points within and others on the surface or outside (T, 4)."""
    both = np.stack([depths, np.where(depths < 0, 1.0, -1.0)], axis=1)
    first = int(np.prod(lattice.counts + 1))
    corners, centres = both[:first], both[first:]
    return lattice.tetrahedra(
        corners.reshape(*(lattice.counts + 1), 2), centres.reshape(*lattice.counts, 2)
    )


def _cells_astride(lattice: Lattice, depths: Array) -> tuple[Cells, Index]:
    """Return the tetrahedra on the surface, and the lattice numbers of their points."""
    numbers, local = np.unique(_astride(lattice, depths), return_inverse=True)
    points, local = lattice.positions(numbers), local.reshape(-1, 4)
    return Cells(points=points, depths=depths[numbers, None], tetrahedra=local), numbers


def _skin(cells: Cells) -> Mesh | None:
    """Return the sides of tetrahedra on surface 0 that belong to one of them, turned outward."""
    on = (cells.depths[:, 0] == 0)[cells.tetrahedra]
    rows, within = np.nonzero(~on & (on.sum(axis=1) == 3)[:, None])
    faces = cells.tetrahedra[rows][on[rows]].reshape(-1, 3)
    # Triangles between two tetrahedra within come from both.
    _, first, times = np.unique(
        side_keys(faces, len(cells.points)), return_index=True, return_counts=True
    )
    first = first[times == 1]
    if not len(first):
        return None
    faces, apex = faces[first], cells.points[cells.tetrahedra[rows[first], within[first]]]
    a, b, c = cells.points[faces].transpose(1, 0, 2)
    inward = np.einsum("fd,fd->f", np.cross(b - a, c - a), a - apex) < 0
    used, local = np.unique(np.where(inward[:, None], faces[:, ::-1], faces), return_inverse=True)
    return Mesh(points=cells.points[used], faces=local.reshape(-1, 3))


# The winding number of a surface without rims only changes across faces: one value serves all
# lattice points that faces do not part.

_LONGEST = 1.99  # of pieces of faces, in voxels: their boxes reach into three along each axis
_STEPS = np.stack(np.meshgrid(*[range(3)] * 3), axis=-1).reshape(-1, 3)
_MOST = 1_000_000
_ROUNDING = 1e-9


def inside(mesh: Mesh, lattice: Lattice) -> Mask:
    """Return which lattice points the surface winds around (N,): corners first, then centres."""
    region = _regions(mesh, lattice)
    asked, answer = np.arange(len(region)), np.arange(len(region))
    free = region > 0
    if free.any():
        _, first, inverse = np.unique(region[free], return_index=True, return_inverse=True)
        beside = np.flatnonzero(~free)
        asked = np.concatenate([np.flatnonzero(free)[first], beside])
        answer[free] = inverse
        answer[beside] = len(first) + np.arange(len(beside))
    return (winding(mesh, lattice.positions(asked)) > INSIDE)[answer]


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
    free = np.ones(shape, bool)
    for voxels in _voxels(parts):
        free[tuple(voxels[((voxels >= 0) & (voxels < shape)).all(axis=1)].T)] = False
    regions = np.asarray(ndimage.label(free)[0])  # pyright: ignore[reportIndexIssue]
    grids = regions[::2, ::2, ::2], regions[1::2, 1::2, 1::2]
    return np.concatenate([grid.ravel() for grid in grids]).astype(np.int64)


def _voxels(triangles: Array) -> Iterator[Index]:
    """Yield the voxels (V, 3) that small triangles (T, 3, 3) pass through, and some neighbours."""
    lowest, highest = extremes(triangles)
    lowest, highest = np.floor(lowest - _ROUNDING), np.floor(highest + _ROUNDING)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    heights = np.einsum("td,td->t", normals, lowest + 0.5 - triangles[:, 0])
    reach = (0.5 + _ROUNDING) * np.abs(normals).sum(axis=1)
    x, y, z = (highest - lowest).T
    for step in _STEPS:
        in_box = np.flatnonzero((x >= step[0]) & (y >= step[1]) & (z >= step[2]))
        chosen = in_box[np.abs(heights[in_box] + normals[in_box] @ step) <= reach[in_box]]
        yield (lowest[chosen] + step).astype(np.int64)


def _small(triangles: Array, shape: Index) -> Array | None:
    """Halve triangles (T, 3, 3) down to the size of voxels; None where that takes too many."""
    done, count = [], 0
    while len(triangles):
        lowest, highest = extremes(triangles)
        near = (highest > -1) & (lowest < shape + 1)
        triangles = triangles[near.all(axis=1)]
        small, rest = halves(triangles, _LONGEST)
        done.append(small)
        count += len(small)
        if count + len(rest) > _MOST:
            return None
        triangles = rest
    return np.concatenate([np.empty((0, 3, 3)), *done])


def united(shells: Shells, pairs: Index) -> Mesh | None:
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
    whole = Manifold.batch_boolean(parts, OpType.Add)
    result = whole.to_mesh64()
    if whole.status() != Error.NoError or not len(result.tri_verts):
        return None
    points = result.vert_properties[:, :3] / factor
    return Mesh(points=points, faces=result.tri_verts.astype(np.int64), up=mesh.up)

"""Which faces of a surface part material from air, where faces cross.

Material is where the surface winds around a point more than half a time (Jacobson et al. 2013).
Faces that cross others are cut up along them, as only parts of them may lie in the open.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.model.mesh import Mesh
from struck.model.mesh_topology import components, edges_of, submesh
from struck.solids.surface.shells import flipped, unit_factor
from struck.solids.surface.welding import single

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
INSIDE = 0.5
# How far beside a face one looks for material, over the extent.
_HAIR = 1e-4
# Length over the extent down to which crossing faces are cut.
_FINEST = 1 / 50
_ROUNDING = 1e-9
_MOST, _MOST_PAIRS = 30_000, 300_000


def winding(mesh: Mesh, points: Array) -> Array:
    """Return how often the surface winds around `points` (K,)."""
    import igl

    factor = unit_factor(mesh)
    return np.atleast_1d(
        igl.fast_winding_number(
            np.ascontiguousarray(mesh.points * factor),
            np.ascontiguousarray(mesh.faces),
            np.ascontiguousarray(points * factor),
        )
    )


def exposed(mesh: Mesh, pairs: Index) -> Mesh | None:
    """Return the faces that part material from air, normals outward; None where there are none.

    Parameters
    ----------
    mesh : Mesh
    pairs : array (K, 2)
        Faces that cross each other.
    """
    crossing, local = np.unique(pairs, return_inverse=True)
    small = _halved(mesh.points[mesh.faces[crossing]], local.reshape(-1, 2), mesh.extent)
    whole = np.setdiff1d(np.arange(len(mesh.faces)), crossing)
    fresh = np.arange(3 * len(small)).reshape(-1, 3) + len(mesh.points)
    parts = Mesh(
        points=np.concatenate([mesh.points, small.reshape(-1, 3)]),
        faces=np.concatenate([mesh.faces[whole], fresh]),
        up=mesh.up,
    )
    patches = np.concatenate([_patches(mesh, whole), np.arange(len(small))])
    patches[len(whole) :] += patches[: len(whole)].max(initial=-1) + 1
    above, below = _sides(mesh, parts, patches)
    bounding = np.flatnonzero(above != below)
    return submesh(flipped(parts, above), bounding) if len(bounding) else None


def _patches(mesh: Mesh, chosen: Index) -> Index:
    """Return the patch of each of the `chosen` faces: as none of them cross, it is all alike."""
    sides, agree = edges_of(mesh.faces).pairs()
    number = np.full(len(mesh.faces), -1)
    number[chosen] = np.arange(len(chosen))
    joined = number[sides[agree]]
    return components(joined[(joined >= 0).all(axis=1)], len(chosen))


def _sides(mesh: Mesh, parts: Mesh, patches: Index) -> tuple[Flags, Flags]:
    """Tell whether there is material above and below each part (F,), by one face a patch."""
    order = np.argsort(-parts.areas, kind="stable")
    _, first = np.unique(patches[order], return_index=True)
    largest = order[first]
    step = _HAIR * mesh.extent * parts.face_normals[largest]
    middles = parts.centroids[largest]
    above, below = (winding(mesh, middles + way) > INSIDE for way in (step, -step))
    return above[patches], below[patches]


def bared(mesh: Mesh) -> Mesh | None:
    """Return the open faces of a surface that branches, though its faces cancel at every edge.

    Bodies that share walls or overlap along common faces are like that. None where the surface
    does not branch or close, or where the faces in the open bound something else.
    """
    edges = edges_of(mesh.faces)
    if edges.balance.any() or not np.any(edges.faces_at > 2):
        return None
    outward = flipped(mesh, np.full(len(mesh.faces), mesh.volume < 0))
    found = exposed(outward, np.empty((0, 2), np.int64))
    if found is None or not 0 < found.volume <= (1 + _ROUNDING) * outward.volume:
        return None
    return single(found)[0]


def _halved(faces: Array, pairs: Index, extent: float) -> Array:
    """Halve triangles (T, 3, 3) while they are long and may still meet one they cross."""
    boxes = np.stack([faces.min(axis=1), faces.max(axis=1)])
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    parts, done = faces, []
    part, partner = np.concatenate([pairs, pairs[:, ::-1]]).T
    if len(part) > _MOST_PAIRS:
        return faces
    while len(parts):
        near = _may_meet(
            parts[part], boxes[:, partner], faces[partner, 0], normals[partner], extent
        )
        part, partner = part[near], partner[near]
        longest, first = _longest(parts)
        cut = np.zeros(len(parts), bool)
        cut[part] = True
        cut &= longest > _FINEST * extent
        cut &= len(parts) + sum(map(len, done)) <= _MOST and len(part) <= _MOST_PAIRS
        done.append(parts[~cut])
        number = np.cumsum(cut) - 1
        part, partner = number[part[cut[part]]], partner[cut[part]]
        parts = _two(parts[cut], first[cut])
        part, partner = np.concatenate([part, part + len(parts) // 2]), np.tile(partner, 2)
    return np.concatenate([np.empty((0, 3, 3)), *done])


def halves(triangles: Array, longest: float) -> tuple[Array, Array]:
    """Return the triangles (T, 3, 3) no longer than `longest`, and both halves of the others."""
    lengths, first = _longest(triangles)
    cut = lengths > longest
    return triangles[~cut], _two(triangles[cut], first[cut])


def _longest(triangles: Array) -> tuple[Array, Index]:
    """Return the longest side of each triangle and the corner it starts from."""
    lengths = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
    return lengths.max(axis=1), lengths.argmax(axis=1)


def _two(triangles: Array, first: Index) -> Array:
    """Halve triangles at their longest sides: first halves, then second halves."""
    turn = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles, turn[:, :, None], axis=1).transpose(1, 0, 2)
    middle = (a + b) / 2
    return np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])


def _may_meet(
    triangles: Array, boxes: Array, origins: Array, normals: Array, extent: float
) -> Flags:
    """Tell whether each triangle may meet another, given by its box, plane and one corner."""
    margin = _ROUNDING * extent
    apart = (triangles.min(axis=1) > boxes[1] + margin) | (
        triangles.max(axis=1) < boxes[0] - margin
    )
    heights = np.einsum("kcd,kd->kc", triangles - origins[:, None], normals)
    beside = (heights.min(axis=1) > margin) | (heights.max(axis=1) < -margin)
    return ~(apart.any(axis=1) | beside)

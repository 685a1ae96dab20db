"""Closed pieces of a surface: which way they face, which bound material, which are one body.

The winding number of all pieces together tells material from air: it is above one half inside.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from struck.errors import MeshError
from struck.model.arrays import Array, Index, Mask
from struck.model.mesh import Mesh
from struck.model.mesh_topology import (
    components,
    edges_of,
    nesting,
    pieces,
    submesh,
    volumes_of,
)
from struck.solids.surface.welding import single

# Boxes of other faces that the box of a face may overlap: of sound surfaces it is a dozen or two,
# and small ones may be as bad as they like.
_MOST_MET, _MOST_PAIRS = 100, 20_000_000
_SAMPLE_COST = 500_000


def apart(mesh: Mesh) -> Mesh:
    """Return the mesh with pieces that share a vertex given one each."""
    # So edges where several pieces meet belong to two faces of each, or are open.
    labels = np.repeat(pieces(mesh), 3)
    keys = labels * len(mesh.points) + mesh.faces.ravel()
    used, renumbered = np.unique(keys, return_inverse=True)
    return Mesh(
        points=mesh.points[used % len(mesh.points)], faces=renumbered.reshape(-1, 3), up=mesh.up
    )


def without_fins(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the mesh without pieces that only lean on others, and how many faces went."""
    # Fins and inner walls meet closed pieces in edges of three faces; without them, smallest
    # first, these edges belong to two.
    edges, labels = edges_of(mesh.faces), pieces(mesh)
    if not np.any(edges.faces_at > 2):
        return mesh, 0
    left = edges.faces_at.copy()
    owner = edges.owner.reshape(-1, 3)
    kept = np.ones(len(mesh.faces), bool)
    leaning = np.unique(labels[np.any(left[owner] > 2, axis=1)])
    areas = np.bincount(labels, weights=mesh.areas)
    for piece in leaning[np.argsort(areas[leaning])]:
        faces = np.flatnonzero(labels == piece)
        own, counts = np.unique(owner[faces], return_counts=True)
        border = counts == 1
        rest = left[own[border]] - 1
        if np.all(rest % 2 == 0) and np.any(rest > 0):
            left[own] -= counts
            kept[faces] = False
    return submesh(mesh, np.flatnonzero(kept)), int(np.count_nonzero(~kept))


def flipped(mesh: Mesh, chosen: Mask) -> Mesh:
    """Return the mesh with the `chosen` faces turned over."""
    if not chosen.any():
        return mesh
    faces = np.where(chosen[:, None], mesh.faces[:, [0, 2, 1]], mesh.faces)
    return Mesh(points=mesh.points, faces=faces, up=mesh.up)


def crossings(mesh: Mesh) -> Index:
    """Return the pairs of faces (K, 2) that cross, or touch without a common vertex or edge."""
    from igl.predicates import find_self_intersections

    points = np.array(mesh.points * unit_factor(mesh), order="C")
    _require_order(points[mesh.faces])
    _, pairs, _ = find_self_intersections(points, np.array(mesh.faces, order="C"))
    return np.asarray(pairs, dtype=np.int64).reshape(-1, 2)


def _require_order(faces: Array) -> None:
    """Refuse faces (F, 3, 3) whose boxes overlap too many others, by a sample."""
    lowest, highest = faces.min(axis=1), faces.max(axis=1)
    count = len(faces)
    sample = np.unique(np.linspace(0, count - 1, max(_SAMPLE_COST // count, 16)).astype(np.int64))
    met = [
        np.count_nonzero(((lowest <= highest[i]) & (highest >= lowest[i])).all(axis=1))
        for i in sample
    ]
    if np.mean(met) > _MOST_MET + _MOST_PAIRS / count:
        raise MeshError(
            f"it is too damaged: of its {count} faces each lies across {np.mean(met):.0f} others "
            "on average; export the surface again, or rebuild it in a mesh editor"
        )


def unit_factor(mesh: Mesh) -> float:
    """Return the power of two, free of rounding, that brings a mesh to an extent near 1."""
    # Products of six lengths of very large or small bodies leave the range of floating point.
    return float(2.0 ** -np.round(np.log2(mesh.extent)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shells:
    """A surface of closed pieces."""

    mesh: Mesh
    labels: Index  # (F,): the piece of each face
    volumes: Array  # (P,), m^3: negative where the normals of a piece point inward
    inner: Index  # (N,): pieces that lie inside others
    around: Index  # (N,): those others

    @classmethod
    def of(cls, mesh: Mesh) -> Shells:
        """Take a surface apart."""
        labels = pieces(mesh)
        inner, around = nesting(mesh, labels)
        volumes = volumes_of(mesh, labels)
        return cls(mesh=mesh, labels=labels, volumes=volumes, inner=inner, around=around)

    @property
    def depths(self) -> Index:
        """How many pieces lie around each (P,)."""
        return np.bincount(self.inner, minlength=len(self.volumes))

    def outward(self) -> tuple[Shells, int]:
        """Turn inside-out bodies over, with all that lies in them; tell how many there were."""
        wrong = (self.depths == 0) & (self.volumes < 0)
        turned = wrong.copy()
        turned[self.inner[wrong[self.around]]] = True
        mesh = flipped(self.mesh, turned[self.labels])
        volumes = np.where(turned, -self.volumes, self.volumes)
        return replace(self, mesh=mesh, volumes=volumes), int(np.count_nonzero(wrong))

    def bounding(self) -> Mask:
        """Tell which pieces part material from air, where none cross (P,)."""
        winding = np.bincount(
            self.inner, weights=np.sign(self.volumes)[self.around], minlength=len(self.volumes)
        )
        return np.where(self.volumes > 0, winding == 0, winding == 1)

    def bodies(self, pairs: Index) -> Index:
        """Return the body of each piece (P,): with its cavities and what it crosses."""
        crossing = self.labels[pairs]
        cavity = self.volumes[self.inner] < 0
        depth = self.depths[self.around]
        deepest = depth == self.depths[self.inner] - 1
        hold = np.stack([self.inner, self.around], axis=1)[cavity & deepest]
        return components(np.concatenate([crossing, hold]), len(self.volumes))

    def only(self, chosen: Mask) -> Shells:
        """Keep the `chosen` pieces (P,)."""
        if chosen.all():
            return self
        return Shells.of(submesh(self.mesh, np.flatnonzero(chosen[self.labels])))


# Faces that cross others are cut up along them, as only parts of them may lie in the open.

INSIDE = 0.5  # winding number from which on a point lies in material (Jacobson et al. 2013)
_HAIR = 1e-4  # how far beside a face to look for material, over the extent
_FINEST = 1 / 50  # length over the extent down to which crossing faces are cut
_ROUNDING = 1e-9
_MOST_PARTS, _MOST_CUT_PAIRS = 30_000, 300_000


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
    """Return the faces that part material from air, normals outward; None without any."""
    # `pairs` (K, 2): faces that cross each other.
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


def _sides(mesh: Mesh, parts: Mesh, patches: Index) -> tuple[Mask, Mask]:
    """Tell whether there is material above and below each part (F,), by one face a patch."""
    order = np.argsort(-parts.areas, kind="stable")
    _, first = np.unique(patches[order], return_index=True)
    largest = order[first]
    step = _HAIR * mesh.extent * parts.face_normals[largest]
    middles = parts.centroids[largest]
    above, below = (winding(mesh, middles + way) > INSIDE for way in (step, -step))
    return above[patches], below[patches]


def bared(mesh: Mesh) -> Mesh | None:
    """Return the open faces of a surface that branches, though its faces cancel at every edge."""
    # Bodies that share walls or overlap along common faces are like that. None where the surface
    # does not branch or close, or where the faces in the open bound something else.
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
    if len(part) > _MOST_CUT_PAIRS:
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
        cut &= len(parts) + sum(map(len, done)) <= _MOST_PARTS and len(part) <= _MOST_CUT_PAIRS
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
) -> Mask:
    """Tell whether each triangle may meet another, given by its box, plane and one corner."""
    margin = _ROUNDING * extent
    apart = (triangles.min(axis=1) > boxes[1] + margin) | (
        triangles.max(axis=1) < boxes[0] - margin
    )
    heights = np.einsum("kcd,kd->kc", triangles - origins[:, None], normals)
    beside = (heights.min(axis=1) > margin) | (heights.max(axis=1) < -margin)
    return ~(apart.any(axis=1) | beside)

"""Closed surfaces: which ones enclose a body, their pieces, and which faces lie in the open.

A surface bounds a solid when every edge belongs to exactly two faces that run along it in
opposite directions, and the normals point out of the material. Its edge-connected pieces then nest
like shells: pieces at even depth bound a body from outside, pieces at odd depth are cavities. The
winding number of all pieces together distinguishes material from air: it is above one half inside.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from struck.errors import MeshError, counted, rounded
from struck.model.arrays import Array, Index, Mask
from struck.model.mesh import Mesh, part_mesh
from struck.model.mesh_topology import (
    Edges,
    boxes_of,
    components,
    edges_of,
    extremes,
    nesting,
    pieces,
    submesh,
    turned_faces,
    volumes_of,
)
from struck.solids.surface.welding import remove_repeated

# Mesh files in single precision carry 1e-7 of their size as rounding: thinner is no body.
MIN_THICKNESS = 1e-6
ONE_SIDED_MESSAGE = (
    "the mesh cannot be oriented (it is one-sided, like a Klein bottle) and so has no inside: "
    "rebuild it as the boundary of a solid"
)


def is_closed(mesh: Mesh) -> bool:
    """Return whether each edge is shared by exactly two faces in opposite directions."""
    edges = edges_of(mesh.faces)
    return bool(edges.shared.all() and not edges.balance.any())


def require_closed(mesh: Mesh) -> None:
    """Raise MeshError with counts of the faults unless a surface encloses one solid body."""
    # Coincident vertices must be merged before.
    _require_thickness(mesh)
    edges = edges_of(mesh.faces)
    _require_two_faces_an_edge(edges)
    _require_orientation(edges, len(mesh.faces))
    labels = pieces(mesh)
    volumes = _require_volume(mesh, labels)
    inner, _ = nesting(mesh, labels)
    _require_one_body(np.bincount(inner, minlength=len(volumes)), volumes)


def _require_thickness(mesh: Mesh) -> None:
    corners = mesh.points[np.unique(mesh.faces)]
    offsets = corners - corners.mean(axis=0)
    _, _, axes = np.linalg.svd(offsets, full_matrices=False)
    thickness = float(np.ptp(offsets @ axes[-1])) if len(axes) == 3 else 0.0
    if thickness <= MIN_THICKNESS * mesh.extent:
        raise MeshError(
            f"the mesh is flat: its {len(corners)} vertices lie in one plane; give the body a "
            "thickness before export"
        )


def _require_two_faces_an_edge(edges: Edges) -> None:
    is_open, branching_count = edges.faces_at == 1, np.count_nonzero(edges.faces_at > 2)
    faults = []
    if is_open.any():
        holes = counted(_loops(edges.ends[is_open]), "hole")
        faults.append(f"{counted(np.count_nonzero(is_open), 'open edge')} in {holes}")
    if branching_count:
        faults.append(f"{counted(branching_count, 'edge')} shared by more than two faces")
    if faults:
        raise MeshError(
            f"the mesh is not closed: {' and '.join(faults)}; close holes and remove inner or "
            "doubled faces in a mesh editor, or leave repair on"
        )


def _require_orientation(edges: Edges, face_count: int) -> None:
    is_flipped = turned_faces(edges, face_count)
    if is_flipped is None:
        raise MeshError(ONE_SIDED_MESSAGE)
    flipped_count = int(np.count_nonzero(is_flipped))
    if flipped_count:
        raise MeshError(
            f"the mesh has {counted(flipped_count, 'face')} with flipped orientation of "
            f"{face_count}: make the normals consistent in a mesh editor, or "
            "leave repair on"
        )


def _require_volume(mesh: Mesh, labels: Index) -> Array:
    volumes = volumes_of(mesh, labels)
    areas = np.bincount(labels, weights=mesh.areas)
    is_empty = np.abs(volumes) <= MIN_THICKNESS * areas * boxes_of(mesh, labels).extents
    if is_empty.any():
        raise MeshError(
            f"the mesh encloses no volume in {np.count_nonzero(is_empty)} of its "
            f"{counted(len(volumes), 'piece')}: give sheets a thickness, or remove them"
        )
    return volumes


def _require_one_body(depths: Index, volumes: Array) -> None:
    is_outer = depths % 2 == 0
    if np.count_nonzero(is_outer) > 1:
        raise MeshError(
            f"the mesh holds {np.count_nonzero(is_outer)} separate bodies: give one at a time, or "
            "join them into one surface, or leave repair on for the largest"
        )
    if np.any(volumes[is_outer] < 0):
        raise MeshError(
            f"the mesh is inside out (its volume is {rounded(volumes.sum(), 3)} m^3): flip all "
            "faces so that the normals point outward, or leave repair on"
        )
    solid_count = np.count_nonzero(volumes[~is_outer] > 0)
    if solid_count:
        raise MeshError(
            f"{counted(solid_count, 'inner shell')} of the mesh with normals outward would be a "
            "body within the body: flip the faces to make a cavity, remove them, or leave repair on"
        )


def _loops(ends: Index) -> int:
    vertices, local = np.unique(ends, return_inverse=True)
    return int(components(local.reshape(-1, 2), len(vertices)).max() + 1)


# Boxes of other faces that the box of a face may overlap: of sound surfaces it is a dozen or two,
# and small ones may be as bad as they like.
_MAX_OVERLAPS, _MAX_PAIRS = 100, 20_000_000
_SAMPLE_COST = 500_000


def separate_pieces(mesh: Mesh) -> Mesh:
    """Return the mesh with pieces that share a vertex given one each."""
    # So edges where several pieces meet belong to two faces of each, or are open.
    keys = np.repeat(pieces(mesh), 3) * len(mesh.points) + mesh.faces.ravel()
    used_keys, renumbered = np.unique(keys, return_inverse=True)
    points = mesh.points[used_keys % len(mesh.points)]
    return part_mesh(points, renumbered.reshape(-1, 3), mesh.up)


def remove_fins(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the mesh without pieces that only lean on others, and how many faces went."""
    # Fins and inner walls meet closed pieces in edges of three faces; without them, smallest
    # first, these edges belong to two.
    edges, labels = edges_of(mesh.faces), pieces(mesh)
    if not np.any(edges.faces_at > 2):
        return mesh, 0
    face_counts = edges.faces_at.copy()
    owner = edges.owner.reshape(-1, 3)
    is_remaining = np.ones(len(mesh.faces), bool)
    leaning_pieces = np.unique(labels[np.any(face_counts[owner] > 2, axis=1)])
    areas = np.bincount(labels, weights=mesh.areas)
    for piece in leaning_pieces[np.argsort(areas[leaning_pieces])]:
        faces = np.flatnonzero(labels == piece)
        piece_edges, counts = np.unique(owner[faces], return_counts=True)
        is_border = counts == 1
        remaining_counts = face_counts[piece_edges[is_border]] - 1
        if np.all(remaining_counts % 2 == 0) and np.any(remaining_counts > 0):
            face_counts[piece_edges] -= counts
            is_remaining[faces] = False
    return submesh(mesh, np.flatnonzero(is_remaining)), int(np.count_nonzero(~is_remaining))


def flip_faces(mesh: Mesh, chosen: Mask) -> Mesh:
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
    low, high = extremes(faces)
    count = len(faces)
    sample = np.unique(np.linspace(0, count - 1, max(_SAMPLE_COST // count, 16)).astype(np.int64))
    overlap_counts = [
        np.count_nonzero(((low <= high[i]) & (high >= low[i])).all(axis=1)) for i in sample
    ]
    if np.mean(overlap_counts) > _MAX_OVERLAPS + _MAX_PAIRS / count:
        raise MeshError(
            f"it is too damaged: of its {count} faces each lies across "
            f"{np.mean(overlap_counts):.0f} others "
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
    around: Index  # (N,): the pieces around them

    @classmethod
    def of(cls, mesh: Mesh) -> Shells:
        """Return a surface taken apart into closed pieces."""
        labels = pieces(mesh)
        inner, around = nesting(mesh, labels)
        volumes = volumes_of(mesh, labels)
        return cls(mesh=mesh, labels=labels, volumes=volumes, inner=inner, around=around)

    @property
    def depths(self) -> Index:
        """Number of pieces that lie around each piece (P,)."""
        return np.bincount(self.inner, minlength=len(self.volumes))

    def orient_outward(self) -> tuple[Shells, int]:
        """Turn inside-out bodies over, with all surfaces inside them; return how many."""
        is_inverted = (self.depths == 0) & (self.volumes < 0)
        is_flipped = is_inverted.copy()
        is_flipped[self.inner[is_inverted[self.around]]] = True
        mesh = flip_faces(self.mesh, is_flipped[self.labels])
        volumes = np.where(is_flipped, -self.volumes, self.volumes)
        return replace(self, mesh=mesh, volumes=volumes), int(np.count_nonzero(is_inverted))

    def bounding(self) -> Mask:
        """Return which pieces part material from air, where none cross (P,)."""
        winding = np.bincount(
            self.inner, weights=np.sign(self.volumes)[self.around], minlength=len(self.volumes)
        )
        return np.where(self.volumes > 0, winding == 0, winding == 1)

    def bodies(self, pairs: Index) -> Index:
        """Return the body of each piece (P,), the same for cavities and crossing pieces."""
        crossing = self.labels[pairs]
        is_cavity = self.volumes[self.inner] < 0
        is_deepest = self.depths[self.around] == self.depths[self.inner] - 1
        cavity_pairs = np.stack([self.inner, self.around], axis=1)[is_cavity & is_deepest]
        return components(np.concatenate([crossing, cavity_pairs]), len(self.volumes))

    def select(self, chosen: Mask) -> Shells:
        """Return the surface with only the `chosen` pieces (P,)."""
        if chosen.all():
            return self
        return Shells.of(submesh(self.mesh, np.flatnonzero(chosen[self.labels])))


# Faces that cross others are cut up along them, as only parts of them may lie in the open.

INSIDE_WINDING = 0.5  # winding number from which on a point lies in material (Jacobson et al. 2013)
_PROBE_DISTANCE = 1e-4  # distance from a face at which material is sought, over the extent
_MIN_CUT_LENGTH = 1 / 50  # length over the extent down to which crossing faces are cut
_ROUNDING = 1e-9
_MAX_PARTS, _MAX_CUT_PAIRS = 30_000, 300_000


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


def expose_faces(mesh: Mesh, pairs: Index) -> Mesh | None:
    """Return the faces that part material from air, normals outward; None without any."""
    # `pairs` (K, 2): faces that cross each other.
    crossing, local = np.unique(pairs, return_inverse=True)
    small = _halve_crossing(mesh.points[mesh.faces[crossing]], local.reshape(-1, 2), mesh.extent)
    uncrossed_faces = np.setdiff1d(np.arange(len(mesh.faces)), crossing)
    new_faces = np.arange(3 * len(small)).reshape(-1, 3) + len(mesh.points)
    parts = Mesh(
        points=np.concatenate([mesh.points, small.reshape(-1, 3)]),
        faces=np.concatenate([mesh.faces[uncrossed_faces], new_faces]),
        up=mesh.up,
    )
    patches = np.concatenate([_patches(mesh, uncrossed_faces), np.arange(len(small))])
    patches[len(uncrossed_faces) :] += patches[: len(uncrossed_faces)].max(initial=-1) + 1
    is_material_above, is_material_below = _sides(mesh, parts, patches)
    bounding = np.flatnonzero(is_material_above != is_material_below)
    return submesh(flip_faces(parts, is_material_above), bounding) if len(bounding) else None


def _patches(mesh: Mesh, chosen: Index) -> Index:
    """Return the patch of each of the `chosen` faces, which do not cross."""
    sides, is_oriented = edges_of(mesh.faces).pairs()
    number = np.full(len(mesh.faces), -1)
    number[chosen] = np.arange(len(chosen))
    patch_pairs = number[sides[is_oriented]]
    return components(patch_pairs[(patch_pairs >= 0).all(axis=1)], len(chosen))


def _sides(mesh: Mesh, parts: Mesh, patches: Index) -> tuple[Mask, Mask]:
    """Return whether there is material above and below each part (F,), by one face a patch."""
    order = np.argsort(-parts.areas, kind="stable")
    _, first = np.unique(patches[order], return_index=True)
    largest_faces = order[first]
    step = _PROBE_DISTANCE * mesh.extent * parts.face_normals[largest_faces]
    centroids = parts.centroids[largest_faces]
    is_material_above, is_material_below = (
        winding(mesh, centroids + offset) > INSIDE_WINDING for offset in (step, -step)
    )
    return is_material_above[patches], is_material_below[patches]


def find_open_faces(mesh: Mesh) -> Mesh | None:
    """Return the open faces of a surface that branches, though its faces cancel at every edge."""
    # Bodies that share walls or overlap along common faces are like that. None where the surface
    # does not branch or close, or where the faces in the open bound something else.
    edges = edges_of(mesh.faces)
    if edges.balance.any() or not np.any(edges.faces_at > 2):
        return None
    oriented_mesh = flip_faces(mesh, np.full(len(mesh.faces), mesh.volume < 0))
    open_mesh = expose_faces(oriented_mesh, np.empty((0, 2), np.int64))
    if open_mesh is None or not 0 < open_mesh.volume <= (1 + _ROUNDING) * oriented_mesh.volume:
        return None
    return remove_repeated(open_mesh)[0]


def _halve_crossing(faces: Array, pairs: Index, extent: float) -> Array:
    """Halve triangles (T, 3, 3) while they are long and may still meet one they cross."""
    boxes = np.stack(extremes(faces))
    normals = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), np.finfo(float).tiny)
    parts, small_parts = faces, []
    part, partner = np.concatenate([pairs, pairs[:, ::-1]]).T
    if len(part) > _MAX_CUT_PAIRS:
        return faces
    while len(parts):
        is_near = _may_meet(
            parts[part], boxes[:, partner], faces[partner, 0], normals[partner], extent
        )
        part, partner = part[is_near], partner[is_near]
        longest, first = _longest(parts)
        is_cut = np.zeros(len(parts), bool)
        is_cut[part] = True
        is_cut &= longest > _MIN_CUT_LENGTH * extent
        is_cut &= (
            len(parts) + sum(map(len, small_parts)) <= _MAX_PARTS and len(part) <= _MAX_CUT_PAIRS
        )
        small_parts.append(parts[~is_cut])
        number = np.cumsum(is_cut) - 1
        part, partner = number[part[is_cut[part]]], partner[is_cut[part]]
        parts = _bisect(parts[is_cut], first[is_cut])
        part, partner = np.concatenate([part, part + len(parts) // 2]), np.tile(partner, 2)
    return np.concatenate([np.empty((0, 3, 3)), *small_parts])


def halves(triangles: Array, longest: float) -> tuple[Array, Array]:
    """Return the triangles (T, 3, 3) no longer than `longest`, and both halves of the others."""
    lengths, first = _longest(triangles)
    is_cut = lengths > longest
    return triangles[~is_cut], _bisect(triangles[is_cut], first[is_cut])


def _longest(triangles: Array) -> tuple[Array, Index]:
    """Return the longest side of each triangle and the corner it starts from."""
    a, b, c = triangles.transpose(1, 0, 2)
    squared_lengths = np.stack(
        [np.einsum("td,td->t", side, side) for side in (b - a, c - b, a - c)]
    )
    first = squared_lengths.argmax(axis=0)
    return np.sqrt(np.take_along_axis(squared_lengths, first[None], axis=0)[0]), first


def _bisect(triangles: Array, first: Index) -> Array:
    """Halve triangles at their longest sides: first halves, then second halves."""
    corner_order = (first[:, None] + np.arange(3)) % 3
    a, b, c = np.take_along_axis(triangles, corner_order[:, :, None], axis=1).transpose(1, 0, 2)
    midpoints = (a + b) / 2
    return np.concatenate([np.stack([a, midpoints, c], 1), np.stack([midpoints, b, c], 1)])


def _may_meet(
    triangles: Array, boxes: Array, origins: Array, normals: Array, extent: float
) -> Mask:
    """Return whether each triangle may meet another, given by its box, plane and one corner."""
    margin = _ROUNDING * extent
    low, high = extremes(triangles)
    is_separated = (low > boxes[1] + margin) | (high < boxes[0] - margin)
    heights = np.einsum("kcd,kd->kc", triangles - origins[:, None], normals)
    is_off_plane = (heights.min(axis=1) > margin) | (heights.max(axis=1) < -margin)
    return ~(is_separated.any(axis=1) | is_off_plane)

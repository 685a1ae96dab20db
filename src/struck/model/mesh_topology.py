"""Topology of a triangle surface: its edges, connected pieces, and which lie inside which."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.model.arrays import Array, Index
from struck.model.mesh import Mesh, part_mesh


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Edges:
    """Edges of a triangle surface."""

    ends: Index  # (E, 2) vertices, the lower number first
    faces_at: Index  # (E,) number of faces at the edge
    balance: Index  # (E,) how many more faces run along it from its first end than from its second
    owner: Index  # (3 F,) the edge of each side of each face

    @property
    def shared(self) -> NDArray[np.bool_]:
        """Mask of the edges that join exactly two faces."""
        return self.faces_at == 2

    def pairs(self) -> tuple[Index, NDArray[np.bool_]]:
        """Return the two faces at each shared edge (S, 2), and whether they agree (S,)."""
        order = np.argsort(self.owner, kind="stable")
        order = order[self.shared[self.owner[order]]]
        return order.reshape(-1, 2) // 3, self.balance[self.shared] == 0


def edges_of(faces: Index) -> Edges:
    """Return the edges of `faces` (F, 3)."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    low, high = np.minimum(start, end), np.maximum(start, end)
    stride = faces.max() + 1
    keys, owner, counts = np.unique(low * stride + high, return_inverse=True, return_counts=True)
    direction = np.where(start < end, 1, -1)
    return Edges(
        ends=np.stack([keys // stride, keys % stride], axis=1),
        faces_at=counts,
        balance=np.bincount(owner, weights=direction).astype(np.int64),
        owner=owner,
    )


def components(pairs: Index, count: int) -> Index:
    """Return the component of each of `count` nodes, numbered in order of appearance."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    ones = np.ones(len(pairs), dtype=np.int8)
    graph = coo_array((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def pieces(mesh: Mesh) -> Index:
    """Return the number of the edge-connected piece of each face (F,), from 0 in file order."""
    sides, _ = edges_of(mesh.faces).pairs()
    return components(sides, len(mesh.faces))


def turned_faces(edges: Edges, face_count: int) -> NDArray[np.bool_] | None:
    """Return which faces to flip (F,), the fewest of each piece; None on a one-sided surface."""
    # Each face appears twice, as it is and flipped (its number plus F), joined to its neighbours'
    # consistent copies. A two-sided piece falls into two mirrored halves.
    sides, is_consistent = edges.pairs()
    copies = np.where(is_consistent, sides[:, 1], sides[:, 1] + face_count)
    mirror_copies = np.where(is_consistent, sides[:, 1] + face_count, sides[:, 1])
    pairs = [np.c_[sides[:, 0], copies], np.c_[sides[:, 0] + face_count, mirror_copies]]
    labels, flipped_labels = components(np.concatenate(pairs), 2 * face_count).reshape(
        2, face_count
    )
    if np.any(labels == flipped_labels):
        return None
    # A half holds as many faces as they are as its mirror image holds flipped.
    face_counts = np.bincount(labels, minlength=max(labels.max(), flipped_labels.max()) + 1)
    sizes, flipped_sizes = face_counts[labels], face_counts[flipped_labels]
    return (sizes < flipped_sizes) | ((sizes == flipped_sizes) & (labels > flipped_labels))


def volumes_of(mesh: Mesh, labels: Index) -> Array:
    """Return the signed volume of each piece about its own middle, open ones too, m^3 (P,)."""
    offsets = mesh.centroids - boxes_of(mesh, labels).middles[labels]
    cones = np.einsum("ij,ij->i", offsets, mesh.area_vectors) / 3
    return np.bincount(labels, weights=cones).astype(np.float64)


def bodies(mesh: Mesh) -> list[Index]:
    """Return the faces of each separate body of a closed surface, cavities with their body."""
    labels = pieces(mesh)
    owner = _owners(mesh, labels)
    return [np.flatnonzero(owner[labels] == body) for body in np.unique(owner)]


def submesh(mesh: Mesh, faces: Index) -> Mesh:
    """Return the surface of some `faces`, without the vertices that they do not use."""
    vertices, renumbered = np.unique(mesh.faces[faces], return_inverse=True)
    return part_mesh(mesh.points[vertices], renumbered.reshape(-1, 3), mesh.up)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Boxes:
    """Bounding boxes of pieces by their corners."""

    lowest: Array  # (P, 3), m
    highest: Array  # (P, 3), m

    @property
    def middles(self) -> Array:
        """Centres of the pieces' bounding boxes, m (P, 3)."""
        return (self.lowest + self.highest) / 2

    @property
    def extents(self) -> Array:
        """Longest edges of the pieces' bounding boxes, m (P,)."""
        return (self.highest - self.lowest).max(axis=1)

    def nested(self) -> Iterator[tuple[int, Index]]:
        """Yield each box that holds other boxes, and their numbers."""
        order = np.argsort(self.lowest[:, 0])
        starts = self.lowest[order, 0]
        for box in range(len(order)):
            low, high = self.lowest[box], self.highest[box]
            candidates = order[np.searchsorted(starts, low[0]) : np.searchsorted(starts, high[0])]
            is_enclosed = (self.lowest[candidates] > low) & (self.highest[candidates] < high)
            if is_enclosed.all(axis=1).any():
                yield box, candidates[is_enclosed.all(axis=1)]


def extremes(triangles: Array) -> tuple[Array, Array]:
    """Return the lowest and highest coordinates (T, 3) of triangles (T, 3, 3)."""
    a, b, c = triangles.transpose(1, 0, 2)  # three times faster than a reduction over the corners
    return np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)


def boxes_of(mesh: Mesh, labels: Index) -> Boxes:
    """Return the bounding boxes of the pieces numbered by `labels` (F,)."""
    lowest = np.full((labels.max() + 1, 3), np.inf)
    highest = -lowest
    corners = mesh.points[mesh.faces]
    np.minimum.at(lowest, labels, corners.min(axis=1))
    np.maximum.at(highest, labels, corners.max(axis=1))
    return Boxes(lowest=lowest, highest=highest)


def nesting(mesh: Mesh, labels: Index) -> tuple[Index, Index]:
    """Return pairs of pieces (inner, shell) of which the first lies inside the second."""
    first = mesh.points[mesh.faces[np.unique(labels, return_index=True)[1], 0]]
    inner: list[Index] = [np.empty(0, np.int64)]
    shells: list[Index] = [np.empty(0, np.int64)]
    for shell, suspects in boxes_of(mesh, labels).nested():
        winding = _winding_numbers(mesh, labels == shell, first[suspects])
        enclosed_pieces = suspects[np.abs(winding) > 0.5]
        inner.append(enclosed_pieces)
        shells.append(np.full(len(enclosed_pieces), shell))
    return np.concatenate(inner), np.concatenate(shells)


def _owners(mesh: Mesh, labels: Index) -> Index:
    """Return the piece that bounds the body of each piece from outside (P,)."""
    inner, shells = nesting(mesh, labels)
    owner = np.arange(labels.max() + 1)
    depths = np.bincount(inner, minlength=len(owner))
    order = np.argsort(depths[shells], kind="stable")
    inner, shells = inner[order], shells[order]
    cavity = depths[inner] % 2 == 1
    owner[inner[cavity]] = shells[cavity]  # the deepest shell around it is written last
    return owner


def _winding_numbers(mesh: Mesh, chosen: NDArray[np.bool_], points: Array) -> Array:
    """Return how often the chosen faces wind around `points` (Barill et al. 2018)."""
    import igl

    faces = np.ascontiguousarray(mesh.faces[chosen])
    return np.atleast_1d(igl.fast_winding_number(mesh.points, faces, points))

"""Crisp edges of a surface, and nodes moved onto them so that a filled body keeps them.

A lattice knows nothing of edges: it bevels convex ones and fills concave ones by a share of its
spacing, which costs volume and shifts frequencies.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.spatial import KDTree

from struck.geometry import Surface
from struck.model.mesh import Mesh
from struck.solids.cutting import PAIRS
from struck.solids.volume_mesh import VolumeMesh, unique_rows

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
# Angle between the normals of two faces from which on the edge between them is crisp, degrees.
_CRISP = 40.0
# Of an element's volume over that of a regular one with edges as long; below it a move is undone.
_WORST = 0.03
_CANDIDATES = 4
_CHUNK = 256


@dataclass(frozen=True, kw_only=True, eq=False)
class Features:
    """Edges where the smooth patches of a closed surface meet, and corners where three do.

    Parameters
    ----------
    mesh : Mesh
        Closed surface.
    """

    mesh: Mesh

    @cached_property
    def _creases(self) -> tuple[Index, Index, Index]:
        """Return the patch of each face (F,), the crisp edges (M, 2), and their patches (M, 2)."""
        edges, faces = _shared_edges(self.mesh.faces)
        cosines = np.einsum("ed,ed->e", *self.mesh.face_normals[faces.T])
        smooth = faces[cosines >= np.cos(np.radians(_CRISP))]
        count = len(self.mesh.faces)
        graph = sparse.coo_array((np.ones(len(smooth)), smooth.T), shape=(count, count))
        patches = sparse.csgraph.connected_components(graph, directed=False)[1].astype(np.int64)
        sides = np.sort(patches[faces], axis=1)
        between = sides[:, 0] != sides[:, 1]
        return patches, edges[between], sides[between]

    @cached_property
    def corners(self) -> Array:
        """Points where three patches or more meet, m (C, 3)."""
        _, edges, sides = self._creases
        meeting = np.stack([edges[:, [0, 0, 1, 1]], sides[:, [0, 1, 0, 1]]], axis=-1)
        if not len(edges):
            return np.empty((0, 3))
        vertices, counts = np.unique(
            unique_rows(meeting.reshape(-1, 2))[0][:, 0], return_counts=True
        )
        return self.mesh.points[vertices[counts > 2]]

    def kept(self, linear: VolumeMesh, on: Flags) -> VolumeMesh:
        """Return linear tetrahedra with nodes moved onto corners and edges that they cut off.

        Parameters
        ----------
        linear : VolumeMesh
            Tetrahedra whose boundary lies near the surface.
        on : array (N,)
            Which nodes lie on the surface.
        """
        if not len(self._creases[1]):
            return linear
        sides = linear.boundary_sides()[0]
        sides = sides[on[sides].all(axis=1)]
        edges, _ = unique_rows(np.sort(sides[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1))
        moves = _Moves(linear)
        for candidates in self._to_corners(linear.nodes, edges):
            moves.attempt(candidates)
        for ends, candidates in self._to_edges(linear.nodes, edges):
            if not moves.placed[ends].any():
                moves.attempt(candidates)
        return replace(linear, nodes=moves.nodes)

    def _to_corners(self, nodes: Array, edges: Index) -> Iterator[list[tuple[int, Array]]]:
        """Yield for each corner the boundary nodes near it, the nearest first."""
        boundary = np.unique(edges)
        reach = _lengths(nodes, edges).max()
        distances, near = KDTree(nodes[boundary]).query(self.corners, k=_CANDIDATES)
        close = np.asarray(distances) < reach
        for corner, chosen, wanted in zip(self.corners, np.asarray(near), close, strict=True):
            yield [(int(boundary[k]), corner) for k in chosen[wanted]]

    def _to_edges(
        self, nodes: Array, edges: Index
    ) -> Iterator[tuple[Index, list[tuple[int, Array]]]]:
        """Yield boundary edges from patch to patch, with their ends' ways to the crisp edge."""
        patches, creases, sides = self._creases
        boundary = np.unique(edges)
        patch = np.zeros(len(nodes), np.int64)
        patch[boundary] = patches[Surface(self.mesh).closest(nodes[boundary])[1]]
        pairs = np.sort(patch[edges], axis=1)
        found = []
        for pair in np.unique(sides, axis=0):
            across = edges[(pairs == pair).all(axis=1)]
            crease = self.mesh.points[creases[(sides == pair).all(axis=1)]]
            goals = _nearest(crease, nodes[across].reshape(-1, 3)).reshape(-1, 2, 3)
            away = np.linalg.norm(goals - nodes[across], axis=2)
            close = away.min(axis=1) < _lengths(nodes, across)
            found += list(zip(across[close], goals[close], away[close], strict=True))
        for ends, goals, away in sorted(found, key=lambda each: each[2].min()):
            yield ends, [(int(ends[k]), goals[k]) for k in np.argsort(away)]


class _Moves:
    """Nodes of tetrahedra moved one by one, each only where no element becomes too flat."""

    def __init__(self, mesh: VolumeMesh) -> None:
        self.nodes, self.placed = mesh.nodes.copy(), np.zeros(len(mesh.nodes), bool)
        self._elements = mesh.elements
        owners = np.repeat(np.arange(len(mesh.elements)), mesh.elements.shape[1])
        order = np.argsort(mesh.elements, axis=None, kind="stable")
        self._owners = owners[order]
        self._starts = np.searchsorted(mesh.elements.ravel()[order], np.arange(len(mesh.nodes) + 1))

    def attempt(self, candidates: list[tuple[int, Array]]) -> None:
        """Move the first of the nodes that can go to its goal there."""
        for node, goal in candidates:
            if self.placed[node]:
                continue
            before = self.nodes[node].copy()
            self.nodes[node] = goal
            if self._worst_at(node) > _WORST:
                self.placed[node] = True
                return
            self.nodes[node] = before

    def _worst_at(self, node: int) -> float:
        """Return the worst shape of the elements at a node: 1 is regular, 0 flat."""
        owners = self._owners[self._starts[node] : self._starts[node + 1]]
        corners = self.nodes[self._elements[owners]]
        volumes = np.linalg.det(corners[:, 1:] - corners[:, :1])
        ends = corners[:, np.array(PAIRS)]
        squares = ((ends[:, :, 0] - ends[:, :, 1]) ** 2).sum(axis=2).mean(axis=1)
        return float((np.sqrt(2) * volumes / squares**1.5).min(initial=1.0))


def _shared_edges(faces: Index) -> tuple[Index, Index]:
    """Return the edges that two faces share (E, 2), and those faces (E, 2)."""
    every = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, number = unique_rows(every)
    order = np.argsort(number, kind="stable")
    first = np.searchsorted(number[order], np.arange(len(edges)))
    shared = np.bincount(number) == 2
    owners = order // 3
    return edges[shared], np.stack([owners[first[shared]], owners[first[shared] + 1]], axis=1)


def _lengths(nodes: Array, edges: Index) -> Array:
    return np.linalg.norm(nodes[edges[:, 0]] - nodes[edges[:, 1]], axis=1)


def _nearest(segments: Array, points: Array) -> Array:
    """Return the points of segments (M, 2, 3) nearest to `points` (K, 3)."""
    starts, ways = segments[:, 0], segments[:, 1] - segments[:, 0]
    squares = np.maximum((ways**2).sum(axis=1), np.finfo(float).tiny)
    parts = [np.empty((0, 3))]
    for first in range(0, len(points), _CHUNK):
        offsets = points[first : first + _CHUNK, None] - starts
        shares = np.clip((offsets * ways).sum(axis=2) / squares, 0.0, 1.0)
        away = ((offsets - shares[..., None] * ways) ** 2).sum(axis=2)
        best = away.argmin(axis=1)
        parts.append(starts[best] + shares[np.arange(len(best)), best, None] * ways[best])
    return np.vstack(parts)

"""Crisp edges of a surface, and nodes moved onto them so that a filled body keeps them.

A lattice knows nothing of edges: it bevels convex ones and fills concave ones by a share of its
spacing, which costs volume and shifts frequencies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.spatial import KDTree

from struck.model.arrays import Array, Index, Mask
from struck.model.mesh import Mesh, Surface
from struck.solids.filling.stuffing import PAIRS, Cells
from struck.solids.volume_mesh import VolumeMesh, unique_rows

# Angle between the normals of two faces from which on the edge between them is crisp, degrees.
_CRISP = 40.0
# Of an element's volume over that of a regular one with edges as long; below it a move is undone.
_WORST = 0.03
_CANDIDATES = 4
_CHUNK = 256


@dataclass(frozen=True, kw_only=True, eq=False)
class Features:
    """Edges where the smooth patches of a closed surface meet, and corners where three do."""

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

    def kept(self, linear: VolumeMesh, on: Mask) -> VolumeMesh:
        """Return linear tetrahedra with nodes moved onto the corners and edges they cut off."""
        # `on` (N,): which nodes lie on the surface.
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


# Boundary nodes moved onto the true surface, as far as no element folds over.
#
# Straight-sided quadratic tetrahedra are worse than linear hexahedra on curved walls: the
# geometry must be quadratic too.

Onto = Callable[[float, Array], Array]
HALFWAY = 0.5
# Smallest allowed ratio of an element's least Jacobian determinant to its mean.
_FLATTEST = 0.02
_HALVINGS = 3
# No tetrahedron gets flatter than this by moving, unless half as flat as it was.
_LEAST_SHAPE = 0.05
_CURVING_CHUNK = 4096


def curved(
    cells: Cells, onto: Onto, up: str = "z", features: Features | None = None
) -> tuple[VolumeMesh, int]:
    """Return quadratic tetrahedra bent onto the surfaces, and how many nodes stay short of them."""
    # Depths of 0 tell near which surface a node lies; `onto` moves points (K, 3) onto the surface
    # of a number (0.5: halfway from 0 to 1). The `features` are the crisp edges of surface 0.
    linear = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4", up=up)
    surfaces = range(cells.depths.shape[1])
    on: dict[float, Mask] = {number: cells.depths[:, number] == 0 for number in surfaces}
    linear, held = _moved(linear, on, onto)
    linear = linear if features is None else features.kept(linear, on[0])
    quadratic = linear.promoted()
    result, short = _moved(quadratic, _middles(quadratic, on), onto)
    return result, held + short


def _middles(mesh: VolumeMesh, on: dict[float, Mask]) -> dict[float, Mask]:
    """Return which mid-edge nodes of the boundary, or of a wall's edges, are near a surface."""
    # Edges through a thin wall must bow as its faces do, or the faces would pass them.
    found = {surface: np.zeros(len(mesh.nodes), bool) for surface in on}
    for sides in mesh.boundary_sides():
        corners, middles = sides[:, :3], sides[:, 3:]
        for surface, flags in on.items():
            along = flags[corners] & flags[np.roll(corners, -1, axis=1)]
            found[surface][middles[along]] = True
    if 1 in on:
        first, second = mesh.elements[:, np.array(mesh.element.edges)].transpose(2, 0, 1)
        through = (on[0][first] & on[1][second]) | (on[1][first] & on[0][second])
        found[HALFWAY] = np.zeros(len(mesh.nodes), bool)
        found[HALFWAY][mesh.elements[:, len(mesh.element.corners) :][through]] = True
    return found


def _any(on: dict[float, Mask]) -> Mask:
    return np.asarray(np.any(list(on.values()), axis=0))


def _ways(mesh: VolumeMesh, on: dict[float, Mask], onto: Onto) -> Array:
    """Return how far each node is from the surfaces it belongs on, one after the other (N, 3)."""
    goal = mesh.nodes.copy()
    for surface, flags in on.items():
        goal[flags] = onto(surface, goal[flags])
    return goal - mesh.nodes


def _moved(mesh: VolumeMesh, on: dict[float, Mask], onto: Onto) -> tuple[VolumeMesh, int]:
    """Move nodes onto their surfaces, or part of the way where elements would fold."""
    way = _ways(mesh, on, onto)
    least = np.minimum(_LEAST_SHAPE, shapes(mesh) / 2)
    share, halvings = _any(on).astype(float), 0
    flat, stirred = np.zeros(len(mesh.elements), bool), share > 0
    while True:
        nodes = mesh.nodes + share[:, None] * way
        again = np.flatnonzero(stirred[mesh.elements].any(axis=1))
        moved = replace(mesh, nodes=nodes)
        flat[again] = flatness(moved, again) < _FLATTEST
        flat[again] |= shapes(moved, again) < least[again]
        stirred = np.zeros(len(share), bool)
        stirred[mesh.elements[flat]] = True
        stirred &= share > 0
        if not stirred.any():
            break
        share[stirred] *= 0.5 if halvings < _HALVINGS else 0.0
        halvings += 1
    return replace(mesh, nodes=nodes), int(np.count_nonzero(share[_any(on)] < 1))


def flatness(mesh: VolumeMesh, chosen: Index | slice = slice(None)) -> Array:
    """Return least over mean Jacobian determinant of elements (E,): 1 straight, below 0 folded."""
    points = np.vstack([mesh.element.nodes, mesh.element.mass_rule.points])
    gradients = mesh.element.gradients(points).transpose(2, 1, 0)
    elements = mesh.elements[chosen]
    parts = []
    for start in range(0, len(elements), _CURVING_CHUNK):
        corners = mesh.nodes[elements[start : start + _CURVING_CHUNK]].transpose(2, 0, 1)
        found = _determinants(corners[:, None] @ gradients)
        mean = np.abs(found).mean(axis=1)
        parts.append(found.min(axis=1) / np.maximum(mean, np.finfo(float).tiny))
    return np.concatenate(parts) if parts else np.empty(0)


def shapes(mesh: VolumeMesh, chosen: Index | slice = slice(None)) -> Array:
    """Return the volume of tetrahedra over that of regular ones with edges as long (E,)."""
    # The edges' mean square stands for their length (Liu & Joe 1994).
    corners = mesh.nodes[mesh.corners[chosen]].transpose(2, 1, 0)
    edges = np.stack([corners[:, b] - corners[:, a] for a, b in PAIRS])
    square = (edges**2).sum(axis=1).mean(axis=0)
    return np.sqrt(2) * _determinants(edges[:3].transpose(1, 0, 2)) / square**1.5


def _determinants(matrices: Array) -> Array:
    """Return the determinants of matrices (3, 3, ...): many small ones, far faster than LU."""
    (a, b, c), (d, e, f), (g, h, i) = matrices
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)

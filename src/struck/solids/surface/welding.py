"""Openings of a surface filled, near vertices merged, repeated and flat faces removed."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from struck.model.arrays import Array, Index, Mask
from struck.model.mesh import Mesh
from struck.model.mesh_topology import components, edges_of, submesh

_REFLEX = 1e3  # factor on the cost of ears that point inward, so that they come last


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Closed:
    """A surface with its openings filled: the old faces, then the new ones."""

    mesh: Mesh
    rims: tuple[Index, ...]  # the vertices around each opening


def close_openings(mesh: Mesh, rims: Sequence[Index] | None = None) -> Closed:
    """Fill the openings of a consistently oriented surface, all or the ones within `rims`."""
    # Each loop of open edges is filled from its shortest chords on (ears cut off a polygon). No
    # new edge runs where the surface has one already.
    rims = loops(mesh.faces) if rims is None else rims
    if not rims:
        return Closed(mesh=mesh, rims=())
    ends = edges_of(mesh.faces).ends
    used_edges = {(a, b) for a, b in ends[np.isin(ends, np.concatenate(rims)).all(axis=1)].tolist()}
    points, new_faces = [mesh.points], []
    count = len(mesh.points)
    for rim in rims:
        triangles, left = _ears(mesh.points[rim], rim, used_edges)
        new_faces += triangles
        if len(left) > 2:
            new_faces += [(left[i - 1], left[i], count) for i in range(len(left))]
            points.append(mesh.points[left].mean(axis=0, keepdims=True))
            count += 1
    faces = np.concatenate([mesh.faces, np.array(new_faces, dtype=np.int64)])
    closed_mesh = Mesh(points=np.concatenate(points), faces=faces, up=mesh.up)
    return Closed(mesh=closed_mesh, rims=tuple(rims))


def loops(faces: Index) -> list[Index]:
    """Return the simple loops of the boundary, each the way round that faces to fill it take."""
    # The boundary of a surface is a sum of loops, whatever the surface: through an edge run as
    # many as it has faces more in one direction than in the other.
    edges = edges_of(faces)
    next_vertices: dict[int, list[int]] = defaultdict(list)
    unbalanced_edges = np.flatnonzero(edges.balance)
    for (low, high), balance in zip(
        edges.ends[unbalanced_edges].tolist(), edges.balance[unbalanced_edges].tolist(), strict=True
    ):
        start, end = (high, low) if balance > 0 else (low, high)
        next_vertices[start] += [end] * abs(balance)
    boundary_loops: list[Index] = []
    for start in list(next_vertices):
        while next_vertices[start]:
            boundary_loops += _walk_loops(start, next_vertices)
    return boundary_loops


def _walk_loops(start: int, next_vertices: dict[int, list[int]]) -> list[Index]:
    """Walk until the path is back at its start, cutting off a loop wherever it meets itself."""
    closed_loops = []
    path, place = [start], {start: 0}
    while next_vertices[path[-1]]:
        reached = next_vertices[path[-1]].pop()
        if reached not in place:
            place[reached] = len(path)
            path.append(reached)
            continue
        loop = path[place[reached] :]
        closed_loops.append(np.array(loop, dtype=np.int64))
        for vertex in loop[1:]:
            del place[vertex]
        del path[place[reached] + 1 :]
    return closed_loops


def _ears(
    points: Array, rim: Index, used_edges: set[tuple[int, int]]
) -> tuple[list[tuple[int, int, int]], list[int]]:
    """Cut ears off a polygon, short chords first; return triangles and the vertices left."""
    # Every chord of the vertices left is an edge already.
    polygon = _Polygon(points, rim)
    queue = [(polygon.cost(i), i, polygon.version[i]) for i in range(len(rim))]
    heapq.heapify(queue)
    triangles: list[tuple[int, int, int]] = []
    while queue and polygon.left > 3:
        _, ear, version = heapq.heappop(queue)
        if version != polygon.version[ear]:
            continue
        previous, following = polygon.before[ear], polygon.after[ear]
        chord = tuple(sorted((int(rim[previous]), int(rim[following]))))
        if chord in used_edges:
            continue
        used_edges.add((chord[0], chord[1]))
        triangles.append((int(rim[previous]), int(rim[ear]), int(rim[following])))
        for neighbour in polygon.cut_ear(ear):
            heapq.heappush(queue, (polygon.cost(neighbour), neighbour, polygon.version[neighbour]))
    remaining_vertices = [int(rim[i]) for i in polygon.remaining()]
    if len(remaining_vertices) == 3:
        return [
            *triangles,
            (remaining_vertices[0], remaining_vertices[1], remaining_vertices[2]),
        ], []
    return triangles, remaining_vertices


class _Polygon:
    """A loop of vertices from which ears are cut."""

    def __init__(self, points: Array, rim: Index) -> None:
        count = len(rim)
        self._points = points
        offsets = points - points.mean(axis=0)
        self._normal = np.cross(offsets, np.roll(offsets, -1, axis=0)).sum(axis=0)
        self.before = [(i - 1) % count for i in range(count)]
        self.after = [(i + 1) % count for i in range(count)]
        self.version = [0] * count
        self.left = count

    def cost(self, ear: int) -> float:
        """Return the length of the chord under an ear, m; more where the ear points inward."""
        a, b, c = self._points[[self.before[ear], ear, self.after[ear]]]
        inward = np.cross(b - a, c - a) @ self._normal < 0
        return float(np.linalg.norm(c - a)) * (_REFLEX if inward else 1.0)

    def cut_ear(self, ear: int) -> tuple[int, int]:
        """Take an ear away and return the neighbours that this changes."""
        previous, following = self.before[ear], self.after[ear]
        self.after[previous], self.before[following] = following, previous
        self.version[ear] = -1
        self.version[previous] += 1
        self.version[following] += 1
        self.left -= 1
        return previous, following

    def remaining(self) -> list[int]:
        """Return the corners that have not been cut off, in order round the loop."""
        start = next(i for i, version in enumerate(self.version) if version >= 0)
        corners = [start]
        while (corner := self.after[corners[-1]]) != start:
            corners.append(corner)
        return corners


_PLANE, _ROUND = 0.1, 0.03  # over its size: how far a meant rim leaves a plane, and a circle
_MIN_ROUND_VERTICES, _MAX_CORNERS = 8, 8  # vertices of a circle, corners of a cut-out
_CORNER_ANGLE = np.radians(15.0)
_LARGE_OPENING = 0.1  # of the extent, above which a cut-out needs no vertices along its edges


def is_feature(rim: Array, *, extent: float) -> bool:
    """Return whether an opening, corners `rim` (n, 3), is meant: round, or straight-edged."""
    # Holes of scans are ragged: their rims follow the triangles that are left.
    centred = rim - rim.mean(axis=0)
    _, _, axes = np.linalg.svd(centred, full_matrices=False)
    x, y, heights = (centred @ axes.T).T
    size = float(np.ptp(centred @ axes.T, axis=0).max())
    if np.abs(heights).max() > _PLANE * size:
        return False
    # The circle through points (x, y): x^2 + y^2 = 2 a x + 2 b y + c.
    terms = np.column_stack([2 * x, 2 * y, np.ones_like(x)])
    (a, b, c), *_ = np.linalg.lstsq(terms, x**2 + y**2)
    radius = np.sqrt(max(c + a**2 + b**2, 0.0))
    deviations = np.abs(np.hypot(x - a, y - b) - radius)
    if len(rim) >= _MIN_ROUND_VERTICES and deviations.max() <= _ROUND * 2 * radius:
        return True
    steps = np.roll(centred, -1, axis=0) - centred
    directions = steps / np.linalg.norm(steps, axis=1)[:, None]
    angles = np.arccos(np.clip(np.sum(directions * np.roll(directions, 1, axis=0), axis=1), -1, 1))
    corners = int(np.count_nonzero(angles > _CORNER_ANGLE))
    is_straight = 4 <= corners <= _MAX_CORNERS and np.all(
        angles[angles <= _CORNER_ANGLE] < _CORNER_ANGLE / 3
    )
    return bool(is_straight and (len(rim) >= 2 * corners or size >= _LARGE_OPENING * extent))


# Distances of vertices that may become one, over the extent.
_WELD_DISTANCES = (1e-7, 1e-6, 1e-5, 1e-4)
_MAX_EDGE_FRACTION = 0.1  # of a typical edge, by which vertices may move
_MIN_HEIGHT_RATIO = 1e-12  # height over longest side of a triangle below which it is a line


def count_open_edges(mesh: Mesh) -> int:
    """Return how many edges belong to one face only."""
    return int(np.count_nonzero(edges_of(mesh.faces).faces_at == 1))


def sew(mesh: Mesh) -> tuple[Mesh, float]:
    """Merge near vertices where that closes at least half of the open edges; return how far, m."""
    best_mesh, open_count, used_distance = mesh, count_open_edges(mesh), 0.0
    lengths = np.linalg.norm(
        mesh.points[mesh.faces] - mesh.points[np.roll(mesh.faces, 1, axis=1)], axis=2
    )
    max_distance = _MAX_EDGE_FRACTION * float(np.median(lengths))
    for distance in (fraction * mesh.extent for fraction in _WELD_DISTANCES):
        if not open_count or distance > max_distance:
            break
        trial = _merge_vertices(mesh, distance)
        remaining_count = open_count if trial is None else count_open_edges(trial)
        if trial is not None and remaining_count <= open_count / 2:
            best_mesh, open_count, used_distance = trial, remaining_count, distance
    return best_mesh, used_distance


def _merge_vertices(mesh: Mesh, distance: float) -> Mesh | None:
    """Merge vertices within `distance` of each other and drop faces that this collapses."""
    pairs = KDTree(mesh.points).query_pairs(distance, output_type="ndarray")
    labels = components(pairs.astype(np.int64), len(mesh.points))
    faces = np.unique(labels, return_index=True)[1][labels][mesh.faces]
    is_whole = np.all(faces != np.roll(faces, 1, axis=1), axis=1)
    if not is_whole.any():
        return None
    return submesh(Mesh(points=mesh.points, faces=faces, up=mesh.up), np.flatnonzero(is_whole))


def remove_repeated(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the mesh without repeated faces, and how many went."""
    # One of the faces on the same three vertices stays; or none if they face each other and the
    # surface closes better without, as between two bodies that share a wall.
    first, repeats, net = _group_repeated(mesh.faces)
    if len(first) == len(mesh.faces):
        return mesh, 0
    choices = [first, first[(repeats == 1) | (net != 0)]]
    nonempty_choices = (choice for choice in choices if len(choice))
    selected = min(
        nonempty_choices,
        key=lambda choice: np.count_nonzero(edges_of(mesh.faces[choice]).faces_at != 2),
    )
    return submesh(mesh, np.sort(selected)), len(mesh.faces) - len(selected)


def _group_repeated(faces: Index) -> tuple[Index, Index, Index]:
    """Return the first face on each three vertices, how many there are, and their net turn."""
    sorted_faces = np.sort(faces, axis=1)
    is_even = (
        (faces[:, 0] < faces[:, 1]).astype(int)
        + (faces[:, 1] < faces[:, 2])
        + (faces[:, 2] < faces[:, 0])
    ) == 2
    _, first, group_numbers, repeats = np.unique(
        sorted_faces, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    net = np.bincount(group_numbers.ravel(), weights=np.where(is_even, 1, -1)).astype(np.int64)
    return first, repeats, net


def find_lines(mesh: Mesh) -> Mask:
    """Return which faces are lines up to rounding (F,)."""
    corners = mesh.points[mesh.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return 2 * mesh.areas <= _MIN_HEIGHT_RATIO * longest**2


def remove_lines(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the mesh without faces of no area, and how many went."""
    # The vertex in the middle of such a face splits the neighbour at its longest side instead.
    # Faces must be oriented consistently.
    flat_faces = np.flatnonzero(find_lines(mesh))
    if not len(flat_faces):
        return mesh, 0
    splitter = _Split(mesh)
    for _ in range(len(flat_faces)):
        waiting_faces = [face for face in flat_faces if splitter.remove(int(face))]
        if len(waiting_faces) in {0, len(flat_faces)}:
            break
        flat_faces = np.array(waiting_faces)
    remaining_mesh = submesh(
        Mesh(points=mesh.points, faces=splitter.faces, up=mesh.up),
        np.flatnonzero(splitter.is_remaining),
    )
    return remaining_mesh, int(
        np.count_nonzero(find_lines(mesh)) - np.count_nonzero(find_lines(remaining_mesh))
    )


class _Split:
    """Faces with the face at each directed side, while sides are split one by one."""

    def __init__(self, mesh: Mesh) -> None:
        self._points = mesh.points
        self.faces = mesh.faces.copy()
        self.is_remaining = np.ones(len(self.faces), bool)
        self._at = {
            (int(a), int(b)): number
            for number, (i, j, k) in enumerate(mesh.faces.tolist())
            for a, b in ((i, j), (j, k), (k, i))
        }

    def remove(self, number: int) -> bool:
        """Take out a face without area; return whether it has to wait for others."""
        if not self.is_remaining[number]:
            return False
        a, b, c = self._from_longest(number)
        neighbour = self._at.get((a, c))
        if neighbour is None:
            self._forget(number)
            return False
        d = next((int(v) for v in self.faces[neighbour] if v not in {a, c}), b)
        if d == b:
            self._forget(number)
            self._forget(neighbour)
            return False
        if (b, d) in self._at or (d, b) in self._at:
            return True
        self._forget(number)
        self._forget(neighbour)
        self._store(number, (a, b, d))
        self._store(neighbour, (b, c, d))
        return False

    def _from_longest(self, number: int) -> tuple[int, int, int]:
        """Return the corners a, b, c of a face, c to a being its longest side."""
        face = self.faces[number]
        sides = np.linalg.norm(self._points[np.roll(face, -1)] - self._points[face], axis=1)
        a, b, c = np.roll(face, -1 - int(sides.argmax())).tolist()
        return a, b, c

    def _forget(self, number: int) -> None:
        i, j, k = self.faces[number].tolist()
        for side in ((i, j), (j, k), (k, i)):
            if self._at.get(side) == number:
                del self._at[side]
        self.is_remaining[number] = False

    def _store(self, number: int, corners: tuple[int, int, int]) -> None:
        i, j, k = corners
        self.faces[number] = corners
        self._at |= {(i, j): number, (j, k): number, (k, i): number}
        self.is_remaining[number] = True

"""Openings of a surface: the loops of its open edges, and faces that close them."""

from __future__ import annotations

import heapq
from collections import defaultdict
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.model.mesh import Mesh
from struck.model.mesh_topology import edges_of

Array = NDArray[np.float64]
Index = NDArray[np.int64]
_REFLEX = 1e3  # such ears come last


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Closed:
    """A surface with its openings filled.

    Parameters
    ----------
    mesh : Mesh
        The old faces, then the new ones.
    rims : tuple of arrays
        Vertices around each opening.
    """

    mesh: Mesh
    rims: tuple[Index, ...]


def closed(mesh: Mesh) -> Closed:
    """Fill all openings of a surface whose faces are oriented alike.

    Each loop of open edges is filled from its shortest chords on (ears cut off a polygon). No
    new edge runs where the surface has one already.
    """
    rims = loops(mesh.faces)
    if not rims:
        return Closed(mesh=mesh, rims=())
    ends = edges_of(mesh.faces).ends
    taken = {(a, b) for a, b in ends[np.isin(ends, np.concatenate(rims)).all(axis=1)].tolist()}
    points, fresh = [mesh.points], []
    count = len(mesh.points)
    for rim in rims:
        triangles, left = _ears(mesh.points[rim], rim, taken)
        fresh += triangles
        if len(left) > 2:
            fresh += [(left[i - 1], left[i], count) for i in range(len(left))]
            points.append(mesh.points[left].mean(axis=0, keepdims=True))
            count += 1
    faces = np.concatenate([mesh.faces, np.array(fresh, dtype=np.int64)])
    whole = Mesh(points=np.concatenate(points), faces=faces, up=mesh.up)
    return Closed(mesh=whole, rims=tuple(rims))


def loops(faces: Index) -> list[Index]:
    """Return the simple loops of the boundary, each the way round that faces to fill it take.

    The boundary of a surface is a sum of loops, whatever the surface: through an edge run as
    many as it has faces more in one direction than in the other.
    """
    edges = edges_of(faces)
    onward: dict[int, list[int]] = defaultdict(list)
    unbalanced = np.flatnonzero(edges.balance)
    for (low, high), balance in zip(
        edges.ends[unbalanced].tolist(), edges.balance[unbalanced].tolist(), strict=True
    ):
        start, end = (high, low) if balance > 0 else (low, high)
        onward[start] += [end] * abs(balance)
    found: list[Index] = []
    for start in list(onward):
        while onward[start]:
            found += _walked(start, onward)
    return found


def _walked(start: int, onward: dict[int, list[int]]) -> list[Index]:
    """Walk until the way is back at its start, cutting a loop off wherever it meets itself."""
    found = []
    path, place = [start], {start: 0}
    while onward[path[-1]]:
        reached = onward[path[-1]].pop()
        if reached not in place:
            place[reached] = len(path)
            path.append(reached)
            continue
        loop = path[place[reached] :]
        found.append(np.array(loop, dtype=np.int64))
        for vertex in loop[1:]:
            del place[vertex]
        del path[place[reached] + 1 :]
    return found


def _ears(
    points: Array, rim: Index, taken: set[tuple[int, int]]
) -> tuple[list[tuple[int, int, int]], list[int]]:
    """Cut ears off a polygon, short chords first.

    Returns the triangles and the vertices of what is left, where every chord is an edge already.
    """
    polygon = _Polygon(points, rim)
    queue = [(polygon.cost(i), i, polygon.version[i]) for i in range(len(rim))]
    heapq.heapify(queue)
    triangles: list[tuple[int, int, int]] = []
    while queue and polygon.left > 3:
        _, ear, version = heapq.heappop(queue)
        if version != polygon.version[ear]:
            continue
        before, after = polygon.before[ear], polygon.after[ear]
        chord = tuple(sorted((int(rim[before]), int(rim[after]))))
        if chord in taken:
            continue
        taken.add((chord[0], chord[1]))
        triangles.append((int(rim[before]), int(rim[ear]), int(rim[after])))
        for changed in polygon.cut(ear):
            heapq.heappush(queue, (polygon.cost(changed), changed, polygon.version[changed]))
    rest = [int(rim[i]) for i in polygon.remaining()]
    if len(rest) == 3:
        return [*triangles, (rest[0], rest[1], rest[2])], []
    return triangles, rest


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

    def cut(self, ear: int) -> tuple[int, int]:
        """Take an ear away and return the neighbours that this changes."""
        before, after = self.before[ear], self.after[ear]
        self.after[before], self.before[after] = after, before
        self.version[ear] = -1
        self.version[before] += 1
        self.version[after] += 1
        self.left -= 1
        return before, after

    def remaining(self) -> list[int]:
        """Return what has not been cut off, in order round the loop."""
        start = next(i for i, version in enumerate(self.version) if version >= 0)
        around = [start]
        while (onward := self.after[around[-1]]) != start:
            around.append(onward)
        return around

"""Remeshing: triangles of about the same size on a given surface, for boundary elements.

Long edges are halved, short ones collapsed into one of their ends, the shortest first (Botsch et
al. 2010, chapter 6). Every vertex stays on the surface, ridges and corners where they are, and no
face turns from the surface's normals by much.
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Iterator

import numpy as np

from struck.model.arrays import Array, Index
from struck.model.mesh import Mesh
from struck.model.mesh_topology import edges_of, submesh

_SHORT, _LONG = 0.8, 4 / 3  # of the wanted edge: shorter ones go, longer ones are halved
_LONGEST = 1.6  # that a collapse may make
_SHARP = np.cos(np.radians(40))  # faces that turn further about their edge meet in a ridge
_TURNED = np.cos(np.radians(20))  # a face against the surface's normals at its smooth corners
_KINKED = np.cos(np.radians(25))  # the new part of a ridge against the old
_ROUND = 0.35  # shape of a triangle, 1 for an equilateral one, that a collapse may leave


def remeshed(mesh: Mesh, edge: float, wall: float) -> Mesh:
    """Return a closed surface again, with edges of about `edge` m where its form allows.

    Faces lie a quarter of the `wall` below the surface at most. It encloses the same volume: flat
    triangles inscribed in a round body would make it smaller.
    """
    made = _Collapsing(_halved(mesh, _LONG * edge), edge, wall).result()
    lift = (mesh.volume - made.volume) / made.areas.sum()
    return Mesh(points=made.points + lift * made.vertex_normals, faces=made.faces, up=mesh.up)


def _lengths(mesh: Mesh) -> tuple[Array, Index, Index]:
    """Return the lengths (E,) of edges, their ends (E, 2), and the edges of the sides (F, 3)."""
    edges = edges_of(mesh.faces)
    ways = mesh.points[edges.ends[:, 1]] - mesh.points[edges.ends[:, 0]]
    return np.linalg.norm(ways, axis=1), edges.ends, edges.owner.reshape(-1, 3)


def _halved(mesh: Mesh, longest: float) -> Mesh:
    """Return the surface with no edge longer than `longest`: the longest of both its faces goes."""
    while True:
        lengths, ends, sides = _lengths(mesh)
        order = np.empty(len(lengths), np.int64)
        order[np.argsort(lengths, kind="stable")] = np.arange(len(lengths))
        side = np.argmax(order[sides], axis=1)
        own = sides[np.arange(len(sides)), side]
        split = (np.bincount(own, minlength=len(lengths)) == 2) & (lengths > longest)
        if not split.any():
            return mesh
        middles = len(mesh.points) + np.cumsum(split) - 1
        cut = split[own]
        turned = (side[cut, None] + np.arange(3)) % 3
        first, second, third = np.take_along_axis(mesh.faces[cut], turned, axis=1).T
        middle = middles[own[cut]]
        halves = [np.stack([first, middle, third], 1), np.stack([middle, second, third], 1)]
        points = np.concatenate([mesh.points, mesh.points[ends[split]].mean(axis=1)])
        mesh = Mesh(points=points, faces=np.concatenate([mesh.faces[~cut], *halves]), up=mesh.up)


class _Collapsing:
    """A surface whose short edges are collapsed one after the other."""

    def __init__(self, mesh: Mesh, edge: float, wall: float) -> None:
        self._mesh, self._edge, self._wall = mesh, edge, wall
        self._points, self._normals = mesh.points, mesh.vertex_normals
        self._faces = mesh.faces.tolist()
        self._around: list[set[int]] = [set() for _ in mesh.points]
        for number, face in enumerate(self._faces):
            for vertex in face:
                self._around[vertex].add(number)
        self._ridges: dict[int, set[int]] = defaultdict(set)
        self._mark_ridges()

    def _mark_ridges(self) -> None:
        edges = edges_of(self._mesh.faces)
        pairs, _ = edges.pairs()
        normals = self._mesh.face_normals[pairs]
        sharp = np.einsum("ed,ed->e", normals[:, 0], normals[:, 1]) < _SHARP
        for one, other in edges.ends[edges.shared][sharp].tolist():
            self._ridges[one].add(other)
            self._ridges[other].add(one)
        self._smooth = np.ones(len(self._points), bool)
        self._smooth[list(self._ridges)] = False
        self._fixed = {vertex for vertex, others in self._ridges.items() if len(others) != 2}

    def result(self) -> Mesh:
        """Return the surface once no short edge can go."""
        lengths, ends, _ = _lengths(self._mesh)
        heap = [
            (length, *pair) for length, pair in zip(lengths.tolist(), ends.tolist(), strict=True)
        ]
        heap = [entry for entry in heap if entry[0] < _SHORT * self._edge]
        heapq.heapify(heap)
        while heap:
            _, one, other = heapq.heappop(heap)
            if not self._joined(one, other):
                continue
            for gone, kept in ((one, other), (other, one)):
                if self._may_go(gone, kept):
                    for entry in self._collapsed(gone, kept):
                        heapq.heappush(heap, entry)
                    break
        alive = sorted(set().union(*self._around))
        faces = np.array([self._faces[number] for number in alive])
        whole = Mesh(points=self._points, faces=faces, up=self._mesh.up)
        return submesh(whole, np.arange(len(faces)))

    def _joined(self, one: int, other: int) -> bool:
        return not self._around[one].isdisjoint(self._around[other])

    def _neighbours(self, vertex: int) -> set[int]:
        return {each for number in self._around[vertex] for each in self._faces[number]} - {vertex}

    def _may_go(self, gone: int, kept: int) -> bool:
        """Return whether a vertex may be moved into another: topology, ridges, form and size."""
        if gone in self._fixed or len(self._around[gone] & self._around[kept]) != 2:
            return False
        if len(self._neighbours(gone) & self._neighbours(kept)) != 2:
            return False
        if not self._smooth[gone] and not self._keeps_ridge(gone, kept):
            return False
        moved = [self._faces[number] for number in self._around[gone] - self._around[kept]]
        before = self._points[moved]
        after = self._points[[[kept if each == gone else each for each in face] for face in moved]]
        return self._keeps_form(np.array(moved), before, after)

    def _keeps_ridge(self, gone: int, kept: int) -> bool:
        if kept not in self._ridges[gone]:
            return False
        (other,) = self._ridges[gone] - {kept}
        if other in self._ridges[kept]:
            return False
        way = self._points[kept] - self._points[other]
        parts = (self._points[gone] - self._points[other], self._points[kept] - self._points[gone])
        size = np.linalg.norm(way)
        return all(part @ way >= _KINKED * np.linalg.norm(part) * size for part in parts)

    def _keeps_form(self, moved: Index, before: Array, after: Array) -> bool:
        old, new = (np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]) for c in (before, after))
        areas, earlier = np.linalg.norm(new, axis=1), np.linalg.norm(old, axis=1)
        squares = np.square(after - np.roll(after, 1, axis=1)).sum(axis=2)
        worst = np.square(before - np.roll(before, 1, axis=1)).sum(axis=(1, 2))
        shape = (earlier / worst).min() * 2 * 3**0.5
        if (2 * 3**0.5 * areas < min(_ROUND, shape) * squares.sum(axis=1)).any():
            return False
        if squares.max() > (_LONGEST * self._edge) ** 2 or not areas.all():
            return False
        normals = new / areas[:, None]
        if (np.einsum("fd,fd->f", normals, old) < _SHARP * earlier).any():
            return False
        # The corner that goes counts too: it was there where the new face is.
        smooth, corners = self._smooth[moved], self._normals[moved]
        turned = np.einsum("fd,fcd->fc", normals, corners)[smooth]
        # An arc of width w, whose ends turn by an angle a, is w a / 4 high, and its chord seen
        # along the normal at its end w a.
        heights = np.ptp(np.einsum("fkd,fcd->fck", after, corners), axis=2)[smooth]
        return bool((turned >= _TURNED).all() and (heights <= self._wall).all())

    def _collapsed(self, gone: int, kept: int) -> Iterator[tuple[float, int, int]]:
        """Move a vertex into another; yield the short edges that the other then has."""
        for number in self._around[gone] & self._around[kept]:
            for each in self._faces[number]:
                self._around[each].discard(number)
        for number in self._around[gone]:
            self._faces[number] = [kept if each == gone else each for each in self._faces[number]]
        self._around[kept] |= self._around[gone]
        self._around[gone] = set()
        if not self._smooth[gone]:
            (other,) = self._ridges.pop(gone) - {kept}
            self._ridges[kept] = self._ridges[kept] - {gone} | {other}
            self._ridges[other] = self._ridges[other] - {gone} | {kept}
        for other in self._neighbours(kept):
            length = float(np.linalg.norm(self._points[other] - self._points[kept]))
            if length < _SHORT * self._edge:
                yield length, min(kept, other), max(kept, other)

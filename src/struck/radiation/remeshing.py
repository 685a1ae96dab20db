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

# Lengths over the target edge: shorter edges are collapsed, longer ones halved.
_MIN_LENGTH, _MAX_LENGTH = 0.8, 4 / 3
_MAX_COLLAPSED_LENGTH = 1.6  # that a collapse may make
_RIDGE_COSINE = np.cos(np.radians(40))  # faces that turn further about their edge meet in a ridge
# Between a face and the surface's normals at its smooth corners.
_MIN_NORMAL_COSINE = np.cos(np.radians(20))
_MIN_RIDGE_COSINE = np.cos(np.radians(25))  # the new part of a ridge against the old
_MIN_SHAPE = 0.35  # shape of a triangle, 1 for an equilateral one, that a collapse may leave


def remesh(mesh: Mesh, edge: float, wall: float) -> Mesh:
    """Return a closed surface again, with edges of about `edge` m where its form allows.

    Faces lie a quarter of the `wall` below the surface at most. It encloses the same volume: flat
    triangles inscribed in a round body would make it smaller.
    """
    new_mesh = _Collapsing(_halve_long_edges(mesh, _MAX_LENGTH * edge), edge, wall).result()
    distance = (mesh.volume - new_mesh.volume) / new_mesh.areas.sum()
    return Mesh(
        points=new_mesh.points + distance * new_mesh.vertex_normals,
        faces=new_mesh.faces,
        up=mesh.up,
    )


def _lengths(mesh: Mesh) -> tuple[Array, Index, Index]:
    """Return the lengths (E,) of edges, their ends (E, 2), and the edges of the sides (F, 3)."""
    edges = edges_of(mesh.faces)
    edge_vectors = mesh.points[edges.ends[:, 1]] - mesh.points[edges.ends[:, 0]]
    return np.linalg.norm(edge_vectors, axis=1), edges.ends, edges.owner.reshape(-1, 3)


def _halve_long_edges(mesh: Mesh, longest: float) -> Mesh:
    """Return the surface with no edge longer than `longest`: the longest of both its faces goes."""
    while True:
        lengths, ends, sides = _lengths(mesh)
        order = np.empty(len(lengths), np.int64)
        order[np.argsort(lengths, kind="stable")] = np.arange(len(lengths))
        side = np.argmax(order[sides], axis=1)
        longest_edges = sides[np.arange(len(sides)), side]
        is_split = (np.bincount(longest_edges, minlength=len(lengths)) == 2) & (lengths > longest)
        if not is_split.any():
            return mesh
        new_vertices = len(mesh.points) + np.cumsum(is_split) - 1
        is_cut = is_split[longest_edges]
        corner_order = (side[is_cut, None] + np.arange(3)) % 3
        first, second, third = np.take_along_axis(mesh.faces[is_cut], corner_order, axis=1).T
        midpoints = new_vertices[longest_edges[is_cut]]
        halves = [np.stack([first, midpoints, third], 1), np.stack([midpoints, second, third], 1)]
        points = np.concatenate([mesh.points, mesh.points[ends[is_split]].mean(axis=1)])
        mesh = Mesh(points=points, faces=np.concatenate([mesh.faces[~is_cut], *halves]), up=mesh.up)


class _Collapsing:
    """A surface whose short edges are collapsed one after the other."""

    def __init__(self, mesh: Mesh, edge: float, wall: float) -> None:
        self._mesh, self._edge, self._wall = mesh, edge, wall
        self._points, self._normals = mesh.points, mesh.vertex_normals
        self._faces = mesh.faces.tolist()
        self._faces_at: list[set[int]] = [set() for _ in mesh.points]
        for number, face in enumerate(self._faces):
            for vertex in face:
                self._faces_at[vertex].add(number)
        self._ridges: dict[int, set[int]] = defaultdict(set)
        self._mark_ridges()

    def _mark_ridges(self) -> None:
        edges = edges_of(self._mesh.faces)
        pairs, _ = edges.pairs()
        normals = self._mesh.face_normals[pairs]
        sharp = np.einsum("ed,ed->e", normals[:, 0], normals[:, 1]) < _RIDGE_COSINE
        for start, end in edges.ends[edges.shared][sharp].tolist():
            self._ridges[start].add(end)
            self._ridges[end].add(start)
        self._is_smooth = np.ones(len(self._points), bool)
        self._is_smooth[list(self._ridges)] = False
        self._corners = {vertex for vertex, others in self._ridges.items() if len(others) != 2}

    def result(self) -> Mesh:
        """Return the surface once no short edge can go."""
        lengths, ends, _ = _lengths(self._mesh)
        heap = [
            (length, *pair) for length, pair in zip(lengths.tolist(), ends.tolist(), strict=True)
        ]
        heap = [entry for entry in heap if entry[0] < _MIN_LENGTH * self._edge]
        heapq.heapify(heap)
        while heap:
            _, start, end = heapq.heappop(heap)
            if not self._are_joined(start, end):
                continue
            for vertex, target in ((start, end), (end, start)):
                if self._may_go(vertex, target):
                    for entry in self._collapse(vertex, target):
                        heapq.heappush(heap, entry)
                    break
        face_numbers = sorted(set().union(*self._faces_at))
        faces = np.array([self._faces[number] for number in face_numbers])
        surface = Mesh(points=self._points, faces=faces, up=self._mesh.up)
        return submesh(surface, np.arange(len(faces)))

    def _are_joined(self, start: int, end: int) -> bool:
        return not self._faces_at[start].isdisjoint(self._faces_at[end])

    def _neighbours(self, vertex: int) -> set[int]:
        return {corner for number in self._faces_at[vertex] for corner in self._faces[number]} - {
            vertex
        }

    def _may_go(self, vertex: int, target: int) -> bool:
        """Return whether a vertex may be moved into another: topology, ridges, form and size."""
        if vertex in self._corners or len(self._faces_at[vertex] & self._faces_at[target]) != 2:
            return False
        if len(self._neighbours(vertex) & self._neighbours(target)) != 2:
            return False
        if not self._is_smooth[vertex] and not self._keeps_ridge(vertex, target):
            return False
        moved_faces = [
            self._faces[number] for number in self._faces_at[vertex] - self._faces_at[target]
        ]
        old_corners = self._points[moved_faces]
        new_corners = self._points[
            [[target if corner == vertex else corner for corner in face] for face in moved_faces]
        ]
        return self._keeps_form(np.array(moved_faces), old_corners, new_corners)

    def _keeps_ridge(self, vertex: int, target: int) -> bool:
        if target not in self._ridges[vertex]:
            return False
        (neighbour,) = self._ridges[vertex] - {target}
        if neighbour in self._ridges[target]:
            return False
        chord = self._points[target] - self._points[neighbour]
        parts = (
            self._points[vertex] - self._points[neighbour],
            self._points[target] - self._points[vertex],
        )
        size = np.linalg.norm(chord)
        return all(
            part @ chord >= _MIN_RIDGE_COSINE * np.linalg.norm(part) * size for part in parts
        )

    def _keeps_form(self, faces: Index, old_corners: Array, new_corners: Array) -> bool:
        old, new = (
            np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]) for c in (old_corners, new_corners)
        )
        areas, old_areas = np.linalg.norm(new, axis=1), np.linalg.norm(old, axis=1)
        squares = np.square(new_corners - np.roll(new_corners, 1, axis=1)).sum(axis=2)
        old_squares = np.square(old_corners - np.roll(old_corners, 1, axis=1)).sum(axis=(1, 2))
        shape = (old_areas / old_squares).min() * 2 * 3**0.5
        if (2 * 3**0.5 * areas < min(_MIN_SHAPE, shape) * squares.sum(axis=1)).any():
            return False
        if squares.max() > (_MAX_COLLAPSED_LENGTH * self._edge) ** 2 or not areas.all():
            return False
        normals = new / areas[:, None]
        if (np.einsum("fd,fd->f", normals, old) < _RIDGE_COSINE * old_areas).any():
            return False
        # The corner that goes counts too: it was there where the new face is.
        is_smooth, corners = self._is_smooth[faces], self._normals[faces]
        cosines = np.einsum("fd,fcd->fc", normals, corners)[is_smooth]
        # An arc of width w, whose ends turn by an angle a, is w a / 4 high, and its chord seen
        # along the normal at its end w a.
        heights = np.ptp(np.einsum("fkd,fcd->fck", new_corners, corners), axis=2)[is_smooth]
        return bool((cosines >= _MIN_NORMAL_COSINE).all() and (heights <= self._wall).all())

    def _collapse(self, vertex: int, target: int) -> Iterator[tuple[float, int, int]]:
        """Move a vertex into another; yield the short edges that the other then has."""
        for number in self._faces_at[vertex] & self._faces_at[target]:
            for corner in self._faces[number]:
                self._faces_at[corner].discard(number)
        for number in self._faces_at[vertex]:
            self._faces[number] = [
                target if corner == vertex else corner for corner in self._faces[number]
            ]
        self._faces_at[target] |= self._faces_at[vertex]
        self._faces_at[vertex] = set()
        if not self._is_smooth[vertex]:
            (neighbour,) = self._ridges.pop(vertex) - {target}
            self._ridges[target] = self._ridges[target] - {vertex} | {neighbour}
            self._ridges[neighbour] = self._ridges[neighbour] - {vertex} | {target}
        for neighbour in self._neighbours(target):
            length = float(np.linalg.norm(self._points[neighbour] - self._points[target]))
            if length < _MIN_LENGTH * self._edge:
                yield length, min(target, neighbour), max(target, neighbour)

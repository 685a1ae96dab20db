"""Faces sewn together: near-coincident vertices, repeated faces, faces without area."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from struck.model.mesh import Mesh
from struck.model.mesh_topology import components, edges_of, submesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
# Distances within which vertices may become one, over the extent: from single precision upwards.
_SHARES = (1e-7, 1e-6, 1e-5, 1e-4)
# Vertices may move by this share of a typical edge and no more.
_SHARE_OF_EDGE = 0.1
# Below this height over its longest side a triangle is a line but for rounding.
_THINNEST_FACE = 1e-12


def open_edges(mesh: Mesh) -> int:
    """Return how many edges belong to one face only."""
    return int(np.count_nonzero(edges_of(mesh.faces).faces_at == 1))


def sewn(mesh: Mesh) -> tuple[Mesh, float]:
    """Merge near vertices where that closes at least half of the open edges.

    Returns
    -------
    Mesh
        The same mesh where nothing was gained.
    float
        The distance within which vertices were merged, m; 0 where none were.
    """
    best, left, used = mesh, open_edges(mesh), 0.0
    lengths = np.linalg.norm(
        mesh.points[mesh.faces] - mesh.points[np.roll(mesh.faces, 1, axis=1)], axis=2
    )
    furthest = _SHARE_OF_EDGE * float(np.median(lengths))
    for distance in (share * mesh.extent for share in _SHARES):
        if not left or distance > furthest:
            break
        trial = _merged(mesh, distance)
        remain = left if trial is None else open_edges(trial)
        if trial is not None and remain <= left / 2:
            best, left, used = trial, remain, distance
    return best, used


def _merged(mesh: Mesh, distance: float) -> Mesh | None:
    """Merge vertices within `distance` of each other and drop faces that this collapses."""
    pairs = KDTree(mesh.points).query_pairs(distance, output_type="ndarray")
    labels = components(pairs.astype(np.int64), len(mesh.points))
    first = np.unique(labels, return_index=True)[1]
    faces = first[labels][mesh.faces]
    whole = np.all(faces != np.roll(faces, 1, axis=1), axis=1)
    if not whole.any():
        return None
    return submesh(Mesh(points=mesh.points, faces=faces, up=mesh.up), np.flatnonzero(whole))


def single(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the mesh without repeated faces, and how many went.

    Of faces on the same three vertices one stays: or none where they face each other and the
    surface closes better without, as between two bodies that share a wall.
    """
    first, repeats, net = _repeats(mesh.faces)
    if len(first) == len(mesh.faces):
        return mesh, 0
    choices = [first, first[(repeats == 1) | (net != 0)]]
    kept = min((each for each in choices if len(each)), key=lambda each: _bad(mesh.faces[each]))
    return submesh(mesh, np.sort(kept)), len(mesh.faces) - len(kept)


def _repeats(faces: Index) -> tuple[Index, Index, Index]:
    """Return the first face on each three vertices, how many there are, and their net turn."""
    ordered = np.sort(faces, axis=1)
    even = (
        (faces[:, 0] < faces[:, 1]).astype(int)
        + (faces[:, 1] < faces[:, 2])
        + (faces[:, 2] < faces[:, 0])
    ) == 2
    _, first, inverse, repeats = np.unique(
        ordered, axis=0, return_index=True, return_inverse=True, return_counts=True
    )
    net = np.bincount(inverse.ravel(), weights=np.where(even, 1, -1)).astype(np.int64)
    return first, repeats, net


def _bad(faces: Index) -> int:
    return int(np.count_nonzero(edges_of(faces).faces_at != 2))


def lines(mesh: Mesh) -> Flags:
    """Tell which faces are lines but for rounding (F,)."""
    corners = mesh.points[mesh.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    return 2 * mesh.areas <= _THINNEST_FACE * longest**2


def without_lines(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the mesh without faces of no area, and how many went.

    The vertex in the middle of such a face splits the neighbour at its longest side instead.
    Faces must be oriented alike.
    """
    flat = np.flatnonzero(lines(mesh))
    if not len(flat):
        return mesh, 0
    split = _Split(mesh)
    for _ in range(len(flat)):
        still = [face for face in flat if split.remove(int(face))]
        if len(still) in {0, len(flat)}:
            break
        flat = np.array(still)
    kept = submesh(
        Mesh(points=mesh.points, faces=split.faces, up=mesh.up), np.flatnonzero(split.kept)
    )
    left = np.count_nonzero(lines(kept))
    return kept, int(np.count_nonzero(lines(mesh)) - left)


class _Split:
    """Faces with the face at each directed side, while sides are split one by one."""

    def __init__(self, mesh: Mesh) -> None:
        self._points = mesh.points
        self.faces = mesh.faces.copy()
        self.kept = np.ones(len(self.faces), bool)
        self._at = {
            (int(a), int(b)): number
            for number, (i, j, k) in enumerate(mesh.faces.tolist())
            for a, b in ((i, j), (j, k), (k, i))
        }

    def remove(self, number: int) -> bool:
        """Take a face of no area out; tell whether it has to wait for others."""
        if not self.kept[number]:
            return False
        a, b, c = self._from_longest(number)
        other = self._at.get((a, c))
        if other is None:
            self._forget(number)
            return False
        d = next((int(v) for v in self.faces[other] if v not in {a, c}), b)
        if d == b:
            self._forget(number)
            self._forget(other)
            return False
        if (b, d) in self._at or (d, b) in self._at:
            return True
        self._forget(number)
        self._forget(other)
        self._put(number, (a, b, d))
        self._put(other, (b, c, d))
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
        self.kept[number] = False

    def _put(self, number: int, corners: tuple[int, int, int]) -> None:
        i, j, k = corners
        self.faces[number] = corners
        self._at |= {(i, j): number, (j, k): number, (k, i): number}
        self.kept[number] = True

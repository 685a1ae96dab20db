"""Closed pieces of a surface: which way they face, which bound material, which are one body.

The winding number of all pieces together tells material from air: it is above one half inside.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError
from struck.model.mesh import Mesh
from struck.model.mesh_topology import (
    components,
    edges_of,
    nesting,
    pieces,
    submesh,
    turned_faces,
    volumes_of,
)

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Flags = NDArray[np.bool_]
# Boxes of other faces that the box of a face may overlap: of sound surfaces it is a dozen or two,
# and small ones may be as bad as they like.
_MOST_MET, _MOST_PAIRS = 100, 20_000_000
_SAMPLE_COST = 500_000


def apart(mesh: Mesh) -> Mesh:
    """Return the mesh with pieces that share a vertex given one each.

    So edges where several pieces meet belong to two faces of each, or are open.
    """
    labels = np.repeat(pieces(mesh), 3)
    keys = labels * len(mesh.points) + mesh.faces.ravel()
    used, renumbered = np.unique(keys, return_inverse=True)
    return Mesh(
        points=mesh.points[used % len(mesh.points)], faces=renumbered.reshape(-1, 3), up=mesh.up
    )


def without_fins(mesh: Mesh) -> tuple[Mesh, int]:
    """Return the mesh without pieces that only lean on others, and how many faces went.

    Fins and inner walls meet closed pieces in edges of three faces; without them, smallest
    first, these edges belong to two.
    """
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


def alike(mesh: Mesh) -> tuple[Mesh, int] | None:
    """Return the mesh with the faces of each piece turned alike, and how many were turned.

    None on a one-sided surface.
    """
    turned = turned_faces(edges_of(mesh.faces), len(mesh.faces))
    return None if turned is None else (flipped(mesh, turned), int(np.count_nonzero(turned)))


def flipped(mesh: Mesh, chosen: Flags) -> Mesh:
    """Return the mesh with the `chosen` faces turned over."""
    if not chosen.any():
        return mesh
    faces = np.where(chosen[:, None], mesh.faces[:, [0, 2, 1]], mesh.faces)
    return Mesh(points=mesh.points, faces=faces, up=mesh.up)


def crossings(mesh: Mesh) -> Index:
    """Return the pairs of faces that cross or touch without sharing a vertex or edge (K, 2).

    Raises
    ------
    MeshError
        When so many faces lie across each other that no one could wait for it.
    """
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
    """Return a power of two that brings a mesh to an extent near 1, without any rounding.

    Products of six lengths of very large or small bodies leave the range of floating point.
    """
    return float(2.0 ** -np.round(np.log2(mesh.extent)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shells:
    """A surface of closed pieces.

    Parameters
    ----------
    mesh : Mesh
    labels : array (F,)
        The piece of each face.
    volumes : array (P,)
        What each piece encloses, negative where its normals point inward, m^3.
    inner, around : arrays (N,)
        Pairs of pieces, the first inside the second.
    """

    mesh: Mesh
    labels: Index
    volumes: Array
    inner: Index
    around: Index

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

    def bounding(self) -> Flags:
        """Tell which pieces part material from air, where none cross (P,)."""
        winding = np.bincount(
            self.inner, weights=np.sign(self.volumes)[self.around], minlength=len(self.volumes)
        )
        return np.where(self.volumes > 0, winding == 0, winding == 1)

    def bodies(self, pairs: Index) -> Index:
        """Return the body that each piece belongs to (P,): with its cavities and what it crosses.

        Parameters
        ----------
        pairs : array (K, 2)
            Faces that cross.
        """
        crossing = self.labels[pairs]
        cavity = self.volumes[self.inner] < 0
        depth = self.depths[self.around]
        deepest = depth == self.depths[self.inner] - 1
        hold = np.stack([self.inner, self.around], axis=1)[cavity & deepest]
        return components(np.concatenate([crossing, hold]), len(self.volumes))

    def only(self, chosen: Flags) -> Shells:
        """Keep the `chosen` pieces (P,)."""
        if chosen.all():
            return self
        return Shells.of(submesh(self.mesh, np.flatnonzero(chosen[self.labels])))

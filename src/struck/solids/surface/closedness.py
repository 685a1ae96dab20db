"""Closed surfaces: which ones enclose a solid body, and what is wrong with the others.

A surface bounds a solid when every edge belongs to exactly two faces that run along it in
opposite directions, and the normals point out of the material. Its edge-connected pieces then nest
like shells: those at even depth bound a body from outside, those at odd depth are cavities.
"""

from __future__ import annotations

import numpy as np

from struck.errors import MeshError
from struck.model.arrays import Array, Index
from struck.model.mesh import Mesh
from struck.model.mesh_topology import (
    Edges,
    boxes_of,
    components,
    edges_of,
    nesting,
    pieces,
    turned_faces,
    volumes_of,
)

# Mesh files in single precision carry 1e-7 of their size as rounding: thinner is no body.
THINNEST = 1e-6
ONE_SIDED = (
    "the mesh cannot be oriented (it is one-sided, like a Klein bottle) and so has no inside: "
    "rebuild it as the boundary of a solid"
)


def is_closed(mesh: Mesh) -> bool:
    """Return whether each edge is shared by exactly two faces in opposite directions."""
    edges = edges_of(mesh.faces)
    return bool(edges.shared.all() and not edges.balance.any())


def require_closed(mesh: Mesh) -> None:
    """Raise MeshError, which counts what is wrong, unless a surface encloses one solid body."""
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
    if thickness <= THINNEST * mesh.extent:
        raise MeshError(
            f"the mesh is flat: its {len(corners)} vertices lie in one plane; give the body a "
            "thickness before export"
        )


def _require_two_faces_an_edge(edges: Edges) -> None:
    lonely, crowded = edges.faces_at == 1, np.count_nonzero(edges.faces_at > 2)
    found = []
    if lonely.any():
        holes = counted(_loops(edges.ends[lonely]), "hole")
        found.append(f"{counted(np.count_nonzero(lonely), 'open edge')} in {holes}")
    if crowded:
        found.append(f"{counted(crowded, 'edge')} shared by more than two faces")
    if found:
        raise MeshError(
            f"the mesh is not closed: {' and '.join(found)}; close holes and remove inner or "
            "doubled faces in a mesh editor, or leave repair on"
        )


def _require_orientation(edges: Edges, face_count: int) -> None:
    turned = turned_faces(edges, face_count)
    if turned is None:
        raise MeshError(ONE_SIDED)
    flipped = int(np.count_nonzero(turned))
    if flipped:
        raise MeshError(
            f"the mesh has {counted(flipped, 'face')} with flipped orientation of "
            f"{face_count}: make the normals consistent in a mesh editor, or "
            "leave repair on"
        )


def _require_volume(mesh: Mesh, labels: Index) -> Array:
    volumes = volumes_of(mesh, labels)
    areas = np.bincount(labels, weights=mesh.areas)
    empty = np.abs(volumes) <= THINNEST * areas * boxes_of(mesh, labels).extents
    if empty.any():
        raise MeshError(
            f"the mesh encloses no volume in {np.count_nonzero(empty)} of its "
            f"{counted(len(volumes), 'piece')}: give sheets a thickness, or remove them"
        )
    return volumes


def _require_one_body(depths: Index, volumes: Array) -> None:
    outer = depths % 2 == 0
    if np.count_nonzero(outer) > 1:
        raise MeshError(
            f"the mesh holds {np.count_nonzero(outer)} separate bodies: give one at a time, or "
            "join them into one surface, or leave repair on for the largest"
        )
    if np.any(volumes[outer] < 0):
        raise MeshError(
            f"the mesh is inside out (its volume is {volumes.sum():.3g} m^3): flip all faces so "
            "that the normals point outward, or leave repair on"
        )
    solid = np.count_nonzero(volumes[~outer] > 0)
    if solid:
        raise MeshError(
            f"{counted(solid, 'inner shell')} of the mesh with normals outward would be a body "
            "within the body: flip the faces to make a cavity, remove them, or leave repair on"
        )


def _loops(ends: Index) -> int:
    vertices, local = np.unique(ends, return_inverse=True)
    return int(components(local.reshape(-1, 2), len(vertices)).max() + 1)


def counted(count: int | np.integer, noun: str) -> str:
    """Return a count with its noun: "1 face", "2 faces", "3 vertices"."""
    if count == 1:
        return f"1 {noun}"
    plural = {"vertex": "vertices", "body": "bodies", "patch": "patches"}
    last = noun.rsplit(maxsplit=1)[-1]
    return f"{count} {noun.removesuffix(last)}{plural.get(last, last + 's')}"

"""Volume meshes of other programs: vtk, vtu, msh and inp to nodes and elements in metres."""

from __future__ import annotations

import os
from collections import Counter
from pathlib import Path

import numpy as np

from struck.errors import MeshError, OptionError
from struck.files.guard import read_volume
from struck.files.mesh_formats import READERS, ElementBlocks
from struck.files.surfaces import UNITS
from struck.model.arrays import Array, Index
from struck.solids.fem.elements import ELEMENTS
from struck.solids.volume_mesh import VolumeMesh

SUFFIXES = frozenset(READERS)
_KINDS = {
    "tetra": "tet4",
    "tetra10": "tet10",
    "hexahedron": "hex8",
    "hexahedron20": "hex20",
    "wedge": "wedge6",
    "wedge15": "wedge15",
}
# Cubes of lengths must stay within the range of double precision.
_FARTHEST = 1e60
_SURFACES = ("vertex", "line", "triangle", "quad", "polygon")


def load_volume(path: str | os.PathLike[str], *, units: str | None = None) -> VolumeMesh:
    """Load a mesh of tetrahedra, hexahedra or wedges of one kind that another program made."""
    path = Path(path)
    if units is not None and units not in UNITS:
        raise OptionError(f"units is {units!r}: give one of {', '.join(UNITS)}")
    try:
        mesh = _one_kind(read_volume(path), UNITS[units or "m"])
        _require_upright(mesh)
    except MeshError as error:
        raise MeshError(f"{path}: {error}") from error
    return mesh


def _one_kind(found: ElementBlocks, metre: float) -> VolumeMesh:
    """Return the volume elements of a file, which must be of one kind."""
    counts: Counter[str] = Counter()
    for kind, cells in found.cells:
        counts[kind] += len(cells)
    solid = [kind for kind in +counts if not kind.startswith(_SURFACES)]
    inventory = ", ".join(f"{count} {kind}" for kind, count in counts.items()) or "nothing"
    if not solid:
        raise MeshError(
            f"it holds no volume elements ({inventory}): export the volume mesh, or load a surface "
            "as obj, stl or ply"
        )
    if len(solid) > 1 or solid[0] not in _KINDS:
        raise MeshError(
            f"its elements are {inventory}, and one kind of volume element is taken, of "
            f"{', '.join(_KINDS)}: mesh it with one kind alone"
        )
    elements = np.concatenate([cells for kind, cells in found.cells if kind == solid[0]])
    return _compact(found.nodes * metre, elements, _KINDS[solid[0]])


def _compact(nodes: Array, elements: Index, kind: str) -> VolumeMesh:
    """Leave out nodes without elements: they would move for nothing."""
    count = elements.shape[1]
    if count != len(ELEMENTS[kind].nodes):
        raise MeshError(f"its {kind} elements have {count} nodes each: export the mesh again")
    if elements.min() < 0 or elements.max() >= len(nodes):
        raise MeshError(
            f"elements name nodes {elements.min()} to {elements.max()} of {len(nodes)}: export the "
            "mesh again"
        )
    used, renumbered = np.unique(elements, return_inverse=True)
    if nodes.shape[1] != 3 or not np.isfinite(nodes[used]).all():
        raise MeshError("its nodes are not finite numbers x, y and z: export the mesh again")
    farthest = np.abs(nodes[used]).max()
    if farthest > _FARTHEST:
        raise MeshError(
            f"a node is {farthest:.3g} m from the origin, and volumes can be computed within "
            f"{_FARTHEST:g} m alone: export the mesh again"
        )
    return VolumeMesh(nodes=nodes[used], elements=renumbered.reshape(elements.shape), kind=kind)


def _require_upright(mesh: VolumeMesh) -> None:
    """Refuse elements that are turned inside out, or have no volume, at one of their corners."""
    element = ELEMENTS[mesh.kind]
    corners = element.gradients(element.corners)
    jacobians = np.einsum("eni,cnj->ecij", mesh.nodes[mesh.elements], corners)
    inverted = np.count_nonzero((np.linalg.det(jacobians) <= 0).any(axis=1))
    if inverted:
        raise MeshError(
            f"{inverted} of its {len(mesh.elements)} {mesh.kind} elements are inverted or without "
            "volume at a corner: smooth the mesh, or put their nodes in the format's own order"
        )

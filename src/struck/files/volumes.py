"""Volume meshes of other programs: vtk, vtu, msh and inp to nodes and elements in metres."""

from __future__ import annotations

import contextlib
import io
import os
import re
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError, MeshError, MissingDependencyError, OptionError
from struck.files.meshes import UNITS
from struck.solids.elements import ELEMENTS
from struck.solids.volume import VolumeMesh

if TYPE_CHECKING:
    import meshio

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_READERS = {".vtk": "vtk", ".vtu": "vtu", ".msh": "gmsh", ".inp": "abaqus"}
SUFFIXES = frozenset(_READERS)
_KINDS = {
    "tetra": "tet4",
    "tetra10": "tet10",
    "hexahedron": "hex8",
    "hexahedron20": "hex20",
    "wedge": "wedge6",
    "wedge15": "wedge15",
}
_SURFACES = ("vertex", "line", "triangle", "quad", "polygon")


def load_volume(path: str | os.PathLike[str], *, units: str | None = None) -> VolumeMesh:
    """Load a mesh of tetrahedra, hexahedra or wedges that another program made.

    Linear and quadratic elements are taken as they are. Points, lines and surface elements are
    passed over, and so are nodes that no volume element uses.

    Parameters
    ----------
    path : path
        A file of VTK (vtk, vtu), Gmsh (msh), or Abaqus and CalculiX (inp).
    units : str, optional
        What the file's numbers are: "m", "cm", "mm", "in" or "ft"; left out, metres.

    Returns
    -------
    VolumeMesh
        Elements of one kind, in m.

    Raises
    ------
    OptionError
        On unknown units.
    MissingDependencyError
        When meshio is not installed.
    FileFormatError
        When the file cannot be read.
    MeshError
        When it holds no volume elements, several kinds of them, inverted ones, or numbers that
        are not finite.
    """
    path = Path(path)
    if units is not None and units not in UNITS:
        raise OptionError(f"units is {units!r}: give one of {', '.join(UNITS)}")
    try:
        mesh = _one_kind(_read(path), UNITS[units or "m"])
        _require_upright(mesh)
    except (FileFormatError, MeshError) as error:
        raise type(error)(f"{path}: {error}") from error
    return mesh


def _read(path: Path) -> meshio.Mesh:
    """Read with meshio, which prints and leaves the program where others raise."""
    reader = _reader(path)
    printed = io.StringIO()
    try:
        if path.suffix.lower() == ".inp":
            _require_one_node_block(path)
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            return reader(str(path))
    except FileFormatError:
        raise
    except OSError as error:
        raise FileFormatError(
            f"it cannot be opened ({error.strerror or error}): check the name and the permissions"
        ) from error
    except (Exception, SystemExit) as error:
        reason = " ".join(f"{type(error).__name__}: {error} {printed.getvalue()}".split())[:160]
        raise FileFormatError(
            f"it cannot be read as {path.suffix[1:]} ({reason}): it is empty, truncated, damaged "
            "or another format; export it again"
        ) from error


def _require_one_node_block(path: Path) -> None:
    """Refuse files of several parts: meshio keeps the nodes of the last alone."""
    text = path.read_text(encoding="utf-8", errors="replace")
    blocks = len(re.findall(r"^\*NODE\s*(?:,|$)", text, re.IGNORECASE | re.MULTILINE))
    if blocks > 1:
        raise FileFormatError(
            f"it holds {blocks} blocks of nodes (*NODE), and one is read: write one part, with all "
            "nodes in one block"
        )


def _reader(path: Path) -> Callable[[str], meshio.Mesh]:
    if path.suffix.lower() not in SUFFIXES:
        raise FileFormatError(
            f"its extension {path.suffix!r} names no volume mesh read here: use one of "
            f"{', '.join(name[1:] for name in _READERS)}"
        )
    try:
        import meshio
    except ImportError as error:
        raise MissingDependencyError(
            'volume meshes are read by meshio: pip install "struck[volumes]"'
        ) from error
    _complete_meshio()
    return getattr(meshio, _READERS[path.suffix.lower()]).read


def _complete_meshio() -> None:
    """Say that two elements are solid: meshio 5.3 knows their nodes and yet fails on them."""
    with contextlib.suppress(ImportError):
        from meshio._mesh import topological_dimension

        topological_dimension.setdefault("wedge15", 3)
        topological_dimension.setdefault("pyramid13", 3)


def _one_kind(found: meshio.Mesh, metre: float) -> VolumeMesh:
    """Return the volume elements of a file, which must be of one kind."""
    counts: Counter[str] = Counter()
    for block in found.cells:
        counts[block.type] += len(block.data)
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
    elements = np.concatenate([block.data for block in found.cells if block.type == solid[0]])
    return _compact(np.asarray(found.points, float) * metre, elements, _KINDS[solid[0]])


def _compact(nodes: Array, elements: Index, kind: str) -> VolumeMesh:
    """Leave out nodes without elements: they would move for nothing."""
    elements = elements.astype(np.int64)
    if elements.min() < 0 or elements.max() >= len(nodes):
        raise MeshError(
            f"elements name nodes {elements.min()} to {elements.max()} of {len(nodes)}: export the "
            "mesh again"
        )
    used, renumbered = np.unique(elements, return_inverse=True)
    if nodes.shape[1] != 3 or not np.isfinite(nodes[used]).all():
        raise MeshError("its nodes are not finite numbers x, y and z: export the mesh again")
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

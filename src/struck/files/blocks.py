"""Volume mesh files to raw blocks of elements; read by meshio, in a process of its own."""

from __future__ import annotations

import contextlib
import io
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError, MissingDependencyError
from struck.files.limits import Limits
from struck.files.source import open_regular

if TYPE_CHECKING:
    import meshio

READERS = {".vtk": "vtk", ".vtu": "vtu", ".msh": "gmsh", ".inp": "abaqus"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Blocks:
    """What a volume mesh file holds, not judged yet.

    Parameters
    ----------
    nodes : array (N, D)
        In the file's own unit.
    cells : list of (str, array (E, K))
        Kinds of elements in meshio's words, and the nodes of each; K is 0 where it varies.
    """

    nodes: NDArray[np.float64]
    cells: list[tuple[str, NDArray[np.int64]]]


def read_blocks(path: Path, limits: Limits) -> Blocks:
    """Read with meshio, which prints and leaves the program where others raise.

    Raises
    ------
    MeshError
        When the file cannot be read.
    MissingDependencyError
        When meshio is not installed.
    """
    reader = _reader(path)
    with open_regular(path, limits) as file:
        if path.suffix.lower() == ".inp":
            _require_one_node_block(file.read())
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            found = reader(str(path))
        nodes = np.asarray(found.points, dtype=np.float64)
        return Blocks(
            nodes=nodes.reshape(len(nodes), -1),
            cells=[(block.type, _cells(block)) for block in found.cells],
        )
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:
        reason = " ".join(f"{type(error).__name__}: {error} {printed.getvalue()}".split())[:160]
        raise MeshError(
            f"it cannot be read as {path.suffix[1:]} ({reason}): it is truncated, damaged or "
            "another format; export it again"
        ) from error


def _cells(block: meshio.CellBlock) -> NDArray[np.int64]:
    cells = np.asarray(block.data)
    if cells.ndim != 2 or cells.dtype.kind not in "iu":
        return np.empty((len(block.data), 0), dtype=np.int64)
    return cells.astype(np.int64)


def _require_one_node_block(data: bytes) -> None:
    """Refuse files of several parts: meshio keeps the nodes of the last alone."""
    blocks = len(re.findall(rb"^\*NODE[ \t\r]*(?:,|$)", data, re.IGNORECASE | re.MULTILINE))
    if blocks > 1:
        raise MeshError(
            f"it holds {blocks} blocks of nodes (*NODE), and one is read: write one part, with all "
            "nodes in one block"
        )
    if re.search(rb"^\*INCLUDE\b", data, re.IGNORECASE | re.MULTILINE):
        raise MeshError(
            "it includes other files (*INCLUDE), which are not read: put all into one file"
        )


def _reader(path: Path) -> Callable[[str], meshio.Mesh]:
    if path.suffix.lower() not in READERS:
        raise MeshError(
            f"its extension {path.suffix!r} names no volume mesh read here: use one of "
            f"{', '.join(name[1:] for name in READERS)}"
        )
    try:
        import meshio
    except ImportError as error:
        raise MissingDependencyError(
            'volume meshes are read by meshio: pip install "struck[volumes]"'
        ) from error
    _complete_meshio()
    return getattr(meshio, READERS[path.suffix.lower()]).read


def _complete_meshio() -> None:
    """Say that two elements are solid: meshio 5.3 knows their nodes and yet fails on them."""
    with contextlib.suppress(ImportError):
        from meshio._mesh import topological_dimension

        topological_dimension.setdefault("wedge15", 3)
        topological_dimension.setdefault("pyramid13", 3)

"""Mesh files to raw parts: the one place where foreign bytes are interpreted.

`parse` takes a path and returns plain arrays; it runs in a process of its own, see `guard`.
"""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import MeshError
from struck.files.archives import open_source
from struck.files.gltf import Buffers, gltf_header, require_core_gltf
from struck.files.limits import Limits
from struck.files.obj import parse_obj
from struck.files.parts import Part
from struck.files.source import Source

if TYPE_CHECKING:
    from trimesh import Scene

_FIRST_BYTES = {"ply": rb"ply\s", "glb": rb"glTF", "off": rb"C?OFF\s", "stl": rb"solid\s.*\sfacet"}
_GLTF = {"skip_materials": True, "merge_primitives": True}
_OPTIONS = {"stl": {}, "ply": {"skip_materials": True}, "off": {}, "glb": _GLTF, "gltf": _GLTF}
_LONGEST_HEADER = 2**16
_MOST_LETTERS = 10**6


def parse(path: Path, limits: Limits) -> tuple[str, list[Part]]:
    """Return the format of a mesh file and its parts, with the file's own numbers.

    The numbers are not judged: they may be infinite, or name vertices that are not there.

    Raises
    ------
    MeshError
        When the file is missing, of an unknown format, not what its name says, beyond the limits,
        or cannot be read.
    """
    source = open_source(path, limits)
    _require_content(source)
    try:
        parts = parse_obj(source.data) if source.kind == "obj" else _by_trimesh(source, limits)
    except (MeshError, MemoryError):
        raise
    except Exception as error:
        raise MeshError(
            f"it cannot be read as {source.kind.upper()} ({_one_line(error)}): it is truncated, "
            "damaged or another format; export it again, as triangles"
        ) from error
    return source.kind, _few((part for part in parts if len(part.faces)), limits)


def _require_content(source: Source) -> None:
    data, kind = source.data, source.kind
    looks = [name for name, first in _FIRST_BYTES.items() if re.match(first, data[:500], re.DOTALL)]
    if looks and kind not in looks:
        raise MeshError(
            f"its content is {looks[0].upper()} and not {kind.upper()}: rename it to end in "
            f".{looks[0]}"
        )
    if kind in {"obj", "off", "gltf"} and b"\0" in data[:100_000]:
        raise MeshError(f"it holds binary data and {kind.upper()} is text: export it again")


def _few(parts: Iterable[Part], limits: Limits) -> list[Part]:
    """Collect parts one by one, as long as they stay within bounds."""
    few: list[Part] = []
    vertices = faces = letters = 0
    for part in parts:
        few.append(part)
        vertices, faces = vertices + len(part.points), faces + len(part.faces)
        _require_at_most(vertices, limits.vertices, "vertices")
        _require_at_most(faces, limits.faces, "faces")
        letters += len(part.name)
        _require_at_most(len(few), limits.parts, "parts")
        _require_at_most(letters, _MOST_LETTERS, "letters in the names of parts")
    return few


def _require_at_most(count: int, most: int, name: str) -> None:
    if count > most:
        raise MeshError(
            f"it holds {count} {name} or more, and {most} are read: simplify the surface (decimate "
            "it), or join its parts"
        )


def _by_trimesh(source: Source, limits: Limits) -> list[Part]:
    import trimesh

    header = gltf_header(source.data, source.kind)
    require_core_gltf(header)
    announced = _announced(source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # NumPy only warns when text numbers end in something else, and drops the rest.
        warnings.filterwarnings("error", message="string or file could not be read to its end")
        scene = trimesh.load_scene(
            io.BytesIO(source.data),
            file_type=source.kind,
            resolver=Buffers(source.beside) if source.kind in {"glb", "gltf"} else None,  # type: ignore[arg-type]
            process=False,
            **_OPTIONS[source.kind],
        )
        # A few bytes can place one surface many times.
        parts = _few(_placed(scene), limits)
    # trimesh walks a scene from its end.
    nodes = {node.get("name", str(i)): i for i, node in enumerate(header.get("nodes", []))}
    parts.sort(key=lambda part: nodes.get(part.name, len(nodes)))
    _require_all(sum(len(part.faces) for part in parts), announced)
    return parts


def _placed(scene: Scene) -> Iterator[Part]:
    """Yield the triangle surfaces of a scene where its nodes put them."""
    import trimesh

    for node in scene.graph.nodes_geometry:
        pose, name = scene.graph[node]
        body = scene.geometry[name]
        if isinstance(body, trimesh.Trimesh):
            points = np.asarray(body.vertices, dtype=np.float64)
            faces = np.asarray(body.faces, dtype=np.int64)
            mirrored = np.linalg.det(pose[:3, :3]) < 0
            yield Part(
                name=str(node).encode(errors="replace").decode(),
                points=points @ pose[:3, :3].T + pose[:3, 3],
                faces=faces[:, ::-1] if mirrored else faces,
            )


def _announced(source: Source) -> int:
    """Return how many faces a file says it has, which cannot be more than its bytes."""
    data, counts = source.data, [0]
    if source.kind == "stl":
        counts = _announced_by_stl(data)
    if source.kind == "ply":
        counts = _announced_by_ply(data)
    if source.kind == "off":
        words = re.sub(rb"#.*", b"", data[:100_000]).split()
        counts = [int(words[1]), int(words[2])]
    if max(counts) > len(data):
        raise MeshError(
            f"it announces {max(counts)} vertices or faces in {len(data)} bytes: it is truncated "
            "or damaged; export it again"
        )
    return counts[-1]


def _announced_by_stl(data: bytes) -> list[int]:
    """Return the facets of a text; a binary file must be as long as it says to be read at all."""
    if data.lstrip()[:5].lower() != b"solid" or b"endfacet" not in data.lower():
        return [0]
    return [len(re.findall(rb"^[ \t]*facet\s", data, re.IGNORECASE | re.MULTILINE))]


def _announced_by_ply(data: bytes) -> list[int]:
    """Return the counts of all elements, that of faces last."""
    header, end, _ = data[:_LONGEST_HEADER].partition(b"end_header")
    if not end:
        raise MeshError(
            f"its header cannot be read: it has no end within {_LONGEST_HEADER} bytes; it is "
            "damaged or another format, export it again"
        )
    found = re.findall(rb"^[ \t]*element[ \t]+(\w+)[ \t]+(\d{1,30})\b", header, re.MULTILINE)
    counts = {name: int(count) for name, count in found}
    return [*counts.values(), counts.get(b"face", 0)]


def _require_all(count: int, announced: int) -> None:
    """Refuse files that announce more triangles than were read."""
    if count < announced:
        raise MeshError(
            f"it announces {announced} faces and only {count} could be read: it is truncated or "
            "damaged; export it again"
        )


def _one_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:120]

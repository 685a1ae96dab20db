"""Mesh files to raw parts: the one place where foreign bytes are interpreted.

`parse` takes a path and returns plain arrays, so that it can run in a process of its own.
"""

from __future__ import annotations

import io
import json
import re
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from struck.errors import FileFormatError
from struck.files.obj import parse_obj
from struck.files.parts import Part

if TYPE_CHECKING:
    from trimesh import Scene

FORMATS = ("obj", "stl", "ply", "off", "glb", "gltf")
_FIRST_BYTES = {"ply": rb"ply\s", "glb": rb"glTF", "off": rb"C?OFF\s", "stl": rb"solid\s.*\sfacet"}
# Required extensions that leave vertices and faces as the core specification has them.
_HARMLESS = re.compile(r"KHR_(materials|texture|lights)_\w+|EXT_texture_\w+")
_TRIANGLE_FAN = 6
_GLTF = {"skip_materials": True, "merge_primitives": True}
_OPTIONS = {"stl": {}, "ply": {"skip_materials": True}, "off": {}, "glb": _GLTF, "gltf": _GLTF}


def parse(path: Path) -> list[Part]:
    """Return the parts of a mesh file with the file's own numbers.

    Raises
    ------
    FileFormatError
        When the file is missing, of an unknown format, not what its name says, or cannot be read.
    """
    kind = _kind(path)
    data = _read(path)
    _require_content(data, kind)
    try:
        parts = parse_obj(data) if kind == "obj" else _by_trimesh(data, kind, path)
    except FileFormatError:
        raise
    except Exception as error:
        raise FileFormatError(
            f"it cannot be read as {kind.upper()} ({_one_line(error)}): it is truncated, damaged "
            "or another format; export it again, as triangles"
        ) from error
    if not any(len(part.faces) for part in parts):
        raise FileFormatError(
            f"no triangles can be read from it as {kind.upper()}: it is empty, truncated or "
            "another format; export the surface again"
        )
    return [part for part in parts if len(part.faces)]


def _kind(path: Path) -> str:
    kind = path.suffix[1:].lower()
    if kind not in FORMATS:
        raise FileFormatError(
            f"its extension {path.suffix!r} names no mesh format read here: use one of "
            f"{', '.join(FORMATS)}"
        )
    return kind


def _read(path: Path) -> bytes:
    try:
        data = path.read_bytes()
    except OSError as error:
        raise FileFormatError(
            f"it cannot be opened ({error.strerror or error}): check the name and the permissions"
        ) from error
    if not data:
        raise FileFormatError("it is empty (0 bytes): export it again")
    return data


def _require_content(data: bytes, kind: str) -> None:
    looks = [name for name, first in _FIRST_BYTES.items() if re.match(first, data[:500], re.DOTALL)]
    if looks and kind not in looks:
        raise FileFormatError(
            f"its content is {looks[0].upper()} and not {kind.upper()}: rename it to end in "
            f".{looks[0]}"
        )
    if kind in {"obj", "off", "gltf"} and b"\0" in data[:100_000]:
        raise FileFormatError(f"it holds binary data and {kind.upper()} is text: export it again")


def _by_trimesh(data: bytes, kind: str, path: Path) -> list[Part]:
    import trimesh
    from trimesh.resolvers import FilePathResolver

    header = _gltf_header(data, kind)
    _require_core_gltf(header)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # NumPy only warns when text numbers end in something else, and drops the rest.
        warnings.filterwarnings("error", message="string or file could not be read to its end")
        scene = trimesh.load_scene(
            io.BytesIO(data),
            file_type=kind,
            resolver=FilePathResolver(str(path)) if kind == "gltf" else None,
            process=False,
            **_OPTIONS[kind],
        )
    # trimesh walks a scene from its end.
    nodes = {node.get("name", str(i)): i for i, node in enumerate(header.get("nodes", []))}
    parts = sorted(_placed(scene), key=lambda part: nodes.get(part.name, len(nodes)))
    _require_all(sum(len(part.faces) for part in parts), data, kind)
    return parts


def _placed(scene: Scene) -> list[Part]:
    """Return the triangle surfaces of a scene where its nodes put them."""
    import trimesh

    parts = []
    for node in scene.graph.nodes_geometry:
        pose, name = scene.graph[node]
        body = scene.geometry[name]
        if isinstance(body, trimesh.Trimesh):
            points = np.asarray(body.vertices, dtype=np.float64)
            faces = np.asarray(body.faces, dtype=np.int64)
            mirrored = np.linalg.det(pose[:3, :3]) < 0
            parts.append(
                Part(
                    name=str(node),
                    points=points @ pose[:3, :3].T + pose[:3, 3],
                    faces=faces[:, ::-1] if mirrored else faces,
                )
            )
    return parts


def _require_all(count: int, data: bytes, kind: str) -> None:
    """Refuse files that announce more triangles than were read."""
    announced = 0
    if kind == "stl" and data.lstrip()[:5].lower() == b"solid" and b"endfacet" in data.lower():
        announced = len(re.findall(rb"^\s*facet\s", data, re.IGNORECASE | re.MULTILINE))
    if kind == "ply":
        found = re.search(rb"element face (\d+)", data[:100_000])
        announced = int(found[1]) if found else 0
    if kind == "off":
        plain = re.sub(rb"#.*", b"", data[:100_000]).split()
        announced = int(plain[2])
    if count < announced:
        raise FileFormatError(
            f"it announces {announced} faces and only {count} could be read: it is truncated or "
            "damaged; export it again"
        )


def _gltf_header(data: bytes, kind: str) -> dict[str, Any]:
    if kind == "gltf":
        return json.loads(data)
    if kind == "glb":
        length = int.from_bytes(data[12:16], "little")
        return json.loads(data[20 : 20 + length])
    return {}


def _require_core_gltf(header: dict[str, Any]) -> None:
    """Refuse what trimesh would pass over: packed vertices and triangle fans."""
    strange = [name for name in header.get("extensionsRequired", []) if not _HARMLESS.match(name)]
    primitives = [part for mesh in header.get("meshes", []) for part in mesh["primitives"]]
    used = [part.get("attributes", {}).get("POSITION") for part in primitives]
    used += [part.get("indices") for part in primitives]
    accessors = [header["accessors"][number] for number in used if number is not None]
    if any(
        "sparse" in one or one.get("normalized") or "bufferView" not in one for one in accessors
    ):
        strange.append("sparse, normalised or empty accessors")
    if any(part.get("mode") == _TRIANGLE_FAN for part in primitives):
        strange.append("triangle fans")
    if strange:
        raise FileFormatError(
            f"it uses {' and '.join(strange)}, not read here: export it again as plain "
            "triangles without compression"
        )


def _one_line(error: Exception) -> str:
    return " ".join(f"{type(error).__name__}: {error}".split())[:120]

"""Mesh files to raw parts: the one place where foreign bytes are interpreted.

`parse` takes a path and returns plain arrays; it runs in a process of its own, see `guard`.
"""

from __future__ import annotations

import contextlib
import io
import json
import re
import warnings
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError, MissingDependencyError
from struck.files.archives import Source, open_regular, open_source
from struck.files.messages import READERS, ElementBlocks, Part, ReadingLimits

if TYPE_CHECKING:
    import meshio
    from trimesh import Scene

_FIRST_BYTES = {"ply": rb"ply\s", "glb": rb"glTF", "off": rb"C?OFF\s", "stl": rb"solid\s.*\sfacet"}
_GLTF = {"merge_primitives": True}
_OPTIONS = {"stl": {}, "ply": {"skip_materials": True}, "off": {}, "glb": _GLTF, "gltf": _GLTF}
_LONGEST_HEADER = 2**16
_MOST_LETTERS = 10**6
# Required extensions that leave vertices and faces as the core specification has them.
_HARMLESS = re.compile(r"KHR_(materials|texture|lights)_\w+|EXT_texture_\w+")
_TRIANGLES, _TRIANGLE_STRIP, _TRIANGLE_FAN = 4, 5, 6


def parse(path: Path, limits: ReadingLimits) -> tuple[str, list[Part]]:
    """Return format and parts of a mesh file; indices and vertices are not checked yet."""
    source = open_source(path, limits)
    _require_content(source)
    try:
        parts = parse_obj(source.data) if source.kind == "obj" else _by_trimesh(source, limits)
    except (MeshError, MemoryError):
        raise
    except Exception as error:
        raise MeshError(
            f"it cannot be read as {source.kind.upper()}{_reason(error)}: it is truncated, "
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


def _few(parts: Iterable[Part], limits: ReadingLimits) -> list[Part]:
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


def _by_trimesh(source: Source, limits: ReadingLimits) -> list[Part]:
    import trimesh

    header = gltf_header(source.data, source.kind)
    require_core_gltf(header)
    announced = _announced(source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # NumPy only warns when text numbers end in something else, and drops the rest.
        warnings.filterwarnings("error", message="string or file could not be read to its end")
        scene = trimesh.load_scene(
            io.BytesIO(_geometry_alone(source.data, source.kind, header)),
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
    count = sum(len(part.faces) for part in parts)
    if count < announced:
        raise MeshError(
            f"it announces {announced} faces and only {count} could be read: it is truncated or "
            "damaged; export it again"
        )
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
    # A binary STL must be as long as it says to be read at all.
    if source.kind == "stl" and data.lstrip()[:5].lower() == b"solid":
        facets = len(re.findall(rb"^[ \t]*facet\s", data, re.IGNORECASE | re.MULTILINE))
        counts = [facets if b"endfacet" in data.lower() else 0]
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


def _reason(error: BaseException, printed: str = "") -> str:
    """Return the message of a reader's error in brackets, or nothing for errors of Python."""
    speaks = isinstance(error, ValueError | OSError) or type(error).__module__ != "builtins"
    said = f"{error} {printed}" if speaks else printed
    told = " ".join(said.split())[:140]
    return f" ({told})" if told else ""


# Wavefront OBJ text: vertices, polygons, objects and groups.
#
# Read here, not by trimesh: that takes relative indices from the end of the file, not from where
# they stand, takes index 0 as 1, and drops lines it cannot read.


def parse_obj(data: bytes) -> Iterator[Part]:
    """Read the objects of an OBJ file, or its groups where it has at most one object."""
    text = data.decode("utf-8", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    reader = _Reader()
    for number, line in enumerate(text.split("\n"), start=1):
        words = line.split("#", 1)[0].split()
        try:
            reader.take(words)
        except (ValueError, IndexError) as error:
            shown = line.strip()[:40]
            raise MeshError(f"line {number} ({shown!r}) cannot be read: {error}") from error
    return reader.parts()


class _Reader:
    """Vertices and triangles of the OBJ lines read so far."""

    def __init__(self) -> None:
        self._points: list[tuple[float, ...]] = []
        self._faces: list[tuple[int, ...]] = []
        self._objects: list[str] = []
        self._groups: list[str] = []
        self._object = "default"
        self._group = "default"

    def take(self, words: list[str]) -> None:
        """Take in the words of one line."""
        keyword = words[0] if words else ""
        if keyword == "v":
            x, y, z = words[1:4]
            self._points.append((float(x), float(y), float(z)))
        elif keyword == "f":
            self._take_polygon([self._index(word) for word in words[1:]])
        elif keyword == "o":
            self._object = " ".join(words[1:]) or "default"
        elif keyword == "g":
            self._group = " ".join(words[1:]) or "default"

    def _index(self, word: str) -> int:
        number = int(word.partition("/")[0])
        if number == 0 or -number > len(self._points):
            raise ValueError(f"there is no vertex {number} among the {len(self._points)} so far")
        return number - 1 if number > 0 else len(self._points) + number

    def _take_polygon(self, corners: list[int]) -> None:
        if len(corners) < 3:
            raise ValueError(f"a face needs 3 vertices and has {len(corners)}")
        fan = [(corners[0], *pair) for pair in pairwise(corners[1:])]
        self._faces += fan
        self._objects += [self._object] * len(fan)
        self._groups += [self._group] * len(fan)

    def parts(self) -> Iterator[Part]:
        """Return the triangles by object, or else by group."""
        points = np.array(self._points, dtype=np.float64).reshape(-1, 3)
        faces = np.array(self._faces, dtype=object).reshape(-1, 3)
        if len(faces) and faces.max() >= len(points):
            raise MeshError(
                f"a face names vertex {faces.max() + 1} of {len(points)}: the file is truncated, "
                "or was edited by hand"
            )
        names = self._objects if len(set(self._objects)) > 1 else self._groups
        numbers = {name: number for number, name in enumerate(dict.fromkeys(names))}
        labels = np.array([numbers[name] for name in names], dtype=np.int64)
        indices = faces.astype(np.int64)[np.argsort(labels, kind="stable")]
        starts = np.cumsum(np.bincount(labels))[:-1] if names else []
        together = zip(numbers, np.split(indices, starts), strict=bool(names))
        return (_part(name, points, each) for name, each in together)


def _part(name: str, points: NDArray[np.float64], faces: NDArray[np.int64]) -> Part:
    used, renumbered = np.unique(faces, return_inverse=True)
    return Part(name=name, points=points[used], faces=renumbered.reshape(-1, 3))


def gltf_header(data: bytes, kind: str) -> dict[str, Any]:
    """Return the JSON header of a glTF or GLB file, and {} for other formats."""
    if kind == "gltf":
        return json.loads(data)
    if kind == "glb" and data[4:8] == b"\1\0\0\0":
        return {"asset": {"version": "1.0"}}  # whose file is laid out otherwise
    if kind == "glb":
        length = int.from_bytes(data[12:16], "little")
        return json.loads(data[20 : 20 + length])
    return {}


def require_core_gltf(header: dict[str, Any]) -> None:
    """Refuse glTF that trimesh would misread: compressed vertices and triangle fans."""
    version = str(header.get("asset", {}).get("version", "2.0"))
    if version[:2] == "1.":
        raise MeshError(f"it is glTF {version}, and 2.0 is read: export it again as that")
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
        raise MeshError(
            f"it uses {' and '.join(strange)}, not read here: export it again as plain "
            "triangles without compression"
        )


def _geometry_alone(data: bytes, kind: str, header: dict[str, Any]) -> bytes:
    """Return glTF without materials, colours, points and lines, and other files as they are."""
    if not header:
        return data
    # trimesh joins the primitives of a mesh by their materials: all get the same, which is empty.
    slim = {name: header[name] for name in header if name not in {"textures", "images", "samplers"}}
    slim["materials"] = [{}]
    slim["meshes"] = [
        {
            **mesh,
            "primitives": [_surface_alone(one) for one in mesh["primitives"] if _is_drawn(one)],
        }
        for mesh in header.get("meshes", [])
    ]
    text = json.dumps(slim).encode()
    if kind == "gltf":
        return text
    text += b" " * (-len(text) % 4)
    before = int.from_bytes(data[12:16], "little")
    whole = int.from_bytes(data[8:12], "little") + len(text) - before  # damage stays visible
    lengths = (each.to_bytes(4, "little", signed=True) for each in (whole, len(text)))
    return b"".join([data[:8], *lengths, data[16:20], text, data[20 + before :]])


def _surface_alone(primitive: dict[str, Any]) -> dict[str, Any]:
    kept = {name: primitive[name] for name in ("indices", "mode") if name in primitive}
    places = {"POSITION": primitive["attributes"]["POSITION"]}
    return {**kept, "attributes": places, "material": 0}


def _is_drawn(primitive: dict[str, Any]) -> bool:
    """Return whether a primitive holds triangles."""
    return primitive.get("mode", _TRIANGLES) in {_TRIANGLES, _TRIANGLE_STRIP}


class Buffers:
    """Buffers outside a glTF file, in the form in which trimesh asks for them."""

    def __init__(self, read: Callable[[str], bytes]) -> None:
        self._read = read

    def get(self, name: str) -> bytes:
        """Return the content of a buffer by its relative address."""
        return self._read(unquote(name))

    __getitem__ = get


def read_blocks(path: Path, limits: ReadingLimits) -> ElementBlocks:
    """Read a volume mesh with meshio, which prints and exits where others raise."""
    reader = _reader(path)
    with open_regular(path, limits) as file:
        if path.suffix.lower() == ".inp":
            _require_one_node_block(file.read())
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            found = reader(str(path))
        nodes = np.asarray(found.points, dtype=np.float64)
        return ElementBlocks(
            nodes=nodes.reshape(len(nodes), -1),
            cells=[(block.type, _cells(block)) for block in found.cells],
        )
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:
        reason = _reason(error, printed.getvalue())
        raise MeshError(
            f"it cannot be read as {path.suffix[1:]}{reason}: it is truncated, damaged or "
            "another format; export it again"
        ) from error


def _cells(block: meshio.CellBlock) -> NDArray[np.int64]:
    cells = np.asarray(block.data)
    if cells.ndim != 2 or cells.dtype.kind not in "iu":
        return np.empty((len(block.data), 0), dtype=np.int64)
    return cells.astype(np.int64)


def _require_one_node_block(data: bytes) -> None:
    """Refuse Abaqus files of several parts: meshio keeps the nodes of the last alone."""
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
    # meshio 5.3 knows the nodes of these two elements and yet fails on them.
    with contextlib.suppress(ImportError):
        from meshio._mesh import topological_dimension

        topological_dimension.setdefault("wedge15", 3)
        topological_dimension.setdefault("pyramid13", 3)
    return getattr(meshio, READERS[path.suffix.lower()]).read

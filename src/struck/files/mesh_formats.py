"""Mesh files to raw parts: the one place where foreign bytes are interpreted.

`parse` takes a path and returns plain arrays; it runs in a separate process, see `guard`.
"""

from __future__ import annotations

import contextlib
import io
import re
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from struck.errors import FileFormatError, MeshError, MissingDependencyError, OptionError
from struck.files.archives import Source, open_regular, open_source
from struck.files.atomic import write_bytes
from struck.files.gltf import read_gltf, strip_triangles
from struck.files.messages import (
    FORMATS,
    READERS,
    Answer,
    ElementBlocks,
    Parsed,
    Part,
    ReadingLimits,
)
from struck.files.recognition import HEAD, explain_not_surface, kind_by_content, recognise
from struck.model.arrays import AnyArray

if TYPE_CHECKING:
    import os

    import meshio
    from trimesh import Scene

    from struck.model.model import ModalModel

_OPTIONS = {"stl": {}, "ply": {"skip_materials": True}}
_LONGEST_HEADER = 2**16
_MOST_LETTERS = 10**6
# Elements of OBJ files with a position, other than vertices and faces, by keyword.
_OBJ_EXTRAS = {"p": "point", "l": "line", "curv": "curve", "surf": "curved patch"}


def parse(path: Path, limits: ReadingLimits) -> Parsed:
    """Return the surfaces of a mesh file, their indices and vertices not checked yet."""
    source = open_source(path, limits)
    _require_content(source)
    try:
        # A few bytes can place one surface many times.
        parts, beside = _READERS[source.kind](source, limits)
        nonempty_parts = _limit_parts((part for part in parts if len(part.faces)), limits)
    except (MeshError, MemoryError):
        raise
    except Exception as error:
        raise MeshError(
            f"it cannot be read as {source.kind.upper()}{_reason(error)}: it is truncated, "
            "damaged or another format; export it again, as triangles"
        ) from error
    return Parsed(kind=source.kind, parts=nonempty_parts, beside=dict(beside))


def answer_surface(path: Path, limits: ReadingLimits) -> Answer:
    """Return the surfaces of a mesh file as an answer of the process that reads files."""
    start, mesh = time.process_time(), parse(path, limits)
    arrays = [array for part in mesh.parts for array in (part.points, part.faces)]
    names = [part.name for part in mesh.parts]
    seconds = time.process_time() - start
    return {"kind": mesh.kind, "names": names, "beside": mesh.beside, "seconds": seconds}, arrays


def answer_volume(path: Path, limits: ReadingLimits) -> Answer:
    """Return the elements of a volume mesh as an answer of the process that reads files."""
    mesh = read_blocks(path, limits)
    arrays = [mesh.nodes, *(cells for _, cells in mesh.cells)]
    return {"kinds": [kind for kind, _ in mesh.cells]}, arrays


def _require_content(source: Source) -> None:
    data, kind = source.data, source.kind
    content = kind_by_content(data[:HEAD])
    if content is not None and content.name.lower() != kind:
        is_surface = content.group == "surface"
        advice = f"rename it to end in .{content.name.lower()}" if is_surface else content.advice
        raise MeshError(f"its content is {content.name} and not {kind.upper()}: {advice}")
    if kind in {"obj", "off", "gltf"} and b"\0" in data[:100_000]:
        raise MeshError(f"it holds binary data and {kind.upper()} is text: export it again")


def _limit_parts(parts: Iterable[Part], limits: ReadingLimits) -> list[Part]:
    """Collect parts one by one, as long as they stay within bounds."""
    selected_parts: list[Part] = []
    vertices = faces = letters = 0
    for part in parts:
        selected_parts.append(part)
        vertices, faces = vertices + len(part.points), faces + len(part.faces)
        _require_at_most(vertices, limits.vertices, "vertices")
        _require_at_most(faces, limits.faces, "faces")
        letters += len(part.name)
        _require_at_most(len(selected_parts), limits.parts, "parts")
        _require_at_most(letters, _MOST_LETTERS, "letters in the names of parts")
    return selected_parts


def _require_at_most(count: int, most: int, name: str) -> None:
    if count > most:
        raise MeshError(
            f"it holds {count} {name} or more, and {most} are read: simplify the surface (decimate "
            "it), or join its parts"
        )


def _by_trimesh(source: Source, limits: ReadingLimits) -> tuple[list[Part], Counter[str]]:
    """Read STL and PLY."""
    import trimesh

    counts = _stated_counts(source)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # NumPy only warns when text numbers end in something else, and drops the rest.
        warnings.filterwarnings("error", message="string or file could not be read to its end")
        scene = trimesh.load_scene(
            io.BytesIO(source.data), file_type=source.kind, process=False, **_OPTIONS[source.kind]
        )
    parts = _limit_parts(_surfaces(scene), limits)
    count = sum(len(part.faces) for part in parts)
    if count < counts["face"]:
        raise MeshError(
            f"it announces {counts['face']} faces and only {count} could be read: it is truncated "
            "or damaged; export it again"
        )
    return parts, Counter({"line": counts["edge"]})


def _surfaces(scene: Scene) -> Iterator[Part]:
    """Yield the triangle surfaces of a file, strips included."""
    import trimesh

    for name, body in scene.geometry.items():
        faces = [np.empty((0, 3), np.int64)]
        if isinstance(body, trimesh.Trimesh):
            faces.append(np.asarray(body.faces, dtype=np.int64))
        strips = body.metadata.get("_ply_raw", {}).get("tristrips")
        if strips:
            faces.append(_unroll(strips["data"]))
        points = np.asarray(body.vertices, dtype=np.float64).reshape(-1, 3)
        yield Part(
            name=str(name).encode(errors="replace").decode(),
            points=points,
            faces=np.concatenate(faces),
        )


def _unroll(strips: dict[str, AnyArray] | AnyArray) -> NDArray[np.int64]:
    """Return the triangles of PLY strips, as text or binary, which are one list parted by -1."""
    if isinstance(strips, dict):
        column = next(iter(strips.values()))
    else:
        column = strips[next(iter(strips.dtype.names or ()))]["f1"]
    indices = np.asarray(column, dtype=np.int64).ravel()
    pieces = np.split(indices, np.flatnonzero(indices < 0))
    return np.concatenate([strip_triangles(piece[piece >= 0]) for piece in pieces])


def _stated_counts(source: Source) -> Counter[str]:
    """Return how many elements of each kind a file says it has: not more than its bytes."""
    data, counts = source.data, Counter[str]()
    # A binary STL must be as long as it says to be read at all.
    if source.kind == "stl" and data.lstrip()[:5].lower() == b"solid":
        facets = len(re.findall(rb"^[ \t]*facet\s", data, re.IGNORECASE | re.MULTILINE))
        counts["face"] = facets if b"endfacet" in data.lower() else 0
    if source.kind == "ply":
        counts = _stated_by_ply(data)
    _require_possible(max(counts.values(), default=0), data)
    return counts


def _require_possible(count: int, data: bytes) -> None:
    if count > len(data):
        raise MeshError(
            f"it announces {count} vertices or faces in {len(data)} bytes: it is truncated "
            "or damaged; export it again"
        )


def _stated_by_ply(data: bytes) -> Counter[str]:
    """Return the counts of all elements."""
    header, end, _ = data[:_LONGEST_HEADER].partition(b"end_header")
    if not end:
        raise MeshError(
            f"its header cannot be read: it has no end within {_LONGEST_HEADER} bytes; it is "
            "damaged or another format, export it again"
        )
    elements = re.findall(rb"^[ \t]*element[ \t]+(\w+)[ \t]+(\d{1,30})\b", header, re.MULTILINE)
    return Counter({name.decode(): int(count) for name, count in elements})


def _reason(error: BaseException, printed: str = "") -> str:
    """Return the message of a reader's error in brackets, or "" for errors of Python itself."""
    has_message = isinstance(error, ValueError | OSError) or type(error).__module__ != "builtins"
    message = f"{error} {printed}" if has_message else printed
    text = " ".join(message.split())[:140]
    return f" ({text})" if text else ""


# Object File Format text: a vertex or face a line, and faces over several lines.
#
# Read here, as trimesh takes each line for a separate face.


def _parse_off(source: Source, _: ReadingLimits) -> tuple[list[Part], Counter[str]]:
    """Read an OFF file: counts, vertices, polygons by the numbers of their corners."""
    text = re.sub(r"#.*", "", source.data.decode("utf-8", errors="replace"))
    keyword = re.match(r"\s*(ST|C|N)*OFF\b(?!\s*BINARY)", text)
    if not keyword:
        raise ValueError(f"it begins with {text[:20]!r} and not with OFF, as text in three axes")
    rows = [line.split() for line in text[keyword.end() :].splitlines() if line.strip()]
    vertices, count = (int(word) for word in rows[0][:2])
    _require_possible(max(vertices, count), source.data)
    points = np.array([row[:3] for row in rows[1 : vertices + 1]], dtype=np.float64)
    polygons = _polygons(rows[vertices + 1 :], count)
    if len(polygons) < count:
        raise MeshError(
            f"it announces {count} faces and only {len(polygons)} could be read: it is "
            "truncated or damaged; export it again"
        )
    fans = [(each[0], *pair) for each in polygons for pair in pairwise(each[1:])]
    part = Part(
        name="default",
        points=points.reshape(vertices, 3),
        faces=np.array(fans, dtype=np.int64).reshape(-1, 3),
    )
    kinds = Counter("point" if len(each) == 1 else "line" for each in polygons if len(each) < 3)
    return [part], kinds


def _polygons(rows: list[list[str]], count: int) -> list[list[int]]:
    """Return the corners of `count` polygons at most; numbers after them in a line are colours."""
    polygons: list[list[int]] = []
    words: list[str] = []
    for row in rows:
        words += row
        corners = int(words[0])
        if len(words) > corners:
            polygons.append([int(word) for word in words[1 : corners + 1]])
            words = []
            if len(polygons) == count:
                break
    return polygons


# Wavefront OBJ text: vertices, polygons, objects and groups.
#
# Read here, not by trimesh: that takes relative indices from the end of the file, not from where
# they stand, takes index 0 as 1, and drops lines it cannot read.


def parse_obj(data: bytes) -> tuple[Iterator[Part], Counter[str]]:
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
    return reader.parts(), reader.beside


class _Reader:
    """Vertices and triangles of the OBJ lines read so far."""

    def __init__(self) -> None:
        self._points: list[tuple[float, ...]] = []
        self._faces: list[tuple[int, ...]] = []
        self._objects: list[str] = []
        self._groups: list[str] = []
        self._object = "default"
        self._group = "default"
        self.beside: Counter[str] = Counter()

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
        elif keyword in _OBJ_EXTRAS:
            self.beside[_OBJ_EXTRAS[keyword]] += 1

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
        groups = zip(numbers, np.split(indices, starts), strict=bool(names))
        return (_part(name, points, each) for name, each in groups)


def _part(name: str, points: NDArray[np.float64], faces: NDArray[np.int64]) -> Part:
    vertex_indices, renumbered = np.unique(faces, return_inverse=True)
    return Part(name=name, points=points[vertex_indices], faces=renumbered.reshape(-1, 3))


def read_blocks(path: Path, limits: ReadingLimits) -> ElementBlocks:
    """Read a volume mesh with meshio, which prints and exits where others raise."""
    reader = _reader(path)
    with open_regular(path, limits) as file:
        if path.suffix.lower() == ".inp":
            _require_one_node_block(file.read())
    output = io.StringIO()
    try:
        with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
            mesh = reader(str(path))
        nodes = np.asarray(mesh.points, dtype=np.float64)
        return ElementBlocks(
            nodes=nodes.reshape(len(nodes), -1),
            cells=[(block.type, _cells(block)) for block in mesh.cells],
        )
    except MemoryError:
        raise
    except (Exception, SystemExit) as error:
        reason = _reason(error, output.getvalue())
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
        if path.suffix[1:].lower() in FORMATS:
            raise MeshError("it is a surface and not a volume mesh: load it by load_body")
        raise MeshError(explain_not_surface(path.name, recognise(path)))
    meshio = _meshio("volume meshes are read")
    # meshio 5.3 knows the nodes of these two elements and yet fails on them.
    with contextlib.suppress(ImportError):
        from meshio._mesh import topological_dimension

        topological_dimension.setdefault("wedge15", 3)
        topological_dimension.setdefault("pyramid13", 3)
    return getattr(meshio, READERS[path.suffix.lower()]).read


def _meshio(what: str) -> ModuleType:
    try:
        import meshio
    except ImportError as error:
        raise MissingDependencyError(f'{what} by meshio: pip install "struck[volumes]"') from error
    return meshio


def write_shapes(model: ModalModel, path: str | os.PathLike[str]) -> None:
    """Write surface and mode shapes of a model as a VTU file, a field of vectors for each mode.

    The fields are named by the modes' numbers, from 1, and frequencies.
    """
    from struck.model.gains import ShapeGains

    gains = model.gains
    if not isinstance(gains, ShapeGains):
        raise OptionError(
            f"{path} would hold mode shapes, and this model has none, as its gains are "
            "recorded: write them to a .sofa file, or analyze a mesh of the body"
        )
    meshio = _meshio("VTU files are written")
    digits = len(str(len(model.frequencies)))
    shapes = np.ascontiguousarray(np.moveaxis(gains.shapes, 2, 0))
    fields = {
        f"mode {number:0{digits}d} ({frequency:.2f} Hz)": shape
        for number, (frequency, shape) in enumerate(
            zip(model.frequencies, shapes, strict=True), start=1
        )
    }
    faces = [("triangle", gains.surface.faces)]
    mesh = meshio.Mesh(gains.surface.points, faces, point_data=fields)
    try:
        with tempfile.TemporaryDirectory() as folder:  # meshio writes to names alone
            file = Path(folder) / "shapes.vtu"
            meshio.vtu.write(file, mesh)
            data = file.read_bytes()
    except OSError as error:
        raise FileFormatError(
            f"{path} cannot be written (no temporary file: {error.strerror or error}): free some "
            "space, or give another temporary folder by TMPDIR"
        ) from error
    write_bytes(path, data)


_READERS: dict[str, Callable[[Source, ReadingLimits], tuple[Iterable[Part], Counter[str]]]] = {
    "obj": lambda source, _: parse_obj(source.data),
    "off": _parse_off,
    "stl": _by_trimesh,
    "ply": _by_trimesh,
    "glb": read_gltf,
    "gltf": read_gltf,
}

"""glTF 2.0 and GLB files to surfaces: buffers, accessors, primitives and nodes.

Read here, as trimesh passes over what the format allows and scanners and exporters write: sparse,
normalised and empty accessors, triangle fans, objects of several materials. Names of sections and
fields are those of the specification (Khronos Group, glTF 2.0, ISO/IEC 12113:2022).
"""

from __future__ import annotations

import base64
import json
import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError
from struck.files.archives import Source, open_source
from struck.files.messages import Answer, Frame, Part, ReadingLimits

# Required extensions that leave vertices and faces as the core specification reads them.
_HARMLESS = re.compile(
    r"KHR_(materials|texture|lights|mesh_quantization)\w*|EXT_texture_\w+|KHR_xmp\w*"
)
_NUMBERS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_COLUMNS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}
_POINTS_AND_LINES = {0: "set of points", 1: "set of lines", 2: "line loop", 3: "line strip"}
_JSON, _BINARY = b"JSON", b"BIN\0"
_TRIANGLES, _STRIP, _FAN = 4, 5, 6


def read_gltf(source: Source, limits: ReadingLimits) -> tuple[Iterator[Part], Counter[str]]:
    """Return the surfaces of a file, placed by its nodes, and counts of the parts left out."""
    header, binary = _open(source)
    _require_known(header)
    document = _Document(header, _buffers(header, binary, source), limits)
    return document.placed(), document.left_out()


def answer_animation(path: Path, limits: ReadingLimits) -> Answer:
    """Return how each node that moves does, as seen from where it rests, as an answer.

    The content has the `names` of the nodes; three arrays belong to each, those of a `Motion`.
    """
    source = open_source(path, limits)
    header, binary = _open(source)
    _require_known(header)
    motions = _Document(header, _buffers(header, binary, source), limits).motions()
    arrays = [
        array
        for motion in motions.values()
        for array in (motion.times[:, None], motion.positions, motion.rotations)
    ]
    return {"names": list(motions)}, arrays


def motions_of(frame: Frame) -> dict[str, Motion]:
    """Return the motions that an answer holds, by the names of their nodes."""
    names, parts = frame.content["names"], frame.arrays
    columns = [array.shape[1] for array in parts]
    if columns != [1, 3, 4] * len(names):
        raise ValueError("its arrays are no motions")
    triples = zip(names, parts[::3], parts[1::3], parts[2::3], strict=True)
    return {
        name: Motion(times=times[:, 0], positions=positions, rotations=rotations)
        for name, times, positions, rotations in triples
    }


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """Motion that takes the surface of a node from its rest position to its place."""

    times: NDArray[np.float64]  # (T,), s
    positions: NDArray[np.float64]  # (T, 3), m
    rotations: NDArray[np.float64]  # (T, 4), unit quaternions (w, x, y, z)


def _open(source: Source) -> tuple[dict[str, Any], bytes | None]:
    """Return the JSON header, and the binary chunk of a GLB file."""
    if source.kind == "gltf":
        return json.loads(source.data), None
    data = source.data
    version, length = np.frombuffer(data[:12], "<u4")[1:]
    if version == 1:
        return {"asset": {"version": "1.0"}}, None  # the rest of the file is laid out otherwise
    if data[:4] != b"glTF" or length > len(data):
        raise ValueError(f"it states {length} bytes, beginning with glTF, and has {len(data)}")
    chunks: dict[bytes, bytes] = {}
    start = 12
    while start + 8 <= length:
        size, kind = int.from_bytes(data[start : start + 4], "little"), data[start + 4 : start + 8]
        chunk = data[start + 8 : start + 8 + size]
        if len(chunk) < size:
            raise ValueError(f"a chunk states {size} bytes and has {len(chunk)}")
        chunks.setdefault(kind, chunk)
        start += 8 + size
    return json.loads(chunks[_JSON]), chunks.get(_BINARY)


def _require_known(header: dict[str, Any]) -> None:
    """Refuse other versions and compressed vertices."""
    version = str(header.get("asset", {}).get("version", "2.0"))
    if version[:2] == "1.":
        raise MeshError(f"it is glTF {version}, and 2.0 is read: export it again as that")
    unknown_extensions = [
        name for name in header.get("extensionsRequired", []) if not _HARMLESS.match(name)
    ]
    if unknown_extensions:
        raise MeshError(
            f"it uses {' and '.join(unknown_extensions)}, not read here: export it again as plain "
            "triangles without compression"
        )


def _buffers(header: dict[str, Any], binary: bytes | None, source: Source) -> list[bytes]:
    """Return the bytes of all buffers of a glTF file, which lie in it or in files next to it."""
    buffers = []
    for number, buffer in enumerate(header.get("buffers", [])):
        address = buffer.get("uri")
        if address is None and number == 0 and binary is not None:
            data = binary
        elif address is not None and address.startswith("data:"):
            data = base64.b64decode(address.partition(",")[2])
        else:
            data = source.beside(unquote(address or ""))
        if len(data) < buffer["byteLength"]:
            raise ValueError(f"buffer {number} states {buffer['byteLength']} bytes: {len(data)}")
        buffers.append(data)
    return buffers


@dataclass(frozen=True, slots=True, kw_only=False, eq=False)
class _Document:
    """A header with the content of its buffers."""

    header: dict[str, Any]
    buffers: list[bytes]
    limits: ReadingLimits

    def left_out(self) -> Counter[str]:
        """Return the numbers of points and lines, which are not triangles, by kind."""
        modes = (
            primitive.get("mode", _TRIANGLES)
            for mesh in self.header.get("meshes", [])
            for primitive in mesh["primitives"]
        )
        return Counter(_POINTS_AND_LINES[mode] for mode in modes if mode in _POINTS_AND_LINES)

    def placed(self) -> Iterator[Part]:
        """Yield the surface of each node that has one, in the order of nodes."""
        nodes = self.header.get("nodes", [])
        surfaces: dict[int, tuple[NDArray[np.float64], NDArray[np.int64]]] = {}
        names: set[str] = set()
        for number, pose in sorted(self._poses().items()):
            mesh = nodes[number].get("mesh")
            if mesh is None:
                continue
            if mesh not in surfaces:
                surfaces[mesh] = self._surface(mesh)
            points, faces = surfaces[mesh]
            is_mirrored = np.linalg.det(pose[:3, :3]) < 0
            name = str(nodes[number].get("name", number))
            name = f"{name} (node {number})" if name in names else name
            names.add(name)
            yield Part(
                name=name,
                points=points @ pose[:3, :3].T + pose[:3, 3],
                faces=faces[:, ::-1] if is_mirrored else faces,
            )

    def _poses(self) -> dict[int, NDArray[np.float64]]:
        """Return the transform of each node of the scene to the world, (4, 4), by its number."""
        nodes = self.header.get("nodes", [])
        children = {child for node in nodes for child in node.get("children", [])}
        scenes = self.header.get("scenes")
        roots = [number for number in range(len(nodes)) if number not in children]
        if scenes:
            roots = scenes[self.header.get("scene", 0)].get("nodes", [])
        poses: dict[int, NDArray[np.float64]] = {}
        open_ends = [(root, np.eye(4)) for root in roots]
        while open_ends:
            number, parent = open_ends.pop()
            if number in poses:
                raise ValueError(f"node {number} hangs on two others, or on itself")
            poses[number] = parent @ _local_pose(nodes[number])
            open_ends += [(child, poses[number]) for child in nodes[number].get("children", [])]
        return poses

    def motions(self) -> dict[str, Motion]:
        """Return the motion of each node that has a mesh and moves, by its name."""
        nodes, rest_poses = self.header.get("nodes", []), self._poses()
        moving_poses = self._moving_poses(rest_poses)
        motions: dict[str, Motion] = {}
        for number in sorted(moving_poses):
            if "mesh" not in nodes[number]:
                continue
            times, poses = moving_poses[number]
            name = str(nodes[number].get("name", number))
            name = f"{name} (node {number})" if name in motions else name
            motions[name] = _make_motion(name, times, poses @ np.linalg.inv(rest_poses[number]))
        return motions

    def _moving_poses(
        self, rest_poses: dict[int, NDArray[np.float64]]
    ) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]:
        """Return times (T,) and transforms to the world (T, 4, 4) of each node that moves."""
        nodes, courses = self.header.get("nodes", []), self._courses()
        parents = {child: up for up in rest_poses for child in nodes[up].get("children", [])}
        moving: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]] = {}
        for number in rest_poses:  # parents come first
            parent, node_courses = parents.get(number), courses.get(number, {})
            parent_motion = None if parent is None else moving.get(parent)
            times = [course[0] for course in node_courses.values()]
            times += [] if parent_motion is None else [parent_motion[0]]
            if not times:
                continue
            node_times = np.unique(np.concatenate(times))
            if parent_motion is not None and np.array_equal(node_times, parent_motion[0]):
                # Else a chain of nodes would take as long as the square of its length.
                poses = parent_motion[1]
            else:
                line = [] if parent is None else [parent]
                while line and line[-1] in parents:
                    line.append(parents[line[-1]])
                poses = np.tile(np.eye(4), (len(node_times), 1, 1))
                for item in reversed(line):
                    poses = poses @ _animate(nodes[item], courses.get(item, {}), node_times)
            moving[number] = node_times, poses @ _animate(nodes[number], node_courses, node_times)
        return moving

    def _courses(self) -> dict[int, dict[str, _Course]]:
        """Return times, values and way of interpolation by node and property."""
        courses: dict[int, dict[str, _Course]] = {}
        for animation in self.header.get("animations", []):
            for channel in animation["channels"]:
                target, sampler = channel["target"], animation["samplers"][channel["sampler"]]
                node, path = target.get("node"), target["path"]
                if node is None or path not in _PROPERTIES:
                    continue
                times = self._numbers(sampler["input"], columns=1)[:, 0]
                values = self._numbers(sampler["output"], columns=_PROPERTIES[path])
                interpolation = sampler.get("interpolation", "LINEAR")
                if interpolation == "CUBICSPLINE":  # value between two tangents
                    values = values[1::3]
                if len(values) != len(times) or not len(times) or (np.diff(times) <= 0).any():
                    raise ValueError(
                        f"an animation of node {node} has {len(times)} times in disorder"
                    )
                courses.setdefault(node, {})[path] = times, values, interpolation
        return courses

    def _surface(self, mesh: int) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        """Return vertices and triangles of all primitives of a mesh."""
        points, faces, count = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0
        for primitive in self.header["meshes"][mesh]["primitives"]:
            mode = primitive.get("mode", _TRIANGLES)
            if mode in _POINTS_AND_LINES:
                continue
            points.append(self._numbers(primitive["attributes"]["POSITION"], columns=3))
            if "indices" in primitive:
                indices = self._numbers(primitive["indices"], columns=1)[:, 0].astype(np.int64)
            else:
                indices = np.arange(len(points[-1]))
            faces.append(_triangles(indices, mode) + count)
            count += len(points[-1])
        return np.concatenate(points), np.concatenate(faces)

    def _numbers(self, number: int, *, columns: int) -> NDArray[np.float64]:
        """Return an accessor's numbers (N, columns): its view or zeros, and sparse values."""
        accessor = self.header["accessors"][number]
        count, kind = accessor["count"], _NUMBERS[accessor["componentType"]]
        if _COLUMNS[accessor["type"]] != columns:
            raise ValueError(f"accessor {number} holds {accessor['type']} where it is used")
        if count > 3 * self.limits.faces:
            raise ValueError(f"accessor {number} states {count} elements")
        values = np.zeros((count, columns))
        if "bufferView" in accessor:
            values[:] = self._view(accessor, kind, count, columns)
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            indices, replaced = sparse["indices"], sparse["values"]
            places = self._view(
                indices, _NUMBERS[indices["componentType"]], sparse["count"], 1, packed=True
            )
            values[places[:, 0]] = self._view(replaced, kind, sparse["count"], columns, packed=True)
        if accessor.get("normalized") and kind[1] != "f":
            values = np.maximum(values / np.iinfo(kind).max, -1.0)
        return values

    def _view(
        self, place: dict[str, Any], kind: str, count: int, columns: int, *, packed: bool = False
    ) -> NDArray[Any]:
        """Return `count` rows of a buffer view, which may lie apart from each other."""
        view = self.header["bufferViews"][place["bufferView"]]
        start = view.get("byteOffset", 0)
        data = memoryview(self.buffers[view["buffer"]])[start : start + view["byteLength"]]
        size = np.dtype(kind).itemsize
        stride = size * columns if packed else view.get("byteStride", size * columns)
        return np.ndarray((count, columns), kind, data, place.get("byteOffset", 0), (stride, size))


_Course = tuple[NDArray[np.float64], NDArray[np.float64], str]
_PROPERTIES = {"translation": 3, "rotation": 4, "scale": 3}
_DEFAULTS = {"translation": (0, 0, 0), "rotation": (0, 0, 0, 1), "scale": (1, 1, 1)}
_MAX_STRETCH = 1e-3  # how far from a rotation what is left of a pose may be


def _animate(
    node: dict[str, Any], courses: dict[str, _Course], times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the transforms of a node to its parent at times (T, 4, 4)."""
    from scipy.spatial.transform import Rotation, Slerp

    if not courses:
        return np.tile(_local_pose(node), (len(times), 1, 1))
    parts = {}
    for path, default in _DEFAULTS.items():
        moments, values, interpolation = courses.get(
            path, (np.zeros(1), np.array([node.get(path, default)], np.float64), "STEP")
        )
        clipped_times = np.clip(times, moments[0], moments[-1])
        if interpolation == "STEP" or len(moments) == 1:
            parts[path] = values[np.searchsorted(moments, clipped_times, side="right") - 1]
        elif path == "rotation":
            parts[path] = Slerp(moments, Rotation.from_quat(values))(clipped_times).as_quat()
        else:
            parts[path] = np.stack([np.interp(clipped_times, moments, v) for v in values.T], axis=1)
    poses = np.tile(np.eye(4), (len(times), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(parts["rotation"]).as_matrix() * parts["scale"][:, None]
    poses[:, :3, 3] = parts["translation"]
    return poses


def _make_motion(name: str, times: NDArray[np.float64], poses: NDArray[np.float64]) -> Motion:
    """Return poses (T, 4, 4) as a motion; ValueError where the node changes its size."""
    from scipy.spatial.transform import Rotation

    matrices = poses[:, :3, :3]
    deviation = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max()
    if not deviation < _MAX_STRETCH:
        raise ValueError(f"{name} changes its size or is sheared while it moves: bodies are rigid")
    rotations = Rotation.from_matrix(matrices).as_quat()[:, [3, 0, 1, 2]]
    return Motion(times=times, positions=poses[:, :3, 3], rotations=rotations)


def _local_pose(node: dict[str, Any]) -> NDArray[np.float64]:
    """Return the transform of a node to its parent, (4, 4)."""
    from scipy.spatial.transform import Rotation  # other formats need not wait for it

    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    pose = np.eye(4)
    rotation = Rotation.from_quat(node.get("rotation", (0, 0, 0, 1))).as_matrix()
    pose[:3, :3] = rotation * np.array(node.get("scale", (1, 1, 1)), dtype=np.float64)
    pose[:3, 3] = node.get("translation", (0, 0, 0))
    return pose


def _triangles(indices: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """Return the triangles (F, 3) of a list, strip or fan of vertices."""
    if mode == _TRIANGLES:
        return indices.reshape(-1, 3)
    if mode == _STRIP:
        return strip_triangles(indices)
    if mode != _FAN:
        raise ValueError(f"a primitive has mode {mode}, and there are 0 to 6")
    first = np.broadcast_to(indices[:1], indices[2:].shape)
    return np.stack([first, indices[1:-1], indices[2:]], axis=1)


def strip_triangles(indices: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the triangles (F, 3) of a strip, in which each vertex makes one with the two before.

    Every other triangle is wound the other way in the strip, and turned here.
    """
    faces = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    faces[1::2] = faces[1::2, ::-1]
    return faces

"""Animation of a scene as a GLB file, on the same clock as its sound.

One node a body, with translation and rotation over time as in section 3.11 of glTF 2.0 (ISO/IEC
12113:2022). In glTF y points up: a root node turns the scene's z axis there.
"""

from __future__ import annotations

import json
import os
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from struck.errors import OptionError
from struck.files.atomic import write_bytes
from struck.model.arrays import AnyArray, Array, checked, require_number
from struck.model.mesh import Mesh
from struck.scene.body import Body, Scene, material_of

COLOURS: dict[str, tuple[float, float, float]] = {  # by group of material
    "metal": (0.72, 0.73, 0.76),
    "glass": (0.70, 0.86, 0.90),
    "ceramic": (0.93, 0.89, 0.82),
    "stone": (0.55, 0.55, 0.53),
    "wood": (0.72, 0.53, 0.33),
    "plastic": (0.83, 0.36, 0.30),
    "other": (0.60, 0.62, 0.66),
}
_FLOAT_TYPE = 5126
_VERTICES = 34962
_Z_UP = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]  # (x, y, z, w): z of the scene to y of glTF


@checked
def save_animation(
    scene: Scene, path: str | os.PathLike[str], *, seconds: float, frames_per_second: float = 60.0
) -> None:
    """Write bodies and their motion to a GLB file, completely or not at all.

    Parameters
    ----------
    scene : Scene
        Moving bodies; those without a surface are left out.
    path : path
        The file, ending in ``.glb``.
    seconds : float
        Duration, s.
    frames_per_second : float, default 60.0
        Rate of the poses, Hz. Viewers interpolate between them.

    Raises
    ------
    OptionError
        If no body has a surface, or a number is out of range.
    FileFormatError
        If the file cannot be written.
    """
    require_number("seconds", seconds, 0.0, 3600.0, above=True, hint="it must exceed 0")
    require_number("frames_per_second", frames_per_second, 1.0, 1000.0, hint="give 1 to 1000")
    visible_bodies = {
        name: body for name, body in scene.bodies.items() if body.model.geometry is not None
    }
    if not visible_bodies:
        raise OptionError("no body of the scene has a surface: there is nothing to show")
    times = np.arange(int(np.floor(seconds * frames_per_second)) + 1) / frames_per_second
    document = _Document()
    for name, body in visible_bodies.items():
        document.add_body(name, body, times)
    write_bytes(path, document.bytes())


def group_of(body: Body) -> str:
    """Return the group of a body's material, "other" where it is unknown."""
    from struck.model.material import materials

    material = material_of(body.model)
    entry = None if material is None else materials().get(material.name)
    return "other" if entry is None else str(entry["group"])


def course_of(body: Body, times: Array) -> tuple[Array, Array]:
    """Return positions (T, 3), m, and rotations (T, 3, 3) of a body at times (T,), s."""
    return body.origin.at(times), body.orientation.at(times)


@dataclass(kw_only=True)
class _Document:
    """A glTF document that grows, and its binary part."""

    _json: dict[str, Any] = field(
        default_factory=lambda: {
            "asset": {"version": "2.0", "generator": "struck"},
            "scene": 0,
            "scenes": [{"nodes": [0]}],
            "nodes": [{"name": "z up", "rotation": _Z_UP, "children": []}],
            "meshes": [],
            "materials": [],
            "animations": [{"name": "motion", "channels": [], "samplers": []}],
            "accessors": [],
            "bufferViews": [],
        }
    )
    _binary: bytearray = field(default_factory=bytearray)
    _meshes: dict[tuple[int, str], int] = field(default_factory=dict)
    _clock: int | None = None

    def add_body(self, name: str, body: Body, times: Array) -> None:
        """Add a body's surface, and its motion where it moves."""
        nodes = self._json["nodes"]
        number = len(nodes)
        positions, rotations = course_of(body, times if body.moves else times[:1])
        node = {"name": name, "mesh": self._mesh(body)}
        node["translation"] = positions[0].tolist()
        node["rotation"] = _compute_quaternions(rotations[:1])[0].tolist()
        nodes.append(node)
        nodes[0]["children"].append(number)
        if body.moves:
            self._animate(number, "translation", positions, times)
            self._animate(number, "rotation", _compute_quaternions(rotations), times)

    def bytes(self) -> bytes:
        """Content of the glTF file."""
        document = dict(self._json)
        if not document["animations"][0]["channels"]:
            del document["animations"]
        document["buffers"] = [{"byteLength": len(self._binary)}]
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        payload = bytes(self._binary)
        length = 12 + 8 + len(text) + 8 + len(payload)
        head = b"glTF" + (2).to_bytes(4, "little") + length.to_bytes(4, "little")
        first = len(text).to_bytes(4, "little") + b"JSON" + text
        return head + first + len(payload).to_bytes(4, "little") + b"BIN\0" + payload

    def _mesh(self, body: Body) -> int:
        """Return the number of a body's surface in the file; equal surfaces are stored once."""
        surface, group = body.model.geometry, group_of(body)
        assert isinstance(surface, Mesh)  # noqa: S101 - the caller has checked
        key = (id(surface), group)
        if key not in self._meshes:
            points = surface.points[surface.faces].reshape(-1, 3).astype("<f4")
            normals = np.repeat(surface.face_normals, 3, axis=0).astype("<f4")
            attributes = {
                "POSITION": self._accessor(points, "VEC3", _VERTICES, bounds=True),
                "NORMAL": self._accessor(normals, "VEC3", _VERTICES),
            }
            primitive = {"attributes": attributes, "material": self._material(group)}
            self._json["meshes"].append({"primitives": [primitive]})
            self._meshes[key] = len(self._json["meshes"]) - 1
        return self._meshes[key]

    def _material(self, group: str) -> int:
        names = [entry["name"] for entry in self._json["materials"]]
        if group not in names:
            metalness = 0.8 if group == "metal" else 0.0
            shade = {
                "baseColorFactor": [*COLOURS[group], 1.0],
                "metallicFactor": metalness,
                "roughnessFactor": 0.5,
            }
            self._json["materials"].append(
                {"name": group, "pbrMetallicRoughness": shade, "doubleSided": True}
            )
            names.append(group)
        return names.index(group)

    def _animate(self, node: int, path: str, values: Array, times: Array) -> None:
        if self._clock is None:
            self._clock = self._accessor(times.astype("<f4"), "SCALAR", None, bounds=True)
        kind = "VEC3" if path == "translation" else "VEC4"
        animation = self._json["animations"][0]
        output = self._accessor(values.astype("<f4"), kind, None)
        sampler = {"input": self._clock, "output": output, "interpolation": "LINEAR"}
        animation["samplers"].append(sampler)
        channel = {"node": node, "path": path}
        animation["channels"].append({"sampler": len(animation["samplers"]) - 1, "target": channel})

    def _accessor(
        self, values: AnyArray, kind: str, target: int | None, *, bounds: bool = False
    ) -> int:
        view: dict[str, Any] = {
            "buffer": 0,
            "byteOffset": len(self._binary),
            "byteLength": values.nbytes,
        }
        if target is not None:
            view["target"] = target
        self._binary += values.tobytes()
        self._json["bufferViews"].append(view)
        accessor: dict[str, Any] = {
            "bufferView": len(self._json["bufferViews"]) - 1,
            "componentType": _FLOAT_TYPE,
            "count": len(values),
            "type": kind,
        }
        if bounds:
            rows = values.reshape(len(values), -1)
            accessor["min"] = rows.min(axis=0).tolist()
            accessor["max"] = rows.max(axis=0).tolist()
        self._json["accessors"].append(accessor)
        return len(self._json["accessors"]) - 1


def _compute_quaternions(rotations: Array) -> Array:
    """Return rotations as (x, y, z, w) of continuous sign (T, 4)."""
    quaternions = Rotation.from_matrix(rotations).as_quat()
    flip_parity = (
        np.cumsum(np.append(False, np.einsum("td,td->t", quaternions[1:], quaternions[:-1]) < 0))
        % 2
    )
    return np.where(flip_parity[:, None] == 1, -quaternions, quaternions)

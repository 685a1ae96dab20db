"""Headers of glTF: what must be true of them before a reader may be trusted with them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any
from urllib.parse import unquote

from struck.errors import MeshError

# Required extensions that leave vertices and faces as the core specification has them.
_HARMLESS = re.compile(r"KHR_(materials|texture|lights)_\w+|EXT_texture_\w+")
_TRIANGLE_FAN = 6


def gltf_header(data: bytes, kind: str) -> dict[str, Any]:
    """Return the header of a glTF or GLB file, and nothing for other formats."""
    if kind == "gltf":
        return json.loads(data)
    if kind == "glb":
        length = int.from_bytes(data[12:16], "little")
        return json.loads(data[20 : 20 + length])
    return {}


def require_core_gltf(header: dict[str, Any]) -> None:
    """Refuse what trimesh would pass over: packed vertices and triangle fans.

    Raises
    ------
    MeshError
        With what the file uses.
    """
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


class Buffers:
    """Buffers outside the file, as trimesh asks for them."""

    def __init__(self, read: Callable[[str], bytes]) -> None:
        self._read = read

    def get(self, name: str) -> bytes:
        """Return the content of one, by its relative address."""
        return self._read(unquote(name))

    __getitem__ = get

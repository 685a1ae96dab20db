"""What a mesh file holds, before any judgement of it as a body."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError
from struck.files.parts import Part

# Squares of lengths, and their sums, must stay within the range of double precision.
_FARTHEST = 1e150
# Below this height over its longest side a triangle is a line but for rounding.
_THINNEST_FACE = 1e-12
_AT_ONCE = 2**16


@dataclass(frozen=True, kw_only=True, eq=False)
class Contents:
    """The parts of a mesh file, all finite and with valid indices.

    Parameters
    ----------
    kind : str
        The format, "obj", "stl", "ply", "off", "glb" or "gltf", of what was packed as well.
    parts : list of Part
        In the file's own order and numbers; each has faces.

    Raises
    ------
    MeshError
        On vertices that are not finite or too far away for arithmetic, indices out of range, no
        faces, or none with an area.
    """

    kind: str
    parts: list[Part]

    def __post_init__(self) -> None:
        for part in self.parts:
            _require_sound(part)
        faces = sum(len(part.faces) for part in self.parts)
        if not faces:
            raise MeshError(
                f"no triangles can be read from it as {self.kind.upper()}: it is empty, truncated "
                "or another format; export the surface again"
            )
        if all(lines.all() for lines in _lines(self.parts)):
            longest = max(float(np.ptp(part.points, axis=0).max()) for part in self.parts)
            raise MeshError(
                f"none of its {faces} faces has an area, and its longest edge is {longest:.3g}: "
                "export the surface again"
            )

    @cached_property
    def degenerate_faces(self) -> int:
        """How many faces have no area, but for rounding."""
        return sum(int(np.count_nonzero(lines)) for lines in _lines(self.parts))

    @cached_property
    def duplicate_faces(self) -> int:
        """How many faces have the corners of one before them, either way round."""
        points = np.concatenate([part.points[part.faces] for part in self.parts]).reshape(-1, 3)
        places = np.unique(points + 0.0, axis=0, return_inverse=True)[1]
        corners = np.sort(places.reshape(-1, 3), axis=1)
        return len(corners) - len(np.unique(corners, axis=0))


def _require_sound(part: Part) -> None:
    wrong = np.count_nonzero(~np.isfinite(part.points).all(axis=1))
    if wrong:
        raise MeshError(
            f"{wrong} of {len(part.points)} vertices are not finite: export the mesh again"
        )
    if not len(part.faces):
        return
    lowest, highest = part.faces.min(), part.faces.max()
    if lowest < 0 or highest >= len(part.points):
        raise MeshError(
            f"faces name vertices {lowest} to {highest} of {len(part.points)}, counted from 0: it "
            "is truncated or damaged; export it again"
        )
    farthest = np.abs(part.points).max()
    if farthest > _FARTHEST:
        raise MeshError(
            f"a vertex is {farthest:.3g} from the origin, and {_FARTHEST:g} can be computed with: "
            "export it again"
        )


def _lines(parts: list[Part]) -> Iterator[NDArray[np.bool_]]:
    """Tell which faces are lines or points, at any scale, so many at a time."""
    for part in parts:
        for start in range(0, len(part.faces), _AT_ONCE):
            corners = part.points[part.faces[start : start + _AT_ONCE]]
            edges = corners - np.roll(corners, 1, axis=1)
            longest = np.abs(edges).max(axis=(1, 2))
            edges /= np.where(longest > 0, longest, 1.0)[:, None, None]
            doubled = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
            yield doubled <= _THINNEST_FACE

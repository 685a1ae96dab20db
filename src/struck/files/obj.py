"""Wavefront OBJ text: vertices, polygons, objects and groups.

Read here, not by trimesh: that takes relative indices from the end of the file, not from where
they stand, takes index 0 as 1, and drops lines it cannot read.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError
from struck.files.parts import Part


def parse_obj(data: bytes) -> Iterator[Part]:
    """Read the objects of an OBJ file, or its groups where it has no several objects.

    Polygons are cut into fans. Texture, normals, materials, lines, points and free-form curves
    are passed over.

    Raises
    ------
    MeshError
        On a line that cannot be read, with its number.
    """
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
    """What the lines so far have said."""

    def __init__(self) -> None:
        self._points: list[tuple[float, ...]] = []
        self._faces: list[tuple[int, ...]] = []
        self._objects: list[str] = []
        self._groups: list[str] = []
        self._object = "default"
        self._group = "default"

    def take(self, words: list[str]) -> None:
        """Take in one line."""
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
        """Return what was read, by object or else by group."""
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

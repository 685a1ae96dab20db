"""Closest points on a triangle surface, and where they lie in its faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.mesh import Mesh

Array = NDArray[np.float64]


class Surface:
    """A triangle surface prepared for many closest-point queries."""

    def __init__(self, mesh: Mesh) -> None:
        import igl

        self._mesh = mesh
        self._points = np.ascontiguousarray(mesh.points)
        self._faces = np.ascontiguousarray(mesh.faces)
        self._tree = igl.AABB()
        self._tree.init(self._points, self._faces)

    def closest(self, points: Array) -> tuple[Array, NDArray[np.int64], Array]:
        """Return distances (K,), faces (K,) and nearest surface points (K, 3)."""
        queries = np.ascontiguousarray(np.atleast_2d(points), dtype=np.float64)
        squared, faces, nearest = self._tree.squared_distance(self._points, self._faces, queries)
        return np.sqrt(np.atleast_1d(squared)), np.atleast_1d(faces), np.atleast_2d(nearest)

    def barycentric(self, points: Array) -> tuple[NDArray[np.int64], Array]:
        """Return the nearest faces (K,) and the weights of their corners (K, 3)."""
        _, faces, nearest = self.closest(points)
        return faces, barycentric(self._points[self._faces[faces]], nearest)


def barycentric(triangles: Array, points: Array) -> Array:
    """Return the weights (K, 3) that make `points` (K, 3) of the corners of `triangles`."""
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    offset = points - triangles[:, 0]
    uu, uv, vv = _dot(first, first), _dot(first, second), _dot(second, second)
    ou, ov = _dot(offset, first), _dot(offset, second)
    area = np.maximum(uu * vv - uv * uv, np.finfo(float).tiny)
    along = np.clip((vv * ou - uv * ov) / area, 0.0, 1.0)
    across = np.clip((uu * ov - uv * ou) / area, 0.0, 1.0 - along)
    return np.stack([1.0 - along - across, along, across], axis=1)


def _dot(left: Array, right: Array) -> Array:
    return np.einsum("kd,kd->k", left, right)

"""Closest points on a triangle surface, and where they lie in its faces."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.model.mesh import Mesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class Closest:
    """Edges or triangles prepared for many closest-point queries.

    Parameters
    ----------
    points : array (N, 3)
    parts : array (P, 2) or (P, 3)
        Numbers of the points at the ends of edges, or corners of triangles.
    """

    def __init__(self, points: Array, parts: Index) -> None:
        import igl

        self._points = np.ascontiguousarray(points)
        self._parts = np.ascontiguousarray(parts)
        self._tree = igl.AABB()
        self._tree.init(self._points, self._parts)

    def closest(self, points: Array) -> tuple[Array, Index, Array]:
        """Return distances (K,), edges or triangles (K,) and the nearest points on them (K, 3)."""
        queries = np.ascontiguousarray(np.atleast_2d(points), dtype=np.float64)
        squared, parts, nearest = self._tree.squared_distance(self._points, self._parts, queries)
        return np.sqrt(np.atleast_1d(squared)), np.atleast_1d(parts), np.atleast_2d(nearest)


class Surface(Closest):
    """A triangle surface prepared for many closest-point queries."""

    def __init__(self, mesh: Mesh) -> None:
        super().__init__(mesh.points, mesh.faces)

    def barycentric(self, points: Array) -> tuple[Index, Array]:
        """Return the nearest faces (K,) and the weights of their corners (K, 3)."""
        _, faces, nearest = self.closest(points)
        return faces, barycentric(self._points[self._parts[faces]], nearest)


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

"""The figurine: a bird, a closed surface around a few rounded parts melted together."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from struck.files.atomic import write_bytes
from struck.model.arrays import Array
from struck.model.mesh import Mesh
from struck.solids.lattice import stuff_body

# Parts as rounded cones from one ball to another: (centre, radius) twice, m.
_PARTS = (
    (((-0.012, 0.0, 0.0), 0.028), ((0.010, 0.0, 0.004), 0.031)),
    (((0.024, 0.0, 0.036), 0.019), ((0.026, 0.0, 0.037), 0.019)),
    (((0.040, 0.0, 0.036), 0.008), ((0.052, 0.0, 0.033), 0.004)),
    (((-0.030, 0.0, 0.006), 0.016), ((-0.066, 0.0, 0.022), 0.008)),
)
_MELT, _FLOOR, _SPACING = 0.012, -0.024, 0.002
_BOUNDS = np.array([(-0.08, -0.035, -0.024), (0.06, 0.035, 0.06)])


def bird() -> Mesh:
    """Return the bird, 13 cm long, standing on a flat base; z points up.

    Returns
    -------
    Mesh
        The surface.
    """
    surface, _ = stuff_body(_depth, _BOUNDS, _SPACING).surface()
    points = surface.points
    for _ in range(4):
        points = points - _depth(points)[:, None] * _gradients(points)
    return Mesh(points=points, faces=surface.faces, up="z")


def written(mesh: Mesh, path: Path) -> Path:
    """Write a surface as an OBJ file and return its path."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.points]
    lines += [f"f {a} {b} {c}" for a, b, c in mesh.faces + 1]
    write_bytes(path, ("\n".join(lines) + "\n").encode("ascii"))
    return path


def _depth(points: Array) -> Array:
    """Return a 1-Lipschitz function, negative inside the bird, m."""
    depth = _cone(points, *_PARTS[0])
    for part in _PARTS[1:]:
        depth = _smooth_minimum(depth, _cone(points, *part))
    return np.maximum(depth, _FLOOR - points[:, 2])


def _cone(points: Array, first: tuple, second: tuple) -> Array:
    """Return the depth in balls swept along a segment, their radius changing linearly."""
    (start, r0), (end, r1) = first, second
    axis = np.subtract(end, start)
    fraction = np.clip((points - start) @ axis / (axis @ axis), 0.0, 1.0)
    length = np.linalg.norm(points - start - fraction[:, None] * axis, axis=1)
    slope = abs(r1 - r0) / np.linalg.norm(axis)
    return (length - r0 - fraction * (r1 - r0)) / np.hypot(1.0, slope)


def _smooth_minimum(a: Array, b: Array) -> Array:
    """Return the smooth minimum of two depths."""
    return np.minimum(a, b) - np.maximum(_MELT - np.abs(a - b), 0.0) ** 2 / (4 * _MELT)


def _gradients(points: Array) -> Array:
    step = 1e-6
    parts = [_depth(points + step * e) - _depth(points - step * e) for e in np.eye(3)]
    gradients = np.stack(parts, axis=1) / (2 * step)
    return gradients / np.maximum(np.square(gradients).sum(axis=1, keepdims=True), 0.25)

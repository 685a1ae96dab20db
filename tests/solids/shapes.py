"""What the tests of meshing measure on tetrahedra."""

from __future__ import annotations

import itertools

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]


def dihedral_angles(points: Array, tetrahedra: Index) -> Array:
    """Return the angles between faces at each edge, degrees (T, 6): arcs around the edge."""
    angles = []
    for first, second in itertools.combinations(range(4), 2):
        third, fourth = sorted({0, 1, 2, 3} - {first, second})
        start = points[tetrahedra[:, first]]
        edge = points[tetrahedra[:, second]] - start
        arms = [points[tetrahedra[:, end]] - start for end in (third, fourth)]
        along = (edge * edge).sum(axis=1, keepdims=True)
        flat = [arm - (arm * edge).sum(axis=1, keepdims=True) / along * edge for arm in arms]
        cosine = (flat[0] * flat[1]).sum(axis=1) / np.prod(
            [np.linalg.norm(each, axis=1) for each in flat], axis=0
        )
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return np.stack(angles, axis=1)


def face_counts(tetrahedra: Index) -> tuple[Index, Index]:
    """Return the distinct faces (F, 3) and how many tetrahedra have each (F,)."""
    every = np.vstack([np.delete(tetrahedra, corner, axis=1) for corner in range(4)])
    return np.unique(np.sort(every, axis=1), axis=0, return_counts=True)


def volumes(points: Array, tetrahedra: Index) -> Array:
    """Return signed volumes (T,)."""
    a, b, c, d = points[tetrahedra].transpose(1, 0, 2)
    return np.einsum("td,td->t", b - a, np.cross(c - a, d - a)) / 6

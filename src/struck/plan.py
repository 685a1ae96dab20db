"""Means over the plan of a flat body: where it is looked at from above."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.model.mesh import Mesh

Array = NDArray[np.float64]

# Radon's rule of 7 points on a triangle, exact to degree 5 (Zienkiewicz 2013, table 3.4).
_ROOT = np.sqrt(15)
_NEAR, _FAR = (6 - _ROOT) / 21, (6 + _ROOT) / 21
_CORNER = np.vstack(
    [np.full((1, 3), 1 / 3)]
    + [np.full((3, 3), part) + (1 - 3 * part) * np.eye(3) for part in (_NEAR, _FAR)]
)
_WEIGHTS = np.concatenate([[9 / 40], np.repeat([(155 - _ROOT) / 1200, (155 + _ROOT) / 1200], 3)])


def plan_rule(surface: Mesh) -> tuple[Array, Array]:
    """Return points on top of a body (Q, 3) and weights (Q,) that average over its plan.

    Each face that looks up counts by the area of its shadow.
    """
    shadows = surface.area_vectors[:, 2]
    top = shadows > 0
    points = np.einsum("qc,fcd->fqd", _CORNER, surface.points[surface.faces[top]])
    weights = np.multiply.outer(shadows[top] / shadows[top].sum(), _WEIGHTS)
    return points.reshape(-1, 3), weights.ravel()

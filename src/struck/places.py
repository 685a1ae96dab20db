"""Names for the outermost places of a surface."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from struck.model.mesh import Mesh

Array = NDArray[np.float64]
_LEVEL = 1e-3


def places_of(mesh: Mesh) -> Mapping[str, Array]:
    """Return "top" and "bottom" along the surface's up axis, and "+x" to "-z", m each (3,)."""
    axes = {f"{sign}{name}": (i, sign) for i, name in enumerate("xyz") for sign in "+-"}
    places = {name: _outermost(mesh, axis, sign) for name, (axis, sign) in axes.items()}
    return places | {"top": places[f"+{mesh.up}"], "bottom": places[f"-{mesh.up}"]}


def _outermost(mesh: Mesh, axis: int, sign: str) -> Array:
    """Return the outermost vertex; on a flat end, the one nearest its middle."""
    height = mesh.points[:, axis] * (1 if sign == "+" else -1)
    ends = mesh.points[height >= height.max() - _LEVEL * mesh.extent]
    return ends[np.argmin(np.linalg.norm(ends - ends.mean(axis=0), axis=1))]

"""Signed distance to a surface, and the body it bounds: solid, or hollow with a wall."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from struck.geometry import Surface
from struck.mesh import Mesh
from struck.solids.tetrahedra import stuffed
from struck.solids.volume import VolumeMesh

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Body:
    """What fills a closed surface: all of it, or a wall inside it.

    Parameters
    ----------
    mesh : Mesh
        Closed surface.
    wall : float, optional
        Thickness of the wall, m; without it the body is solid.
    inset : float
        Depth by which the boundary of a solid body lies inside the surface, m.
    """

    mesh: Mesh
    wall: float | None = None
    inset: float = 0.0

    @cached_property
    def _surface(self) -> Surface:
        return Surface(self.mesh)

    def distance(self, points: Array) -> Array:
        """Return the signed distance to the surface, negative inside, m (K,).

        The sign is that of the winding number (Barill et al. 2018).
        """
        import igl

        winding = igl.fast_winding_number(
            np.ascontiguousarray(self.mesh.points),
            np.ascontiguousarray(self.mesh.faces),
            np.ascontiguousarray(points),
        )
        length, _, _ = self._surface.closest(points)
        return np.where(np.atleast_1d(winding) > _INSIDE, -length, length)

    def depth(self, points: Array) -> Array:
        """Return a 1-Lipschitz function, negative in the material and 0 on its boundary, m (K,)."""
        distance = self.distance(points)
        if self.wall is None:
            return distance + self.inset
        return np.abs(distance + self.wall / 2) - self.wall / 2

    def stuffed(self, spacing: float) -> VolumeMesh:
        """Fill the body with linear tetrahedra on a lattice of `spacing`, m."""
        return stuffed(self.depth, self.mesh.bounds, spacing, self.mesh.up)

    def projected(self, points: Array) -> Array:
        """Return points near the boundary moved onto it along the shortest way."""
        if self.wall is None:
            return self.offset(points, np.full(len(points), self.inset))
        length, _, _ = self._surface.closest(points)
        return self.offset(points, np.where(length > self.wall / 2, self.wall, 0.0))

    def offset(self, points: Array, depths: Array) -> Array:
        """Return points inside the surface moved to the given depths below it, m (K, 3)."""
        length, _, nearest = self._surface.closest(points)
        share = np.divide(depths, length, out=np.zeros_like(length), where=depths > 0)
        return nearest + (points - nearest) * share[:, None]


_INSIDE = 0.5

"""Isosurface stuffing: tetrahedra of good shape in any body (Labelle & Shewchuk 2007).

Lattice points too near the boundary move onto it; tetrahedra that the boundary still cuts are
replaced by their part inside. Several surfaces may bound the body: each cuts in its turn, so a
wall between two of them may be much thinner than the lattice.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from struck.errors import MeshError
from struck.solids.cutting import Cells
from struck.solids.filling.lattice import Lattice
from struck.solids.filling.stuffing import refined
from struck.solids.volume_mesh import VolumeMesh

Array = NDArray[np.float64]
Index = NDArray[np.int64]
# Shares of an edge within which the boundary pulls a lattice point over; long edges join two
# corners or two centres, short ones a corner and a centre (their table 1, safe for all shapes).
_LONG, _SHORT = 0.24999, 0.41189


def stuffed(
    depths: Callable[[Array], Array], bounds: Array, spacing: float, up: str = "z"
) -> VolumeMesh:
    """Fill a body with linear tetrahedra: `cells_in` as a mesh."""
    cells = cells_in(depths, bounds, spacing)
    return VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4", up=up)


def cells_in(
    depths: Callable[[Array], Array], bounds: Array, spacing: float, *, halved: int = 0
) -> Cells:
    """Fill a body with linear tetrahedra, smaller ones where it is slender, creased or cleft.

    Parameters
    ----------
    depths : callable
        1-Lipschitz functions of points (K, 3), all negative in the body, m (K,) or (K, n).
    bounds : array (2, 3)
        Corners of a box around the body, m.
    spacing : float
        Of the lattice, m.
    halved : int
        How many edges may be halved where the lattice is too coarse for the body, twice over.

    Raises
    ------
    MeshError
        When no lattice point lies in the body.
    """
    lattice = Lattice.over(bounds, spacing)
    corners, centres = lattice.sampled(depths)
    tetrahedra = lattice.tetrahedra(corners, centres)
    _require_any(tetrahedra, spacing)
    values = np.concatenate([each.reshape(-1, each.shape[-1]) for each in (corners, centres)])
    numbers, local = np.unique(tetrahedra, return_inverse=True)
    whole = Cells(
        points=lattice.positions(numbers),
        depths=values[numbers],
        tetrahedra=local.reshape(-1, 4),
    )
    fine = refined(whole, depths, shortest=spacing / 5, most=halved)
    cells = _warped(fine, numbers >= corners[..., 0].size)
    for surface in range(values.shape[1]):
        cells = cells.within(surface)
    _require_any(cells.tetrahedra, spacing)
    return cells.compact()


def _require_any(tetrahedra: Index, spacing: float) -> None:
    if not len(tetrahedra):
        raise MeshError(
            f"no point of a lattice of {spacing:.3g} m lies in the body: use a finer one"
        )


def _warped(cells: Cells, is_centre: NDArray[np.bool_]) -> Cells:
    """Move points that a surface passes too near onto the nearest crossing."""
    edges = cells.edges()
    found = [cells.crossings(surface, edges) for surface in range(cells.depths.shape[1])]
    ends = np.concatenate([each.edges.T.ravel() for each in found])
    where = np.concatenate([np.tile(each.points, (2, 1)) for each in found])
    there = np.concatenate([np.tile(each.depths, (2, 1)) for each in found])
    nearness = np.concatenate(
        [np.concatenate([each.share, 1 - each.share]) for each in found]
    ) / np.concatenate([np.tile(_reach(each.edges, is_centre), 2) for each in found])
    bounding = there.max(axis=1, initial=0.0) <= 0  # elsewhere the surface bounds nothing
    order = np.lexsort((nearness, ends))
    order = order[(nearness[order] < 1) & bounding[order]]
    moved, first = np.unique(ends[order], return_index=True)
    points, depths = cells.points.copy(), cells.depths.copy()
    points[moved] = where[order[first]]
    depths[moved] = there[order[first]]
    return Cells(points=points, depths=depths, tetrahedra=cells.tetrahedra)


def _reach(edges: Index, is_centre: NDArray[np.bool_]) -> Array:
    """Return the shares of edges that are safe; points beyond the lattice's own are halfway."""
    known = np.zeros(max(int(edges.max(initial=0)) + 1, len(is_centre)), np.int8)
    known[: len(is_centre)] = np.where(is_centre, 1, -1)
    return np.where(known[edges].prod(axis=1) < 0, _SHORT, _LONG)

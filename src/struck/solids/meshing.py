"""Which elements fill a body, at which spacing, and whether they do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from struck.errors import MeshError, OptionError
from struck.solids.curving import curved, flatness
from struck.solids.distance import Body
from struck.solids.volume import VolumeMesh
from struck.solids.wedges import layered

Array = NDArray[np.float64]
Index = NDArray[np.int64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """How finely a body is filled.

    Parameters
    ----------
    nodes : int
        Nodes to aim at in a solid body.
    most : int
        Nodes not to exceed; a thin wall beyond it gets one layer of wedges.
    spacing_of_wall : float
        Lattice spacing over wall thickness; the wall tears above 0.75.
    triangles : int
        Wedges to aim at in one layer.
    """

    nodes: int
    most: int
    spacing_of_wall: float
    triangles: int


ACCURACIES: Mapping[str, Accuracy] = MappingProxyType(
    {
        "preview": Accuracy(nodes=3_000, most=15_000, spacing_of_wall=0.75, triangles=800),
        "standard": Accuracy(nodes=12_000, most=70_000, spacing_of_wall=0.75, triangles=3_000),
        "fine": Accuracy(nodes=25_000, most=130_000, spacing_of_wall=0.6, triangles=9_000),
    }
)
# Quadratic nodes a lattice cell, in solid bodies and in walls two or three tetrahedra thick.
_NODES_SOLID, _NODES_WALL = 18, 26
# What about 8 GiB hold at any accuracy.
_MOST = 90_000
_LARGEST_VOLUME_ERROR = 0.01
_LARGEST_SPACING_OF_WALL = 0.75
_FINER = (0.75, 0.55)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Filling:
    """Elements of a body with what a person would ask about them.

    Parameters
    ----------
    mesh : VolumeMesh
    path : str
        "stuffing" or "wedges".
    spacing : float
        Lattice, m.
    volume_error : float
        Relative, against the surface's own volume.
    short : int
        Boundary nodes that stayed short of the surface.
    """

    mesh: VolumeMesh
    path: str
    spacing: float
    volume_error: float
    short: int


def accuracy_named(name: str) -> Accuracy:
    """Look an accuracy up; OptionError when there is none of that name."""
    if name not in ACCURACIES:
        raise OptionError(f"accuracy is {name!r}: give one of {', '.join(ACCURACIES)}")
    return ACCURACIES[name]


def filled(body: Body, accuracy: str = "standard") -> Filling:
    """Fill a closed surface, or its wall, with quadratic elements.

    Parameters
    ----------
    body : Body
    accuracy : str
        "preview", "standard" or "fine".

    Raises
    ------
    MeshError
        When the wall is thicker than the body, or the elements cannot follow the body.
    OptionError
        On an unknown accuracy.
    """
    goal = accuracy_named(accuracy)
    area, whole = float(body.mesh.areas.sum()), body.mesh.volume
    volume = whole if body.wall is None else min(whole, area * body.wall)
    thickness = body.wall or 2 * whole / area
    spacing = _spacing(body, volume, thickness, goal)
    if volume * _NODES_WALL / spacing**3 <= goal.most:
        return _stuffing(body, spacing, volume, goal)
    if body.wall is None:
        raise MeshError(
            f"parts about {thickness:.3g} m thick in a body of {body.mesh.extent:.3g} m need more "
            f"than {goal.most} nodes: make a solid of struck.solids instead, or give the outer "
            "surface alone with wall="
        )
    layer = _wedges(body, body.wall, goal)
    complaint = _complaint(layer)
    if not complaint:
        return layer
    if volume * _NODES_WALL / spacing**3 <= _MOST:
        return _stuffing(body, spacing, volume, goal)
    raise MeshError(f"{complaint} in one layer of wedges: {_WAY_OUT}")


def _spacing(body: Body, volume: float, thickness: float, goal: Accuracy) -> float:
    by_nodes = (volume * _NODES_SOLID / goal.nodes) ** (1 / 3)
    share = goal.spacing_of_wall if body.wall is not None else _LARGEST_SPACING_OF_WALL
    return min(share * thickness, by_nodes)


def _material_volume(body: Body, spacing: float) -> float:
    """Return the volume of the material, m^3: a hollow body's less its cavity's."""
    whole = body.mesh.volume
    if body.wall is None:
        return whole
    cavity = Body(mesh=body.mesh, inset=body.wall)
    try:
        inner, _ = curved(cavity.stuffed(spacing), cavity.projected)
    except MeshError:
        raise MeshError(
            f"a wall of {body.wall:g} m leaves no cavity in a body of {body.mesh.extent:.3g} m: "
            "leave wall= out for a solid body, or give a thinner wall"
        ) from None
    return whole - inner.volume()


def _stuffing(body: Body, spacing: float, rough: float, goal: Accuracy) -> Filling:
    """Stuff the body; where a part finer than the lattice tears, try again finer."""
    while True:
        volume = _material_volume(body, spacing)
        mesh, short = curved(body.stuffed(spacing), body.projected)
        filling = _judged(mesh, "stuffing", spacing, volume, short)
        complaint = _complaint(filling)
        if not complaint:
            return filling
        spacing *= 0.75
        if rough * _NODES_WALL / spacing**3 > max(goal.most, _MOST):
            raise MeshError(f"{complaint} on a lattice of {spacing / 0.75:.3g} m: {_WAY_OUT}")


def _wedges(body: Body, wall: float, goal: Accuracy) -> Filling:
    """Fill the wall with one layer; where it folds over, try again finer."""
    # A lattice plane is cut into two triangles a cell at the least.
    spacing = float(np.sqrt(2.0 * body.mesh.areas.sum() / goal.triangles))
    filling = _layer(body, wall, spacing)
    for share in _FINER:
        if not _complaint(filling):
            break
        filling = _layer(body, wall, share * spacing)
    return filling


def _layer(body: Body, wall: float, spacing: float) -> Filling:
    mesh, short = layered(body, wall, spacing)
    return _judged(mesh, "wedges", spacing, _material_volume(body, spacing), short)


def _judged(mesh: VolumeMesh, path: str, spacing: float, volume: float, short: int) -> Filling:
    error = mesh.volume() / volume - 1
    return Filling(mesh=mesh, path=path, spacing=spacing, volume_error=error, short=short)


_WAY_OUT = "use accuracy='fine', a thicker wall, or a smoother surface"


def _complaint(filling: Filling) -> str:
    """Tell what is wrong with the elements, or nothing."""
    folded = int(np.count_nonzero(flatness(filling.mesh) <= 0))
    if folded:
        return f"{folded} of {len(filling.mesh.elements)} elements fold over"
    pieces = piece_count(filling.mesh)
    if pieces > 1:
        return f"the body falls into {pieces} pieces"
    if abs(filling.volume_error) > _LARGEST_VOLUME_ERROR:
        return f"{100 * filling.volume_error:+.1f} % of the volume is missing or too much"
    return ""


def piece_count(mesh: VolumeMesh) -> int:
    """Count the pieces that hang together by faces, not by edges or points only."""
    neighbours = []
    for corners in {len(side) for side in mesh.element.sides}:
        sides = np.array([side for side in mesh.element.sides if len(side) == corners])
        owners = np.repeat(np.arange(len(mesh.elements)), len(sides))
        keys = np.sort(mesh.elements[:, sides].reshape(-1, corners), axis=1)
        order = np.lexsort(keys.T)
        same = (keys[order][1:] == keys[order][:-1]).all(axis=1)
        neighbours.append(np.stack([owners[order][:-1][same], owners[order][1:][same]]))
    first, second = np.hstack(neighbours)
    count = len(mesh.elements)
    graph = sparse.coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
    return int(sparse.csgraph.connected_components(graph, directed=False)[0])

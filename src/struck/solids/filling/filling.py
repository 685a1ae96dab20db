"""Which elements fill a body, at which spacing, and whether they do."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np
from scipy import sparse

from struck.errors import MeshError, OptionError
from struck.model.arrays import Index
from struck.solids.filling.creases import Features, curved, flatness
from struck.solids.filling.lattice import Lattice
from struck.solids.filling.stuffing import Cells, cells_in
from struck.solids.surface.distance import FilledBody, WalledSheet
from struck.solids.volume_mesh import VolumeMesh, side_keys


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """How finely a body is filled."""

    nodes: int  # to begin with
    most: int  # nodes not to exceed
    error: float  # relative, that the frequencies of most modes shall keep

    def coarser(self) -> Accuracy:
        """Return what the error is told by: a third of the nodes."""
        return Accuracy(nodes=self.nodes // 3, most=self.most // 3, error=self.error)


ACCURACIES: Mapping[str, Accuracy] = MappingProxyType(
    {
        "preview": Accuracy(nodes=3_000, most=15_000, error=0.03),
        "standard": Accuracy(nodes=12_000, most=70_000, error=0.005),
        "fine": Accuracy(nodes=25_000, most=130_000, error=0.001),
    }
)
# Quadratic nodes a lattice cell, in solid bodies and in walls two or three tetrahedra thick.
_NODES_SOLID, _NODES_WALL = 18, 26
# Quadratic nodes that halving an edge adds, neighbours included.
_NODES_HALVED = 15
# A solid part thinner than its lattice tears.
_SPACING_OF_SOLID = 0.75
# Spacing over wall at which one layer still bends well; flatter only where nodes run out.
_FLATTEST_LAYER = 8
_LARGEST_VOLUME_ERROR, _LARGEST_COARSE_VOLUME_ERROR = 0.02, 0.05
# Along the longest edge, to find out how deep a body is: few show most cavities.
_SOUNDINGS = (10, 40)
# Crumbs hang by an edge or a corner where the lattice grazes the surface.
_CRUMB = 0.01
# Of the volume, along each edge of a lattice cell.
_SAMPLES_A_CELL = 1.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Filling:
    """Elements of a body with what a person would ask about them."""

    mesh: VolumeMesh
    path: str  # "stuffing"; "one layer" where the lattice is coarser than the wall is thick
    reason: str  # why that path, in figures
    spacing: float  # of the lattice, m
    volume_error: float  # relative, against the body's own volume
    short: int  # boundary nodes that stayed short of the surface
    crumbs: int  # tetrahedra left out because they hung by an edge or a corner


def accuracy_named(name: str) -> Accuracy:
    """Look an accuracy up; OptionError when there is none of that name."""
    if name not in ACCURACIES:
        raise OptionError(f"accuracy is {name!r}: give one of {', '.join(ACCURACIES)}")
    return ACCURACIES[name]


def nodes_allowed(accuracy: str, wanted: int) -> int:
    """Return how many nodes the lattice may make where so many are wanted."""
    goal = accuracy_named(accuracy)
    return min(max(goal.nodes, wanted), goal.most)


def filled(
    body: FilledBody | WalledSheet, accuracy: str = "standard", *, nodes: int = 0
) -> Filling:
    """Fill a closed surface, its wall, or a sheet's wall, with curved quadratic tetrahedra."""
    # `nodes`: more than the accuracy begins with, as far as it allows.
    goal = accuracy_named(accuracy)
    _require_cavity(body)
    wanted = nodes_allowed(accuracy, nodes)
    # Creases, clefts and slender parts may take as many again: how many, only filling tells.
    begun = min(wanted, goal.most // 2)
    filling = _filled(body, _spacing(body, begun, goal), goal)
    left = min(wanted, begun * goal.most // len(filling.mesh.nodes))
    return _refilled(body, filling, left, goal) if left > begun else filling


def filled_coarsely(
    body: FilledBody | WalledSheet, accuracy: str = "standard"
) -> tuple[Filling, ...]:
    """Fill a body with about a third of the nodes; return nothing when so few cannot follow it."""
    goal = accuracy_named(accuracy).coarser()
    _require_cavity(body)
    spacing = spacing_for(body, goal.nodes)
    if nodes_for(body, spacing) > goal.most:
        return ()
    filling = _stuffing(body, spacing, goal)
    return () if _complaint(filling, _LARGEST_COARSE_VOLUME_ERROR) else (filling,)


def spacing_for(body: FilledBody | WalledSheet, nodes: int) -> float:
    """Return the lattice spacing that makes about so many nodes, m."""
    volume, thickness = _rough_volume(body), body.thickness
    if _is_solid(body):
        return min(_SPACING_OF_SOLID * thickness, (volume * _NODES_SOLID / nodes) ** (1 / 3))
    thick = (volume * _NODES_WALL / nodes) ** (1 / 3)
    thin = (volume * _NODES_WALL / nodes / thickness) ** (1 / 2)
    return thick if thick < thickness else thin


def nodes_for(body: FilledBody | WalledSheet, spacing: float) -> float:
    """Return about how many nodes a lattice makes."""
    cell = spacing**2 * (spacing if _is_solid(body) else min(spacing, body.thickness))
    return _rough_volume(body) * _NODES_WALL / cell


def _is_solid(body: FilledBody | WalledSheet) -> bool:
    return isinstance(body, FilledBody) and body.wall is None


def _rough_volume(body: FilledBody | WalledSheet) -> float:
    if isinstance(body, WalledSheet):
        return float(body.mesh.areas.sum()) * body.wall
    whole = body.mesh.volume
    return whole if body.wall is None else min(whole, float(body.mesh.areas.sum()) * body.wall)


def _spacing(body: FilledBody | WalledSheet, nodes: int, goal: Accuracy) -> float:
    """Return the spacing that makes about so many nodes, or more where a layer were too flat."""
    spacing = spacing_for(body, nodes)
    if _is_solid(body):
        return spacing
    return min(spacing, max(_FLATTEST_LAYER * body.thickness, spacing_for(body, goal.most)))


def _require_cavity(body: FilledBody | WalledSheet) -> None:
    """Refuse a wall so thick that it fills the body."""
    if isinstance(body, WalledSheet) or body.wall is None:
        return
    deepest = 0.0
    for soundings in _SOUNDINGS:
        corners, centres = Lattice.over(body.bounds, body.mesh.extent / soundings).sampled(
            body.distance
        )
        deepest = -min(float(corners.min()), float(centres.min()))
        if deepest > body.wall:
            return
    raise MeshError(
        f"a wall of {body.wall:g} m leaves no cavity in a body of {body.mesh.extent:.3g} m, "
        f"{deepest:.3g} m deep: leave wall= out for a solid body, or give a thinner wall"
    )


def _filled(body: FilledBody | WalledSheet, spacing: float, goal: Accuracy) -> Filling:
    """Fill the body; where a part finer than the lattice tears, try again finer."""
    if nodes_for(body, spacing) > goal.most:
        raise MeshError(
            f"parts about {body.thickness:.3g} m thick in a body of {body.mesh.extent:.3g} m need "
            f"more than {goal.most} nodes: make a solid of struck.solids instead, or give the "
            "outer surface alone with wall="
        )
    while True:
        filling = _stuffing(body, spacing, goal)
        complaint = _complaint(filling, _LARGEST_VOLUME_ERROR)
        if not complaint:
            return filling
        spacing *= 0.75
        if nodes_for(body, spacing) > goal.most:
            raise MeshError(
                f"{complaint} on a lattice of {filling.spacing:.3g} m: use accuracy='fine', a "
                "thicker wall, or a smoother surface"
            )


def _refilled(
    body: FilledBody | WalledSheet, filling: Filling, nodes: int, goal: Accuracy
) -> Filling:
    """Fill a body again with more nodes, or leave it as it is where these do not serve."""
    spacing = _spacing(body, nodes, goal)
    finer = _stuffing(body, spacing, goal) if spacing < filling.spacing else filling
    fits = len(finer.mesh.nodes) <= goal.most and not _complaint(finer, _LARGEST_VOLUME_ERROR)
    return finer if fits else filling


def _stuffing(body: FilledBody | WalledSheet, spacing: float, goal: Accuracy) -> Filling:
    halved = int(max(goal.most - nodes_for(body, spacing), 0) / _NODES_HALVED)
    cells, crumbs = _whole(cells_in(body.depths, body.bounds, spacing, halved=halved))
    features = Features(mesh=body.mesh) if isinstance(body, FilledBody) else None
    mesh, short = curved(cells, body.onto, body.mesh.up, features)
    thin = not _is_solid(body) and spacing > body.thickness
    relation = "thicker" if spacing < body.thickness else "thinner"
    what = "body" if _is_solid(body) else "wall"
    return Filling(
        mesh=mesh,
        path="one layer" if thin else "stuffing",
        reason=f"the {what} of {body.thickness:.3g} m is {relation} than the lattice",
        spacing=spacing,
        volume_error=mesh.volume() / body.volume(spacing / _SAMPLES_A_CELL) - 1,
        short=short,
        crumbs=crumbs,
    )


def _whole(cells: Cells) -> tuple[Cells, int]:
    """Leave out pieces that are nothing but crumbs, and count their tetrahedra."""
    mesh = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4")
    labels = pieces_of(mesh)
    sizes = np.bincount(labels)
    crumbs = sizes[labels] < _CRUMB * len(labels)
    if not crumbs.any():
        return cells, 0
    return replace(cells, tetrahedra=cells.tetrahedra[~crumbs]).compact(), int(crumbs.sum())


def _complaint(filling: Filling, largest: float) -> str:
    """Tell what is wrong with the elements, or nothing."""
    folded = int(np.count_nonzero(flatness(filling.mesh) <= 0))
    if folded:
        return f"{folded} of {len(filling.mesh.elements)} elements fold over"
    pieces = piece_count(filling.mesh)
    if pieces > 1:
        return f"the body falls into {pieces} pieces"
    if abs(filling.volume_error) > largest:
        return f"{100 * filling.volume_error:+.1f} % of the volume is missing or too much"
    return ""


def piece_count(mesh: VolumeMesh) -> int:
    """Count the pieces that hang together by faces, not by edges or points only."""
    return int(pieces_of(mesh).max()) + 1


def pieces_of(mesh: VolumeMesh) -> Index:
    """Return the number of the face-connected piece of each element (E,)."""
    neighbours = []
    for corners in {len(side) for side in mesh.element.sides}:
        sides = np.array([side for side in mesh.element.sides if len(side) == corners])
        owners = np.repeat(np.arange(len(mesh.elements)), len(sides))
        keys = side_keys(mesh.elements[:, sides].reshape(-1, corners), len(mesh.nodes))
        order = np.argsort(keys, kind="stable")
        same = keys[order][1:] == keys[order][:-1]
        neighbours.append(np.stack([owners[order][:-1][same], owners[order][1:][same]]))
    first, second = np.hstack(neighbours)
    count = len(mesh.elements)
    graph = sparse.coo_array((np.ones(len(first)), (first, second)), shape=(count, count))
    return sparse.csgraph.connected_components(graph, directed=False)[1].astype(np.int64)

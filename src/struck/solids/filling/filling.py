"""Curved tetrahedra that fill a body: their spacing, their curved sides, the crisp edges kept."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.spatial import KDTree

from struck.errors import MeshError, rounded
from struck.model.arrays import Array, Index, Mask
from struck.model.mesh import Closest, Mesh, Surface
from struck.model.mesh_topology import components, edges_of
from struck.solids.lattice import (
    Cells,
    Lattice,
    NoCellsError,
    cells_in,
    determinants,
    shape_of,
)
from struck.solids.resolution import level
from struck.solids.surface.distance import THINNEST, FilledBody, WalledSheet
from struck.solids.volume_mesh import FUNCTIONS_A_NODE, VolumeMesh, unique_rows

if TYPE_CHECKING:
    from struck.solids.filling.thin_walls import ThinBody


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """Number of nodes and layers with which a body is filled."""

    nodes: int  # to begin with
    most: int  # nodes not to exceed
    thin: int  # nodes, or functions of cubic elements, not to exceed in thin bodies
    crowded: int  # functions of cubic elements beyond which needless cuts are undone
    error: float  # relative, that the frequencies of most modes shall keep

    def coarser(self) -> Accuracy:
        """Return an accuracy with a third of the nodes, for estimates of the mesh's error."""
        return replace(self, nodes=self.nodes // 3, most=self.most // 3, thin=self.thin // 3)


ACCURACIES: Mapping[str, Accuracy] = MappingProxyType(
    {
        "preview": Accuracy(nodes=3_000, most=15_000, thin=30_000, crowded=30_000, error=0.03),
        "standard": Accuracy(nodes=12_000, most=70_000, thin=100_000, crowded=100_000, error=0.005),
        "fine": Accuracy(nodes=25_000, most=130_000, thin=180_000, crowded=180_000, error=0.001),
    }
)
# Functions a cell: solid, in a wall of 2 or 3 elements, in a wall of one element with cubics.
_NODES_SOLID, _NODES_WALL, _NODES_LAYER = 18, 26, 80
_NODES_HALVED = 15  # quadratic nodes that halving an edge adds, neighbours included
_SOLID = 2.0  # times the nodes to begin with, up to which a body is filled as a solid one
# Spacing over wall below which several layers take no more than one: between, cuts crowd.
_SEVERAL = 0.7
# Spacing over wall at which one layer bends well, quadratic or cubic; more if nodes run out.
_FLATTEST_LAYER, _FLATTEST_CUBIC = 8, 20
_LARGEST_VOLUME_ERROR, _LARGEST_COARSE_VOLUME_ERROR = 0.02, 0.05
_PLACES = 5_000  # on a surface, where elements are looked for
_LARGEST_UNREACHED = 0.02  # of the surface, or a part as large as a handle is missing
_TWISTLESS, _FOLLOWED = 0.315, 4.0  # thicknesses
_SOUNDINGS = (10, 40)  # along the longest edge, for the depth of a body: few show most cavities
_CRUMB = 0.01  # share of tetrahedra that hang by an edge or a corner where the lattice grazes
_CUT, _FINER = 2.0, 2.0  # of forecasts: cells that the surface cuts; fine over coarse nodes
_HALVED = 1_000  # edges of a lattice over thin walls that may be halved at least
_MOST_FUNCTIONS = 400_000  # whatever the accuracy: more takes minutes and many GiB
_SLACK = 1.1  # times the most, where a lattice turns out to take a little more than foreseen
_COARSER = 3  # lattices tried where walls take more functions than foreseen
_FINER_LATTICE, _A_LITTLE = 0.75, 0.9  # spacing over the one before, where that did not serve
_OF_VOLUME = 0.4  # error of the volume over that of frequencies that is aimed at
_SAMPLES_A_CELL = 1.5  # of the volume, along each edge of a lattice cell


Body: TypeAlias = "FilledBody | WalledSheet | ThinBody"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Filling:
    """Elements of a body, with the method that made them and measures of their quality."""

    mesh: VolumeMesh
    path: str  # "stuffing"; "one layer" where the lattice is coarser than walls are thick
    reason: str  # why that path, in figures
    spacing: float  # of the lattice, m
    volume_error: float  # relative, against the body's own volume
    stiffened: float  # relative, of frequencies, by what elements miss along a thin body's edges
    short: int  # boundary nodes that stayed short of the surface
    unreached: float  # share of the surface that is farther from all elements than the lattice
    crumbs: int  # tetrahedra left out because they hung by an edge or a corner

    @property
    def references(self) -> tuple[str, ...]:
        """Sources of cubic displacements, where there are any."""
        return ("szabo1991",) if self.mesh.cubic else ()


def accuracy_named(name: str) -> Accuracy:
    """Look an accuracy up; OptionError when there is none of that name."""
    level(name)
    return ACCURACIES[name]


def nodes_allowed(accuracy: str, wanted: int) -> int:
    """Return the largest number of nodes that the lattice may make for a number `wanted`."""
    goal = accuracy_named(accuracy)
    return min(max(goal.nodes, wanted), goal.most)


def nodes_expected(given: FilledBody | WalledSheet, accuracy: str) -> tuple[float, float]:
    """Return about how many nodes a coarse filling, 0 if none follows the body, and a fine have."""
    goal = accuracy_named(accuracy)
    body, goal = _as_it_is(given, goal)
    few = goal.coarser()
    spacing = spacing_for(body, few.nodes)
    coarse = _crowded(body, spacing) if nodes_for(body, spacing) <= few.most else 0.0
    fine = _crowded(body, _spacing(body, min(goal.nodes, goal.most // 2), goal))
    return coarse, min(max(fine, _FINER * coarse), goal.most)


def _crowded(body: Body, spacing: float) -> float:
    """Return about how many nodes a lattice makes with the cells that its surface cuts."""
    shares = spacing / body.thickness if body.is_solid else 1.0
    return nodes_for(body, spacing) * (1 + shares) / _CUT


def filled(
    given: FilledBody | WalledSheet, accuracy: str = "standard", *, nodes: int = 0
) -> Filling:
    """Fill a closed surface, its wall, or a sheet's wall, with curved quadratic tetrahedra."""
    # `nodes`: more than the accuracy begins with, as far as it allows.
    goal = accuracy_named(accuracy)
    _require_cavity(given)
    wanted = nodes_allowed(accuracy, nodes)
    body, goal = _as_it_is(given, goal)
    # Creases, clefts and slender parts may take as many again: how many, only filling tells.
    begun = min(wanted, goal.most // 2)
    filling = _filled(body, _spacing(body, begun, goal), goal)
    left = min(wanted, begun * goal.most // filling.mesh.functions)
    if left > begun:
        filling = _refilled(body, filling, _spacing(body, left, goal), goal)
    if not body.is_solid and not body.both_faces:
        return filling
    if not body.is_solid and filling.mesh.functions > goal.most:
        filling = _fewer(body, filling, left, goal)
    return _shaped(body, filling, goal)


def filled_coarsely(
    given: FilledBody | WalledSheet, accuracy: str = "standard"
) -> tuple[Filling, ...]:
    """Fill a body with about a third of the nodes; return () when so few cannot follow it."""
    goal = accuracy_named(accuracy)
    _require_cavity(given)
    body, goal = _as_it_is(given, goal)
    goal = goal.coarser()
    spacing = spacing_for(body, goal.nodes)
    while nodes_for(body, spacing) <= goal.most:
        filling = _stuffing(body, spacing, goal)
        if not _complaint(filling, _LARGEST_COARSE_VOLUME_ERROR):
            return (filling,)
        if body.is_solid:
            break
        spacing *= _FINER_LATTICE
    return ()


def _as_it_is(body: FilledBody | WalledSheet, goal: Accuracy) -> tuple[Body, Accuracy]:
    """Return a solid as a thin body where a lattice that it would not tear takes many nodes."""
    if not isinstance(body, FilledBody):
        from struck.solids.filling.thin_walls import with_both_faces

        body = with_both_faces(body) or body
    elif body.wall is not None:
        from struck.solids.filling.thin_walls import with_inner_face

        body = with_inner_face(body) or body
    if not isinstance(body, FilledBody) or not body.is_solid:
        return body, goal
    thin = nodes_for(body, THINNEST * body.thickness) > _SOLID * goal.nodes
    if not thin:
        return body, goal
    from struck.solids.filling.thin_walls import ThinBody  # few bodies need it

    return ThinBody(solid=body), replace(goal, most=goal.thin)


def spacing_for(body: Body, nodes: int) -> float:
    """Return the lattice spacing that makes about the given number of nodes, m."""
    volume, thickness = body.rough_volume, body.thickness
    if body.is_solid:
        return min(THINNEST * thickness, (volume * _NODES_SOLID / nodes) ** (1 / 3))
    thick = (volume * _NODES_WALL / nodes) ** (1 / 3)
    layer = _NODES_LAYER if body.both_faces else _NODES_WALL
    thin = (volume * layer / nodes / thickness) ** (1 / 2)
    return thick if thick < _SEVERAL * thickness else max(thin, thickness)


def nodes_for(body: Body, spacing: float) -> float:
    """Return about how many nodes, or as many functions, a lattice makes."""
    thin = not body.is_solid and spacing > _SEVERAL * body.thickness
    cell = spacing**2 * (body.thickness if thin else spacing)
    return body.rough_volume * (_NODES_LAYER if thin and body.both_faces else _NODES_WALL) / cell


def _spacing(body: Body, nodes: int, goal: Accuracy) -> float:
    """Return the spacing for about a number of nodes, smaller where a layer would be too flat."""
    spacing = spacing_for(body, nodes)
    if body.is_solid:
        return spacing
    flattest = _FLATTEST_CUBIC if body.both_faces else _FLATTEST_LAYER
    return min(spacing, max(flattest * body.thickness, spacing_for(body, goal.most)))


def _require_cavity(body: FilledBody | WalledSheet) -> None:
    """Refuse a wall so thick that it fills the body."""
    if isinstance(body, WalledSheet) or body.wall is None:
        return
    deepest = 0.0
    for soundings in _SOUNDINGS:
        # Of both faces of the wall, since values are exact near one of them alone.
        sampled = Lattice.over(body.bounds, body.mesh.extent / soundings).sampled(body.depths)
        deepest = max(deepest, *(body.wall + float(each[..., 1].max()) for each in sampled))
        if deepest > body.wall:
            return
    raise MeshError(
        f"a wall of {body.wall:g} m leaves no cavity in a body of {rounded(body.mesh.extent, 3)} "
        f"m, {rounded(deepest, 3)} m deep: leave wall= out for a solid body, or give a thinner wall"
    )


def _filled(body: Body, spacing: float, goal: Accuracy) -> Filling:
    """Fill the body; where a part finer than the lattice tears, try again finer."""
    if nodes_for(body, spacing) > goal.most:
        raise MeshError(
            f"parts about {rounded(body.thickness, 3)} m thick in a body of "
            f"{rounded(body.mesh.extent, 3)} m need more than {goal.most} nodes: use "
            f"{_next_accuracy(goal)}a solid of struck.solids, or the outer surface alone with wall="
        )
    while True:
        try:
            filling = _stuffing(body, spacing, goal)
        except NoCellsError as error:
            complaint = str(error)
        else:
            if not (complaint := _complaint(filling, _LARGEST_VOLUME_ERROR)):
                return filling
            complaint += f" on a lattice of {rounded(spacing, 3)} m"
        spacing *= _FINER_LATTICE
        if nodes_for(body, spacing) > goal.most:
            goal = replace(goal, most=goal.thin)  # a neck or a handle takes as many as a thin body
        if nodes_for(body, spacing) > goal.most:
            other = "the outer surface alone with wall=" if body.both_faces else "a thicker wall"
            raise MeshError(
                f"{complaint}: use {_next_accuracy(goal)}{other}, a smoother surface, or for rods "
                "and rings a solid of struck.solids"
            )


def _next_accuracy(goal: Accuracy) -> str:
    """Return the option that asks for the next finer accuracy, or "" at the finest."""
    finer = next((name for name, other in ACCURACIES.items() if other.thin > goal.thin), None)
    return f"accuracy='{finer}', " if finer else ""


def _refilled(body: Body, filling: Filling, spacing: float, goal: Accuracy) -> Filling:
    """Fill a body again on a finer lattice, or leave it as it is where that does not serve."""
    finer = _stuffing(body, spacing, goal) if spacing < filling.spacing else filling
    fits = finer.mesh.functions <= _SLACK * goal.most and not _complaint(
        finer, _LARGEST_VOLUME_ERROR
    )
    return finer if fits else filling


def _fewer(body: Body, filling: Filling, nodes: int, goal: Accuracy) -> Filling:
    """Fill a thin body on coarser lattices until it takes about as many functions as it may."""
    for _ in range(_COARSER):
        coarser = _stuffing(body, _spacing(body, nodes, goal), goal)
        fewer = coarser.mesh.functions < filling.mesh.functions
        filling = coarser if fewer and not _complaint(coarser, _LARGEST_VOLUME_ERROR) else filling
        if filling.mesh.functions <= _SLACK * goal.most:
            break
        nodes = nodes * goal.most // coarser.mesh.functions
    return filling


def _shaped(body: Body, filling: Filling, goal: Accuracy) -> Filling:
    """Fill a body finer until its shape costs less than the error that is aimed at."""
    # Lattices that differ little may miss very different shares of a crisp solid's edges.
    spacing = filling.spacing
    while abs(filling.volume_error) > _OF_VOLUME * goal.error:
        spacing *= _A_LITTLE if body.is_solid else _FINER_LATTICE
        if nodes_for(body, spacing) > goal.most:
            break
        finer = _refilled(body, filling, spacing, goal)
        better = abs(finer.volume_error) < abs(filling.volume_error)
        filling = finer if better else filling
    return filling


def _stuffing(body: Body, spacing: float, goal: Accuracy) -> Filling:
    thin = not body.is_solid and spacing > body.thickness  # one layer of elements in walls
    widest = body.widest(spacing) if isinstance(body, FilledBody) else None
    most = goal.thin if widest else goal.most  # a slender part may take what a thin body takes
    halved = max(most - nodes_for(body, spacing), 0) / _NODES_HALVED
    cubic = thin and body.both_faces
    if cubic:
        halved = max(halved / FUNCTIONS_A_NODE, _HALVED)
    seen = body.at(spacing)
    found = cells_in(
        seen.depths, seen.bounds, spacing, halved=int(halved), judge=seen.judge, widest=widest
    )
    functions = FUNCTIONS_A_NODE * (len(found.points) + len(found.edges())) if cubic else 0.0
    if functions > _SLACK * goal.crowded:
        from struck.solids.filling.membership import mended  # few bodies need it

        found = mended(found)
    cells, crumbs = _whole(found)
    features = None if isinstance(body, WalledSheet) else Features(mesh=body.mesh)
    mesh, short = curved(cells, seen.onto, body.mesh.up, opposed=seen.opposed, features=features)
    relation = "thicker" if spacing < body.thickness else "thinner"
    what = "body" if body.is_solid else "wall"
    return Filling(
        mesh=replace(mesh, cubic=cubic),
        path="one layer" if thin else "stuffing",
        reason=f"the {what} of {rounded(body.thickness, 3)} m is {relation} than the lattice",
        spacing=spacing,
        volume_error=mesh.volume() / seen.volume(spacing / _SAMPLES_A_CELL) - 1,
        stiffened=_stiffened(body, spacing),
        short=short,
        unreached=_uncovered_share(body.mesh, mesh, spacing),
        crumbs=crumbs,
    )


def _stiffened(body: Body, spacing: float) -> float:
    """Return the relative error of frequencies by twist that flat elements miss at thin edges."""
    if isinstance(body, FilledBody | WalledSheet):
        return 0.0
    # Within about a thickness h of an edge twist has no moment to bear: a strip of width b twists
    # as one narrower by 0.315 h at either edge (Timoshenko & Goodier, section 109). Of that a
    # lattice of r thicknesses misses about (r / (r + 4))^4, as found on plates.
    width = spacing / body.thickness
    return _TWISTLESS * body.solid.rims * (width / (width + _FOLLOWED)) ** 4


def _uncovered_share(outline: Mesh, elements: VolumeMesh, spacing: float) -> float:
    """Return the share of a surface's area that no element is within a lattice spacing of."""
    places, vectors = outline.spread(_PLACES)
    areas = np.linalg.norm(vectors, axis=1)
    # Sides have a node every half spacing, and nodes are found in a third of the time.
    return float(areas[KDTree(elements.nodes).query(places)[0] > spacing].sum() / areas.sum())


def _whole(cells: Cells) -> tuple[Cells, int]:
    """Leave out crumbs, pieces of a few tetrahedra, and count their tetrahedra."""
    mesh = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4")
    labels = pieces_of(mesh)
    sizes = np.bincount(labels)
    crumbs = sizes[labels] < _CRUMB * len(labels)
    if not crumbs.any() or crumbs.all():  # many crumbs are no body: it falls into pieces
        return cells, 0
    return replace(cells, tetrahedra=cells.tetrahedra[~crumbs]).compact(), int(crumbs.sum())


def _complaint(filling: Filling, largest: float) -> str:
    """Return the fault of the elements as a message, empty if there is none."""
    if filling.mesh.functions > _MOST_FUNCTIONS:
        return f"walls cross so closely that they take {filling.mesh.functions} functions"
    folded = int(np.count_nonzero(flatness(filling.mesh) <= 0))
    if folded:
        return f"{folded} of {len(filling.mesh.elements)} elements fold over"
    pieces = piece_count(filling.mesh)
    if pieces > 1:
        return f"the body falls into {pieces} pieces"
    if abs(filling.volume_error) > largest:
        return f"{100 * filling.volume_error:+.1f} % of the volume is missing or too much"
    if filling.unreached > _LARGEST_UNREACHED:
        return f"parts with {100 * filling.unreached:.0f} % of the surface have no elements"
    return ""


def piece_count(mesh: VolumeMesh) -> int:
    """Count the pieces that hang together by faces, not by edges or points only."""
    return int(pieces_of(mesh).max()) + 1


def pieces_of(mesh: VolumeMesh) -> Index:
    """Return the number of the face-connected piece of each element (E,)."""
    return components(mesh.neighbours(), len(mesh.elements))


# Curved sides: straight-sided quadratic tetrahedra are worse than linear hexahedra on curved walls,
# so boundary nodes move onto the true surface as far as no element folds over.

Surfaces = tuple[int, ...]  # one surface, or two for what lies halfway between them
Onto = Callable[[Surfaces, Array], Array]
_FLATTEST = 0.02  # least over mean Jacobian determinant of an element
_LEAST_SHAPE = 0.05  # of a tetrahedron after moving, unless half as flat as it was
_HALVINGS = 3
_CHUNK = 4096


def curved(
    cells: Cells,
    onto: Onto,
    up: str = "z",
    *,
    opposed: Iterable[tuple[int, int]] = (),
    features: Features | None = None,
) -> tuple[VolumeMesh, int]:
    """Return quadratic tetrahedra bent onto the surfaces, and how many nodes stay short of them."""
    # Depths of 0 tell near which surface a node lies; `onto` moves points (K, 3) onto a surface, or
    # halfway between two that are `opposed`. The `features` are the crisp edges of all.
    linear = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4", up=up)
    surfaces = range(cells.depths.shape[1])
    on: dict[Surfaces, Mask] = {(number,): cells.depths[:, number] == 0 for number in surfaces}
    linear, held = _moved(linear, on, onto)
    linear = linear if features is None else features.kept(linear, _any(on))
    quadratic = linear.promoted()
    result, short = _moved(quadratic, _middles(quadratic, on, opposed), onto)
    return result, held + short


def _middles(
    mesh: VolumeMesh, on: dict[Surfaces, Mask], opposed: Iterable[tuple[int, int]]
) -> dict[Surfaces, Mask]:
    """Return which mid-edge nodes of the boundary, or of a wall's edges, are near a surface."""
    # Edges through a thin wall must bow as its faces do, or the faces would pass them.
    found = {surface: np.zeros(len(mesh.nodes), bool) for surface in on}
    for sides in mesh.boundary_sides():
        corners, middles = sides[:, :3], sides[:, 3:]
        for surface, flags in on.items():
            along = flags[corners] & flags[np.roll(corners, -1, axis=1)]
            found[surface][middles[along]] = True
    first, second = mesh.elements[:, np.array(mesh.element.edges)].transpose(2, 0, 1)
    middles = mesh.elements[:, len(mesh.element.corners) :]
    for pair in opposed:
        one, other = on[pair[:1]], on[pair[1:]]
        through = (one[first] & other[second]) | (other[first] & one[second])
        found[pair] = np.zeros(len(mesh.nodes), bool)
        found[pair][middles[through]] = True
    return found


def _any(on: dict[Surfaces, Mask]) -> Mask:
    return np.asarray(np.any(list(on.values()), axis=0))


def _ways(mesh: VolumeMesh, on: dict[Surfaces, Mask], onto: Onto) -> Array:
    """Return how far each node is from the surfaces it belongs on, one after the other (N, 3)."""
    goal = mesh.nodes.copy()
    for surface, flags in on.items():
        goal[flags] = onto(surface, goal[flags])
    return goal - mesh.nodes


def _moved(mesh: VolumeMesh, on: dict[Surfaces, Mask], onto: Onto) -> tuple[VolumeMesh, int]:
    """Move nodes onto their surfaces, or part of the way where elements would fold."""
    way = _ways(mesh, on, onto)
    least = np.minimum(_LEAST_SHAPE, shapes(mesh) / 2)
    share, halvings = _any(on).astype(float), 0
    flat, stirred = np.zeros(len(mesh.elements), bool), share > 0
    while True:
        nodes = mesh.nodes + share[:, None] * way
        again = np.flatnonzero(stirred[mesh.elements].any(axis=1))
        moved = replace(mesh, nodes=nodes)
        flat[again] = flatness(moved, again) < _FLATTEST
        flat[again] |= shapes(moved, again) < least[again]
        stirred = np.zeros(len(share), bool)
        stirred[mesh.elements[flat]] = True
        stirred &= share > 0
        if not stirred.any():
            break
        share[stirred] *= 0.5 if halvings < _HALVINGS else 0.0
        halvings += 1
    return replace(mesh, nodes=nodes), int(np.count_nonzero(share[_any(on)] < 1))


def flatness(mesh: VolumeMesh, chosen: Index | slice = slice(None)) -> Array:
    """Return least over mean Jacobian determinant of elements (E,): 1 straight, below 0 folded."""
    points = np.vstack([mesh.element.nodes, mesh.element.mass_rule.points])
    gradients = mesh.element.gradients(points).transpose(2, 1, 0)
    elements = mesh.elements[chosen]
    parts = []
    for start in range(0, len(elements), _CHUNK):
        corners = mesh.nodes[elements[start : start + _CHUNK]].transpose(2, 0, 1)
        found = determinants(corners[:, None] @ gradients)
        mean = np.abs(found).mean(axis=1)
        parts.append(found.min(axis=1) / np.maximum(mean, np.finfo(float).tiny))
    return np.concatenate(parts) if parts else np.empty(0)


def shapes(mesh: VolumeMesh, chosen: Index | slice = slice(None)) -> Array:
    """Return the volume of tetrahedra over that of regular ones with edges as long (E,)."""
    return shape_of(mesh.nodes[mesh.corners[chosen]])


# Crisp edges: a lattice bevels convex ones and fills concave ones by a share of its spacing, which
# costs volume and shifts frequencies.

_CRISP = 40.0  # angle between the normals of two faces with a crisp edge between them, degrees
_WORST = 0.03  # shape of an element, 1 for a regular one, below which a move is undone
_CANDIDATES = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Features:
    """Edges where the smooth patches of a closed surface meet, and corners where three do."""

    mesh: Mesh

    @cached_property
    def _creases(self) -> tuple[Index, Index, Index]:
        """Return the patch of each face (F,), the crisp edges (M, 2), and their patches (M, 2)."""
        every = edges_of(self.mesh.faces)
        edges, faces = every.ends[every.shared], every.pairs()[0]
        cosines = np.einsum("ed,ed->e", *self.mesh.face_normals[faces.T])
        smooth = faces[cosines >= np.cos(np.radians(_CRISP))]
        patches = components(smooth, len(self.mesh.faces))
        sides = np.sort(patches[faces], axis=1)
        between = sides[:, 0] != sides[:, 1]
        return patches, edges[between], sides[between]

    @cached_property
    def corners(self) -> Array:
        """Points where three patches or more meet, m (C, 3)."""
        _, edges, sides = self._creases
        meeting = np.stack([edges[:, [0, 0, 1, 1]], sides[:, [0, 1, 0, 1]]], axis=-1)
        if not len(edges):
            return np.empty((0, 3))
        vertices, counts = np.unique(
            unique_rows(meeting.reshape(-1, 2))[0][:, 0], return_counts=True
        )
        return self.mesh.points[vertices[counts > 2]]

    def kept(self, linear: VolumeMesh, on: Mask) -> VolumeMesh:
        """Return linear tetrahedra with nodes moved onto the corners and edges they cut off."""
        # `on` (N,): which nodes lie on the surface.
        if not len(self._creases[1]):
            return linear
        sides = linear.boundary_sides()[0]
        sides = sides[on[sides].all(axis=1)]
        edges, _ = unique_rows(np.sort(sides[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1))
        moves = _Moves(linear)
        for candidates in self._to_corners(linear.nodes, edges):
            moves.attempt(candidates)
        for ends, candidates in self._to_edges(linear.nodes, edges):
            if not moves.placed[ends].any():
                moves.attempt(candidates)
        return replace(linear, nodes=moves.nodes)

    def _to_corners(self, nodes: Array, edges: Index) -> Iterator[list[tuple[int, Array]]]:
        """Yield for each corner the boundary nodes near it, the nearest first."""
        boundary = np.unique(edges)
        reach = _lengths(nodes, edges).max()
        distances, near = KDTree(nodes[boundary]).query(self.corners, k=_CANDIDATES)
        close = np.asarray(distances) < reach
        for corner, chosen, wanted in zip(self.corners, np.asarray(near), close, strict=True):
            yield [(int(boundary[k]), corner) for k in chosen[wanted]]

    def _to_edges(
        self, nodes: Array, edges: Index
    ) -> Iterator[tuple[Index, list[tuple[int, Array]]]]:
        """Yield boundary edges from patch to patch, with their ends' ways to the crisp edge."""
        patches, creases, sides = self._creases
        boundary = np.unique(edges)
        patch = np.zeros(len(nodes), np.int64)
        patch[boundary] = patches[Surface(self.mesh).closest(nodes[boundary])[1]]
        pairs = np.sort(patch[edges], axis=1)
        found = []
        for pair in np.unique(sides, axis=0):
            across = edges[(pairs == pair).all(axis=1)]
            if not len(across):
                continue
            crease = Closest(self.mesh.points, creases[(sides == pair).all(axis=1)])
            goals = crease.closest(nodes[across].reshape(-1, 3))[2].reshape(-1, 2, 3)
            away = np.linalg.norm(goals - nodes[across], axis=2)
            close = away.min(axis=1) < _lengths(nodes, across)
            found += list(zip(across[close], goals[close], away[close], strict=True))
        for ends, goals, away in sorted(found, key=lambda each: each[2].min()):
            yield ends, [(int(ends[k]), goals[k]) for k in np.argsort(away)]


class _Moves:
    """Nodes of tetrahedra moved one by one, each only where no element becomes too flat."""

    def __init__(self, mesh: VolumeMesh) -> None:
        self.nodes, self.placed = mesh.nodes.copy(), np.zeros(len(mesh.nodes), bool)
        self._elements = mesh.elements
        owners = np.repeat(np.arange(len(mesh.elements)), mesh.elements.shape[1])
        order = np.argsort(mesh.elements, axis=None, kind="stable")
        self._owners = owners[order]
        self._starts = np.searchsorted(mesh.elements.ravel()[order], np.arange(len(mesh.nodes) + 1))

    def attempt(self, candidates: list[tuple[int, Array]]) -> None:
        """Move the first of the nodes that can go to its goal there."""
        for node, goal in candidates:
            if self.placed[node]:
                continue
            before = self.nodes[node].copy()
            self.nodes[node] = goal
            if self._worst_at(node) > _WORST:
                self.placed[node] = True
                return
            self.nodes[node] = before

    def _worst_at(self, node: int) -> float:
        """Return the worst shape of the elements at a node: 1 is regular, 0 flat."""
        owners = self._owners[self._starts[node] : self._starts[node + 1]]
        return float(shape_of(self.nodes[self._elements[owners]]).min(initial=1.0))


def _lengths(nodes: Array, edges: Index) -> Array:
    return np.linalg.norm(nodes[edges[:, 0]] - nodes[edges[:, 1]], axis=1)

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
from struck.solids.surface.distance import MAX_SPACING_RATIO, FilledBody, WalledSheet
from struck.solids.volume_mesh import FUNCTIONS_PER_NODE, VolumeMesh, unique_rows

if TYPE_CHECKING:
    from struck.solids.filling.thin_walls import ThinBody


@dataclass(frozen=True, slots=True, kw_only=True)
class Accuracy:
    """Number of nodes and layers with which a body is filled."""

    nodes: int  # to begin with
    max_nodes: int  # nodes not to exceed
    max_thin_nodes: int  # nodes, or functions of cubic elements, not to exceed in thin bodies
    simplify_above: int  # functions of cubic elements beyond which needless cuts are undone
    error: float  # relative, that the frequencies of most modes shall keep

    def coarser(self) -> Accuracy:
        """Return an accuracy with a third of the nodes, for estimates of the mesh's error."""
        return replace(
            self,
            nodes=self.nodes // 3,
            max_nodes=self.max_nodes // 3,
            max_thin_nodes=self.max_thin_nodes // 3,
        )


ACCURACIES: Mapping[str, Accuracy] = MappingProxyType(
    {
        "preview": Accuracy(
            nodes=3_000, max_nodes=15_000, max_thin_nodes=30_000, simplify_above=30_000, error=0.03
        ),
        "standard": Accuracy(
            nodes=12_000,
            max_nodes=70_000,
            max_thin_nodes=100_000,
            simplify_above=100_000,
            error=0.005,
        ),
        "fine": Accuracy(
            nodes=25_000,
            max_nodes=130_000,
            max_thin_nodes=180_000,
            simplify_above=180_000,
            error=0.001,
        ),
    }
)
# Functions a cell: solid, in a wall of 2 or 3 elements, in a wall of one element with cubics.
_SOLID_CELL_NODES, _WALL_CELL_NODES, _LAYER_CELL_NODES = 18, 26, 80
_NODES_PER_HALVING = 15  # quadratic nodes that halving an edge adds, neighbours included
_SOLID_FACTOR = 2.0  # times the nodes to begin with, up to which a body is filled as a solid one
# Spacing over wall below which several layers take no more nodes than one.
_LAYER_SPACING = 0.7
# Spacing over wall at which one layer bends well, quadratic or cubic; more if nodes run out.
_MAX_ASPECT, _MAX_CUBIC_ASPECT = 8, 20
_MAX_VOLUME_ERROR, _MAX_COARSE_VOLUME_ERROR = 0.02, 0.05
_SURFACE_SAMPLES = 5_000  # on a surface, where elements are looked for
_MAX_UNREACHED_FRACTION = 0.02  # of the surface, or a part as large as a handle is missing
_EDGE_WIDTH, _EDGE_SPACING = 0.315, 4.0  # thicknesses
_SOUNDINGS = (10, 40)  # along the longest edge, for the depth of a body: few show most cavities
# Fraction of the tetrahedra below which a piece that hangs by an edge or a corner is a crumb.
_MAX_CRUMB_FRACTION = 0.01
# For forecasts: factor of cells that the surface cuts; least ratio of fine to coarse nodes.
_CUT_FACTOR, _FINE_RATIO = 2.0, 2.0
_MIN_HALVINGS = 1_000  # edges of a lattice over thin walls that may be halved at least
_MAX_FUNCTIONS = 400_000  # at any accuracy; more take minutes and many GiB
_SIZE_TOLERANCE = 1.1  # times the maximum, as a lattice may take a little more than foreseen
_MAX_COARSENINGS = 3  # lattices tried where walls take more functions than foreseen
_REFINEMENT, _SMALL_REFINEMENT = 0.75, 0.9  # spacing over the one before, where that did not serve
_VOLUME_ERROR_RATIO = 0.4  # error of the volume over that of frequencies that is aimed at
_SAMPLES_PER_CELL = 1.5  # of the volume, along each edge of a lattice cell


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
    unreached: float  # fraction of the surface that is farther from all elements than the lattice
    crumbs: int  # tetrahedra left out because they hung by an edge or a corner

    @property
    def references(self) -> tuple[str, ...]:
        """Sources of cubic displacements, where there are any."""
        return ("szabo1991",) if self.mesh.cubic else ()


def accuracy_named(name: str) -> Accuracy:
    """Return the accuracy of this name; OptionError if it does not exist."""
    level(name)
    return ACCURACIES[name]


def nodes_allowed(accuracy: str, requested_nodes: int) -> int:
    """Return the number of nodes of a lattice: `requested_nodes` within those of the accuracy."""
    goal = accuracy_named(accuracy)
    return min(max(goal.nodes, requested_nodes), goal.max_nodes)


def nodes_expected(original: FilledBody | WalledSheet, accuracy: str) -> tuple[float, float]:
    """Estimate the nodes of a coarse filling, 0 if it cannot follow the body, and a fine one."""
    goal = accuracy_named(accuracy)
    body, goal = _treat_as_thin(original, goal)
    coarse_goal = goal.coarser()
    spacing = spacing_for(body, coarse_goal.nodes)
    coarse_nodes = (
        _estimate_nodes(body, spacing) if nodes_for(body, spacing) <= coarse_goal.max_nodes else 0.0
    )
    fine_nodes = _estimate_nodes(body, _spacing(body, min(goal.nodes, goal.max_nodes // 2), goal))
    return coarse_nodes, min(max(fine_nodes, _FINE_RATIO * coarse_nodes), goal.max_nodes)


def _estimate_nodes(body: Body, spacing: float) -> float:
    """Estimate the number of nodes of a lattice, cells that the surface cuts included."""
    cut_ratio = spacing / body.thickness if body.is_solid else 1.0
    return nodes_for(body, spacing) * (1 + cut_ratio) / _CUT_FACTOR


def fill_body(
    original: FilledBody | WalledSheet, accuracy: str = "standard", *, nodes: int = 0
) -> Filling:
    """Fill a closed surface, its wall, or a sheet's wall, with curved quadratic tetrahedra."""
    # `nodes`: more than the accuracy begins with, as far as it allows.
    goal = accuracy_named(accuracy)
    _require_cavity(original)
    requested_nodes = nodes_allowed(accuracy, nodes)
    body, goal = _treat_as_thin(original, goal)
    # Creases, clefts and slender parts may take as many again: how many, only filling tells.
    start_nodes = min(requested_nodes, goal.max_nodes // 2)
    filling = _find_valid_filling(body, _spacing(body, start_nodes, goal), goal)
    affordable_nodes = min(requested_nodes, start_nodes * goal.max_nodes // filling.mesh.functions)
    if affordable_nodes > start_nodes:
        filling = _refill(body, filling, _spacing(body, affordable_nodes, goal), goal)
    if not body.is_solid and not body.both_faces:
        return filling
    if not body.is_solid and filling.mesh.functions > goal.max_nodes:
        filling = _reduce_size(body, filling, affordable_nodes, goal)
    return _improve_shape(body, filling, goal)


def fill_body_coarsely(
    original: FilledBody | WalledSheet, accuracy: str = "standard"
) -> tuple[Filling, ...]:
    """Fill a body with about a third of the nodes; return () if they cannot follow it."""
    goal = accuracy_named(accuracy)
    _require_cavity(original)
    body, goal = _treat_as_thin(original, goal)
    goal = goal.coarser()
    spacing = spacing_for(body, goal.nodes)
    while nodes_for(body, spacing) <= goal.max_nodes:
        filling = _stuff(body, spacing, goal)
        if not _complaint(filling, _MAX_COARSE_VOLUME_ERROR):
            return (filling,)
        if body.is_solid:
            break
        spacing *= _REFINEMENT
    return ()


def _treat_as_thin(body: FilledBody | WalledSheet, goal: Accuracy) -> tuple[Body, Accuracy]:
    """Return a solid as a thin body where a lattice that it would not tear takes many nodes."""
    if not isinstance(body, FilledBody):
        from struck.solids.filling.thin_walls import add_both_faces

        body = add_both_faces(body) or body
    elif body.wall is not None:
        from struck.solids.filling.thin_walls import add_inner_face

        body = add_inner_face(body) or body
    if not isinstance(body, FilledBody) or not body.is_solid:
        return body, goal
    is_thin = nodes_for(body, MAX_SPACING_RATIO * body.thickness) > _SOLID_FACTOR * goal.nodes
    if not is_thin:
        return body, goal
    from struck.solids.filling.thin_walls import ThinBody  # few bodies need it

    return ThinBody(solid=body), replace(goal, max_nodes=goal.max_thin_nodes)


def spacing_for(body: Body, nodes: int) -> float:
    """Return the lattice spacing that makes about the given number of nodes, m."""
    volume, thickness = body.rough_volume, body.thickness
    if body.is_solid:
        return min(MAX_SPACING_RATIO * thickness, (volume * _SOLID_CELL_NODES / nodes) ** (1 / 3))
    solid_spacing = (volume * _WALL_CELL_NODES / nodes) ** (1 / 3)
    nodes_per_cell = _LAYER_CELL_NODES if body.both_faces else _WALL_CELL_NODES
    layer_spacing = (volume * nodes_per_cell / nodes / thickness) ** (1 / 2)
    return (
        solid_spacing
        if solid_spacing < _LAYER_SPACING * thickness
        else max(layer_spacing, thickness)
    )


def nodes_for(body: Body, spacing: float) -> float:
    """Return about how many nodes, or as many functions, a lattice makes."""
    is_thin = not body.is_solid and spacing > _LAYER_SPACING * body.thickness
    cell = spacing**2 * (body.thickness if is_thin else spacing)
    return (
        body.rough_volume
        * (_LAYER_CELL_NODES if is_thin and body.both_faces else _WALL_CELL_NODES)
        / cell
    )


def _spacing(body: Body, nodes: int, goal: Accuracy) -> float:
    """Return the spacing for about a number of nodes, smaller where a layer would be too flat."""
    spacing = spacing_for(body, nodes)
    if body.is_solid:
        return spacing
    max_aspect = _MAX_CUBIC_ASPECT if body.both_faces else _MAX_ASPECT
    return min(spacing, max(max_aspect * body.thickness, spacing_for(body, goal.max_nodes)))


def _require_cavity(body: FilledBody | WalledSheet) -> None:
    """Refuse a wall so thick that it fills the body."""
    if isinstance(body, WalledSheet) or body.wall is None:
        return
    max_depth = 0.0
    for soundings in _SOUNDINGS:
        # Both faces of the wall are sampled, as values are exact near one of them alone.
        grids = Lattice.cover(body.bounds, body.mesh.extent / soundings).sample(body.depths)
        max_depth = max(max_depth, *(body.wall + float(grid[..., 1].max()) for grid in grids))
        if max_depth > body.wall:
            return
    raise MeshError(
        f"a wall of {rounded(body.wall)} m leaves no cavity in a body of "
        f"{rounded(body.mesh.extent, 3)} m, {rounded(max_depth, 3)} m deep: leave wall= out for a "
        "solid body, or give a thinner wall"
    )


def _find_valid_filling(body: Body, spacing: float, goal: Accuracy) -> Filling:
    """Fill the body; where a part finer than the lattice tears, try again finer."""
    if nodes_for(body, spacing) > goal.max_nodes:
        raise MeshError(
            f"parts about {rounded(body.thickness, 3)} m thick in a body of "
            f"{rounded(body.mesh.extent, 3)} m need more than {goal.max_nodes} nodes: use "
            f"{_next_accuracy(goal)}a solid of struck.solids, or the outer surface alone with wall="
        )
    while True:
        try:
            filling = _stuff(body, spacing, goal)
        except NoCellsError as error:
            complaint = str(error)
        else:
            if not (complaint := _complaint(filling, _MAX_VOLUME_ERROR)):
                return filling
            complaint += f" on a lattice of {rounded(spacing, 3)} m"
        spacing *= _REFINEMENT
        if nodes_for(body, spacing) > goal.max_nodes:
            # A neck or a handle takes as many nodes as a thin body.
            goal = replace(goal, max_nodes=goal.max_thin_nodes)
        if nodes_for(body, spacing) > goal.max_nodes:
            hint = "the outer surface alone with wall=" if body.both_faces else "a thicker wall"
            raise MeshError(
                f"{complaint}: use {_next_accuracy(goal)}{hint}, a smoother surface, or for rods "
                "and rings a solid of struck.solids"
            )


def _next_accuracy(goal: Accuracy) -> str:
    """Return the option that selects the next finer accuracy, or "" at the finest."""
    finer_name = next(
        (
            name
            for name, accuracy in ACCURACIES.items()
            if accuracy.max_thin_nodes > goal.max_thin_nodes
        ),
        None,
    )
    return f"accuracy='{finer_name}', " if finer_name else ""


def _refill(body: Body, filling: Filling, spacing: float, goal: Accuracy) -> Filling:
    """Fill a body again on a finer lattice, or leave it as it is where that does not serve."""
    finer_filling = _stuff(body, spacing, goal) if spacing < filling.spacing else filling
    is_valid = finer_filling.mesh.functions <= _SIZE_TOLERANCE * goal.max_nodes and not _complaint(
        finer_filling, _MAX_VOLUME_ERROR
    )
    return finer_filling if is_valid else filling


def _reduce_size(body: Body, filling: Filling, nodes: int, goal: Accuracy) -> Filling:
    """Fill a thin body on coarser lattices until it takes about as many functions as it may."""
    for _ in range(_MAX_COARSENINGS):
        coarser_filling = _stuff(body, _spacing(body, nodes, goal), goal)
        is_smaller = coarser_filling.mesh.functions < filling.mesh.functions
        filling = (
            coarser_filling
            if is_smaller and not _complaint(coarser_filling, _MAX_VOLUME_ERROR)
            else filling
        )
        if filling.mesh.functions <= _SIZE_TOLERANCE * goal.max_nodes:
            break
        nodes = nodes * goal.max_nodes // coarser_filling.mesh.functions
    return filling


def _improve_shape(body: Body, filling: Filling, goal: Accuracy) -> Filling:
    """Fill a body finer until its shape costs less than the error that is aimed at."""
    # Lattices that differ little may miss very different fractions of a crisp solid's edges.
    spacing = filling.spacing
    while abs(filling.volume_error) > _VOLUME_ERROR_RATIO * goal.error:
        spacing *= _SMALL_REFINEMENT if body.is_solid else _REFINEMENT
        if nodes_for(body, spacing) > goal.max_nodes:
            break
        finer_filling = _refill(body, filling, spacing, goal)
        is_better = abs(finer_filling.volume_error) < abs(filling.volume_error)
        filling = finer_filling if is_better else filling
    return filling


def _stuff(body: Body, spacing: float, goal: Accuracy) -> Filling:
    is_thin = not body.is_solid and spacing > body.thickness  # one layer of elements in walls
    max_edges = body.max_edges(spacing) if isinstance(body, FilledBody) else None
    # A slender part may take as many nodes as a thin body.
    max_nodes = goal.max_thin_nodes if max_edges else goal.max_nodes
    max_halvings = max(max_nodes - nodes_for(body, spacing), 0) / _NODES_PER_HALVING
    is_cubic = is_thin and body.both_faces
    if is_cubic:
        max_halvings = max(max_halvings / FUNCTIONS_PER_NODE, _MIN_HALVINGS)
    lattice_body = body.at(spacing)
    raw_cells = cells_in(
        lattice_body.depths,
        lattice_body.bounds,
        spacing,
        max_halvings=int(max_halvings),
        judge=lattice_body.judge,
        max_edges=max_edges,
    )
    functions = (
        FUNCTIONS_PER_NODE * (len(raw_cells.points) + len(raw_cells.edges())) if is_cubic else 0.0
    )
    if functions > _SIZE_TOLERANCE * goal.simplify_above:
        from struck.solids.filling.membership import undo_needless_cuts  # few bodies need it

        raw_cells = undo_needless_cuts(raw_cells)
    cells, crumbs = _drop_crumbs(raw_cells)
    features = None if isinstance(body, WalledSheet) else Features(mesh=body.mesh)
    mesh, short_count = curve_elements(
        cells, lattice_body.onto, body.mesh.up, opposed=lattice_body.opposed, features=features
    )
    relation = "thicker" if spacing < body.thickness else "thinner"
    noun = "body" if body.is_solid else "wall"
    return Filling(
        mesh=replace(mesh, cubic=is_cubic),
        path="one layer" if is_thin else "stuffing",
        reason=f"the {noun} of {rounded(body.thickness, 3)} m is {relation} than the lattice",
        spacing=spacing,
        volume_error=mesh.volume() / lattice_body.volume(spacing / _SAMPLES_PER_CELL) - 1,
        stiffened=_estimate_stiffening(body, spacing),
        short=short_count,
        unreached=_uncovered_fraction(body.mesh, mesh, spacing),
        crumbs=crumbs,
    )


def _estimate_stiffening(body: Body, spacing: float) -> float:
    """Return the relative error of frequencies by twist that flat elements miss at thin edges."""
    if isinstance(body, FilledBody | WalledSheet):
        return 0.0
    # Within about a thickness h of an edge twist has no moment to bear: a strip of width b twists
    # as one narrower by 0.315 h at either edge (Timoshenko & Goodier, section 109). A
    # lattice of r thicknesses misses about (r / (r + 4))^4 of that, as found on plates.
    width = spacing / body.thickness
    return _EDGE_WIDTH * body.solid.rims * (width / (width + _EDGE_SPACING)) ** 4


def _uncovered_fraction(outline: Mesh, elements: VolumeMesh, spacing: float) -> float:
    """Return the fraction of a surface's area that no element is within a lattice spacing of."""
    places, vectors = outline.spread(_SURFACE_SAMPLES)
    areas = np.linalg.norm(vectors, axis=1)
    # Sides have a node every half spacing, and nodes are found in a third of the time.
    return float(areas[KDTree(elements.nodes).query(places)[0] > spacing].sum() / areas.sum())


def _drop_crumbs(cells: Cells) -> tuple[Cells, int]:
    """Leave out crumbs, pieces of a few tetrahedra, and count their tetrahedra."""
    mesh = VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4")
    labels = pieces_of(mesh)
    sizes = np.bincount(labels)
    is_crumb = sizes[labels] < _MAX_CRUMB_FRACTION * len(labels)
    if not is_crumb.any() or is_crumb.all():  # many crumbs are no body: it falls into pieces
        return cells, 0
    return replace(cells, tetrahedra=cells.tetrahedra[~is_crumb]).compact(), int(is_crumb.sum())


def _complaint(filling: Filling, max_error: float) -> str:
    """Return the fault of the elements as a message, or ""."""
    if filling.mesh.functions > _MAX_FUNCTIONS:
        return f"walls cross so closely that they take {filling.mesh.functions} functions"
    folded_count = int(np.count_nonzero(flatness(filling.mesh) <= 0))
    if folded_count:
        return f"{folded_count} of {len(filling.mesh.elements)} elements fold over"
    pieces = piece_count(filling.mesh)
    if pieces > 1:
        return f"the body falls into {pieces} pieces"
    if abs(filling.volume_error) > max_error:
        return f"{100 * filling.volume_error:+.1f} % of the volume is missing or too much"
    if filling.unreached > _MAX_UNREACHED_FRACTION:
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
_MIN_JACOBIAN_RATIO = 0.02  # least over mean Jacobian determinant of an element
_MIN_MOVED_SHAPE = 0.05  # of a tetrahedron after moving, unless half as flat as it was
_HALVINGS = 3
_CHUNK = 4096


def curve_elements(
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
    linear, held_count = _move_nodes(linear, on, onto)
    linear = linear if features is None else features.snap_nodes(linear, _unite_masks(on))
    quadratic_mesh = linear.promoted()
    result, short_count = _move_nodes(
        quadratic_mesh, _find_midside_nodes(quadratic_mesh, on, opposed), onto
    )
    return result, held_count + short_count


def _find_midside_nodes(
    mesh: VolumeMesh, on: dict[Surfaces, Mask], opposed: Iterable[tuple[int, int]]
) -> dict[Surfaces, Mask]:
    """Return which mid-edge nodes of the boundary, or of a wall's edges, are near a surface."""
    # Edges through a thin wall must bow as its faces do, or the faces would pass them.
    masks = {surface: np.zeros(len(mesh.nodes), bool) for surface in on}
    for sides in mesh.boundary_sides():
        corners, midside_nodes = sides[:, :3], sides[:, 3:]
        for surface, flags in on.items():
            is_along = flags[corners] & flags[np.roll(corners, -1, axis=1)]
            masks[surface][midside_nodes[is_along]] = True
    first, second = mesh.elements[:, np.array(mesh.element.edges)].transpose(2, 0, 1)
    midside_nodes = mesh.elements[:, len(mesh.element.corners) :]
    for pair in opposed:
        one, other = on[pair[:1]], on[pair[1:]]
        is_through = (one[first] & other[second]) | (other[first] & one[second])
        masks[pair] = np.zeros(len(mesh.nodes), bool)
        masks[pair][midside_nodes[is_through]] = True
    return masks


def _unite_masks(on: dict[Surfaces, Mask]) -> Mask:
    return np.asarray(np.any(list(on.values()), axis=0))


def _displacements_onto(mesh: VolumeMesh, on: dict[Surfaces, Mask], onto: Onto) -> Array:
    """Return how far each node is from the surfaces it belongs on, one after the other (N, 3)."""
    goals = mesh.nodes.copy()
    for surface, flags in on.items():
        goals[flags] = onto(surface, goals[flags])
    return goals - mesh.nodes


def _move_nodes(mesh: VolumeMesh, on: dict[Surfaces, Mask], onto: Onto) -> tuple[VolumeMesh, int]:
    """Move nodes onto their surfaces, or part of the way where elements would fold."""
    displacements = _displacements_onto(mesh, on, onto)
    min_shapes = np.minimum(_MIN_MOVED_SHAPE, shapes(mesh) / 2)
    fractions, halvings = _unite_masks(on).astype(float), 0
    is_flat, is_moving = np.zeros(len(mesh.elements), bool), fractions > 0
    while True:
        nodes = mesh.nodes + fractions[:, None] * displacements
        changed_elements = np.flatnonzero(is_moving[mesh.elements].any(axis=1))
        moved_mesh = replace(mesh, nodes=nodes)
        is_flat[changed_elements] = flatness(moved_mesh, changed_elements) < _MIN_JACOBIAN_RATIO
        is_flat[changed_elements] |= (
            shapes(moved_mesh, changed_elements) < min_shapes[changed_elements]
        )
        is_moving = np.zeros(len(fractions), bool)
        is_moving[mesh.elements[is_flat]] = True
        is_moving &= fractions > 0
        if not is_moving.any():
            break
        fractions[is_moving] *= 0.5 if halvings < _HALVINGS else 0.0
        halvings += 1
    return replace(mesh, nodes=nodes), int(np.count_nonzero(fractions[_unite_masks(on)] < 1))


def flatness(mesh: VolumeMesh, chosen: Index | slice = slice(None)) -> Array:
    """Return least over mean Jacobian determinant of elements (E,): 1 straight, below 0 folded."""
    points = np.vstack([mesh.element.nodes, mesh.element.mass_rule.points])
    gradients = mesh.element.gradients(points).transpose(2, 1, 0)
    elements = mesh.elements[chosen]
    parts = []
    for start in range(0, len(elements), _CHUNK):
        corners = mesh.nodes[elements[start : start + _CHUNK]].transpose(2, 0, 1)
        jacobians = determinants(corners[:, None] @ gradients)
        mean = np.abs(jacobians).mean(axis=1)
        parts.append(jacobians.min(axis=1) / np.maximum(mean, np.finfo(float).tiny))
    return np.concatenate(parts) if parts else np.empty(0)


def shapes(mesh: VolumeMesh, chosen: Index | slice = slice(None)) -> Array:
    """Return the volume of tetrahedra over that of regular ones with edges as long (E,)."""
    return shape_of(mesh.nodes[mesh.corners[chosen]])


# Crisp edges: a lattice bevels convex ones and fills concave ones by a share of its spacing, which
# costs volume and shifts frequencies.

_CRISP_ANGLE = 40.0  # degrees between the normals of two faces with a crisp edge between them
_MIN_SHAPE = 0.03  # shape of an element, 1 for a regular one, below which a move is undone
_CANDIDATES = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Features:
    """Edges where the smooth patches of a closed surface meet, and corners where three do."""

    mesh: Mesh

    @cached_property
    def _creases(self) -> tuple[Index, Index, Index]:
        """Return the patch of each face (F,), the crisp edges (M, 2), and their patches (M, 2)."""
        all_edges = edges_of(self.mesh.faces)
        edges, faces = all_edges.ends[all_edges.shared], all_edges.pairs()[0]
        cosines = np.einsum("ed,ed->e", *self.mesh.face_normals[faces.T])
        smooth_pairs = faces[cosines >= np.cos(np.radians(_CRISP_ANGLE))]
        patches = components(smooth_pairs, len(self.mesh.faces))
        sides = np.sort(patches[faces], axis=1)
        is_between = sides[:, 0] != sides[:, 1]
        return patches, edges[is_between], sides[is_between]

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

    def snap_nodes(self, linear: VolumeMesh, on: Mask) -> VolumeMesh:
        """Return linear tetrahedra with nodes moved onto the corners and edges they cut off."""
        # `on` (N,): which nodes lie on the surface.
        if not len(self._creases[1]):
            return linear
        sides = linear.boundary_sides()[0]
        sides = sides[on[sides].all(axis=1)]
        edges, _ = unique_rows(np.sort(sides[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1))
        node_moves = _Moves(linear)
        for candidates in self._to_corners(linear.nodes, edges):
            node_moves.attempt(candidates)
        for ends, candidates in self._to_edges(linear.nodes, edges):
            if not node_moves.is_placed[ends].any():
                node_moves.attempt(candidates)
        return replace(linear, nodes=node_moves.nodes)

    def _to_corners(self, nodes: Array, edges: Index) -> Iterator[list[tuple[int, Array]]]:
        """Yield for each corner the boundary nodes near it, the nearest first."""
        boundary = np.unique(edges)
        reach = _lengths(nodes, edges).max()
        distances, neighbours = KDTree(nodes[boundary]).query(self.corners, k=_CANDIDATES)
        is_near = np.asarray(distances) < reach
        for corner, candidates, is_reachable in zip(
            self.corners, np.asarray(neighbours), is_near, strict=True
        ):
            yield [(int(boundary[k]), corner) for k in candidates[is_reachable]]

    def _to_edges(
        self, nodes: Array, edges: Index
    ) -> Iterator[tuple[Index, list[tuple[int, Array]]]]:
        """Yield boundary edges between patches, with the goals of their ends on the crisp edge."""
        patches, creases, sides = self._creases
        boundary = np.unique(edges)
        patch = np.zeros(len(nodes), np.int64)
        patch[boundary] = patches[Surface(self.mesh).closest(nodes[boundary])[1]]
        pairs = np.sort(patch[edges], axis=1)
        moves = []
        for pair in np.unique(sides, axis=0):
            crossing_edges = edges[(pairs == pair).all(axis=1)]
            if not len(crossing_edges):
                continue
            crease = Closest(self.mesh.points, creases[(sides == pair).all(axis=1)])
            goals = crease.closest(nodes[crossing_edges].reshape(-1, 3))[2].reshape(-1, 2, 3)
            distances = np.linalg.norm(goals - nodes[crossing_edges], axis=2)
            is_near = distances.min(axis=1) < _lengths(nodes, crossing_edges)
            moves += list(
                zip(crossing_edges[is_near], goals[is_near], distances[is_near], strict=True)
            )
        for ends, goals, distances in sorted(moves, key=lambda move: move[2].min()):
            yield ends, [(int(ends[k]), goals[k]) for k in np.argsort(distances)]


class _Moves:
    """Nodes of tetrahedra moved one by one, each only where no element becomes too flat."""

    def __init__(self, mesh: VolumeMesh) -> None:
        self.nodes, self.is_placed = mesh.nodes.copy(), np.zeros(len(mesh.nodes), bool)
        self._elements = mesh.elements
        owners = np.repeat(np.arange(len(mesh.elements)), mesh.elements.shape[1])
        order = np.argsort(mesh.elements, axis=None, kind="stable")
        self._owners = owners[order]
        self._starts = np.searchsorted(mesh.elements.ravel()[order], np.arange(len(mesh.nodes) + 1))

    def attempt(self, candidates: list[tuple[int, Array]]) -> None:
        """Move the first of the nodes that can go to its goal there."""
        for node, goal in candidates:
            if self.is_placed[node]:
                continue
            old_position = self.nodes[node].copy()
            self.nodes[node] = goal
            if self._worst_at(node) > _MIN_SHAPE:
                self.is_placed[node] = True
                return
            self.nodes[node] = old_position

    def _worst_at(self, node: int) -> float:
        """Return the worst shape of the elements at a node: 1 is regular, 0 flat."""
        owners = self._owners[self._starts[node] : self._starts[node + 1]]
        return float(shape_of(self.nodes[self._elements[owners]]).min(initial=1.0))


def _lengths(nodes: Array, edges: Index) -> Array:
    return np.linalg.norm(nodes[edges[:, 0]] - nodes[edges[:, 1]], axis=1)

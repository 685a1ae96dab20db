"""Isosurface stuffing: tetrahedra of good shape in any body (Labelle & Shewchuk 2007).

A body-centred cubic lattice lies over the body. Its tetrahedra are halved where they are too coarse
(Rivara 1991), points too near the boundary move onto it, and tetrahedra that the boundary still
cuts are replaced by their part inside. Several surfaces may bound the body: each cuts in its turn,
so a wall between two of them may be much thinner than the lattice.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from struck.errors import MeshError, rounded
from struck.model.arrays import AnyArray, Array, Index, Mask
from struck.solids.volume_mesh import VolumeMesh, unique_rows

PAIRS = ((0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3))
Depths = Callable[[Array], Array]
Widths = Callable[[Array], Array]  # longest edges required at points (K, 3), m (K,)

# Fractions of an edge within which the boundary pulls a lattice point over; long edges join two
# corners or two centres, short ones a corner and a centre (their table 1, safe for all shapes).
_LONG_REACH, _SHORT_REACH = 0.24999, 0.41189
_NOUGHT = 1e-4  # fraction of an edge within which a point counts as on a surface


def stuff_body(depths: Depths, bounds: Array, spacing: float, up: str = "z") -> VolumeMesh:
    """Fill a body with linear tetrahedra: `cells_in` as a mesh."""
    cells = cells_in(depths, bounds, spacing)
    return VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4", up=up)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judge:
    """Rule that decides which cells are in a body, where some surfaces extend past it."""

    joined: tuple[int, ...]  # the surfaces beyond which it may extend
    distance: Depths  # to the body, m: negative inside
    # From cells on both sides of each surface to those in the body.
    select_cells: Callable[[Cells], Cells]


def cells_in(
    depths: Depths,
    bounds: Array,
    spacing: float,
    *,
    max_halvings: int = 0,
    judge: Judge | None = None,
    max_edges: Widths | None = None,
) -> Cells:
    """Fill a body with linear tetrahedra, smaller ones where it is slender, creased or cleft."""
    # `depths`: 1-Lipschitz functions of points (K, 3), m (K,) or (K, n), all negative in the body
    # except for surfaces that a `judge` has joined. At most `max_halvings` edges are halved where a
    # lattice is too coarse for it or longer than `max_edges`; more so that neighbours fit.
    lattice = Lattice.cover(bounds, spacing)
    all_cells, is_centre = _lattice_cells(lattice, depths, judge, has_slender=max_edges is not None)
    _require_any(all_cells.tetrahedra, spacing)
    max_miss = _MAX_MISS if judge is None else _MAX_WALL_MISS
    fine = refine(
        all_cells,
        depths,
        min_length=spacing / 5,
        max_halvings=max_halvings,
        max_miss=max_miss,
        max_edges=max_edges,
    )
    cells = warp(fine, is_centre)
    for surface in range(cells.depths.shape[1]):
        cells = cells.cut_at(surface, both_sides=judge is not None)
    if judge is not None:
        cells = judge.select_cells(cells.compact())
    _require_any(cells.tetrahedra, spacing)
    return cells.compact()


def _lattice_cells(
    lattice: Lattice, depths: Depths, judge: Judge | None, *, has_slender: bool
) -> tuple[Cells, Mask]:
    """Return the tetrahedra of a lattice that a body may reach, and which points are centres."""
    grids = lattice.sample(depths)
    edge = lattice.cell.max()
    near_grids = grids
    if judge or has_slender:  # a part may pass between all points of the lattice
        distance = judge.distance if judge else depths
        near_grids = lattice.sample(lambda points: _columns(distance, points).max(axis=1) - edge)
    numbers, local = np.unique(lattice.tetrahedra(*near_grids), return_inverse=True)
    values = np.concatenate([grid.reshape(-1, grid.shape[-1]) for grid in grids])[numbers]
    values[np.abs(values) < _NOUGHT * edge] = 0.0
    cells = Cells(
        points=lattice.positions(numbers),
        depths=values,
        tetrahedra=local.reshape(-1, 4),
        joined=judge.joined if judge else (),
    )
    return cells, numbers >= np.prod(lattice.counts + 1)


class NoCellsError(MeshError):
    """A lattice is so wide that a body passes between its points."""


def _require_any(tetrahedra: Index, spacing: float) -> None:
    if not len(tetrahedra):
        raise NoCellsError(f"no point of a lattice of {rounded(spacing, 3)} m lies in the body")


def warp(cells: Cells, is_centre: Mask) -> Cells:
    """Move points that a surface passes too near onto the nearest crossing."""
    edges = cells.edges()
    crossings = [cells.crossings(surface, edges) for surface in range(cells.depths.shape[1])]
    ends = np.concatenate([crossing.edges.T.ravel() for crossing in crossings])
    new_points = np.concatenate([np.tile(crossing.points, (2, 1)) for crossing in crossings])
    new_depths = np.concatenate([np.tile(crossing.depths, (2, 1)) for crossing in crossings])
    nearness = np.concatenate(
        [np.concatenate([crossing.fractions, 1 - crossing.fractions]) for crossing in crossings]
    ) / np.concatenate([np.tile(_reach(crossing.edges, is_centre), 2) for crossing in crossings])
    # Elsewhere a surface bounds nothing; and a point on one that does is where it should be.
    is_bounding, is_within = (
        np.asarray((values[:, cells.bounding_surfaces] <= 0).all(axis=1))
        for values in (new_depths, cells.depths)
    )
    is_placed = is_within & (cells.depths == 0).any(axis=1)
    order = np.lexsort((nearness, ends))
    order = order[(nearness[order] < 1) & is_bounding[order] & ~is_placed[ends[order]]]
    moved_points, first = np.unique(ends[order], return_index=True)
    points, depths = cells.points.copy(), cells.depths.copy()
    points[moved_points] = new_points[order[first]]
    depths[moved_points] = new_depths[order[first]]
    return replace(cells, points=points, depths=depths)


def _reach(edges: Index, is_centre: Mask) -> Array:
    """Return the fractions of edges that are safe; points beyond the lattice's own are halfway."""
    kinds = np.zeros(max(int(edges.max(initial=0)) + 1, len(is_centre)), np.int8)
    kinds[: len(is_centre)] = np.where(is_centre, 1, -1)
    return np.where(kinds[edges].prod(axis=1) < 0, _SHORT_REACH, _LONG_REACH)


_BLOCK = 3  # points per side of a block that one value may serve


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lattice:
    """Corners and centres of a grid of cells."""

    origin: Array  # lowest corner, m
    cell: Array  # edges of a cell, m
    counts: Index  # cells along each axis

    @classmethod
    def cover(cls, bounds: Array, spacing: float) -> Lattice:
        """Lay cells of about `spacing` over a box, one beyond it, its faces on lattice planes."""
        # So boxes keep their edges, and symmetric bodies get a symmetric lattice.
        extent = bounds[1] - bounds[0]
        inner = np.maximum(np.round(extent / spacing), 1).astype(np.int64)
        cell = extent / inner
        return cls(origin=bounds[0] - cell, cell=cell, counts=inner + 2)

    def positions(self, numbers: Index) -> Array:
        """Return positions of lattice points, numbered corners first, then centres (K, 3)."""
        corners = int(np.prod(self.counts + 1))
        centre = numbers >= corners
        triples = np.empty((len(numbers), 3))
        triples[~centre] = _triples(numbers[~centre], self.counts + 1)
        triples[centre] = _triples(numbers[centre] - corners, self.counts) + 0.5
        return self.origin + triples * self.cell

    def sample(self, depths: Depths) -> tuple[Array, Array]:
        """Evaluate n 1-Lipschitz functions at corners (I, J, K, n) and centres."""
        # Far from all zeros only the signs are needed, so one value serves a whole block there.
        half = self.cell * _BLOCK / 2
        blocks = -(-(self.counts + 1) // _BLOCK)
        block_centres = self.origin + half * (2 * _triples(np.arange(np.prod(blocks)), blocks) + 1)
        block_values = _columns(depths, block_centres)
        # Both ends of an edge that leaves the block must have separate values.
        reach = np.linalg.norm(half) + max(self.cell.max(), np.linalg.norm(self.cell) / 2)
        is_near = (np.abs(block_values) <= reach).any(axis=1).reshape(blocks)
        block_values = block_values.reshape(*blocks, -1)
        shapes = (self.counts + 1, self.counts)
        values = np.concatenate(
            [_repeat_blocks(block_values, s).reshape(-1, block_values.shape[-1]) for s in shapes]
        )
        near_points = np.flatnonzero(
            np.concatenate([_repeat_blocks(is_near, s).ravel() for s in shapes])
        )
        values[near_points] = _columns(depths, self.positions(near_points))
        corners, centres = np.split(values, [int(np.prod(shapes[0]))])
        return corners.reshape(*shapes[0], -1), centres.reshape(*shapes[1], -1)

    def tetrahedra(self, corners: Array, centres: Array) -> Index:
        """Return the tetrahedra, as point numbers (T, 4), that may reach into the body."""
        # Each joins two neighbouring centres to an edge of the face between their cells. Functions
        # at `corners` (I, J, K, n) and `centres` are negative at one of its corners or more.
        first = int(np.prod(self.counts + 1))
        number = np.arange(first).reshape(self.counts + 1)
        centre_numbers = first + np.arange(np.prod(self.counts)).reshape(self.counts)
        parts = []
        for axis in range(3):
            ring = [_face(number, axis, u, v) for u, v in _FACE_CORNERS]
            ends = [_drop_layer(centre_numbers, axis, 0), _drop_layer(centre_numbers, axis, 1)]
            is_inside = [_face(corners, axis, u, v) < 0 for u, v in _FACE_CORNERS]
            is_inside += [_drop_layer(centres, axis, 0) < 0, _drop_layer(centres, axis, 1) < 0]
            chosen = np.any(is_inside, axis=0).all(axis=-1)
            low, high, *rim = (grid[chosen] for grid in (*ends, *ring))
            parts += [np.stack([low, high, rim[q], rim[q - 3]], axis=1) for q in range(4)]
        return np.vstack(parts)


_FACE_CORNERS = ((0, 0), (1, 0), (1, 1), (0, 1))


def _columns(depths: Depths, points: Array) -> Array:
    return np.asarray(depths(points), np.float64).reshape(len(points), -1)


def _triples(numbers: Index, counts: Index) -> Array:
    return np.stack(np.unravel_index(numbers, counts), axis=1).astype(np.float64)


def _repeat_blocks(block_values: AnyArray, counts: Index) -> AnyArray:
    """Repeat a value of each block over the points that lie in it."""
    return block_values[np.ix_(*[np.arange(count) // _BLOCK for count in counts])]


def _drop_layer(grid: AnyArray, axis: int, start: int) -> AnyArray:
    """Drop the last (start 0) or first (start 1) layer along an axis."""
    return np.take(grid, range(start, grid.shape[axis] - 1 + start), axis=axis)


def _face(grid: AnyArray, axis: int, u: int, v: int) -> AnyArray:
    """Return one corner of the faces between neighbouring cells along an axis."""
    inner = np.take(grid, range(1, grid.shape[axis] - 1), axis=axis)
    return _drop_layer(_drop_layer(inner, (axis + 1) % 3, u), (axis + 2) % 3, v)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cells:
    """Tetrahedra with the depths of their corners below the surfaces that bound a body."""

    points: Array  # (K, 3), m
    depths: Array  # (K, n) below n surfaces: negative inside, 0 on the surface, m
    tetrahedra: Index  # (T, 4), point numbers
    joined: tuple[int, ...] = ()  # surfaces beyond which the body may extend

    @property
    def bounding_surfaces(self) -> list[int]:
        """The surfaces that do not join another body."""
        return [surface for surface in range(self.depths.shape[1]) if surface not in self.joined]

    def edges(self) -> Index:
        """Return the edges of the tetrahedra, each once (E, 2)."""
        pairs = np.sort(self.tetrahedra[:, np.array(PAIRS)].reshape(-1, 2), axis=1)
        return unique_rows(pairs)[0]

    def crossings(self, surface: int, edges: Index) -> Crossings:
        """Return where one of the surfaces crosses `edges` (E, 2)."""
        depth = self.depths[:, surface]
        crossed_edges = edges[depth[edges[:, 0]] * depth[edges[:, 1]] < 0]
        first, second = depth[crossed_edges].T
        fractions = first / (first - second)
        depths = _interpolate(self.depths, crossed_edges, fractions)
        depths[np.abs(depths) < _NOUGHT * np.abs(first - second)[:, None]] = 0.0
        depths[:, surface] = 0.0
        return Crossings(
            edges=crossed_edges,
            fractions=fractions,
            points=_interpolate(self.points, crossed_edges, fractions),
            depths=depths,
        )

    def cut_at(self, surface: int, *, both_sides: bool = False) -> Cells:
        """Return tetrahedra cut at a surface: the parts inside it, or all with `both_sides`."""
        crossings = self.crossings(surface, self.edges())
        keys = crossings.edges[:, 0] * len(self.points) + crossings.edges[:, 1]

        def crossing(a: Index, b: Index) -> Index:
            return len(self.points) + np.searchsorted(
                keys, np.minimum(a, b) * len(self.points) + np.maximum(a, b)
            )

        parts = []
        for sign in (1, -1) if both_sides else (1,):
            signs = sign * np.sign(self.depths[:, surface])[self.tetrahedra]
            order = np.argsort(signs, axis=1, kind="stable")
            sorted_corners = np.take_along_axis(self.tetrahedra, order, axis=1)
            inside_counts, outside_counts = (signs < 0).sum(axis=1), (signs > 0).sum(axis=1)
            parts.append(sorted_corners[(outside_counts == 0) & (inside_counts > 0)])
            for (inside_count, outside_count), stencil in _STENCILS.items():
                a, b, c, d = sorted_corners[
                    (inside_counts == inside_count) & (outside_counts == outside_count)
                ].T
                parts += stencil(a, b, c, d, crossing)
        return replace(
            self,
            points=np.vstack([self.points, crossings.points]),
            depths=np.vstack([self.depths, crossings.depths]),
            tetrahedra=np.vstack(parts),
        )

    def compact(self) -> Cells:
        """Give all tetrahedra positive volume; drop empty ones and unused points."""
        corners = self.points[self.tetrahedra]
        volumes = np.linalg.det(corners[:, 1:] - corners[:, :1])
        oriented = np.where(
            (volumes < 0)[:, None], self.tetrahedra[:, [0, 2, 1, 3]], self.tetrahedra
        )
        tetrahedra = oriented[np.abs(volumes) > 1e-9 * np.abs(volumes).max(initial=0.0)]
        used_points, local = np.unique(tetrahedra, return_inverse=True)
        return replace(
            self,
            points=self.points[used_points],
            depths=self.depths[used_points],
            tetrahedra=local.reshape(-1, 4),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Crossings:
    """Points where edges (E, 2) meet a surface: fractions from the first end, places and depths."""

    edges: Index
    fractions: Array
    points: Array
    depths: Array


def shape_of(corners: Array) -> Array:
    """Return the volume of tetrahedra (T, 4, 3) over that of regular ones with edges as long."""
    # The length of edges is their root mean square (Liu & Joe 1994).
    corners = corners.transpose(2, 1, 0)
    edges = np.stack([corners[:, b] - corners[:, a] for a, b in PAIRS])
    square = (edges**2).sum(axis=1).mean(axis=0)
    cube = np.maximum(square**1.5, np.finfo(float).tiny)
    return np.sqrt(2) * determinants(edges[:3].transpose(1, 0, 2)) / cube


def determinants(matrices: Array) -> Array:
    """Return the determinants of matrices (3, 3, ...): many small ones, far faster than LU."""
    (a, b, c), (d, e, f), (g, h, i) = matrices
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def _interpolate(values: Array, edges: Index, fractions: Array) -> Array:
    return values[edges[:, 0]] * (1 - fractions)[:, None] + values[edges[:, 1]] * fractions[:, None]


def _prism(bottom: Index, top: Index) -> list[Index]:
    """Split prisms between triangles (m, 3) into three tetrahedra each."""
    # The lowest corner comes first: its faces are halved from it, the third from its own lowest.
    lowest_corners = np.hstack([bottom, top]).argmin(axis=1)
    is_flipped = (lowest_corners >= 3)[:, None]
    low, high = np.where(is_flipped, top, bottom), np.where(is_flipped, bottom, top)
    corner_order = (lowest_corners[:, None] % 3 + np.arange(3)) % 3
    low, high = (
        np.take_along_axis(low, corner_order, axis=1),
        np.take_along_axis(high, corner_order, axis=1),
    )
    (a, b, c), (x, y, z) = low.T, high.T
    from_b = (np.minimum(b, z) < np.minimum(c, y))[:, None]
    first = np.where(from_b, np.stack([a, b, c, z], 1), np.stack([a, b, c, y], 1))
    second = np.where(from_b, np.stack([a, b, z, y], 1), np.stack([a, y, c, z], 1))
    return [first, second, np.stack([a, x, y, z], axis=1)]


def _pyramid(apex: Index, quad: tuple[Index, Index, Index, Index]) -> list[Index]:
    """Split pyramids over quadrilaterals a, b, c, d into two tetrahedra each."""
    a, b, c, d = quad
    from_a = (np.minimum(a, c) < np.minimum(b, d))[:, None]
    first = np.where(from_a, np.stack([apex, a, b, c], 1), np.stack([apex, b, c, d], 1))
    return [first, np.where(from_a, np.stack([apex, a, c, d], 1), np.stack([apex, a, b, d], 1))]


# By counts of corners inside and outside, corners ordered from inside to outside.
_STENCILS = {
    (1, 3): lambda a, b, c, d, x: [np.stack([a, x(a, b), x(a, c), x(a, d)], axis=1)],
    (1, 2): lambda a, b, c, d, x: [np.stack([a, b, x(a, c), x(a, d)], axis=1)],
    (1, 1): lambda a, b, c, d, x: [np.stack([a, b, c, x(a, d)], axis=1)],
    (2, 1): lambda a, b, c, d, x: _pyramid(c, (a, b, x(b, d), x(a, d))),
    (2, 2): lambda a, b, c, d, x: _prism(
        np.stack([a, x(a, c), x(a, d)], axis=1), np.stack([b, x(b, c), x(b, d)], axis=1)
    ),
    (3, 1): lambda a, b, c, d, x: _prism(
        np.stack([a, b, c], axis=1), np.stack([x(a, d), x(b, d), x(c, d)], axis=1)
    ),
}


# Deviation of the depth halfway along an edge from the mean of its ends, over length: more than a
# wall's face may miss would leave a fillet at its foot too thick or too thin.
_MAX_MISS, _MAX_WALL_MISS = 0.2, 0.1
_IGNORED_DISTANCE = 0.1  # lengths of an edge from a surface at which other surfaces matter no more
_NEAR_DISTANCE = 0.5  # lengths of an edge within which surfaces matter to it


def refine(
    cells: Cells,
    depths: Depths,
    *,
    min_length: float,
    max_halvings: int,
    max_miss: float = _MAX_MISS,
    max_edges: Widths | None = None,
) -> Cells:
    """Halve tetrahedra where the surfaces bend or come near each other within one edge."""
    # At most `max_halvings` edges are marked. They are longer than twice `min_length`, m, and their
    # depth halfway misses by more than `max_miss`, or they are longer than `max_edges`.
    midpoint_depths = _MidpointDepths(depths, cells.depths.shape[1], _NOUGHT * min_length)
    new_tetrahedra = cells.tetrahedra
    while max_halvings > 0:
        edges = np.unique(_keys(new_tetrahedra))
        miss = _misses(cells, edges, midpoint_depths, min_length, max_miss)
        if max_edges is not None:
            miss = np.maximum(miss, max_miss * _length_ratios(cells, edges, max_edges))
        coarse_edges = np.flatnonzero(miss > max_miss)
        if not len(coarse_edges):
            break
        worst_edges = coarse_edges[np.argsort(-miss[coarse_edges], kind="stable")[:max_halvings]]
        max_halvings -= len(worst_edges)
        cells, unchanged_count = _halve_edges(cells, edges[worst_edges], midpoint_depths)
        new_tetrahedra = cells.tetrahedra[unchanged_count:]
    return cells


def _keys(tetrahedra: Index) -> Index:
    """Return one number for each edge of each tetrahedron (T, 6)."""
    first, second = tetrahedra[:, np.array(PAIRS)].transpose(2, 0, 1)
    return (np.minimum(first, second) << 32) | np.maximum(first, second)


def _ends(keys: Index) -> Index:
    """Return the ends (E, 2) of edges."""
    return np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=-1)


class _MidpointDepths:
    """Depths halfway along edges, each computed once."""

    def __init__(self, depths: Depths, surfaces: int, nought: float) -> None:
        self._depths, self._nought = depths, nought
        self._keys = np.empty(0, np.int64)
        self._values = np.empty((0, surfaces))

    def of(self, points: Array, edges: Index) -> Array:
        """Return the depths halfway along edges (E, n)."""
        new_edges = np.setdiff1d(edges, self._keys)
        if len(new_edges):
            depths = _columns(self._depths, points[_ends(new_edges)].mean(axis=1))
            depths[np.abs(depths) < self._nought] = 0.0
            keys = np.concatenate([self._keys, new_edges])
            order = np.argsort(keys)
            values = np.vstack([self._values, depths])
            self._keys, self._values = keys[order], values[order]
        return self._values[np.searchsorted(self._keys, edges)]


def _misses(
    cells: Cells, edges: Index, midpoint_depths: _MidpointDepths, min_length: float, max_miss: float
) -> Array:
    """Return how far depths halfway are from the mean of both ends, in edge lengths (E,)."""
    # 0 for short edges, and where a 1-Lipschitz function cannot miss by much: the ends are too far
    # from each surface, or too unlike in depth.
    ends = _ends(edges)
    length = np.linalg.norm(cells.points[ends[:, 0]] - cells.points[ends[:, 1]], axis=1)[:, None]
    first, second = cells.depths[ends[:, 0]], cells.depths[ends[:, 1]]
    is_near = np.maximum(np.abs(first), np.abs(second)) < (_NEAR_DISTANCE + 0.5) * length
    is_similar = np.abs(first - second) < (1 - 2 * max_miss) * length
    is_candidate = (is_near & is_similar).any(axis=1) & (length[:, 0] > 2 * min_length)
    mid_depths = midpoint_depths.of(cells.points, edges[is_candidate])
    length = length[is_candidate]
    deviations = np.abs(mid_depths - (first[is_candidate] + second[is_candidate]) / 2) / length
    # Where all of an edge lies well beyond one surface, others bound nothing.
    min_depths = np.minimum(np.minimum(first[is_candidate], second[is_candidate]), mid_depths)
    is_beyond = min_depths > _IGNORED_DISTANCE * length
    is_beyond[:, cells.joined] = False
    is_ignored = is_beyond.sum(axis=1, keepdims=True) > is_beyond
    misses = np.zeros(len(edges))
    misses[is_candidate] = np.where(
        (np.abs(mid_depths) < _NEAR_DISTANCE * length) & ~is_ignored, deviations, 0.0
    ).max(axis=1)
    return misses


def _length_ratios(cells: Cells, edges: Index, max_edges: Widths) -> Array:
    """Return the ratio of the length of edges near the body to the required length (E,)."""
    ends = _ends(edges)
    length = np.linalg.norm(cells.points[ends[:, 0]] - cells.points[ends[:, 1]], axis=1)
    is_near = cells.depths[ends].max(axis=2).min(axis=1) < length
    ratios = np.zeros(len(edges))
    ratios[is_near] = length[is_near] / max_edges(cells.points[ends[is_near]].mean(axis=1))
    return ratios


def _halve_edges(
    cells: Cells, marked_edges: Index, midpoint_depths: _MidpointDepths
) -> tuple[Cells, int]:
    """Halve the marked edges, and others for a fit; return also how many tetrahedra stay whole."""
    # Those left whole come first.
    cut, unchanged_count = np.empty(0, np.int64), len(cells.tetrahedra)
    while True:
        marked_edges, hit, longest = _mark_longest(cells, marked_edges)
        if not len(hit):
            return cells, unchanged_count
        unchanged_count -= int(np.count_nonzero(hit < unchanged_count))
        edges = np.setdiff1d(longest, cut)
        cells = replace(
            cells,
            points=np.vstack([cells.points, cells.points[_ends(edges)].mean(axis=1)]),
            depths=np.vstack([cells.depths, midpoint_depths.of(cells.points, edges)]),
        )
        cut = np.concatenate([cut, edges])  # in the order of the new points
        order = np.argsort(cut)
        midpoints = (
            len(cells.points) - len(cut) + order[np.searchsorted(cut, longest, sorter=order)]
        )
        cells = _replace_halved(cells, hit, _ends(longest), midpoints)


def _mark_longest(cells: Cells, marked_edges: Index) -> tuple[Index, Index, Index]:
    """Mark the longest edge of every tetrahedron with a marked edge, until no more are."""
    # Return the marked edges, the tetrahedra that have any, and the longest edge of each of those.
    longest = np.full(len(cells.tetrahedra), -1)
    new_edges = marked_edges = np.unique(marked_edges)
    while len(new_edges):
        reached = _find_with_edges(cells, new_edges)
        reached = reached[longest[reached] < 0]
        longest[reached] = _longest(cells, reached)
        new_edges = np.setdiff1d(longest[reached], marked_edges)
        marked_edges = np.union1d(marked_edges, new_edges)
    hit = np.flatnonzero(longest >= 0)
    return marked_edges, hit, longest[hit]


def _find_with_edges(cells: Cells, edges: Index) -> Index:
    """Return the tetrahedra that have any of some edges, sorted ones."""
    is_touched = np.zeros(len(cells.points), bool)
    is_touched[_ends(edges)] = True
    candidates = np.flatnonzero(np.count_nonzero(is_touched[cells.tetrahedra], axis=1) > 1)
    keys = _keys(cells.tetrahedra[candidates])
    place = np.minimum(np.searchsorted(edges, keys), len(edges) - 1)
    return candidates[(edges[place] == keys).any(axis=1)]


def _longest(cells: Cells, chosen: Index) -> Index:
    """Return the longest edge of the chosen tetrahedra, of equally long ones the last."""
    tetrahedra = cells.tetrahedra[chosen]
    first, second = cells.points[tetrahedra[:, np.array(PAIRS)]].transpose(2, 0, 1, 3)
    length = np.linalg.norm(first - second, axis=2)
    is_longest = length >= length.max(axis=1, keepdims=True, initial=0.0) * (1 - 1e-9)
    return np.where(is_longest, _keys(tetrahedra), -1).max(axis=1, initial=-1)


def _replace_halved(cells: Cells, hit: Index, ends: Index, midpoints: Index) -> Cells:
    """Replace each hit tetrahedron by two that meet in the middle of one of its edges."""
    old = cells.tetrahedra[hit]
    halves = [np.where(old == ends[:, end : end + 1], midpoints[:, None], old) for end in (0, 1)]
    return replace(cells, tetrahedra=np.vstack([np.delete(cells.tetrahedra, hit, 0), *halves]))

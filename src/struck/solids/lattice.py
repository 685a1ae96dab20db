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
Widths = Callable[[Array], Array]  # longest edges wanted at points (K, 3), m (K,)

# Shares of an edge within which the boundary pulls a lattice point over; long edges join two
# corners or two centres, short ones a corner and a centre (their table 1, safe for all shapes).
_LONG, _SHORT = 0.24999, 0.41189
_NOUGHT = 1e-4  # share of an edge within which a point counts as on a surface


def stuffed(depths: Depths, bounds: Array, spacing: float, up: str = "z") -> VolumeMesh:
    """Fill a body with linear tetrahedra: `cells_in` as a mesh."""
    cells = cells_in(depths, bounds, spacing)
    return VolumeMesh(nodes=cells.points, elements=cells.tetrahedra, kind="tet4", up=up)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Judge:
    """Rule that decides which cells are in a body, where some surfaces are carried on past it."""

    joined: tuple[int, ...]  # the surfaces beyond which it may go on
    distance: Depths  # to the body, m: negative inside
    kept: Callable[[Cells], Cells]  # of cells on both sides of each surface, those in the body


def cells_in(
    depths: Depths,
    bounds: Array,
    spacing: float,
    *,
    halved: int = 0,
    judge: Judge | None = None,
    widest: Widths | None = None,
) -> Cells:
    """Fill a body with linear tetrahedra, smaller ones where it is slender, creased or cleft."""
    # `depths`: 1-Lipschitz functions of points (K, 3), m (K,) or (K, n), all negative in the body
    # but for surfaces that a `judge` has joined. At most `halved` edges are halved where a lattice
    # is too coarse for it or longer than the `widest`; more are halved so that neighbours fit.
    lattice = Lattice.over(bounds, spacing)
    whole, is_centre = _lattice_cells(lattice, depths, judge, slender=widest is not None)
    _require_any(whole.tetrahedra, spacing)
    largest = _LARGEST_MISS if judge is None else _MISS_OF_WALLS
    fine = refined(whole, depths, shortest=spacing / 5, most=halved, largest=largest, widest=widest)
    cells = warped(fine, is_centre)
    for surface in range(cells.depths.shape[1]):
        cells = cells.within(surface, beyond=judge is not None)
    if judge is not None:
        cells = judge.kept(cells.compact())
    _require_any(cells.tetrahedra, spacing)
    return cells.compact()


def _lattice_cells(
    lattice: Lattice, depths: Depths, judge: Judge | None, *, slender: bool
) -> tuple[Cells, Mask]:
    """Return the tetrahedra of a lattice that a body may reach, and which points are centres."""
    grids = lattice.sampled(depths)
    edge = lattice.cell.max()
    near = grids
    if judge or slender:  # a part may pass between all points of the lattice
        distance = judge.distance if judge else depths
        near = lattice.sampled(lambda points: _columns(distance, points).max(axis=1) - edge)
    numbers, local = np.unique(lattice.tetrahedra(*near), return_inverse=True)
    values = np.concatenate([each.reshape(-1, each.shape[-1]) for each in grids])[numbers]
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


def warped(cells: Cells, is_centre: Mask) -> Cells:
    """Move points that a surface passes too near onto the nearest crossing."""
    edges = cells.edges()
    found = [cells.crossings(surface, edges) for surface in range(cells.depths.shape[1])]
    ends = np.concatenate([each.edges.T.ravel() for each in found])
    where = np.concatenate([np.tile(each.points, (2, 1)) for each in found])
    there = np.concatenate([np.tile(each.depths, (2, 1)) for each in found])
    nearness = np.concatenate(
        [np.concatenate([each.share, 1 - each.share]) for each in found]
    ) / np.concatenate([np.tile(_reach(each.edges, is_centre), 2) for each in found])
    # Elsewhere a surface bounds nothing; and a point on one that does is where it should be.
    bounding, within = (
        np.asarray((each[:, cells.alone] <= 0).all(axis=1)) for each in (there, cells.depths)
    )
    placed = within & (cells.depths == 0).any(axis=1)
    order = np.lexsort((nearness, ends))
    order = order[(nearness[order] < 1) & bounding[order] & ~placed[ends[order]]]
    moved, first = np.unique(ends[order], return_index=True)
    points, depths = cells.points.copy(), cells.depths.copy()
    points[moved] = where[order[first]]
    depths[moved] = there[order[first]]
    return replace(cells, points=points, depths=depths)


def _reach(edges: Index, is_centre: Mask) -> Array:
    """Return the shares of edges that are safe; points beyond the lattice's own are halfway."""
    known = np.zeros(max(int(edges.max(initial=0)) + 1, len(is_centre)), np.int8)
    known[: len(is_centre)] = np.where(is_centre, 1, -1)
    return np.where(known[edges].prod(axis=1) < 0, _SHORT, _LONG)


_BLOCK = 3  # points a side of a block that one value may serve


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Lattice:
    """Corners and centres of a grid of cells."""

    origin: Array  # lowest corner, m
    cell: Array  # edges of a cell, m
    counts: Index  # cells along each axis

    @classmethod
    def over(cls, bounds: Array, spacing: float) -> Lattice:
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

    def sampled(self, depths: Depths) -> tuple[Array, Array]:
        """Evaluate n 1-Lipschitz functions at corners (I, J, K, n) and centres."""
        # Far from all zeros only the signs are needed, so one value serves a whole block there.
        half = self.cell * _BLOCK / 2
        blocks = -(-(self.counts + 1) // _BLOCK)
        middles = self.origin + half * (2 * _triples(np.arange(np.prod(blocks)), blocks) + 1)
        coarse = _columns(depths, middles)
        # Both ends of an edge that leaves the block must have values of their own.
        reach = np.linalg.norm(half) + max(self.cell.max(), np.linalg.norm(self.cell) / 2)
        near = (np.abs(coarse) <= reach).any(axis=1).reshape(blocks)
        coarse = coarse.reshape(*blocks, -1)
        shapes = (self.counts + 1, self.counts)
        values = np.concatenate([_spread(coarse, s).reshape(-1, coarse.shape[-1]) for s in shapes])
        close = np.flatnonzero(np.concatenate([_spread(near, s).ravel() for s in shapes]))
        values[close] = _columns(depths, self.positions(close))
        corners, centres = np.split(values, [int(np.prod(shapes[0]))])
        return corners.reshape(*shapes[0], -1), centres.reshape(*shapes[1], -1)

    def tetrahedra(self, corners: Array, centres: Array) -> Index:
        """Return the tetrahedra, as point numbers (T, 4), that may reach into the body."""
        # Each joins two neighbouring centres to an edge of the face between their cells. Functions
        # at `corners` (I, J, K, n) and `centres` are negative at one of its corners or more.
        first = int(np.prod(self.counts + 1))
        number = np.arange(first).reshape(self.counts + 1)
        middle = first + np.arange(np.prod(self.counts)).reshape(self.counts)
        parts = []
        for axis in range(3):
            ring = [_face(number, axis, u, v) for u, v in _AROUND]
            ends = [_one_less(middle, axis, 0), _one_less(middle, axis, 1)]
            inside = [_face(corners, axis, u, v) < 0 for u, v in _AROUND]
            inside += [_one_less(centres, axis, 0) < 0, _one_less(centres, axis, 1) < 0]
            chosen = np.any(inside, axis=0).all(axis=-1)
            low, high, *rim = (grid[chosen] for grid in (*ends, *ring))
            parts += [np.stack([low, high, rim[q], rim[q - 3]], axis=1) for q in range(4)]
        return np.vstack(parts)


_AROUND = ((0, 0), (1, 0), (1, 1), (0, 1))


def _columns(depths: Depths, points: Array) -> Array:
    return np.asarray(depths(points), np.float64).reshape(len(points), -1)


def _triples(numbers: Index, counts: Index) -> Array:
    return np.stack(np.unravel_index(numbers, counts), axis=1).astype(np.float64)


def _spread(coarse: AnyArray, counts: Index) -> AnyArray:
    """Repeat a value of each block over the points that lie in it."""
    return coarse[np.ix_(*[np.arange(count) // _BLOCK for count in counts])]


def _one_less(grid: AnyArray, axis: int, start: int) -> AnyArray:
    """Drop the last (start 0) or first (start 1) layer along an axis."""
    return np.take(grid, range(start, grid.shape[axis] - 1 + start), axis=axis)


def _face(grid: AnyArray, axis: int, u: int, v: int) -> AnyArray:
    """Return one corner of the faces between neighbouring cells along an axis."""
    inner = np.take(grid, range(1, grid.shape[axis] - 1), axis=axis)
    return _one_less(_one_less(inner, (axis + 1) % 3, u), (axis + 2) % 3, v)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cells:
    """Tetrahedra with the depths of their corners below the surfaces that bound a body."""

    points: Array  # (K, 3), m
    depths: Array  # (K, n) below n surfaces: negative inside, 0 on the surface, m
    tetrahedra: Index  # (T, 4), point numbers
    joined: tuple[int, ...] = ()  # surfaces beyond which the body may go on

    @property
    def alone(self) -> list[int]:
        """The surfaces that do not join another body."""
        return [each for each in range(self.depths.shape[1]) if each not in self.joined]

    def edges(self) -> Index:
        """Return the edges of the tetrahedra, each once (E, 2)."""
        pairs = np.sort(self.tetrahedra[:, np.array(PAIRS)].reshape(-1, 2), axis=1)
        return unique_rows(pairs)[0]

    def crossings(self, surface: int, edges: Index) -> Crossings:
        """Return where one of the surfaces crosses `edges` (E, 2)."""
        depth = self.depths[:, surface]
        crossed = edges[depth[edges[:, 0]] * depth[edges[:, 1]] < 0]
        first, second = depth[crossed].T
        share = first / (first - second)
        depths = _between(self.depths, crossed, share)
        depths[np.abs(depths) < _NOUGHT * np.abs(first - second)[:, None]] = 0.0
        depths[:, surface] = 0.0
        return Crossings(
            edges=crossed, share=share, points=_between(self.points, crossed, share), depths=depths
        )

    def within(self, surface: int, *, beyond: bool = False) -> Cells:
        """Return tetrahedra cut at a surface: the parts inside it, or with `beyond` all parts."""
        found = self.crossings(surface, self.edges())
        keys = found.edges[:, 0] * len(self.points) + found.edges[:, 1]

        def crossing(a: Index, b: Index) -> Index:
            return len(self.points) + np.searchsorted(
                keys, np.minimum(a, b) * len(self.points) + np.maximum(a, b)
            )

        parts = []
        for sign in (1, -1) if beyond else (1,):
            signs = sign * np.sign(self.depths[:, surface])[self.tetrahedra]
            order = np.argsort(signs, axis=1, kind="stable")
            ordered = np.take_along_axis(self.tetrahedra, order, axis=1)
            inside, outside = (signs < 0).sum(axis=1), (signs > 0).sum(axis=1)
            parts.append(ordered[(outside == 0) & (inside > 0)])
            for (few, many), stencil in _STENCILS.items():
                a, b, c, d = ordered[(inside == few) & (outside == many)].T
                parts += stencil(a, b, c, d, crossing)
        return replace(
            self,
            points=np.vstack([self.points, found.points]),
            depths=np.vstack([self.depths, found.depths]),
            tetrahedra=np.vstack(parts),
        )

    def compact(self) -> Cells:
        """Give all tetrahedra positive volume; drop empty ones and unused points."""
        corners = self.points[self.tetrahedra]
        volumes = np.linalg.det(corners[:, 1:] - corners[:, :1])
        turned = np.where((volumes < 0)[:, None], self.tetrahedra[:, [0, 2, 1, 3]], self.tetrahedra)
        solid = turned[np.abs(volumes) > 1e-9 * np.abs(volumes).max(initial=0.0)]
        used, local = np.unique(solid, return_inverse=True)
        return replace(
            self,
            points=self.points[used],
            depths=self.depths[used],
            tetrahedra=local.reshape(-1, 4),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Crossings:
    """Where edges (E, 2) meet a surface: the share from their first end, points and depths."""

    edges: Index
    share: Array
    points: Array
    depths: Array


def shape_of(corners: Array) -> Array:
    """Return the volume of tetrahedra (T, 4, 3) over that of regular ones with edges as long."""
    # The edges' mean square stands for their length (Liu & Joe 1994).
    corners = corners.transpose(2, 1, 0)
    edges = np.stack([corners[:, b] - corners[:, a] for a, b in PAIRS])
    square = (edges**2).sum(axis=1).mean(axis=0)
    cube = np.maximum(square**1.5, np.finfo(float).tiny)
    return np.sqrt(2) * determinants(edges[:3].transpose(1, 0, 2)) / cube


def determinants(matrices: Array) -> Array:
    """Return the determinants of matrices (3, 3, ...): many small ones, far faster than LU."""
    (a, b, c), (d, e, f), (g, h, i) = matrices
    return a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g)


def _between(values: Array, edges: Index, share: Array) -> Array:
    return values[edges[:, 0]] * (1 - share)[:, None] + values[edges[:, 1]] * share[:, None]


def _prism(bottom: Index, top: Index) -> list[Index]:
    """Split prisms between triangles (m, 3) into three tetrahedra each."""
    # The lowest corner comes first: its faces are halved from it, the third from its own lowest.
    lowest = np.hstack([bottom, top]).argmin(axis=1)
    flipped = (lowest >= 3)[:, None]
    low, high = np.where(flipped, top, bottom), np.where(flipped, bottom, top)
    turn = (lowest[:, None] % 3 + np.arange(3)) % 3
    low, high = np.take_along_axis(low, turn, axis=1), np.take_along_axis(high, turn, axis=1)
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


# Of the depth halfway along an edge against the mean of its ends, over length: more than a wall's
# face may miss would leave a fillet at its foot too thick or too thin.
_LARGEST_MISS, _MISS_OF_WALLS = 0.2, 0.1
_BEYOND = 0.1  # lengths of an edge from a surface at which other surfaces matter no more
_NEAR = 0.5  # lengths of an edge within which surfaces matter to it


def refined(
    cells: Cells,
    depths: Depths,
    *,
    shortest: float,
    most: int,
    largest: float = _LARGEST_MISS,
    widest: Widths | None = None,
) -> Cells:
    """Halve tetrahedra where the surfaces bend or come near each other within one edge."""
    # No edge shorter than twice `shortest`, m, and no more than `most` of them, are asked for; none
    # whose depth halfway misses by less than `largest`, unless it is longer than the `widest`.
    middles = _Middles(depths, cells.depths.shape[1], _NOUGHT * shortest)
    fresh = cells.tetrahedra
    while most > 0:
        edges = np.unique(_keys(fresh))
        miss = _misses(cells, edges, middles, shortest, largest)
        if widest is not None:
            miss = np.maximum(miss, largest * _excess(cells, edges, widest))
        wanted = np.flatnonzero(miss > largest)
        if not len(wanted):
            break
        worst = wanted[np.argsort(-miss[wanted], kind="stable")[:most]]
        most -= len(worst)
        cells, whole = _halved(cells, edges[worst], middles)
        fresh = cells.tetrahedra[whole:]
    return cells


def _keys(tetrahedra: Index) -> Index:
    """Return one number for each edge of each tetrahedron (T, 6)."""
    first, second = tetrahedra[:, np.array(PAIRS)].transpose(2, 0, 1)
    return (np.minimum(first, second) << 32) | np.maximum(first, second)


def _ends(keys: Index) -> Index:
    """Return the ends (E, 2) of edges."""
    return np.stack([keys >> 32, keys & 0xFFFFFFFF], axis=-1)


class _Middles:
    """Depths halfway along edges, each asked for once."""

    def __init__(self, depths: Depths, surfaces: int, nought: float) -> None:
        self._depths, self._nought = depths, nought
        self._keys = np.empty(0, np.int64)
        self._known = np.empty((0, surfaces))

    def of(self, points: Array, edges: Index) -> Array:
        """Return the depths halfway along edges (E, n)."""
        fresh = np.setdiff1d(edges, self._keys)
        if len(fresh):
            found = _columns(self._depths, points[_ends(fresh)].mean(axis=1))
            found[np.abs(found) < self._nought] = 0.0
            keys = np.concatenate([self._keys, fresh])
            order = np.argsort(keys)
            known = np.vstack([self._known, found])
            self._keys, self._known = keys[order], known[order]
        return self._known[np.searchsorted(self._keys, edges)]


def _misses(
    cells: Cells, edges: Index, middles: _Middles, shortest: float, largest: float
) -> Array:
    """Return how far depths halfway are from the mean of both ends, in edge lengths (E,)."""
    # 0 for short edges, and where a 1-Lipschitz function cannot miss by much: the ends are too far
    # from each surface, or too unlike in depth.
    ends = _ends(edges)
    length = np.linalg.norm(cells.points[ends[:, 0]] - cells.points[ends[:, 1]], axis=1)[:, None]
    first, second = cells.depths[ends[:, 0]], cells.depths[ends[:, 1]]
    within = np.maximum(np.abs(first), np.abs(second)) < (_NEAR + 0.5) * length
    alike = np.abs(first - second) < (1 - 2 * largest) * length
    worth = (within & alike).any(axis=1) & (length[:, 0] > 2 * shortest)
    middle = middles.of(cells.points, edges[worth])
    length = length[worth]
    off = np.abs(middle - (first[worth] + second[worth]) / 2) / length
    # Where all of an edge lies well beyond one surface, others bound nothing.
    lowest = np.minimum(np.minimum(first[worth], second[worth]), middle)
    beyond = lowest > _BEYOND * length
    beyond[:, cells.joined] = False
    idle = beyond.sum(axis=1, keepdims=True) > beyond
    misses = np.zeros(len(edges))
    misses[worth] = np.where((np.abs(middle) < _NEAR * length) & ~idle, off, 0.0).max(axis=1)
    return misses


def _excess(cells: Cells, edges: Index, widest: Widths) -> Array:
    """Return the ratio of the length of edges near the body to the wanted length (E,)."""
    ends = _ends(edges)
    length = np.linalg.norm(cells.points[ends[:, 0]] - cells.points[ends[:, 1]], axis=1)
    near = cells.depths[ends].max(axis=2).min(axis=1) < length
    excess = np.zeros(len(edges))
    excess[near] = length[near] / widest(cells.points[ends[near]].mean(axis=1))
    return excess


def _halved(cells: Cells, marked: Index, middles: _Middles) -> tuple[Cells, int]:
    """Halve the marked edges, and others for a fit; return also how many tetrahedra stay whole."""
    # Those left whole come first.
    cut, whole = np.empty(0, np.int64), len(cells.tetrahedra)
    while True:
        marked, hit, longest = _closed(cells, marked)
        if not len(hit):
            return cells, whole
        whole -= int(np.count_nonzero(hit < whole))
        edges = np.setdiff1d(longest, cut)
        cells = replace(
            cells,
            points=np.vstack([cells.points, cells.points[_ends(edges)].mean(axis=1)]),
            depths=np.vstack([cells.depths, middles.of(cells.points, edges)]),
        )
        cut = np.concatenate([cut, edges])  # in the order of the new points
        order = np.argsort(cut)
        middle = len(cells.points) - len(cut) + order[np.searchsorted(cut, longest, sorter=order)]
        cells = _split(cells, hit, _ends(longest), middle)


def _closed(cells: Cells, marked: Index) -> tuple[Index, Index, Index]:
    """Mark the longest edge of every tetrahedron with a marked edge, until no more are."""
    # Return the marked edges, the tetrahedra that have any, and the longest edge of each of those.
    longest = np.full(len(cells.tetrahedra), -1)
    fresh = marked = np.unique(marked)
    while len(fresh):
        reached = _having(cells, fresh)
        reached = reached[longest[reached] < 0]
        longest[reached] = _longest(cells, reached)
        fresh = np.setdiff1d(longest[reached], marked)
        marked = np.union1d(marked, fresh)
    hit = np.flatnonzero(longest >= 0)
    return marked, hit, longest[hit]


def _having(cells: Cells, edges: Index) -> Index:
    """Return the tetrahedra that have any of some edges, sorted ones."""
    touched = np.zeros(len(cells.points), bool)
    touched[_ends(edges)] = True
    likely = np.flatnonzero(np.count_nonzero(touched[cells.tetrahedra], axis=1) > 1)
    keys = _keys(cells.tetrahedra[likely])
    place = np.minimum(np.searchsorted(edges, keys), len(edges) - 1)
    return likely[(edges[place] == keys).any(axis=1)]


def _longest(cells: Cells, chosen: Index) -> Index:
    """Return the longest edge of the chosen tetrahedra, of equally long ones the last."""
    tetrahedra = cells.tetrahedra[chosen]
    first, second = cells.points[tetrahedra[:, np.array(PAIRS)]].transpose(2, 0, 1, 3)
    length = np.linalg.norm(first - second, axis=2)
    longest = length >= length.max(axis=1, keepdims=True, initial=0.0) * (1 - 1e-9)
    return np.where(longest, _keys(tetrahedra), -1).max(axis=1, initial=-1)


def _split(cells: Cells, hit: Index, ends: Index, middle: Index) -> Cells:
    """Replace each hit tetrahedron by two that meet in the middle of one of its edges."""
    old = cells.tetrahedra[hit]
    halves = [np.where(old == ends[:, end : end + 1], middle[:, None], old) for end in (0, 1)]
    return replace(cells, tetrahedra=np.vstack([np.delete(cells.tetrahedra, hit, 0), *halves]))

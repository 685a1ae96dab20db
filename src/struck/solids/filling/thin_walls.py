"""Thin walls of a closed surface: its faces sorted into sheets, each with a distance of its own.

Where a wall is thinner than the lattice that fills it, one distance cannot tell its two faces
apart. So the surface is cut into segments along convex creases and around thin rims; segments that
bound the same wall, or meet at its rim, become different sheets. Each sheet goes on past its border
along its tangent, and what lies behind all of them is the body. Thickness is that of the largest
ball inside that touches the surface (Ma, Bae & Choi 2012, Vis. Comput. 28, 7).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from struck.errors import MeshError
from struck.model.arrays import Array, Index, Mask
from struck.model.mesh import Closest, Mesh, Surface, barycentric
from struck.model.mesh_topology import components, edges_of, turned_faces
from struck.solids.filling.membership import kept
from struck.solids.lattice import Judge
from struck.solids.surface.closedness import crossings
from struck.solids.surface.distance import THINNEST, FilledBody, WalledSheet

_TURNS = 30  # of shrinking a ball: few faces take more than ten
_TOUCHING = 1e-3  # share of its radius by which a ball may overlap the surface
_FACING, _ASKEW = -0.87, -0.5  # cosines between the normals of two faces: a wall, and no wall
_HOLLOW = 0.2  # concave over convex bending up to which a strip is a rim, and no fillet
_INWARD = 1e-6  # of the body's extent, by which rays start below the surface
_CREASE = np.radians(40.0)
_KINK, _ALONE = np.radians(12.0), 2.0  # a smaller crease, and how much sharper than edges alongside
_FLAT, _ALONGSIDE = np.radians(1.0), 0.8  # angle within a flat part, and cosine between two edges
_CARRIED = 1.5  # lattice spacings up to which sheets that are joined count: more than a cell
_REACH = 2.0  # lattice spacings beyond the nearest sheet within which others bound the body too
_MOST_SHEETS = 40
_AROUND_A_ROD = 2.0  # thicknesses along the surface to the opposite side: of a circle, pi / 2
_FEW_FACES = 4_000  # up to which each face is probes at four points


def balls_at(surface: Surface, points: Array, normals: Array, most: Array) -> tuple[Array, Index]:
    """Return the balls inside that touch the surface at `points`: diameters, m, and other faces."""
    # No ball is larger than `most` (K,); where it touches nothing else, its face is -1 (K,).
    radii, touched = most / 2, np.full(len(points), -1)
    active = np.arange(len(points))
    for _ in range(_TURNS):
        centres = points[active] - radii[active, None] * normals[active]
        length, faces, nearest = surface.closest(centres)
        way = points[active] - nearest
        height = np.einsum("kd,kd->k", way, normals[active])
        square = np.einsum("kd,kd->k", way, way)
        over = (length < radii[active] * (1 - _TOUCHING)) & (height > 0)
        active = active[over]
        touched[active] = faces[over]
        radii[active] = np.minimum(radii[active], square[over] / (2 * height[over]))
        if not len(active):
            break
    return 2 * radii, touched


_OFF_PLANE = 0.02  # share of a wall by which its inner face may miss the planes beside a vertex
_MOST_FACETS = 20_000  # of a surface whose inner face is looked for


def with_inner_face(body: FilledBody) -> FilledBody | None:
    """Return a body of flat faces with a wall as the surface that bounds the wall on both sides.

    Each vertex moves inward until it lies as deep as the wall is thick below all faces beside it.
    None where that is impossible, as on curved surfaces whose facets turn both ways, or where the
    inner face would cross itself.
    """
    mesh, wall = body.mesh, body.wall
    if wall is None or len(mesh.faces) > _MOST_FACETS or not len(crisp_edges(mesh)):
        return None
    normals, corners = mesh.face_normals, mesh.faces.ravel()
    squares = np.zeros((len(mesh.points), 3, 3))
    sums = np.zeros((len(mesh.points), 3))
    np.add.at(squares, corners, np.repeat(normals[:, :, None] * normals[:, None, :], 3, axis=0))
    np.add.at(sums, corners, np.repeat(normals, 3, axis=0))
    inward = np.einsum("vij,vj->vi", np.linalg.pinv(squares, rcond=1e-6, hermitian=True), sums)
    depths = np.einsum("fcd,fd->fc", inward[mesh.faces], normals)
    if np.abs(depths - 1).max() > _OFF_PLANE:
        return None
    count = len(mesh.points)
    both = Mesh(
        points=np.vstack([mesh.points, mesh.points - wall * inward]),
        faces=np.vstack([mesh.faces, mesh.faces[:, ::-1] + count]),
        up=mesh.up,
    )
    crossed = both.volume <= 0 or len(crossings(both))
    return None if crossed else FilledBody(mesh=both)


def with_both_faces(sheet: WalledSheet) -> FilledBody | None:
    """Return a one-sided sheet, such as a Moebius strip, as the surface of its wall.

    Going round such a strip once leads to its other face: both are one, here twice as long, which
    stands half a wall off the sheet, and a strip along the rim closes it. None of other sheets.
    """
    mesh, count = sheet.mesh, len(sheet.mesh.faces)
    edges = edges_of(mesh.faces)
    if turned_faces(edges, count) is not None:
        return None
    faces = np.vstack([mesh.faces, mesh.faces[:, ::-1]])  # each face, and its back
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    owner = edges.owner.reshape(-1, 3)
    edge = np.vstack([owner, owner[:, [1, 0, 2]]]).ravel()
    order = np.lexsort((np.arange(len(edge)) // 3 % count, start > end, edge))
    ways = edges.faces_at[edge[order]]
    sides, rim = order[ways == 2].reshape(-1, 4), order[ways == 1].reshape(-1, 2)
    # At each edge a face goes on into that side of its neighbour which runs along the other way.
    here, there = sides[:, [0, 1]].ravel(), sides[:, [3, 2]].ravel()
    joints = np.vstack([np.stack([here, _after(there)], 1), np.stack([_after(here), there], 1)])
    corners = components(joints, len(start))
    points = np.empty((corners.max() + 1, 3))
    points[corners] = mesh.points[start]
    cover = Mesh(points=points, faces=corners.reshape(-1, 3), up=mesh.up)
    (front, back), (ahead, behind) = corners[rim].T, corners[_after(rim)].T
    across = np.vstack([np.stack([ahead, front, behind], 1), np.stack([ahead, behind, back], 1)])
    both = Mesh(
        points=points + sheet.wall / 2 * cover.vertex_normals,
        faces=np.vstack([cover.faces, across]),
        up=mesh.up,
    )
    if len(crossings(both)):
        raise MeshError(
            f"a wall of {sheet.wall:g} m around this one-sided sheet crosses itself: give less "
            "wall="
        )
    return FilledBody(mesh=both)


def _after(sides: Index) -> Index:
    """Return the next side around the same face."""
    return sides // 3 * 3 + (sides + 1) % 3


def crisp_edges(mesh: Mesh) -> Index:
    """Return the pairs of faces (E, 2) that meet at a crease."""
    pairs = edges_of(mesh.faces).pairs()[0]
    return pairs[np.einsum("ed,ed->e", *mesh.face_normals[pairs.T]) < np.cos(_CREASE)]


@dataclass(frozen=True, kw_only=True, eq=False)
class ThinBody:
    """A closed surface around a body that is thin against its size."""

    solid: FilledBody
    is_solid, both_faces = False, True

    @property
    def mesh(self) -> Mesh:
        """Surface of the body."""
        return self.solid.mesh

    @property
    def thickness(self) -> float:
        """Of a plate with the same volume and surface, m."""
        return self.solid.thickness

    @property
    def rough_volume(self) -> float:
        """Volume of the material, m^3."""
        return self.solid.mesh.volume

    def at(self, spacing: float) -> FilledBody | SheetedBody:
        """Return the body as a lattice of some spacing, m, is to see it."""
        segments = Segments.of(self.mesh, spacing / THINNEST)
        if not len(segments.opposed):
            return self.solid
        colours = segments.coloured()
        if colours.max() >= _MOST_SHEETS:  # a jagged surface: each sheet costs a number a cell
            return self.solid
        sheet = np.where(segments.faces < 0, -1, colours[segments.faces])
        sheets = tuple(
            BoundingSheet(self.mesh, np.flatnonzero(sheet == number), np.flatnonzero(sheet < 0))
            for number in range(colours.max() + 1)
        )
        pairs = {(int(a), int(b)) for a, b in np.sort(colours[segments.opposed], axis=1)}
        return SheetedBody(
            solid=self.solid,
            sheets=sheets,
            opposed=tuple(sorted(pairs)),
            spacing=spacing,
            joined=tuple(np.unique(colours[segments.joined]).tolist()),
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class SheetedBody:
    """A closed surface whose faces are sorted into sheets, for a lattice of one spacing."""

    solid: FilledBody
    sheets: tuple[BoundingSheet, ...]
    opposed: tuple[tuple[int, int], ...]  # numbers of sheets that bound the same wall
    spacing: float  # m
    joined: tuple[int, ...]  # numbers of sheets that the body goes on beyond, at concave creases

    @property
    def judge(self) -> Judge:
        """Rule that decides which cells are in the body."""
        distance = self.solid.distance
        return Judge(
            joined=self.joined,
            distance=distance,
            kept=lambda cells: kept(cells, self._heights, distance, self.spacing),
        )

    @property
    def bounds(self) -> Array:
        """Corners of a box around the body, m (2, 3)."""
        return self.solid.bounds

    def _heights(self, points: Array) -> tuple[Array, Array]:
        """Return heights above each sheet and its extension, and distances from them, m (K, n)."""
        # Sheets that are joined end some way past their borders, so that all is continuous.
        found = [sheet.height(points) for sheet in self.sheets]
        heights, lengths = (np.stack(each, axis=1) for each in zip(*found, strict=True))
        joined = list(self.joined)
        beyond = lengths[:, joined] - _CARRIED * self.spacing
        heights[:, joined] = np.maximum(heights[:, joined], beyond)
        return heights, lengths

    def depths(self, points: Array) -> Array:
        """Return depths below each sheet and its extension past the border, m (K, n)."""
        # In the material those of sheets that are not joined are negative.
        distance = self.solid.distance(points)[:, None]
        heights, lengths = self._heights(points)
        joined = np.isin(np.arange(len(self.sheets)), self.joined)
        far = ~joined & (lengths > np.abs(distance) + _REACH * self.spacing)
        heights = np.where(far, -lengths, heights)
        inside = distance <= 0
        heights = np.where(inside & ~joined, np.minimum(heights, distance), heights)
        # Outside, one sheet at least says so.
        best = heights.argmax(axis=1)
        lost = np.flatnonzero(~inside[:, 0] & (heights.max(axis=1) <= 0))
        heights[lost, best[lost]] = distance[lost, 0]
        return heights

    def onto(self, surfaces: tuple[int, ...], points: Array) -> Array:
        """Return points (K, 3) moved onto a sheet, or halfway between two."""
        return np.mean([self.sheets[number].onto(points) for number in surfaces], axis=0)

    def volume(self, _spacing: float) -> float:
        """Return the volume of the material, m^3."""
        return self.solid.mesh.volume


class BoundingSheet:
    """Some faces of a surface that bound a body from one side."""

    def __init__(self, mesh: Mesh, faces: Index, rounded: Index) -> None:
        # `rounded` faces round off a rim: they belong to the sheets on both sides of it.
        self._points, self._faces = mesh.points, mesh.faces[faces]
        self._tree = Closest(mesh.points, self._faces)
        self._whole = Closest(mesh.points, mesh.faces[np.concatenate([faces, rounded])])
        self._normals, self._at_border = _normals(mesh, faces)

    def height(self, points: Array) -> tuple[Array, Array]:
        """Return heights above the sheet and its tangents past it, and distances, m (K,)."""
        length, face, nearest = self._tree.closest(points)
        weights = barycentric(self._points[self._faces[face]], nearest)
        place = _places(weights)
        normals = self._normals[face, place]
        above = np.einsum("kd,kd->k", points - nearest, normals)
        return np.where(self._at_border[face, place], above, np.sign(above) * length), length

    def onto(self, points: Array) -> Array:
        """Return the nearest points, m (K, 3)."""
        return self._whole.closest(points)[2]


_AT = 1e-6  # share of a face's height within which a point counts as on its edge or corner


def _places(weights: Array) -> Index:
    """Return the place of points in a face: corner 0 to 2, opposite edge 3 to 5, inside 6."""
    nought = weights < _AT
    corner = weights.argmax(axis=1)
    edge = 3 + nought.argmax(axis=1)
    count = nought.sum(axis=1)
    return np.where(count > 1, corner, np.where(count == 1, edge, 6))


def _normals(mesh: Mesh, faces: Index) -> tuple[Array, Mask]:
    """Return the normals (F, 7, 3) at the places of each face, and which are on the border."""
    # Sums over the faces that meet there, at corners by their angles (Baerentzen & Aanaes 2005).
    corners = mesh.faces[faces]
    own = mesh.face_normals[faces]
    edges = edges_of(corners)
    sides = np.zeros((len(edges.ends), 3))
    np.add.at(sides, edges.owner, np.repeat(own, 3, axis=0))
    opposite = edges.owner.reshape(-1, 3)[:, [1, 2, 0]]
    ways = mesh.points[np.roll(corners, -1, axis=1)] - mesh.points[corners]
    ways /= np.maximum(np.linalg.norm(ways, axis=2, keepdims=True), np.finfo(float).tiny)
    cosines = -np.einsum("fcd,fcd->fc", ways, np.roll(ways, 1, axis=1))
    angles = np.arccos(np.clip(cosines, -1, 1))
    around = np.zeros((len(mesh.points), 3))
    np.add.at(around, corners.ravel(), (angles[:, :, None] * own[:, None]).reshape(-1, 3))
    rim = np.zeros(len(mesh.points), bool)
    rim[edges.ends[edges.faces_at == 1]] = True
    found = np.concatenate([around[corners], sides[opposite], own[:, None]], axis=1)
    border = np.concatenate(
        [rim[corners], edges.faces_at[opposite] == 1, np.zeros((len(faces), 1), bool)], axis=1
    )
    lengths = np.linalg.norm(found, axis=2, keepdims=True)
    return found / np.maximum(lengths, np.finfo(float).tiny), border


@dataclass(frozen=True, kw_only=True, eq=False)
class Segments:
    """Parts of a surface between convex creases and rims, and which have a wall between them."""

    faces: Index  # (F,) segment of each face; -1 where it rounds off a rim
    areas: Array  # (S,), m^2
    opposed: Index  # (P, 2) segments that bound the same wall
    joined: Index  # (P, 2) segments that meet at a concave crease
    apart: Index  # (P, 2) segments that cannot be one sheet: these, and those that one cell may see

    @classmethod
    def of(cls, mesh: Mesh, thin: float) -> Self:
        """Cut a surface where it goes round walls of less than `thin`, m."""
        probes = _ThicknessProbes.of(mesh, thin)
        pairs = edges_of(mesh.faces).pairs()[0]
        bend = _bends(mesh, pairs)
        bent, rim = _rims(mesh, probes, pairs, bend)
        crisp = _crisp(mesh, pairs, bend)
        cut = (crisp & (bend > 0)) | (rim[pairs[:, 0]] != rim[pairs[:, 1]])
        cleft = crisp & (bend < 0) & probes.thin[pairs].any(axis=1)
        bent |= _crumbs(mesh, pairs, bent, cut | cleft, thin)
        kept = ~bent
        whole = kept[pairs].all(axis=1)
        smooth = whole & ~cut & ~cleft
        labels = components(pairs[smooth], len(mesh.faces))
        labels = _unfolded(mesh, smooth, labels, probes.opposed, thin)
        rounded = components(pairs[~kept[pairs].any(axis=1)], len(mesh.faces))
        labels = np.where(kept, labels, -1)
        across = pairs[whole & (cut | cleft) & probes.thin[pairs].any(axis=1)]
        met = [_distinct(labels[each]) for each in (probes.opposed, across, probes.beside)]
        met.append(_around(labels, rounded, pairs[kept[pairs].sum(axis=1) == 1], kept))
        met.append(_close(mesh, labels, 2 * _CARRIED * THINNEST * thin))
        return cls(
            faces=labels,
            areas=np.asarray(np.bincount(labels[kept], weights=mesh.areas[kept]), np.float64),
            opposed=met[0],
            joined=_distinct(labels[pairs[whole & cleft]]),
            apart=np.vstack(met),
        )

    def coloured(self) -> Index:
        """Return the layer of a wall in which each part of the surface lies (S,), of the fewest."""
        sheets = np.full(len(self.areas), -1)
        both = np.vstack([self.apart, self.apart[:, ::-1]])
        joined = np.isin(np.arange(len(sheets)), self.joined)
        for segment in np.argsort(-self.areas, kind="stable"):
            taken = set(sheets[both[both[:, 0] == segment, 1]].tolist())
            taken |= set(sheets[joined != joined[segment]].tolist())
            sheets[segment] = next(i for i in range(len(taken) + 1) if i not in taken)
        return sheets


def _unfolded(mesh: Mesh, smooth: Mask, labels: Index, opposed: Index, thin: float) -> Index:
    """Return labels (F,) with segments cut that are both faces of a wall, as on a Moebius strip.

    Three bands, by their way from one face, are each no longer opposite themselves. A rod stays
    whole: the way around it is short.
    """
    count = labels.max() + 1
    opposed = opposed[(labels[opposed] >= 0).all(axis=1)]
    sides = labels[opposed]
    own = np.bincount(sides[sides[:, 0] == sides[:, 1], 0], minlength=count)
    folded = np.flatnonzero(4 * own > np.bincount(sides.ravel(), minlength=count))
    if not len(folded):
        return labels
    edges = edges_of(mesh.faces)
    pairs, ends = edges.pairs()[0][smooth], edges.ends[edges.shared][smooth]
    chosen = np.isin(labels[pairs], folded).all(axis=1)
    inside = pairs[chosen]
    along = np.diff(mesh.points[ends[chosen]], axis=1)[:, 0]
    # Across the edge alone: middles of two slivers beside it may be far from each other along it.
    across = np.cross(along, np.diff(mesh.centroids[inside], axis=1)[:, 0])
    ways = np.linalg.norm(across, axis=1) / np.linalg.norm(along, axis=1)
    graph = sparse.coo_array((ways, inside.T), shape=(len(labels), len(labels))).tocsr()
    bands = np.zeros(len(labels), np.int64)
    for segment in folded:
        faces = np.flatnonzero(labels == segment)
        far = np.zeros(len(labels))
        far[faces] = dijkstra(graph, directed=False, indices=faces[0])[faces]
        ways = np.abs(np.diff(far[opposed[(sides == segment).all(axis=1)]]))
        if np.median(ways) > _AROUND_A_ROD * thin:
            bands[faces] = np.minimum(3 * far[faces] / far.max(), 2).astype(np.int64)
    cut = components(pairs[bands[pairs[:, 0]] == bands[pairs[:, 1]]], len(labels))
    return np.where(labels < 0, -1, cut)


def _distinct(pairs: Index) -> Index:
    """Return pairs (P, 2) of two different segments, each once."""
    return np.unique(pairs[(pairs >= 0).all(axis=1) & (pairs[:, 0] != pairs[:, 1])], axis=0)


def _bends(mesh: Mesh, pairs: Index) -> Array:
    """Return the angles between neighbouring faces (P, 2), rad: above 0 where they are convex."""
    first, second = mesh.face_normals[pairs.T]
    angles = np.arccos(np.clip(np.einsum("pd,pd->p", first, second), -1, 1))
    way = mesh.centroids[pairs[:, 1]] - mesh.centroids[pairs[:, 0]]
    return np.where(np.einsum("pd,pd->p", first, way) < 0, angles, -angles)


def _crisp(mesh: Mesh, pairs: Index, bend: Array) -> Mask:
    """Return where neighbouring faces (P, 2) meet at a crease, and do not follow a curve."""
    # A curve turns about as much at the next edge that runs alongside, on the same flat part.
    edges, turns = edges_of(mesh.faces), np.abs(bend)
    ends = edges.ends[edges.shared]
    number = np.where(edges.shared, np.cumsum(edges.shared) - 1, -1)
    at = number[edges.owner].reshape(-1, 3)  # the pairs that each face is one of
    own = np.arange(len(at))[:, None]
    flat = (at >= 0) & (turns[at] < _FLAT)
    part = np.hstack([own, np.where(flat, pairs[at].sum(axis=2) - own, own)])
    near = at[part[pairs]].reshape(len(pairs), -1)
    way = mesh.points[ends[:, 1]] - mesh.points[ends[:, 0]]
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    alongside = np.abs(np.einsum("pd,pkd->pk", way, way[near])) > _ALONGSIDE
    apart = (ends[near][:, :, :, None] != ends[:, None, None, :]).all(axis=(2, 3))
    curve = (near >= 0) & alongside & apart & (turns[near] <= _CREASE)
    beside = np.where(curve, turns[near], 0.0).max(axis=1)
    return (turns > _CREASE) | ((turns > _KINK) & (turns > _ALONE * beside))


def _rims(mesh: Mesh, probes: _ThicknessProbes, pairs: Index, bend: Array) -> tuple[Mask, Mask]:
    """Return which faces round off the rim of a wall, and which are its rim (F,) each."""
    strip = probes.bent | probes.rim
    inner = strip[pairs].all(axis=1) & (bend <= _CREASE)
    labels = components(pairs[inner], len(mesh.faces))
    beside = strip[pairs].any(axis=1) & (bend <= _CREASE)
    met, angle = pairs[beside], bend[beside]
    owner = labels[np.where(strip[met[:, 0]], met[:, 0], met[:, 1])]
    convex, hollow = (
        np.bincount(owner, weights=np.maximum(sign * angle, 0), minlength=len(strip))
        for sign in (1, -1)
    )
    has_rim = np.bincount(labels, weights=probes.rim, minlength=len(strip)) > 0
    # One face alone that goes on smoothly is half of a facet that a wall's foot passes.
    several = np.bincount(labels, minlength=len(strip)) > 1
    is_rim = strip & (has_rim & several & (hollow <= _HOLLOW * convex))[labels]
    return is_rim & probes.bent, is_rim & probes.rim


def _crumbs(mesh: Mesh, pairs: Index, bent: Mask, cut: Mask, thin: float) -> Mask:
    """Return the mask of faces in small parts of the surface next to a rounded rim (F,)."""
    whole = ~bent[pairs].any(axis=1)
    labels = components(pairs[whole & ~cut], len(mesh.faces))
    areas = np.bincount(labels, weights=mesh.areas)
    rounds = np.zeros(len(areas), bool)
    rounds[labels[pairs[bent[pairs].any(axis=1)]]] = True
    return (rounds & (areas < thin**2))[labels]


def _close(mesh: Mesh, labels: Index, reach: float) -> Index:
    """Return the segments (P, 2) whose creases pass within `reach`, m: one cell may see both."""
    edges = edges_of(mesh.faces)
    sides = labels[edges.pairs()[0]]
    crease = (sides[:, 0] != sides[:, 1]) & (sides >= 0).all(axis=1)
    start, end = mesh.points[edges.ends[edges.shared][crease]].transpose(1, 0, 2)
    counts = np.ceil(2 * np.linalg.norm(end - start, axis=1) / reach).astype(np.int64) + 1
    edge = np.repeat(np.arange(len(counts)), counts)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    share = (step / np.maximum(counts - 1, 1)[edge])[:, None]
    points = start[edge] * (1 - share) + end[edge] * share
    near = KDTree(points).query_pairs(reach, output_type="ndarray")
    met = np.unique(np.stack([edge[near[:, 0]], edge[near[:, 1]]], axis=1), axis=0)
    every = sides[crease][met]
    both = np.broadcast_arrays(every[:, 0, :, None], every[:, 1, None, :])
    return _distinct(np.stack(both, axis=-1).reshape(-1, 2))


def _around(labels: Index, rounded: Index, pairs: Index, kept: Mask) -> Index:
    """Return the segments (P, 2) that meet around the same rounded rim."""
    inner = np.where(kept[pairs[:, 0]], pairs[:, 0], pairs[:, 1])
    outer = np.where(kept[pairs[:, 0]], pairs[:, 1], pairs[:, 0])
    met = np.unique(np.stack([rounded[outer], labels[inner]], axis=1), axis=0)
    found = [
        (a, b)
        for rim in np.unique(met[:, 0])
        for a in met[met[:, 0] == rim, 1]
        for b in met[met[:, 0] == rim, 1]
        if a < b
    ]
    return np.array(found, np.int64).reshape(-1, 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class _ThicknessProbes:
    """Thickness and opposite faces of each face, measured by balls and rays inside the surface."""

    thin: Mask  # (F,): a wall or its rim
    bent: Mask  # (F,): near a wall's rim, or where a wall leaves a thicker part
    rim: Mask  # (F,): material goes on below, though a thin wall begins or ends there
    opposed: Index  # (P, 2) faces with a thin wall between them
    beside: Index  # (P, 2) faces that the same small ball touches

    @classmethod
    def of(cls, mesh: Mesh, thin: float) -> Self:
        surface = Surface(mesh)
        face, points = _probes(mesh)
        normals = mesh.face_normals[face]
        below, depth = surface.first_below(points - _INWARD * mesh.extent * normals, -normals)
        # A ball that reaches through the body is no larger, and far from a middle of all faces.
        across, touched = balls_at(surface, points, normals, np.minimum(depth, 2 * thin))
        slender = across < thin
        cosine = np.einsum("kd,kd->k", normals, mesh.face_normals[below])
        wall = (depth < thin) & (cosine < _FACING)
        middle = slice(len(mesh.faces))  # the first point of each face is its middle
        rim = slender & ~wall & ((depth >= thin) | (cosine > _ASKEW))
        pairs = np.stack([face, touched], axis=1)[slender]
        return cls(
            thin=(slender | wall)[middle],
            bent=(slender & ~wall & ~rim)[middle],
            rim=rim[middle],
            opposed=np.unique(np.stack([face, below], axis=1)[wall], axis=0),
            beside=np.unique(pairs[pairs[:, 1] >= 0], axis=0),
        )


def _probes(mesh: Mesh) -> tuple[Index, Array]:
    """Return faces (K,) and points on them (K, 3): all middles first, then more of few faces."""
    every = np.arange(len(mesh.faces))
    if len(every) > _FEW_FACES:
        return every, mesh.centroids
    between = (mesh.points[mesh.faces] + mesh.centroids[:, None]) / 2
    points = np.vstack([mesh.centroids, between.reshape(-1, 3)])
    return np.concatenate([every, np.repeat(every, 3)]), points

"""Thin walls of a closed surface: its faces sorted into sheets, each with a separate distance.

Where a wall is thinner than the lattice that fills it, one distance cannot distinguish its two
faces. So the surface is cut into segments along convex creases and around thin rims; segments that
bound the same wall, or meet at its rim, become different sheets. Each sheet is extended past its
border along its tangent, and the body lies behind all of them. Thickness is that of the largest
ball inside that touches the surface (Ma, Bae & Choi 2012, Vis. Comput. 28, 7).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from struck.errors import MeshError, rounded
from struck.model.arrays import Array, Index, Mask
from struck.model.mesh import Closest, Mesh, Surface, barycentric
from struck.model.mesh_topology import components, edges_of, turned_faces
from struck.solids.filling.membership import select_cells
from struck.solids.lattice import Judge
from struck.solids.surface.closedness import crossings
from struck.solids.surface.distance import MAX_SPACING_RATIO, FilledBody, WalledSheet

_MAX_STEPS = 30  # of shrinking a ball: few faces take more than ten
_TOUCHING = 1e-3  # fraction of its radius by which a ball may overlap the surface
# Cosines between the normals of two faces: a wall, and no wall.
_FACING_COSINE, _ASKEW_COSINE = -0.87, -0.5
_HOLLOW_RATIO = 0.2  # concave over convex bending up to which a strip is a rim, and no fillet
_INWARD = 1e-6  # of the body's extent, by which rays start below the surface
_CREASE_ANGLE = np.radians(40.0)
# A smaller crease, and how much sharper than edges alongside.
_KINK_ANGLE, _SHARPNESS_RATIO = np.radians(12.0), 2.0
# Angle within a flat part, and cosine between two edges.
_FLAT_ANGLE, _ALONGSIDE_COSINE = np.radians(1.0), 0.8
_EXTENSION = 1.5  # lattice spacings up to which sheets that are joined count: more than a cell
_REACH = 2.0  # lattice spacings beyond the nearest sheet within which others bound the body too
_MAX_SHEETS = 40
_AROUND_A_ROD = 2.0  # thicknesses along the surface to the opposite side: of a circle, pi / 2
_FEW_FACES = 4_000  # up to which each face is probes at four points


def balls_at(
    surface: Surface, points: Array, normals: Array, max_diameters: Array
) -> tuple[Array, Index]:
    """Return the balls inside that touch the surface at `points`: diameters, m, and other faces."""
    # No ball is larger than `max_diameters` (K,); if it touches nothing else, its face is -1 (K,).
    radii, touched_faces = max_diameters / 2, np.full(len(points), -1)
    active = np.arange(len(points))
    for _ in range(_MAX_STEPS):
        centres = points[active] - radii[active, None] * normals[active]
        length, faces, nearest_points = surface.closest(centres)
        vectors = points[active] - nearest_points
        height = np.einsum("kd,kd->k", vectors, normals[active])
        square = np.einsum("kd,kd->k", vectors, vectors)
        is_overlapping = (length < radii[active] * (1 - _TOUCHING)) & (height > 0)
        active = active[is_overlapping]
        touched_faces[active] = faces[is_overlapping]
        radii[active] = np.minimum(
            radii[active], square[is_overlapping] / (2 * height[is_overlapping])
        )
        if not len(active):
            break
    return 2 * radii, touched_faces


_OFF_PLANE = 0.02  # fraction of a wall by which its inner face may miss the planes at a vertex
_MAX_FACETS = 20_000  # of a surface whose inner face is looked for


def add_inner_face(body: FilledBody) -> FilledBody | None:
    """Return a body of flat faces with a wall as the surface that bounds the wall on both sides.

    Each vertex moves inward until it lies as deep as the wall is thick below all faces around it.
    None where that is impossible, as on curved surfaces that are convex and concave, or where the
    inner face would cross itself.
    """
    mesh, wall = body.mesh, body.wall
    if wall is None or len(mesh.faces) > _MAX_FACETS or not len(crisp_edges(mesh)):
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
    both_sides = Mesh(
        points=np.vstack([mesh.points, mesh.points - wall * inward]),
        faces=np.vstack([mesh.faces, mesh.faces[:, ::-1] + count]),
        up=mesh.up,
    )
    is_crossing = both_sides.volume <= 0 or len(crossings(both_sides))
    return None if is_crossing else FilledBody(mesh=both_sides)


def add_both_faces(sheet: WalledSheet) -> FilledBody | None:
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
    face_counts = edges.faces_at[edge[order]]
    sides, rim = order[face_counts == 2].reshape(-1, 4), order[face_counts == 1].reshape(-1, 2)
    # At each edge a face continues in that side of its neighbour which runs in the other direction.
    first_sides, second_sides = sides[:, [0, 1]].ravel(), sides[:, [3, 2]].ravel()
    joints = np.vstack(
        [
            np.stack([first_sides, _next_side(second_sides)], 1),
            np.stack([_next_side(first_sides), second_sides], 1),
        ]
    )
    corners = components(joints, len(start))
    points = np.empty((corners.max() + 1, 3))
    points[corners] = mesh.points[start]
    cover = Mesh(points=points, faces=corners.reshape(-1, 3), up=mesh.up)
    (front, back), (front_end, back_end) = corners[rim].T, corners[_next_side(rim)].T
    rim_faces = np.vstack(
        [np.stack([front_end, front, back_end], 1), np.stack([front_end, back_end, back], 1)]
    )
    both_sides = Mesh(
        points=points + sheet.wall / 2 * cover.vertex_normals,
        faces=np.vstack([cover.faces, rim_faces]),
        up=mesh.up,
    )
    if len(crossings(both_sides)):
        raise MeshError(
            f"a wall of {rounded(sheet.wall)} m around this one-sided sheet crosses itself: give "
            "less wall="
        )
    return FilledBody(mesh=both_sides)


def _next_side(sides: Index) -> Index:
    """Return the next side around the same face."""
    return sides // 3 * 3 + (sides + 1) % 3


def crisp_edges(mesh: Mesh) -> Index:
    """Return the pairs of faces (E, 2) that meet at a crease."""
    pairs = edges_of(mesh.faces).pairs()[0]
    return pairs[np.einsum("ed,ed->e", *mesh.face_normals[pairs.T]) < np.cos(_CREASE_ANGLE)]


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
        """Thickness of a plate with the same volume and surface, m."""
        return self.solid.thickness

    @property
    def rough_volume(self) -> float:
        """Volume of the material, m^3."""
        return self.solid.mesh.volume

    def at(self, spacing: float) -> FilledBody | SheetedBody:
        """Return the body as a lattice of some spacing, m, is to see it."""
        segments = Segments.of(self.mesh, spacing / MAX_SPACING_RATIO)
        if not len(segments.opposed):
            return self.solid
        colours = segments.colour()
        if colours.max() >= _MAX_SHEETS:  # a jagged surface: each sheet costs a number a cell
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
    joined: tuple[int, ...]  # numbers of sheets that the body extends beyond, at concave creases

    @property
    def judge(self) -> Judge:
        """Rule that decides which cells are in the body."""
        distance = self.solid.distance
        return Judge(
            joined=self.joined,
            distance=distance,
            select_cells=lambda cells: select_cells(cells, self._heights, distance, self.spacing),
        )

    @property
    def bounds(self) -> Array:
        """Corners of a box around the body, m (2, 3)."""
        return self.solid.bounds

    def _heights(self, points: Array) -> tuple[Array, Array]:
        """Return heights above each sheet and its extension, and distances from them, m (K, n)."""
        # Sheets that are joined end some way past their borders, so that all is continuous.
        sheet_heights = [sheet.height(points) for sheet in self.sheets]
        heights, lengths = (np.stack(column, axis=1) for column in zip(*sheet_heights, strict=True))
        joined_sheets = list(self.joined)
        overshoot = lengths[:, joined_sheets] - _EXTENSION * self.spacing
        heights[:, joined_sheets] = np.maximum(heights[:, joined_sheets], overshoot)
        return heights, lengths

    def depths(self, points: Array) -> Array:
        """Return depths below each sheet and its extension past the border, m (K, n)."""
        # In the material those of sheets that are not joined are negative.
        distance = self.solid.distance(points)[:, None]
        heights, lengths = self._heights(points)
        is_joined = np.isin(np.arange(len(self.sheets)), self.joined)
        is_far = ~is_joined & (lengths > np.abs(distance) + _REACH * self.spacing)
        heights = np.where(is_far, -lengths, heights)
        is_inside = distance <= 0
        heights = np.where(is_inside & ~is_joined, np.minimum(heights, distance), heights)
        # Outside, at least one height must be positive.
        highest_sheets = heights.argmax(axis=1)
        wrong_points = np.flatnonzero(~is_inside[:, 0] & (heights.max(axis=1) <= 0))
        heights[wrong_points, highest_sheets[wrong_points]] = distance[wrong_points, 0]
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
        place = _find_places(weights)
        normals = self._normals[face, place]
        above = np.einsum("kd,kd->k", points - nearest, normals)
        return np.where(self._at_border[face, place], above, np.sign(above) * length), length

    def onto(self, points: Array) -> Array:
        """Return the nearest points, m (K, 3)."""
        return self._whole.closest(points)[2]


# Fraction of a face's height within which a point counts as on its edge or corner.
_EDGE_TOLERANCE = 1e-6


def _find_places(weights: Array) -> Index:
    """Return the place of points in a face: corner 0 to 2, opposite edge 3 to 5, inside 6."""
    is_zero = weights < _EDGE_TOLERANCE
    corner = weights.argmax(axis=1)
    edge = 3 + is_zero.argmax(axis=1)
    count = is_zero.sum(axis=1)
    return np.where(count > 1, corner, np.where(count == 1, edge, 6))


def _normals(mesh: Mesh, faces: Index) -> tuple[Array, Mask]:
    """Return the normals (F, 7, 3) at the places of each face, and which are on the border."""
    # Sums over the faces that meet there, at corners by their angles (Baerentzen & Aanaes 2005).
    corners = mesh.faces[faces]
    face_normals = mesh.face_normals[faces]
    edges = edges_of(corners)
    sides = np.zeros((len(edges.ends), 3))
    np.add.at(sides, edges.owner, np.repeat(face_normals, 3, axis=0))
    opposite_edges = edges.owner.reshape(-1, 3)[:, [1, 2, 0]]
    edge_vectors = mesh.points[np.roll(corners, -1, axis=1)] - mesh.points[corners]
    edge_vectors /= np.maximum(
        np.linalg.norm(edge_vectors, axis=2, keepdims=True), np.finfo(float).tiny
    )
    cosines = -np.einsum("fcd,fcd->fc", edge_vectors, np.roll(edge_vectors, 1, axis=1))
    angles = np.arccos(np.clip(cosines, -1, 1))
    vertex_normals = np.zeros((len(mesh.points), 3))
    np.add.at(
        vertex_normals, corners.ravel(), (angles[:, :, None] * face_normals[:, None]).reshape(-1, 3)
    )
    is_rim = np.zeros(len(mesh.points), bool)
    is_rim[edges.ends[edges.faces_at == 1]] = True
    normals = np.concatenate(
        [vertex_normals[corners], sides[opposite_edges], face_normals[:, None]], axis=1
    )
    is_border = np.concatenate(
        [is_rim[corners], edges.faces_at[opposite_edges] == 1, np.zeros((len(faces), 1), bool)],
        axis=1,
    )
    lengths = np.linalg.norm(normals, axis=2, keepdims=True)
    return normals / np.maximum(lengths, np.finfo(float).tiny), is_border


@dataclass(frozen=True, kw_only=True, eq=False)
class Segments:
    """Parts of a surface between convex creases and rims, and which have a wall between them."""

    faces: Index  # (F,) segment of each face; -1 where it rounds off a rim
    areas: Array  # (S,), m^2
    opposed: Index  # (P, 2) segments that bound the same wall
    joined: Index  # (P, 2) segments that meet at a concave crease
    # (P, 2) segments that cannot be one sheet: the opposed ones, and those that one cell may see
    disjoint: Index

    @classmethod
    def of(cls, mesh: Mesh, thin: float) -> Self:
        """Cut a surface where it goes round walls of less than `thin`, m."""
        probes = _ThicknessProbes.of(mesh, thin)
        pairs = edges_of(mesh.faces).pairs()[0]
        angles = _bends(mesh, pairs)
        is_bent, is_rim = _rims(mesh, probes, pairs, angles)
        is_crisp = _crisp(mesh, pairs, angles)
        is_cut = (is_crisp & (angles > 0)) | (is_rim[pairs[:, 0]] != is_rim[pairs[:, 1]])
        is_cleft = is_crisp & (angles < 0) & probes.thin[pairs].any(axis=1)
        is_bent |= _crumbs(mesh, pairs, is_bent, is_cut | is_cleft, thin)
        is_labelled = ~is_bent
        is_whole = is_labelled[pairs].all(axis=1)
        is_smooth = is_whole & ~is_cut & ~is_cleft
        labels = components(pairs[is_smooth], len(mesh.faces))
        labels = _cut_folded(mesh, is_smooth, labels, probes.opposed, thin)
        rim_labels = components(pairs[~is_labelled[pairs].any(axis=1)], len(mesh.faces))
        labels = np.where(is_labelled, labels, -1)
        crease_pairs = pairs[is_whole & (is_cut | is_cleft) & probes.thin[pairs].any(axis=1)]
        disjoint_pairs = [
            _select_distinct(labels[segment_pairs])
            for segment_pairs in (probes.opposed, crease_pairs, probes.touching)
        ]
        disjoint_pairs.append(
            _meet_around_rims(
                labels, rim_labels, pairs[is_labelled[pairs].sum(axis=1) == 1], is_labelled
            )
        )
        disjoint_pairs.append(
            _find_near_segments(mesh, labels, 2 * _EXTENSION * MAX_SPACING_RATIO * thin)
        )
        return cls(
            faces=labels,
            areas=np.asarray(
                np.bincount(labels[is_labelled], weights=mesh.areas[is_labelled]), np.float64
            ),
            opposed=disjoint_pairs[0],
            joined=_select_distinct(labels[pairs[is_whole & is_cleft]]),
            disjoint=np.vstack(disjoint_pairs),
        )

    def colour(self) -> Index:
        """Return the layer of a wall in which each part of the surface lies (S,), of the fewest."""
        sheets = np.full(len(self.areas), -1)
        directed_pairs = np.vstack([self.disjoint, self.disjoint[:, ::-1]])
        is_joined = np.isin(np.arange(len(sheets)), self.joined)
        for segment in np.argsort(-self.areas, kind="stable"):
            used_sheets = set(sheets[directed_pairs[directed_pairs[:, 0] == segment, 1]].tolist())
            used_sheets |= set(sheets[is_joined != is_joined[segment]].tolist())
            sheets[segment] = next(i for i in range(len(used_sheets) + 1) if i not in used_sheets)
        return sheets


def _cut_folded(mesh: Mesh, smooth: Mask, labels: Index, opposed: Index, thin: float) -> Index:
    """Return labels (F,) with segments cut that are both faces of a wall, as on a Moebius strip.

    They are cut into three bands by their distance from one face, none of which is opposite to
    itself. A rod stays whole: the path around it is short.
    """
    count = labels.max() + 1
    opposed = opposed[(labels[opposed] >= 0).all(axis=1)]
    sides = labels[opposed]
    self_opposed_counts = np.bincount(sides[sides[:, 0] == sides[:, 1], 0], minlength=count)
    folded_segments = np.flatnonzero(
        4 * self_opposed_counts > np.bincount(sides.ravel(), minlength=count)
    )
    if not len(folded_segments):
        return labels
    edges = edges_of(mesh.faces)
    pairs, ends = edges.pairs()[0][smooth], edges.ends[edges.shared][smooth]
    chosen = np.isin(labels[pairs], folded_segments).all(axis=1)
    inner_pairs = pairs[chosen]
    edge_vectors = np.diff(mesh.points[ends[chosen]], axis=1)[:, 0]
    # Only the distance across the edge: centroids of two slivers at it may be far apart along it.
    cross_products = np.cross(edge_vectors, np.diff(mesh.centroids[inner_pairs], axis=1)[:, 0])
    distances = np.linalg.norm(cross_products, axis=1) / np.linalg.norm(edge_vectors, axis=1)
    graph = sparse.coo_array((distances, inner_pairs.T), shape=(len(labels), len(labels))).tocsr()
    bands = np.zeros(len(labels), np.int64)
    for segment in folded_segments:
        faces = np.flatnonzero(labels == segment)
        path_lengths = np.zeros(len(labels))
        path_lengths[faces] = dijkstra(graph, directed=False, indices=faces[0])[faces]
        distances = np.abs(np.diff(path_lengths[opposed[(sides == segment).all(axis=1)]]))
        if np.median(distances) > _AROUND_A_ROD * thin:
            bands[faces] = np.minimum(3 * path_lengths[faces] / path_lengths.max(), 2).astype(
                np.int64
            )
    cut = components(pairs[bands[pairs[:, 0]] == bands[pairs[:, 1]]], len(labels))
    return np.where(labels < 0, -1, cut)


def _select_distinct(pairs: Index) -> Index:
    """Return pairs (P, 2) of two different segments, each once."""
    return np.unique(pairs[(pairs >= 0).all(axis=1) & (pairs[:, 0] != pairs[:, 1])], axis=0)


def _bends(mesh: Mesh, pairs: Index) -> Array:
    """Return the angles between neighbouring faces (P, 2), rad: above 0 where they are convex."""
    first, second = mesh.face_normals[pairs.T]
    angles = np.arccos(np.clip(np.einsum("pd,pd->p", first, second), -1, 1))
    steps = mesh.centroids[pairs[:, 1]] - mesh.centroids[pairs[:, 0]]
    return np.where(np.einsum("pd,pd->p", first, steps) < 0, angles, -angles)


def _crisp(mesh: Mesh, pairs: Index, bend: Array) -> Mask:
    """Return where neighbouring faces (P, 2) meet at a crease, and do not follow a curve."""
    # A curve turns about as much at the next edge that runs alongside, on the same flat part.
    edges, bend_angles = edges_of(mesh.faces), np.abs(bend)
    ends = edges.ends[edges.shared]
    number = np.where(edges.shared, np.cumsum(edges.shared) - 1, -1)
    at = number[edges.owner].reshape(-1, 3)  # the pairs that each face is one of
    face_numbers = np.arange(len(at))[:, None]
    is_flat = (at >= 0) & (bend_angles[at] < _FLAT_ANGLE)
    part = np.hstack(
        [face_numbers, np.where(is_flat, pairs[at].sum(axis=2) - face_numbers, face_numbers)]
    )
    neighbours = at[part[pairs]].reshape(len(pairs), -1)
    directions = mesh.points[ends[:, 1]] - mesh.points[ends[:, 0]]
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    is_alongside = (
        np.abs(np.einsum("pd,pkd->pk", directions, directions[neighbours])) > _ALONGSIDE_COSINE
    )
    is_disjoint = (ends[neighbours][:, :, :, None] != ends[:, None, None, :]).all(axis=(2, 3))
    is_curve = (
        (neighbours >= 0) & is_alongside & is_disjoint & (bend_angles[neighbours] <= _CREASE_ANGLE)
    )
    neighbour_angles = np.where(is_curve, bend_angles[neighbours], 0.0).max(axis=1)
    return (bend_angles > _CREASE_ANGLE) | (
        (bend_angles > _KINK_ANGLE) & (bend_angles > _SHARPNESS_RATIO * neighbour_angles)
    )


def _rims(mesh: Mesh, probes: _ThicknessProbes, pairs: Index, bend: Array) -> tuple[Mask, Mask]:
    """Return which faces round off the rim of a wall, and which are its rim (F,) each."""
    strip = probes.bent | probes.rim
    is_inner = strip[pairs].all(axis=1) & (bend <= _CREASE_ANGLE)
    labels = components(pairs[is_inner], len(mesh.faces))
    is_next_to = strip[pairs].any(axis=1) & (bend <= _CREASE_ANGLE)
    border_pairs, border_angles = pairs[is_next_to], bend[is_next_to]
    owner = labels[np.where(strip[border_pairs[:, 0]], border_pairs[:, 0], border_pairs[:, 1])]
    convex_sums, concave_sums = (
        np.bincount(owner, weights=np.maximum(sign * border_angles, 0), minlength=len(strip))
        for sign in (1, -1)
    )
    has_rim = np.bincount(labels, weights=probes.rim, minlength=len(strip)) > 0
    # One face alone that continues smoothly is half of a facet that a wall's foot passes.
    has_several = np.bincount(labels, minlength=len(strip)) > 1
    is_rim = strip & (has_rim & has_several & (concave_sums <= _HOLLOW_RATIO * convex_sums))[labels]
    return is_rim & probes.bent, is_rim & probes.rim


def _crumbs(mesh: Mesh, pairs: Index, bent: Mask, cut: Mask, thin: float) -> Mask:
    """Return the mask of faces in small parts of the surface next to a rounded rim (F,)."""
    is_whole = ~bent[pairs].any(axis=1)
    labels = components(pairs[is_whole & ~cut], len(mesh.faces))
    areas = np.bincount(labels, weights=mesh.areas)
    is_next_to_rim = np.zeros(len(areas), bool)
    is_next_to_rim[labels[pairs[bent[pairs].any(axis=1)]]] = True
    return (is_next_to_rim & (areas < thin**2))[labels]


def _find_near_segments(mesh: Mesh, labels: Index, reach: float) -> Index:
    """Return the segments (P, 2) whose creases pass within `reach`, m: one cell may see both."""
    edges = edges_of(mesh.faces)
    sides = labels[edges.pairs()[0]]
    is_crease = (sides[:, 0] != sides[:, 1]) & (sides >= 0).all(axis=1)
    start, end = mesh.points[edges.ends[edges.shared][is_crease]].transpose(1, 0, 2)
    counts = np.ceil(2 * np.linalg.norm(end - start, axis=1) / reach).astype(np.int64) + 1
    edge = np.repeat(np.arange(len(counts)), counts)
    step = np.arange(len(edge)) - np.repeat(np.cumsum(counts) - counts, counts)
    fractions = (step / np.maximum(counts - 1, 1)[edge])[:, None]
    points = start[edge] * (1 - fractions) + end[edge] * fractions
    near_pairs = KDTree(points).query_pairs(reach, output_type="ndarray")
    edge_pairs = np.unique(
        np.stack([edge[near_pairs[:, 0]], edge[near_pairs[:, 1]]], axis=1), axis=0
    )
    side_pairs = sides[is_crease][edge_pairs]
    segment_grids = np.broadcast_arrays(side_pairs[:, 0, :, None], side_pairs[:, 1, None, :])
    return _select_distinct(np.stack(segment_grids, axis=-1).reshape(-1, 2))


def _meet_around_rims(labels: Index, rim_labels: Index, pairs: Index, is_labelled: Mask) -> Index:
    """Return the segments (P, 2) that meet around the same rounded rim."""
    inner = np.where(is_labelled[pairs[:, 0]], pairs[:, 0], pairs[:, 1])
    outer = np.where(is_labelled[pairs[:, 0]], pairs[:, 1], pairs[:, 0])
    rim_segments = np.unique(np.stack([rim_labels[outer], labels[inner]], axis=1), axis=0)
    segment_pairs = [
        (a, b)
        for rim in np.unique(rim_segments[:, 0])
        for a in rim_segments[rim_segments[:, 0] == rim, 1]
        for b in rim_segments[rim_segments[:, 0] == rim, 1]
        if a < b
    ]
    return np.array(segment_pairs, np.int64).reshape(-1, 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class _ThicknessProbes:
    """Thickness and opposite faces of each face, measured by balls and rays inside the surface."""

    thin: Mask  # (F,): a wall or its rim
    bent: Mask  # (F,): near a wall's rim, or where a wall leaves a thicker part
    rim: Mask  # (F,): material continues below, though a thin wall begins or ends there
    opposed: Index  # (P, 2) faces with a thin wall between them
    touching: Index  # (P, 2) faces that the same small ball touches

    @classmethod
    def of(cls, mesh: Mesh, thin: float) -> Self:
        surface = Surface(mesh)
        face, points = _probes(mesh)
        normals = mesh.face_normals[face]
        opposite_faces, depths = surface.first_below(
            points - _INWARD * mesh.extent * normals, -normals
        )
        # A ball that reaches through the body is no larger, and far from a middle of all faces.
        diameters, touched_faces = balls_at(surface, points, normals, np.minimum(depths, 2 * thin))
        is_slender = diameters < thin
        cosines = np.einsum("kd,kd->k", normals, mesh.face_normals[opposite_faces])
        is_wall = (depths < thin) & (cosines < _FACING_COSINE)
        first_probes = slice(len(mesh.faces))  # the first point of each face is its centroid
        is_rim = is_slender & ~is_wall & ((depths >= thin) | (cosines > _ASKEW_COSINE))
        pairs = np.stack([face, touched_faces], axis=1)[is_slender]
        return cls(
            thin=(is_slender | is_wall)[first_probes],
            bent=(is_slender & ~is_wall & ~is_rim)[first_probes],
            rim=is_rim[first_probes],
            opposed=np.unique(np.stack([face, opposite_faces], axis=1)[is_wall], axis=0),
            touching=np.unique(pairs[pairs[:, 1] >= 0], axis=0),
        )


def _probes(mesh: Mesh) -> tuple[Index, Array]:
    """Return faces (K,) and points on them (K, 3): all centroids, then more if faces are few."""
    all_faces = np.arange(len(mesh.faces))
    if len(all_faces) > _FEW_FACES:
        return all_faces, mesh.centroids
    inner_points = (mesh.points[mesh.faces] + mesh.centroids[:, None]) / 2
    points = np.vstack([mesh.centroids, inner_points.reshape(-1, 3)])
    return np.concatenate([all_faces, np.repeat(all_faces, 3)]), points

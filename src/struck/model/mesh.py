"""Triangle surfaces, closest points on them, and names for their outermost places."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import ContactError, MeshError, rounded
from struck.model.arrays import Array, Index, Mask, checked

if TYPE_CHECKING:
    import igl


_SMOOTH = float(np.cos(np.deg2rad(40)))  # faces that turn further from each other meet in an edge
_FLAT = 1e-9  # of unit normals: faces that differ by less lie in one plane


@checked
@dataclass(frozen=True, kw_only=True, eq=False)
class Mesh:
    """A triangle mesh whose normals point out of the material.

    Parameters
    ----------
    points : array (V, 3)
        Vertices, m.
    faces : array (F, 3)
        Vertex indices of each triangle, counter-clockwise seen from outside.
    up : {"x", "y", "z"}, default "z"
        Axis that points up. It defines the contacts "top" and "bottom".

    Raises
    ------
    MeshError
        If points are not finite or beyond 1e60 m, indices are out of range, there are no faces, or
        none has an area.

    Examples
    --------
    >>> points = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], dtype=float)
    >>> faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    >>> tetrahedron = struck.Mesh(points=points, faces=faces)
    >>> tetrahedron.areas.round(4)
    array([0.005 , 0.005 , 0.005 , 0.0087])
    """

    points: Array
    faces: Index
    up: str = "z"

    def __post_init__(self) -> None:
        points = np.array(self.points, dtype=np.float64, ndmin=2, order="C")
        faces = np.array(indices("faces", self.faces), ndmin=2, order="C")
        require_vertices(points)
        require_triangles(faces, len(points))
        require_area((points, faces))
        points.setflags(write=False)
        faces.setflags(write=False)
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "faces", faces)

    @cached_property
    def area_vectors(self) -> Array:
        """Outward normals of the faces times their areas, m^2 (F, 3)."""
        corners = self.points[self.faces]
        return 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])

    @cached_property
    def areas(self) -> Array:
        """Areas of the faces, m^2 (F,)."""
        return np.linalg.norm(self.area_vectors, axis=1)

    @cached_property
    def centroids(self) -> Array:
        """Centroids of the faces, m (F, 3)."""
        return self.points[self.faces].mean(axis=1)

    @cached_property
    def face_normals(self) -> Array:
        """Outward unit normals of the faces (F, 3)."""
        return self.area_vectors / np.maximum(self.areas, np.finfo(float).tiny)[:, None]

    @cached_property
    def vertex_normals(self) -> Array:
        """Outward unit normals at the vertices, weighted by area (V, 3)."""
        normals = np.zeros_like(self.points)
        for corner in self.faces.T:
            np.add.at(normals, corner, self.area_vectors)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
        return normals / np.maximum(lengths, np.finfo(float).tiny)

    @cached_property
    def corner_normals(self) -> Array:
        """Outward unit normals at the corners of the faces (F, 3, 3), smooth but for sharp edges.

        A corner takes the mean of those faces around its vertex that turn from its own by less than
        40 degrees, weighted as N. Max does (1999), which is exact on spheres and tubes.
        """
        from scipy import sparse  # only where a body is touched or drawn

        corners, places, tiny = self.faces.ravel(), self.points[self.faces], np.finfo(float).tiny
        to, back = np.roll(places, -1, axis=1) - places, np.roll(places, 1, axis=1) - places
        sides = np.einsum("fcd,fcd->fc", to, to) * np.einsum("fcd,fcd->fc", back, back)
        shares = (np.cross(to, back) / np.maximum(sides, tiny)[:, :, None]).reshape(-1, 3)
        count = np.arange(len(corners))
        ones = sparse.csr_array((np.ones(len(corners)), (corners, count)))
        adjacency = ones[corners]  # of each corner, all corners at its vertex
        mine, others = np.repeat(count // 3, np.diff(adjacency.indptr)), adjacency.indices
        cosines = np.einsum("kd,kd->k", self.face_normals[mine], self.face_normals[others // 3])
        alike = shares[others] * np.where(cosines > _SMOOTH, 1.0, 0.0)[:, None]
        means = np.add.reduceat(alike, adjacency.indptr[:-1])
        means /= np.maximum(np.linalg.norm(means, axis=1, keepdims=True), tiny)
        return means.reshape(-1, 3, 3)

    def normals_at(self, faces: Index, points: Array) -> Array:
        """Interpolate the outward unit normals at points of the surface.

        Parameters
        ----------
        faces : array (K,) of int
            Face on which each point lies.
        points : array (K, 3)
            Points, m.

        Returns
        -------
        array (K, 3)
            Unit normals, interpolated between the corners of curved faces.
        """
        flat, corners = self.face_normals[faces], self.corner_normals[faces]
        weights = barycentric(self.points[self.faces[faces]], points)
        smooth = np.einsum("kc,kcd->kd", weights, corners)
        smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), np.finfo(float).tiny)
        bent = np.abs(corners - flat[:, None]).max(axis=(1, 2)) > _FLAT
        return np.where(bent[:, None], smooth, flat)

    @cached_property
    def mean_curvatures(self) -> Array:
        """Mean curvature about each vertex, 1/m, above 0 where it bulges (V,).

        An edge of length l, whose faces turn by an angle a, holds a l / 2 of the integral of the
        mean curvature (Steiner's formula); half of it goes to each end.
        """
        corners = np.sort(self.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
        owner = np.repeat(np.arange(len(self.faces)), 3)
        order = np.lexsort((corners[:, 1], corners[:, 0]))
        corners, owner = corners[order], owner[order]
        two = np.flatnonzero((corners[1:] == corners[:-1]).all(axis=1))
        ends, one, other = corners[two], owner[two], owner[two + 1]
        normals, edge_vectors = self.face_normals, self.points[ends[:, 1]] - self.points[ends[:, 0]]
        cosines = np.einsum("ed,ed->e", normals[one], normals[other])
        centroid_offsets = self.centroids[other] - self.centroids[one]
        bulges = np.where(np.einsum("ed,ed->e", centroid_offsets, normals[one]) > 0, -1.0, 1.0)
        edge_integrals = (
            bulges * np.arccos(np.clip(cosines, -1, 1)) * np.linalg.norm(edge_vectors, axis=1) / 4
        )
        curvatures, vertex_areas = np.zeros(len(self.points)), np.zeros(len(self.points))
        for end in ends.T:
            np.add.at(curvatures, end, edge_integrals)
        for corner in self.faces.T:
            np.add.at(vertex_areas, corner, self.areas / 3)
        return curvatures / np.maximum(vertex_areas, np.finfo(float).tiny)

    @cached_property
    def locator(self) -> Surface:
        """The surface as a place to look contacts up on."""
        return Surface(self)

    @property
    def volume(self) -> float:
        """Enclosed volume, m^3; negative when the normals point inward."""
        return float(np.einsum("ij,ij->", self.centroids, self.area_vectors) / 3)

    @cached_property
    def bounds(self) -> Array:
        """Lowest and highest corner of the bounding box, m (2, 3)."""
        vertices = self.points[np.unique(self.faces)]
        return np.stack([vertices.min(axis=0), vertices.max(axis=0)])

    @cached_property
    def reach(self) -> float:
        """Radius of the ball that has the surface's area, m."""
        return float(np.sqrt(self.areas.sum() / (4 * np.pi)))

    @cached_property
    def extent(self) -> float:
        """Longest edge of the bounding box, m."""
        return float(np.ptp(self.bounds, axis=0).max())

    def spread(self, count: int) -> tuple[Array, Array]:
        """Distribute points evenly over the surface.

        Each face with an area has at least one.

        Parameters
        ----------
        count : int
            Approximate number of points.

        Returns
        -------
        tuple of array (S, 3), array (S, 3)
            Points, m, and the area vector of each, m^2.
        """
        sides = np.ceil(np.sqrt(count * self.areas / self.areas.sum())).astype(int)
        places, vectors = [], []
        for side in np.unique(sides[sides > 0]):
            chosen = sides == side
            steps = np.indices((side, side)).reshape(2, -1).T
            upright, turned = (steps[steps.sum(axis=1) < side - k] + (k + 1) / 3 for k in (0, 1))
            two = np.vstack([upright, turned]) / side
            weights = np.column_stack([two, 1 - two.sum(axis=1)])
            corners = self.points[self.faces[chosen]]
            places.append(np.einsum("pc,fcd->fpd", weights, corners).reshape(-1, 3))
            vectors.append(np.repeat(self.area_vectors[chosen] / side**2, side**2, axis=0))
        return np.vstack(places), np.vstack(vectors)

    @checked
    def scaled(self, factor: float) -> Mesh:
        """Return a copy scaled about the origin.

        Parameters
        ----------
        factor : float
            Ratio of the new to the old size.

        Returns
        -------
        Mesh
            The scaled surface.
        """
        return Mesh(points=self.points * factor, faces=self.faces, up=self.up)


class Triangles(Protocol):
    """A surface of another library: trimesh's; Open3D's has `triangles`, PyVista's `points`."""

    @property
    def vertices(self) -> ArrayLike:
        """Vertices (V, 3)."""
        ...


class Points(Protocol):
    """Any object with points and padded faces, as a surface of PyVista has."""

    @property
    def points(self) -> ArrayLike:
        """Vertices (V, 3)."""
        ...

    @property
    def faces(self) -> ArrayLike:
        """Polygons, each after the count of its corners."""
        ...


Arrays = Triangles | Points | tuple[ArrayLike, ArrayLike]  # vertices and faces


def indices(name: str, values: ArrayLike) -> Index:
    """Return whole numbers that may name vertices; MeshError on any other."""
    array = np.asarray(values)
    # NaN is refused as well.
    if array.dtype.kind not in "iub" and not np.all(np.abs(array) < _MAX_INDEX):
        raise MeshError(f"{name} hold what numbers no vertex: give whole numbers from 0 on")
    return array.astype(np.int64)


_MAX_INDEX = 2.0**53


def require_vertices(points: Array) -> None:
    """Raise MeshError unless points are finite vertices (V, 3) that can be computed with."""
    if points.ndim != 2 or points.shape[1] != 3:
        raise MeshError(f"points have shape {points.shape}, not (V, 3): give x, y and z in m")
    bad_count = np.count_nonzero(~np.isfinite(points).all(axis=1))
    if bad_count:
        raise MeshError(
            f"{bad_count} of {len(points)} vertices are not finite: export the mesh again"
        )
    distance = np.abs(points).max(initial=0.0)
    if distance > MAX_COORDINATE:
        raise MeshError(
            f"a vertex is {rounded(distance, 3)} from the origin, and volumes can be computed "
            f"within {rounded(MAX_COORDINATE)} alone: export the mesh again"
        )


def require_triangles(faces: Index, count: int) -> None:
    """Raise MeshError unless faces are triangles (F, 3) of `count` vertices, at least one."""
    if faces.ndim != 2 or faces.shape[1] != 3 or not len(faces):
        raise MeshError(f"faces have shape {faces.shape}, not (F, 3) with F > 0: give triangles")
    if faces.min() < 0 or faces.max() >= count:
        raise MeshError(
            f"faces name vertices {faces.min()} to {faces.max()} of {count}, counted from 0: the "
            "mesh is truncated or damaged; export it again"
        )


def require_area(*surfaces: tuple[Array, Index]) -> None:
    """Raise MeshError if all triangles of some vertices and faces are lines or points."""
    if all(lines.all() for points, faces in surfaces for lines in _lines(points, faces)):
        longest = max(float(np.ptp(points[faces], axis=(0, 1)).max()) for points, faces in surfaces)
        raise MeshError(
            f"all of its {sum(len(faces) for _, faces in surfaces)} faces are lines or points, and "
            f"its longest edge is {rounded(longest, 3)}: export the surface again"
        )


def _lines(points: Array, faces: Index) -> Iterator[Mask]:
    """Yield which faces are lines or points, at any scale, 4,096 faces at a time."""
    for start in range(0, len(faces), _AT_ONCE):
        corners = points[faces[start : start + _AT_ONCE]]
        edges = corners - np.roll(corners, 1, axis=1)
        longest = np.abs(edges).max(axis=(1, 2))
        edges /= np.maximum(longest, SHORTEST_EDGE)[:, None, None]
        doubled_areas = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        yield (doubled_areas <= _THINNEST_FACE) | (longest <= SHORTEST_EDGE)


def part_mesh(points: Array, faces: Index, up: str = "z") -> Mesh:
    """Return a part of a checked surface: some of its triangles, which may all be lines."""
    require_triangles(faces, len(points))
    part = object.__new__(Mesh)
    for array in (points, faces):
        array.setflags(write=False)
    for name, value in (("points", points), ("faces", faces), ("up", up)):
        object.__setattr__(part, name, value)
    return part


_TINY = np.finfo(np.float64).tiny
_FARTHEST = 1e150  # m: squares beyond it are infinite, and compiled code returns what it finds
# m: cubes of lengths, and sums of such, stay within the range of double precision.
SHORTEST_EDGE, MAX_COORDINATE = 1e-60, 1e60
# Below this height over its longest side a triangle is a line, within rounding.
_THINNEST_FACE = 1e-12
_AT_ONCE = 2**12


def in_space(points: ArrayLike) -> Array:
    """Return points as compiled code needs them: contiguous, with finite squares, m (K, 3)."""
    array = np.ascontiguousarray(points, dtype=np.float64)
    if not array.size:
        return np.zeros((0, 3))
    rows = np.atleast_2d(array)
    if rows.shape[1:] != (3,):
        raise ContactError(f"points have shape {array.shape}: give x, y and z of each, m")
    if not np.abs(rows).max() < _FARTHEST:  # NaN included
        raise ContactError(
            f"a point has a coordinate that is no number below {rounded(_FARTHEST)} m: give finite "
            "ones"
        )
    return rows


class Closest:
    """Edges (P, 2) or triangles (P, 3) of points (N, 3), ready for closest-point queries."""

    def __init__(self, points: Array, parts: Index) -> None:
        self._points = np.ascontiguousarray(points)
        self._parts = np.ascontiguousarray(parts)
        if not self._parts.size:
            raise MeshError("there are no edges or triangles to be near to: give at least one")

    @cached_property
    def _tree(self) -> igl.AABB:
        import igl

        tree = igl.AABB()
        tree.init(self._points, self._parts)
        return tree

    def __getstate__(self) -> dict[str, object]:
        """Return the state for pickles and copies, without libigl's tree, which is rebuilt."""
        return {name: value for name, value in vars(self).items() if name != "_tree"}

    def closest(self, points: Array) -> tuple[Array, Index, Array]:
        """Return distances (K,), edges or triangles (K,) and the nearest points on them (K, 3)."""
        queries = in_space(points)
        if not len(queries):
            return np.zeros(0), np.zeros(0, np.int64), queries
        squared_distances, parts, nearest = self._tree.squared_distance(
            self._points, self._parts, queries
        )
        return (
            np.sqrt(np.atleast_1d(squared_distances)),
            np.atleast_1d(parts),
            np.atleast_2d(nearest),
        )


class Surface(Closest):
    """A triangle surface prepared for many closest-point queries."""

    def __init__(self, mesh: Mesh) -> None:
        super().__init__(mesh.points, mesh.faces)

    def barycentric(self, points: Array) -> tuple[Index, Array]:
        """Return the nearest faces (K,) and the weights of their corners (K, 3)."""
        _, faces, nearest = self.closest(points)
        return faces, barycentric(self._points[self._parts[faces]], nearest)

    def holds(self, points: Array) -> Mask:
        """Return which points (K,) lie within the surface: it winds around them (K,)."""
        import igl

        winding_numbers = igl.winding_number(self._points, self._parts, in_space(points))
        return np.atleast_1d(np.asarray(winding_numbers, np.float64)) > 0.5

    def first_below(self, points: Array, ways: Array) -> tuple[Index, Array]:
        """Return the faces (K,) that rays meet first, and how far away; -1 and infinity: none."""
        hits = self._tree.intersect_ray_first(
            self._points, self._parts, in_space(points), in_space(ways)
        )
        faces, depths = np.atleast_1d(hits[0]), np.atleast_1d(hits[1])
        return faces, np.where(faces < 0, np.inf, depths)


def barycentric(triangles: Array, points: Array) -> Array:
    """Return the weights (K, 3) of the corners of `triangles` that make `points` (K, 3)."""
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    offset = points - triangles[:, 0]
    uu, uv, vv = _dot(first, first), _dot(first, second), _dot(second, second)
    ou, ov = _dot(offset, first), _dot(offset, second)
    area = np.maximum(uu * vv - uv * uv, _TINY)
    # A live touch comes by here in every block: these two are half as long as `clip`.
    along = np.minimum(np.maximum((vv * ou - uv * ov) / area, 0.0), 1.0)
    across = np.minimum(np.maximum((uu * ov - uv * ou) / area, 0.0), 1.0 - along)
    return np.stack([1.0 - along - across, along, across], axis=1)


def _dot(left: Array, right: Array) -> Array:
    return np.einsum("kd,kd->k", left, right)


_DEEP = 0.1  # fraction of the height by which an open body's centre lies below its rim
_INSET = 0.01  # fraction of the distance to a face's centroid that places keep from a sharp edge
_LEVEL = 1e-3  # share of the extent within which vertices count as one flat end


def places_of(mesh: Mesh) -> Mapping[str, Array]:
    """Return the places that every body has, m each (3,).

    They are "top" and "bottom" along its upward axis, "side" along the axis after it, "middle"
    under a drop that falls on its middle, "+x" to "-z", and "rim" where that drop falls far into a
    body whose four quarters all reach its top.
    """
    axes = {f"{sign}{name}": (i, sign) for i, name in enumerate("xyz") for sign in "+-"}
    places = {name: _outermost(mesh, axis, sign) for name, (axis, sign) in axes.items()}
    up = "xyz".index(mesh.up)
    across = [(up + 1) % 3, (up + 2) % 3]
    top, middle = places[f"+{mesh.up}"], _find_top_over_centre(mesh, up, across)
    named_places = {
        "top": top,
        "bottom": places[f"-{mesh.up}"],
        "side": places[f"+{'xyz'[across[0]]}"],
    }
    low, high = mesh.bounds
    lowest = high[up] - _DEEP * (high - low)[up]
    upper = mesh.points[mesh.points[:, up] > lowest]
    quarters = np.unique(upper[:, across] > ((low + high) / 2)[across], axis=0)
    if len(quarters) == 4 and (middle is None or middle[up] < lowest):
        edge = np.flatnonzero(mesh.points[:, up] >= high[up] - _LEVEL * mesh.extent)
        outermost = edge[np.argmax(mesh.points[edge, across[0]])]
        named_places["rim"] = _move_off_edges(mesh, outermost, np.eye(3)[across[0]])
    if middle is None:
        distances = np.linalg.norm(mesh.points - (low + high) / 2, axis=1)
        middle = mesh.points[np.argmin(distances)]
    return places | named_places | {"middle": middle}


def _find_top_over_centre(mesh: Mesh, up: int, across: list[int]) -> Array | None:
    """Return the highest point over the centre of a surface's plan, None where it is open."""
    centre = mesh.bounds.mean(axis=0)
    corners = mesh.points[mesh.faces]
    plan, heights = corners[:, :, across] - centre[across], corners[:, :, up]
    after, last = np.roll(plan, -1, axis=1), np.roll(plan, -2, axis=1)
    # Twice the areas that the middle makes with each edge: of one sign where it lies within.
    areas = after[:, :, 0] * last[:, :, 1] - after[:, :, 1] * last[:, :, 0]
    slack = _FLAT * mesh.extent**2
    is_within = (areas >= -slack).all(axis=1) | (areas <= slack).all(axis=1)
    is_within &= np.abs(areas.sum(axis=1)) > slack
    if not is_within.any():
        return None
    weights = areas[is_within] / areas[is_within].sum(axis=1, keepdims=True)
    point = centre.copy()
    point[up] = np.einsum("fc,fc->f", weights, heights[is_within]).max()
    return point


def _outermost(mesh: Mesh, axis: int, sign: str) -> Array:
    """Return the outermost vertex; on a flat end, the one nearest its middle."""
    direction = np.eye(3)[axis] * (1 if sign == "+" else -1)
    heights = mesh.points @ direction
    ends = np.flatnonzero(heights >= heights.max() - _LEVEL * mesh.extent)
    points = mesh.points[ends]
    return _move_off_edges(
        mesh, ends[np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1))], direction
    )


def _move_off_edges(mesh: Mesh, vertex: int, direction: Array) -> Array:
    """Return a vertex, moved from a sharp edge into that of its faces which looks most one way."""
    adjacent_faces = np.flatnonzero((mesh.faces == vertex).any(axis=1))
    normals, point = mesh.face_normals[adjacent_faces], mesh.points[vertex]
    face = int(np.argmax(normals @ direction))
    if (normals @ normals[face]).min() > _SMOOTH:
        return point
    return point + _INSET * (mesh.centroids[adjacent_faces[face]] - point)

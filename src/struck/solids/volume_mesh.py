"""Volume meshes: nodes and elements of one kind, in VTK's node order."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from struck.errors import MeshError
from struck.model.arrays import Array, Index, Mask, checked, numbers
from struck.model.mesh import Mesh, indices
from struck.solids.elements import ELEMENTS, QUADRATIC_KINDS, Element

FUNCTIONS_PER_NODE = 3.0
"""Approximate number of functions of cubic displacements per node of their elements."""


@checked
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class VolumeMesh:
    """Nodes and elements of one kind.

    Parameters
    ----------
    nodes : array (N, 3)
        Nodes, m.
    elements : array (E, n) of int
        Node indices of each element, in VTK's order for the kind.
    kind : str
        A key of ``ELEMENTS``: "tet4", "tet10", "hex8", "hex20", "wedge6" or "wedge15".
    up : {"x", "y", "z"}, default "z"
        Axis that points up.
    cubic : bool, default False
        Whether displacements are cubic in these elements, as thin ones of kind "tet10" need for
        bending; the nodes define the geometry.

    Raises
    ------
    MeshError
        If the kind is unknown, the number of nodes per element is wrong, or indices are out of
        range.

    Examples
    --------
    >>> nodes = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]], dtype=float)
    >>> mesh = struck.solids.VolumeMesh(nodes=nodes, elements=np.array([[0, 1, 2, 3]]), kind="tet4")
    >>> float(round(mesh.volume(), 9))
    0.000166667
    """

    nodes: Array
    elements: Index
    kind: str
    up: str = "z"
    cubic: bool = False

    def __post_init__(self) -> None:
        for name, array in (
            ("nodes", numbers("nodes", self.nodes, width=3, error=MeshError)),
            ("elements", indices("elements", self.elements)),
        ):
            object.__setattr__(self, name, array)
        if self.kind not in ELEMENTS:
            raise MeshError(f"elements of kind {self.kind!r} are unknown: use {sorted(ELEMENTS)}")
        if self.cubic and self.kind != "tet10":
            raise MeshError(f"displacements on {self.kind} are not cubic: only tet10 takes cubic=")
        node_count = len(self.element.nodes)
        if (
            self.elements.ndim != 2
            or self.elements.shape[1] != node_count
            or not len(self.elements)
        ):
            raise MeshError(
                f"{self.kind} elements have shape {self.elements.shape}, not (E, {node_count})"
            )
        if self.elements.min() < 0 or self.elements.max() >= len(self.nodes):
            raise MeshError(f"elements name nodes outside 0 to {len(self.nodes) - 1}")

    @property
    def element(self) -> Element:
        """The reference element of this kind."""
        return ELEMENTS[self.kind]

    @property
    def functions(self) -> int:
        """Number of functions that its displacements are sums of, about."""
        return round(len(self.nodes) * (FUNCTIONS_PER_NODE if self.cubic else 1))

    @property
    def corners(self) -> Index:
        """Corner nodes of the elements (E, c)."""
        return self.elements[:, : len(self.element.corners)]

    def promoted(self) -> VolumeMesh:
        """Return the quadratic mesh on the same corners, with straight edges.

        Returns
        -------
        VolumeMesh
            Elements of quadratic kind.
        """
        if self.kind not in QUADRATIC_KINDS:
            return self
        kind = QUADRATIC_KINDS[self.kind]
        pairs = self.elements[:, np.array(ELEMENTS[kind].edges)]
        edges, edge_numbers = unique_rows(np.sort(pairs.reshape(-1, 2), axis=1))
        midside_nodes = self.nodes[edges].mean(axis=1)
        numbers = len(self.nodes) + edge_numbers.reshape(len(self.elements), -1)
        return replace(
            self,
            nodes=np.vstack([self.nodes, midside_nodes]),
            elements=np.hstack([self.elements, numbers]),
            kind=kind,
        )

    def straight(self) -> Mask:
        """Find the elements whose midside nodes are all halfway.

        Returns
        -------
        array (E,) of bool
            Mask of the elements.
        """
        if not self.element.edges:
            return np.ones(len(self.elements), bool)
        pairs = self.nodes[self.elements[:, np.array(self.element.edges)]]
        midside_nodes = self.nodes[self.elements[:, len(self.element.corners) :]]
        bow = np.linalg.norm(midside_nodes - pairs.mean(axis=2), axis=2)
        length = np.linalg.norm(pairs[:, :, 1] - pairs[:, :, 0], axis=2)
        return np.asarray((bow <= 1e-10 * length).all(axis=1))

    def jacobians(self, points: Array, chosen: Index | slice = slice(None)) -> Array:
        """Compute the Jacobian matrices dx/dxi.

        Parameters
        ----------
        points : array (q, 3)
            Reference points.
        chosen : array of int or slice, optional
            Elements. Default: all.

        Returns
        -------
        array (E, q, 3, 3)
            Matrices, m.
        """
        return np.einsum(
            "qnr,end->eqdr",
            self.element.gradients(points),
            self.nodes[self.elements[chosen]],
            optimize=True,
        )

    def volume(self) -> float:
        """Compute the volume of the elements by quadrature.

        Returns
        -------
        float
            Volume, m^3.
        """
        rule = self.element.mass_rule
        parts = (
            np.linalg.det(self.jacobians(rule.points, c)) @ rule.weights for c in self.chunks()
        )
        return float(sum(part.sum() for part in parts))

    def width(self) -> float:
        """Compute the mean distance of the two farthest corners of an element.

        Returns
        -------
        float
            Distance, m.
        """
        pairs = np.array(list(combinations(range(len(self.element.corners)), 2))).T
        total_width = 0.0
        for chunk in self.chunks():
            first, second = (self.nodes[self.corners[chunk][:, ends]] for ends in pairs)
            total_width += np.linalg.norm(first - second, axis=2).max(axis=1).sum()
        return total_width / len(self.elements)

    def chunks(self, size: int = 4096) -> Iterator[slice]:
        """Yield slices of elements, to be processed one after another.

        Parameters
        ----------
        size : int, default 4096
            Maximum number of elements of a slice.

        Returns
        -------
        iterator of slice
            The slices.
        """
        for start in range(0, len(self.elements), size):
            yield slice(start, start + size)

    def boundary_sides(self) -> list[Index]:
        """Find the sides that belong to only one element.

        Returns
        -------
        list of array (S, n) of int
            Node indices of the sides, one array per number of corners.
        """
        groups = []
        for corners in sorted({len(side) for side in self.element.sides}):
            sides = [_side_nodes(self.element, s) for s in self.element.sides if len(s) == corners]
            all_sides = self.elements[:, np.array(sides)].reshape(-1, len(sides[0]))
            keys = side_keys(all_sides[:, :corners], len(self.nodes))
            _, first, counts = np.unique(keys, return_index=True, return_counts=True)
            groups.append(all_sides[first[counts == 1]])
        return groups

    def neighbours(self) -> Index:
        """Find the pairs of elements that have a side in common.

        Returns
        -------
        array (P, 2) of int
            Pairs of elements.
        """
        pairs = []
        for corners in {len(side) for side in self.element.sides}:
            sides = np.array([side for side in self.element.sides if len(side) == corners])
            owners = np.repeat(np.arange(len(self.elements)), len(sides))
            keys = side_keys(self.elements[:, sides].reshape(-1, corners), len(self.nodes))
            order = np.argsort(keys, kind="stable")
            is_shared = keys[order][1:] == keys[order][:-1]
            pairs.append(np.stack([owners[order][:-1][is_shared], owners[order][1:][is_shared]]))
        return np.hstack(pairs).T

    def surface(self) -> tuple[Mesh, Index]:
        """Return the boundary as triangles through all its nodes.

        Returns
        -------
        tuple of Mesh, array (V,) of int
            Surface, and the number of the node of each of its points.
        """
        sides = [sides for sides in self.boundary_sides() if len(sides)]
        triangles = np.vstack([_triangles(group, self.nodes) for group in sides])
        numbers, faces = np.unique(triangles, return_inverse=True)
        return Mesh(points=self.nodes[numbers], faces=faces.reshape(-1, 3), up=self.up), numbers


def side_keys(corners: Index, nodes: int) -> Index:
    """Return a number for each side (S,) that only sides with the same corners (S, c) share."""
    # The three lowest corners identify a side, and three numbers below two million fit into one.
    low, mid, high = np.sort(corners, axis=1)[:, :3].T
    if nodes < 2**21:
        return (low * nodes + mid) * nodes + high
    _, pairs = unique_rows(np.stack([low, mid], axis=1))
    return unique_rows(np.stack([pairs, high], axis=1))[1]


def unique_rows(pairs: Index) -> tuple[Index, Index]:
    """Return the distinct rows of integer `pairs` (P, 2) and where each row went."""
    keys, positions = np.unique(pairs[:, 0] * (pairs.max() + 1) + pairs[:, 1], return_inverse=True)
    return np.stack(np.divmod(keys, pairs.max() + 1), axis=1), positions


def _side_nodes(element: Element, side: tuple[int, ...]) -> tuple[int, ...]:
    midside_nodes = {
        frozenset(edge): len(element.corners) + i for i, edge in enumerate(element.edges)
    }
    side_edges = zip(side, (*side[1:], side[0]), strict=True)
    return side + tuple(midside_nodes[frozenset(edge)] for edge in side_edges if element.edges)


# Triangles that tile a side through its nodes, by the side's count of nodes (corners, then
# midside nodes); quadrilaterals are cut along their shorter diagonal.
_TILES = {
    3: [(0, 1, 2)],
    6: [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)],
    4: [(0, 1, 2), (0, 2, 3)],
    8: [(0, 4, 7), (4, 1, 5), (5, 2, 6), (7, 6, 3), (4, 5, 6), (4, 6, 7)],
}


def _triangles(sides: Index, nodes: Array) -> Index:
    if sides.shape[1] in {4, 8}:
        # Across a narrow strip of a bent side the longer one would run beneath the surface.
        ends = nodes[sides[:, -4:]]
        first, second = (np.linalg.norm(ends[:, i + 2] - ends[:, i], axis=1) for i in (0, 1))
        rotated_sides = np.flatnonzero(second < (1 - 1e-9) * first)
        sides = sides.copy()
        for start in range(0, sides.shape[1], 4):
            sides[rotated_sides, start : start + 4] = np.roll(
                sides[rotated_sides, start : start + 4], -1, axis=1
            )
    return sides[:, np.array(_TILES[sides.shape[1]])].reshape(-1, 3)


def linear_tetrahedra(mesh: VolumeMesh) -> VolumeMesh:
    """Return tetrahedra between the corners of any elements, as the paper of 2002 uses."""
    # Hexahedra and wedges get a node in each side and one within, so that neighbours agree on
    # every side without a rule for diagonals.
    corners = mesh.corners
    if corners.shape[1] == 4:
        return _compact(mesh, mesh.nodes, corners)
    centroids = mesh.nodes[corners].mean(axis=1)
    centre_nodes = len(mesh.nodes) + np.arange(len(corners))
    nodes, parts = [mesh.nodes, centroids], []
    start = len(mesh.nodes) + len(corners)
    for count in sorted({len(side) for side in mesh.element.sides}):
        sides = np.array([side for side in mesh.element.sides if len(side) == count])
        all_sides = corners[:, sides].reshape(-1, count)
        _, first, number = np.unique(
            np.sort(all_sides, axis=1), axis=0, return_index=True, return_inverse=True
        )
        nodes.append(mesh.nodes[all_sides[first]].mean(axis=1))
        hub = start + number.ravel()
        start += len(first)
        ring = zip(all_sides.T, np.roll(all_sides, -1, axis=1).T, strict=True)
        apex = np.repeat(centre_nodes, len(sides))
        parts += [np.stack([b, a, hub, apex], axis=1) for a, b in ring]
    return _compact(mesh, np.vstack(nodes), np.vstack(parts))


def _compact(mesh: VolumeMesh, nodes: Array, elements: Index) -> VolumeMesh:
    used_nodes, local = np.unique(elements, return_inverse=True)
    return VolumeMesh(
        nodes=nodes[used_nodes], elements=local.reshape(-1, 4), kind="tet4", up=mesh.up
    )

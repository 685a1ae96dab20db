"""Stiffness and mass matrices of isoparametric elements, assembled by whole arrays.

For node pairs i, j and directions a, b, with shape-function gradients G (Zienkiewicz, Taylor
& Zhu 2013, section 9.3; O'Brien et al. 2002, eq. 12 without its misprinted factor -1/2):

    K_ij,ab = integral of lambda G_ia G_jb + mu G_ib G_ja + mu delta_ab sum_c G_ic G_jc
    M_ij,ab = delta_ab integral of rho N_i N_j
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Self

import numpy as np
from scipy import sparse

from struck.errors import MeshError
from struck.model.arrays import Array, Complex, Index, Mask
from struck.model.material import Material
from struck.solids.elements import ELEMENTS, QUADRATIC_KINDS, TET_14, TET_24, Quadrature
from struck.solids.volume_mesh import VolumeMesh

_STEP = 1e-30  # derivatives by complex steps are exact


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hierarchic:
    """Functions of one degree more than a mesh's own: on edges, sides, and within elements."""

    # Integrated Legendre polynomials along edges and bubbles (Szabo & Babuska 1991, chapter 13).
    mesh: VolumeMesh
    degree: int  # 2 to 4
    members: tuple[tuple[int, ...], ...]  # corners of the edge, side or element of each function
    numbers: Index  # (E, m), of the functions in the whole mesh
    signs: Array  # (E, m): which way an odd function runs along its edge; 0 held

    @classmethod
    def of(cls, mesh: VolumeMesh, held: Mask, degree: int = 0) -> Self:
        """Return the functions of a degree; 0 selects the next one to that of the mesh."""
        mesh_degree = 1 if mesh.kind in QUADRATIC_KINDS else 3 if mesh.cubic else 2
        degree = degree or mesh_degree + 1
        edges = ELEMENTS[QUADRATIC_KINDS.get(mesh.kind, mesh.kind)].edges
        member_sets = {2: (), 3: mesh.element.sides, 4: (tuple(range(len(mesh.element.corners))),)}
        members = (*edges, *member_sets[degree])
        keys = np.empty((len(mesh.elements), len(members)), np.int64)
        signs = np.ones(keys.shape)
        for i, member in enumerate(members):
            corners = mesh.corners[:, member]
            keys[:, i] = edge_or_side_keys(np.sort(corners, axis=1), len(mesh.nodes))
            if len(member) == 2 and degree == 3:
                signs[:, i] = np.sign(corners[:, 1] - corners[:, 0])
            signs[held[corners].all(axis=1), i] = 0
        numbers = np.unique(keys, return_inverse=True)[1].reshape(keys.shape)
        return cls(mesh=mesh, degree=degree, members=members, numbers=numbers, signs=signs)

    @property
    def count(self) -> int:
        """Number of added basis functions."""
        return int(self.numbers.max()) + 1

    def values(self, points: Array | Complex) -> Array | Complex:
        """Return the functions at reference `points` (q, 3): (q, m)."""
        at = barycentric_coordinates(self.mesh.kind, points)
        corners = barycentric_coordinates(self.mesh.kind, self.mesh.element.corners)
        functions = []
        for member in self.members:
            is_involved = corners[list(member)].any(axis=0)
            function = np.prod(at[:, is_involved], axis=1)
            if len(member) == 2:
                edge_coordinates = at @ (corners[member[1]] - corners[member[0]])
                function = (
                    function
                    * {2: 1.0, 3: edge_coordinates, 4: 5 * edge_coordinates**2 - 1}[self.degree]
                )
            functions.append(function)
        return np.stack(functions, axis=1)

    def gradients(self, points: Array) -> Array:
        """Return their gradients in reference coordinates: (q, m, 3)."""
        steps = [points + 1j * _STEP * axis for axis in np.eye(3)]
        return np.stack([np.imag(self.values(at)) / _STEP for at in steps], axis=2)


def barycentric_coordinates(kind: str, points: Array | Complex) -> Array | Complex:
    """Return barycentric coordinates (q, s) of reference `points` (q, 3), factor after factor."""
    # A hexahedron is the product of three lines, a wedge of a triangle and a line.
    x, y, z = points.T
    if kind.startswith("tet"):
        return np.stack([1 - x - y - z, x, y, z], axis=1)
    if kind.startswith("hex"):
        return np.stack([1 - x, x, 1 - y, y, 1 - z, z], axis=1)
    return np.stack([1 - x - y, x, y, 1 - z, z], axis=1)


def edge_or_side_keys(corners: Index, nodes: int) -> Index:
    """Return a number for each edge (two corners), side (three lowest) or element (four)."""
    keys = corners[:, 0] * nodes + corners[:, 1]
    if corners.shape[1] > 2:
        keys = nodes**2 + keys * nodes + corners[:, 2]
    return keys


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Displacements:
    """Displacements of a mesh as sums of shape functions: nodal functions, then cubic ones."""

    mesh: VolumeMesh
    numbers: Index  # (E, n), of the functions in the whole mesh
    added: Hierarchic | None  # cubics, after those of the nodes

    @classmethod
    def of(cls, mesh: VolumeMesh) -> Self:
        """Return the basis functions of a mesh."""
        if not mesh.cubic:
            return cls(mesh=mesh, numbers=mesh.elements, added=None)
        added = Hierarchic.of(mesh, np.zeros(len(mesh.nodes), bool), degree=3)
        numbers = np.hstack([mesh.elements, len(mesh.nodes) + added.numbers])
        return cls(mesh=mesh, numbers=numbers, added=added)

    @property
    def count(self) -> int:
        """Number of basis functions."""
        return len(self.mesh.nodes) + (self.added.count if self.added else 0)

    @property
    def mass_rule(self) -> Quadrature:
        """Quadrature rule for products of two functions."""
        return TET_24 if self.added else self.mesh.element.mass_rule

    @property
    def stiffness_rules(self) -> tuple[Quadrature, Quadrature]:
        """Quadrature rules for products of two slopes, on straight and on curved elements."""
        if self.added:
            return TET_14, TET_24
        return self.mesh.element.straight_rule, self.mesh.element.stiffness_rule

    def values(self, points: Array, chosen: Index | slice) -> Array:
        """Return the functions at reference `points` (q, 3): (E or 1, q, n)."""
        nodal_values = self.mesh.element.values(points)
        if self.added is None:
            return nodal_values[None]
        signs = self.added.signs[chosen, None]
        added_values = np.real(self.added.values(points)) * signs
        return np.concatenate(
            [np.broadcast_to(nodal_values, (len(signs), *nodal_values.shape)), added_values], axis=2
        )

    def slopes(self, points: Array, inverse_jacobians: Array, chosen: Index | slice) -> Array:
        """Return physical gradients (E, q, n, 3) from the inverse Jacobians (E, q, 3, 3)."""
        nodal_slopes = self.mesh.element.gradients(points) @ inverse_jacobians
        if self.added is None:
            return nodal_slopes
        signs = self.added.signs[chosen, None, :, None]
        return np.concatenate(
            [nodal_slopes, self.added.gradients(points) @ inverse_jacobians * signs], axis=2
        )

    def held(self, nodes: Mask) -> Mask:
        """Return which basis functions (F,) move only nodes (N,) that are held."""
        if self.added is None:
            return nodes
        is_held = np.zeros(self.count, bool)
        is_held[: len(nodes)] = nodes
        for i, member in enumerate(self.added.members):
            is_fixed = nodes[self.mesh.corners[:, member]].all(axis=1)
            is_held[len(nodes) + self.added.numbers[is_fixed, i]] = True
        return is_held

    def pad(self, motions: Array) -> Array:
        """Return motions of the nodes (3N, k) as motions of all functions."""
        return np.pad(motions, ((0, 3 * self.count - len(motions)), (0, 0)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class System:
    """Stiffness and mass on pairs of nodes, lower triangle."""

    starts: Index  # (N + 1,): where each column of node pairs begins
    rows: Index  # (P,): at or below the diagonal
    stiffness: Array  # (3, 3, P), N/m
    mass: Array  # (P,), kg: the same in all three directions

    @property
    def node_count(self) -> int:
        """Number of nodes that are free to move."""
        return len(self.starts) - 1

    @property
    def unknowns(self) -> int:
        """Number of unknown displacements, three a node."""
        return 3 * self.node_count

    @property
    def entries(self) -> int:
        """Stored entries of the lower triangle of K."""
        return 9 * len(self.rows) - 3 * self.node_count

    @property
    def columns(self) -> Index:
        """Column of the sparse matrix for each pair of nodes (P,)."""
        return np.repeat(np.arange(self.node_count), np.diff(self.starts))

    def mass_matrix(self) -> sparse.csr_matrix:
        """Return the mass between nodes, both triangles (N, N)."""
        return _fill_both_triangles(self.mass, self.rows, self.starts)

    def shifted(self, shift: float) -> sparse.csc_matrix:
        """Return the lower triangle of K - shift M (3N, 3N)."""
        blocks = self.stiffness.copy()
        blocks[(0, 1, 2), (0, 1, 2)] -= shift * self.mass
        return _expand_blocks(blocks, self.rows, self.starts)

    def free(self, movable: Mask) -> System:
        """Return the system with the other nodes held still."""
        numbers = np.cumsum(movable) - 1
        is_free = movable[self.rows] & movable[self.columns]
        counts = np.bincount(numbers[self.columns[is_free]], minlength=int(movable.sum()))
        return System(
            starts=np.concatenate([[0], np.cumsum(counts)]),
            rows=numbers[self.rows[is_free]],
            stiffness=self.stiffness[:, :, is_free],
            mass=self.mass[is_free],
        )


def assemble(mesh: VolumeMesh, material: Material, *, lumped: bool = False) -> System:
    """Assemble stiffness and mass; `lumped` puts an element's mass on its nodes (2002, eq. 15)."""
    if lumped and mesh.kind != "tet4":
        raise MeshError(f"mass is lumped on tet4 elements only, not on {mesh.kind}: leave it out")
    basis = Displacements.of(mesh)
    lower, upper = np.tril_indices(basis.numbers.shape[1])
    first, second = basis.numbers[:, lower], basis.numbers[:, upper]
    pairs, place = _node_pairs(first, second, basis.count)
    is_swapped = first < second
    stiffness, mass = np.zeros((3, 3, len(pairs))), np.zeros(len(pairs))
    for chosen, rule in _batches(basis):
        products = _products(basis, chosen, rule)
        # np.add.at is six times faster on flat arrays.
        positions = place[chosen].ravel()
        for a, b, part in _components(products, lower, upper, is_swapped[chosen], material):
            np.add.at(stiffness[a, b], positions, part.ravel())
        parts = _masses(basis, chosen, material, lumped=lumped)[:, lower, upper]
        np.add.at(mass, positions, parts.ravel())
    columns, rows = np.divmod(pairs, basis.count)
    starts = np.concatenate([[0], np.cumsum(np.bincount(columns, minlength=basis.count))])
    return System(starts=starts, rows=rows, stiffness=stiffness, mass=mass)


def _batches(basis: Displacements) -> Iterator[tuple[Index, Quadrature]]:
    """Yield groups of elements that fit the processor's cache, with the rule they need."""
    is_straight = basis.mesh.straight()
    for group, rule in zip((is_straight, ~is_straight), basis.stiffness_rules, strict=True):
        members = np.flatnonzero(group)
        for start in range(0, len(members), 512):
            yield members[start : start + 512], rule


def gradients(basis: Displacements, chosen: Index, rule: Quadrature) -> tuple[Array, Array]:
    """Return physical gradients (E, q, n, 3) and volume weights (E, q) of the elements."""
    jacobians = basis.mesh.jacobians(rule.points, chosen)
    determinants = np.linalg.det(jacobians)
    inverted_count = np.count_nonzero((determinants <= 0).any(axis=1))
    if inverted_count:
        raise MeshError(
            f"{inverted_count} of {len(basis.mesh.elements)} elements are turned inside out: the "
            "mesh folds over itself there; use another lattice (accuracy=) or a smoother surface"
        )
    slopes = basis.slopes(rule.points, np.asarray(np.linalg.inv(jacobians), np.float64), chosen)
    return slopes, determinants * rule.weights


def _products(basis: Displacements, chosen: Index, rule: Quadrature) -> Array:
    """Return the integrals of G_ia G_jb of the elements: (E, n, 3, n, 3)."""
    slopes, weights = gradients(basis, chosen, rule)
    count, points, functions, _ = slopes.shape
    flat = slopes.reshape(count, points, 3 * functions)
    products = (flat * weights[:, :, None]).transpose(0, 2, 1) @ flat
    return products.reshape(count, functions, 3, functions, 3)


def _components(
    products: Array, lower: Index, upper: Index, is_swapped: Mask, material: Material
) -> Iterator[tuple[int, int, Array]]:
    """Yield a, b and K_ij,ab of the pairs, with the higher node as row: (E, pairs)."""
    g = [[products[:, lower, a, upper, b] for b in range(3)] for a in range(3)]
    trace = material.shear_modulus * (g[0][0] + g[1][1] + g[2][2])
    for a, b in product(range(3), repeat=2):
        if a == b:
            yield a, a, (material.first_lame + material.shear_modulus) * g[a][a] + trace
        else:
            first_terms = np.where(is_swapped, g[b][a], g[a][b])
            second_terms = np.where(is_swapped, g[a][b], g[b][a])
            yield a, b, material.first_lame * first_terms + material.shear_modulus * second_terms


def _masses(basis: Displacements, chosen: Index, material: Material, *, lumped: bool) -> Array:
    rule = basis.mass_rule
    jacobians = basis.mesh.jacobians(rule.points, chosen)
    weights = material.density * np.linalg.det(jacobians) * rule.weights
    if lumped:
        return weights.sum(axis=1)[:, None, None] * np.eye(4) / 4
    values = basis.values(rule.points, chosen)
    if len(values) > 1:
        return (values * weights[:, :, None]).transpose(0, 2, 1) @ values
    products = values[0, :, :, None] * values[0, :, None, :]
    return np.asarray(np.tensordot(weights, products, axes=1), np.float64)


def _node_pairs(first: Index, second: Index, nodes: int) -> tuple[Index, Index]:
    """Return the distinct node pairs as sorted keys and the place of each element's pair."""
    keys = (np.minimum(first, second) * nodes + np.maximum(first, second)).ravel()
    order = np.argsort(keys)
    sorted_keys = keys[order]
    is_new = np.concatenate([[True], sorted_keys[1:] != sorted_keys[:-1]])
    place = np.empty(len(keys), np.int64)
    place[order] = np.cumsum(is_new) - 1
    return sorted_keys[is_new], place.reshape(first.shape)


def _expand_blocks(blocks: Array, rows: Index, starts: Index) -> sparse.csc_matrix:
    """Expand 3x3 blocks (3, 3, P) on the lower triangle to scalars, column after column."""
    nodes, counts = len(starts) - 1, np.diff(starts)
    columns = np.repeat(np.arange(nodes), counts)
    slot = np.arange(len(rows)) - np.repeat(starts[:-1], counts)
    # The diagonal block comes first in its column and loses its b entries above the diagonal.
    ends = np.cumsum((3 * counts[:, None] - np.arange(3)).ravel())
    first_slots = np.concatenate([[0], ends[:-1]]).reshape(nodes, 3)
    pattern, data = np.empty(ends[-1], np.int32), np.empty(ends[-1])
    for a, b in product(range(3), repeat=2):
        is_lower = slice(None) if a >= b else slot > 0
        target = (first_slots[columns, b] + 3 * slot + a - b)[is_lower]
        pattern[target] = (3 * rows + a)[is_lower]
        data[target] = blocks[a, b][is_lower]
    indptr = np.concatenate([[0], ends])
    return sparse.csc_matrix((data, pattern, indptr), shape=(3 * nodes, 3 * nodes))


def _fill_both_triangles(values: Array, rows: Index, starts: Index) -> sparse.csr_matrix:
    nodes = len(starts) - 1
    lower = sparse.csc_matrix((values, rows, starts), shape=(nodes, nodes))
    return (lower + sparse.tril(lower, -1).T).tocsr()

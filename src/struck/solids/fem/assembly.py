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

import numpy as np
from scipy import sparse

from struck.errors import MeshError
from struck.model.arrays import Array, Index, Mask
from struck.model.material import Material
from struck.solids.fem.elements import Quadrature
from struck.solids.volume_mesh import VolumeMesh


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class System:
    """Stiffness and mass on pairs of nodes, lower triangle."""

    starts: Index  # (N + 1,): where each column of node pairs begins
    rows: Index  # (P,): at or below the diagonal
    stiffness: Array  # (3, 3, P), N/m
    mass: Array  # (P,), kg: the same in all three directions

    @property
    def node_count(self) -> int:
        """Nodes that can move."""
        return len(self.starts) - 1

    @property
    def unknowns(self) -> int:
        """Displacements, three a node."""
        return 3 * self.node_count

    @property
    def entries(self) -> int:
        """Stored entries of the lower triangle of K."""
        return 9 * len(self.rows) - 3 * self.node_count

    @property
    def columns(self) -> Index:
        """Column of each node pair (P,)."""
        return np.repeat(np.arange(self.node_count), np.diff(self.starts))

    def mass_matrix(self) -> sparse.csr_matrix:
        """Return the mass between nodes, both triangles (N, N)."""
        return _both_triangles(self.mass, self.rows, self.starts)

    def shifted(self, shift: float) -> sparse.csc_matrix:
        """Return the lower triangle of K - shift M (3N, 3N)."""
        blocks = self.stiffness.copy()
        blocks[(0, 1, 2), (0, 1, 2)] -= shift * self.mass
        return _scalar_lower(blocks, self.rows, self.starts)

    def free(self, movable: Mask) -> System:
        """Return the system with the other nodes held still."""
        numbers = np.cumsum(movable) - 1
        kept = movable[self.rows] & movable[self.columns]
        counts = np.bincount(numbers[self.columns[kept]], minlength=int(movable.sum()))
        return System(
            starts=np.concatenate([[0], np.cumsum(counts)]),
            rows=numbers[self.rows[kept]],
            stiffness=self.stiffness[:, :, kept],
            mass=self.mass[kept],
        )


def assemble(mesh: VolumeMesh, material: Material, *, lumped: bool = False) -> System:
    """Assemble stiffness and mass; `lumped` puts an element's mass on its nodes (2002, eq. 15)."""
    if lumped and mesh.kind != "tet4":
        raise MeshError(f"mass is lumped on tet4 elements only, not on {mesh.kind}: leave it out")
    lower, upper = np.tril_indices(len(mesh.element.nodes))
    first, second = mesh.elements[:, lower], mesh.elements[:, upper]
    pairs, place = _node_pairs(first, second, len(mesh.nodes))
    turned = first < second
    stiffness, mass = np.zeros((3, 3, len(pairs))), np.zeros(len(pairs))
    for chosen, rule in _batches(mesh):
        products = _products(mesh, chosen, rule)
        # np.add.at is six times faster on flat arrays.
        where = place[chosen].ravel()
        for a, b, part in _components(products, lower, upper, turned[chosen], material):
            np.add.at(stiffness[a, b], where, part.ravel())
        parts = _masses(mesh, chosen, material, lumped=lumped)[:, lower, upper]
        np.add.at(mass, where, parts.ravel())
    columns, rows = np.divmod(pairs, len(mesh.nodes))
    counts = np.bincount(columns, minlength=len(mesh.nodes))
    starts = np.concatenate([[0], np.cumsum(counts)])
    return System(starts=starts, rows=rows, stiffness=stiffness, mass=mass)


def _batches(mesh: VolumeMesh) -> Iterator[tuple[Index, Quadrature]]:
    """Yield groups of elements that fit the processor's cache, with the rule they need."""
    straight = mesh.straight()
    rules = ((straight, mesh.element.straight_rule), (~straight, mesh.element.stiffness_rule))
    for group, rule in rules:
        members = np.flatnonzero(group)
        for start in range(0, len(members), 512):
            yield members[start : start + 512], rule


def gradients(mesh: VolumeMesh, chosen: Index, rule: Quadrature) -> tuple[Array, Array]:
    """Return physical gradients (E, q, n, 3) and volume weights (E, q) of the elements."""
    jacobians = mesh.jacobians(rule.points, chosen)
    determinants = np.linalg.det(jacobians)
    inverted = np.count_nonzero((determinants <= 0).any(axis=1))
    if inverted:
        raise MeshError(
            f"{inverted} of {len(mesh.elements)} elements are turned inside out: the mesh folds "
            "over itself there; use another lattice (accuracy=) or a smoother surface"
        )
    reference = mesh.element.gradients(rule.points)
    return reference @ np.linalg.inv(jacobians), determinants * rule.weights


def _products(mesh: VolumeMesh, chosen: Index, rule: Quadrature) -> Array:
    """Return the integrals of G_ia G_jb of the elements: (E, n, 3, n, 3)."""
    slopes, weights = gradients(mesh, chosen, rule)
    count, points, nodes, _ = slopes.shape
    flat = slopes.reshape(count, points, 3 * nodes)
    products = (flat * weights[:, :, None]).transpose(0, 2, 1) @ flat
    return products.reshape(count, nodes, 3, nodes, 3)


def _components(
    products: Array,
    lower: Index,
    upper: Index,
    turned: Mask,
    material: Material,
) -> Iterator[tuple[int, int, Array]]:
    """Yield a, b and K_ij,ab of the pairs, with the higher node as row: (E, pairs)."""
    g = [[products[:, lower, a, upper, b] for b in range(3)] for a in range(3)]
    trace = material.shear_modulus * (g[0][0] + g[1][1] + g[2][2])
    for a, b in product(range(3), repeat=2):
        if a == b:
            yield a, a, (material.first_lame + material.shear_modulus) * g[a][a] + trace
        else:
            straight = np.where(turned, g[b][a], g[a][b])
            crossed = np.where(turned, g[a][b], g[b][a])
            yield a, b, material.first_lame * straight + material.shear_modulus * crossed


def _masses(mesh: VolumeMesh, chosen: Index, material: Material, *, lumped: bool) -> Array:
    rule = mesh.element.mass_rule
    weights = material.density * np.linalg.det(mesh.jacobians(rule.points, chosen)) * rule.weights
    if lumped:
        return weights.sum(axis=1)[:, None, None] * np.eye(4) / 4
    values = mesh.element.values(rule.points)
    products = values[:, :, None] * values[:, None, :]
    return np.asarray(np.tensordot(weights, products, axes=1), np.float64)


def _node_pairs(first: Index, second: Index, nodes: int) -> tuple[Index, Index]:
    """Return the distinct node pairs as sorted keys and the place of each element's pair."""
    keys = (np.minimum(first, second) * nodes + np.maximum(first, second)).ravel()
    order = np.argsort(keys)
    ordered = keys[order]
    fresh = np.concatenate([[True], ordered[1:] != ordered[:-1]])
    place = np.empty(len(keys), np.int64)
    place[order] = np.cumsum(fresh) - 1
    return ordered[fresh], place.reshape(first.shape)


def _scalar_lower(blocks: Array, rows: Index, starts: Index) -> sparse.csc_matrix:
    """Expand 3x3 blocks (3, 3, P) on the lower triangle to scalars, column after column."""
    nodes, counts = len(starts) - 1, np.diff(starts)
    columns = np.repeat(np.arange(nodes), counts)
    slot = np.arange(len(rows)) - np.repeat(starts[:-1], counts)
    # The diagonal block comes first in its column and loses its b entries above the diagonal.
    ends = np.cumsum((3 * counts[:, None] - np.arange(3)).ravel())
    begins = np.concatenate([[0], ends[:-1]]).reshape(nodes, 3)
    pattern, data = np.empty(ends[-1], np.int32), np.empty(ends[-1])
    for a, b in product(range(3), repeat=2):
        kept = slice(None) if a >= b else slot > 0
        target = (begins[columns, b] + 3 * slot + a - b)[kept]
        pattern[target] = (3 * rows + a)[kept]
        data[target] = blocks[a, b][kept]
    indptr = np.concatenate([[0], ends])
    return sparse.csc_matrix((data, pattern, indptr), shape=(3 * nodes, 3 * nodes))


def _both_triangles(values: Array, rows: Index, starts: Index) -> sparse.csr_matrix:
    nodes = len(starts) - 1
    lower = sparse.csc_matrix((values, rows, starts), shape=(nodes, nodes))
    return (lower + sparse.tril(lower, -1).T).tocsr()

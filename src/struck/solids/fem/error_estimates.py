"""Errors of natural frequencies: residuals on one mesh, scaled where a second mesh is known.

A mode leaves forces on functions of the next degree: cubics along edges, bubbles on sides. Each
on its own yields to its force, and the energies won so are together about what the eigenvalue is
too high by (Bank & Smith 1993, SIAM J. Numer. Anal. 30:921).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from struck.model.arrays import Array, Complex, Index, Mask
from struck.model.material import Material
from struck.model.modes import Modes
from struck.solids.fem.elements import ELEMENTS, PROMOTED, Element
from struck.solids.volume_mesh import VolumeMesh

_COLUMNS = 32
_CHUNK = 512
_STEP = 1e-30  # derivatives by complex steps are exact
# Hexahedra are integrated by few points. Half of what they yield is no error, as their stresses
# are better there than in between; and where an element is too large for a thin or curved wall,
# the energy that those points do not see tells it, much too loudly.
_YIELDING, _UNSEEN = 0.45, 0.03


def residual_errors(mesh: VolumeMesh, material: Material, values: Array, vectors: Array) -> Array:
    """Return the relative error of each frequency (M,) from the residuals of its mode."""
    # Values are in 1/s^2 (M,), vectors mass-normalised (N, 3, M); nodes that never move are held.
    finer = Finer.of(mesh, held=np.all(vectors == 0, axis=(1, 2)))
    parts = np.array_split(np.arange(len(values)), max(1, -(-len(values) // _COLUMNS)))
    energies = [_missing(finer, material, values[p], vectors[:, :, p]) for p in parts]
    return np.concatenate(energies) / (2 * values)


def _missing(finer: Finer, material: Material, values: Array, vectors: Array) -> Array:
    yielded, seen_everywhere = finer.energies(material, values, vectors)
    if not finer.reduced:
        return yielded
    return np.maximum(_YIELDING * yielded, _UNSEEN * (seen_everywhere - values))


def shares(kind: str, points: Array | Complex) -> Array | Complex:
    """Return barycentric coordinates (q, s) of reference `points` (q, 3), factor after factor."""
    # A hexahedron is the product of three lines, a wedge of a triangle and a line.
    x, y, z = points.T
    if kind.startswith("tet"):
        return np.stack([1 - x - y - z, x, y, z], axis=1)
    if kind.startswith("hex"):
        return np.stack([1 - x, x, 1 - y, y, 1 - z, z], axis=1)
    return np.stack([1 - x - y, x, y, 1 - z, z], axis=1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Finer:
    """The functions of the next degree on a mesh."""

    mesh: VolumeMesh
    members: tuple[tuple[int, ...], ...]  # corners of the edge or side of each function
    numbers: Index  # (E, m), of the functions in the whole mesh
    signs: Array  # (E, m): which way a cubic runs along its edge; 0 held

    @classmethod
    def of(cls, mesh: VolumeMesh, held: Mask) -> Finer:
        """Return the functions of all edges and, for quadratic elements, of all sides."""
        edges = ELEMENTS[PROMOTED.get(mesh.kind, mesh.kind)].edges
        members = edges if mesh.kind in PROMOTED else (*edges, *mesh.element.sides)
        keys = np.empty((len(mesh.elements), len(members)), np.int64)
        signs = np.ones(keys.shape)
        for i, member in enumerate(members):
            corners = mesh.corners[:, member]
            keys[:, i] = _keys(np.sort(corners, axis=1), len(mesh.nodes))
            if len(member) == 2 and mesh.kind not in PROMOTED:
                signs[:, i] = np.sign(corners[:, 1] - corners[:, 0])
            signs[held[corners].all(axis=1), i] = 0
        numbers = np.unique(keys, return_inverse=True)[1].reshape(keys.shape)
        return cls(mesh=mesh, members=members, numbers=numbers, signs=signs)

    @property
    def reduced(self) -> bool:
        """Whether fewer points carry the stiffness than would integrate it."""
        return self.mesh.kind.startswith("hex")

    def values(self, points: Array | Complex) -> Array | Complex:
        """Return the functions at reference `points` (q, 3): (q, m)."""
        at = shares(self.mesh.kind, points)
        corners = shares(self.mesh.kind, self.mesh.element.corners)
        found = []
        for member in self.members:
            involved = corners[list(member)].any(axis=0)
            function = np.prod(at[:, involved], axis=1)
            if len(member) == 2 and self.mesh.kind not in PROMOTED:
                function = function * (at @ (corners[member[1]] - corners[member[0]]))
            found.append(function)
        return np.stack(found, axis=1)

    def gradients(self, points: Array) -> Array:
        """Return their gradients in reference coordinates: (q, m, 3)."""
        steps = [points + 1j * _STEP * axis for axis in np.eye(3)]
        return np.stack([np.imag(self.values(at)) / _STEP for at in steps], axis=2)

    def energies(self, material: Material, values: Array, vectors: Array) -> tuple[Array, Array]:
        """Return twice the energy gained, and twice that of the modes at all points (M,)."""
        count, modes = int(self.numbers.max()) + 1, len(values)
        forces, stiffness = np.zeros((count, 3 * modes)), np.zeros((count, 9))
        everywhere = np.zeros(modes)
        for chunk in self.mesh.chunks(_CHUNK):
            part = _Part(self, chunk)
            shapes = vectors[self.mesh.elements[chunk]].reshape(len(part.weights), -1, modes)
            force, own = part.forces(material, values, shapes), part.stiffness(material)
            here, at = np.unique(self.numbers[chunk], return_inverse=True)
            signs = self.signs[chunk].ravel()
            gather = sparse.csr_array((signs, (at.ravel(), np.arange(len(signs)))))
            forces[here] += gather @ force.reshape(len(signs), -1)
            stiffness[here] += abs(gather) @ own.reshape(len(signs), -1)
            if self.reduced:
                everywhere += part.strain_energy(material, shapes)
        free = stiffness[:, 0] > 0
        loads = forces[free].reshape(-1, 3, modes)
        moved = np.linalg.solve(stiffness[free].reshape(-1, 3, 3), loads)
        return np.einsum("kam,kam->m", loads, moved), everywhere


def _keys(corners: Index, nodes: int) -> Index:
    """Return a number for each edge (two corners) or side (its three lowest corners)."""
    ends = corners[:, 0] * nodes + corners[:, 1]
    return ends if corners.shape[1] == 2 else nodes**2 + ends * nodes + corners[:, 2]


class _Part:
    """Some elements of a mesh at quadrature points."""

    def __init__(self, finer: Finer, chunk: slice) -> None:
        element, rule = finer.mesh.element, finer.mesh.element.mass_rule
        jacobians = finer.mesh.jacobians(rule.points, chunk)
        self.weights = np.linalg.det(jacobians) * rule.weights
        inverse = np.linalg.inv(jacobians)
        self._slopes = element.gradients(rule.points) @ inverse
        self._finer_slopes = finer.gradients(rule.points) @ inverse
        self._products = finer.values(rule.points), element.values(rule.points)
        self._seen = _carried(finer.mesh, chunk) if finer.reduced else self._slopes

    def forces(self, material: Material, values: Array, shapes: Array) -> Array:
        """Return what modes (E, 3n, M) leave of forces on the functions (E, m, 3, M)."""
        across = _stiffness(self._integrals(self._finer_slopes, self._seen), material)
        count, functions, _, nodes, _ = across.shape
        elastic = across.reshape(count, 3 * functions, 3 * nodes) @ shapes
        inertia = material.density * np.einsum(
            "eq,qm,qn->emn", self.weights, *self._products, optimize=True
        )
        moved = inertia @ shapes.reshape(count, nodes, -1)
        return (elastic.reshape(count, functions, 3, -1)) - moved.reshape(
            count, functions, 3, -1
        ) * values

    def stiffness(self, material: Material) -> Array:
        """Return the stiffness of each function (E, m, 3, 3)."""
        slopes = self._finer_slopes
        products = np.einsum("eqma,eqmb,eq->emab", slopes, slopes, self.weights, optimize=True)
        return _stiffness(products[:, :, :, None], material)[:, :, :, 0]

    def strain_energy(self, material: Material, shapes: Array) -> Array:
        """Return twice the elastic energy of modes (E, 3n, M) at all points (M,)."""
        whole = _stiffness(self._integrals(self._slopes, self._slopes), material)
        stiffness = whole.reshape(len(shapes), shapes.shape[1], -1)
        return np.einsum("enm,enm->m", shapes, stiffness @ shapes)

    def _integrals(self, first: Array, second: Array) -> Array:
        """Return the integrals of slopes of functions: (E, m, 3, n, 3)."""
        count, points, functions, _ = first.shape
        weighted = (first * self.weights[:, :, None, None]).reshape(count, points, -1)
        products = weighted.transpose(0, 2, 1) @ second.reshape(count, points, -1)
        return products.reshape(count, functions, 3, -1, 3)


def _stiffness(products: Array, material: Material) -> Array:
    """Return stiffness from products of slopes (E, m, 3, n, 3): see struck.solids.fem.assembly."""
    blocks = material.first_lame * products
    blocks += material.shear_modulus * products.transpose(0, 1, 4, 3, 2)
    traces = material.shear_modulus * np.trace(products, axis1=2, axis2=4)
    for axis in range(3):
        blocks[:, :, axis, :, axis] += traces
    return blocks


def _carried(mesh: VolumeMesh, chunk: slice) -> Array:
    """Return slopes as the 2 x 2 x 2 points of hexahedra see them, at all points (E, q, n, 3)."""
    linear: Element = ELEMENTS["hex8"]
    few = 0.5 + (linear.corners - 0.5) / np.sqrt(3)
    between = linear.values(mesh.element.mass_rule.points) @ np.linalg.inv(linear.values(few))
    slopes = mesh.element.gradients(few) @ np.linalg.inv(mesh.jacobians(few, chunk))
    return np.einsum("qp,epnd->eqnd", between, slopes, optimize=True)


# Two meshes: their frequencies move apart while the residual errors shrink. Movement over shrinkage
# scales the errors that are left, even where both meshes share a defect, as walls of one layer do.
# The figures were set on spheres, cubes, tubes and plates whose frequencies are known.

ALONE, _SCALED = 4.0, 2.3  # bound over residual error: of one mesh, and scaled by two
_POWER = 3.0  # of the edges, with which errors fall; 4 is the most that quadratic elements reach
_TYPICAL = 2.5  # how many times larger the errors are for which a count of nodes is chosen
_LEAST_RATIO = 1.05  # of the nodes of two meshes that are compared
_LEAST_GAIN = 0.05  # least share of its residual error that the finer mesh counts as having removed
_MOST_MODES = 0.9
_OF_VOLUME = 1.5  # relative error of frequencies over that of the volume, where edges are cut off
# Least error stated. Where a mode looks so much more exact than the modes beside it (four on each
# side), two meshes happen to agree on it: it gets this share of theirs.
_LEAST, _BESIDE, _OUTLYING, _SHARE = 1e-4, 4, 0.07, 0.6


def stated_errors(modes: Modes, nodes: int, coarse: Modes | None, coarse_nodes: int) -> Array:
    """Return the relative error of each frequency (M,) from those of one or of two meshes."""
    # `modes` and `coarse` (a coarser mesh, a wider band) come with residual errors of one mesh.
    if coarse is None or not comparable(nodes, coarse_nodes):
        return np.maximum(modes.errors, _LEAST)
    known = min(len(modes.frequencies), len(coarse.frequencies))
    ratio = coarse.frequencies[:known] / modes.frequencies[:known]
    before, after = coarse.errors[:known], modes.errors[:known]
    # Errors are told in energy, and as shares of what their own mesh found.
    gone = np.abs(1 - ratio**-2) / 2
    scale = gone / np.maximum(before - after, _LEAST_GAIN * before)
    # Where modes cross from mesh to mesh one's own scale means little: that of most holds too.
    scaled = _SCALED * np.maximum(scale, np.median(scale)) * after
    fallen = np.abs(ratio - 1) / ((nodes / coarse_nodes) ** (_POWER / 3) - 1)
    errors = modes.errors.copy()
    errors[:known] = np.minimum(scaled, np.maximum(after, fallen))
    return _levelled(errors)


def comparable(nodes: int, coarse_nodes: int) -> bool:
    """Tell whether a coarser mesh of so many nodes says something about one of `nodes`."""
    return coarse_nodes > 0 and nodes / coarse_nodes >= _LEAST_RATIO


def _levelled(errors: Array) -> Array:
    spans = [errors[max(i - _BESIDE, 0) : i + _BESIDE + 1] for i in range(len(errors))]
    beside = np.array([np.median(span) for span in spans])
    believed = np.where(errors < _OUTLYING * beside, _SHARE * beside, errors)
    return np.maximum(believed, _LEAST)


def nodes_needed(coarse: Modes, nodes: int, target: float) -> int:
    """Return how many nodes bring most modes' errors below `target`, from a coarser mesh's."""
    error = float(np.quantile(coarse.errors, _MOST_MODES)) * (_TYPICAL / ALONE)
    return int(nodes * max(error / target, 1e-9) ** 0.75)


def with_shape(errors: Array, volume_error: float) -> Array:
    """Return errors (M,) with what the body's own shape misses, as crisp edges cut off do."""
    return np.hypot(errors, _OF_VOLUME * volume_error)

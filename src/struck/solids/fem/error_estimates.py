"""Errors of natural frequencies: residuals on one mesh, scaled where a second mesh is known.

A mode leaves forces on functions of the next degree: cubics along edges, bubbles on sides. Each
on its own yields to its force, and the energies won so are together about what the eigenvalue is
too high by (Bank & Smith 1993, SIAM J. Numer. Anal. 30:921).
"""

from __future__ import annotations

import numpy as np
from scipy import sparse

from struck.model.arrays import Array
from struck.model.material import Material
from struck.model.mesh import Mesh, Surface
from struck.model.modes import Modes
from struck.solids.elements import ELEMENTS, Element
from struck.solids.fem.assembly import Displacements, Hierarchic
from struck.solids.volume_mesh import VolumeMesh

_COLUMNS = 32
_CHUNK = 512
# Hexahedra are integrated by few points. Half of what they yield is no error, as their stresses
# are better there than in between; and where an element is too large for a thin or curved wall,
# the energy that those points do not see tells it, much too loudly.
_YIELDING, _UNSEEN = 0.45, 0.03
# Cubics in one layer of a wall: functions that each yield alone win a small part of what is missing
# there, as bending takes many at once.
_CUBIC = 4.0


def residual_errors(mesh: VolumeMesh, material: Material, values: Array, vectors: Array) -> Array:
    """Return the relative error of each frequency (M,) from the residuals of its mode."""
    # Values are in 1/s^2 (M,), vectors mass-normalised (N, 3, M); nodes that never move are held.
    held = np.all(vectors[: len(mesh.nodes)] == 0, axis=(1, 2))
    pair = Displacements.of(mesh), Hierarchic.of(mesh, held)
    parts = np.array_split(np.arange(len(values)), max(1, -(-len(values) // _COLUMNS)))
    energies = [_missing(*pair, material, values[p], vectors[:, :, p]) for p in parts]
    return np.concatenate(energies) / (2 * values) * (_CUBIC if mesh.cubic else 1.0)


def _missing(
    basis: Displacements, finer: Hierarchic, material: Material, values: Array, vectors: Array
) -> Array:
    yielded, seen_everywhere = energies_gained(basis, finer, material, values, vectors)
    if not _is_reduced(basis.mesh):
        return yielded
    return np.maximum(_YIELDING * yielded, _UNSEEN * (seen_everywhere - values))


def _is_reduced(mesh: VolumeMesh) -> bool:
    """Return whether fewer points carry the stiffness than would integrate it."""
    return mesh.kind.startswith("hex")


def energies_gained(
    basis: Displacements, finer: Hierarchic, material: Material, values: Array, vectors: Array
) -> tuple[Array, Array]:
    """Return twice the strain energy gained, and twice the modes' energy at all points (M,)."""
    modes = len(values)
    forces, stiffness = np.zeros((finer.count, 3 * modes)), np.zeros((finer.count, 9))
    everywhere = np.zeros(modes)
    for chunk in basis.mesh.chunks(_CHUNK):
        part = _Part(basis, finer, chunk)
        shapes = vectors[basis.numbers[chunk]].reshape(len(part.weights), -1, modes)
        force, own = part.forces(material, values, shapes), part.stiffness(material)
        here, at = np.unique(finer.numbers[chunk], return_inverse=True)
        signs = finer.signs[chunk].ravel()
        gather = sparse.csr_array((signs, (at.ravel(), np.arange(len(signs)))))
        forces[here] += gather @ force.reshape(len(signs), -1)
        stiffness[here] += abs(gather) @ own.reshape(len(signs), -1)
        if _is_reduced(basis.mesh):
            everywhere += part.strain_energy(material, shapes)
    free = stiffness[:, 0] > 0
    loads = forces[free].reshape(-1, 3, modes)
    moved = np.linalg.solve(stiffness[free].reshape(-1, 3, 3), loads)
    return np.einsum("kam,kam->m", loads, moved), everywhere


class _Part:
    """Some elements of a mesh at quadrature points."""

    def __init__(self, basis: Displacements, finer: Hierarchic, chunk: slice) -> None:
        rule = basis.mass_rule
        jacobians = basis.mesh.jacobians(rule.points, chunk)
        self.weights = np.linalg.det(jacobians) * rule.weights
        inverse = np.asarray(np.linalg.inv(jacobians), np.float64)
        self._slopes = basis.slopes(rule.points, inverse, chunk)
        self._finer_slopes = finer.gradients(rule.points) @ inverse
        self._products = finer.values(rule.points), basis.values(rule.points, chunk)
        self._seen = _carried(basis.mesh, chunk) if _is_reduced(basis.mesh) else self._slopes

    def forces(self, material: Material, values: Array, shapes: Array) -> Array:
        """Return the residual forces of modes (E, 3n, M) on the finer functions (E, m, 3, M)."""
        across = _stiffness(self._integrals(self._finer_slopes, self._seen), material)
        count, functions, _, nodes, _ = across.shape
        elastic = across.reshape(count, 3 * functions, 3 * nodes) @ shapes
        finer, own = self._products
        weighted = self.weights[:, :, None] * finer
        inertia = material.density * (weighted.transpose(0, 2, 1) @ own)
        moved = inertia @ shapes.reshape(count, nodes, -1)
        return (elastic.reshape(count, functions, 3, -1)) - moved.reshape(
            count, functions, 3, -1
        ) * values

    def stiffness(self, material: Material) -> Array:
        """Return the stiffness of each finer basis function in each element (E, m, 3, 3)."""
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
LEAST_FINER = 1.016
"""Least ratio of the widths of elements of two meshes that are compared."""
_LEAST_GAIN = 0.05  # least share of its residual error that the finer mesh counts as having removed
_MOST_MODES = 0.9
_CAUTIOUS = 4.0  # times the true errors that stated ones are, where they are not far too large
_AGAIN = 4.0, 8.0  # times the error, by whose fourth root elements are made narrower
_OF_VOLUME = 1.5  # relative error of frequencies over that of the volume, where edges are cut off
# The same over the mass that is cut off, but not this much more: elements beside it suffer too.
_OF_CUT, _MORE_OF_CUT = 3.0, 0.01
_PLACES = 5_000  # all over a surface, where it is compared with that of the elements
_BENT = 0.05  # distance from a flat triangle over its size that is still that of a bent one
_OF_LAYER = 2.0  # the same of thin walls: a tube with lattice cells as wide as its radius
# Least error stated. Where a mode looks so much more exact than the modes beside it (four on each
# side), two meshes happen to agree on it: it gets this share of theirs.
_LEAST, _BESIDE, _OUTLYING, _SHARE = 1e-4, 4, 0.07, 0.6


def stated_errors(modes: Modes, coarse: Modes | None, finer: float) -> Array:
    """Return the relative error of each frequency (M,) by the estimates of one or two meshes."""
    # `modes` and `coarse` (elements `finer` times as wide, a wider band) come with residual errors
    # of one mesh.
    if coarse is None or finer < LEAST_FINER:
        return np.maximum(modes.errors, _LEAST)
    known = min(len(modes.frequencies), len(coarse.frequencies))
    ratio = coarse.frequencies[:known] / modes.frequencies[:known]
    before, after = coarse.errors[:known], modes.errors[:known]
    # Errors are told in energy, and as shares of what their own mesh found.
    gone = np.abs(1 - ratio**-2) / 2
    scale = gone / np.maximum(before - after, _LEAST_GAIN * before)
    # Where modes cross from mesh to mesh one's own scale means little: that of most holds too.
    scaled = _SCALED * np.maximum(scale, np.median(scale)) * after
    fallen = np.abs(ratio - 1) / (finer**_POWER - 1)
    # Modes that the coarse mesh has beyond its band are scaled as most others.
    errors = np.maximum(1.0, _SCALED * np.median(scale)) * modes.errors if known else modes.errors
    errors[:known] = np.minimum(scaled, np.maximum(after, fallen))
    return _shared(modes.frequencies, _levelled(errors))


def _levelled(errors: Array) -> Array:
    spans = [errors[max(i - _BESIDE, 0) : i + _BESIDE + 1] for i in range(len(errors))]
    beside = np.array([np.median(span) for span in spans])
    return np.maximum(np.where(errors < _OUTLYING * beside, _SHARE * beside, errors), _LEAST)


def _shared(frequencies: Array, errors: Array) -> Array:
    """Give two modes that lie within their errors of each other the mean of both."""
    # A symmetric body has such pairs. Meshes split them by chance, so that one of the two looks
    # more exact than it is and the other less.
    if len(errors) < 2:
        return errors
    gaps = np.diff(frequencies) / frequencies[1:]
    beside = np.pad(gaps, 1, constant_values=np.inf)
    closest = (gaps < beside[:-2]) & (gaps <= beside[2:])
    first = np.flatnonzero(closest & (gaps <= np.maximum(errors[:-1], errors[1:])))
    shared = errors.copy()
    shared[first] = shared[first + 1] = (errors[first] + errors[first + 1]) / 2
    return shared


def most_errors(modes: Modes) -> float:
    """Return the error that nine in ten modes keep."""
    return float(np.quantile(modes.errors, _MOST_MODES)) if len(modes.errors) else 0.0


def nodes_needed(coarse: Modes, nodes: int, target: float) -> int:
    """Return how many nodes bring most modes' errors below `target`, from a coarser mesh's."""
    error = most_errors(coarse) * (_TYPICAL / ALONE)
    return int(nodes * max(error / target, 1e-9) ** 0.75)


def times_too_wide(stated: float, target: float) -> float:
    """Return how many times too wide elements are if errors stated are far above `target`, or 1."""
    beyond = stated / (_CAUTIOUS * target)
    return float(np.clip(beyond, *_AGAIN)) ** 0.25 if beyond > 1 else 1.0


def with_shape(
    errors: Array, volume_error: float, cut: Array | float = 0.0, *, layer: bool = False
) -> Array:
    """Return errors (M,) increased by errors of the geometry, of volume and of `cut` elements."""
    # In a `layer`, what its two faces miss partly cancels in the volume.
    all_over = (_OF_LAYER if layer else _OF_VOLUME) * abs(volume_error)
    there = np.minimum(_OF_CUT * np.asarray(cut), cut + _MORE_OF_CUT)
    return np.hypot(errors, np.maximum(all_over, there))


def cut_off(outline: Mesh, modes: Modes) -> Array:
    """Return how much the mass beyond the elements would lower each frequency (M,), or more.

    A needle's point is next to nothing of the volume, but moves farther than all the rest. By
    Rayleigh's quotient a mass m lowers a frequency by its share m |shape|^2 / 2.
    """
    surface = modes.surface
    points, areas = outline.spread(_PLACES)
    faces, weights = Surface(surface).barycentric(points)
    away = points - np.einsum("sc,scd->sd", weights, surface.points[surface.faces[faces]])
    # Less is the arc over a chord of elements that are bent.
    far = np.linalg.norm(away, axis=1) > _BENT * np.sqrt(surface.areas[faces])
    volumes = np.maximum(np.einsum("sd,sd->s", away, areas), 0) * far
    masses = modes.mass / surface.volume * volumes[:, None] * weights
    gathered = np.bincount(surface.faces[faces].ravel(), masses.ravel(), len(surface.points))
    moving = np.flatnonzero(gathered)
    return gathered[moving] @ np.square(modes.shapes[moving]).sum(axis=1) / 2

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
_YIELD_FACTOR, _UNSEEN_FACTOR = 0.45, 0.03
# Cubics in one layer of a wall: functions that each yield alone win a small part of what is missing
# there, as bending takes many at once.
_CUBIC_FACTOR = 4.0


def residual_errors(mesh: VolumeMesh, material: Material, values: Array, vectors: Array) -> Array:
    """Return the relative error of each frequency (M,) from the residuals of its mode."""
    # Values are in 1/s^2 (M,), vectors mass-normalised (N, 3, M); nodes that never move are held.
    is_held = np.all(vectors[: len(mesh.nodes)] == 0, axis=(1, 2))
    pair = Displacements.of(mesh), Hierarchic.of(mesh, is_held)
    parts = np.array_split(np.arange(len(values)), max(1, -(-len(values) // _COLUMNS)))
    energies = [_estimate_missing(*pair, material, values[p], vectors[:, :, p]) for p in parts]
    return np.concatenate(energies) / (2 * values) * (_CUBIC_FACTOR if mesh.cubic else 1.0)


def _estimate_missing(
    basis: Displacements, hierarchic: Hierarchic, material: Material, values: Array, vectors: Array
) -> Array:
    yielded_energies, full_energies = energies_gained(basis, hierarchic, material, values, vectors)
    if not _is_reduced(basis.mesh):
        return yielded_energies
    return np.maximum(_YIELD_FACTOR * yielded_energies, _UNSEEN_FACTOR * (full_energies - values))


def _is_reduced(mesh: VolumeMesh) -> bool:
    """Return whether fewer points carry the stiffness than would integrate it."""
    return mesh.kind.startswith("hex")


def energies_gained(
    basis: Displacements, hierarchic: Hierarchic, material: Material, values: Array, vectors: Array
) -> tuple[Array, Array]:
    """Return twice the strain energy gained, and twice the modes' energy at all points (M,)."""
    modes = len(values)
    forces, stiffness = np.zeros((hierarchic.count, 3 * modes)), np.zeros((hierarchic.count, 9))
    full_energies = np.zeros(modes)
    for chunk in basis.mesh.chunks(_CHUNK):
        part = _Part(basis, hierarchic, chunk)
        shapes = vectors[basis.numbers[chunk]].reshape(len(part.weights), -1, modes)
        force, chunk_stiffness = part.forces(material, values, shapes), part.stiffness(material)
        function_numbers, at = np.unique(hierarchic.numbers[chunk], return_inverse=True)
        signs = hierarchic.signs[chunk].ravel()
        gather_matrix = sparse.csr_array((signs, (at.ravel(), np.arange(len(signs)))))
        forces[function_numbers] += gather_matrix @ force.reshape(len(signs), -1)
        stiffness[function_numbers] += abs(gather_matrix) @ chunk_stiffness.reshape(len(signs), -1)
        if _is_reduced(basis.mesh):
            full_energies += part.strain_energy(material, shapes)
    is_free = stiffness[:, 0] > 0
    loads = forces[is_free].reshape(-1, 3, modes)
    displacements = np.linalg.solve(stiffness[is_free].reshape(-1, 3, 3), loads)
    return np.einsum("kam,kam->m", loads, displacements), full_energies


class _Part:
    """Some elements of a mesh at quadrature points."""

    def __init__(self, basis: Displacements, hierarchic: Hierarchic, chunk: slice) -> None:
        rule = basis.mass_rule
        jacobians = basis.mesh.jacobians(rule.points, chunk)
        self.weights = np.linalg.det(jacobians) * rule.weights
        inverse_jacobians = np.asarray(np.linalg.inv(jacobians), np.float64)
        self._slopes = basis.slopes(rule.points, inverse_jacobians, chunk)
        self._finer_slopes = hierarchic.gradients(rule.points) @ inverse_jacobians
        self._products = hierarchic.values(rule.points), basis.values(rule.points, chunk)
        self._seen_slopes = (
            _interpolate_slopes(basis.mesh, chunk) if _is_reduced(basis.mesh) else self._slopes
        )

    def forces(self, material: Material, values: Array, shapes: Array) -> Array:
        """Return the residual forces of modes (E, 3n, M) on the finer functions (E, m, 3, M)."""
        cross_stiffness = _stiffness(
            self._integrals(self._finer_slopes, self._seen_slopes), material
        )
        count, functions, _, nodes, _ = cross_stiffness.shape
        elastic_forces = cross_stiffness.reshape(count, 3 * functions, 3 * nodes) @ shapes
        finer_values, basis_values = self._products
        weighted = self.weights[:, :, None] * finer_values
        inertia = material.density * (weighted.transpose(0, 2, 1) @ basis_values)
        inertia_forces = inertia @ shapes.reshape(count, nodes, -1)
        return (elastic_forces.reshape(count, functions, 3, -1)) - inertia_forces.reshape(
            count, functions, 3, -1
        ) * values

    def stiffness(self, material: Material) -> Array:
        """Return the stiffness of each finer basis function in each element (E, m, 3, 3)."""
        slopes = self._finer_slopes
        products = np.einsum("eqma,eqmb,eq->emab", slopes, slopes, self.weights, optimize=True)
        return _stiffness(products[:, :, :, None], material)[:, :, :, 0]

    def strain_energy(self, material: Material, shapes: Array) -> Array:
        """Return twice the elastic energy of modes (E, 3n, M) at all points (M,)."""
        blocks = _stiffness(self._integrals(self._slopes, self._slopes), material)
        stiffness = blocks.reshape(len(shapes), shapes.shape[1], -1)
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


def _interpolate_slopes(mesh: VolumeMesh, chunk: slice) -> Array:
    """Return slopes as the 2 x 2 x 2 points of hexahedra see them, at all points (E, q, n, 3)."""
    linear: Element = ELEMENTS["hex8"]
    gauss_points = 0.5 + (linear.corners - 0.5) / np.sqrt(3)
    interpolation = linear.values(mesh.element.mass_rule.points) @ np.linalg.inv(
        linear.values(gauss_points)
    )
    slopes = mesh.element.gradients(gauss_points) @ np.linalg.inv(
        mesh.jacobians(gauss_points, chunk)
    )
    return np.einsum("qp,epnd->eqnd", interpolation, slopes, optimize=True)


# Two meshes: their frequencies move apart while the residual errors shrink. Movement over shrinkage
# scales the errors that are left, even where both meshes share a defect, as walls of one layer do.
# The figures were set on spheres, cubes, tubes and plates whose frequencies are known.

# Bound over residual error: of one mesh, and scaled by two.
SINGLE_MESH_FACTOR, _SCALED_FACTOR = 4.0, 2.3
_POWER = 3.0  # of the edges, with which errors fall; 4 is the most that quadratic elements reach
_TYPICAL_FACTOR = 2.5  # how many times larger the errors are for which a count of nodes is chosen
MIN_WIDTH_RATIO = 1.016
"""Least ratio of the widths of elements of two meshes that are compared."""
_MIN_GAIN = 0.05  # least share of its residual error that the finer mesh counts as having removed
_MODE_QUANTILE = 0.9
_CAUTION_FACTOR = 4.0  # stated over true errors, unless the stated ones are far too large
_NARROWING_RANGE = 4.0, 8.0  # times the error, by whose fourth root elements are made narrower
_OF_VOLUME = 1.5  # relative error of frequencies over that of the volume, where edges are cut off
# The same over the mass that is cut off, but at most this much more, as neighbouring elements are
# affected too.
_OF_CUT, _MORE_OF_CUT = 3.0, 0.01
_PLACES = 5_000  # all over a surface, where it is compared with that of the elements
_BENT = 0.05  # distance from a flat triangle over its size that is still that of a bent one
_OF_LAYER = 2.0  # the same of thin walls: a tube with lattice cells as wide as its radius
# Smallest error stated. If the error of a mode is below 0.07 of the median around it (four modes on
# each side), two meshes agree on it by chance, and it gets 0.6 of that median.
_MIN_ERROR, _NEIGHBOUR_COUNT, _OUTLIER_RATIO, _OUTLIER_FRACTION = 1e-4, 4, 0.07, 0.6


def stated_errors(modes: Modes, coarse: Modes | None, width_ratio: float) -> Array:
    """Return the relative error of each frequency (M,) by the estimates of one or two meshes."""
    # `modes` and `coarse` (elements `width_ratio` times as wide, a wider band) come with residual
    # errors of one mesh.
    if coarse is None or width_ratio < MIN_WIDTH_RATIO:
        return np.maximum(modes.errors, _MIN_ERROR)
    common_count = min(len(modes.frequencies), len(coarse.frequencies))
    ratio = coarse.frequencies[:common_count] / modes.frequencies[:common_count]
    coarse_errors, fine_errors = coarse.errors[:common_count], modes.errors[:common_count]
    # Errors are those of energy, relative to the eigenvalue of the same mesh.
    movements = np.abs(1 - ratio**-2) / 2
    scale = movements / np.maximum(coarse_errors - fine_errors, _MIN_GAIN * coarse_errors)
    # Where modes cross from mesh to mesh one's own scale means little: that of most holds too.
    scaled_errors = _SCALED_FACTOR * np.maximum(scale, np.median(scale)) * fine_errors
    extrapolated_errors = np.abs(ratio - 1) / (width_ratio**_POWER - 1)
    # Modes that the coarse mesh has beyond its band are scaled as most others.
    errors = (
        np.maximum(1.0, _SCALED_FACTOR * np.median(scale)) * modes.errors
        if common_count
        else modes.errors
    )
    errors[:common_count] = np.minimum(scaled_errors, np.maximum(fine_errors, extrapolated_errors))
    return _average_pairs(modes.frequencies, _raise_outliers(errors))


def _raise_outliers(errors: Array) -> Array:
    windows = [
        errors[max(i - _NEIGHBOUR_COUNT, 0) : i + _NEIGHBOUR_COUNT + 1] for i in range(len(errors))
    ]
    local_medians = np.array([np.median(span) for span in windows])
    return np.maximum(
        np.where(
            errors < _OUTLIER_RATIO * local_medians, _OUTLIER_FRACTION * local_medians, errors
        ),
        _MIN_ERROR,
    )


def _average_pairs(frequencies: Array, errors: Array) -> Array:
    """Give two modes that lie within their errors of each other the mean of both."""
    # A symmetric body has such pairs. Meshes split them by chance, so that one of the two looks
    # more exact than it is and the other less.
    if len(errors) < 2:
        return errors
    gaps = np.diff(frequencies) / frequencies[1:]
    neighbour_gaps = np.pad(gaps, 1, constant_values=np.inf)
    is_closest = (gaps < neighbour_gaps[:-2]) & (gaps <= neighbour_gaps[2:])
    first = np.flatnonzero(is_closest & (gaps <= np.maximum(errors[:-1], errors[1:])))
    averaged_errors = errors.copy()
    averaged_errors[first] = averaged_errors[first + 1] = (errors[first] + errors[first + 1]) / 2
    return averaged_errors


def quantile_error(modes: Modes) -> float:
    """Return the error that nine in ten modes keep."""
    return float(np.quantile(modes.errors, _MODE_QUANTILE)) if len(modes.errors) else 0.0


def nodes_needed(coarse: Modes, nodes: int, target: float) -> int:
    """Return how many nodes bring most modes' errors below `target`, from a coarser mesh's."""
    error = quantile_error(coarse) * (_TYPICAL_FACTOR / SINGLE_MESH_FACTOR)
    return int(nodes * max(error / target, 1e-9) ** 0.75)


def times_too_wide(stated_error: float, target: float) -> float:
    """Return how many times too wide elements are if errors stated are far above `target`, or 1."""
    error_ratio = stated_error / (_CAUTION_FACTOR * target)
    return float(np.clip(error_ratio, *_NARROWING_RANGE)) ** 0.25 if error_ratio > 1 else 1.0


def add_shape_errors(
    errors: Array, volume_error: float, cut: Array | float = 0.0, *, layer: bool = False
) -> Array:
    """Return errors (M,) increased by errors of the geometry, of volume and of `cut` elements."""
    # In a `layer`, what its two faces miss partly cancels in the volume.
    volume_part = (_OF_LAYER if layer else _OF_VOLUME) * abs(volume_error)
    cut_part = np.minimum(_OF_CUT * np.asarray(cut), cut + _MORE_OF_CUT)
    return np.hypot(errors, np.maximum(volume_part, cut_part))


def cut_off(outline: Mesh, modes: Modes) -> Array:
    """Return how much the mass beyond the elements would lower each frequency (M,), or more.

    A needle's point is next to nothing of the volume, but moves farther than all the rest. By
    Rayleigh's quotient a mass m lowers a frequency by its share m |shape|^2 / 2.
    """
    surface = modes.surface
    points, areas = outline.spread(_PLACES)
    faces, weights = Surface(surface).barycentric(points)
    gaps = points - np.einsum("sc,scd->sd", weights, surface.points[surface.faces[faces]])
    # Less is the arc over a chord of elements that are bent.
    is_far = np.linalg.norm(gaps, axis=1) > _BENT * np.sqrt(surface.areas[faces])
    volumes = np.maximum(np.einsum("sd,sd->s", gaps, areas), 0) * is_far
    masses = modes.mass / surface.volume * volumes[:, None] * weights
    vertex_masses = np.bincount(surface.faces[faces].ravel(), masses.ravel(), len(surface.points))
    moving = np.flatnonzero(vertex_masses)
    return vertex_masses[moving] @ np.square(modes.shapes[moving]).sum(axis=1) / 2

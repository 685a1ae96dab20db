"""Sound power of a vibrating skin by the on-surface radiation condition.

Surface harmonics are to any surface what spherical harmonics are to a sphere: the air answers each
as it answers the sphere of the same area (Antoine, Barucq & Bendali 1999). Velocity and pressure on
the skin, bundled to point sources, give the power that leaves to all sides.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy import sparse
from scipy.linalg import eigh
from scipy.sparse.linalg import eigsh
from scipy.special import hankel1

from struck.errors import MeshError
from struck.model.arrays import Array, Complex, Index
from struck.model.mesh import Mesh
from struck.model.mesh_topology import pieces, submesh


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Skin:
    """Part of a surface that meets free air: without the walls of closed cavities."""

    mesh: Mesh  # F faces, none without area, and the vertices that they use
    faces: NDArray[np.int64]  # (F,), the number of each face in the whole surface

    @classmethod
    def of(cls, surface: Mesh, centre: Array) -> Skin:
        """Return the skin of a surface; MeshError where no piece encloses a positive volume."""
        cones = np.einsum("fd,fd->f", surface.centroids - centre, surface.area_vectors)
        labels = pieces(surface)
        is_exposed = np.bincount(labels, weights=cones)[labels] > 0
        faces = np.flatnonzero(is_exposed & (surface.areas > 0))
        if not len(faces):
            raise MeshError(
                f"the {labels.max() + 1} pieces of the surface enclose no volume: flip "
                "the normals so that they point out of the material"
            )
        return cls(mesh=submesh(surface, faces), faces=faces)

    @property
    def radius(self) -> float:
        """Radius of the sphere of the same area, m."""
        return float(np.sqrt(self.mesh.areas.sum() / (4 * np.pi)))


def normal_velocities(surface: Mesh, shapes: NDArray[np.floating]) -> Array:
    """Return normal components (F, M) at the faces of vertex motions `shapes` (V, 3, M)."""
    faces = surface.faces
    columns = (3 * faces[:, :, None] + np.arange(3)).ravel()
    weights = np.repeat(surface.face_normals[:, None] / 3, 3, axis=1).ravel()
    indptr, count = np.arange(0, len(columns) + 1, 9), 3 * len(surface.points)
    projection = sparse.csr_array((weights, columns, indptr), shape=(len(faces), count))
    return np.asarray(projection @ shapes.reshape(count, shapes.shape[2]))


COUNT = 64  # maximum number of harmonics, on a sphere those of the orders 0 to 7
# Fraction of an eigenvalue by which the last harmonic lies below the first that is left out. Round
# and square bodies have pairs of equal ones; if a pair were cut, rounding would decide which stays.
_MIN_GAP = 1e-3
# Least fraction of the remainder in its averages at the vertices; less is of the rounding of
# shapes to 32 bits, squared 4e-15 of them, to 0.2 %. Torsion of a turned body, whose faces tilt
# to both sides in turn, has 1e-13.
_ALTERNATING = 1e-9

# Number of vertices up to which a full decomposition costs less than an iteration.
_SMALL = 400
_SEED = 1  # of the vector that the iteration starts from


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Split:
    """Normal velocities, split into surface harmonics and a remainder."""

    # (H, M), coefficients of the harmonics, m^2/s; their squares are fractions of the whole
    parts: Array
    remainder: Array  # (V, M), what remains at the vertices, m/s
    remainder_orders: Array  # (M,), the order ascribed to all of the remainder
    remainder_powers: Array  # (M,), its part of the integral of the square, m^4/s^2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceHarmonics:
    """Smoothest eigenfunctions of the surface Laplacian.

    On a sphere of radius a, they are the spherical harmonics, and the eigenvalue is n (n + 1) /
    a^2. Elsewhere the same formula with the radius of the sphere of the same area gives each its
    order, a real number.
    """

    mesh: Mesh  # V vertices, all of them used, and F faces, none without area
    stiffness: sparse.csc_array  # (V, V), integrals of products of gradients
    masses: Array  # (V,), area that belongs to each vertex, m^2
    functions: Array  # (V, H), 1/m, orthonormal: their squares integrate to 1
    orders: Array  # (H,), from 0 on
    radius: float  # of the sphere of the same area, m

    @classmethod
    def of(cls, mesh: Mesh, radius: float) -> SurfaceHarmonics:
        """Find the harmonics of a surface."""
        stiffness, masses = laplacian(mesh)
        eigenvalues, functions = _compute_harmonics(stiffness, masses, radius)
        return cls(
            mesh=mesh,
            stiffness=stiffness,
            masses=masses,
            functions=functions,
            orders=_orders(eigenvalues, radius),
            radius=radius,
        )

    def split(self, velocities: Array) -> Split:
        """Split normal velocities of the faces (F, M) into harmonics and a remainder.

        The order of the remainder is that of its mean squared gradient over its mean square
        (Rayleigh's quotient), for which it is averaged at the vertices and linear in between. Where
        next to nothing remains of it there, it alternates from face to face, and has the order of
        these.
        """
        flows = _integrate_at_corners(self.mesh) @ velocities
        parts = self.functions.T @ flows
        remainder = flows / self.masses[:, None] - self.functions @ parts
        steepness = np.einsum("vm,vm->m", remainder, self.stiffness @ remainder)
        smooth_squares = np.maximum(self.masses @ np.square(remainder), np.finfo(float).tiny)
        totals = self.mesh.areas @ np.square(velocities)
        powers = np.maximum(totals - np.square(parts).sum(axis=0), 0.0)
        max_slope = np.mean(self.stiffness.diagonal() / self.masses)
        slopes = np.where(
            smooth_squares < _ALTERNATING * powers, max_slope, steepness / smooth_squares
        )
        return Split(
            parts=parts,
            remainder=remainder,
            remainder_orders=np.maximum(_orders(slopes, self.radius), self.orders.max()),
            remainder_powers=powers,
        )


def laplacian(mesh: Mesh) -> tuple[sparse.csc_array, Array]:
    """Return stiffness (V, V) and lumped mass (V,), m^2, of the surface Laplacian.

    Linear finite elements on the faces (the cotangent Laplacian; Pinkall & Polthier 1993).
    """
    corners = mesh.points[mesh.faces]
    opposite_edges = np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)
    products = (
        np.einsum("fid,fjd->fij", opposite_edges, opposite_edges) / (4 * mesh.areas)[:, None, None]
    )
    rows, columns = np.repeat(mesh.faces, 3, axis=1), np.tile(mesh.faces, (1, 3))
    shape = (len(mesh.points), len(mesh.points))
    stiffness = sparse.coo_array((products.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
    return stiffness.tocsc(), _integrate_at_corners(mesh) @ np.ones(len(mesh.faces))


def _integrate_at_corners(mesh: Mesh) -> sparse.csc_array:
    """Return the matrix (V, F) that gives each corner of a face a third of its integral."""
    indptr = np.arange(0, mesh.faces.size + 1, 3)
    shape = (len(mesh.points), len(mesh.faces))
    return sparse.csc_array((np.repeat(mesh.areas / 3, 3), mesh.faces.ravel(), indptr), shape)


def _orders(eigenvalues: Array, radius: float) -> Array:
    """Return the real order nu with nu (nu + 1) = radius^2 eigenvalue."""
    return np.sqrt(radius**2 * np.maximum(eigenvalues, 0.0) + 0.25) - 0.5


def _compute_harmonics(
    stiffness: sparse.csc_array, masses: Array, radius: float
) -> tuple[Array, Array]:
    """Return the lowest eigenvalues (H,) and the functions (V, H), no group of equal ones cut."""
    roots = sparse.diags_array(1 / np.sqrt(masses))
    standard = (roots @ stiffness @ roots).tocsc()
    if len(masses) <= _SMALL:
        eigenvalues, functions = eigh(
            standard.toarray(), subset_by_index=(0, min(COUNT, len(masses) - 1))
        )
    else:
        eigenvalues, functions = eigsh(
            standard,
            k=COUNT + 1,
            sigma=-1 / radius**2,  # below all of them, where the matrix is regular
            v0=np.random.default_rng(_SEED).normal(size=len(masses)),
        )
    gaps = np.flatnonzero(np.diff(eigenvalues) > _MIN_GAP * eigenvalues[1:]) + 1
    count = gaps[-1] if len(eigenvalues) > COUNT else len(eigenvalues)
    return eigenvalues[:count], functions[:, :count] / np.sqrt(masses)[:, None]


_EQUAL = 1e-6  # of a group's weight: halves that differ by less are equal
_BUNDLES = 512  # bundles of faces, which limit the wave number that they resolve
_DIRECTIONS = 128  # pairs of opposite ones


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PointSources:
    """Bundles of neighbouring faces, each a source and a dipole at one point."""

    positions: Array  # (K, 3), centres of area, m
    # (K, F) matrix from normal velocities of the faces to volume flows of the bundles, m^2
    flows: sparse.csr_array
    # (3 K, F), to the first moments of these flows about the centres, m^3
    moments: sparse.csr_array
    # (3 K, V), from pressures at the vertices to forces on the bundles, m^2
    forces: sparse.csr_array

    @classmethod
    def of(cls, mesh: Mesh) -> PointSources:
        """Bundle the faces of a mesh."""
        labels = bundles(mesh.centroids, mesh.areas, _BUNDLES)
        flows = _gathering(labels, mesh.areas[:, None])
        positions = np.asarray(flows @ mesh.centroids) / flows.sum(axis=1)[:, None]
        arms = mesh.centroids - positions[labels]
        indptr = np.arange(0, mesh.faces.size + 1, 3)
        thirds = np.full(mesh.faces.size, 1 / 3)
        shape = (len(mesh.faces), len(mesh.points))
        means = sparse.csr_array((thirds, mesh.faces.ravel(), indptr), shape)
        return cls(
            positions=positions,
            flows=flows,
            moments=_gathering(labels, mesh.areas[:, None] * arms),
            forces=_gathering(labels, mesh.area_vectors) @ means,
        )

    def mean_squares(self, wave_numbers: Array, flows: Array, dipoles: Complex) -> Array:
        """Return the mean square pressure of each mode's sources over all directions (M,).

        That is the sum of (flow + direction . dipole) exp(-i k direction . position) with the wave
        numbers k (M,), 1/m, flows (K, M) and dipoles (K, 3, M) in one unit.
        """
        directions = _half_of_all_directions(_DIRECTIONS)
        paths = directions @ self.positions.T
        strengths = np.concatenate([flows[:, None], dipoles.real, dipoles.imag], axis=1)
        squares = np.empty(len(wave_numbers))
        # Modes of one wave number share their phases.
        for wave_number in np.unique(wave_numbers):
            is_shared = wave_numbers == wave_number
            # NumPy's tangent takes a tenth of the time of its sine and cosine, or half at least.
            tangents = np.tan(wave_number / 2 * paths)
            denominators = 1 + np.square(tangents)
            sources = strengths[:, :, is_shared].reshape(len(strengths), -1)
            cosines, sines = (
                (2 / denominators - 1) @ sources,
                (2 * tangents / denominators) @ sources,
            )
            waves = (cosines - 1j * sines).reshape(len(directions), 7, -1)
            real = np.einsum("ndm,nd->nm", waves[:, 1:4], directions)
            imaginary = np.einsum("ndm,nd->nm", waves[:, 4:], directions)
            # In the opposite direction, phases and dipoles change their signs, so the products of
            # flows and real dipoles cancel between the two.
            squared_sums = np.square(np.abs(waves[:, 0] + 1j * imaginary)) + np.square(np.abs(real))
            squares[is_shared] = squared_sums.mean(axis=0)
        return squares


def bundles(points: Array, weights: Array, count: int) -> Index:
    """Return the group of each point: at most `count` (a power of two) groups of equal weight.

    Groups are halved across their longest extent, independent of the orientation of the points.
    """
    # Rounded, so that neither the body's size nor its place decides between equals.
    arms = points - points.mean(axis=0)
    places = np.round(arms / np.abs(arms).max(), 6)
    fractions = (weights / weights.sum()).astype(np.float32).astype(float)
    order, start_indices = np.arange(len(points)), np.zeros(1, np.int64)
    while len(start_indices) < count and len(start_indices) < len(points):
        order, start_indices = _halve_groups(order, start_indices, places, fractions)
    labels = np.empty(len(points), np.int64)
    labels[order] = np.repeat(np.arange(len(start_indices)), _sizes(start_indices, len(points)))
    return labels


def _sizes(start_indices: Index, count: int) -> Index:
    return np.diff(np.append(start_indices, count))


def _halve_groups(
    order: Index, start_indices: Index, points: Array, weights: Array
) -> tuple[Index, Index]:
    """Return points in their new order, and where in it each group starts, twice as many."""
    sizes, point_weights = _sizes(start_indices, len(order)), weights[order][:, None]
    totals = np.add.reduceat(point_weights, start_indices)
    means = np.add.reduceat(point_weights * points[order], start_indices) / totals
    arms = points[order] - np.repeat(means, sizes, axis=0)
    products = (point_weights * arms)[:, :, None] * arms[:, None]
    axes = np.linalg.eigh(np.add.reduceat(products, start_indices))[1][:, :, -1]
    projections = np.einsum("nd,nd->n", arms, np.repeat(axes, sizes, axis=0))
    order = order[np.lexsort((projections, np.repeat(np.arange(len(start_indices)), sizes)))]
    cumulative_weights = np.cumsum(weights[order])
    ends = (
        cumulative_weights[start_indices]
        - weights[order][start_indices]
        + (0.5 - _EQUAL) * totals[:, 0]
    )
    light = np.add.reduceat(
        cumulative_weights < np.repeat(ends, sizes), start_indices, dtype=np.int64
    )
    split_indices = start_indices + np.clip(light, 1, sizes - 1)
    return order, np.sort(np.append(start_indices, split_indices[sizes > 1]))


def _gathering(labels: Index, weights: Array) -> sparse.csr_array:
    """Return the matrix (D K, F) that sums by label with D `weights` (F, D) a face."""
    count, dimensions = weights.shape
    rows = dimensions * labels[:, None] + np.arange(dimensions)
    columns = np.repeat(np.arange(count), dimensions)
    shape = (dimensions * (labels.max() + 1), count)
    return sparse.coo_array((weights.ravel(), (rows.ravel(), columns)), shape=shape).tocsr()


def _half_of_all_directions(count: int) -> Array:
    """Return unit vectors (count, 3), spread evenly over the upper hemisphere (a golden spiral)."""
    steps = np.arange(count) + 0.5
    height, azimuth = steps / count, np.pi * (1 + np.sqrt(5)) * steps
    radius = np.sqrt(1 - height**2)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), height], axis=1)


# Size ka from which the power is computed by both methods. Below it, little of the pressure on the
# skin does work, and the work is a small difference of estimates.
_WIDE_AS_A_WAVE = np.pi
# Size ka that the bundles still resolve. A motion that radiates there radiates above, too.
_MAX_SIZE = 10.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Radiator:
    """Vibrating skin in air, prepared for the power of many modes."""

    radius: float  # of the sphere of the same area, m
    harmonics: SurfaceHarmonics  # H of them
    sources: PointSources  # the faces, in K bundles
    forces: Array  # (K, 3, H), integrals of the harmonics times the normal over each bundle, m

    @classmethod
    def of(cls, mesh: Mesh, radius: float) -> Radiator:
        """Prepare the skin `mesh`, of the area of a sphere of `radius`."""
        harmonics, sources = SurfaceHarmonics.of(mesh, radius), PointSources.of(mesh)
        return cls(
            radius=radius,
            harmonics=harmonics,
            sources=sources,
            forces=_split_by_bundle(sources.forces @ harmonics.functions),
        )

    def mean_squares(self, velocities: Array, wave_numbers: Array) -> Array:
        """Return mean squares over directions (M,) of the pressure at 1 m, in (rho c)^2 m^2/s^2."""
        components, sizes = self.harmonics.split(velocities), wave_numbers * self.radius
        squares = self._far_away(velocities, components, np.minimum(sizes, _MAX_SIZE))
        is_wide = sizes >= _WIDE_AS_A_WAVE
        if is_wide.any():
            wide_components = Split(
                **{f.name: getattr(components, f.name)[..., is_wide] for f in fields(components)}
            )
            squares[is_wide] = np.maximum(
                self._through_skin(wide_components, sizes[is_wide]), squares[is_wide]
            )
        return squares

    def _through_skin(self, components: Split, sizes: Array) -> Array:
        """Return mean squares from the work that the pressure does on the skin."""
        efficiencies = sphere_efficiency(self.harmonics.orders[:, None], sizes)
        remainder = (
            sphere_efficiency(components.remainder_orders, sizes) * components.remainder_powers
        )
        return (np.sum(efficiencies * np.square(components.parts), axis=0) + remainder) / (
            4 * np.pi
        )

    def _far_away(self, velocities: Array, components: Split, sizes: Array) -> Array:
        """Return mean squares from the waves that velocity and pressure on the skin send out."""
        wave_numbers = sizes / self.radius
        flows = self.sources.flows @ velocities
        moments = _split_by_bundle(self.sources.moments @ velocities)
        dipoles = self._forces(components, sizes) - 1j * wave_numbers * moments
        squares = self.sources.mean_squares(wave_numbers, flows, dipoles)
        return np.square(wave_numbers / (4 * np.pi)) * squares

    def _forces(self, components: Split, sizes: Array) -> NDArray[np.complex128]:
        """Return the forces of the air on the bundles (K, 3, M) in units of rho c, m^3/s."""
        distinct_sizes, numbers = np.unique(sizes, return_inverse=True)
        impedances = sphere_impedance(self.harmonics.orders[:, None], distinct_sizes)[:, numbers]
        harmonics = impedances * components.parts
        remainder = _split_by_bundle(self.sources.forces @ components.remainder)
        return (
            self.forces @ harmonics
            + sphere_impedance(components.remainder_orders, sizes) * remainder
        )


def _split_by_bundle(values: Array) -> Array:
    """Return rows (3 K, ...) as (K, 3, ...)."""
    return values.reshape(-1, 3, values.shape[1])


def sphere_impedance(order: ArrayLike, ka: ArrayLike) -> Complex:
    """Return pressure over normal velocity on a sphere, in rho c (Williams 1999, chapter 6).

    For a velocity that is one spherical harmonic of real order n >= 0, it is i h_n(x) / h_n'(x) at
    x = ka, with the spherical Hankel function of the first kind: time goes as exp(-i omega t). The
    real part is the radiation efficiency, by the Wronskian of h_n and its conjugate; the imaginary
    part is negative: mass.
    """
    x = np.asarray(ka, float)
    value, slope = _hankel_and_slope(order, x)
    mass = -x / (np.asarray(order, float) + 1)  # for small ka
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        reactance = (value / slope).real
    # Beyond the largest number, too.
    return _efficiency(slope, x) + 1j * np.where(np.isfinite(reactance), reactance, mass)


def sphere_efficiency(order: ArrayLike, ka: ArrayLike) -> Array:
    """Return the radiation efficiency of a spherical order n >= 0 (Williams 1999, chapter 6).

    A sphere whose normal velocity is a harmonic of one order n radiates sigma rho c S <v^2>, with
    <v^2> the mean square over surface and time, and sigma = 1 / |x h_n'(x)|^2 at x = ka.
    """
    x = np.asarray(ka, float)
    return _efficiency(_hankel_and_slope(order, x)[1], x)


def _efficiency(slope: Complex, ka: Array) -> Array:
    """Return 1 / |x h'(x)|^2 of slopes h' at x = ka."""
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        efficiency = 1 / np.square(ka * np.abs(slope))
    return np.where(np.isfinite(efficiency), efficiency, 0.0)  # |h'| beyond the largest number


def _hankel_and_slope(order: ArrayLike, ka: ArrayLike) -> tuple[Complex, Complex]:
    degree, x = np.asarray(order, float), np.asarray(ka, float)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        value = _hankel(degree, x)
        return value, _hankel(degree - 1, x) - (degree + 1) / x * value


def _hankel(order: Array, x: Array) -> Complex:
    """Return the spherical Hankel function of the first kind of a real order."""
    return np.asarray(np.sqrt(np.pi / (2 * x)) * hankel1(order + 0.5, x), np.complex128)

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
from scipy.sparse.linalg import LinearOperator, eigsh, splu
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


def face_velocities(surface: Mesh, shapes: NDArray[np.floating]) -> Array:
    """Return velocities (F, 3, M) of the faces, means of vertex motions `shapes` (V, 3, M)."""
    flat = shapes.reshape(len(surface.points), -1)
    return np.asarray(face_means(surface) @ flat).reshape(len(surface.faces), 3, -1)


def face_means(mesh: Mesh) -> sparse.csr_array:
    """Return the matrix (F, V) to the means over the faces from values at the vertices."""
    return weigh_corners(mesh, np.full(mesh.faces.shape, 1 / 3))


def weigh_corners(mesh: Mesh, weights: Array) -> sparse.csr_array:
    """Return the matrix (F, V) of the sums over the corners of the faces with weights (F, 3)."""
    indptr, shape = np.arange(0, mesh.faces.size + 1, 3), (len(mesh.faces), len(mesh.points))
    return sparse.csr_array((weights.ravel(), mesh.faces.ravel(), indptr), shape=shape)


def opposite_edges(mesh: Mesh) -> Array:
    """Return the edge opposite to each corner of each face (F, 3, 3), m."""
    corners = mesh.points[mesh.faces]
    return np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)


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
# Iterations, each of which gives an order to the remainder, and how many of their functions make
# its pressure. With 32 and 32, powers change by less than 0.3 dB on the bodies of the proof.
_ITERATIONS, _BASIS = 16, 6
# Largest order of the surface's cells, of a body as of its finest ordinary cells (times their
# eigenvalue): smaller cells, as across the edge of a sheet, are made heavier. Chosen by judgement.
_FINEST_ORDER, _FINEST_CELL = 40.0, 2.0

# Number of vertices up to which a full decomposition costs less than an iteration.
_SMALL = 400
_SEED = 1  # of the vector that the iteration starts from
_VECTORS = 110  # that it keeps: with twice COUNT, as by default, it takes a third longer


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Split:
    """Normal velocities, split into surface harmonics and a remainder of N orders.

    A function of the Laplacian is applied to the remainder by its values at the orders: the basis
    functions times (weights times values, summed over the orders).
    """

    # (H, M), coefficients of the harmonics, m^2/s; their squares are fractions of the whole
    parts: Array
    orders: Array  # (N, M), orders of the remainder
    powers: Array  # (N, M), its part of the integral of the square at each order, m^4/s^2
    basis: Array  # (B, V, M), functions at the vertices that span the remainder, 1/m
    weights: Array  # (B, N, M), m^2/s
    totals: Array  # (M,), integrals of the squares of the velocities of the faces, m^4/s^2

    def chosen(self, modes: Index) -> Split:
        """Return the parts of some modes (K,)."""
        values = {item.name: getattr(self, item.name)[..., modes] for item in fields(self)}
        return Split(**values)


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
    # (V,), m: roots of the masses by which remainders are iterated, see `_bounded_masses`
    roots: Array
    operator: sparse.csr_array  # (V, V), 1/m^2, the Laplacian in functions times these roots
    radius: float  # of the sphere of the same area, m

    @classmethod
    def of(cls, mesh: Mesh, radius: float) -> SurfaceHarmonics:
        """Find the harmonics of a surface."""
        stiffness, masses = laplacian(mesh)
        eigenvalues, functions = _compute_harmonics(stiffness, masses, radius)
        roots = np.sqrt(_bounded_masses(stiffness, masses, radius))
        scales = sparse.diags_array(1 / roots)
        return cls(
            mesh=mesh,
            stiffness=stiffness,
            masses=masses,
            functions=functions,
            orders=_orders(eigenvalues, radius),
            roots=roots,
            operator=(scales @ stiffness @ scales).tocsr(),
            radius=radius,
        )

    def split(self, velocities: Array) -> Split:
        """Split normal velocities of the faces (F, M) into harmonics and a remainder."""
        flows = _integrate_at_corners(self.mesh) @ velocities
        parts = self.functions.T @ flows
        remainder = flows / self.masses[:, None] - self.functions @ parts
        eigenvalues, weights, basis = _lanczos(self.operator, self.roots[:, None] * remainder)
        fractions = weights[0] / np.maximum(weights[0].sum(axis=0), np.finfo(float).tiny)
        return Split(
            parts=parts,
            orders=_orders(eigenvalues, self.radius),
            powers=fractions * (self.masses @ np.square(remainder)),
            basis=basis / self.roots[:, None],
            weights=weights,
            totals=self.mesh.areas @ np.square(velocities),
        )


def laplacian(mesh: Mesh) -> tuple[sparse.csc_array, Array]:
    """Return stiffness (V, V) and lumped mass (V,), m^2, of the surface Laplacian.

    Linear finite elements on the faces (the cotangent Laplacian; Pinkall & Polthier 1993).
    """
    edges = opposite_edges(mesh)
    products = np.einsum("fid,fjd->fij", edges, edges) / (4 * mesh.areas)[:, None, None]
    rows, columns = np.repeat(mesh.faces, 3, axis=1), np.tile(mesh.faces, (1, 3))
    shape = (len(mesh.points), len(mesh.points))
    stiffness = sparse.coo_array((products.ravel(), (rows.ravel(), columns.ravel())), shape=shape)
    return stiffness.tocsc(), _integrate_at_corners(mesh) @ np.ones(len(mesh.faces))


def _integrate_at_corners(mesh: Mesh) -> sparse.csc_array:
    """Return the matrix (V, F) that gives each corner of a face a third of its integral."""
    indptr = np.arange(0, mesh.faces.size + 1, 3)
    shape = (len(mesh.points), len(mesh.faces))
    return sparse.csc_array((np.repeat(mesh.areas / 3, 3), mesh.faces.ravel(), indptr), shape)


def _bounded_masses(stiffness: sparse.csc_array, masses: Array, radius: float) -> Array:
    """Return masses (V,), m^2, increased where cells are so small that they slow the iteration.

    As mass scaling of explicit finite elements: it changes orders near the bound and above.
    """
    max_stiffness = 2 * stiffness.diagonal()  # twice it bounds the eigenvalues (Gershgorin)
    max_eigenvalue = max(
        _FINEST_ORDER**2 / radius**2, _FINEST_CELL * np.median(max_stiffness / masses)
    )
    return np.maximum(masses, max_stiffness / max_eigenvalue)


def _lanczos(operator: sparse.csr_array, start: Array) -> tuple[Array, Array, Array]:
    """Return eigenvalues (N, M), weights (B, N, M) and basis (B, V, M) of start vectors (V, M).

    The Lanczos iteration for the symmetric operator, separately for each vector. The tridiagonal
    matrix gives the Gauss quadrature of the vector's spectrum: weights[0] are in proportion to the
    fractions of its square at the eigenvalues (Golub & Meurant 1994).
    """
    norms = np.linalg.norm(start, axis=0)
    current, previous_vectors = start / np.where(norms > 0, norms, 1.0), np.zeros_like(start)
    coupling = np.zeros(start.shape[1])
    matrices = np.zeros((start.shape[1], _ITERATIONS, _ITERATIONS))
    basis = np.empty((_BASIS, *start.shape))
    for step in range(_ITERATIONS):
        if step < _BASIS:
            basis[step] = current
        following = operator @ current - coupling * previous_vectors
        diagonal = np.einsum("vm,vm->m", following, current)
        following -= diagonal * current
        matrices[:, step, step] = diagonal
        coupling = np.sqrt(np.einsum("vm,vm->m", following, following))
        # Where all of a vector's spectrum is found, nothing follows but rounding.
        coupling[coupling <= _ROUNDING * np.abs(diagonal)] = 0.0
        if step + 1 < _ITERATIONS:
            matrices[:, step, step + 1] = matrices[:, step + 1, step] = coupling
        previous_vectors, current = current, following / np.where(coupling > 0, coupling, np.inf)
    eigenvalues, vectors = np.linalg.eigh(matrices)
    weights = vectors[:, :_BASIS] * (vectors[:, :1] * norms[:, None, None])
    return eigenvalues.T, np.moveaxis(weights, 0, -1), basis


_ROUNDING = 1e-9  # relative to the operator, of a function that is left by rounding alone


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
        shift = -1 / radius**2  # below all of them, where the matrix is positive definite
        factors = splu(
            (standard - shift * sparse.eye_array(len(masses))).tocsc(),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        eigenvalues, functions = eigsh(
            standard,
            k=COUNT + 1,
            sigma=shift,
            OPinv=LinearOperator(standard.shape, factors.solve, dtype=np.float64),
            ncv=_VECTORS,
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
        return cls(
            positions=positions,
            flows=flows,
            moments=_gathering(labels, mesh.areas[:, None] * arms),
            forces=_gathering(labels, mesh.area_vectors) @ face_means(mesh),
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


# Size ka that the bundles still resolve. A motion that radiates there radiates above, too.
_MAX_SIZE = 10.0
# Largest factor by which vertices lose power of velocities that jump at an edge; more is lost only
# where faces tilt to both sides in turn, as in torsion of a turned body, which radiates nothing.
_MAX_LOSS = 2.0
# Uncertainty of the power, dB: of a sphere, and the increase by thinness, which is 1/2 of a sheet.
# At least 19 of 20 modes in the proof differ by less from boundary elements.
_ROUND_ERROR, _THIN_ERROR = 1.0, 8.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SkinSound:
    """Sound of M modes that have unit velocity, in units of rho c."""

    mean_squares: Array  # (M,), of the far pressure referred to 1 m, over directions, m^2/s^2
    pressures: Complex  # (V, M), on the skin, m/s


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Radiator:
    """Vibrating skin in air, prepared for the power of many modes."""

    radius: float  # of the sphere of the same area, m
    harmonics: SurfaceHarmonics  # H of them
    sources: PointSources  # the faces, in K bundles
    thinness: float  # by which orders are lowered, see `_thinness`

    @classmethod
    def of(cls, mesh: Mesh, radius: float) -> Radiator:
        """Prepare the skin `mesh`, of the area of a sphere of `radius`."""
        return cls(
            radius=radius,
            harmonics=SurfaceHarmonics.of(mesh, radius),
            sources=PointSources.of(mesh),
            thinness=_thinness(mesh, radius),
        )

    def sound(self, velocities: Array, wave_numbers: Array) -> SkinSound:
        """Return the sound of modes with normal velocities (F, M) and wave numbers (M,), 1/m."""
        components, sizes = self.harmonics.split(velocities), wave_numbers * self.radius
        impedances = self._impedances(components, sizes)
        pressures = self._pressures(components, impedances)
        squares = np.concatenate([np.square(components.parts), components.powers])
        resolved_squares = np.maximum(squares.sum(axis=0), _TINY)
        efficiencies = np.sum(impedances.real * squares, axis=0) / resolved_squares
        on_skin = (
            efficiencies * np.minimum(components.totals, _MAX_LOSS * resolved_squares) / (4 * np.pi)
        )
        # Where the bundles do not resolve the waves, the far field is that of a lower frequency.
        is_resolved = sizes <= _MAX_SIZE
        far_sizes, far_pressures = np.minimum(sizes, _MAX_SIZE), pressures
        if not is_resolved.all():
            high = np.flatnonzero(~is_resolved)
            high_components = components.chosen(high)
            impedances = self._impedances(high_components, far_sizes[high])
            far_pressures = pressures.copy()
            far_pressures[:, high] = self._pressures(high_components, impedances)
        far_squares = self._far_away(velocities, far_pressures, far_sizes)
        # Above 1, near coincidence, the power on the skin of hollow bodies is too large.
        weights = np.minimum(efficiencies, 1 / np.maximum(efficiencies, 1.0))
        blends = far_squares ** (1 - weights) * on_skin**weights
        return SkinSound(
            mean_squares=np.where(is_resolved, blends, np.maximum(far_squares, on_skin)),
            pressures=pressures,
        )

    @property
    def uncertainty(self) -> float:
        """Uncertainty of the power, dB: the exact one is within it for 19 of 20 modes."""
        return _ROUND_ERROR + _THIN_ERROR * self.thinness

    def _impedances(self, components: Split, sizes: Array) -> Complex:
        """Return the impedances of all parts of the velocities (H + N, M), over rho c."""
        count = len(sizes)
        harmonic_orders = np.repeat(self.harmonics.orders[:, None], count, axis=1)
        orders = np.concatenate([harmonic_orders, components.orders])
        return sphere_impedance(np.maximum(orders - self.thinness, 0.0), sizes)

    def _pressures(self, components: Split, impedances: Complex) -> Complex:
        """Return the pressures at the vertices (V, M) in units of rho c, m/s."""
        count = len(components.parts)
        parts = impedances[:count] * components.parts
        weights = np.einsum("bnm,nm->bm", components.weights, impedances[count:])
        real, imaginary = (
            self.harmonics.functions @ of_harmonics
            + np.einsum("bvm,bm->vm", components.basis, of_remainder)
            for of_harmonics, of_remainder in (
                (parts.real, weights.real),
                (parts.imag, weights.imag),
            )
        )
        return np.asarray(real + 1j * imaginary)

    def _far_away(self, velocities: Array, pressures: Complex, sizes: Array) -> Array:
        """Return mean squares from the waves that velocity and pressure on the skin send out."""
        wave_numbers = sizes / self.radius
        flows = self.sources.flows @ velocities
        moments = _split_by_bundle(self.sources.moments @ velocities)
        forces = _split_by_bundle(self.sources.forces @ pressures.real) + 1j * _split_by_bundle(
            self.sources.forces @ pressures.imag
        )
        dipoles = forces - 1j * wave_numbers * moments
        squares = self.sources.mean_squares(wave_numbers, flows, dipoles)
        return np.square(wave_numbers / (4 * np.pi)) * squares


_TINY = float(np.finfo(float).tiny)


def _thinness(mesh: Mesh, radius: float) -> float:
    """Return by how much orders are lowered for the air's answer: 0 of a sphere, 1/2 of a sheet.

    A sphere answers the eigenvalue lambda as a mass divided by n + 1 = sqrt(lambda a^2 + 1/4) +
    1/2. The last term is of its mean curvature, which the two sides of a sheet have with opposite
    signs. Between them it is interpolated by 3 V / S a of volume and area, 1 of a sphere.
    """
    compactness = 3 * mesh.volume / (mesh.areas.sum() * radius)
    return 0.5 * (1 - min(max(compactness, 0.0), 1.0))


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
    degree, x = np.asarray(order, float), np.asarray(ka, float)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        value = _hankel(degree, x)
        slope = _hankel(degree - 1, x) - (degree + 1) / x * value
        efficiency, reactance = 1 / np.square(x * np.abs(slope)), (value / slope).real
    # Where the functions exceed the largest number, there is the mass of small ka alone.
    efficiency = np.where(np.isfinite(efficiency), efficiency, 0.0)
    return efficiency + 1j * np.where(np.isfinite(reactance), reactance, -x / (degree + 1))


def _hankel(order: Array, x: Array) -> Complex:
    """Return the spherical Hankel function of the first kind of a real order."""
    return np.asarray(np.sqrt(np.pi / (2 * x)) * hankel1(order + 0.5, x), np.complex128)

"""Boundary elements: the sound pressure that a vibrating closed surface makes in free air.

The Helmholtz integral equation by collocation at the centres of flat triangles, on each of which
pressure and normal velocity are constant. Integrals over near triangles have their static part in
closed form, so a wall may be thinner than an element. Frequencies at which the equation has
further solutions are kept out by points inside the body, where the outer field's formula gives
zero (CHIEF: Schenck 1968): equations that border the others. Derivation: docs, "Boundary elements".
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from struck.core.machine import thread_count
from struck.errors import MeshError, SolverError
from struck.model.arrays import Array, Complex, Index, Single
from struck.model.material import AIR, Air
from struck.model.mesh import Mesh

# Relative difference of frequencies up to which modes have a factorisation in common.
SAME_FREQUENCY = 1e-3
# Wall over element edge; below it, the equations of both sides are nearly linearly dependent.
MIN_WALL_RATIO = 0.1
# Fraction of the surface that may be thinner, as at the edge of a knife. With 0.05 % of it, the far
# pressure of a can changes by 0.04 to 0.4 %; by 2 % (ka 20) and 44 % (ka 5) for cos 4 theta motion,
# which radiates little. Chosen by judgement between the two.
_SHARP_FRACTION = 1e-3
# Longest edges within which the static part of an element is integrated in closed form.
_NEAR_DISTANCE = 2.5
_ROWS = 64  # places at a time, so that their memory stays small against that of the matrix
_MAX_INNER_POINTS = 24  # interior points at most
_MIN_PHASE = 1.5  # wave number times half the depth: below it nothing inside can resonate
# Fractions of the depth at which interior points lie, where no mode has its node.
_DEEP = (0.2, 0.5)
_GOLDEN = (5**0.5 - 1) / 2
_FAR_DISTANCE = 30.0  # body's extents at which the power is summed
_DIRECTIONS = 400
# Relative errors of the far pressure, measured on spheres, bowls, hoops and blocks (tests): of any
# mesh, by the square of wave number times edge, and by edge over wall where the wall is thinner.
_BASE_ERROR, _WAVE_ERROR, _WALL_ERROR = 0.02, 0.01, 0.04


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoundaryElements:
    """Triangles of constant pressure and velocity, as the core integrates over them."""

    mesh: Mesh
    corners: Array  # (F, 3, 3), m
    normals: Array  # (3, F)
    nodes: Array  # (3 nodes, 3, F), m
    sizes: Array  # (F,), longest edges, m

    @classmethod
    def of(cls, mesh: Mesh) -> BoundaryElements:
        """Return the elements of a closed surface."""
        corners = np.ascontiguousarray(mesh.points[mesh.faces])
        sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        weights = np.full((3, 3), 1 / 6) + 0.5 * np.eye(3)
        return cls(
            mesh=mesh,
            corners=corners,
            normals=np.ascontiguousarray(mesh.face_normals.T),
            nodes=np.ascontiguousarray(np.einsum("nc,fcd->ndf", weights, corners)),
            sizes=sides.max(axis=1),
        )

    def layers(
        self, places: Array, wave_number: float, doubles: Complex, first: int = -1
    ) -> Complex:
        """Write the double layers of all elements at places (P, 3); return the single ones (P, F).

        From number `first` on, unless it is negative, the places are the elements' own centres.
        """
        from struck.core import entry

        kernel = entry("boundary_layers")
        if kernel is None:
            raise SolverError(
                "boundary elements need the compiled core: install struck again, or take "
                "radiation='power'"
            )
        singles = np.empty((len(places), len(self.sizes)), np.complex128)
        kernel(
            *(len(places), np.ascontiguousarray(places), first, len(self.sizes), self.corners),
            *(self.normals, self.nodes, self.mesh.areas, self.sizes, wave_number, _NEAR_DISTANCE),
            *(doubles.shape[1], doubles, singles),
        )
        return singles


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SurfaceField:
    """Pressure and normal velocity of modes on one mesh of boundary elements, and so around it.

    Time goes as exp(+i w t), so that a wave goes out as exp(-i k r) / r.
    """

    mesh: Mesh  # closed, F elements
    modes: Index  # (K,), their numbers in the body
    wave_numbers: Array  # (K,), 1/m
    pressures: Single  # (2, F, K), real and imaginary, for unit modal velocity, Pa/(kg^1/2 m/s)
    velocities: Single  # (F, K), outward, for unit modal velocity, kg^-1/2
    errors: Array  # (K,), relative, of the pressure far away
    air: Air = AIR

    def pressure(self, points: Array, modes: Index) -> Complex:
        """Return the pressure at points (P, 3) outside the body, of some modes (K,).

        The Kirchhoff-Helmholtz integral: Pa for a modal velocity of 1 kg^1/2 m/s.
        """
        elements = BoundaryElements.of(self.mesh)
        out = np.empty((len(points), len(modes)), np.complex128)
        wave_numbers = self.wave_numbers[modes]
        real, imaginary = (part.T[modes].astype(np.float64) for part in self.pressures)
        pressures = real + 1j * imaginary
        flows = _flows(wave_numbers[:, None], self.velocities.T[modes], self.air)
        for wave_number in np.unique(wave_numbers):
            columns = np.flatnonzero(wave_numbers == wave_number)

            def evaluate(
                rows: slice, wave_number: float = wave_number, columns: Index = columns
            ) -> None:
                places = points[rows]
                doubles = np.empty((len(places), len(self.mesh.faces)), np.complex128)
                singles = elements.layers(places, wave_number, doubles)
                out[rows, columns] = layer_sums(doubles, pressures[columns]) + layer_sums(
                    singles, flows[columns]
                )

            run_in_threads(evaluate, row_blocks(0, len(points)))
        return out

    def chosen(self, modes: Index, size: float, factor: float | Array) -> SurfaceField | None:
        """Return the field of some of the body's modes, by their places in `modes`.

        The body is `size` times as large, and its shapes `factor` times; None if they are not in
        the field.
        """
        places = {int(mode): place for place, mode in enumerate(self.modes)}
        mode_numbers = [number for number, mode in enumerate(modes) if int(mode) in places]
        if not mode_numbers:
            return None
        columns = np.array([places[int(modes[number])] for number in mode_numbers])
        factors = np.broadcast_to(np.asarray(factor, np.float32), len(modes))[mode_numbers]
        return replace(
            self,
            mesh=self.mesh if size == 1 else self.mesh.scaled(size),
            modes=np.array(mode_numbers),
            wave_numbers=self.wave_numbers[columns] / size,
            pressures=self.pressures[:, :, columns] * factors,
            velocities=self.velocities[:, columns] * factors,
            errors=self.errors[columns],
        )


def join_fields(fields: Sequence[SurfaceField]) -> SurfaceField:
    """Return the field of all modes of several fields on the same mesh."""
    rows = {
        name: np.concatenate([getattr(field, name) for field in fields], axis=-1)
        for name in ("modes", "wave_numbers", "pressures", "velocities", "errors")
    }
    return replace(fields[0], **rows)


def solve_field(
    mesh: Mesh, wave_numbers: ArrayLike, velocities: Array, modes: Index, air: Air = AIR
) -> SurfaceField:
    """Return the field of modes of about one frequency by outward normal velocities (F, K).

    One factorisation, at the mean of their wave numbers, serves them all.

    Parameters
    ----------
    mesh : Mesh
        Closed, of F triangles of about the same size.
    wave_numbers : array-like (K,) or float
        1/m, within 0.1 % of each other.
    velocities : array (F, K)
        Outward normal velocities at the centres for unit modal velocity, kg^-1/2.
    modes : array (K,)
        Numbers of the modes in the body.
    air : Air
        The medium.

    Raises
    ------
    MeshError
        When a wall is thinner than a tenth of the elements on it.
    SolverError
        Without a compiled core.
    """
    elements, walls = BoundaryElements.of(mesh), Walls.of(mesh)
    wall_ratio = walls.min_ratio
    if wall_ratio < MIN_WALL_RATIO:
        raise MeshError(
            f"a wall is {wall_ratio:.3f} of the boundary elements on it, of {MIN_WALL_RATIO} at "
            "least: give a finer mesh, or keep the estimate of radiation='power', which needs no "
            "elements"
        )
    mode_wave_numbers = np.broadcast_to(np.asarray(wave_numbers, np.float64), len(modes)).copy()
    mean, flows = float(mode_wave_numbers.mean()), _flows(mode_wave_numbers, velocities, air)
    pressures = _pressures(elements, mean, flows, walls.inner_points(mean))
    field = SurfaceField(
        mesh=mesh,
        modes=np.asarray(modes, np.int64),
        wave_numbers=mode_wave_numbers,
        pressures=np.stack([pressures.real, pressures.imag]).astype(np.float32),
        velocities=velocities.astype(np.float32),
        errors=np.zeros(len(modes)),
        air=air,
    )
    edge = edge_length(mesh)
    mesh_error = (
        _BASE_ERROR + _WAVE_ERROR * (mean * edge) ** 2 + _WALL_ERROR * max(1 / wall_ratio - 1, 0)
    )
    return replace(field, errors=mesh_error + _imbalances(field))


def _pressures(
    elements: BoundaryElements, wave_number: float, flows: Complex, inner_points: Array
) -> Complex:
    """Return the pressures (F, K) that flows (F, K) make; points (P, 3) border the equations."""
    from scipy.linalg import lu_factor, lu_solve

    count, rows = len(elements.sizes), len(elements.sizes) + len(inner_points)
    places = np.concatenate([elements.mesh.centroids, inner_points])
    matrix = np.empty((rows, rows), np.complex128)
    right_sides = np.empty((rows, flows.shape[1]), np.complex128)

    def fill(block: slice) -> None:
        first_element = block.start if block.stop <= count else -1
        singles = elements.layers(places[block], wave_number, matrix[block], first_element)
        right_sides[block] = layer_sums(singles, flows.T)
        np.negative(matrix[block], out=matrix[block])

    run_in_threads(fill, [*row_blocks(0, count), *row_blocks(count, rows)])
    matrix[np.arange(count), np.arange(count)] += 0.5
    matrix[:count, count:] = matrix[count:, :count].conj().T
    matrix[count:, count:] = 0
    # LAPACK reads rows as columns, so it factorises the transposed matrix in place.
    factors = lu_factor(matrix.T, overwrite_a=True, check_finite=False)
    return lu_solve(factors, right_sides, trans=1, overwrite_b=True, check_finite=False)[:count]


def row_blocks(first: int, end: int) -> list[slice]:
    """Return the rows from `first` to `end`, few at once."""
    return [slice(start, min(start + _ROWS, end)) for start in range(first, end, _ROWS)]


def run_in_threads(task: Callable[[slice], None], blocks: Sequence[slice]) -> None:
    """Run a task on each block of rows, in threads on all processors."""
    if len(blocks) == 1:  # a listener that moves has no time for threads
        task(blocks[0])
        return
    with ThreadPoolExecutor(thread_count()) as threads:
        list(threads.map(task, blocks))


def layer_sums(layers: Complex, values: Complex) -> Complex:
    """Return layers (P, F) of values (K, F): (P, K)."""
    # Not by a matrix product, whose own threads would wait, busily, for processors that ours use.
    return np.einsum("pf,kf->pk", layers, values)


def _flows(wave_numbers: float | Array, velocities: Array | Single, air: Air) -> Complex:
    """Return densities of single layers (F, K): i w times density times outward velocity."""
    return np.asarray(1j * air.impedance * wave_numbers * velocities, np.complex128)


def edge_length(mesh: Mesh) -> float:
    """Return the edge of an equilateral triangle of the faces' mean area, m."""
    return float(np.sqrt(mesh.areas.mean() * 4 / np.sqrt(3)))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Walls:
    """Depths of the body below the centres of its elements."""

    mesh: Mesh
    depths: Array  # (F,), along the inward normal, m; NaN where the ray slips between two faces

    @classmethod
    def of(cls, mesh: Mesh, part: Mesh | None = None) -> Walls:
        """Measure the walls of a closed surface, or those below the elements of a part of it."""
        part = mesh if part is None else part
        origins = part.centroids - 1e-6 * np.sqrt(part.areas)[:, None] * part.face_normals
        _, depths = mesh.locator.first_below(origins, -part.face_normals)
        return cls(mesh=part, depths=np.where(np.isfinite(depths), depths, np.nan))

    def between(self, surface: Mesh, tolerance: float) -> Walls:
        """Return the walls whose other side is on a surface too, within a tolerance, m."""
        depths = np.full_like(self.depths, np.nan)
        faces = np.flatnonzero(~np.isnan(self.depths))
        shifts = self.depths[faces, None] * self.mesh.face_normals[faces]
        distances, _, _ = surface.locator.closest(self.mesh.centroids[faces] - shifts)
        is_between = distances <= tolerance
        depths[faces[is_between]] = self.depths[faces[is_between]]
        return Walls(mesh=self.mesh, depths=depths)

    @property
    def min_ratio(self) -> float:
        """The least depth over the edge of the element above, edges as sharp as a knife aside."""
        return self._find_thinnest()[0]

    @property
    def shallowest(self) -> tuple[float, Array]:
        """Depth below the element that has the least for its edge, m, and its centre (3,), m."""
        face = self._find_thinnest()[1]
        return float(self.depths[face]), self.mesh.centroids[face]

    def _find_thinnest(self) -> tuple[float, int]:
        """Return the least depth over edge, and of which element; infinite where none is known."""
        areas = self.mesh.areas
        ratios = self.depths / np.sqrt(areas * 4 / np.sqrt(3))
        order = np.argsort(np.where(np.isnan(ratios), np.inf, ratios), kind="stable")
        is_counted = np.cumsum(areas[order]) > _SHARP_FRACTION * areas.sum()
        face = int(order[np.argmax(is_counted)])
        return float(np.nan_to_num(ratios[face], nan=np.inf)), face

    def inner_points(self, wave_number: float) -> Array:
        """Return points (P, 3) inside, far from each other, where waves could stand."""
        deep = np.flatnonzero(self.depths / 2 * wave_number > _MIN_PHASE)
        if not len(deep):
            return np.zeros((0, 3))
        insets = np.interp(np.arange(len(deep)) * _GOLDEN % 1, (0, 1), _DEEP) * self.depths[deep]
        points = self.mesh.centroids[deep] - insets[:, None] * self.mesh.face_normals[deep]
        chosen = [0]
        distances = np.linalg.norm(points - points[0], axis=1)
        while len(chosen) < min(_MAX_INNER_POINTS, len(points)):
            chosen.append(int(np.argmax(distances)))
            distances = np.minimum(distances, np.linalg.norm(points - points[chosen[-1]], axis=1))
        return points[chosen]


def _imbalances(field: SurfaceField) -> Array:
    """Return the relative differences of the amplitudes by far power and skin power (K,)."""
    steps = np.arange(_DIRECTIONS) + 0.5
    heights, angles = 1 - 2 * steps / _DIRECTIONS, 2 * np.pi * _GOLDEN * steps
    planar = np.sqrt(1 - heights**2)
    directions = np.stack([planar * np.cos(angles), planar * np.sin(angles), heights], axis=1)
    radius = _FAR_DISTANCE * field.mesh.extent
    points = field.mesh.bounds.mean(axis=0) + radius * directions
    pressures = field.pressure(points, np.arange(len(field.modes)))
    far_power = (
        4 * np.pi * radius**2 * np.square(np.abs(pressures)).mean(axis=0) / field.air.impedance
    )
    skin_power = field.mesh.areas @ (field.pressures[0].astype(np.float64) * field.velocities)
    tiny = np.finfo(float).tiny
    return np.abs(np.sqrt(np.maximum(skin_power, 0) / np.maximum(far_power, tiny)) - 1)

"""Sound field of a body: meshes for groups of modes, with forecasts of time and memory.

Each mode gets the coarsest of a few meshes that has at least six elements in its wavelength in air
and in that of its shape. Modes within 0.1 % share a factorisation.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from threadpoolctl import threadpool_limits

from struck.core.machine import GIB, available, thread_count
from struck.errors import MeshError, SolverError, rounded
from struck.model.arrays import Array, Index
from struck.model.gains import Keep, ShapeGains
from struck.model.material import AIR
from struck.model.mesh import Mesh
from struck.model.mesh_topology import edges_of
from struck.model.provenance import FORECAST, Progress, silent
from struck.radiation.boundary_elements import (
    MIN_WALL_RATIO,
    SAME_FREQUENCY,
    SurfaceField,
    Walls,
    edge_length,
    join_fields,
    solve_field,
)
from struck.radiation.on_surface import Skin, laplacian, normal_velocities
from struck.radiation.remeshing import remesh

PER_WAVE = 6  # elements in a wavelength
MAX_SIZE = 24.0  # wave number times radius: beyond it the estimate stays
_MIN_ELEMENTS = 1000  # elements, which a body's form takes, whatever the wavelength
_WALL_QUANTILE = 0.02  # fraction of the faces whose depth may be less than the wall
_WALL = 0.15  # of an element, which a wall has at least
_MAX_CROSSED_FRACTION = 1e-3  # fraction of the skin that may lie within the body
_EDGE_RATIO = 2**0.5  # from a mesh to the next: twice as many elements
# Where a wall is too thin for some of a mesh's elements, it is made again with smaller ones, in
# steps of _STEP, down to half the edge: four times as many at most, chosen by judgement.
_STEP, _MIN_EDGE_RATIO = 2**-0.25, 0.5
# Processor time of one factorisation by its F elements, s: near ones, far ones, and LAPACK's LU.
_BY_ELEMENT, _BY_SQUARE, _BY_CUBE = 8e-5, 3.5e-8, 6.5e-11
_BY_FACE = 3e-4  # of remeshing, by the faces of the skin, s
_SAMPLES = 1300  # places around the body at which the field is read
_BYTES = 18  # of memory by the square of the elements


def compute_directly(compute: Callable[[], SurfaceField], /, **inputs: object) -> SurfaceField:
    """Return the result of `compute`, without storing it."""
    del inputs
    return compute()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FieldPlan:
    """Plan of a computed field: modes by mesh, and by frequency on each."""

    skin: Skin  # the part of the surface in free air
    wall: float  # a depth that almost all of the body has below its skin, m
    edges: tuple[float, ...]  # of the meshes, m, those of most elements first
    mesh_modes: tuple[Index, ...]  # modes of each mesh, in order of frequency
    wave_numbers: Array  # (M,), of all modes of the body, 1/m
    left_out: Index  # modes that keep the estimate: ka above the bound

    @classmethod
    def of(cls, gains: ShapeGains, frequencies: Array, band: tuple[float, float]) -> FieldPlan:
        """Plan the field of the modes within a band, Hz; MeshError where no skin is closed."""
        wave_numbers = 2 * np.pi * frequencies / AIR.sound_speed
        in_band = np.flatnonzero((frequencies >= band[0]) & (frequencies <= band[1]))
        is_high = wave_numbers[in_band] * gains.radius > MAX_SIZE
        chosen = in_band[~is_high]
        skin = Skin.of(gains.surface, gains.centre)
        _require_closed(skin.mesh)
        wall = float(np.nanquantile(Walls.of(skin.mesh).depths, _WALL_QUANTILE))
        even_edge = edge_length(skin.mesh) * np.sqrt(len(skin.faces) / _MIN_ELEMENTS)
        max_edge = min(even_edge, wall / _WALL)
        max_wave_numbers = np.maximum(wave_numbers[chosen], _shape_waves(gains)[chosen])
        target_edges = 2 * np.pi / (PER_WAVE * max_wave_numbers)
        levels = np.ceil(
            np.log(np.maximum(max_edge / target_edges, 1)) / np.log(_EDGE_RATIO) - 1e-9
        )
        distinct_levels = np.unique(levels)[::-1]
        return cls(
            skin=skin,
            wall=wall,
            edges=tuple(float(max_edge / _EDGE_RATIO**level) for level in distinct_levels),
            mesh_modes=tuple(chosen[levels == level] for level in distinct_levels),
            wave_numbers=wave_numbers,
            left_out=in_band[is_high],
        )

    @property
    def counts(self) -> Array:
        """About how many elements each mesh has (L,)."""
        return self.skin.mesh.areas.sum() / (3**0.5 / 4 * np.square(self.edges))

    def groups(self, modes: Index) -> Iterator[Index]:
        """Yield the modes, in order of frequency, that share a factorisation."""
        first = 0
        for number in range(1, len(modes) + 1):
            min_wave_number = self.wave_numbers[modes[first]]
            if (
                number == len(modes)
                or self.wave_numbers[modes[number]] > (1 + SAME_FREQUENCY) * min_wave_number
            ):
                yield modes[first:number]
                first = number

    def seconds(self, counts: Array) -> float:
        """Estimated CPU time, s, for meshes of the given element counts (L,)."""
        solve_counts = np.array([len(list(self.groups(modes))) for modes in self.mesh_modes])
        solve_times = (
            counts * (_BY_ELEMENT + _BY_SQUARE * (counts + _SAMPLES)) + _BY_CUBE * counts**3
        )
        return float(solve_counts @ solve_times) + _BY_FACE * len(self.skin.faces) * len(
            solve_counts
        )


def _require_memory(counts: Array) -> float:
    """Return the bytes for meshes of the given element counts; SolverError if they are not free."""
    needed_bytes, free = float(_BYTES * np.square(counts).max(initial=0)), available()
    if free is not None and needed_bytes > free:
        raise SolverError(
            f"the timbre field needs about {rounded(needed_bytes / GIB, 3)} GiB of memory, but "
            f"{rounded(free / GIB, 3)} GiB are free: give a band= that ends lower or a thicker "
            "body, or keep the estimate of radiation='power'"
        )
    return needed_bytes


def _require_closed(mesh: Mesh) -> None:
    """Raise MeshError where a surface is open or crosses itself."""
    loose = np.count_nonzero(edges_of(mesh.faces).balance)
    if loose:
        raise MeshError(
            f"{loose} edges of the surface have a face on one side alone, of 0 at most: analyze "
            "the body from its mesh, which closes it, or take radiation='power'"
        )
    origins = mesh.centroids + 1e-6 * np.sqrt(mesh.areas)[:, None] * mesh.face_normals
    hit_faces, _ = mesh.locator.first_below(origins, mesh.face_normals)
    cosines = np.einsum("fd,fd->f", mesh.face_normals[hit_faces], mesh.face_normals)
    # Their ray may also have slipped between two faces.
    inner_faces = np.flatnonzero((hit_faces >= 0) & (cosines > 0))
    inner_faces = (
        inner_faces[mesh.locator.holds(origins[inner_faces])] if len(inner_faces) else inner_faces
    )
    crossed_fraction = mesh.areas[inner_faces].sum() / mesh.areas.sum()
    if crossed_fraction > _MAX_CROSSED_FRACTION:
        raise MeshError(
            f"the surface crosses itself: {crossed_fraction:.1%} of it lie within the body, of "
            f"{_MAX_CROSSED_FRACTION:.1%} at most: analyze the body from its mesh, which unites "
            "it, or take radiation='power'"
        )


def _shape_waves(gains: ShapeGains) -> Array:
    """Return wave numbers of the shapes along the surface (M,): root of their mean squared slope.

    A sine over all of the surface has its own.
    """
    stiffness, masses = laplacian(gains.surface)
    waves = np.empty(gains.count)
    for mode in range(gains.count):
        shape = gains.shapes[:, :, mode].astype(np.float64)
        slopes = np.einsum("vd,vd->", shape, stiffness @ shape)
        waves[mode] = np.sqrt(max(slopes, 0.0) / np.einsum("v,vd->", masses, np.square(shape)))
    return waves


def fields_of(
    gains: ShapeGains, plan: FieldPlan, keep: Keep = compute_directly, progress: Progress = silent
) -> list[SurfaceField]:
    """Return the fields of the planned modes, one for each mesh.

    Raises
    ------
    MeshError
        Where a wall is too thin for the elements.
    SolverError
        Where memory does not suffice.
    """
    _require_memory(plan.counts)
    meshes = [fitting_mesh(plan.skin.mesh, edge, plan.wall) for edge in plan.edges]
    # Folds and ridges may keep more elements than the plan has.
    counts = np.array([len(mesh.faces) for mesh in meshes], np.float64)
    needed_bytes, seconds = _require_memory(counts), plan.seconds(counts)
    task_count = _count_concurrent(needed_bytes)
    forecast = (
        f"about {seconds:.0f} s of a processor and {rounded(task_count * needed_bytes / 1e9, 2)} GB"
    )
    progress(f"{FORECAST}timbre field, {forecast}", 0.0)
    done_count, mode_count = 0, sum(len(modes) for modes in plan.mesh_modes)
    parts = []
    for mesh, modes in zip(meshes, plan.mesh_modes, strict=True):
        velocities = velocities_on(mesh, gains, plan.skin, modes)
        places = {int(mode): place for place, mode in enumerate(modes)}
        tasks, mode_fields = [], []
        for group in plan.groups(modes):
            inputs = {
                "mesh": mesh,
                "wave_numbers": plan.wave_numbers[group],
                "velocities": velocities[:, [places[int(mode)] for mode in group]],
                "modes": group,
            }
            tasks.append(partial(keep, partial(solve_field, **inputs), **inputs))
        for field in _results(tasks, task_count):
            mode_fields.append(field)
            done_count += len(field.modes)
            progress("computing the timbre field", done_count / mode_count)
        parts.append(join_fields(mode_fields))
    return parts


def fitting_mesh(skin: Mesh, planned: float, wall: float) -> Mesh:
    """Return a skin remeshed with edges of `planned` m, or as small as its thinnest wall needs.

    MeshError where half of that is not small enough.
    """
    edge = planned
    while True:
        mesh = remesh(skin, edge, wall)
        walls = Walls.of(mesh)
        wall_ratio = walls.min_ratio
        if wall_ratio >= MIN_WALL_RATIO:
            return mesh
        edge *= _STEP
        if edge < _MIN_EDGE_RATIO * planned * (1 - 1e-9):
            break
    depth, position = walls.shallowest
    place_text = ", ".join(rounded(coordinate, 3) for coordinate in position)
    raise MeshError(
        f"the body is {rounded(1000 * depth, 2)} mm thick at ({place_text}) m, "
        f"{rounded(wall_ratio, 2)} of the "
        f"boundary elements there, of {MIN_WALL_RATIO} at least, with {len(mesh.faces)} of them: "
        "keep the model as it is, whose estimate of radiation needs no elements, or thicken the "
        "body "
        "there"
    )


def _count_concurrent(needed_bytes: float) -> int:
    """Return how many frequencies to solve at once, each in a thread, by the memory they need."""
    free = available()
    fitting = thread_count() if free is None else int(free // max(needed_bytes, 1.0))
    return max(min(thread_count(), fitting), 1)


def _results(
    tasks: Sequence[Callable[[], SurfaceField]], task_count: int
) -> Iterator[SurfaceField]:
    """Yield the results of tasks in their order, some computed at once; none begins after an error.

    A frequency a thread scales better than threads within a factorisation, much of which is serial.
    """
    if task_count == 1:
        yield from (task() for task in tasks)
        return
    threads = ThreadPoolExecutor(task_count)
    try:
        with threadpool_limits(1, user_api="blas"):
            yield from threads.map(lambda task: task(), tasks)
    finally:
        threads.shutdown(cancel_futures=True)


def velocities_on(mesh: Mesh, gains: ShapeGains, skin: Skin, modes: Index) -> Array:
    """Return outward normal velocities (F, K) on a remeshed skin for unit modal velocity, kg^-1/2.

    Shapes are those of the body's own surface at the vertices; the net flux through the skin is
    the surface's own, so that what weak modes radiate is not what remeshing left over.
    """
    shapes = gains.shapes[:, :, modes].astype(np.float64)
    faces, weights = skin.mesh.locator.barycentric(mesh.points)
    corners = gains.surface.faces[skin.faces[faces]]
    velocities = normal_velocities(mesh, np.einsum("vc,vcdm->vdm", weights, shapes[corners]))
    surface_fluxes = (
        gains.surface.areas[skin.faces] @ normal_velocities(gains.surface, shapes)[skin.faces]
    )
    return velocities + (surface_fluxes - mesh.areas @ velocities) / mesh.areas.sum()

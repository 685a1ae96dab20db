"""From a volume mesh and a material to certified modes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from scipy import sparse

from struck.model.arrays import Array, Index, Mask
from struck.model.material import Material
from struck.model.mesh import Mesh
from struck.model.modes import Modes
from struck.model.provenance import Progress, Provenance, silent
from struck.solids.fem import factorisation
from struck.solids.fem.assembly import Displacements, System, assemble, gradients
from struck.solids.fem.factorisation import Factoriser
from struck.solids.fem.lanczos import Eigenpairs, rigid_motions
from struck.solids.fem.spectrum import (
    Search,
    Solver,
    Spectrum,
    largest_residual,
    require_complete,
    require_one_piece,
)
from struck.solids.volume_mesh import VolumeMesh

# Relative errors (m,) of modes, from their eigenvalues (m,) and the movement of all nodes
# (N, 3, m); many modes come slice by slice.
Estimate = Callable[[Array, Array], Array]


def vibration_modes(
    mesh: VolumeMesh,
    material: Material,
    highest: float,
    *,
    fixed: Mask | None = None,
    solver: Solver | None = None,
    estimate: Estimate | None = None,
    progress: Progress = silent,
) -> Modes:
    """Compute all modes of a body up to `highest`, Hz, certified by a count of inertia."""
    # `fixed` (N,): nodes that cannot move; without any the body floats freely.
    solver = solver or Solver()
    progress("setting up the equations of motion", 0.0)
    full_system = assemble(mesh, material, lumped=solver.lumped)
    basis = Displacements.of(mesh)
    is_movable = np.ones(basis.count, bool) if fixed is None else ~basis.held(fixed)
    system = full_system if is_movable.all() else full_system.free(is_movable)
    collector = _Collector(
        basis=basis,
        material=material,
        movable=is_movable,
        surface=_surface(basis),
        estimate=estimate,
    )
    search = Search(
        system=system,
        motions=_free_motions(basis) if is_movable.all() else np.zeros((system.unknowns, 0)),
        bound=(2 * np.pi * highest) ** 2,
        solver=solver,
        shown=3 * len(collector.surface[0].points),
        progress=progress,
    )
    # Nothing here may hold on to a slice's vectors while the next one is found.
    results = _join_slices(map(partial(_certify, search, collector), search.pairs()), search)
    require_complete(results.values, search.bound, search.counted)
    return _as_modes(collector, full_system, results, highest, _provenance(mesh, search, results))


def without_modes(
    mesh: VolumeMesh, material: Material, highest: float, *, solver: Solver, why: str
) -> Modes:
    """Return a free body that has no mode up to `highest`, Hz: its surface, mass and inertia."""
    surface = _surface(Displacements.of(mesh))[0]
    mass, centre, inertia = mass_properties(
        assemble(mesh, material, lumped=solver.lumped), mesh.nodes
    )
    none = np.zeros(0)
    return Modes(
        frequencies=none,
        surface=surface,
        shapes=np.zeros((len(surface.points), 3, 0)),
        mass=mass,
        centre=centre,
        inertia=inertia,
        complete_to=highest,
        poisson_slopes=none,
        errors=none,
        provenance=Provenance(
            method=f"finite elements ({_name_elements(mesh)})",
            references=("zienkiewicz2013", "parlett1998"),
            dropped=(why,),
            details={"nodes": len(mesh.nodes), "sturm_count": 0},
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _SliceResults:
    """Results kept of eigenpairs: values, shapes on the surface, errors and Poisson slopes."""

    values: Array
    shapes: Array
    slopes: Array
    errors: Array
    residual: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Collector:
    """A body, and the parts of its modes that are kept."""

    basis: Displacements
    material: Material
    movable: Mask
    surface: tuple[Mesh, Index | sparse.csr_array]  # and which functions move its vertices
    estimate: Estimate | None

    def of(self, pairs: Eigenpairs, residual: float) -> _SliceResults:
        """Return the results of a slice of eigenpairs, without their full vectors."""
        vectors = self._expand(pairs)
        unknown_errors = np.full(len(pairs.values), np.nan)
        return _SliceResults(
            values=pairs.values,
            shapes=self._move_surface(vectors),
            slopes=poisson_slopes(self.basis, self.material, pairs.values, vectors),
            errors=unknown_errors
            if self.estimate is None
            else self.estimate(pairs.values, vectors),
            residual=residual,
        )

    def _move_surface(self, vectors: Array) -> Array:
        """Return the movement of the surface's vertices (V, 3, m)."""
        vertex_map = self.surface[1]
        if isinstance(vertex_map, np.ndarray):
            return vectors[vertex_map]
        return (vertex_map @ vectors.reshape(len(vectors), -1)).reshape(-1, *vectors.shape[1:])

    def _expand(self, pairs: Eigenpairs) -> Array:
        """Return the displacements of all functions (N, 3, m), zero for held ones."""
        moving = pairs.vectors.reshape(-1, 3, len(pairs.values))
        if self.movable.all():
            return moving
        vectors = np.zeros((len(self.movable), *moving.shape[1:]))
        vectors[self.movable] = moving
        return vectors


def _surface(basis: Displacements) -> tuple[Mesh, Index | sparse.csr_array]:
    if basis.added is None:
        return basis.mesh.surface()
    from struck.solids.fem.cubic_surface import surface_of  # only thin bodies need it

    return surface_of(basis.mesh, basis.added)


def _certify(search: Search, collector: _Collector, pairs: Eigenpairs) -> _SliceResults:
    search.progress("checking that no mode is missing", 0.0)
    require_one_piece(pairs.values, search.bound)
    return collector.of(pairs, largest_residual(search.system, pairs))


def _join_slices(parts: Iterable[_SliceResults], search: Search) -> _SliceResults:
    """Put slices side by side as they come; shapes, the most of it, in their final place."""
    none = np.zeros((0, 3, 0))
    shapes, slices = none, []
    for part in parts:
        if not slices:
            shapes = np.empty((*part.shapes.shape[:2], search.counted))
        first = sum(len(earlier.values) for earlier in slices)
        require_complete(part.values, np.inf, min(len(part.values), search.counted - first))
        shapes[:, :, first : first + len(part.values)] = part.shapes
        slices.append(replace(part, shapes=none))
    return _SliceResults(
        values=np.concatenate([part.values for part in slices]),
        shapes=shapes,
        slopes=np.concatenate([part.slopes for part in slices]),
        errors=np.concatenate([part.errors for part in slices]),
        residual=max(part.residual for part in slices),
    )


def _as_modes(
    collector: _Collector,
    system: System,
    results: _SliceResults,
    highest: float,
    provenance: Provenance,
) -> Modes:
    mass, centre, inertia = mass_properties(system, collector.basis.mesh.nodes)
    return Modes(
        frequencies=np.sqrt(results.values) / (2 * np.pi),
        surface=collector.surface[0],
        shapes=results.shapes,
        mass=mass,
        centre=centre,
        inertia=inertia,
        complete_to=highest,
        poisson_slopes=results.slopes,
        errors=results.errors,
        supported=not collector.movable.all(),
        provenance=provenance,
    )


def _provenance(mesh: VolumeMesh, search: Search, results: _SliceResults) -> Provenance:
    lumped = "lumped" if search.solver.lumped else "consistent"
    method = "anderson1999" if search.small else "grimes1994"
    return Provenance(
        method=f"finite elements ({_name_elements(mesh)}, {lumped} mass)",
        references=("zienkiewicz2013", method, "parlett1998"),
        details={
            "elements": f"{len(mesh.elements)} {_name_elements(mesh)}",
            "nodes": len(mesh.nodes),
            "unknowns": search.system.unknowns,
            "largest_residual": results.residual,
            "sturm_count": search.counted,
            "memory_forecast": f"{search.forecast / factorisation.GIB:.2f} GiB",
        },
    )


def _name_elements(mesh: VolumeMesh) -> str:
    return f"cubic {mesh.kind}" if mesh.cubic else mesh.kind


def mass_properties(system: System, nodes: Array) -> tuple[float, Array, Array]:
    """Return mass, centre of mass and moments of inertia about it from the mass matrix."""
    # The functions of the nodes make up all translations; others follow them.
    node_masses = system.mass_matrix()[: len(nodes), : len(nodes)]
    weights = np.asarray(node_masses.sum(axis=0)).ravel()
    mass = float(weights.sum())
    centre = weights @ nodes / mass
    arms = nodes - centre
    second_moments = arms.T @ (node_masses @ arms)
    return mass, centre, np.trace(second_moments) * np.eye(3) - second_moments


def poisson_slopes(
    basis: Displacements, material: Material, values: Array, vectors: Array
) -> Array:
    """Return d ln f / d(Poisson's ratio) at constant Young's modulus for each mode (M,)."""
    # First-order perturbation: K = lambda D + mu B, so the energy of dilatation x'Dx of a mode
    # determines how its eigenvalue changes with lambda and mu.
    nu, young = material.poisson_ratio, material.youngs_modulus
    dilatation = _dilatation(basis, vectors)
    shear_part = (values - material.first_lame * dilatation) / material.shear_modulus
    first = young * (1 + 2 * nu**2) / ((1 + nu) * (1 - 2 * nu)) ** 2
    shear = -young / (2 * (1 + nu) ** 2)
    return (first * dilatation + shear * shear_part) / (2 * values)


def _dilatation(basis: Displacements, vectors: Array) -> Array:
    """Return the integral of (div x)^2 of each mode (M,)."""
    integrals = np.zeros(vectors.shape[2])
    rule = basis.stiffness_rules[1]
    for chunk in basis.mesh.chunks(512):
        chosen = np.arange(len(basis.mesh.elements))[chunk]
        slopes, weights = gradients(basis, chosen, rule)
        count, points, functions, _ = slopes.shape
        shapes = vectors[basis.numbers[chosen]].reshape(count, 3 * functions, -1)
        divergence = slopes.reshape(count, points, 3 * functions) @ shapes
        integrals += np.einsum("eq,eqm,eqm->m", weights, divergence, divergence, optimize=True)
    return integrals


def _free_motions(basis: Displacements) -> Array:
    """Return translations and rotations (3N, 6): linear, so the functions of the nodes do."""
    return basis.pad(rigid_motions(basis.mesh.nodes))


def lowest_frequency(
    mesh: VolumeMesh, material: Material, solver: Solver | None = None, *, number: int = 1
) -> float:
    """Return the lowest natural frequency of a freely floating body, or a higher one, Hz."""
    solver = solver or Solver()
    system = assemble(mesh, material, lumped=solver.lumped)
    motions = _free_motions(Displacements.of(mesh))
    # Any shift below all frequencies will do; this one is the square of a travelling wave's.
    speed = np.sqrt(material.youngs_modulus / material.density)
    max_eigenvalue = np.square(speed / np.ptp(mesh.nodes, axis=0).max())
    spectrum = Spectrum(system, motions, Factoriser(solver.backend))
    pairs = spectrum.near(spectrum.shift(-float(max_eigenvalue) / 400), 0, number)
    return float(np.sqrt(pairs.values[number - 1]) / (2 * np.pi))

"""From a volume mesh and a material to certified modes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.material import Material
from struck.modes import Modes
from struck.progress import Progress, silent
from struck.provenance import Provenance
from struck.solids.assembly import System, assemble, gradients
from struck.solids.certify import certify, counted_below
from struck.solids.eigen import Eigenpairs, Mass, block_lanczos, dense, rigid_motions
from struck.solids.factor import Factoriser
from struck.solids.volume import VolumeMesh

Array = NDArray[np.float64]
DENSE_LIMIT = 1200


@dataclass(frozen=True, slots=True, kw_only=True)
class Solver:
    """How eigenpairs are computed.

    Parameters
    ----------
    lumped : bool
        Lumped instead of consistent mass; linear tetrahedra only (2002, eq. 15).
    backend : str
        Sparse factorisation: "auto", "rslab" or "superlu".
    dense_limit : int
        Up to so many unknowns LAPACK takes the whole matrix.
    """

    lumped: bool = False
    backend: str = "auto"
    dense_limit: int = DENSE_LIMIT


def vibration_modes(
    mesh: VolumeMesh,
    material: Material,
    highest: float,
    *,
    fixed: NDArray[np.bool_] | None = None,
    solver: Solver | None = None,
    progress: Progress = silent,
) -> Modes:
    """Compute all modes of a body up to `highest`.

    Parameters
    ----------
    mesh : VolumeMesh
    material : Material
    highest : float
        End of the band, Hz.
    fixed : array (N,) of bool, optional
        Nodes that cannot move; without any the body floats freely.
    solver : Solver, optional
    progress : callable
        Told the stage and its fraction done.

    Returns
    -------
    Modes
        Certified: counted by inertia, none missing up to `highest`.

    Raises
    ------
    OptionError
        When no mode lies below `highest`.
    MeshError
        When elements are inverted or parts hang together by a point.
    SolverError
        When the certificate fails.
    """
    solver = solver or Solver()
    progress("assemble", 0.0)
    whole = assemble(mesh, material, lumped=solver.lumped)
    movable = np.ones(len(mesh.nodes), bool) if fixed is None else ~fixed
    system = whole if movable.all() else whole.free(movable)
    motions = rigid_motions(mesh.nodes) if movable.all() else np.zeros((system.unknowns, 0))
    pairs, residual = _eigenpairs(system, motions, highest, solver, progress)
    vectors = np.zeros((len(mesh.nodes), 3, len(pairs.values)))
    vectors[movable] = pairs.vectors.reshape(-1, 3, len(pairs.values))
    provenance = _provenance(mesh, system, pairs, residual, solver)
    return _as_modes(
        mesh,
        material,
        whole,
        pairs.values,
        vectors,
        highest,
        provenance,
        supported=not movable.all(),
    )


def _eigenpairs(
    system: System, motions: Array, highest: float, solver: Solver, progress: Progress
) -> tuple[Eigenpairs, float]:
    """Return the certified pairs up to `highest` and their largest residual."""
    bound, rigid = (2 * np.pi * highest) ** 2, motions.shape[1]
    progress("count", 0.0)
    factorise = Factoriser(solver.backend)
    counted = counted_below(system, bound, rigid, factorise)
    if system.unknowns <= solver.dense_limit:
        stiffness, mass = _full(system)
        pairs = dense(stiffness, mass, bound, rigid)
    else:
        pairs = _sparse_pairs(system, motions, bound, max(counted, 1), factorise, progress)
    if not counted:
        lowest = np.sqrt(max(pairs.values[0], 0.0)) / (2 * np.pi)
        raise OptionError(
            f"no mode lies below {highest:g} Hz: the lowest is at {lowest:.4g} Hz; widen band=, or "
            "make the body larger, thinner or softer"
        )
    progress("certify", 0.0)
    return pairs, certify(system, pairs, bound, counted)


def _sparse_pairs(
    system: System,
    motions: Array,
    bound: float,
    count: int,
    factorise: Factoriser,
    progress: Progress,
) -> Eigenpairs:
    progress("factor", 0.0)
    shift = -bound / 400
    factor = factorise(system.shifted(shift))
    return block_lanczos(
        factor.solve,
        Mass(system.mass_matrix()),
        shift,
        count,
        motions,
        lambda fraction: progress("iterate", fraction),
    )


def _full(system: System) -> tuple[Array, Array]:
    lower = system.shifted(0.0).toarray()
    stiffness = lower + np.tril(lower, -1).T
    mass = np.kron(system.mass_matrix().toarray(), np.eye(3))
    return stiffness, np.asarray(mass, np.float64)


def _as_modes(
    mesh: VolumeMesh,
    material: Material,
    system: System,
    values: Array,
    vectors: Array,
    highest: float,
    provenance: Provenance,
    *,
    supported: bool,
) -> Modes:
    surface, numbers = mesh.surface()
    mass, centre, inertia = mass_properties(system, mesh.nodes)
    return Modes(
        frequencies=np.sqrt(values) / (2 * np.pi),
        surface=surface,
        shapes=vectors[numbers],
        mass=mass,
        centre=centre,
        inertia=inertia,
        complete_to=highest,
        poisson_slopes=poisson_slopes(mesh, material, values, vectors),
        errors=np.full(len(values), np.nan),
        supported=supported,
        provenance=provenance,
    )


def _provenance(
    mesh: VolumeMesh, system: System, pairs: Eigenpairs, residual: float, solver: Solver
) -> Provenance:
    small = system.unknowns <= solver.dense_limit
    lumped = "lumped" if solver.lumped else "consistent"
    return Provenance(
        method=f"finite elements ({mesh.kind}, {lumped} mass)",
        references=("zienkiewicz2013", "anderson1999" if small else "grimes1994", "parlett1998"),
        details={
            "elements": f"{len(mesh.elements)} {mesh.kind}",
            "nodes": len(mesh.nodes),
            "unknowns": system.unknowns,
            "largest_residual": residual,
            "sturm_count": len(pairs.values),
        },
    )


def mass_properties(system: System, nodes: Array) -> tuple[float, Array, Array]:
    """Return mass, centre of mass and moments of inertia about it from the mass matrix."""
    between = system.mass_matrix()
    weights = np.asarray(between.sum(axis=0)).ravel()
    mass = float(weights.sum())
    centre = weights @ nodes / mass
    offsets = nodes - centre
    second = offsets.T @ (between @ offsets)
    return mass, centre, np.trace(second) * np.eye(3) - second


def poisson_slopes(mesh: VolumeMesh, material: Material, values: Array, vectors: Array) -> Array:
    """Return d ln f / d(Poisson's ratio) at constant Young's modulus for each mode (M,).

    First-order perturbation: K = lambda D + mu B, so the energy of dilatation x'Dx of a mode
    tells how its eigenvalue follows lambda and mu.
    """
    nu, young = material.poisson_ratio, material.youngs_modulus
    dilatation = _dilatation(mesh, vectors)
    rest = (values - material.first_lame * dilatation) / material.shear_modulus
    first = young * (1 + 2 * nu**2) / ((1 + nu) * (1 - 2 * nu)) ** 2
    shear = -young / (2 * (1 + nu) ** 2)
    return (first * dilatation + shear * rest) / (2 * values)


def _dilatation(mesh: VolumeMesh, vectors: Array) -> Array:
    """Return the integral of (div x)^2 of each mode (M,)."""
    total = np.zeros(vectors.shape[2])
    rule = mesh.element.stiffness_rule
    for chunk in mesh.chunks(512):
        chosen = np.arange(len(mesh.elements))[chunk]
        slopes, weights = gradients(mesh, chosen, rule)
        count, points, nodes, _ = slopes.shape
        shapes = vectors[mesh.elements[chosen]].reshape(count, 3 * nodes, -1)
        divergence = slopes.reshape(count, points, 3 * nodes) @ shapes
        total += np.einsum("eq,eqm,eqm->m", weights, divergence, divergence, optimize=True)
    return total


def lowest_frequency(mesh: VolumeMesh, material: Material, solver: Solver | None = None) -> float:
    """Return the lowest natural frequency of a freely floating body, Hz."""
    solver = solver or Solver()
    system = assemble(mesh, material, lumped=solver.lumped)
    motions = rigid_motions(mesh.nodes)
    # Any shift below all frequencies will do; this one is the square of a travelling wave's.
    speed = np.sqrt(material.youngs_modulus / material.density)
    bound = np.square(speed / np.ptp(mesh.nodes, axis=0).max())
    pairs = _sparse_pairs(system, motions, float(bound), 1, Factoriser(solver.backend), silent)
    return float(np.sqrt(pairs.values[0]) / (2 * np.pi))

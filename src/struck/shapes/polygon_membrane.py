"""Membranes held along any polygon, the L-shape of 1998 among them.

Quadratic elements find roughly where the eigenvalues lie, and how many there are at least;
particular solutions refine each with a bound of its error; Crouzeix-Raviart elements prove that
there are no more.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar

import numpy as np

from struck.errors import MeshError, OptionError, SolverError, rounded
from struck.model.arrays import Array, checked
from struck.model.material import Material
from struck.model.provenance import Progress, silent
from struck.shapes.particular_solutions import Basis, Eigenfunction, PolygonForms, Trial, refine
from struck.shapes.polygon import Polygon, Triangulation, edge_for, place_sources, plan_of
from struck.shapes.shape import Shape, Vibration, require_tension
from struck.shapes.skins import Sheet
from struck.solids.polygon_mesh import Pairs, as_points, check_loops
from struck.solids.resolution import require_length


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaplacianSpectrum:
    """Eigenvalues of the Laplacian in a polygon, held along its edges."""

    values: Array  # (M,), ascending, 1/m^2
    errors: Array  # (M,), relative distances to true eigenvalues at most
    forms: PolygonForms  # with mean squares of 1
    proved_to: float  # no eigenvalue is missing below, 1/m^2; 0 where that is not proved


def spectrum(
    corners: Array, max_eigenvalue: float, progress: Progress = silent
) -> LaplacianSpectrum:
    """Return all eigenvalues up to `max_eigenvalue`, 1/m^2, of a polygon (n, 2), m."""
    plan = plan_of(corners)
    estimates = _upper_bounds(plan, max_eigenvalue, progress)
    estimates = estimates[: _find_cut(estimates, max_eigenvalue) + 2]
    if len(estimates) < 2:
        none = np.zeros(0, np.int64)
        empty = Basis(plan=plan, centres=none, counts=none, sources=np.zeros((0, 2)), highest=0.0)
        return _pack(empty, [], 0.0)
    basis, trial = _choose_basis(plan, estimates[:-1])
    modes = _refine_all(trial, estimates[:-1], progress)
    progress("proving that no mode is missing", 0.0)
    proved_to = _prove_complete(plan, modes, max_eigenvalue, float(estimates[-1]))
    return _pack(basis, [mode for mode in modes if mode.value <= max_eigenvalue], proved_to)


def estimate_count(plan: Polygon, max_eigenvalue: float) -> float:
    """Return about how many eigenvalues lie below a value, 1/m^2 (Weyl; Ivrii 1980)."""
    corners = np.sum((np.pi**2 - plan.angles**2) / (24 * np.pi * plan.angles))
    rim = plan.lengths.sum() * np.sqrt(max_eigenvalue)
    return float((plan.area * max_eigenvalue - rim) / (4 * np.pi) + corners)


# Eigenvalues above the bound, and a twentieth: the widest gap there ends the search.
_EXTRA_EIGENVALUES = 4
_PHASE = 1.3  # of a wave along the longest edge of an element, for a hundred eigenvalues


def _upper_bounds(plan: Polygon, max_eigenvalue: float, progress: Progress) -> Array:
    """Return eigenvalues of quadratic elements up to a few more than lie below a value."""
    count = max(estimate_count(plan, max_eigenvalue), 1.0)
    search_end = max_eigenvalue + (_EXTRA_EIGENVALUES + count / 20 + 3) * 4 * np.pi / plan.area
    refinement = min(1.0, (100 / count) ** 0.25)
    longest = min(_PHASE * refinement / np.sqrt(search_end), float(plan.reaches.max()) / 16)
    return (
        Triangulation.of(plan.corners, longest)
        .assemble_quadratic()
        .find_below(search_end, progress)
    )


def _find_cut(estimates: Array, max_eigenvalue: float) -> int:
    """Return the number of the last eigenvalue below the widest gap above `max_eigenvalue`."""
    first_index = max(
        int(np.searchsorted(estimates, max_eigenvalue * (1 + _ESTIMATE_ERROR))) - 1, 0
    )
    candidates = estimates[first_index : first_index + _EXTRA_EIGENVALUES + 2 + first_index // 20]
    gaps = candidates[1:] - np.maximum(candidates[:-1], max_eigenvalue)
    return first_index + int(np.argmax(gaps)) if len(gaps) else len(estimates)


_ESTIMATE_ERROR = 2e-3  # relative error of rough eigenvalues, seldom reached
# Distances of the sources from the edges, in parts of area / perimeter, and near corners, in
# parts of their clearance: none at first, then ever nearer.
_DISTANCES = ((0.0, 0.0), (1.5, 0.5), (1.5, 0.25), (0.75, 0.12))
_TARGET_ERROR = 1e-8  # error at which no richer basis is tried
_MAX_FUNCTIONS = 1200


def _choose_basis(plan: Polygon, estimates: Array) -> tuple[Basis, Trial]:
    """Return the basis that serves the lowest and the most secluded high eigenvalue best."""
    gaps = np.diff(estimates, prepend=0.0, append=np.inf)
    min_gaps = np.minimum(gaps[:-1], gaps[1:])
    probe = len(estimates) // 2 + int(np.argmax(min_gaps[len(estimates) // 2 :]))
    best_choice: tuple[float, Basis, Trial] | None = None
    for basis in _candidates(plan, float(np.sqrt(estimates[-1]))):
        trial = Trial(basis)
        probes = [refine(trial, float(estimates[at]), 1, _MIN_GAP)[0] for at in (0, probe)]
        error = max(mode.error for mode in probes)
        if best_choice is None or error < best_choice[0]:
            best_choice = (error, basis, trial)
        if error <= _TARGET_ERROR:
            break
    if best_choice is None:
        raise SolverError(_TOO_MANY_MESSAGE.format(len(estimates), _MAX_FUNCTIONS))
    return best_choice[1:]


_TOO_MANY_MESSAGE = "{} modes of this polygon need more than {} functions: lower the band's end"
_SOURCES_PER_WAVE = 5
# Orders about corners beyond those of waves, without sources and with them; and at least without.
_STEEP, _STEEP_WITH_SOURCES, _MIN_ORDER = 20, 14, 60


def _candidates(plan: Polygon, wavenumber: float) -> Iterator[Basis]:
    """Yield bases of more and more particular solutions."""
    centres = plan.singular if len(plan.singular) else np.array([0])
    for max_distance, clearance_fraction in _DISTANCES:
        sources = np.zeros((0, 2))
        orders = np.maximum(_STEEP + wavenumber * plan.reaches, _MIN_ORDER)
        if max_distance:
            # Sources make up what is smooth: corners serve their neighbourhood alone.
            distance = max_distance * plan.area / plan.lengths.sum()
            sources = place_sources(
                plan, distance, clearance_fraction, 2 * np.pi / (_SOURCES_PER_WAVE * wavenumber)
            )
            orders = np.full(len(orders), _STEEP_WITH_SOURCES + wavenumber * distance)
        basis = Basis(
            plan=plan,
            centres=centres,
            counts=np.ceil((orders / plan.powers)[centres]).astype(np.int64),
            sources=sources,
            highest=1.01 * wavenumber,
        )
        if basis.size <= _MAX_FUNCTIONS:
            yield basis


_ATTEMPTS = 5
# Relative gap above which functions are orthogonal without help: in errors, and its limits.
_GAP_IN_ERRORS, _MIN_GAP, _MAX_GAP = 30.0, 1e-8, 1e-5
_MAX_ERROR = 1e-3  # beyond, what was found is no mode
# Relative distance of rough eigenvalues that are refined together at first.
_GROUPING_DISTANCE = 5e-3


def _refine_all(trial: Trial, estimates: Array, progress: Progress = silent) -> list[Eigenfunction]:
    """Refine all rough eigenvalues, near ones together; where two meet, both together again."""
    groups, min_gap = _group_estimates(estimates), _MIN_GAP
    refined_groups: dict[tuple[int, int], list[Eigenfunction]] = {}
    for _ in range(_ATTEMPTS):
        for group in groups:
            progress("refining the modes", group[0] / len(estimates))
            if group not in refined_groups:
                group_mean = float(estimates[slice(*group)].mean())
                refined_groups[group] = refine(trial, group_mean, group[1] - group[0], min_gap)
        group_modes = [refined_groups[group] for group in groups]
        errors = [mode.error for part in group_modes for mode in part]
        min_gap = float(np.clip(_GAP_IN_ERRORS * max(errors), _MIN_GAP, _MAX_GAP))
        merged_groups = _merge_groups(groups, group_modes, estimates, min_gap)
        if merged_groups == groups and max(errors) < _MAX_ERROR:
            return [mode for part in group_modes for mode in part]
        groups = merged_groups
    first, last = max(
        refined_groups, key=lambda group: max(mode.error for mode in refined_groups[group])
    )
    raise SolverError(
        f"modes {first + 1} to {last} of this polygon cannot be separated: lower "
        "the band's end, or move corners that nearly meet"
    )


def _group_estimates(estimates: Array) -> list[tuple[int, int]]:
    """Return ranges of eigenvalues so near each other that they are refined together."""
    max_distances = np.minimum(_GROUPING_DISTANCE, 0.25 / np.arange(2, len(estimates) + 1))
    split_indices = np.flatnonzero(np.diff(estimates) > max_distances * estimates[1:]) + 1
    return list(pairwise([0, *split_indices.tolist(), len(estimates)]))


def _merge_groups(
    groups: list[tuple[int, int]],
    group_modes: list[list[Eigenfunction]],
    estimates: Array,
    min_gap: float,
) -> list[tuple[int, int]]:
    """Merge neighbouring groups that found the same, passed each other, or passed their bound."""
    merged_groups = [groups[0]]
    for number in range(1, len(groups)):
        first, last = groups[number]
        previous_value, current = group_modes[number - 1][-1].value, group_modes[number]
        is_same = current[0].value - previous_value <= min_gap * previous_value
        has_passed = previous_value > estimates[first - 1] * (1 + min_gap)
        if number == len(groups) - 1:
            has_passed |= current[-1].value > estimates[last - 1] * (1 + min_gap)
        if is_same or has_passed:
            merged_groups[-1] = (merged_groups[-1][0], last)
        else:
            merged_groups.append(groups[number])
    return merged_groups


_MAX_EDGES, _REFINEMENTS = 1_000_000, 4  # unknowns of a count; how often it is tried finer


def _prove_complete(
    plan: Polygon, modes: list[Eigenfunction], max_eigenvalue: float, following: float
) -> float:
    """Return the value up to which no eigenvalue is missing, 0 where the count is too large.

    With m Crouzeix-Raviart eigenvalues below s, the next true one exceeds s / (1 + slack s).
    """
    last = max(modes[-1].value * (1 + modes[-1].error), max_eigenvalue)
    target, count = last + 0.1 * (following - last), 0
    longest = edge_for(0.5 * (following - last) / target**2)
    for _ in range(_REFINEMENTS):
        if 6 * plan.area / longest**2 > _MAX_EDGES:
            return 0.0
        filling = Triangulation.of(plan.corners, longest)
        count = filling.assemble_nonconforming().count(target / (1 - filling.slack * target))
        if count == len(modes):
            return target
        if count < len(modes):
            break
        longest *= np.sqrt(0.5)
    raise SolverError(
        f"{len(modes)} modes of this polygon were found where finite elements count {count}: "
        "change the band's end slightly, or move corners that nearly meet"
    )


def _pack(basis: Basis, modes: list[Eigenfunction], proved_to: float) -> LaplacianSpectrum:
    forms = PolygonForms(
        corners=basis.plan.corners,
        centres=basis.centres,
        counts=basis.counts,
        sources=basis.sources,
        wavenumbers=np.array([mode.wavenumber for mode in modes]),
        coefficients=np.array([mode.coefficients for mode in modes]).reshape(-1, basis.size),
    )
    return LaplacianSpectrum(
        values=np.array([mode.value for mode in modes]),
        errors=np.array([mode.error for mode in modes]),
        forms=forms,
        proved_to=proved_to,
    )


# A few minutes in simple polygons; each mode takes longer, the more there are.
_MAX_MODES = 1000


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class PolygonMembrane(Shape):
    """A membrane under tension, held along a polygon that does not cross itself.

    Parameters
    ----------
    corners : sequence of (x, y)
        Corners in order, in either direction, m.
    thickness : float
        Thickness, m.
    tension : float
        Tension, N/m, equal in all directions.

    Raises
    ------
    OptionError
        On a thickness or tension that is not positive, fewer than three corners, repeated ones,
        edges that meet, numbers that are not finite.

    Notes
    -----
    Frequencies are sqrt(lambda tension / (density thickness)) / (2 pi), lambda the eigenvalues of
    the Laplacian in the polygon. The method of particular solutions finds them with a bound of
    each one's error (Betcke & Trefethen 2005; Moler & Payne 1968): Fourier-Bessel functions
    J_nu(k r) sin(nu theta) about the corners where eigenfunctions are not smooth and, where these
    do not suffice, fundamental solutions Y_0 about points outside (Barnett & Betcke 2008).

    That none is missing or doubled is proved by counts. There are at least as many eigenvalues as
    were found: each lies in the interval of a function's error, and functions whose values are
    nearer than 30 errors are refined as one orthonormal set. There are no more below a value just
    above the highest one found: so Crouzeix-Raviart elements tell, whose eigenvalues, corrected by
    their size, bound the true ones from below (Carstensen & Gedicke 2014; Liu 2015), counted by
    the inertia of their matrix. This holds up to rounding, and to bounds of errors that take
    the largest value on the boundary from samples; ``details`` of the vibration tell up to which
    frequency the proof reaches, 0 where it was too large to try.

    Places: "top" (also "middle"): the place farthest from all edges, the one nearest the middle of
    the box where several are; "edge" and "corner": 1 % of the extent off the middle of the longest
    edge and off the corner farthest from "top".

    Examples
    --------
    >>> drum = PolygonMembrane.l_shape(side=0.2, thickness=0.00025, tension=3000.0)
    >>> film = Material(density=1390.0, youngs_modulus=4.5e9, poisson_ratio=0.38)
    >>> drum.vibration(film, 350.0).frequencies.round(2)
    array([229.56, 288.24, 328.5 ])
    """

    corners: Pairs
    thickness: float
    tension: float

    tensioned: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require_length("thickness of the membrane", self.thickness)
        require_tension("membrane", self.tension)
        object.__setattr__(self, "corners", as_points("the polygon", self.corners))
        try:
            check_loops((self._loop,))
        except MeshError as error:
            raise OptionError(str(error)) from error

    @classmethod
    @checked
    def l_shape(cls, *, side: float, thickness: float, tension: float) -> PolygonMembrane:
        """Make the L-shape of three squares in the quadrant x, y > 0.

        Parameters
        ----------
        side : float
            Side of each square, m.
        thickness : float
            Thickness, m.
        tension : float
            Tension, N/m, equal in all directions.

        Returns
        -------
        PolygonMembrane
            The membrane.

        Raises
        ------
        OptionError
            On numbers that are not positive and finite.
        """
        require_length("side of the L", side)
        units = ((0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2))
        corners = tuple((side * x, side * y) for x, y in units)
        return cls(corners=corners, thickness=thickness, tension=tension)

    @property
    def _loop(self) -> Array:
        return np.array(self.corners, dtype=np.float64)

    @property
    def _plan(self) -> Polygon:
        return plan_of(self._loop)

    @property
    def geometry(self) -> Sheet:
        """Surface of the membrane, and places on it by name."""
        return Sheet(self._plan, self.thickness)

    def vibration(self, material: Material, highest: float) -> Vibration:
        """Compute all modes up to a frequency.

        Parameters
        ----------
        material : Material
            Material of the body.
        highest : float
            Upper limit of the frequencies, Hz.

        Returns
        -------
        Vibration
            Frequencies and shapes of the modes.

        Raises
        ------
        OptionError
            When there are too many.
        SolverError
            When near modes cannot be separated.
        """
        return self._vibration(material, highest, silent)

    def _vibration(self, material: Material, highest: float, progress: Progress) -> Vibration:
        speed = float(np.sqrt(self.tension / (material.density * self.thickness)))
        max_eigenvalue = np.square(2 * np.pi * highest / speed)
        count = estimate_count(self._plan, max_eigenvalue)
        if count > _MAX_MODES:
            raise OptionError(
                f"about {count:.0f} modes lie below {rounded(highest)} Hz, and {_MAX_MODES} can be "
                "had: check the lengths (m), or end the band at "
                f"{np.floor(highest * np.sqrt(_MAX_MODES / count)):.0f} Hz or lower"
            )
        eigenmodes = spectrum(self._loop, max_eigenvalue, progress)
        wavenumbers = np.sqrt(eigenmodes.values)
        max_wavenumber = np.append(np.sqrt(max_eigenvalue), wavenumbers)[-1]
        return Vibration(
            frequencies=wavenumbers * speed / (2 * np.pi),
            forms=eigenmodes.forms,
            poisson_slopes=np.zeros(len(wavenumbers)),
            errors=eigenmodes.errors,
            half_wave=float(np.pi / max_wavenumber),
            method="particular solutions, counted by nonconforming finite elements",
            references=("betcke2005", "moler1968", "barnett2008", "carstensen2014", "liu2015"),
            details={
                "functions a mode": int(eigenmodes.forms.coefficients.shape[1]),
                "fundamental solutions among them": len(eigenmodes.forms.sources),
                "proved complete up to (Hz)": float(
                    np.sqrt(eigenmodes.proved_to) * speed / (2 * np.pi)
                ),
            },
        )

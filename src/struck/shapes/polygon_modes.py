"""All eigenvalues of a membrane held along a polygon up to a bound: found, refined and counted.

Quadratic elements tell roughly where the eigenvalues lie and how many there are at least;
particular solutions refine each with a bound of its error; Crouzeix-Raviart elements prove that
there are no more.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from struck.errors import SolverError
from struck.shapes.fourier_bessel import Basis, PolygonForms
from struck.shapes.particular_solutions import Found, Trial, refined
from struck.shapes.plan_elements import Triangulation, edge_for
from struck.shapes.plan_nodes import around
from struck.shapes.polygon import Plan, plan_of

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spectrum:
    """Eigenvalues of the Laplacian in a polygon, held along its edges.

    Parameters
    ----------
    values : array (M,)
        Ascending, 1/m^2.
    errors : array (M,)
        Each lies within this share of itself of a true eigenvalue.
    forms : PolygonForms
        The eigenfunctions, with mean squares of 1.
    proved_to : float
        Up to here it is proved that no eigenvalue is missing, 1/m^2; 0 where it is not.
    """

    values: Array
    errors: Array
    forms: PolygonForms
    proved_to: float


def spectrum(corners: Array, highest: float) -> Spectrum:
    """Return all eigenvalues up to `highest`, 1/m^2, of a polygon (n, 2), m.

    Raises
    ------
    SolverError
        When as many eigenvalues as there must be cannot be told apart, or counted.
    """
    plan = plan_of(corners)
    rough = _upper_bounds(plan, highest)
    rough = rough[: _cut(rough, highest) + 2]
    if len(rough) < 2:
        return _packed(plan, None, [], 0.0)
    basis, trial = _chosen(plan, rough[:-1])
    found = _all(trial, rough[:-1])
    proved_to = _proved(plan, found, highest, float(rough[-1]))
    return _packed(plan, basis, [each for each in found if each.value <= highest], proved_to)


def expected(plan: Plan, highest: float) -> float:
    """Return about how many eigenvalues lie below a value, 1/m^2 (Weyl; Ivrii 1980)."""
    corners = np.sum((np.pi**2 - plan.angles**2) / (24 * np.pi * plan.angles))
    rim = plan.lengths.sum() * np.sqrt(highest)
    return float((plan.area * highest - rim) / (4 * np.pi) + corners)


_SPARE = 4  # eigenvalues above the bound, and a twentieth: the widest gap there ends the search
_PHASE = 1.3  # of a wave along the longest edge of an element, for a hundred eigenvalues


def _upper_bounds(plan: Plan, highest: float) -> Array:
    """Return eigenvalues of quadratic elements up to somewhat above a value."""
    count = max(expected(plan, highest), 1.0)
    above = highest + (_SPARE + count / 20 + 3) * 4 * np.pi / plan.area
    finer = min(1.0, (100 / count) ** 0.25)
    longest = min(_PHASE * finer / np.sqrt(above), float(plan.reaches.max()) / 16)
    return Triangulation.of(plan.corners, longest).quadratic().below(above)


def _cut(rough: Array, highest: float) -> int:
    """Return the number of the last eigenvalue below the widest gap above `highest`."""
    least = max(int(np.searchsorted(rough, highest * (1 + _ROUGH))) - 1, 0)
    some = rough[least : least + _SPARE + 2 + least // 20]
    gaps = some[1:] - np.maximum(some[:-1], highest)
    return least + int(np.argmax(gaps)) if len(gaps) else len(rough)


_ROUGH = 2e-3  # relative error of rough eigenvalues, seldom reached
# Distances of the sources from the edges, in parts of area / perimeter, and near corners, in
# parts of their clearance: none at first, then ever nearer.
_DISTANCES = ((0.0, 0.0), (1.5, 0.5), (1.5, 0.25), (0.75, 0.12))
_GOOD = 1e-8  # error at which no richer basis is tried
_MOST_FUNCTIONS = 1200


def _chosen(plan: Plan, rough: Array) -> tuple[Basis, Trial]:
    """Return the basis that serves the lowest and the most secluded high eigenvalue best."""
    gaps = np.diff(rough, prepend=0.0, append=np.inf)
    secluded = np.minimum(gaps[:-1], gaps[1:])
    probe = len(rough) // 2 + int(np.argmax(secluded[len(rough) // 2 :]))
    best: tuple[float, Basis, Trial] | None = None
    for basis in _candidates(plan, float(np.sqrt(rough[-1]))):
        trial = Trial(basis)
        near = [refined(trial, float(rough[at]), 1, _LEAST_APART)[0] for at in (0, probe)]
        error = max(each.error for each in near)
        if best is None or error < best[0]:
            best = (error, basis, trial)
        if error <= _GOOD:
            break
    if best is None:
        raise SolverError(_TOO_MANY.format(len(rough), _MOST_FUNCTIONS))
    return best[1:]


_TOO_MANY = "{} modes of this polygon need more than {} functions: lower the band's end"
_SOURCES_A_WAVE = 5
# Orders about corners beyond those of waves, without sources and with them; and at least without.
_STEEP, _STEEP_NEAR, _LEAST_ORDER = 20, 14, 60


def _candidates(plan: Plan, wavenumber: float) -> Iterator[Basis]:
    """Return ever richer bases."""
    centres = plan.singular if len(plan.singular) else np.array([0])
    for farthest, near in _DISTANCES:
        sources = np.zeros((0, 2))
        orders = np.maximum(_STEEP + wavenumber * plan.reaches, _LEAST_ORDER)
        if farthest:
            # Sources make up what is smooth: corners serve their neighbourhood alone.
            distance = farthest * plan.area / plan.lengths.sum()
            sources = around(plan, distance, near, 2 * np.pi / (_SOURCES_A_WAVE * wavenumber))
            orders = np.full(len(orders), _STEEP_NEAR + wavenumber * distance)
        basis = Basis(
            plan=plan,
            centres=centres,
            counts=np.ceil((orders / plan.powers)[centres]).astype(np.int64),
            sources=sources,
            highest=1.01 * wavenumber,
        )
        if basis.size <= _MOST_FUNCTIONS:
            yield basis


_ATTEMPTS = 5
# Relative distance from which functions are orthogonal by themselves: in errors, and bounds.
_ERRORS_APART, _LEAST_APART, _MOST_APART = 30.0, 1e-8, 1e-5
_MOST_ERROR = 1e-3  # beyond, what was found is no mode
_NEAR = 5e-3  # relative distance of rough eigenvalues that are refined together at first


def _all(trial: Trial, rough: Array) -> list[Found]:
    """Refine all rough eigenvalues, near ones together; where two meet, both together again."""
    groups, apart = _grouped(rough), _LEAST_APART
    done: dict[tuple[int, int], list[Found]] = {}
    for _ in range(_ATTEMPTS):
        for group in groups:
            if group not in done:
                middle = float(rough[slice(*group)].mean())
                done[group] = refined(trial, middle, group[1] - group[0], apart)
        found = [done[group] for group in groups]
        errors = [each.error for part in found for each in part]
        apart = float(np.clip(_ERRORS_APART * max(errors), _LEAST_APART, _MOST_APART))
        merged = _merged(groups, found, rough, apart)
        if merged == groups and max(errors) < _MOST_ERROR:
            return [each for part in found for each in part]
        groups = merged
    raise SolverError(
        f"modes {groups[0][0] + 1} to {groups[-1][1]} of this polygon cannot be told apart: lower "
        "the band's end, or move corners that nearly meet"
    )


def _grouped(rough: Array) -> list[tuple[int, int]]:
    """Return ranges of eigenvalues too near each other to start from one by one."""
    near = np.minimum(_NEAR, 0.25 / np.arange(2, len(rough) + 1))
    starts = np.flatnonzero(np.diff(rough) > near * rough[1:]) + 1
    ends = [0, *starts.tolist(), len(rough)]
    return list(pairwise(ends))


def _merged(
    groups: list[tuple[int, int]], found: list[list[Found]], rough: Array, apart: float
) -> list[tuple[int, int]]:
    """Merge neighbouring groups that found the same, passed each other, or passed their bound."""
    merged = [groups[0]]
    for number in range(1, len(groups)):
        first, last = groups[number]
        before, here = found[number - 1][-1].value, found[number]
        met = here[0].value - before <= apart * before
        passed = before > rough[first - 1] * (1 + apart)
        if number == len(groups) - 1:
            passed |= here[-1].value > rough[last - 1] * (1 + apart)
        if met or passed:
            merged[-1] = (merged[-1][0], last)
        else:
            merged.append(groups[number])
    return merged


_MOST_EDGES, _FINER = 1_000_000, 4  # unknowns of a count; how often it is tried finer


def _proved(plan: Plan, found: list[Found], highest: float, following: float) -> float:
    """Return up to where no eigenvalue can be missing, 0 where the count is too large to take.

    With m Crouzeix-Raviart eigenvalues below s, the next true one exceeds s / (1 + slack s).
    """
    last = max(found[-1].value * (1 + found[-1].error), highest)
    target, count = last + 0.1 * (following - last), 0
    longest = edge_for(0.5 * (following - last) / target**2)
    for _ in range(_FINER):
        if 6 * plan.area / longest**2 > _MOST_EDGES:
            return 0.0
        filling = Triangulation.of(plan.corners, longest)
        count = filling.nonconforming().count(target / (1 - filling.slack * target))
        if count == len(found):
            return target
        if count < len(found):
            break
        longest *= np.sqrt(0.5)
    raise SolverError(
        f"{len(found)} modes of this polygon were found where finite elements count {count}: "
        "change the band's end slightly, or move corners that nearly meet"
    )


def _packed(plan: Plan, basis: Basis | None, found: list[Found], proved_to: float) -> Spectrum:
    size = basis.size if basis else 0
    coefficients = np.array([each.coefficients for each in found]).reshape(len(found), size)
    values = np.array([each.value for each in found])
    forms = PolygonForms(
        corners=plan.corners,
        centres=basis.centres if basis else np.zeros(0, np.int64),
        counts=basis.counts if basis else np.zeros(0, np.int64),
        sources=basis.sources if basis else np.zeros((0, 2)),
        wavenumbers=np.array([each.wavenumber for each in found]),
        coefficients=coefficients,
    )
    errors = np.array([each.error for each in found])
    return Spectrum(values=values, errors=errors, forms=forms, proved_to=proved_to)

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

from struck.errors import MeshError, OptionError, SolverError
from struck.model.arrays import Array, checked
from struck.model.material import Material
from struck.model.provenance import Progress, silent
from struck.shapes.particular_solutions import Basis, Found, PolygonForms, Trial, refined
from struck.shapes.polygon import Polygon, Triangulation, around, edge_for, plan_of
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


def spectrum(corners: Array, highest: float, progress: Progress = silent) -> LaplacianSpectrum:
    """Return all eigenvalues up to `highest`, 1/m^2, of a polygon (n, 2), m."""
    plan = plan_of(corners)
    rough = _upper_bounds(plan, highest, progress)
    rough = rough[: _cut(rough, highest) + 2]
    if len(rough) < 2:
        none = np.zeros(0, np.int64)
        empty = Basis(plan=plan, centres=none, counts=none, sources=np.zeros((0, 2)), highest=0.0)
        return _packed(empty, [], 0.0)
    basis, trial = _chosen(plan, rough[:-1])
    found = _all(trial, rough[:-1], progress)
    progress("proving that no mode is missing", 0.0)
    proved_to = _proved(plan, found, highest, float(rough[-1]))
    return _packed(basis, [each for each in found if each.value <= highest], proved_to)


def expected(plan: Polygon, highest: float) -> float:
    """Return about how many eigenvalues lie below a value, 1/m^2 (Weyl; Ivrii 1980)."""
    corners = np.sum((np.pi**2 - plan.angles**2) / (24 * np.pi * plan.angles))
    rim = plan.lengths.sum() * np.sqrt(highest)
    return float((plan.area * highest - rim) / (4 * np.pi) + corners)


_SPARE = 4  # eigenvalues above the bound, and a twentieth: the widest gap there ends the search
_PHASE = 1.3  # of a wave along the longest edge of an element, for a hundred eigenvalues


def _upper_bounds(plan: Polygon, highest: float, progress: Progress) -> Array:
    """Return eigenvalues of quadratic elements up to somewhat above a value."""
    count = max(expected(plan, highest), 1.0)
    above = highest + (_SPARE + count / 20 + 3) * 4 * np.pi / plan.area
    finer = min(1.0, (100 / count) ** 0.25)
    longest = min(_PHASE * finer / np.sqrt(above), float(plan.reaches.max()) / 16)
    return Triangulation.of(plan.corners, longest).quadratic().below(above, progress)


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


def _chosen(plan: Polygon, rough: Array) -> tuple[Basis, Trial]:
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


def _candidates(plan: Polygon, wavenumber: float) -> Iterator[Basis]:
    """Yield bases of more and more particular solutions."""
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


def _all(trial: Trial, rough: Array, progress: Progress = silent) -> list[Found]:
    """Refine all rough eigenvalues, near ones together; where two meet, both together again."""
    groups, apart = _grouped(rough), _LEAST_APART
    done: dict[tuple[int, int], list[Found]] = {}
    for _ in range(_ATTEMPTS):
        for group in groups:
            progress("refining the modes", group[0] / len(rough))
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
    first, last = max(done, key=lambda group: max(each.error for each in done[group]))
    raise SolverError(
        f"modes {first + 1} to {last} of this polygon cannot be told apart: lower "
        "the band's end, or move corners that nearly meet"
    )


def _grouped(rough: Array) -> list[tuple[int, int]]:
    """Return ranges of eigenvalues so near each other that they are refined together."""
    near = np.minimum(_NEAR, 0.25 / np.arange(2, len(rough) + 1))
    starts = np.flatnonzero(np.diff(rough) > near * rough[1:]) + 1
    return list(pairwise([0, *starts.tolist(), len(rough)]))


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


def _proved(plan: Polygon, found: list[Found], highest: float, following: float) -> float:
    """Return the value up to which no eigenvalue is missing, 0 where the count is too large.

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


def _packed(basis: Basis, found: list[Found], proved_to: float) -> LaplacianSpectrum:
    forms = PolygonForms(
        corners=basis.plan.corners,
        centres=basis.centres,
        counts=basis.counts,
        sources=basis.sources,
        wavenumbers=np.array([each.wavenumber for each in found]),
        coefficients=np.array([each.coefficients for each in found]).reshape(-1, basis.size),
    )
    return LaplacianSpectrum(
        values=np.array([each.value for each in found]),
        errors=np.array([each.error for each in found]),
        forms=forms,
        proved_to=proved_to,
    )


# A few minutes in simple polygons; each mode takes longer, the more there are.
_MOST_MODES = 1000


@checked
@dataclass(frozen=True, slots=True, kw_only=True)
class PolygonMembrane(Shape):
    """A membrane under tension, held along a polygon that does not cross itself.

    Parameters
    ----------
    corners : sequence of (x, y)
        In either direction round, m.
    thickness : float
        m.
    tension : float
        N/m, the same everywhere and in every direction.

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
    the inertia of their matrix. This holds but for rounding, and for bounds of errors that take
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
        """Make the L-shape: three squares of a `side`, m, in the quadrant x, y > 0.

        `thickness`, m, and `tension`, N/m, as in the class.

        Raises
        ------
        OptionError
            On numbers that are not positive and finite.
        """
        require_length("side of the L", side)
        turns = ((0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2))
        corners = tuple((side * x, side * y) for x, y in turns)
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
        """Return every mode up to `highest` Hz.

        Raises
        ------
        OptionError
            When there are too many.
        SolverError
            When near modes cannot be told apart.
        """
        return self._vibration(material, highest, silent)

    def _vibration(self, material: Material, highest: float, progress: Progress) -> Vibration:
        speed = float(np.sqrt(self.tension / (material.density * self.thickness)))
        bound = np.square(2 * np.pi * highest / speed)
        count = expected(self._plan, bound)
        if count > _MOST_MODES:
            raise OptionError(
                f"about {count:.0f} modes lie below {highest:g} Hz, and {_MOST_MODES} can be had: "
                f"check the lengths (m), or end the band at "
                f"{np.floor(highest * np.sqrt(_MOST_MODES / count)):.0f} Hz or lower"
            )
        found = spectrum(self._loop, bound, progress)
        wavenumbers = np.sqrt(found.values)
        shortest = np.append(np.sqrt(bound), wavenumbers)[-1]
        return Vibration(
            frequencies=wavenumbers * speed / (2 * np.pi),
            forms=found.forms,
            poisson_slopes=np.zeros(len(wavenumbers)),
            errors=found.errors,
            half_wave=float(np.pi / shortest),
            method="particular solutions, counted by nonconforming finite elements",
            references=("betcke2005", "moler1968", "barnett2008", "carstensen2014", "liu2015"),
            details={
                "functions a mode": int(found.forms.coefficients.shape[1]),
                "fundamental solutions among them": len(found.forms.sources),
                "proved complete up to (Hz)": float(np.sqrt(found.proved_to) * speed / (2 * np.pi)),
            },
        )

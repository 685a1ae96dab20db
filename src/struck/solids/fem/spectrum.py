"""All eigenpairs below a bound, a slice of the spectrum at a time.

One factorisation K - shift M = L D L^T serves twice: its inertia counts the eigenvalues below the
shift, and block Lanczos with it finds those on both sides. The counts at two shifts then give
the number between them, so that none is missed and none is taken twice (Grimes, Lewis
& Simon 1994, section 3).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse

from struck.core import machine
from struck.errors import MeshError, NoModeError, SolverError, rounded
from struck.model.arrays import Array
from struck.model.provenance import Progress, silent
from struck.solids.fem import factorisation
from struck.solids.fem.assembly import System
from struck.solids.fem.factorisation import Factor, Factoriser
from struck.solids.fem.lanczos import Eigenpairs, Mass, block_lanczos, solve_dense


def require_complete(values: Array, max_value: float, expected_count: int) -> None:
    """Raise SolverError unless as many eigenvalues, in order, were found as inertia counts."""
    value_count = int(np.count_nonzero(values <= max_value))
    if value_count != expected_count or np.any(np.diff(values) < 0):
        raise SolverError(
            f"{value_count} modes were found but {expected_count} exist up to the band's end: "
            "change band= slightly, or report this body"
        )


def require_one_piece(values: Array, max_value: float) -> None:
    """Raise MeshError when some motion has no restoring force."""
    loose = int(np.count_nonzero(values < 1e-10 * max_value))
    if loose:
        raise MeshError(
            f"{loose} parts of the body hang together by a point or an edge and swing freely: "
            "use a finer lattice (accuracy=), or a thicker wall"
        )


def largest_residual(system: System, pairs: Eigenpairs) -> float:
    """Return the largest |K x - lambda M x| / |K x| of the pairs."""
    lower, mass = system.shifted(0.0), Mass(system.mass_matrix())
    upper = sparse.tril(lower, -1).T
    max_ratio = 0.0
    # A few at a time: a slice's vectors are large enough once.
    for start in range(0, len(pairs.values), 16):
        batch = slice(start, start + 16)
        vectors = np.ascontiguousarray(pairs.vectors[:, batch])
        push = lower @ vectors + upper @ vectors
        residuals = push - (mass @ vectors) * pairs.values[batch]
        ratios = np.linalg.norm(residuals, axis=0) / np.linalg.norm(push, axis=0)
        max_ratio = max(max_ratio, float(ratios.max()))
    return max_ratio


SLICE_LIMIT = 200  # modes of one factorisation; beyond, keeping all vectors apart takes over
_MAX_ATTEMPTS = 12
_SPLIT_TOLERANCE = 1e-7  # fraction of equal eigenvalues by which they may come out apart


@dataclass(frozen=True, slots=True, kw_only=True)
class Shift:
    """A factorised K - value M, and how many elastic eigenvalues lie below."""

    value: float
    below: int
    factor: Factor


@dataclass(frozen=True, slots=True, kw_only=True)
class EigenvalueCount:
    """Below `value` lie `count` elastic eigenvalues."""

    value: float
    count: int


class Spectrum:
    """The elastic eigenpairs of a body; its rigid motions `known` (n, k) are not counted."""

    def __init__(
        self,
        system: System,
        known: Array,
        factorise: Factoriser,
        limit: int = SLICE_LIMIT,
        progress: Progress = silent,
    ) -> None:
        self._system = system
        self._known = known
        self._factorise = factorise
        self._limit = max(limit, 4)
        self._progress = progress
        self._done_fraction = 0.0
        self._reported_fraction = 0.0
        self._mass = Mass(system.mass_matrix())

    def shift(self, value: float) -> Shift:
        """Factorise at a shift; SolverError when it lies on an eigenvalue too exactly."""
        self._tell("solving for modes", self._done_fraction)
        for nudge in (0.0, 1e-6, -1e-6):
            try:
                factor = self._factorise(self._system.shifted(value * (1 + nudge)))
            except SolverError as error:
                last = error
            else:
                below = max(factor.negative - self._known.shape[1], 0)
                return Shift(value=value * (1 + nudge), below=below, factor=factor)
        raise last

    def _tell(self, stage: str, fraction: float) -> None:
        # Slices that turn out shorter than planned must not turn progress back.
        self._reported_fraction = max(self._reported_fraction, fraction)
        self._progress(stage, self._reported_fraction)

    def near(
        self,
        shift: Shift,
        below: int,
        above: int,
        fraction_of_work: float = 1.0,
        min_value: float = -np.inf,
    ) -> Eigenpairs:
        """Return the nearest eigenpairs, `below` and `above` a shift, none below `min_value`."""
        # `fraction_of_work` is their part of all the work, for the progress.
        done_before = self._done_fraction
        pairs = block_lanczos(
            shift.factor.solve,
            self._mass,
            shift.value,
            above,
            self._known,
            lambda fraction: self._tell(
                "solving for modes", done_before + fraction * fraction_of_work
            ),
            below=below,
            min_value=min_value,
        )
        self._done_fraction = min(done_before + fraction_of_work, 1.0)
        return pairs

    def up_to(self, end: Shift) -> Iterator[Eigenpairs]:
        """Yield all eigenpairs below a shift, ascending: at once, or in slices when many."""
        if end.below <= self._limit:
            pairs = self.near(end, end.below, 0)
            del end  # and its factor with it
            yield pairs
            return
        goal = EigenvalueCount(value=end.value, count=end.below)
        del end
        yield from self._slices(goal)

    def _slices(self, goal: EigenvalueCount) -> Iterator[Eigenpairs]:
        """Yield the eigenpairs below each shift, once its inertia has confirmed their number."""
        # What a shift found above itself waits as `tail` for the next one's count.
        last, tail, cut = EigenvalueCount(value=-np.inf, count=0), _NONE, 0.0
        while last.count + len(tail.values) < goal.count:
            start = EigenvalueCount(value=cut, count=last.count + len(tail.values))
            shift = self._find_next_shift(start, goal)
            lower, upper = self._solve_around(start, shift, goal)
            if len(lower.values) and lower.values[0] <= cut:
                # The tail missed some, so all pairs between the shifts are computed from here.
                lower, tail = self._solve_between(last, shift), _NONE
            last = EigenvalueCount(value=shift.value, count=shift.below)
            del shift  # and its factor with it
            yield from (part for part in (tail, lower) if len(part.values))
            del lower
            tail, cut = _cut_at_gap(upper, last.value, goal.value, goal.count - last.count)
            del upper
            self._done_fraction = (last.count + len(tail.values)) / goal.count
        if len(tail.values):
            yield tail

    def _solve_around(
        self, start: EigenvalueCount, shift: Shift, goal: EigenvalueCount
    ) -> tuple[Eigenpairs, Eigenpairs]:
        """Return the eigenpairs between `start` and a shift, and further ones that fill a slice."""
        below = shift.below - start.count
        above = min(max(self._limit - below, self._limit // 4), goal.count - shift.below)
        if not below + above:
            return _NONE, _NONE
        # A quarter of what lies above may be left to the next slice.
        fraction_of_work = (below + 3 * above // 4) / goal.count
        pairs = self.near(shift, below, above, fraction_of_work, start.value)
        return _select_pairs(pairs, slice(below)), _select_pairs(pairs, slice(below, None))

    def _solve_between(self, last: EigenvalueCount, shift: Shift) -> Eigenpairs:
        pairs = self.near(shift, shift.below - last.count, 0, 0.0, last.value)
        if pairs.values[0] <= last.value:
            raise SolverError(
                f"{shift.below - last.count} modes exist between {_hertz(last.value):.6g} and "
                f"{_hertz(shift.value):.6g} Hz, but not all were found: change band= slightly, or "
                "report this body"
            )
        return pairs

    def _find_next_shift(self, start: EigenvalueCount, goal: EigenvalueCount) -> Shift:
        """Return the next shift, about half a slice of modes above the value reached."""
        target = start.count + min(self._limit, goal.count - start.count) / 2
        shift = self.shift(_predict_shift(target, start, goal))
        for _ in range(_MAX_ATTEMPTS):
            if shift.below - start.count <= 0.8 * self._limit:
                break
            farthest = EigenvalueCount(value=shift.value, count=shift.below)
            del shift  # and its factor with it
            shift = self.shift(_predict_shift(target, start, farthest))
        if shift.below < start.count:
            raise SolverError(
                f"{start.count} modes were found up to {_hertz(start.value):.6g} Hz but "
                f"{shift.below} counted up to {_hertz(shift.value):.6g} Hz: change band= "
                "slightly, or report this body"
            )
        return shift


_NONE = Eigenpairs(values=np.zeros(0), vectors=np.zeros((0, 0)))


def _predict_shift(target: float, start: EigenvalueCount, end: EigenvalueCount) -> float:
    """Return where the count should reach `target`: it grows as a power of the eigenvalue."""
    # Weyl's law: 1 in thin walls, which is the first guess; less in bars, more in lumps.
    power = 1.0
    if start.count:
        power = np.log(end.count / start.count) / np.log(end.value / start.value)
    value = end.value * (target / end.count) ** (1 / power)
    # Strictly between, however steep the count is.
    width = end.value - start.value
    return float(np.clip(value, start.value + 0.02 * width, end.value - 0.02 * width))


def _select_pairs(pairs: Eigenpairs, chosen: slice) -> Eigenpairs:
    # A copy, so that the rest can go.
    return Eigenpairs(values=pairs.values[chosen], vectors=pairs.vectors[:, chosen].copy())


def _cut_at_gap(
    pairs: Eigenpairs, min_value: float, end: float, left: int
) -> tuple[Eigenpairs, float]:
    """Return the pairs below `end`, or up to a gap when more are `left`, and where the cut lies."""
    # A cut through equal eigenvalues would leave their vectors unlike those of the next slice.
    values = pairs.values
    if not len(values):
        return pairs, min_value
    if values[-1] > end or len(values) == left:
        inside_count = int(np.searchsorted(values, end))
        return _select_pairs(pairs, slice(inside_count)), float(
            values[inside_count - 1]
        ) if inside_count else min_value
    gaps = np.diff(values, prepend=min_value)
    last = 3 * len(values) // 4
    while last and gaps[last:].max() < _SPLIT_TOLERANCE * values[-1]:
        last //= 2
    gap_index = last + int(np.argmax(gaps[last:]))
    return _select_pairs(pairs, slice(gap_index)), float(values[gap_index] - gaps[gap_index] / 2)


def _hertz(value: float) -> float:
    return float(np.sqrt(max(value, 0.0)) / (2 * np.pi))


DENSE_LIMIT = 1200


@dataclass(frozen=True, slots=True, kw_only=True)
class Solver:
    """The method by which eigenpairs are computed."""

    lumped: bool = False  # mass; linear tetrahedra only (2002, eq. 15)
    backend: str = "auto"  # sparse factorisation: "auto", "rslab" or "superlu"
    dense_limit: int = DENSE_LIMIT  # number of unknowns up to which LAPACK takes the whole matrix
    slice_limit: int = SLICE_LIMIT  # more modes are found slice by slice
    coarser: str = ""  # settings that need less memory, which messages offer


class Search:
    """The elastic eigenpairs of one system up to `bound`, (rad/s)^2: counted, then found."""

    # `motions` (n, k): rigid ones, k = 0 if the body is held; `shown`: numbers stored per mode.

    def __init__(
        self,
        *,
        system: System,
        motions: Array,
        bound: float,
        solver: Solver,
        shown: int = 0,
        progress: Progress = silent,
    ) -> None:
        self.system = system
        self.bound = bound
        self.solver = solver
        self.progress = progress
        self.forecast = 0
        self.counted = 0
        self._motions = motions
        self._shown = shown
        self._factorise = Factoriser(solver.backend)
        self._spectrum = Spectrum(system, motions, self._factorise, solver.slice_limit, progress)

    @property
    def small(self) -> bool:
        """Whether the matrix is small enough for LAPACK as a whole."""
        return self.system.unknowns <= self.solver.dense_limit

    def pairs(self) -> Iterator[Eigenpairs]:
        """Yield all eigenpairs, ascending, a slice at a time."""
        self.progress("counting modes", 0.0)
        self._require_memory(modes=1)
        end = self._spectrum.shift(self.bound)
        self.counted = end.below
        if self.small:
            eigenpairs = solve_dense(
                *_dense_matrices(self.system), self.bound, self._motions.shape[1]
            )
            self._require_some(eigenpairs)
            yield eigenpairs
            return
        if not self.counted:
            self._require_some(self._spectrum.near(end, 0, 1))
        self._require_memory(modes=min(self.counted, self.solver.slice_limit))
        slices = self._spectrum.up_to(end)
        del end  # so that its factor can go
        yield from slices

    def _require_some(self, pairs: Eigenpairs) -> None:
        if not self.counted:
            min_frequency = np.sqrt(max(pairs.values[0], 0.0)) / (2 * np.pi)
            max_frequency = np.sqrt(self.bound) / (2 * np.pi)
            raise NoModeError(
                f"no mode lies below {rounded(max_frequency)} Hz: the lowest is at "
                f"{rounded(min_frequency, 4)} Hz; widen band=, or make the body larger, thinner or "
                "softer"
            )

    @cached_property
    def _plan(self) -> tuple[int, int]:
        return self._factorise.memory(self.system.shifted(self.bound))

    @cached_property
    def _free(self) -> int | None:
        """Bytes that were free before the first factorisation, which a forecast contains."""
        return machine.available()

    def _require_memory(self, modes: int) -> None:
        """Refuse a solve that exceeds the memory: its factorisation or its iteration."""
        if self.small:
            return
        peak, resident_bytes = self._plan
        self.forecast = factorisation.forecast(
            unknowns=self.system.unknowns,
            entries=self.system.entries,
            factor=peak,
            resident_bytes=resident_bytes,
            modes=modes,
            shown_numbers=self._shown * self.counted,
        )
        factorisation.require(self.forecast, self._free, self.solver.coarser)


def _dense_matrices(system: System) -> tuple[Array, Array]:
    lower = system.shifted(0.0).toarray()
    stiffness = lower + np.tril(lower, -1).T
    return stiffness, np.asarray(np.kron(system.mass_matrix().toarray(), np.eye(3)), np.float64)

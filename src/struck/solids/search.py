"""The search for all modes of a band: how many there are, whether it fits, and one by one."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from struck.errors import OptionError
from struck.progress import Progress, silent
from struck.solids import memory
from struck.solids.fem.assembly import System
from struck.solids.fem.factorisation import Factoriser
from struck.solids.fem.lanczos import Eigenpairs, dense
from struck.solids.fem.spectrum import SLICE_LIMIT, Spectrum

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
    slice_limit : int
        More modes than these are found slice by slice, each with its own factorisation.
    """

    lumped: bool = False
    backend: str = "auto"
    dense_limit: int = DENSE_LIMIT
    slice_limit: int = SLICE_LIMIT


class Search:
    """The elastic eigenpairs of one system up to a bound.

    Parameters
    ----------
    system : System
    motions : array (n, k)
        Its rigid motions; none of a body that is held.
    bound : float
        Largest eigenvalue, (rad/s)^2.
    solver : Solver
    shown : int
        Numbers that are kept of each mode to the end, for the forecast.
    progress : callable
        Told the stage and its fraction done.

    Attributes
    ----------
    counted : int
        How many inertia counts up to the bound, once the search has begun.
    forecast : int
        Bytes foretold; 0 where LAPACK takes the whole matrix.
    """

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
        """Whether LAPACK takes the whole matrix."""
        return self.system.unknowns <= self.solver.dense_limit

    def pairs(self) -> Iterator[Eigenpairs]:
        """Yield all eigenpairs, ascending, a slice at a time."""
        self.progress("count", 0.0)
        self._require_memory(modes=1)
        end = self._spectrum.shift(self.bound)
        self.counted = end.below
        if self.small:
            found = dense(*_full(self.system), self.bound, self._motions.shape[1])
            self._require_some(found)
            yield found
            return
        if not self.counted:
            self._require_some(self._spectrum.near(end, 0, 1))
        self._require_memory(modes=min(self.counted, self.solver.slice_limit))
        slices = self._spectrum.up_to(end)
        del end  # so that its factor can go
        yield from slices

    def _require_some(self, pairs: Eigenpairs) -> None:
        if not self.counted:
            lowest = np.sqrt(max(pairs.values[0], 0.0)) / (2 * np.pi)
            highest = np.sqrt(self.bound) / (2 * np.pi)
            raise OptionError(
                f"no mode lies below {highest:g} Hz: the lowest is at {lowest:.4g} Hz; widen "
                "band=, or make the body larger, thinner or softer"
            )

    @cached_property
    def _plan(self) -> tuple[int, int]:
        return self._factorise.memory(self.system.shifted(self.bound))

    def _require_memory(self, modes: int) -> None:
        """Refuse what does not fit: the factorisation before it, the iteration before that."""
        if self.small:
            return
        peak, kept = self._plan
        self.forecast = memory.forecast(
            unknowns=self.system.unknowns,
            entries=self.system.entries,
            factor=peak,
            kept=kept,
            modes=modes,
            shown=self._shown * self.counted,
        )
        memory.require(self.forecast)


def _full(system: System) -> tuple[Array, Array]:
    lower = system.shifted(0.0).toarray()
    stiffness = lower + np.tril(lower, -1).T
    mass = np.kron(system.mass_matrix().toarray(), np.eye(3))
    return stiffness, np.asarray(mass, np.float64)

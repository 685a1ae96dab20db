"""Gains as contact part times listener part: one simple mode is a table of rank one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from struck.errors import OptionError
from struck.model.arrays import Array, Complex, Index
from struck.model.survey import Survey

_SILENT = 1e-3  # drive below which nothing is known of a listener, however small the noise
_SWEEPS = 200
_SETTLED = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Separation:
    """Real contact parts and complex listener parts whose products come nearest to the gains.

    Parameters
    ----------
    drives : array (P, M)
        The largest of each mode is 1.
    outputs : array (Q, M), complex
    weights : array (Q, M)
        How much is known of each output: one over its variance, in any unit.
    rank_errors : array (M,)
        Distance of the gains from the products, root mean square over root mean square, corrected
        for how much was fitted; NaN where nothing is left to tell.
    drive_errors, output_errors : array (M,)
        Expected error of a part at half of its places, over its root mean square.
    """

    drives: Array
    outputs: Complex
    weights: Array
    rank_errors: Array
    drive_errors: Array
    output_errors: Array

    @classmethod
    def of(cls, survey: Survey) -> Separation:
        """Find them by alternating least squares, mode by mode.

        Where the survey has no errors, noise counts as equally strong in all modes, and as strong
        as what the products leave of the gains.

        Raises
        ------
        OptionError
            When recordings fall into groups that share neither contact nor listener.
        """
        table = _Table.of(survey)
        table.require_connected()
        drives, outputs = table.separated()
        known = table.listeners @ (table.weights * np.square(drives)[table.contact])
        loud = known > _SILENT**2 * table.listeners @ table.weights
        energies = np.square(np.abs(outputs))
        pushed = table.contacts @ (table.weights * energies[table.listener])
        variance = table.variance(drives, outputs) if survey.errors is None else 1.0
        return cls(
            drives=drives,
            outputs=outputs,
            weights=known,
            rank_errors=table.rank_errors(drives, outputs),
            drive_errors=_error(pushed, variance, drives**2),
            output_errors=_error(known * loud, variance, energies),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Table:
    """Recorded gains (n, M) with matrices that sum over recordings of a contact or a listener."""

    gains: Complex
    weights: Array
    contact: Index
    listener: Index
    contacts: sparse.csr_array
    listeners: sparse.csr_array

    @classmethod
    def of(cls, survey: Survey) -> _Table:
        contact, listener = survey.pairs.T
        errors = np.ones(survey.gains.shape) if survey.errors is None else survey.errors
        return cls(
            gains=survey.gains,
            weights=1 / np.square(errors),
            contact=contact,
            listener=listener,
            contacts=_sums(contact, len(survey.contacts)),
            listeners=_sums(listener, len(survey.listeners)),
        )

    @property
    def surplus(self) -> int:
        """How many more real numbers were recorded of a mode than its parts have."""
        unknowns = self.contacts.shape[0] + 2 * self.listeners.shape[0] - 1
        return 2 * len(self.gains) - unknowns

    def require_connected(self) -> None:
        reached = np.zeros(self.contacts.shape[0])
        reached[self.contact[0]] = 1
        for _ in reached:
            heard = self.listeners @ reached[self.contact] > 0
            reached = (self.contacts @ heard[self.listener] > 0).astype(float)
        lost = np.flatnonzero(self.contacts.sum(axis=1) * (reached == 0))
        if len(lost):
            raise OptionError(
                f"contact {lost[0] + 1} shares no listener with contact {self.contact[0] + 1}, not "
                "even by way of others: record one listener with all contacts"
            )

    def separated(self) -> tuple[Array, Complex]:
        """Return drives (P, M), the largest of each mode 1, and outputs (Q, M).

        For each mode it starts from the contact of which most was recorded, and spreads from there:
        where nothing is known yet, a part is 0 and counts for nothing.
        """
        energies = self.contacts @ (self.weights * np.square(np.abs(self.gains)))
        drives = (np.arange(len(energies))[:, None] == energies.argmax(axis=0)).astype(float)
        for _ in range(_SWEEPS):
            last, heard = drives, self._outputs(drives)[self.listener]
            agreement = self.contacts @ (self.weights * (heard.conj() * self.gains).real)
            powers = self.contacts @ (self.weights * np.square(np.abs(heard)))
            drives = agreement * _inverse(powers)
            drives = drives * _inverse(_leading(drives))
            if np.abs(drives - last).max() < _SETTLED:
                break
        return drives, self._outputs(drives)

    def variance(self, drives: Array, outputs: Complex) -> float:
        """Return that of the noise of a gain, alike in all modes; 0 where nothing tells."""
        rest = self.gains - drives[self.contact] * outputs[self.listener]
        if self.surplus <= 0:
            return 0.0
        return 2 * float(np.square(np.abs(rest)).sum()) / (self.surplus * rest.shape[1])

    def rank_errors(self, drives: Array, outputs: Complex) -> Array:
        if self.surplus <= 0:
            return np.full(drives.shape[1], np.nan)
        rest = self.gains - drives[self.contact] * outputs[self.listener]
        energies = (self.weights * np.square(np.abs(self.gains))).sum(axis=0)
        shares = (self.weights * np.square(np.abs(rest))).sum(axis=0) * _inverse(energies)
        return np.sqrt(shares * 2 * len(rest) / self.surplus)

    def _outputs(self, drives: Array) -> Complex:
        pushes = self.weights * drives[self.contact]
        known = self.listeners @ (pushes**2 / self.weights)
        return np.asarray(self.listeners @ (pushes * self.gains), np.complex128) * _inverse(known)


def _sums(owner: Index, count: int) -> sparse.csr_array:
    """Return the matrix (count, n) that sums what belongs to each owner."""
    ones, numbers = np.ones(len(owner)), np.arange(len(owner))
    return sparse.csr_array((ones, (owner, numbers)), shape=(count, len(owner)))


def _inverse(values: Array) -> Array:
    """Return one over each, 0 for 0: nothing known counts for nothing."""
    return np.where(values == 0, 0.0, 1 / np.where(values == 0, 1.0, values))


def _error(weights: Array, variance: float, powers: Array) -> Array:
    """Return the error at half of the places of a part (P, M) over its root mean square (M,)."""
    with np.errstate(divide="ignore", invalid="ignore"):
        variances = np.where(weights > 0, variance / weights, np.inf)
        shares = np.median(variances, axis=0) / powers.mean(axis=0)
    return np.sqrt(np.where(powers.any(axis=0), shares, np.inf))


def _leading(drives: Array) -> Array:
    """Return the drive of the largest absolute value of each mode (1, M)."""
    return np.take_along_axis(drives, np.abs(drives).argmax(axis=0)[None], axis=0)

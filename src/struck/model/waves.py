"""How strong each outgoing wave is, from what listeners heard: Bayesian regression by mode."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from struck.recordings.fields.evidence import shares
from struck.recordings.fields.outgoing import ORDER, degrees, near_field, real_harmonics

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Choice = NDArray[np.bool_]

NOISES = (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)
"""What the variance of the noise may be of the scale of the amplitudes."""
_DEGREES, _ANGULAR = degrees(ORDER)
_FREE = 100.0  # for the monopole: what a single listener heard must not shrink
_VARIANCES = np.where(_DEGREES == 0, _FREE, 1 / (1.0 + _DEGREES * (_DEGREES + 1)))
_POWERS = np.arange(1.0, ORDER + 2)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Law:
    """How waves of each harmonic go with the distance: powers r^-(k+1) with these factors.

    Parameters
    ----------
    coefficients : array (ORDER + 1, B, M or 1), complex
    """

    coefficients: Complex

    @classmethod
    def same(cls, reference: float) -> Law:
        """Keep directions at all distances: reference / r."""
        coefficients = np.zeros((ORDER + 1, len(_DEGREES), 1), np.complex128)
        coefficients[0] = reference
        return cls(coefficients=coefficients)

    @classmethod
    def waves(cls, reference: float, wave_numbers: Array) -> Law:
        """Solve the wave equation; of absolute value 1 at the reference distance, m."""
        inverse = (1 / wave_numbers) ** np.arange(ORDER + 1)[:, None, None]
        coefficients = near_field(ORDER)[:, _DEGREES, None] * inverse
        size = np.abs(np.einsum("kbm,k->bm", coefficients, reference**-_POWERS))
        return cls(coefficients=coefficients / size)

    def at(self, distances: Array) -> Complex:
        """Return the waves at distances (Q,): (M or 1, Q, B)."""
        return np.einsum("qk,kbm->mqb", distances[:, None] ** -_POWERS, self.coefficients)


def fit_waves(
    laws: Sequence[Law], places: Array, outputs: Complex, weights: Array, *, mirrored: bool
) -> Complex:
    """Fit waves of unknown degree and noise to outputs (Q, M) at places (Q, 3).

    Amplitudes are taken as normal random numbers whose variance falls with the degree as
    1 / (1 + l (l + 1)), that of the monopole being next to free. Law, highest degree and noise are
    averaged over by their evidence (C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for
    Machine Learning, MIT Press, 2006, chapters 2 and 5). There are never more harmonics than
    listeners.

    Parameters
    ----------
    weights : array (Q, M)
        What each output counts for.
    mirrored : bool
        Whether outputs are even in y.

    Returns
    -------
    array (ORDER + 1, B, M), complex
        Parts of r^-(k+1) Y_lm, as in `Waves`.
    """
    distances = np.linalg.norm(places, axis=1)
    harmonics = real_harmonics(places / distances[:, None], ORDER)
    usable = (_ANGULAR >= 0) | (not mirrored)
    choices = [usable & (order >= _DEGREES) for order in range(ORDER + 1)]
    choices = [each for each in choices if np.count_nonzero(each) <= len(places)]
    problems = [_Problem.of(harmonics * law.at(distances), outputs, weights) for law in laws]
    cases = list(product(range(len(laws)), choices, NOISES))
    fits = [problems[number].solved(chosen, noise) for number, chosen, noise in cases]
    believed = shares(np.stack([evidence for evidence, _ in fits]))
    parts = np.zeros((ORDER + 1, len(_DEGREES), outputs.shape[1]), np.complex128)
    for share, (number, chosen, _), (_, found) in zip(believed, cases, fits, strict=True):
        parts[:, chosen] += laws[number].coefficients[:, chosen] * (share * found.T)
    return parts


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Problem:
    """Normal equations of one law: matrices (M, B, B), right sides (M, B), energies (M,).

    Weights have the mean 1 over those above 0, of which there are `count` (M,).
    """

    matrices: Complex
    sides: Complex
    energies: Array
    count: Array

    @classmethod
    def of(cls, design: Complex, outputs: Complex, weights: Array) -> _Problem:
        count = np.maximum(np.count_nonzero(weights, axis=0), 1)
        even = (weights * count / np.maximum(weights.sum(axis=0), np.finfo(float).tiny)).T
        weighted = design.conj().transpose(0, 2, 1) * even[:, None]
        return cls(
            matrices=weighted @ design,
            sides=(weighted @ outputs.T[:, :, None])[:, :, 0],
            energies=(even * np.square(np.abs(outputs.T))).sum(axis=1),
            count=count,
        )

    def solved(self, chosen: Choice, noise: float) -> tuple[Array, Complex]:
        """Return evidence (M,) and amplitudes (M, B) of the chosen harmonics for one noise."""
        matrices = self.matrices[:, chosen][:, :, chosen] + noise * np.diag(1 / _VARIANCES[chosen])
        sides = self.sides[:, chosen]
        found = np.linalg.solve(matrices, sides[:, :, None])[:, :, 0]
        misfit = self.energies - (sides.conj() * found).real.sum(axis=1)
        spread = np.linalg.slogdet(matrices)[1] + np.log(_VARIANCES[chosen]).sum()
        unused = self.count - np.count_nonzero(chosen)
        tiny = np.finfo(np.float64).tiny
        evidence = -self.count * np.log(np.maximum(misfit, tiny) / noise)
        evidence -= spread + unused * np.log(noise)
        return evidence, np.asarray(found, np.complex128)

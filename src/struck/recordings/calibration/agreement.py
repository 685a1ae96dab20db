"""How well fitted modes agree with computed ones under some hypothesis, and a better hypothesis.

Expectation maximisation: how likely each pair is under a hypothesis, then the hypothesis that suits
these pairs best (A. P. Dempster, N. M. Laird and D. B. Rubin, Journal of the Royal Statistical
Society B 39, 1977).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.recordings.calibration.expected import GREATEST_RATIO, LEAST_RATIO, Expected
from struck.recordings.calibration.hypotheses import Hypotheses, densities
from struck.recordings.calibration.matchings import posteriors
from struck.recordings.calibration.partials import Partials

Array = NDArray[np.float64]
Index = NDArray[np.int64]

RATIO_PRIOR = 0.1
"""Standard deviation of Poisson's ratio about the model's own before anything was heard."""
# A scatter, and for how many pairs it counts: two or three alone never make it vanish.
_SCATTER, _SCATTER_PAIRS = 3e-4, 2.0
# A few modes lie farther off than the others, as theory or a support has it: share, and how far.
_STRAY, _ASTRAY = 0.05, 3e-3
# Shares found and false, and how many modes they count for: most modes are in both.
_FOUND, _FALSE, _SHARE_MODES = 0.8, 0.2, 10.0
_SHARES = (0.02, 0.98)
_LARGEST_STEP = 0.05
_BEYOND = 0.03  # how far beyond the ends of a list, in ln f, a partner may lie
_LARGEST_ODDS = np.exp(25.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """What H hypotheses make of M fitted and N computed modes.

    Parameters
    ----------
    pairs : array (H, M, N)
        How likely each pair is; computed modes in ascending order.
    regular : array (H, M, N)
        How likely each pair lies no farther off than most.
    order : array (H, N)
        Numbers of the computed modes in this order.
    apart : array (H, M, N)
        ln f0 as heard, less what is expected.
    slopes : array (H, N)
        Of the expected ln f0 over Poisson's ratio.
    sought, told : array (H,)
        How many computed modes could have been fitted, and fitted ones computed.
    likelihoods : array (H,)
        Logarithms, but for a constant.
    """

    pairs: Array
    regular: Array
    order: Index
    apart: Array
    slopes: Array
    sought: Array
    told: Array
    likelihoods: Array

    def over_modes(self) -> Array:
        """Return how likely each pair is (H, M, N), by the numbers of the computed modes."""
        numbered = np.zeros_like(self.pairs)
        np.put_along_axis(numbered, self.order[:, None], self.pairs, axis=2)
        return numbered


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Agreement:
    """Fitted modes beside computed ones.

    Parameters
    ----------
    heard : array (M,)
        ln f0 of the fitted modes, ascending.
    errors : array (M,)
        Their standard errors.
    crowd : array (M,)
        How many fitted modes there are around each for a unit of ln f.
    expected : Expected
        The computed modes.
    audible : array (N,)
        How far each of these can be expected to be heard, 0 to 1.
    """

    heard: Array
    errors: Array
    crowd: Array
    expected: Expected
    audible: Array

    @classmethod
    def of(cls, partials: Partials, expected: Expected, audible: Array) -> Agreement:
        """Put the fitted modes in order."""
        natural = partials.natural_frequencies
        order = np.argsort(natural, kind="stable")
        heard = np.log(natural[order])
        return cls(
            heard=heard,
            errors=(partials.frequency_errors / natural)[order],
            crowd=densities(heard),
            expected=expected,
            audible=audible,
        )

    def under(self, cases: Hypotheses) -> Evidence:
        """Return what hypotheses make of the modes."""
        logarithms, slopes = self.expected.logarithms(cases.ratios)
        logarithms = logarithms + cases.shifts[:, None]
        order = np.argsort(logarithms, axis=1, kind="stable")
        logarithms, slopes = (np.take_along_axis(a, order, axis=1) for a in (logarithms, slopes))
        apart = self.heard[:, None] - logarithms[:, None]
        chances = cases.found[:, None] * self.audible[order]
        odds, regular = self._odds(apart, cases)
        odds = odds * (chances / (1 - chances))[:, None]
        pairs, sums = posteriors(np.minimum(odds, _LARGEST_ODDS))
        low, high = self.heard[0] - _BEYOND, self.heard[-1] + _BEYOND
        within = (logarithms > low) & (logarithms < high)
        told = (self.heard < logarithms[:, -1:] + _BEYOND).sum(axis=1)
        alone = (np.log1p(-chances) * within).sum(axis=1) + np.log(cases.false) * told
        return Evidence(
            pairs=pairs,
            regular=pairs * regular,
            order=order,
            apart=apart,
            slopes=slopes,
            sought=(self.audible[order] * within).sum(axis=1),
            told=told.astype(np.float64),
            likelihoods=sums + alone + self._priors(cases),
        )

    def improved(self, cases: Hypotheses, evidence: Evidence) -> Hypotheses:
        """Return hypotheses that suit the evidence better."""
        steps = self._steps(cases, evidence)
        count = evidence.pairs.sum(axis=(1, 2))
        prior = _SHARE_MODES
        found = (count + prior * _FOUND) / (evidence.sought + prior)
        false = (evidence.told - count + prior * _FALSE) / (evidence.told + prior)
        return Hypotheses(
            shifts=cases.shifts + steps[0],
            ratios=np.clip(cases.ratios + steps[1], LEAST_RATIO, GREATEST_RATIO),
            scatters=self._scatters(cases, evidence),
            found=np.clip(found, *_SHARES),
            false=np.clip(false, *_SHARES),
        )

    def _odds(self, apart: Array, cases: Hypotheses) -> tuple[Array, Array]:
        """Return odds of pairs, all modes being found, and which share of them is regular."""
        variances = self._variances(cases)
        most = (1 - _STRAY) * _normal(apart, variances)
        some = _STRAY * _normal(apart, variances + _ASTRAY**2)
        either = most + some
        crowd = (cases.false[:, None] * self.crowd)[:, :, None]
        return either / crowd, most / np.maximum(either, np.finfo(float).tiny)

    def _variances(self, cases: Hypotheses) -> Array:
        return (cases.scatters[:, None] ** 2 + self.errors**2)[:, :, None]

    def _priors(self, cases: Hypotheses) -> Array:
        found = _FOUND * np.log(cases.found) + (1 - _FOUND) * np.log(1 - cases.found)
        false = _FALSE * np.log(cases.false) + (1 - _FALSE) * np.log(1 - cases.false)
        return _SHARE_MODES * (found + false) - self._strange(cases) ** 2 / 2

    def _strange(self, cases: Hypotheses) -> Array:
        """Return how far ratios are from the model's own, in standard deviations (H,)."""
        if not self.expected.follows:
            return np.zeros(len(cases))
        return (cases.ratios - self.expected.poisson_ratio) / RATIO_PRIOR

    def _steps(self, cases: Hypotheses, evidence: Evidence) -> tuple[Array, Array]:
        """Return the least squares of shift and ratio, each pair counting as far as it is likely.

        Poisson's ratio, when little heard depends on it, keeps to the model's own.
        """
        weights = evidence.regular / self._variances(cases)
        slopes, apart = evidence.slopes[:, None], evidence.apart
        plain, mixed, square, pull, turn = (
            (weights * term).sum(axis=(1, 2))
            for term in (1.0, slopes, slopes**2, apart, apart * slopes)
        )
        plain = plain + 1.0  # a case without pairs stays where it is
        square = square + 1 / RATIO_PRIOR**2
        turn = turn - self._strange(cases) / RATIO_PRIOR
        ratio = (plain * turn - mixed * pull) / (plain * square - mixed**2)
        ratio = np.clip(ratio, -_LARGEST_STEP, _LARGEST_STEP)
        return (pull - mixed * ratio) / plain, ratio

    def _scatters(self, cases: Hypotheses, evidence: Evidence) -> Array:
        """Return how far most lie about where they are expected, errors of fitting apart (H,)."""
        own = cases.scatters[:, None, None] ** 2
        share = own / self._variances(cases)
        squares = (share * evidence.apart) ** 2 + own * (1 - share)
        total = (evidence.regular * squares).sum(axis=(1, 2)) + _SCATTER_PAIRS * _SCATTER**2
        count = evidence.regular.sum(axis=(1, 2))
        free = np.maximum(count - 1 - self.expected.follows, 0) + _SCATTER_PAIRS
        return np.sqrt(total / free)


def _normal(apart: Array, variances: Array) -> Array:
    return np.exp(-(apart**2) / (2 * variances)) / np.sqrt(2 * np.pi * variances)

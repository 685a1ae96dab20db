"""Least squares for E / density and Poisson's ratio, from modes that are paired."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from struck.recordings.calibration.agreement import RATIO_PRIOR
from struck.recordings.calibration.expected import GREATEST_RATIO, LEAST_RATIO, Expected
from struck.recordings.calibration.pairing import Pairing
from struck.recordings.calibration.partials import Partials

Array = NDArray[np.float64]
_ROUNDS = 20
_LEAST = 1e-9  # what rounding leaves of ln f
_FARTHEST, _FEWEST = 4.0, 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticFit:
    """What frequencies tell.

    Parameters
    ----------
    shift : float
        ln of the factor from computed frequencies to fitted ones: half that of E / density.
    ratio : float
        Poisson's.
    covariance : array (2, 2)
        Of ln(E / density) and the ratio.
    freedom : float
        Modes less the coefficients that they told.
    scatter : float
        Standard deviation of ln f about the fit, errors of fitting apart.
    residuals : array (P,)
        ln f heard less expected.
    regular : array (P,), bool
        Which modes counted: those not off by more than four standard deviations of the pairing.
    """

    shift: float
    ratio: float
    covariance: Array
    freedom: float
    scatter: float
    residuals: Array
    regular: NDArray[np.bool_]


def elastic_fit(
    partials: Partials, expected: Expected, pairing: Pairing, assumed: float
) -> ElasticFit:
    """Fit E / density and Poisson's ratio.

    Parameters
    ----------
    partials : Partials
        The fitted modes.
    expected : Expected
        The computed ones.
    pairing : Pairing
        Which is which.
    assumed : float
        Poisson's ratio before anything was heard, within about 0.1; it stays where modes do not
        depend on it.

    Notes
    -----
    Modes count by their standard errors and a scatter common to all, for the model is not exact
    either: R. C. Paule and J. Mandel, Journal of Research of the National Bureau of Standards 87,
    1982. The model's stated errors may all go one way, or each its own: both are added.
    """
    natural = partials.natural_frequencies[pairing.fitted]
    errors = partials.frequency_errors[pairing.fitted] / natural
    every = _Task(
        heard=np.log(natural),
        variances=np.square(errors),
        expected=expected,
        computed=pairing.computed,
        assumed=assumed,
    )
    place, scatter = np.array([np.log(pairing.factor), pairing.poisson_ratio]), pairing.scatter
    deviations = np.sqrt(every.variances + scatter**2)
    regular = np.abs(every.apart(place)[0]) <= _FARTHEST * deviations
    if regular.sum() < _FEWEST:
        regular[:] = True
    task = every.of(regular)
    for _ in range(_ROUNDS):
        place = task.nearer(place, scatter)
        scatter = task.scatter(place, scatter)
    covariance, freedom = task.told(place, scatter)
    return ElasticFit(
        shift=float(place[0]),
        ratio=float(place[1]),
        covariance=covariance,
        freedom=freedom,
        scatter=scatter,
        residuals=every.apart(place)[0],
        regular=regular,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Task:
    heard: Array
    variances: Array
    expected: Expected
    computed: NDArray[np.int64]
    assumed: float

    def of(self, modes: NDArray[np.bool_]) -> _Task:
        """Return the task for some of the modes."""
        return replace(
            self,
            heard=self.heard[modes],
            variances=self.variances[modes],
            computed=self.computed[modes],
        )

    def apart(self, place: Array) -> tuple[Array, Array]:
        """Return the residuals (P,) and how what is expected follows shift and ratio (P, 2)."""
        logarithms, slopes = self.expected.logarithms(place[1:])
        chosen = slopes[0, self.computed]
        residuals = self.heard - logarithms[0, self.computed] - place[0]
        return residuals, np.stack([np.ones_like(chosen), chosen], axis=1)

    def weighed(self, design: Array, scatter: float) -> tuple[Array, Array]:
        """Return weights (P,) and the normal matrix without what was assumed."""
        weights = 1 / np.maximum(self.variances + scatter**2, _LEAST**2)
        return weights, (design * weights[:, None]).T @ design

    @property
    def prior(self) -> Array:
        return np.diag([0.0, RATIO_PRIOR**-2])

    def nearer(self, place: Array, scatter: float) -> Array:
        residuals, design = self.apart(place)
        weights, normal = self.weighed(design, scatter)
        pull = (design * weights[:, None]).T @ residuals
        known = np.isfinite(self.assumed)
        pull[1] += (self.assumed - place[1]) / RATIO_PRIOR**2 if known else 0.0
        moved = place + np.linalg.solve(normal + self.prior, pull)
        return np.array([moved[0], np.clip(moved[1], LEAST_RATIO, GREATEST_RATIO)])

    def scatter(self, place: Array, before: float) -> float:
        """Return the scatter with which the residuals are as large as they should be."""
        residuals, design = self.apart(place)
        squares = np.square(residuals)
        free = self.freedom(design, before)
        most = float(np.sqrt(squares.sum() / free))

        def excess(scatter: float) -> float:
            spread = np.maximum(self.variances + scatter**2, _LEAST**2)
            return float((squares / spread).sum() - free)

        if excess(0.0) <= 0:
            return 0.0
        return float(brentq(excess, 0.0, 2 * most + _LEAST))

    def freedom(self, design: Array, scatter: float) -> float:
        _, normal = self.weighed(design, scatter)
        told = np.trace(np.linalg.solve(normal + self.prior, normal))
        return max(len(self.heard) - float(told), 1.0)

    def told(self, place: Array, scatter: float) -> tuple[Array, float]:
        """Return the covariance of ln(E / density) and the ratio, and the degrees of freedom."""
        _, design = self.apart(place)
        weights, normal = self.weighed(design, scatter)
        covariance: Array = np.linalg.inv(normal + self.prior).astype(np.float64)
        stated = self.expected.remade(float(place[1])).errors
        if stated is not None:
            wrong = np.nan_to_num(stated[self.computed])
            follows = covariance @ (design * weights[:, None] * wrong[:, None]).T
            together = follows.sum(axis=1)
            covariance += np.outer(together, together) + follows @ follows.T
        double = np.diag([2.0, 1.0])
        return double @ covariance @ double, self.freedom(design, scatter)

"""Which law of damping the decays of some modes follow, chosen by cross-validation.

Decays scatter by factors, not by amounts, so all fits are least squares of ln d, with errors beyond
two standard deviations counted less (P. J. Huber, Annals of Mathematical Statistics 35, 1964).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from struck.errors import RecordingError, rounded
from struck.model.arrays import Array
from struck.model.damping import Damping, InternalFriction, Measured, Rayleigh

_ROUNDS = 15


@dataclass(frozen=True, kw_only=True)
class Terms:
    """A sum of powers of frequency, each with a factor of at least 0."""

    name: str
    kind: type[InternalFriction | Rayleigh]
    labels: tuple[str, ...]  # names of the factors

    @property
    def count(self) -> int:
        """Number of coefficients of the sum."""
        return len(self.labels)

    def fitted(self, frequencies: Array, decays: Array, weights: Array) -> tuple[Array, Array]:
        """Return the coefficients of the least squares, and the slopes of ln d over them (n, k)."""
        units = np.eye(self.count)
        basis = np.stack([self.damping(unit).decays(frequencies) for unit in units], axis=1)
        scale = np.median(decays) / np.median(basis, axis=0)
        basis = basis * scale
        coefficients, model_decays = np.zeros(self.count), decays
        for _ in range(_ROUNDS):  # Gauss-Newton in ln d, from the least squares of d / model
            rows = np.sqrt(weights) / model_decays
            targets = model_decays * (1 + np.log(decays / model_decays))
            coefficients, _ = nnls(basis * rows[:, None], targets * rows)
            model_decays = np.maximum(basis @ coefficients, np.finfo(float).tiny)
        return coefficients * scale, basis / model_decays[:, None] / scale

    def damping(self, coefficients: Array) -> Damping:
        """Return the law with these coefficients."""
        factors = dict(zip(self.labels, map(float, coefficients), strict=True))
        required = {"mass": 0.0, "stiffness": 0.0} if self.kind is Rayleigh else {"loss_tangent": 0}
        return self.kind(**(required | factors))


@dataclass(frozen=True, kw_only=True)
class LossCurve:
    """Straight lines in ln f and ln d between knots with equally many modes in between."""

    knots: tuple[float, ...]

    @classmethod
    def through(cls, frequencies: Array, count: int) -> LossCurve:
        """Place this many knots, fewer where modes coincide."""
        return cls(knots=tuple(np.unique(np.quantile(frequencies, np.linspace(0, 1, count)))))

    @property
    def name(self) -> str:
        """Name of the law."""
        return f"curve of {self.count} points"

    @property
    def count(self) -> int:
        """Number of coefficients of the law."""
        return len(self.knots)

    def fitted(self, frequencies: Array, decays: Array, weights: Array) -> tuple[Array, Array]:
        """Return the rates of the least squares, and the slopes of ln d over them (n, k)."""
        places, log_frequencies = np.log(self.knots), np.log(frequencies)
        basis = np.stack(
            [np.interp(log_frequencies, places, unit) for unit in np.eye(self.count)], axis=1
        )
        rows = np.sqrt(weights)
        solution = np.linalg.lstsq(basis * rows[:, None], np.log(decays) * rows)[0]
        return np.exp(solution), basis * np.exp(-solution)

    def damping(self, coefficients: Array) -> Damping:
        """Return the law with these coefficients."""
        return Measured(frequencies=self.knots, rates=tuple(map(float, coefficients)))

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the rates."""
        return tuple(f"rate at {rounded(knot, 4)} Hz" for knot in self.knots)


LossLaw = Terms | LossCurve
_TWO_LOSSES_NAME = "loss tangent and external"
LAWS = (
    Terms(name="loss tangent", kind=InternalFriction, labels=("loss_tangent",)),
    Terms(name=_TWO_LOSSES_NAME, kind=InternalFriction, labels=("loss_tangent", "external")),
    Terms(name="Rayleigh", kind=Rayleigh, labels=("mass", "stiffness")),
)

_CURVES = (3, 5, 8, 12)
_MODES_PER_COEFFICIENT = 3
_FOLDS = 10
_HUBER = 2.0
_MAX_DEVIATION = 3.0
_MIN_ERROR = 1e-4  # least relative error of a decay


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Losses:
    """Law of damping that the modes of a body follow, with its errors and its rivals."""

    # the best predictor of left-out modes; a simpler law if that is not significantly worse
    law: Damping
    name: str
    coefficients: Mapping[str, float]  # of the law, by name, in its units
    standard_errors: Mapping[str, float]
    scatter: float  # standard deviation of ln d about the law
    # By law: root mean square of ln d of unseen modes about it, capped at three standard deviations
    # of the closest.
    scores: Mapping[str, float]


def losses(frequencies: ArrayLike, decays: ArrayLike, errors: ArrayLike | None = None) -> Losses:
    """Find the law of damping that modes follow; modes that do not decay are left out.

    A constant loss tangent, one with external losses (1998, eq. 12 and 13), Rayleigh damping (2002,
    eq. 9), or a free curve, by tenfold cross-validation. Natural frequencies (n,) in Hz, decays and
    their standard errors in 1/s.
    """
    decay_rates = np.asarray(decays, np.float64)
    stated_errors = np.zeros_like(decay_rates) if errors is None else np.asarray(errors, np.float64)
    indices = np.flatnonzero(decay_rates > 0)
    if not indices.size:
        raise RecordingError("no fitted mode decays: there is no damping to find")
    indices = indices[np.argsort(np.asarray(frequencies)[indices], kind="stable")]
    modes = _Decays(
        frequencies=np.asarray(frequencies, np.float64)[indices],
        decays=decay_rates[indices],
        errors=np.maximum(stated_errors[indices] / decay_rates[indices], _MIN_ERROR),
    )
    return modes.explained()


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Decays:
    frequencies: Array  # ascending
    decays: Array
    errors: Array  # of ln d

    def explained(self) -> Losses:
        laws = self.laws()
        deviations_by_law = {law.name: self.cross_validated(law) for law in laws}
        scale = min(_spread(deviations_of_law) for deviations_of_law in deviations_by_law.values())
        squares_by_law = {
            name: np.minimum(deviations_of_law**2, (_MAX_DEVIATION * scale) ** 2)
            for name, deviations_of_law in deviations_by_law.items()
        }
        law = _select_simplest(laws, squares_by_law)
        coefficients, slopes, weights, scatter = self.settled(law)
        deviations = _standard_errors(slopes * np.sqrt(weights)[:, None])
        return Losses(
            law=law.damping(coefficients),
            name=law.name,
            coefficients=dict(zip(law.labels, map(float, coefficients), strict=True)),
            standard_errors=dict(zip(law.labels, map(float, deviations), strict=True)),
            scatter=scatter,
            scores={
                name: float(np.sqrt(deviations_of_law.mean()))
                for name, deviations_of_law in squares_by_law.items()
            },
        )

    def laws(self) -> list[LossLaw]:
        curves = [LossCurve.through(self.frequencies, count) for count in _CURVES]
        candidates: list[LossLaw] = [*LAWS, *curves]
        max_coefficients = len(self.decays) / _MODES_PER_COEFFICIENT
        laws_by_name = {
            law.name: law for law in candidates if law.count == 1 or law.count <= max_coefficients
        }
        return list(laws_by_name.values())

    def log_deviations(self, law: LossLaw, coefficients: Array) -> Array:
        expected_decays = law.damping(coefficients).decays(self.frequencies)
        return np.log(self.decays / np.maximum(expected_decays, np.finfo(float).tiny))

    def of(self, modes: NDArray[np.bool_]) -> _Decays:
        return _Decays(
            frequencies=self.frequencies[modes],
            decays=self.decays[modes],
            errors=self.errors[modes],
        )

    def settled(self, law: LossLaw) -> tuple[Array, Array, Array, float]:
        """Return coefficients, slopes of ln d over them, weights, and the scatter of ln d."""
        weights = np.ones_like(self.decays)
        coefficients, slopes, scatter = np.zeros(0), np.zeros(0), 0.0
        for _ in range(4):
            coefficients, slopes = law.fitted(self.frequencies, self.decays, weights)
            deviations_from_law = self.log_deviations(law, coefficients)
            freedom = max(len(deviations_from_law) - law.count, 1) / len(deviations_from_law)
            scatter = _spread(deviations_from_law) / np.sqrt(freedom)
            law_variance = np.maximum(scatter**2 - np.median(self.errors) ** 2, 0.0)
            deviations = np.sqrt(law_variance + self.errors**2)
            huber = np.minimum(
                1.0, _HUBER * deviations / np.maximum(np.abs(deviations_from_law), _MIN_ERROR**2)
            )
            weights = huber / deviations**2
        return coefficients, slopes, weights, scatter

    def cross_validated(self, law: LossLaw) -> Array:
        """Return ln d less that of the law fitted to other modes (n,), by cross-validation."""
        count = len(self.decays)
        folds = np.arange(count) % min(_FOLDS, count)
        deviations = np.zeros(count)
        for fold in np.unique(folds):
            is_left_out = folds == fold
            training_decays = self.of(~is_left_out) if count > 1 else self
            deviations[is_left_out] = self.of(is_left_out).log_deviations(
                law, training_decays.settled(law)[0]
            )
        return deviations


def _spread(deviations: Array) -> float:
    """Return a standard deviation that a few outliers do not move."""
    return max(1.4826 * float(np.median(np.abs(deviations))), _MIN_ERROR)


def _standard_errors(design: Array) -> Array:
    """Return standard errors of coefficients in any units, of equations of unit variance (n, k)."""
    sizes = np.linalg.norm(design, axis=0)
    return np.sqrt(np.diag(np.linalg.pinv((design / sizes).T @ (design / sizes)))) / sizes


def _select_simplest(laws: list[LossLaw], squares: Mapping[str, Array]) -> LossLaw:
    """Return the law with the fewest coefficients that is not significantly worse than the best."""
    best_law = min(laws, key=lambda law: squares[law.name].mean())

    def as_good(law: LossLaw) -> bool:
        more = squares[law.name] - squares[best_law.name]
        return law is best_law or more.mean() <= more.std() / np.sqrt(len(more))

    chosen = [law for law in laws if as_good(law)]
    return min(chosen, key=lambda law: (law.count, squares[law.name].mean()))

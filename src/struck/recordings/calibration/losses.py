"""Which law of damping the decays of some modes follow, chosen by cross-validation.

Decays scatter by factors, not by amounts, so all fits are least squares of ln d, with errors beyond
two standard deviations counted less (P. J. Huber, Annals of Mathematical Statistics 35, 1964).

What the air takes is a known term of each decay, d = law(f) + air. Its uncertainty has a part that
is common to all modes, which the decays themselves narrow down, and a part that is each mode's.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import nnls

from struck.errors import RecordingError, rounded
from struck.model.air_losses import AirLosses
from struck.model.arrays import Array
from struck.model.damping import Damping, InternalFriction, Measured, Rayleigh


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

    def start(self, frequencies: Array, rates: Array, weights: Array) -> Array:
        """Return coefficients (k,) near those of the rates (n,), 1/s."""
        basis, rows = self.basis(frequencies, np.ones(self.count)), np.sqrt(weights) / rates
        return _nonnegative(basis * rows[:, None], rates * rows)

    def basis(self, frequencies: Array, coefficients: Array) -> Array:
        """Return the slopes of the rates over the coefficients (n, k), 1/s."""
        units = np.eye(len(coefficients))
        return np.stack([self.damping(unit).decays(frequencies) for unit in units], axis=1)

    def damping(self, coefficients: Array, *, contains_air: bool = False) -> Damping:
        """Return the law with these coefficients."""
        factors = dict(zip(self.labels, map(float, coefficients), strict=True))
        required = {"mass": 0.0, "stiffness": 0.0} if self.kind is Rayleigh else {"loss_tangent": 0}
        return self.kind(**(required | factors), contains_air=contains_air)


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

    def start(self, frequencies: Array, rates: Array, weights: Array) -> Array:
        """Return the curve's rates (k,) by least squares of ln d."""
        rows = np.sqrt(weights)
        knot_weights = self._knot_weights(frequencies) * rows[:, None]
        return np.exp(np.linalg.lstsq(knot_weights, np.log(rates) * rows)[0])

    def basis(self, frequencies: Array, coefficients: Array) -> Array:
        """Return the slopes of the rates over the coefficients (n, k), whose sum they are too."""
        knot_weights = self._knot_weights(frequencies)
        return np.exp(knot_weights @ np.log(coefficients))[:, None] * knot_weights / coefficients

    def damping(self, coefficients: Array, *, contains_air: bool = False) -> Damping:
        """Return the law with these coefficients."""
        rates = tuple(map(float, coefficients))
        return Measured(frequencies=self.knots, rates=rates, contains_air=contains_air)

    @property
    def labels(self) -> tuple[str, ...]:
        """Names of the rates."""
        return tuple(f"rate at {rounded(knot, 4)} Hz" for knot in self.knots)

    def _knot_weights(self, frequencies: Array) -> Array:
        """Return the share of each knot in ln d at each frequency (n, k)."""
        places, log_frequencies = np.log(self.knots), np.log(frequencies)
        return np.stack(
            [np.interp(log_frequencies, places, unit) for unit in np.eye(self.count)], axis=1
        )


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
# Least scatter of ln d about a law where few modes are without uncertain losses to the air, so that
# these few cannot show it. Chosen by judgement.
_MIN_SCATTER = 0.02
_MIN_ERROR = 1e-4  # least relative error of a decay
_MAX_ERROR = 1e6  # relative error of a law from which on there is no law
_ROUNDS, _HALVINGS = 15, 5
_MAX_LAST_STEP = 1e-7  # relative: rounds end when no rate changes by more
_REWEIGHTINGS = 4
_TINY = np.finfo(float).tiny
_MIN_START = 0.05  # of the decay, from which the fit starts where the air explains all of it
_MIN_RATE = 1e-4  # of a curve, as a share of the decay: it has no logarithm at 0

_NORMAL_QUANTILE = 1.96  # standard deviations, within which 19 of 20 values lie
# Share of the variance of ln of the radiated power that is common to the modes of one body: its
# estimate against boundary elements deviated by 2.5 dB between eight bodies and 1.6 dB within them.
_COMMON_FRACTION = 0.7
# Common deviations that are tried, in standard deviations.
_DEVIATIONS = np.linspace(-3.0, 3.0, 13)
_MAX_INDIVIDUAL_DEVIATION = 3.0  # individual deviation of the air, in standard deviations


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
    form: LossLaw
    covariance: Array  # (k, k), of the coefficients in their order
    # (n,), of the given modes, as far as the decays narrow them down; None: the law contains them
    air: AirLosses | None = None

    def errors(self, frequencies: Array) -> Array:
        """Return relative standard errors of the law's rates at frequencies (n,), Hz.

        They are infinite where nothing is left for the law.
        """
        coefficients = np.array(list(self.coefficients.values()))
        basis = self.form.basis(frequencies, coefficients)
        variances = np.einsum("ni,ij,nj->n", basis, self.covariance, basis)
        deviations, rates = np.sqrt(np.maximum(variances, 0.0)), basis @ coefficients
        is_left = rates > deviations / _MAX_ERROR
        return np.divide(deviations, rates, out=np.full(len(rates), np.inf), where=is_left)


def losses(
    frequencies: ArrayLike,
    decays: ArrayLike,
    errors: ArrayLike | None = None,
    *,
    air: AirLosses | None = None,
) -> Losses:
    """Find the law of damping that modes follow; modes that do not decay are left out.

    A constant loss tangent, one with external losses (1998, eq. 12 and 13), Rayleigh damping (2002,
    eq. 9), or a free curve, by tenfold cross-validation. Natural frequencies (n,) in Hz, decays and
    their standard errors in 1/s; `air` is the part of these decays that the law is not to contain.
    Default: it contains all.
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
        air=_Air.zero(len(indices)) if air is None else _Air.of(air.chosen(indices)),
    )
    law = modes.select_law()
    form, estimate = law.form, modes.estimate_law(law.form)
    return Losses(
        law=form.damping(estimate.coefficients, contains_air=air is None),
        name=form.name,
        coefficients=dict(zip(form.labels, map(float, estimate.coefficients), strict=True)),
        standard_errors=dict(
            zip(form.labels, np.sqrt(np.diag(estimate.covariance)).tolist(), strict=True)
        ),
        scatter=estimate.scatter,
        scores=law.scores,
        form=form,
        covariance=estimate.covariance,
        air=None if air is None else _update_air(air, estimate.deviation, estimate.spread),
    )


def _update_air(air: AirLosses, deviation: float, spread: float) -> AirLosses:
    """Return losses whose common deviation is known, with its standard deviation."""
    common, individual_deviations = _deviations(air.uncertainty)
    spreads = np.hypot(common * spread, individual_deviations)
    return replace(
        air,
        sound=air.sound * np.exp(common * deviation),
        uncertainty=_NORMAL_QUANTILE * spreads * 10 / np.log(10),
    )


def _deviations(uncertainty: Array) -> tuple[Array, Array]:
    """Return standard deviations of ln of powers, common and individual, of those in dB."""
    deviations = uncertainty * np.log(10) / 10 / _NORMAL_QUANTILE
    return np.sqrt(_COMMON_FRACTION) * deviations, np.sqrt(1 - _COMMON_FRACTION) * deviations


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Air:
    """Decay rates by the air (n,), and how they may deviate."""

    sound: Array  # 1/s
    surface: Array  # 1/s
    common_spread: Array  # standard deviation of ln of `sound`, of all modes together
    individual_spread: Array  # the same, of each mode

    @classmethod
    def zero(cls, count: int) -> _Air:
        zeros = np.zeros(count)
        return cls(sound=zeros, surface=zeros, common_spread=zeros, individual_spread=zeros)

    @classmethod
    def of(cls, air: AirLosses) -> _Air:
        common, individual_deviations = _deviations(air.uncertainty)
        return cls(
            sound=air.sound,
            surface=air.surface,
            common_spread=common,
            individual_spread=individual_deviations,
        )

    @property
    def is_uncertain(self) -> bool:
        return bool(np.any(self.sound * self.common_spread > 0))

    def chosen(self, modes: NDArray[np.bool_]) -> _Air:
        return _Air(**{name: getattr(self, name)[modes] for name in self.__slots__})

    def sound_at(self, deviation: float) -> Array:
        """Return decay rates by sound when all deviate by this number of standard deviations."""
        return self.sound * np.exp(self.common_spread * deviation)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Fit:
    """Coefficients of a law, and the common deviation of the air."""

    coefficients: Array
    deviation: float
    slopes: Array  # (n, k), of ln d over the coefficients
    residuals: Array  # (n,), of ln d
    variances: Array  # (n,), of ln d by the individual deviations of the air
    local_variances: Array  # (n,), the same about the deviations that explain the residuals


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Estimate:
    coefficients: Array
    covariance: Array
    scatter: float
    deviation: float  # of the air, common to all modes, in standard deviations
    spread: float  # its standard deviation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Choice:
    form: LossLaw
    scores: Mapping[str, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Decays:
    frequencies: Array  # ascending
    decays: Array
    errors: Array  # of ln d
    air: _Air

    def select_law(self) -> _Choice:
        laws = self.laws()
        deviations_by_law = {law.name: self.cross_validated(law) for law in laws}
        scale = min(_spread(deviations_of_law) for deviations_of_law in deviations_by_law.values())
        squares_by_law = {
            name: np.minimum(deviations_of_law**2, (_MAX_DEVIATION * scale) ** 2)
            for name, deviations_of_law in deviations_by_law.items()
        }
        scores = {
            name: float(np.sqrt(deviations_of_law.mean()))
            for name, deviations_of_law in squares_by_law.items()
        }
        form = _select_simplest(laws, squares_by_law)
        if self.air.is_uncertain:
            sufficient_laws = [law for law in self.sufficient_laws(laws) if law.count < form.count]
            form = min(sufficient_laws, key=lambda law: law.count, default=form)
        return _Choice(form=form, scores=scores)

    def sufficient_laws(self, laws: list[LossLaw]) -> list[LossLaw]:
        """Return laws from which decays deviate no more than the uncertainty of the air allows.

        The deviations of the air are similar for modes of similar frequencies, so that a curve
        would follow them, and predict modes that are left out as well.
        """
        settled_fits = [self.settled(law) for law in laws]
        known_variances = self.known_variances(min(scatter for _, _, scatter in settled_fits))
        selected_laws = []
        for law, (fit, _, _) in zip(laws, settled_fits, strict=True):
            variances = known_variances + fit.variances
            weights = known_variances / variances  # modes of much air say little
            freedom = max(1 - law.count / len(weights), 1 / len(weights))
            if (weights * fit.residuals**2 / variances).sum() <= freedom * weights.sum():
                selected_laws.append(law)
        return selected_laws

    def laws(self) -> list[LossLaw]:
        curves = [LossCurve.through(self.frequencies, count) for count in _CURVES]
        candidates: list[LossLaw] = [*LAWS, *curves]
        max_coefficients = len(self.decays) / _MODES_PER_COEFFICIENT
        laws_by_name = {
            law.name: law for law in candidates if law.count == 1 or law.count <= max_coefficients
        }
        return list(laws_by_name.values())

    def of(self, modes: NDArray[np.bool_]) -> _Decays:
        return _Decays(
            frequencies=self.frequencies[modes],
            decays=self.decays[modes],
            errors=self.errors[modes],
            air=self.air.chosen(modes),
        )

    def estimate_law(self, law: LossLaw) -> _Estimate:
        """Return the mean of the coefficients over the common deviation of the air."""
        fit, weights, scatter = self.settled(law)
        deviations = _DEVIATIONS if self.air.is_uncertain else np.array([fit.deviation])
        fits, costs, all_weights = [], [], []
        for deviation in deviations:
            case_weights = weights
            case = self.fitted(law, case_weights, float(deviation))
            if self.air.is_uncertain:
                case_weights = self.weights(case, scatter)
                case = self.fitted(law, case_weights, float(deviation))
            fits.append(case)
            costs.append(self.surprise(case, scatter) + deviation**2)
            all_weights.append(case_weights)
        squares = np.array(costs)
        chances = np.exp((squares.min() - squares) / 2)
        chances /= chances.sum()
        coefficients = np.stack([case.coefficients for case in fits])
        mean = chances @ coefficients
        covariance = (chances[:, None] * (coefficients - mean)).T @ (coefficients - mean)
        for chance, case, case_weights in zip(chances, fits, all_weights, strict=True):
            covariance += chance * _covariance_of_fit(case, case_weights)
        deviation = float(chances @ deviations)
        return _Estimate(
            coefficients=mean,
            covariance=covariance,
            scatter=scatter,
            deviation=deviation,
            spread=float(np.sqrt(chances @ (deviations - deviation) ** 2)),
        )

    def settled(self, law: LossLaw) -> tuple[_Fit, Array, float]:
        """Return the fit, its weights, and the scatter of ln d without that of the air."""
        weights, scatter = np.ones_like(self.decays), 1.0
        fit = self.fitted(law, weights)
        for _ in range(_REWEIGHTINGS * (2 if self.air.is_uncertain else 1)):
            freedom = max(len(self.decays) - law.count, 1) / len(self.decays)
            known_variances = self.known_variances(scatter)
            precision = np.sqrt(known_variances / (known_variances + fit.variances))
            scatter = _spread(fit.residuals * precision) / np.sqrt(freedom)
            if self.air.is_uncertain:
                scatter = max(scatter, _MIN_SCATTER)
            weights = self.weights(fit, scatter)
            fit = self.fitted(law, weights)
        return fit, weights, scatter

    def weights(self, fit: _Fit, scatter: float) -> Array:
        """Return weights of modes (n,), less for those beyond two standard deviations."""
        deviations = np.sqrt(self.known_variances(scatter) + fit.variances)
        huber = np.minimum(
            1.0, _HUBER * deviations / np.maximum(np.abs(fit.residuals), _MIN_ERROR**2)
        )
        return huber / deviations**2

    def surprise(self, fit: _Fit, scatter: float) -> float:
        """Return -2 ln of the likelihood of the decays, up to a constant."""
        known_variances = self.known_variances(scatter)
        relative_residuals = np.abs(fit.residuals) / np.sqrt(known_variances + fit.variances)
        squares = np.where(
            relative_residuals < _HUBER,
            relative_residuals**2,
            _HUBER * (2 * relative_residuals - _HUBER),
        )
        return float((squares + np.log(known_variances + fit.local_variances)).sum())

    def known_variances(self, scatter: float) -> Array:
        """Return variances of ln d (n,) without those of the air, from their median scatter."""
        return np.maximum(scatter**2 - np.median(self.errors) ** 2, 0.0) + self.errors**2

    def fitted(self, law: LossLaw, weights: Array, deviation: float | None = None) -> _Fit:
        """Fit a law by Gauss-Newton steps in ln d, and the common deviation if it is None."""
        remainder = self.decays - self.air.sound - self.air.surface
        start = law.start(
            self.frequencies, np.maximum(remainder, _MIN_START * self.decays), weights
        )
        values = np.append(start, deviation or 0.0)
        is_free = deviation is None and self.air.is_uncertain
        residuals, slopes = self._linearised(law, values)
        cost = _cost(residuals, weights, values, is_free=is_free)
        for _ in range(_ROUNDS):
            target = self._step(values, residuals, slopes, weights, is_free=is_free)
            step = target - values
            for _ in range(_HALVINGS):
                trial = values + step
                trial[:-1] = np.maximum(trial[:-1], self._min_coefficient(law))
                new = self._linearised(law, trial)
                if (new_cost := _cost(new[0], weights, trial, is_free=is_free)) <= cost:
                    break
                step = step / 2
            else:
                break
            has_settled = np.abs(step) <= _MAX_LAST_STEP * np.maximum(np.abs(values), 1e-300)
            values, (residuals, slopes), cost = trial, new, new_cost
            if has_settled[: None if is_free else -1].all():
                break
        return self.evaluate(law, values)

    def evaluate(self, law: LossLaw, values: Array) -> _Fit:
        """Return the fit with given coefficients, and the deviation as the last of the values."""
        residuals, slopes = self._linearised(law, values)
        sound, individual_deviations = (
            self.air.sound_at(float(values[-1])),
            self.air.individual_spread,
        )
        other_decays = self.decays * np.exp(-residuals) - sound
        # The deviation of the air that would explain the residual. Its chord, not the tangent: the
        # sound of a mode is farther off upward, and a mode whose sound is estimated too low would
        # seem to be one with little of it.
        log_ratios = np.log(np.maximum(self.decays - other_decays, _TINY)) - np.log(
            np.maximum(sound, _TINY)
        )
        reach = _MAX_INDIVIDUAL_DEVIATION * individual_deviations
        deviations = np.clip(log_ratios, -reach, reach)
        expected_decays, explaining_decays = (
            other_decays + sound,
            other_decays + sound * np.exp(deviations),
        )
        is_small = np.abs(deviations) < _MIN_ERROR
        tangents = sound / expected_decays
        chords = np.log(explaining_decays / expected_decays) / np.where(is_small, 1.0, deviations)
        return _Fit(
            coefficients=values[:-1],
            deviation=float(values[-1]),
            slopes=slopes[:, :-1],
            residuals=residuals,
            variances=np.square(individual_deviations * np.where(is_small, tangents, chords)),
            local_variances=np.square(
                individual_deviations * sound * np.exp(deviations) / explaining_decays
            ),
        )

    def _min_coefficient(self, law: LossLaw) -> float:
        return _MIN_RATE * float(self.decays.min()) if isinstance(law, LossCurve) else 0.0

    def _linearised(self, law: LossLaw, values: Array) -> tuple[Array, Array]:
        """Return residuals (n,) and slopes (n, k + 1) of ln d."""
        basis = law.basis(self.frequencies, values[:-1])
        sound = self.air.sound_at(float(values[-1]))
        expected_decays = np.maximum(basis @ values[:-1] + sound + self.air.surface, _TINY)
        columns = np.column_stack([basis, sound * self.air.common_spread])
        return np.log(self.decays / expected_decays), columns / expected_decays[:, None]

    @staticmethod
    def _step(
        values: Array, residuals: Array, slopes: Array, weights: Array, *, is_free: bool
    ) -> Array:
        """Return the values (k + 1,) at which the linearised residuals are least."""
        rows = np.sqrt(weights)
        if not is_free:
            target_values = residuals + slopes[:, :-1] @ values[:-1]
            return np.append(
                _nonnegative(slopes[:, :-1] * rows[:, None], target_values * rows), values[-1]
            )
        # The deviation has either sign, and its own size is that expected beforehand: 1.
        signed_slopes = np.column_stack([slopes, -slopes[:, -1]]) * rows[:, None]
        prior = np.r_[np.zeros(len(values) - 1), 1.0, -1.0]
        target_values = (residuals + slopes @ values) * rows
        solution = _nonnegative(np.vstack([signed_slopes, prior]), np.append(target_values, 0.0))
        deviation = np.clip(solution[-2] - solution[-1], values[-1] - 1, values[-1] + 1)
        return np.append(solution[:-2], deviation)

    def cross_validated(self, law: LossLaw) -> Array:
        """Return ln d less that of the law fitted to other modes (n,), by cross-validation.

        Where the air is uncertain, deviations are reduced to the part that the law has in them.
        """
        count = len(self.decays)
        folds = np.arange(count) % min(_FOLDS, count)
        deviations = np.zeros(count)
        for fold in np.unique(folds):
            is_left_out = folds == fold
            training_decays = self.of(~is_left_out) if count > 1 else self
            fit, _, scatter = training_decays.settled(law)
            left_out = self.of(is_left_out)
            values = np.append(fit.coefficients, fit.deviation)
            unseen_decays = left_out.evaluate(law, values)
            if not self.air.is_uncertain:
                deviations[is_left_out] = unseen_decays.residuals
                continue
            known_variances = left_out.known_variances(scatter)
            precision = np.sqrt(scatter**2 / (known_variances + unseen_decays.variances))
            deviations[is_left_out] = unseen_decays.residuals * np.minimum(precision, 1.0)
        return deviations


def _cost(residuals: Array, weights: Array, values: Array, *, is_free: bool) -> float:
    return float((weights * residuals**2).sum()) + (float(values[-1]) ** 2 if is_free else 0.0)


def _nonnegative(design: Array, target_values: Array) -> Array:
    """Return least squares of at least 0, for columns in any units."""
    sizes = np.linalg.norm(design, axis=0)
    sizes = np.where(sizes > 0, sizes, 1.0)
    return nnls(design / sizes, target_values)[0] / sizes


def _spread(deviations: Array) -> float:
    """Return a standard deviation that a few outliers do not move."""
    return max(1.4826 * float(np.median(np.abs(deviations))), _MIN_ERROR)


def _covariance(design: Array) -> Array:
    """Return the covariance of coefficients in any units, of equations of unit variance (n, k)."""
    sizes = np.linalg.norm(design, axis=0)
    sizes = np.where(sizes > 0, sizes, 1.0)
    inverse_matrix = np.linalg.pinv((design / sizes).T @ (design / sizes))
    return np.asarray(inverse_matrix / np.outer(sizes, sizes))


def _covariance_of_fit(fit: _Fit, weights: Array) -> Array:
    """Return the covariance of the coefficients (k, k).

    The individual deviations of the air may all go one way, as those of the modes with little sound
    do, or each its own: both are added.
    """
    covariance = _covariance(fit.slopes * np.sqrt(weights)[:, None])
    response = covariance @ fit.slopes.T @ (weights * np.sqrt(fit.variances))
    return np.asarray(covariance + np.outer(response, response))


def _select_simplest(laws: list[LossLaw], squares: Mapping[str, Array]) -> LossLaw:
    """Return the law with the fewest coefficients that is not significantly worse than the best."""
    best_law = min(laws, key=lambda law: squares[law.name].mean())

    def as_good(law: LossLaw) -> bool:
        more = squares[law.name] - squares[best_law.name]
        return law is best_law or more.mean() <= more.std() / np.sqrt(len(more))

    chosen = [law for law in laws if as_good(law)]
    return min(chosen, key=lambda law: (law.count, squares[law.name].mean()))

"""Material of a body, from a recording of it and a model of its shape.

2002's future work: "using their measured data for a given object to infer material parameters that
could then be applied to the geometry of a different object". Frequencies determine E / density
and, as far as modes follow it differently, Poisson's ratio; decays determine the damping, once the
losses to the air are subtracted, which the model knows. Sound alone determines neither Young's
modulus nor density; 1 % of size is 2 % of E / density.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.stats import t as student

from struck.errors import MaterialError, OptionError, RecordingError, counted, rounded
from struck.model.air_losses import AirLosses
from struck.model.arrays import Array, Index, brief, checked, require_number
from struck.model.damping import Measured, ringing
from struck.model.gains import ShapeGains
from struck.model.material import Material
from struck.model.model import ModalModel
from struck.recordings.calibration.agreement import (
    GREATEST_RATIO,
    LEAST_RATIO,
    RATIO_PRIOR,
    Expected,
    FittedModes,
    Partials,
)
from struck.recordings.calibration.losses import Losses, losses
from struck.recordings.calibration.pairing import Pairing, explains, paired

# Modes closer than this share of their frequency are two of a round body's pair.
_SHARED = 1e-3


@checked
def corrected(
    model: ModalModel, fitted: FittedModes | ModalModel, pairing: Pairing | None = None
) -> ModalModel:
    """Replace the frequencies and decay rates of a computed model by those of a recording.

    Shapes, and so how the timbre changes over the surface, stay those computed.

    Parameters
    ----------
    model : ModalModel
        Computed model of the body.
    fitted : FittedModes or ModalModel
        Any object with `frequencies`, `decays` and `gains`.
    pairing : Pairing, optional
        Pairs of modes. Default: estimated.

    Returns
    -------
    ModalModel
        Modes with a partner ring as it does. The others follow by the factor and Poisson's ratio
        that the partners have in common, or with their twin where they share a frequency with a
        mode that has one, and their damping by the median of the partners' over the computed one;
        the losses to the air stay those computed. The provenance counts both. The material's
        damping becomes the curve through all decays, which contains the losses to the air; its
        constants stay as assumed: `calibrated` finds them.

    Raises
    ------
    RecordingError
        If no mode can be paired.
    """
    partials = Partials.of(fitted)
    pairs = paired(partials, model) if pairing is None else pairing
    if not len(pairs):
        raise RecordingError(
            f"none of {len(partials.frequencies)} fitted modes could be paired with the model's: "
            "check the shape and its size"
        )
    natural = _frequencies(model, partials, pairs)
    decays = _decays(model, partials, pairs)
    order = np.argsort(natural, kind="stable")
    natural, decays = natural[order], decays[order]
    slopes, material = model.poisson_slopes, model.material
    ratios = partials.natural_frequencies[pairs.fitted] / model.natural_frequencies[pairs.computed]
    count, mode_count = len(pairs), len(natural)
    return replace(
        model,
        natural_frequencies=natural,
        frequencies=ringing(natural, decays),
        decays=decays,
        gains=model.gains.changed(natural, order, 1, 1),
        material=None if material is None else material.damped(_curve(natural, decays)),
        complete_to=model.complete_to * min(1.0, float(ratios.min())),
        poisson_slopes=None if slopes is None else slopes[order],
        errors=_errors(model, partials, pairs)[order],
        provenance=model.provenance.extended(
            corrected=(
                f"{count} of {mode_count} modes ring as recorded, {mode_count - count} follow them"
            ),
            recorded_over_computed=pairs.factor,
        ),
    )


def _frequencies(model: ModalModel, partials: Partials, pairs: Pairing) -> Array:
    """Return natural frequencies in the model's order, Hz."""
    model_frequencies = model.natural_frequencies
    natural = pairs.expected.copy()
    natural[pairs.computed] = partials.natural_frequencies[pairs.fitted]
    for mode in pairs.missing:
        gaps = np.abs(model_frequencies[pairs.computed] / model_frequencies[mode] - 1)
        if gaps.min() < _SHARED:
            natural[mode] = natural[pairs.computed[np.argmin(gaps)]]
    return natural


def _decays(model: ModalModel, partials: Partials, pairs: Pairing) -> Array:
    """Return decays in the model's order, 1/s."""
    air_decays = model.air_decays
    material_decays = model.decays - air_decays
    fitted_decays, computed_decays = partials.decays[pairs.fitted], material_decays[pairs.computed]
    is_decaying = computed_decays > 0
    excess_decays = np.maximum(fitted_decays - air_decays[pairs.computed], 0.0)
    ratio = (
        float(np.median(excess_decays[is_decaying] / computed_decays[is_decaying]))
        if is_decaying.any()
        else 1.0
    )
    decays = material_decays * ratio + air_decays
    decays[pairs.computed] = fitted_decays
    return decays


def _errors(model: ModalModel, partials: Partials, pairs: Pairing) -> Array:
    """Return relative errors of the frequencies: the fit's for paired modes, else the scatter."""
    errors = np.full(len(model.natural_frequencies), pairs.scatter)
    stated_errors = partials.frequency_errors[pairs.fitted] / partials.frequencies[pairs.fitted]
    errors[pairs.computed] = np.where(stated_errors > 0, stated_errors, np.nan)
    return errors


def _curve(natural: Array, decays: Array) -> Measured:
    """Return the damping that goes through all decays; modes of one frequency share their mean."""
    places, twins = np.unique(natural, return_inverse=True)
    positive_decays = np.maximum(decays, np.finfo(float).tiny)
    means = np.exp(np.bincount(twins, np.log(positive_decays)) / np.bincount(twins))
    return Measured(frequencies=tuple(places.tolist()), rates=tuple(means.tolist()))


_FIT_ROUNDS = 20
_ROUNDING_ERROR = 1e-9  # rounding error of ln f
_MAX_DEVIATION, _MIN_REGULAR_MODES = 4.0, 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ElasticFit:
    """E / density and Poisson's ratio by least squares from the frequencies of a recording."""

    shift: float  # ln of fitted over computed frequencies: half that of E / density
    ratio: float  # Poisson's
    covariance: Array  # (2, 2), of ln(E / density) and the ratio
    freedom: float  # number of modes less the number of coefficients that they determine
    scatter: float  # standard deviation of ln f about the fit, errors of fitting apart
    residuals: Array  # (P,), ln f heard less expected
    regular: NDArray[np.bool_]  # (P,), modes that counted: within four deviations of the pairing


def elastic_fit(
    partials: Partials, expected: Expected, pairing: Pairing, assumed: float
) -> ElasticFit:
    """Fit E / density and Poisson's ratio, `assumed` beforehand within 0.1, to paired modes.

    Modes count by their standard errors and a scatter common to all, for the model is not exact
    either: R. C. Paule and J. Mandel, Journal of Research of the National Bureau of Standards 87,
    1982. The model's stated errors may all go one way, or each its own: both are added.
    """
    natural = partials.natural_frequencies[pairing.fitted]
    errors = partials.frequency_errors[pairing.fitted] / natural
    full_task = _Task(
        log_frequencies=np.log(natural),
        variances=np.square(errors),
        expected=expected,
        computed=pairing.computed,
        assumed=assumed,
    )
    place, scatter = np.array([np.log(pairing.factor), pairing.poisson_ratio]), pairing.scatter
    regular = np.abs(full_task.residuals_and_design(place)[0]) <= _MAX_DEVIATION * np.sqrt(
        full_task.variances + scatter**2
    )
    if regular.sum() < _MIN_REGULAR_MODES:
        regular[:] = True
    task = full_task.of(regular)
    for _ in range(_FIT_ROUNDS):
        place = task.nearer(place, scatter)
        scatter = task.scatter(place, scatter)
    covariance, freedom = task.material_covariance(place, scatter)
    return ElasticFit(
        shift=float(place[0]),
        ratio=float(place[1]),
        covariance=covariance,
        freedom=freedom,
        scatter=scatter,
        residuals=full_task.residuals_and_design(place)[0],
        regular=regular,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Task:
    log_frequencies: Array
    variances: Array
    expected: Expected
    computed: NDArray[np.int64]
    assumed: float

    def of(self, modes: NDArray[np.bool_]) -> _Task:
        """Return the task for some of the modes."""
        return replace(
            self,
            log_frequencies=self.log_frequencies[modes],
            variances=self.variances[modes],
            computed=self.computed[modes],
        )

    def residuals_and_design(self, place: Array) -> tuple[Array, Array]:
        """Return the residuals (P,) and their design: slopes over shift and ratio (P, 2)."""
        logarithms, slopes = self.expected.logarithms(place[1:])
        chosen = slopes[0, self.computed]
        residuals = self.log_frequencies - logarithms[0, self.computed] - place[0]
        return residuals, np.stack([np.ones_like(chosen), chosen], axis=1)

    def weighed(self, design: Array, scatter: float) -> tuple[Array, Array]:
        """Return weights (P,) of pairs and the normal matrix without the prior."""
        weights = 1 / np.maximum(self.variances + scatter**2, _ROUNDING_ERROR**2)
        return weights, (design * weights[:, None]).T @ design

    @property
    def prior(self) -> Array:
        return np.diag([0.0, RATIO_PRIOR**-2])

    def nearer(self, place: Array, scatter: float) -> Array:
        residuals, design = self.residuals_and_design(place)
        weights, normal_matrix = self.weighed(design, scatter)
        force = (design * weights[:, None]).T @ residuals
        is_known = np.isfinite(self.assumed)
        force[1] += (self.assumed - place[1]) / RATIO_PRIOR**2 if is_known else 0.0
        new_place = place + np.linalg.solve(normal_matrix + self.prior, force)
        return np.array([new_place[0], np.clip(new_place[1], LEAST_RATIO, GREATEST_RATIO)])

    def scatter(self, place: Array, before: float) -> float:
        """Return the scatter with which the residuals are as large as they should be."""
        residuals, design = self.residuals_and_design(place)
        squares = np.square(residuals)
        free = self.freedom(design, before)
        max_scatter = float(np.sqrt(squares.sum() / free))

        def excess(scatter: float) -> float:
            spread = np.maximum(self.variances + scatter**2, _ROUNDING_ERROR**2)
            return float((squares / spread).sum() - free)

        if excess(0.0) <= 0:
            return 0.0
        return float(brentq(excess, 0.0, 2 * max_scatter + _ROUNDING_ERROR))

    def freedom(self, design: Array, scatter: float) -> float:
        _, normal_matrix = self.weighed(design, scatter)
        parameter_count = np.trace(np.linalg.solve(normal_matrix + self.prior, normal_matrix))
        return max(len(self.log_frequencies) - float(parameter_count), 1.0)

    def material_covariance(self, place: Array, scatter: float) -> tuple[Array, float]:
        """Return the covariance of ln(E / density) and the ratio, and the degrees of freedom."""
        _, design = self.residuals_and_design(place)
        weights, normal_matrix = self.weighed(design, scatter)
        covariance: Array = np.linalg.inv(normal_matrix + self.prior).astype(np.float64)
        stated_errors = self.expected.remade(float(place[1])).errors
        if stated_errors is not None:
            errors = np.nan_to_num(stated_errors[self.computed])
            responses = covariance @ (design * weights[:, None] * errors[:, None]).T
            common_response = responses.sum(axis=1)
            covariance += np.outer(common_response, common_response) + responses @ responses.T
        double = np.diag([2.0, 1.0])
        return double @ covariance @ double, self.freedom(design, scatter)


MIN_PAIRS = 3  # pairs that a calibration needs at least
_ROUNDS = 8
# Steps this small, slopes carry on exactly.
_MAX_LAST_STEP = 1e-5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Calibration:
    """Material constants inferred from a recording, with standard errors.

    Parameters
    ----------
    specific_stiffness : float
        E / density, m^2/s^2: the square of the speed of sound along a thin bar.
    poisson_ratio : float
        Poisson's ratio.
    covariance : array (2, 2)
        Of ln(E / density) and Poisson's ratio.
    freedom : float
        Degrees of freedom that the covariance was found with.
    scatter : float
        Relative standard deviation of frequencies about the model's, errors of fitting apart.
    losses : Losses
        The law of damping, with its errors and rivals. It contains the losses to the air only if
        `air` is None.
    air : AirLosses or None
        Losses to the air of the P paired modes at their fitted frequencies, as computed; None if
        the model does not know them.
    frequencies : array (P,)
        Fitted natural frequencies, Hz.
    decays : array (P,)
        Fitted decay rates, 1/s.
    decay_errors : array (P,)
        Their standard errors, 1/s; 0 where unknown.
    density : float
        kg/m^3; the model's, as sound does not tell it.
    name : str
        Of the model's material.
    pairing : Pairing
        With the modes of `model`.
    model : ModalModel
        The body as last computed.
    residuals : array (P,)
        Fitted frequencies over those of the model with these constants, cents.
    """

    __repr__ = brief
    specific_stiffness: float
    poisson_ratio: float
    covariance: Array
    freedom: float
    scatter: float
    losses: Losses
    air: AirLosses | None
    frequencies: Array
    decays: Array
    decay_errors: Array
    density: float
    name: str
    pairing: Pairing
    model: ModalModel
    residuals: Array

    @property
    def standard_errors(self) -> tuple[float, float]:
        """Standard errors of E / density, relative, and of Poisson's ratio."""
        relative, ratio = np.sqrt(np.diag(self.covariance))
        return float(relative), float(ratio)

    @property
    def air_fractions(self) -> Array:
        """Fractions of the decay rates of the paired modes that are due to the air (P,).

        They are NaN if the losses to the air are unknown.
        """
        if self.losses.air is None:
            return np.full(len(self.pairing), np.nan)
        material_decays = self.losses.law.decays(self.frequencies)
        return self.losses.air.total / (self.losses.air.total + material_decays)

    @property
    def damping_errors(self) -> Array:
        """Relative standard errors of the damping at the frequencies of the paired modes (P,)."""
        return self.losses.errors(self.frequencies)

    @checked
    def of_density(self, density: float) -> Calibration:
        """Return the calibration for a body of another density.

        The heavier the body, the less the air takes from it: the damping is fitted again.

        Parameters
        ----------
        density : float
            Density, kg/m^3.

        Returns
        -------
        Calibration
            The calibration.
        """
        if self.air is None or density == self.density:
            return replace(self, density=density)
        air = self.air.scaled(1.0, density / self.density)
        fitted = losses(self.frequencies, self.decays, self.decay_errors, air=air)
        return replace(self, density=density, air=air, losses=fitted)

    @checked
    def interval(self, level: float = 0.95) -> tuple[tuple[float, float], tuple[float, float]]:
        """Compute confidence intervals of E / density and Poisson's ratio.

        Parameters
        ----------
        level : float, default 0.95
            Confidence level, a probability between 0 and 1.

        Returns
        -------
        tuple of (float, float), (float, float)
            Bounds of E / density, m^2/s^2, and of Poisson's ratio.

        Raises
        ------
        OptionError
            If the level is not between 0 and 1.
        """
        if not 0 < level < 1:
            raise OptionError(f"level is {level}: give a probability between 0 and 1")
        reach = float(student.ppf((1 + level) / 2, self.freedom))
        stiffness_error, ratio = self.standard_errors
        stretch = np.exp(reach * stiffness_error)
        return (
            (self.specific_stiffness / stretch, self.specific_stiffness * stretch),
            (self.poisson_ratio - reach * ratio, self.poisson_ratio + reach * ratio),
        )

    @checked
    def material(self, density: float | None = None) -> Material:
        """Return the inferred material, to analyze other bodies with.

        Parameters
        ----------
        density : float, optional
            Density, kg/m^3. Default: that of the model.

        Returns
        -------
        Material
            The material. Its damping is without the losses to the air, which `analyze` adds for
            each body; if they were not known, it contains them, and `analyze` adds none.
        """
        if density is not None and density != self.density:
            return self.of_density(density).material()
        stiffness, ratio = self.standard_errors
        return Material(
            name=f"{self.name} as heard",
            density=self.density,
            youngs_modulus=self.specific_stiffness * self.density,
            poisson_ratio=self.poisson_ratio,
            damping=self.losses.law,
            source=(
                f"{len(self.pairing)} modes of a recording: E / density within "
                f"{rounded(100 * stiffness, 2)} %, "
                f"Poisson's ratio within {rounded(ratio, 2)}, standard errors; the density was "
                "assumed"
            ),
        )

    def summary(self) -> list[str]:
        """Summarise the results with their standard errors.

        Returns
        -------
        list of str
            One line per result.
        """
        stiffness, ratio = self.standard_errors
        modulus_in_gpa = self.specific_stiffness * self.density / 1e9
        modulus, density = rounded(self.specific_stiffness), rounded(self.density)
        extra, missing = len(self.pairing.extra), len(self.pairing.missing)
        law = [
            f"{name.replace('_', ' ')} {rounded(x, 4)}"
            for name, x in self.losses.coefficients.items()
        ]
        errors = self.damping_errors
        rms_residual = np.sqrt(np.mean(self.residuals**2))
        return [
            f"E/density {modulus} m2/s2, error {rounded(100 * stiffness, 2)} %",
            f"Poisson   {self.poisson_ratio:.4f}, error {rounded(ratio, 2)}",
            f"E         {rounded(modulus_in_gpa, 5)} GPa, if the density is {density} kg/m3",
            f"damping   {'' if 'loss' in law[0] else f'{self.losses.name}: '}{', '.join(law)}",
            f"          {_describe_errors(errors)}",
            *self._air_summary(),
            f"pairs     {len(self.pairing)}; alone {extra} fitted modes, {missing} of the model",
            f"residual  {rounded(rms_residual, 2)} cents root mean square",
        ]

    def _air_summary(self) -> list[str]:
        """Return lines on what the air takes, and on modes from which it takes too much."""
        if self.air is None:
            return ["air       the model has no losses to it: the damping contains them"]
        fractions, air_decays = self.air_fractions, self.air.total
        max_mode = int(np.argmax(fractions))
        fractions_text, place = (
            _median_and_maximum(fractions),
            rounded(self.frequencies[max_mode], 4),
        )
        lines = [f"air       takes {fractions_text}, at {place} Hz: the damping is without it"]
        min_air_decays = self.air.surface + self.air.sound * 10 ** (-self.air.uncertainty / 10)
        is_too_much, is_wrong = air_decays > self.decays, min_air_decays > self.decays
        if is_too_much.any():
            modes = counted(int(is_too_much.sum()), "mode")
            lines.append(
                f"note: by the air alone {modes} would decay faster than recorded, "
                f"{int((is_too_much & ~is_wrong).sum())} within its uncertainty"
            )
        if is_wrong.any():
            modes = counted(int(is_wrong.sum()), "mode")
            lines.append(
                f"caution: {modes} would by more than that uncertainty: check the size, the wall "
                "and the density"
            )
        return lines


def _describe_errors(errors: Array) -> str:
    """Return the relative errors of the damping as text."""
    if np.isfinite(errors).all():
        return f"error {_median_and_maximum(errors)}"
    count = int(np.count_nonzero(np.isinf(errors)))
    return f"unknown for {count} of {len(errors)} modes: the air alone explains their decay"


def _median_and_maximum(fractions: Array) -> str:
    median, maximum = (rounded(100 * statistic(fractions), 2) for statistic in (np.median, np.max))
    return f"{median} % in the median, {maximum} % at most"


@checked
def calibrated(
    fitted: FittedModes | ModalModel,
    model: ModalModel,
    *,
    recompute: Callable[[Material], ModalModel] | None = None,
    widest: float = 2.0,
    size_error: float = 0.0,
) -> Calibration:
    """Infer a material from modes fitted to a recording and a model of the same shape.

    Parameters
    ----------
    fitted : FittedModes or ModalModel
        Any object with `frequencies`, `decays` and `gains`; standard errors are used if it has
        them. The pairs of modes need not be known.
    model : ModalModel
        Computed model of the body, of an approximate material.
    recompute : callable, optional
        Called as ``recompute(material)``; computes the model of another material, if that is exact
        and cheap. Default: modes change with Poisson's ratio by their slopes, within 0.2 % for a
        ratio wrong by 0.05.
    widest : float, default 2.0
        Largest ratio of fitted and computed frequencies, in either direction.
    size_error : float, default 0.0
        Relative standard error of the lengths of the model: a body 1 % too large makes its material
        2 % too stiff. For a sheet the thickness over the square of its length counts.

    Returns
    -------
    Calibration
        Constants with their standard errors. If the decays of the model contain the losses to the
        air, they are computed at the fitted frequencies and taken from the fitted decays before the
        law of damping is chosen; else the law contains them.

    Raises
    ------
    MaterialError
        If tension, not stiffness, is the restoring force, or the material of the model is unknown.
    RecordingError
        If fewer than three modes can be paired, or no more than by chance.
    OptionError
        If `size_error` is below 0 or above 1, or another bound is not met.
    """
    material = inferable(model, size_error)
    partials = Partials.of(fitted)
    pairing = _require_pairs(paired(partials, model, widest=widest), partials)
    _require_agreement(partials, model, pairing)
    if recompute is not None:
        model, pairing = _recompute_until_settled(partials, model, pairing, recompute)
    fit = elastic_fit(partials, Expected(model=model), pairing, material.poisson_ratio)
    base = inferable(model)
    mode_values = partials.natural_frequencies, partials.decays, partials.decay_errors
    frequencies, decays, decay_errors = (values[pairing.fitted] for values in mode_values)
    air = losses_to_air(model, frequencies, pairing.computed)
    covariance = fit.covariance + np.diag([(2 * size_error) ** 2, 0.0])
    return Calibration(
        specific_stiffness=base.youngs_modulus / base.density * float(np.exp(2 * fit.shift)),
        poisson_ratio=fit.ratio,
        covariance=covariance,
        freedom=fit.freedom,
        scatter=fit.scatter,
        losses=losses(frequencies, decays, decay_errors, air=air),
        air=air,
        frequencies=frequencies,
        decays=decays,
        decay_errors=decay_errors,
        density=material.density,
        name=material.name,
        pairing=pairing,
        model=model,
        residuals=1200 / np.log(2) * fit.residuals,
    )


def losses_to_air(model: ModalModel, natural: Array, modes: Index) -> AirLosses | None:
    """Return the losses of some modes (K,) to the air if they have other frequencies (K,), Hz.

    None if the decays of the model do not contain such losses. A timbre field is computed at the
    frequencies of the model alone: the losses by its sound follow the estimate from there, and by
    as much as that changes they are uncertain.
    """
    gains = model.gains
    if not (model.air and isinstance(gains, ShapeGains) and gains.losses):
        return None
    losses_of_estimate = gains.changed(natural, modes, 1.0, 1.0).losses
    if not gains.directional or losses_of_estimate is None:
        return losses_of_estimate
    estimated_losses = ShapeGains.changed(
        gains, model.natural_frequencies[modes], modes, 1.0, 1.0
    ).losses
    computed_losses = gains.losses.chosen(modes)
    if estimated_losses is None:
        return computed_losses
    factors = losses_of_estimate.sound / np.maximum(estimated_losses.sound, np.finfo(float).tiny)
    changes = np.abs(10 * np.log10(np.maximum(factors, np.finfo(float).tiny)))
    return replace(
        losses_of_estimate,
        sound=computed_losses.sound * factors,
        uncertainty=np.minimum(
            computed_losses.uncertainty + changes, losses_of_estimate.uncertainty
        ),
    )


@checked
def inferable(model: ModalModel, size_error: float = 0.0) -> Material:
    """Return the material of a model, if a body's true material can be inferred from it.

    Parameters
    ----------
    model : ModalModel
        Computed model of the measured body.
    size_error : float, default 0.0
        Relative standard error of the size of the body.

    Returns
    -------
    Material
        The material of the model.

    Raises
    ------
    MaterialError
        If tension, not stiffness, is the restoring force, or the material of the model is unknown.
    OptionError
        If `size_error` is below 0 or above 1, or another bound is not met.
    """
    hint = "give a relative error of at least 0"
    require_number("size_error", size_error, 0, 1, hint=hint)
    if model.material is None:
        raise MaterialError("the model's own material is unknown: analyze the shape with a guess")
    if model.tensioned:
        raise MaterialError(
            "tension, not stiffness, drives this body back: its frequencies do not tell what it "
            "is made of"
        )
    return model.material


def _require_pairs(pairing: Pairing, partials: Partials) -> Pairing:
    if len(pairing) < MIN_PAIRS:
        raise RecordingError(
            f"{len(pairing)} of {len(partials.frequencies)} fitted modes could be paired with the "
            f"model's, fewer than {MIN_PAIRS}: check the shape and its size, or analyze it "
            "in a material nearer to the body's"
        )
    return pairing


def _require_agreement(partials: Partials, model: ModalModel, pairing: Pairing) -> None:
    if not explains(partials, model, pairing):
        raise RecordingError(
            f"only {len(pairing)} of {len(partials.frequencies)} fitted modes agree with the "
            f"model's {len(model.frequencies)}, no more than with random ones: check that it is "
            "the body recorded, its shape and how it was held"
        )


def _recompute_until_settled(
    partials: Partials,
    model: ModalModel,
    pairing: Pairing,
    recompute: Callable[[Material], ModalModel],
) -> tuple[ModalModel, Pairing]:
    """Compute the body again until its material agrees with the recording."""
    first_material = inferable(model)
    for _ in range(_ROUNDS):
        material = inferable(model)
        fit = elastic_fit(partials, Expected(model=model), pairing, first_material.poisson_ratio)
        if abs(fit.shift) + abs(fit.ratio - material.poisson_ratio) < _MAX_LAST_STEP:
            break
        stiffness = material.youngs_modulus * float(np.exp(2 * fit.shift))
        new_material = replace(material, youngs_modulus=stiffness, poisson_ratio=fit.ratio)
        model = recompute(new_material)
        pairing = _require_pairs(paired(partials, model, widest=1), partials)
    return model, pairing

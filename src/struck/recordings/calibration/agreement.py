"""Agreement of fitted modes with computed ones under hypotheses, improved step by step.

Expectation maximisation: how likely each pair is under a hypothesis, then the hypothesis that suits
these pairs best (A. P. Dempster, N. M. Laird and D. B. Rubin, Journal of the Royal Statistical
Society B 39, 1977).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from struck.errors import RecordingError, rounded
from struck.model.arrays import Array, Index
from struck.model.model import ModalModel
from struck.model.modes import Stiffness, changed

LEAST_RATIO, GREATEST_RATIO = -0.9, 0.49  # Poisson's ratios that a search may try


@dataclass(frozen=True, kw_only=True, eq=False)
class Expected:
    """Modes that a computed model expects of a body for any Poisson's ratio."""

    model: ModalModel  # the body as computed

    @cached_property
    def stiffness(self) -> Stiffness:
        """Frequencies of the model's modes and how they follow the material."""
        model = self.model
        return Stiffness(
            frequencies=model.natural_frequencies,
            poisson_slopes=model.poisson_slopes,
            errors=model.errors,
            complete_to=model.complete_to,
            tensioned=model.tensioned,
        )

    @property
    def poisson_ratio(self) -> float:
        """The model's own; NaN where its material is unknown."""
        return np.nan if self.model.material is None else self.model.material.poisson_ratio

    @property
    def follows(self) -> bool:
        """Whether the model knows how its modes follow Poisson's ratio."""
        slopes = self.model.poisson_slopes
        is_known = slopes is not None and bool(np.isfinite(slopes).all())
        return is_known and self.model.material is not None and not self.model.tensioned

    def remade(self, ratio: float) -> Stiffness:
        """Return the modes with another Poisson's ratio, Young's modulus and density kept."""
        material = self.model.material
        if not self.follows or material is None:
            return self.stiffness
        return changed(self.stiffness, material, replace(material, poisson_ratio=ratio))

    def logarithms(self, ratios: Array) -> tuple[Array, Array]:
        """Return ln f0 and its slopes over Poisson's ratio, both (H, M), for ratios (H,)."""
        if not self.follows:
            log_frequencies = np.log(self.stiffness.frequencies)
            return np.tile(log_frequencies, (len(ratios), 1)), np.zeros(
                (len(ratios), len(log_frequencies))
            )
        stiffnesses = [self.remade(float(ratio)) for ratio in ratios]
        slopes = [np.asarray(stiffness.poisson_slopes, np.float64) for stiffness in stiffnesses]
        return np.log([stiffness.frequencies for stiffness in stiffnesses]), np.array(slopes)


# Every fitted mode could be every computed one; each such pair votes for the factor between the
# two. True pairs agree, false ones scatter (a Hough transform: D. H. Ballard, 'Generalizing the
# Hough transform to detect arbitrary shapes', Pattern Recognition 13, 1981).

_RATIOS = np.arange(0.0, 0.49, 0.02)
# disagreement of true pairs about ln of the factor; 0.003 comes from the ratios' grid
_WIDTHS = (0.004, 0.016)
_MAX_GUESSES = 12  # guesses
_NEIGHBOURS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypotheses:
    """H hypotheses on the factor, Poisson's ratio and shares by which two sets of modes differ."""

    shifts: Array  # (H,), ln of the factor from computed to fitted frequencies
    ratios: Array  # (H,), Poisson's
    scatters: Array  # (H,), standard deviation of ln f about what the model expects
    detection_rates: Array  # (H,), fraction of the computed modes that were fitted
    false_fractions: Array  # (H,), fraction of the fitted modes that the model does not have

    @classmethod
    def of(cls, shifts: Array, ratios: Array, scatters: Array) -> Hypotheses:
        """Return hypotheses that 80 % of the modes were fitted and 20 % are not of the body."""
        ones = np.ones(len(shifts))
        return cls(
            shifts=shifts,
            ratios=ratios,
            scatters=scatters,
            detection_rates=0.8 * ones,
            false_fractions=0.2 * ones,
        )

    def __len__(self) -> int:
        return len(self.shifts)

    def and_narrower(self, factor: float) -> Hypotheses:
        """Return all cases, and all again with scatters divided by a factor."""
        twice = self.chosen(np.tile(np.arange(len(self)), 2))
        return replace(twice, scatters=np.concatenate([self.scatters, self.scatters / factor]))

    def chosen(self, cases: Index) -> Hypotheses:
        """Return some of the hypotheses."""
        return replace(self, **{name: getattr(self, name)[cases] for name in self.__slots__})


def densities(logarithms: Array) -> Array:
    """Return modes for each unit of ln f around each of (M,), ascending: three on either side."""
    place = np.arange(len(logarithms))
    low = np.maximum(place - _NEIGHBOURS, 0)
    high = np.minimum(place + _NEIGHBOURS, len(place) - 1)
    # A lone mode tells no density: as if the next were an octave away.
    spans = np.where(high > low, logarithms[high] - logarithms[low], np.log(2))
    return np.maximum(high - low, 1) / np.maximum(spans, 1e-3)


def guesses(log_frequencies: Array, expected: Expected, max_factor: float) -> Hypotheses:
    """Return likely factors up to `max_factor` and Poisson's ratios for ascending ln f0 (M,)."""
    if max_factor == 1:
        ratios = np.array([expected.poisson_ratio])
        return Hypotheses.of(np.zeros(1), ratios, np.array([_WIDTHS[0]]))
    votes = [
        _find_votes(log_frequencies, expected, float(np.log(max_factor)), width)
        for width in _WIDTHS
    ]
    return Hypotheses.of(*(np.concatenate(values) for values in zip(*votes, strict=True)))


def _find_votes(
    log_frequencies: Array, expected: Expected, widest: float, width: float
) -> tuple[Array, Array, Array]:
    """Return shifts, ratios and scatters of the most voted for."""
    model_ratio = expected.poisson_ratio
    ratios = np.array([model_ratio])
    if expected.follows and np.ptp(expected.logarithms(ratios)[1]) > width:
        ratios = np.union1d(_RATIOS, model_ratio)
    logarithms, _ = expected.logarithms(ratios)
    edges = np.arange(-widest - width, widest + 1.5 * width, width)
    # The weight of a pair: sparse modes are more specific.
    weights = np.log1p(1 / (densities(log_frequencies) * width))
    votes = np.array(
        [
            _votes(log_frequencies, expected_logarithms, weights, edges)
            for expected_logarithms in logarithms
        ]
    )
    cases, bins = _peaks(votes)
    bin_centres = (edges[:-1] + edges[1:]) / 2
    return bin_centres[bins], ratios[cases], np.full(len(bins), 2 * width)


def _votes(
    log_frequencies: Array, expected_logarithms: Array, weights: Array, edges: Array
) -> Array:
    differences = log_frequencies[:, None] - expected_logarithms
    spread_weights = np.broadcast_to(weights[:, None], differences.shape)
    counts, _ = np.histogram(differences, edges, weights=spread_weights)
    return np.convolve(counts, [0.5, 1.0, 0.5], mode="same")


def _peaks(votes: Array) -> tuple[Index, Index]:
    """Return cases and bins of the highest peaks, no two in neighbouring bins of close cases."""
    order = np.argsort(-votes, axis=None, kind="stable")[: 40 * _MAX_GUESSES]
    cases, bins = np.unravel_index(order, votes.shape)
    peaks: list[int] = []
    for place in range(len(order)):
        is_near = (np.abs(bins[peaks] - bins[place]) < 3) & (
            np.abs(cases[peaks] - cases[place]) < 3
        )
        if not is_near.any():
            peaks.append(place)
        if len(peaks) == _MAX_GUESSES:
            break
    return cases[peaks], bins[peaks]


# All matchings of two ordered lists, one to one and in order, and how likely each pair is in them.
#
# A matching's likelihood is the product of its pairs' odds: how many times likelier each is as a
# pair than as two lonely entries. Sums over all matchings, which are far too many to list, take one
# pass in each direction (the forward-backward algorithm: R. Durbin, S. Eddy, A. Krogh and G.
# Mitchison, Biological Sequence Analysis, Cambridge University Press, 1998, chapters 3 and 4).


def posteriors(odds: Array) -> tuple[Array, Array]:
    """Return probabilities of pairs (H, M, N) and ln of the likelihood sums (H,) of all matchings.

    `odds` (H, M, N) are likelihoods of each pair over those of two unpaired entries; the
    empty matching has the likelihood 1.
    """
    first, reached = _sum_matchings(odds)
    last, left = _sum_matchings(odds[:, ::-1, ::-1])
    sums_before, sums_after = first[:-1, :, :-1], last[::-1, :, ::-1][1:, :, 1:]
    total = reached[-1]
    scale = np.exp(reached[:-1] + left[::-1][1:] - total)
    return sums_before.swapaxes(0, 1) * odds * (sums_after * scale[:, :, None]).swapaxes(
        0, 1
    ), total


def _sum_matchings(odds: Array) -> tuple[Array, Array]:
    """Return sums over the matchings of the first i with the first j entries (M + 1, H, N + 1).

    Each row is divided by its largest, whose logarithm (M + 1, H) is returned too. Entry i is
    either alone, or paired with some k up to j while those before i keep to those before k.
    """
    cases, rows, columns = odds.shape
    sums = np.ones((rows + 1, cases, columns + 1))
    logarithms = np.zeros((rows + 1, cases))
    for row in range(rows):
        row_sums, following = sums[row], sums[row + 1]
        np.cumsum(odds[:, row] * row_sums[:, :-1], axis=1, out=following[:, 1:])
        following[:, 0] = 0.0
        following += row_sums
        row_maxima = following[:, -1:].copy()
        following /= row_maxima
        logarithms[row + 1] = logarithms[row] + np.log(row_maxima[:, 0])
    return sums, logarithms


_LISTENER_DISTANCE = 1.0  # least distance of the listener of a model from its centre, m


@runtime_checkable
class FittedModes(Protocol):
    """Modes fitted to a recording.

    `frequency_errors` (Hz) and `decay_errors` (1/s), standard errors of (M,) modes, count where the
    object has them.
    """

    @property
    def frequencies(self) -> ArrayLike:
        """Ringing frequencies, Hz (M,)."""
        ...

    @property
    def decays(self) -> ArrayLike:
        """Decay rates, 1/s (M,)."""
        ...

    @property
    def gains(self) -> ArrayLike:
        """Complex gains, (M,) or (channels, M)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Partials:
    """Modes as heard, in any order, checked."""

    frequencies: Array  # (M,), ringing, Hz
    decays: Array  # (M,), 1/s
    amplitudes: Array  # (M,), of the gains; root mean square over channels
    frequency_errors: Array  # (M,), standard errors, Hz; 0 where unknown
    decay_errors: Array  # (M,), 1/s

    def __post_init__(self) -> None:
        count = len(self.frequencies)
        if not count:
            raise RecordingError("the recording has 0 fitted modes: there is nothing to pair")
        for name in self.__slots__:
            values = getattr(self, name)
            if values.shape != (count,):
                raise RecordingError(f"{name} of {count} modes have shape {values.shape}")
            if not (np.isfinite(values).all() and values.min() >= 0):
                raise RecordingError(f"{name} hold {rounded(values.min())}: leave such modes out")
        if self.frequencies.min() <= 0:
            raise RecordingError("a mode rings at 0 Hz: leave it out")

    @classmethod
    def of(cls, fitted: FittedModes | Partials | ModalModel) -> Partials:
        """Take fitted modes of any make; of a model, as its default contact sounds."""
        if isinstance(fitted, Partials):
            return fitted
        if isinstance(fitted, ModalModel):
            return cls._of_model(fitted)
        frequencies = np.asarray(fitted.frequencies, np.float64)
        gains = np.atleast_2d(np.asarray(fitted.gains, np.complex128))
        return cls(
            frequencies=frequencies,
            decays=np.asarray(fitted.decays, np.float64),
            amplitudes=np.sqrt(np.square(np.abs(gains)).mean(axis=0)),
            frequency_errors=_errors(fitted, "frequency_errors", len(frequencies)),
            decay_errors=_errors(fitted, "decay_errors", len(frequencies)),
        )

    @classmethod
    def _of_model(cls, model: ModalModel) -> Partials:
        contact = model.contact()
        drives = model.gains.at(contact.point[None], contact.direction[None])[0]
        centre = np.zeros(3) if model.centre is None else model.centre
        reach = (
            _LISTENER_DISTANCE
            if model.geometry is None
            else _LISTENER_DISTANCE + 2 * model.geometry.extent
        )
        outputs = model.gains.toward(centre[None] + [reach, 0.0, 0.0])[0]
        zeros = np.zeros(len(model.frequencies))
        errors = zeros if model.errors is None else np.nan_to_num(model.errors)
        frequency_errors = errors * model.frequencies
        return cls(
            frequencies=model.frequencies,
            decays=model.decays,
            amplitudes=np.abs((drives * outputs).sum(axis=0)),
            frequency_errors=frequency_errors,
            # Noise moves a fitted pole equally far in all directions, as `standard_errors` has it.
            decay_errors=2 * np.pi * frequency_errors if model.recorded else zeros,
        )

    @property
    def natural_frequencies(self) -> Array:
        """Frequencies without damping, Hz (M,)."""
        return np.hypot(self.frequencies, self.decays / (2 * np.pi))


def _errors(fit: Any, name: str, count: int) -> Array:  # noqa: ANN401 - any result of a fit
    stated_errors = getattr(fit, name, None)
    return (
        np.zeros(count)
        if stated_errors is None
        else np.nan_to_num(np.asarray(stated_errors, np.float64))
    )


RATIO_PRIOR = 0.1  # standard deviation of Poisson's ratio about the model's own beforehand
# A scatter, and for how many pairs it counts: two or three alone never make it vanish.
_SCATTER, _SCATTER_PAIRS = 3e-4, 2.0
# A few modes lie farther off than the others, as theory or a support has it: share, and how far.
_STRAY_FRACTION, _STRAY_DEVIATION = 0.05, 3e-3
# Shares found and false, and how many modes they count for: most modes are in both.
_PRIOR_DETECTION_RATE, _PRIOR_FALSE_FRACTION, _SHARE_MODES = 0.8, 0.2, 10.0
_SHARES = (0.02, 0.98)
_LARGEST_STEP = 0.05
_END_MARGIN = 0.03  # how far beyond the ends of a list, in ln f, a partner may lie
_LARGEST_ODDS = np.exp(25.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Evidence:
    """Likelihood of H hypotheses and of their pairs of M fitted with N computed modes."""

    pairs: Array  # (H, M, N), probabilities; computed modes in ascending order
    regular: Array  # (H, M, N), the same of pairs no farther off than most
    order: Index  # (H, N), numbers of the computed modes in this order
    deviations: Array  # (H, M, N), fitted less expected ln f0
    slopes: Array  # (H, N), of the expected ln f0 over Poisson's ratio
    computed_counts: Array  # (H,), computed modes that could have been fitted
    fitted_counts: Array  # (H,), fitted modes that could have been computed
    likelihoods: Array  # (H,), logarithms up to a constant

    def over_modes(self) -> Array:
        """Return the probability of each pair (H, M, N), by numbers of the computed modes."""
        pairs = np.zeros_like(self.pairs)
        np.put_along_axis(pairs, self.order[:, None], self.pairs, axis=2)
        return pairs


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Agreement:
    """Agreement of fitted modes with computed ones."""

    log_frequencies: Array  # (M,), ln f0 of the fitted modes, ascending
    errors: Array  # (M,), their standard errors
    mode_densities: Array  # (M,), fitted modes around each for a unit of ln f
    expected: Expected
    audible: Array  # (N,), share of each computed mode that can be expected to be heard, 0 to 1

    @classmethod
    def of(cls, partials: Partials, expected: Expected, audible: Array) -> Agreement:
        """Put the fitted modes in order."""
        natural = partials.natural_frequencies
        order = np.argsort(natural, kind="stable")
        log_frequencies = np.log(natural[order])
        return cls(
            log_frequencies=log_frequencies,
            errors=(partials.frequency_errors / natural)[order],
            mode_densities=densities(log_frequencies),
            expected=expected,
            audible=audible,
        )

    def under(self, cases: Hypotheses) -> Evidence:
        """Return the evidence for hypotheses."""
        logarithms, slopes = self.expected.logarithms(cases.ratios)
        logarithms = logarithms + cases.shifts[:, None]
        order = np.argsort(logarithms, axis=1, kind="stable")
        logarithms, slopes = (np.take_along_axis(a, order, axis=1) for a in (logarithms, slopes))
        deviations = self.log_frequencies[:, None] - logarithms[:, None]
        chances = cases.detection_rates[:, None] * self.audible[order]
        odds, regular = self._odds(deviations, cases)
        odds = odds * (chances / (1 - chances))[:, None]
        pairs, sums = posteriors(np.minimum(odds, _LARGEST_ODDS))
        low, high = self.log_frequencies[0] - _END_MARGIN, self.log_frequencies[-1] + _END_MARGIN
        is_within = (logarithms > low) & (logarithms < high)
        fitted_counts = (self.log_frequencies < logarithms[:, -1:] + _END_MARGIN).sum(axis=1)
        unpaired_terms = (np.log1p(-chances) * is_within).sum(axis=1) + np.log(
            cases.false_fractions
        ) * fitted_counts
        return Evidence(
            pairs=pairs,
            regular=pairs * regular,
            order=order,
            deviations=deviations,
            slopes=slopes,
            computed_counts=(self.audible[order] * is_within).sum(axis=1),
            fitted_counts=fitted_counts.astype(np.float64),
            likelihoods=sums + unpaired_terms + self._priors(cases),
        )

    def improved(self, cases: Hypotheses, evidence: Evidence) -> Hypotheses:
        """Return hypotheses that suit the evidence better."""
        steps = self._steps(cases, evidence)
        count = evidence.pairs.sum(axis=(1, 2))
        prior = _SHARE_MODES
        detection_rates = (count + prior * _PRIOR_DETECTION_RATE) / (
            evidence.computed_counts + prior
        )
        false_fractions = (evidence.fitted_counts - count + prior * _PRIOR_FALSE_FRACTION) / (
            evidence.fitted_counts + prior
        )
        return Hypotheses(
            shifts=cases.shifts + steps[0],
            ratios=np.clip(cases.ratios + steps[1], LEAST_RATIO, GREATEST_RATIO),
            scatters=self._scatters(cases, evidence),
            detection_rates=np.clip(detection_rates, *_SHARES),
            false_fractions=np.clip(false_fractions, *_SHARES),
        )

    def _odds(self, deviations: Array, cases: Hypotheses) -> tuple[Array, Array]:
        """Return odds of pairs, all modes being found, and which share of them is regular."""
        variances = self._variances(cases)
        regular_likelihoods = (1 - _STRAY_FRACTION) * _gaussian_density(deviations, variances)
        stray_likelihoods = _STRAY_FRACTION * _gaussian_density(
            deviations, variances + _STRAY_DEVIATION**2
        )
        likelihoods = regular_likelihoods + stray_likelihoods
        false_densities = (cases.false_fractions[:, None] * self.mode_densities)[:, :, None]
        return likelihoods / false_densities, regular_likelihoods / np.maximum(
            likelihoods, np.finfo(float).tiny
        )

    def _variances(self, cases: Hypotheses) -> Array:
        return (cases.scatters[:, None] ** 2 + self.errors**2)[:, :, None]

    def _priors(self, cases: Hypotheses) -> Array:
        detection_terms = _PRIOR_DETECTION_RATE * np.log(cases.detection_rates) + (
            1 - _PRIOR_DETECTION_RATE
        ) * np.log(1 - cases.detection_rates)
        false_terms = _PRIOR_FALSE_FRACTION * np.log(cases.false_fractions) + (
            1 - _PRIOR_FALSE_FRACTION
        ) * np.log(1 - cases.false_fractions)
        return _SHARE_MODES * (detection_terms + false_terms) - self._strange(cases) ** 2 / 2

    def _strange(self, cases: Hypotheses) -> Array:
        """Return how far ratios are from the model's own, in standard deviations (H,)."""
        if not self.expected.follows:
            return np.zeros(len(cases))
        return (cases.ratios - self.expected.poisson_ratio) / RATIO_PRIOR

    def _steps(self, cases: Hypotheses, evidence: Evidence) -> tuple[Array, Array]:
        """Return least-squares steps of shift and ratio, pairs weighted by their probability.

        Poisson's ratio, when little heard depends on it, keeps to the model's own.
        """
        weights = evidence.regular / self._variances(cases)
        slopes, deviations = evidence.slopes[:, None], evidence.deviations
        plain, mixed, square, shift_force, ratio_force = (
            (weights * term).sum(axis=(1, 2))
            for term in (1.0, slopes, slopes**2, deviations, deviations * slopes)
        )
        plain = plain + 1.0  # a case without pairs stays where it is
        square = square + 1 / RATIO_PRIOR**2
        ratio_force = ratio_force - self._strange(cases) / RATIO_PRIOR
        ratio = (plain * ratio_force - mixed * shift_force) / (plain * square - mixed**2)
        ratio = np.clip(ratio, -_LARGEST_STEP, _LARGEST_STEP)
        return (shift_force - mixed * ratio) / plain, ratio

    def _scatters(self, cases: Hypotheses, evidence: Evidence) -> Array:
        """Return scatters about expected frequencies, errors of fitting apart (H,)."""
        scatter_variances = cases.scatters[:, None, None] ** 2
        scatter_fractions = scatter_variances / self._variances(cases)
        squares = (scatter_fractions * evidence.deviations) ** 2 + scatter_variances * (
            1 - scatter_fractions
        )
        total = (evidence.regular * squares).sum(axis=(1, 2)) + _SCATTER_PAIRS * _SCATTER**2
        count = evidence.regular.sum(axis=(1, 2))
        freedom = np.maximum(count - 1 - self.expected.follows, 0) + _SCATTER_PAIRS
        return np.sqrt(total / freedom)


def _gaussian_density(deviations: Array, variances: Array) -> Array:
    return np.exp(-(deviations**2) / (2 * variances)) / np.sqrt(2 * np.pi * variances)

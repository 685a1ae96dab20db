"""Which fitted mode is which computed one: one to one, with a factor and Poisson's ratio unknown.

A computed mode is fitted with some probability, and then lies about where the model expects it;
other fitted modes are not in the model, and as dense as the fitted modes around them. All matchings
of the two lists in order are weighted by likelihood; factor, ratio, scatter and fractions are
estimated by expectation maximisation, from start values that most pairs vote for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from struck.errors import OptionError, RecordingError, rounded
from struck.model.arrays import Array, Index
from struck.model.model import ModalModel
from struck.recordings.calibration.agreement import (
    Agreement,
    Expected,
    FittedModes,
    Hypotheses,
    Partials,
    guesses,
)

_FIRST_ROUNDS, _ROUNDS = 6, 40
_RIVALS = 6
# Rounds end when no case moves by more than this share of its scatter.
_MAX_LAST_STEP = 0.01
# From a wide scatter and from a narrow one: either may take a stray for a partner or miss many.
_NARROWING_FACTOR = 5.0
# Hypotheses this close are one.
_SAME_SHIFT, _SAME_RATIO = 2e-3, 0.02


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pairing:
    """Fitted modes with the computed ones that they are."""

    fitted: Index  # (P,), numbers of the modes, by ascending fitted frequency
    computed: Index  # (P,), their partners
    confidence: Array  # (P,), probabilities; below 0.5 where neighbours may be exchanged
    extra: Index  # fitted modes without a partner
    missing: Index  # computed modes without a partner
    # Fitted over computed frequencies at `poisson_ratio`: the root of E / density over the model's,
    # times the model's size over the body's.
    factor: float
    # best for the model; its own where slopes are unknown, NaN without a material
    poisson_ratio: float
    scatter: float  # standard deviation of ln f about `expected`, errors of fitting apart
    expected: Array  # (N,), natural frequencies with this factor and ratio, Hz
    certainty: float  # probability of this factor and ratio among all hypotheses
    # ln of how much likelier the fitted modes are with the model than alone. Above 0 the model
    # surely explains the recording; below, `beyond_chance` tells.
    support: float

    def __len__(self) -> int:
        return len(self.fitted)


def paired(
    fitted: FittedModes | Partials,
    model: ModalModel,
    *,
    widest: float = 2.0,
    audible: ArrayLike | None = None,
) -> Pairing:
    """Find which fitted mode is which of a model's modes.

    Some may be missing, some not of the body. `widest` is the largest factor between their
    frequencies, 1 where factor and Poisson's ratio are known to some parts in a thousand;
    `audible` (N,), 0 to 1, is how far each computed mode can be expected in the recording: one that
    was not woken is not missed.
    """
    partials = Partials.of(fitted)
    if not len(model.frequencies):
        raise RecordingError("the model has 0 modes to pair with: widen its band")
    if not (np.isfinite(widest) and widest >= 1):
        raise OptionError(f"widest is {widest}: give the largest factor, at least 1")
    shares = _audible_fractions(audible, len(model.frequencies))
    agreement = Agreement.of(partials, Expected(model=model), shares)
    cases, likelihoods = _guess_hypotheses(agreement, widest)
    best_cases = np.argsort(-likelihoods, kind="stable")[:_RIVALS]
    cases = _improve(agreement, cases.chosen(best_cases).and_narrower(_NARROWING_FACTOR), _ROUNDS)
    return _decide(agreement, cases, np.argsort(partials.natural_frequencies, kind="stable"))


def first_support(partials: Partials, model: ModalModel, max_factor: float = 2.0) -> float:
    """Return about the support of the best pairing: ln of its likelihood after a few rounds."""
    shares = _audible_fractions(None, len(model.frequencies))
    agreement = Agreement.of(partials, Expected(model=model), shares)
    return float(_guess_hypotheses(agreement, max_factor)[1].max())


def _guess_hypotheses(agreement: Agreement, max_factor: float) -> tuple[Hypotheses, Array]:
    """Return hypotheses with their likelihoods, a few rounds from the first guesses."""
    cases = _improve(
        agreement, guesses(agreement.log_frequencies, agreement.expected, max_factor), _FIRST_ROUNDS
    )
    return cases, agreement.under(cases).likelihoods


def _audible_fractions(audible: ArrayLike | None, count: int) -> Array:
    shares = np.ones(count) if audible is None else np.asarray(audible, np.float64)
    if shares.shape != (count,) or not ((shares >= 0) & (shares <= 1)).all():
        raise OptionError(
            f"audible has shape {shares.shape} and reaches from {rounded(shares.min())} to "
            f"{rounded(shares.max())}: give a share from 0 to 1 for each of {count} modes"
        )
    return shares


def _improve(agreement: Agreement, cases: Hypotheses, rounds: int) -> Hypotheses:
    for _ in range(rounds):
        previous_cases = cases
        cases = agreement.improved(cases, agreement.under(cases))
        steps = np.abs(cases.shifts - previous_cases.shifts) + np.abs(
            cases.scatters - previous_cases.scatters
        )
        if np.all(steps < _MAX_LAST_STEP * cases.scatters):
            break
    return cases


def _decide(agreement: Agreement, cases: Hypotheses, order: Index) -> Pairing:
    """Pair fitted with computed modes, where the probability over all hypotheses exceeds 50 %."""
    evidence = agreement.under(cases)
    weights, best_case, certainty = _weights(cases, evidence.likelihoods)
    probabilities: Array = (weights[:, None, None] * evidence.over_modes()).sum(axis=0)
    ratio, scatter = float(cases.ratios[best_case]), float(cases.scatters[best_case])
    logarithms = agreement.expected.logarithms(np.array([ratio]))[0][0] + cases.shifts[best_case]
    rows, columns = linear_sum_assignment(probabilities, maximize=True)
    confidence = _confidences(probabilities, logarithms, rows, columns, scatter)
    is_sure = confidence > 0.5
    rows, columns = rows[is_sure], columns[is_sure]
    steadiness = _steadiness(agreement, rows, logarithms[columns], scatter)
    return Pairing(
        fitted=order[rows],
        computed=columns.astype(np.int64),
        confidence=np.minimum(confidence[is_sure], 1.0) * steadiness,
        extra=np.sort(np.delete(order, rows)),
        missing=np.delete(np.arange(len(logarithms)), columns),
        factor=float(np.exp(cases.shifts[best_case])),
        poisson_ratio=ratio,
        scatter=scatter,
        expected=np.exp(logarithms),
        certainty=certainty,
        support=float(evidence.likelihoods[best_case]),
    )


def _weights(cases: Hypotheses, likelihoods: Array) -> tuple[Array, int, float]:
    """Return probabilities of the cases, the number of the best, and that it and its like have.

    Cases that have come to the same place share the probability of one of them.
    """
    best_case = int(np.argmax(likelihoods))
    weights = np.exp(likelihoods - likelihoods[best_case])
    is_same = np.abs(cases.shifts - cases.shifts[best_case]) < _SAME_SHIFT
    is_same &= ~(np.abs(cases.ratios - cases.ratios[best_case]) >= _SAME_RATIO)
    weights = np.where(is_same, weights / is_same.sum(), weights)
    weights /= weights.sum()
    return weights, best_case, float(weights[is_same].sum())


def _confidences(
    probabilities: Array, logarithms: Array, rows: Index, columns: Index, scatter: float
) -> Array:
    """Return the probability that each fitted mode is its computed one, or one of equal frequency.

    Modes of round bodies are in pairs of one frequency: which of the two was fitted does not
    matter.
    """
    has_same_frequency = np.abs(logarithms - logarithms[columns, None]) < scatter
    return np.where(has_same_frequency, probabilities[rows], 0.0).sum(axis=1)


def _steadiness(agreement: Agreement, rows: Index, logarithms: Array, scatter: float) -> Array:
    """Return how likely pairs are not exchanged with neighbours, whose order may be wrong."""
    variances = agreement.errors[rows] ** 2 + scatter**2
    fitted_steps, expected_steps = np.diff(agreement.log_frequencies[rows]), np.diff(logarithms)
    mean_variances = (variances[1:] + variances[:-1]) / 2
    exchange_odds = np.exp(-np.maximum(fitted_steps * expected_steps, 0) / mean_variances) * (
        expected_steps > scatter
    )
    steadiness = np.ones(len(rows))
    steadiness[1:] /= 1 + exchange_odds
    steadiness[:-1] /= 1 + exchange_odds
    return steadiness


SIGNIFICANT = 4.0  # standard deviations beyond chance at which a model is taken to be the body's
_TRIALS = 8
_MIN_DEVIATION = 1e-3  # one mode fits any other as well
_TWINS = 1e-3  # relative distance of modes that are one frequency's
_SMOOTHING_MODES = 4  # modes between the knots of the curve that random frequencies follow


def explains(fit: FittedModes | Partials, model: ModalModel, pairing: Pairing) -> bool:
    """Return whether fitted modes agree with a model better than with random ones."""
    if not len(pairing):
        return False
    return pairing.support > 0 or beyond_chance(fit, model) >= SIGNIFICANT


def pairs_by_chance(
    fit: FittedModes | Partials, model: ModalModel, *, widest: float, seed: int = 0
) -> float:
    """Return how many pairs random models of as many modes get on average."""
    chance, partials = np.random.default_rng(seed), Partials.of(fit)
    pair_counts = [
        len(paired(partials, _random_model(model, chance), widest=widest)) for _ in range(_TRIALS)
    ]
    return float(np.mean(pair_counts))


def beyond_chance(fit: FittedModes | Partials, model: ModalModel, *, seed: int = 0) -> float:
    """Return how far a model's support lies above that of random ones, standard deviations."""
    chance = np.random.default_rng(seed)
    partials = Partials.of(fit)
    model_support = first_support(partials, model)
    trials = [first_support(partials, _random_model(model, chance)) for _ in range(_TRIALS)]
    return float(
        (model_support - np.mean(trials)) / max(float(np.std(trials, ddof=1)), _MIN_DEVIATION)
    )


def _random_model(model: ModalModel, chance: Generator) -> ModalModel:
    """Return a model with as many modes, as dense, but elsewhere; slopes go to any of them.

    Twins, as the modes of round bodies are, stay twins.
    """
    log_frequencies = np.log(model.natural_frequencies)
    first = np.flatnonzero(np.diff(log_frequencies, prepend=-np.inf) > _TWINS)
    distinct_logarithms, count = log_frequencies[first], len(first)
    knots = np.linspace(0, count - 1, max(2, count // _SMOOTHING_MODES))
    heights = np.interp(knots, np.arange(count), distinct_logarithms)
    drawn_positions = np.sort(chance.uniform(0, count - 1, count))
    twins = chance.permutation(np.diff(first, append=len(log_frequencies)))
    frequencies = np.repeat(np.exp(np.interp(drawn_positions, knots, heights)), twins)
    slopes = model.poisson_slopes
    return replace(
        model,
        natural_frequencies=frequencies,
        poisson_slopes=None if slopes is None else slopes[chance.permutation(len(log_frequencies))],
    )

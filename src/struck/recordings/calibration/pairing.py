"""Which fitted mode is which computed one: one to one, with a factor and Poisson's ratio unknown.

A computed mode is fitted with some probability, and then lies about where the model expects it;
other fitted modes are none of the model's, and as dense as fitted modes are around. All ways to
pair the two lists in order are weighed by likelihood; factor, ratio, scatter and shares are found
by expectation maximisation, from those that most pairs vote for.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.random import Generator
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from struck.errors import OptionError, RecordingError
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

_ROUGH, _ROUNDS = 6, 40
_RIVALS = 6
# Rounds end when no case moves by more than this share of its scatter.
_SETTLED = 0.01
# From a wide scatter and from a narrow one: either may take a stray for a partner or miss many.
_NARROWER = 5.0
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
    certainty: float  # probability of this factor and ratio beside others
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

    Some may be missing, some none of the body's. `widest` is the largest factor between their
    frequencies, 1 where factor and Poisson's ratio are known but for some parts in a thousand;
    `audible` (N,), 0 to 1, is how far each computed mode can be expected in the recording: one that
    was not woken is not missed.
    """
    partials = Partials.of(fitted)
    if not len(model.frequencies):
        raise RecordingError("the model has 0 modes to pair with: widen its band")
    if not (np.isfinite(widest) and widest >= 1):
        raise OptionError(f"widest is {widest}: give the largest factor, at least 1")
    shares = _shares(audible, len(model.frequencies))
    agreement = Agreement.of(partials, Expected(model=model), shares)
    cases, likelihoods = _likely(agreement, widest)
    best = np.argsort(-likelihoods, kind="stable")[:_RIVALS]
    cases = _improved(agreement, cases.chosen(best).and_narrower(_NARROWER), _ROUNDS)
    return _decided(agreement, cases, np.argsort(partials.natural_frequencies, kind="stable"))


def first_support(partials: Partials, model: ModalModel, widest: float = 2.0) -> float:
    """Return about the support of the best pairing: ln of its likelihood after a few rounds."""
    shares = _shares(None, len(model.frequencies))
    agreement = Agreement.of(partials, Expected(model=model), shares)
    return float(_likely(agreement, widest)[1].max())


def _likely(agreement: Agreement, widest: float) -> tuple[Hypotheses, Array]:
    """Return hypotheses with their likelihoods, a few rounds from the first guesses."""
    cases = _improved(agreement, guesses(agreement.heard, agreement.expected, widest), _ROUGH)
    return cases, agreement.under(cases).likelihoods


def _shares(audible: ArrayLike | None, count: int) -> Array:
    shares = np.ones(count) if audible is None else np.asarray(audible, np.float64)
    if shares.shape != (count,) or not ((shares >= 0) & (shares <= 1)).all():
        raise OptionError(
            f"audible has shape {shares.shape} and reaches from {shares.min():g} to "
            f"{shares.max():g}: give a share from 0 to 1 for each of {count} modes"
        )
    return shares


def _improved(agreement: Agreement, cases: Hypotheses, rounds: int) -> Hypotheses:
    for _ in range(rounds):
        before = cases
        cases = agreement.improved(cases, agreement.under(cases))
        steps = np.abs(cases.shifts - before.shifts) + np.abs(cases.scatters - before.scatters)
        if np.all(steps < _SETTLED * cases.scatters):
            break
    return cases


def _decided(agreement: Agreement, cases: Hypotheses, order: Index) -> Pairing:
    """Pair fitted with computed modes, where the probability over all hypotheses exceeds 50 %."""
    evidence = agreement.under(cases)
    weights, best, certainty = _weights(cases, evidence.likelihoods)
    likely: Array = (weights[:, None, None] * evidence.over_modes()).sum(axis=0)
    ratio, scatter = float(cases.ratios[best]), float(cases.scatters[best])
    logarithms = agreement.expected.logarithms(np.array([ratio]))[0][0] + cases.shifts[best]
    rows, columns = linear_sum_assignment(likely, maximize=True)
    confidence = _confidences(likely, logarithms, rows, columns, scatter)
    sure = confidence > 0.5
    rows, columns = rows[sure], columns[sure]
    steadiness = _steadiness(agreement, rows, logarithms[columns], scatter)
    return Pairing(
        fitted=order[rows],
        computed=columns.astype(np.int64),
        confidence=np.minimum(confidence[sure], 1.0) * steadiness,
        extra=np.sort(np.delete(order, rows)),
        missing=np.delete(np.arange(len(logarithms)), columns),
        factor=float(np.exp(cases.shifts[best])),
        poisson_ratio=ratio,
        scatter=scatter,
        expected=np.exp(logarithms),
        certainty=certainty,
        support=float(evidence.likelihoods[best]),
    )


def _weights(cases: Hypotheses, likelihoods: Array) -> tuple[Array, int, float]:
    """Return probabilities of the cases, the number of the best, and that it and its like have.

    Cases that have come to the same place share the probability of one of them.
    """
    best = int(np.argmax(likelihoods))
    weights = np.exp(likelihoods - likelihoods[best])
    same = np.abs(cases.shifts - cases.shifts[best]) < _SAME_SHIFT
    same &= ~(np.abs(cases.ratios - cases.ratios[best]) >= _SAME_RATIO)
    weights = np.where(same, weights / same.sum(), weights)
    weights /= weights.sum()
    return weights, best, float(weights[same].sum())


def _confidences(
    likely: Array, logarithms: Array, rows: Index, columns: Index, scatter: float
) -> Array:
    """Return the probability that each fitted mode is its computed one, or one of equal frequency.

    A round body has its modes two by two at one frequency: which of both is heard does not matter.
    """
    alike = np.abs(logarithms - logarithms[columns, None]) < scatter
    return np.where(alike, likely[rows], 0.0).sum(axis=1)


def _steadiness(agreement: Agreement, rows: Index, logarithms: Array, scatter: float) -> Array:
    """Return how likely pairs are not exchanged with neighbours, whose order may be wrong."""
    variances = agreement.errors[rows] ** 2 + scatter**2
    heard, expected = np.diff(agreement.heard[rows]), np.diff(logarithms)
    between = (variances[1:] + variances[:-1]) / 2
    exchanged = np.exp(-np.maximum(heard * expected, 0) / between) * (expected > scatter)
    steadiness = np.ones(len(rows))
    steadiness[1:] /= 1 + exchanged
    steadiness[:-1] /= 1 + exchanged
    return steadiness


SIGNIFICANT = 4.0  # standard deviations beyond chance at which a model is taken to be the body's
_TRIALS = 8
_LEAST = 1e-3  # one mode fits any other as well
_TWINS = 1e-3  # relative distance of modes that are one frequency's
_SMOOTH = 4  # modes between which frequencies are drawn anew


def explains(fitted: FittedModes | Partials, model: ModalModel, pairing: Pairing) -> bool:
    """Return whether fitted modes agree with a model better than with random ones."""
    if not len(pairing):
        return False
    return pairing.support > 0 or beyond_chance(fitted, model) >= SIGNIFICANT


def pairs_by_chance(
    fitted: FittedModes | Partials, model: ModalModel, *, widest: float, seed: int = 0
) -> float:
    """Return how many pairs random models of as many modes get on average."""
    chance, partials = np.random.default_rng(seed), Partials.of(fitted)
    found = [len(paired(partials, _random(model, chance), widest=widest)) for _ in range(_TRIALS)]
    return float(np.mean(found))


def beyond_chance(fitted: FittedModes | Partials, model: ModalModel, *, seed: int = 0) -> float:
    """Return how far a model's support lies above that of random ones, standard deviations."""
    chance = np.random.default_rng(seed)
    partials = Partials.of(fitted)
    own = first_support(partials, model)
    trials = [first_support(partials, _random(model, chance)) for _ in range(_TRIALS)]
    return float((own - np.mean(trials)) / max(float(np.std(trials, ddof=1)), _LEAST))


def _random(model: ModalModel, chance: Generator) -> ModalModel:
    """Return a model with as many modes, as dense, but elsewhere; slopes go to any of them.

    Twins, as the modes of round bodies are, stay twins.
    """
    every = np.log(model.natural_frequencies)
    first = np.flatnonzero(np.diff(every, prepend=-np.inf) > _TWINS)
    alone, count = every[first], len(first)
    knots = np.linspace(0, count - 1, max(2, count // _SMOOTH))
    heights = np.interp(knots, np.arange(count), alone)
    drawn = np.sort(chance.uniform(0, count - 1, count))
    twins = chance.permutation(np.diff(first, append=len(every)))
    frequencies = np.repeat(np.exp(np.interp(drawn, knots, heights)), twins)
    slopes = model.poisson_slopes
    return replace(
        model,
        natural_frequencies=frequencies,
        poisson_slopes=None if slopes is None else slopes[chance.permutation(len(every))],
    )

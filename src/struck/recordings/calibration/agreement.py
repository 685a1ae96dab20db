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

from struck.errors import RecordingError
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
        known = slopes is not None and bool(np.isfinite(slopes).all())
        return known and self.model.material is not None and not self.model.tensioned

    def remade(self, ratio: float) -> Stiffness:
        """Return the modes with another Poisson's ratio, Young's modulus and density kept."""
        material = self.model.material
        if not self.follows or material is None:
            return self.stiffness
        return changed(self.stiffness, material, replace(material, poisson_ratio=ratio))

    def logarithms(self, ratios: Array) -> tuple[Array, Array]:
        """Return ln f0 and its slopes over Poisson's ratio, both (H, M), for ratios (H,)."""
        if not self.follows:
            own = np.log(self.stiffness.frequencies)
            return np.tile(own, (len(ratios), 1)), np.zeros((len(ratios), len(own)))
        every = [self.remade(float(ratio)) for ratio in ratios]
        slopes = [np.asarray(each.poisson_slopes, np.float64) for each in every]
        return np.log([each.frequencies for each in every]), np.array(slopes)


# Every fitted mode could be every computed one; each such pair votes for the factor between the
# two. True pairs agree, false ones scatter (a Hough transform: D. H. Ballard, 'Generalizing the
# Hough transform to detect arbitrary shapes', Pattern Recognition 13, 1981).

_RATIOS = np.arange(0.0, 0.49, 0.02)
# disagreement of true pairs about ln of the factor; 0.003 comes from the ratios' grid
_WIDTHS = (0.004, 0.016)
_KEPT = 12  # guesses
_NEIGHBOURS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypotheses:
    """H hypotheses on the factor, Poisson's ratio and shares by which two sets of modes differ."""

    shifts: Array  # (H,), ln of the factor from computed to fitted frequencies
    ratios: Array  # (H,), Poisson's
    scatters: Array  # (H,), standard deviation of ln f about what the model expects
    found: Array  # (H,), share of the computed modes that were fitted
    false: Array  # (H,), share of the fitted modes that the model does not have

    @classmethod
    def of(cls, shifts: Array, ratios: Array, scatters: Array) -> Hypotheses:
        """Suppose that four in five modes were found, and one in five is none of the body's."""
        share = np.ones(len(shifts))
        return cls(
            shifts=shifts, ratios=ratios, scatters=scatters, found=0.8 * share, false=0.2 * share
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


def guesses(heard: Array, expected: Expected, widest: float) -> Hypotheses:
    """Return likely factors up to `widest` and Poisson's ratios for ascending ln f0 (M,)."""
    if widest == 1:
        own = np.array([expected.poisson_ratio])
        return Hypotheses.of(np.zeros(1), own, np.array([_WIDTHS[0]]))
    every = [_voted(heard, expected, float(np.log(widest)), width) for width in _WIDTHS]
    return Hypotheses.of(*(np.concatenate(values) for values in zip(*every, strict=True)))


def _voted(
    heard: Array, expected: Expected, widest: float, width: float
) -> tuple[Array, Array, Array]:
    """Return shifts, ratios and scatters of the most voted for."""
    own = expected.poisson_ratio
    ratios = np.array([own])
    if expected.follows and np.ptp(expected.logarithms(ratios)[1]) > width:
        ratios = np.union1d(_RATIOS, own)
    logarithms, _ = expected.logarithms(ratios)
    edges = np.arange(-widest - width, widest + 1.5 * width, width)
    # What a pair is worth: modes are telling where they are sparse.
    weights = np.log1p(1 / (densities(heard) * width))
    votes = np.array([_votes(heard, each, weights, edges) for each in logarithms])
    cases, bins = _peaks(votes)
    middles = (edges[:-1] + edges[1:]) / 2
    return middles[bins], ratios[cases], np.full(len(bins), 2 * width)


def _votes(heard: Array, computed: Array, weights: Array, edges: Array) -> Array:
    differences = heard[:, None] - computed
    spread = np.broadcast_to(weights[:, None], differences.shape)
    counts, _ = np.histogram(differences, edges, weights=spread)
    return np.convolve(counts, [0.5, 1.0, 0.5], mode="same")


def _peaks(votes: Array) -> tuple[Index, Index]:
    """Return cases and bins of the highest peaks, no two in neighbouring bins of close cases."""
    order = np.argsort(-votes, axis=None, kind="stable")[: 40 * _KEPT]
    cases, bins = np.unravel_index(order, votes.shape)
    kept: list[int] = []
    for place in range(len(order)):
        near = (np.abs(bins[kept] - bins[place]) < 3) & (np.abs(cases[kept] - cases[place]) < 3)
        if not near.any():
            kept.append(place)
        if len(kept) == _KEPT:
            break
    return cases[kept], bins[kept]


# All ways to pair two ordered lists one to one, in order, and how likely each pair is in them.
#
# A matching's likelihood is the product of its pairs' odds: how many times likelier each is as a
# pair than as two lonely entries. Sums over all matchings, which are far too many to list, take one
# pass in each direction (the forward-backward algorithm: R. Durbin, S. Eddy, A. Krogh and G.
# Mitchison, Biological Sequence Analysis, Cambridge University Press, 1998, chapters 3 and 4).


def posteriors(odds: Array) -> tuple[Array, Array]:
    """Return probabilities of pairs (H, M, N) and ln of the likelihood sums (H,) of all matchings.

    `odds` (H, M, N) say how many times likelier each is as a pair than as two lonely entries; the
    empty matching has the likelihood 1.
    """
    first, reached = _sums(odds)
    last, left = _sums(odds[:, ::-1, ::-1])
    before, after = first[:-1, :, :-1], last[::-1, :, ::-1][1:, :, 1:]
    total = reached[-1]
    scale = np.exp(reached[:-1] + left[::-1][1:] - total)
    return before.swapaxes(0, 1) * odds * (after * scale[:, :, None]).swapaxes(0, 1), total


def _sums(odds: Array) -> tuple[Array, Array]:
    """Return sums over the matchings of the first i with the first j entries (M + 1, H, N + 1).

    Each row is divided by its largest, whose logarithm (M + 1, H) comes beside it. Entry i is
    either alone, or paired with some k up to j while those before i keep to those before k.
    """
    cases, rows, columns = odds.shape
    sums = np.ones((rows + 1, cases, columns + 1))
    logarithms = np.zeros((rows + 1, cases))
    for row in range(rows):
        now, following = sums[row], sums[row + 1]
        np.cumsum(odds[:, row] * now[:, :-1], axis=1, out=following[:, 1:])
        following[:, 0] = 0.0
        following += now
        largest = following[:, -1:].copy()
        following /= largest
        logarithms[row + 1] = logarithms[row] + np.log(largest[:, 0])
    return sums, logarithms


_BESIDE = 1.0  # where a model is heard from, m beyond its centre


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
                raise RecordingError(f"{name} hold {values.min():g}: leave such modes out")
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
        reach = _BESIDE if model.geometry is None else _BESIDE + 2 * model.geometry.extent
        outputs = model.gains.toward(centre[None] + [reach, 0.0, 0.0])[0]
        unknown = np.zeros(len(model.frequencies))
        errors = unknown if model.errors is None else np.nan_to_num(model.errors)
        return cls(
            frequencies=model.frequencies,
            decays=model.decays,
            amplitudes=np.abs((drives * outputs).sum(axis=0)),
            frequency_errors=errors * model.frequencies,
            decay_errors=unknown,
        )

    @property
    def natural_frequencies(self) -> Array:
        """Frequencies without damping, Hz (M,)."""
        return np.hypot(self.frequencies, self.decays / (2 * np.pi))


def _errors(fitted: Any, name: str, count: int) -> Array:  # noqa: ANN401 - whoever fitted it
    stated = getattr(fitted, name, None)
    return np.zeros(count) if stated is None else np.nan_to_num(np.asarray(stated, np.float64))


RATIO_PRIOR = 0.1  # standard deviation of Poisson's ratio about the model's own beforehand
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
    """Likelihood of H hypotheses and of their pairs of M fitted with N computed modes."""

    pairs: Array  # (H, M, N), probabilities; computed modes in ascending order
    regular: Array  # (H, M, N), the same of pairs no farther off than most
    order: Index  # (H, N), numbers of the computed modes in this order
    apart: Array  # (H, M, N), ln f0 as heard less expected
    slopes: Array  # (H, N), of the expected ln f0 over Poisson's ratio
    sought: Array  # (H,), computed modes that could have been fitted
    told: Array  # (H,), fitted modes that could have been computed
    likelihoods: Array  # (H,), logarithms but for a constant

    def over_modes(self) -> Array:
        """Return the probability of each pair (H, M, N), by numbers of the computed modes."""
        numbered = np.zeros_like(self.pairs)
        np.put_along_axis(numbered, self.order[:, None], self.pairs, axis=2)
        return numbered


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Agreement:
    """Agreement of fitted modes with computed ones."""

    heard: Array  # (M,), ln f0 of the fitted modes, ascending
    errors: Array  # (M,), their standard errors
    crowd: Array  # (M,), fitted modes around each for a unit of ln f
    expected: Expected
    audible: Array  # (N,), share of each computed mode that can be expected to be heard, 0 to 1

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
        """Return the evidence for hypotheses."""
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
        """Return least-squares steps of shift and ratio, pairs weighted by their probability.

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
        """Return scatters about expected frequencies, errors of fitting apart (H,)."""
        own = cases.scatters[:, None, None] ** 2
        share = own / self._variances(cases)
        squares = (share * evidence.apart) ** 2 + own * (1 - share)
        total = (evidence.regular * squares).sum(axis=(1, 2)) + _SCATTER_PAIRS * _SCATTER**2
        count = evidence.regular.sum(axis=(1, 2))
        free = np.maximum(count - 1 - self.expected.follows, 0) + _SCATTER_PAIRS
        return np.sqrt(total / free)


def _normal(apart: Array, variances: Array) -> Array:
    return np.exp(-(apart**2) / (2 * variances)) / np.sqrt(2 * np.pi * variances)

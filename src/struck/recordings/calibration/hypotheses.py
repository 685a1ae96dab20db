"""First guesses of what a recording and a model have in common: a factor and Poisson's ratio.

Every fitted mode could be every computed one; each such pair votes for the factor between the two.
True pairs agree, false ones scatter (a Hough transform: D. H. Ballard, 'Generalizing the Hough
transform to detect arbitrary shapes', Pattern Recognition 13, 1981).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from struck.recordings.calibration.expected import Expected

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_RATIOS = np.arange(0.0, 0.49, 0.02)
_WIDTHS = (0.004, 0.016)
"""How far true pairs may disagree about the logarithm of the factor; the ratios' grid alone makes
them disagree by 0.3 %."""
_KEPT = 12
_NEIGHBOURS = 3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hypotheses:
    """What may be true of a recording, H cases side by side.

    Parameters
    ----------
    shifts : array (H,)
        Logarithm of the factor from computed frequencies to fitted ones.
    ratios : array (H,)
        Poisson's ratio.
    scatters : array (H,)
        Standard deviation of ln f about what the model expects.
    found : array (H,)
        Share of the computed modes that were fitted.
    false : array (H,)
        Share of the fitted modes that the model does not have.
    """

    shifts: Array
    ratios: Array
    scatters: Array
    found: Array
    false: Array

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
        """Return some of the cases."""
        return replace(self, **{name: getattr(self, name)[cases] for name in self.__slots__})


def densities(logarithms: Array) -> Array:
    """Return how many modes there are for each unit of ln f, around each of some (M,), ascending.

    Counted among the three neighbours on either side.
    """
    place = np.arange(len(logarithms))
    low = np.maximum(place - _NEIGHBOURS, 0)
    high = np.minimum(place + _NEIGHBOURS, len(place) - 1)
    # A lone mode tells no density: as if the next were an octave away.
    spans = np.where(high > low, logarithms[high] - logarithms[low], np.log(2))
    return np.maximum(high - low, 1) / np.maximum(spans, 1e-3)


def guesses(heard: Array, expected: Expected, widest: float) -> Hypotheses:
    """Return likely factors and Poisson's ratios.

    Parameters
    ----------
    heard : array (M,)
        ln f0 of the fitted modes, ascending.
    expected : Expected
        The computed ones.
    widest : float
        Largest factor either way.
    """
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

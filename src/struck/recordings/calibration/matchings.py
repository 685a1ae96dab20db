"""All ways to pair two ordered lists one to one, in order, and how likely each pair is in them.

A matching's likelihood is the product of its pairs' odds: how many times likelier each is as a pair
than as two lonely entries. Sums over all matchings, which are far too many to list, take one pass
in each direction (the forward-backward algorithm: R. Durbin, S. Eddy, A. Krogh and G. Mitchison,
Biological Sequence Analysis, Cambridge University Press, 1998, chapters 3 and 4).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def posteriors(odds: Array) -> tuple[Array, Array]:
    """Return how likely each pair is, and how likely the lists are as a whole.

    Parameters
    ----------
    odds : array (H, M, N)
        Of each pair of M with N entries, for each of H separate cases.

    Returns
    -------
    pairs : array (H, M, N)
        The share of all matchings, by likelihood, that hold the pair.
    logarithms : array (H,)
        Of the likelihoods of all matchings summed up; the empty one has the likelihood 1.
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

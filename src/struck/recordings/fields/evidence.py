"""Which of several explanations data speak for, when many modes share the same few."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
_ROUNDS = 30
_LEAST = 1e-12  # less than that would only make denormal numbers, which processors are slow at


def shares(evidence: Array) -> Array:
    """Return how far to believe each explanation (K, M), adding up to 1 for each mode.

    Parameters
    ----------
    evidence : array (K, M)
        Log marginal likelihood of K explanations for each of M modes.

    Returns
    -------
    array (K, M)

    Notes
    -----
    Modes are taken as draws from one mixture of the explanations. Its weights come from all modes
    by expectation maximisation, from equal ones: a mode that tells little by itself goes with the
    others (empirical Bayes; C. M. Bishop, Pattern Recognition and Machine Learning, Springer, 2006,
    chapter 9).
    """
    count, modes = evidence.shape
    relative = np.exp(evidence - evidence.max(axis=0, initial=-np.inf))
    common = np.full(count, 1 / count)
    believed = relative
    for _ in range(_ROUNDS):
        believed = relative * common[:, None]
        believed /= believed.sum(axis=0)
        # As if one more mode had spoken for all alike: no weight ever vanishes.
        common = (believed.sum(axis=1) + 1 / count) / (modes + 1)
    return np.where(believed > _LEAST, believed, 0.0)

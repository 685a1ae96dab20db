"""Whether a model explains a recording, or merely has as many modes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from struck.model.model import ModalModel
from struck.recordings.calibration.pairing import Pairing, first_support
from struck.recordings.calibration.partials import FittedModes, Partials

Array = NDArray[np.float64]

SIGNIFICANT = 4.0
"""Standard deviations beyond chance at which a model is taken to be that of the body."""
_TRIALS = 8
_LEAST = 1e-3  # one mode fits any other as well
_SMOOTH = 4  # modes between which frequencies are drawn anew


def explains(fitted: FittedModes | Partials, model: ModalModel, pairing: Pairing) -> bool:
    """Return whether fitted modes agree with a model better than with random ones.

    Parameters
    ----------
    fitted : FittedModes or Partials
    model : ModalModel
    pairing : Pairing
        Of the two.
    """
    if not len(pairing):
        return False
    return pairing.support > 0 or beyond_chance(fitted, model) >= SIGNIFICANT


def beyond_chance(fitted: FittedModes | Partials, model: ModalModel, *, seed: int = 0) -> float:
    """Return how far a model's support lies above that of random ones, in standard deviations.

    Parameters
    ----------
    fitted : FittedModes or Partials
    model : ModalModel
    seed : int
        Of eight random models whose modes are as many and as dense as the model's.
    """
    chance = np.random.default_rng(seed)
    partials = fitted if isinstance(fitted, Partials) else Partials.of(fitted)
    own = first_support(partials, model)
    trials = [first_support(partials, _random(model, chance)) for _ in range(_TRIALS)]
    return float((own - np.mean(trials)) / max(float(np.std(trials, ddof=1)), _LEAST))


def _random(model: ModalModel, chance: Generator) -> ModalModel:
    """Return a model with as many modes, as dense, but elsewhere; slopes go to any of them."""
    count = len(model.natural_frequencies)
    knots = np.linspace(0, count - 1, max(2, count // _SMOOTH))
    heights = np.interp(knots, np.arange(count), np.log(model.natural_frequencies))
    drawn = np.sort(chance.uniform(0, count - 1, count))
    frequencies = np.exp(np.interp(drawn, knots, heights))
    slopes = model.poisson_slopes
    return replace(
        model,
        natural_frequencies=frequencies,
        poisson_slopes=None if slopes is None else slopes[chance.permutation(count)],
    )

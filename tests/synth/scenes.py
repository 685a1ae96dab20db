"""Models and pushes by chance, for banks of resonators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from struck.synth import resonators
from struck.synth.resonators import Resonators

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
RATE = 48000


@dataclass(frozen=True)
class Bank:
    """What rings."""

    frequencies: Array
    decays: Array

    @property
    def turns(self) -> Complex:
        """What a sample turns each mode by."""
        return np.exp((-self.decays + 2j * np.pi * self.frequencies) / RATE)


def reference(*given: Any, **options: Any) -> Resonators:  # noqa: ANN401 - of `Resonators`
    """Return resonators in plain NumPy, as where the core is missing."""
    with mock.patch.object(resonators, "entry", return_value=None):
        return Resonators(*given, **options)


def bank(
    random: np.random.Generator,
    count: int,
    *,
    highest: float = 18000.0,
    decays: tuple[float, float] = (0.5, 200.0),
) -> Bank:
    """Return modes spread evenly over octaves and over decays."""
    octaves = random.uniform(np.log(30.0), np.log(highest), count)
    slowest, fastest = np.log(decays)
    return Bank(np.sort(np.exp(octaves)), np.exp(random.uniform(slowest, fastest, count)))


def decibels(error: Array, signal: Array) -> float:
    """Return peak error over peak signal, dB."""
    return 20 * float(np.log10(np.abs(error).max() / np.abs(signal).max()))


def exactly(bank: Bank, outputs: Complex, drive: Array, force: Array) -> Array:
    """Return what is heard under a force, by SciPy's filters (points, samples)."""
    from scipy.signal import lfilter

    heard = np.zeros((len(outputs), len(force)))
    for turn, weight, output in zip(bank.turns, drive / RATE, outputs.T, strict=True):
        state = lfilter([weight], [1, -turn], force.astype(complex))
        heard += np.imag(np.outer(output, state - weight / (1 - turn) * force))
    return heard

"""Time as a multiple of a Fourier transform's, for loose bounds that hold on any machine."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterable

import numpy as np

from struck.model.provenance import FORECAST

_NOISE = np.random.default_rng(0).normal(size=2**18)


def fastest(
    work: Callable[[], object], turns: int, clock: Callable[[], float] = time.perf_counter
) -> float:
    """Return the least time of several turns of some work, s, by a clock."""
    taken = []
    for _ in range(turns):
        begun = clock()
        work()
        taken.append(clock() - begun)
    return min(taken)


def transforms(work: Callable[[], object], turns: int = 1) -> float:
    """Return how many real transforms of 2**18 samples take as long as some work."""
    return fastest(work, turns) / fastest(lambda: np.fft.rfft(_NOISE), 5)


_USUAL = 4e-3  # s, of a transform where forecasts of seconds were fitted
_USUAL_LOOP = 3.6e-3  # s, of the loop below where the bounds on seconds were last met


def slowness() -> float:
    """Return how many times as much of a processor as there work takes here.

    Where transforms and loops are faster than usual, other work need not be: bounds on it take at
    least 1.
    """
    transform = fastest(lambda: np.fft.rfft(_NOISE), 40, time.process_time)
    return max(transform / _USUAL, fastest(_loop, 20, time.process_time) / _USUAL_LOOP)


def _loop() -> int:
    """Return a sum of 100,000 whole numbers, by the interpreter."""
    total = 0
    for number in range(100_000):
        total += number
    return total


def seconds_foretold(stages: Iterable[str]) -> float:
    """Return the seconds of a processor that an analysis said it would take, as they are here."""
    told = " ".join(each for each in stages if each.startswith(FORECAST))
    number, unit = re.search(r"about (\S+) (s|min) of a processor", told).groups()
    return float(number.replace(",", "")) * {"s": 1, "min": 60}[unit] * slowness()

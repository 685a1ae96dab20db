"""Time as a multiple of a Fourier transform's, for loose bounds that hold on any machine."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

_NOISE = np.random.default_rng(0).normal(size=2**18)


def fastest(work: Callable[[], object], turns: int) -> float:
    """Return the least time of several turns of some work, s."""
    taken = []
    for _ in range(turns):
        begun = time.perf_counter()
        work()
        taken.append(time.perf_counter() - begun)
    return min(taken)


def transforms(work: Callable[[], object], turns: int = 1) -> float:
    """Return how many real transforms of 2**18 samples take as long as some work."""
    return fastest(work, turns) / fastest(lambda: np.fft.rfft(_NOISE), 5)

"""Recordings of one hit, as they should be and as they should not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from struck.files import wav

Array = NDArray[np.float64]

RATE = 16_000
LEAD_IN, SECONDS = 0.2, 0.4
FREQUENCIES = np.array([440.0, 1130.0, 2710.0])
ONSET = 0.25


def hit(
    *,
    onset: float = ONSET,
    length: float = 0.8,
    peak: float = 0.5,
    noise: float = 1e-4,
    gains: Array | None = None,
    seed: int = 1,
) -> Array:
    """Return samples (1, n) of a struck body in white noise, with the peak given."""
    times = np.arange(round(length * RATE)) / RATE - onset
    strengths = np.ones(3) if gains is None else gains
    partials = np.sin(2 * np.pi * FREQUENCIES * times[:, None]) @ strengths
    rung = np.where(times >= 0, partials * np.exp(-9 * times), 0.0)
    ambient = noise * np.random.default_rng(seed).standard_normal(len(times))
    return (rung * peak / np.abs(rung).max() + ambient)[None]


def write(path: Path, samples: Array, rate: int = RATE) -> None:
    path.write_bytes(
        wav.encode(wav.Recording(samples=samples.astype(np.float32), sample_rate=rate))
    )


def clip(samples: np.ndarray) -> np.ndarray:
    """Return a take that is clipped at full scale."""
    return np.clip(2.5 * samples, -1, 1)


def end_early(samples: np.ndarray) -> np.ndarray:
    """Return a take that ends within its lead-in."""
    return samples[:, : round(0.1 * RATE)]

"""Recordings of a body whose shapes are cosines: what a fit of contacts ought to find."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.files.sound import Sound
from struck.recordings.takes import Take

Array = NDArray[np.float64]

RATE = 32_000
ONSET = 0.3
FREQUENCIES = np.array([311.0, 702.0, 1291.0, 2217.0, 3405.0, 5120.0])
DECAYS = np.array([4.0, 6.0, 9.0, 15.0, 25.0, 60.0])
LEVELS = np.array([1.0, 0.8, 0.7, 0.5, 0.4, 0.4])


def shapes(contacts: Array) -> Array:
    """Return cos(n pi u) of contacts (K,): (K, 6)."""
    return np.cos(np.pi * np.outer(contacts, np.arange(1, 7)))


def gains(contacts: Array) -> Array:
    """Return the true gains (K, 6): sines from the moment of the hit on."""
    return shapes(np.atleast_1d(contacts)) * LEVELS


def ringing(gain: Array, *, onset: float = ONSET, seconds: float = 1.0) -> Array:
    """Return samples (n,) of a hit with gains (6,)."""
    times = np.arange(round(seconds * RATE)) / RATE - onset
    waves = np.exp(np.outer(np.maximum(times, 0), -DECAYS + 2j * np.pi * FREQUENCIES))
    return np.where(times >= 0, (waves @ gain).imag, 0.0)


def noise(length: int, level: float, seed: int) -> Array:
    """Return white noise so many dB under 1."""
    return 10 ** (-level / 20) * np.random.default_rng(seed).standard_normal(length)


def take(samples: Array, name: str = "the take") -> Take:
    return Take(samples=0.2 * samples, sample_rate=RATE, name=name)


def hit(
    contact: float,
    *,
    level: float = 50.0,
    seed: int = 0,
    strength: float = 1.0,
    onset: float = ONSET,
) -> Take:
    """Return a take of a hit at a contact, with noise `level` dB under 1."""
    sound = strength * ringing(gains(np.array(contact))[0], onset=onset)
    return take(sound + noise(len(sound), level, seed), f"hit at {contact}")


def sound(given: Take) -> Sound:
    return Sound(samples=given.samples.astype(np.float32), sample_rate=given.sample_rate)

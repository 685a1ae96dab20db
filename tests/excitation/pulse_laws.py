"""Pulses of unit area in closed form: over time as textbooks give them, and their transforms."""

from __future__ import annotations

import numpy as np
from scipy.special import erf, gamma

from struck.excitation import pulses

SHAPES = tuple(pulses.SPECTRA)


def force(shape: str, time: float, duration: float) -> float:
    """Return the force of a pulse of unit area at a time since its onset, 1/s."""
    phase = time / duration
    if shape == "gaussian":  # a deviation of T / 6, cut at three of them
        area = np.sqrt(2 * np.pi) / 6 * erf(3 / np.sqrt(2))
        return float(np.exp(-0.5 * (6 * (phase - 0.5)) ** 2) / area / duration)
    power = {"half-sine": 1.0, "hertz": 1.5}[shape]
    area = gamma((power + 1) / 2) / (np.sqrt(np.pi) * gamma(power / 2 + 1))
    return float(np.sin(np.pi * phase) ** power / area / duration)


def transform(shape: str, frequencies: np.ndarray, duration: float) -> np.ndarray:
    """Return the integral of the force times exp(-2 pi i f t) dt."""
    cycles = frequencies * duration
    return pulses.SPECTRA[shape](np.abs(cycles)) * np.exp(-1j * np.pi * cycles)

"""The Cramer-Rao bound of decaying sines in white noise, from sums in closed form."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tests.recordings.scenes import RATE, Truth, reaches

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]


def bounds(truth: Truth, seconds: float = 2.0) -> tuple[Array, Array]:
    """Return least standard errors of frequencies, Hz, and decays, 1/s, of all modes together.

    The signal is the sum of Im[g exp(s t)]. Its derivatives by Re g, Im g, Re s and Im s are
    Im w, Re w, Im[g t w] and Re[g t w], w = exp(s t); the gains of each channel are eliminated.
    """
    count, length = len(truth.poles), round(seconds * RATE)
    information = np.zeros((2 * count, 2 * count))
    ones = np.ones(count)
    for gains, noise in zip(truth.gains, truth.noise, strict=True):
        own = _products(truth.poles, ones, ones, 0, length)
        mixed = _products(truth.poles, ones, gains, 1, length)
        whole = _products(truth.poles, gains, gains, 2, length)
        information += (whole - mixed.T @ np.linalg.solve(own, mixed)) / noise**2
    errors = np.sqrt(np.diag(np.linalg.inv(information)))
    return errors[count:] / (2 * np.pi), errors[:count]


def resolvable(truth: Truth, seconds: float = 2.0) -> NDArray[np.bool_]:
    """Return modes that can be told from noise and, at two standard errors, from neighbours."""
    errors, _ = bounds(truth, seconds)
    return truth.detectable() & (2 * errors < reaches(truth.frequencies))


def _products(poles: Complex, left: Complex, right: Complex, power: int, length: int) -> Array:
    """Return inner products of (Im, Re) of left w with (Im, Re) of t^power right w, blockwise."""
    steps = poles / RATE
    direct = np.outer(left.conj(), right) * _sums(np.add.outer(steps.conj(), steps), power, length)
    mirrored = np.outer(left, right) * _sums(np.add.outer(steps, steps), power, length)
    return 0.5 * np.block(
        [
            [(direct - mirrored).real, (mirrored - direct).imag],
            [(direct + mirrored).imag, (direct + mirrored).real],
        ]
    )


def _sums(exponents: Complex, power: int, length: int) -> Complex:
    """Return the sums of (n / RATE)^power exp(x n)."""
    ratio, last = np.exp(exponents), np.exp(exponents * length)
    rest = -np.expm1(exponents)
    if power == 0:
        return (1 - last) / rest
    if power == 1:
        return (ratio - last * (length - (length - 1) * ratio)) / rest**2 / RATE
    square = length**2 - (2 * length**2 - 2 * length - 1) * ratio + (length - 1) ** 2 * ratio**2
    return (ratio * (1 + ratio) - last * square) / rest**3 / RATE**2

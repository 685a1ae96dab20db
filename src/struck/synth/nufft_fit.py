"""The weights of the block transform: a damped wave as eight waves on a grid of frequencies.

Over a block the time runs from x = -1 to 1. A mode that turns by the phase Im zeta relative to the
middle of its eight neighbours, and decays by Re zeta, is fitted by least squares as

    window(x) exp(zeta x) ~ sum over j of V_j(zeta) exp(i pi (j - 7/2) x B / M),

so each V_j is a linear functional of exp(zeta x), a power series in zeta with coefficients that
depend on the block alone: the cost of a mode's weights does not depend on the length of the block.
Fitted interpolators: Fessler and Sutton, "Nonuniform fast Fourier transforms using min-max
interpolation", IEEE Trans. Signal Process. 51 (2003), here for complex frequencies.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Single = NDArray[np.float32]
Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

WEIGHTS = 8
"""Frequencies of the grid that a mode touches."""
OVERSAMPLING = 2.25
"""Length of the transform over that of the block."""
SPAN = 2.0
"""Nepers a block within a class of decays: wider classes need more weights."""
# Of the steepness that suits undamped waves: the worst error at a class's edge is least here.
_SHARPNESS = 0.97
# |zeta| <= 0.86 in every class, so that the first power left out is below 1e-25.
_POWERS = 22
_MODES_AT_ONCE = 4096


def length_of(block: int) -> int:
    """Return the even length M of the transform for a block."""
    return 2 * math.ceil(OVERSAMPLING * block / 2)


def window(block: int) -> Array:
    """Return the window (B + 1,), largest in the middle: the transform of a Kaiser-Bessel bell."""
    steepness = _SHARPNESS * np.pi * WEIGHTS * (1 - 1 / (2 * OVERSAMPLING))
    phase = np.pi * WEIGHTS * np.linspace(-0.5, 0.5, block + 1) * block / length_of(block)
    root = np.sqrt(steepness**2 - phase**2)
    bell = np.sinh(root) / root
    return bell / bell.max()


def openings(block: int, classes: int) -> Array:
    """Return what undoes the window and restores the mean decay of each class (C, B + 1)."""
    decays = SPAN * (np.arange(classes) + 0.5)
    return np.exp(-np.outer(decays, np.arange(block + 1) / block)) / window(block)


def fill(rows: Single, turns: Complex, block: int) -> None:
    """Write the weights of modes, real and imaginary parts alternating.

    Parameters
    ----------
    rows : array (N, 16)
        The result, for times counted from the start of the block.
    turns : array (N,)
        2 zeta: decay and phase over the block relative to the mean decay of the class and to the
        middle of the eight frequencies.
    block : int
    """
    series = _series(block)
    for first in range(0, len(turns), _MODES_AT_ONCE):
        some = turns[first : first + _MODES_AT_ONCE] / 2
        weights = np.zeros((len(some), WEIGHTS), dtype=np.complex128)
        for coefficients in series:
            weights *= some[:, None]
            weights += coefficients
        weights *= np.exp(some)[:, None]
        rows[first : first + len(some), 0::2] = weights.real
        rows[first : first + len(some), 1::2] = weights.imag


def _series(block: int) -> Complex:
    """Return the coefficients of the powers of zeta, highest first (P, 8)."""
    middles = np.arange(WEIGHTS) - (WEIGHTS - 1) / 2
    turn = np.pi * block / length_of(block)
    times = np.linspace(-1.0, 1.0, block + 1)
    waves = np.exp(1j * turn * np.outer(times, middles)) / window(block)[:, None]
    exponents = np.arange(_POWERS)
    factorials = np.array([float(math.factorial(m)) for m in exponents])
    powers = times[:, None] ** exponents / factorials
    fitted = np.linalg.pinv(waves, rcond=1e-15) @ powers
    # From the middle of the block, where the fit counts time, to its start.
    return np.asarray(fitted * np.exp(-1j * turn * middles)[:, None], dtype=np.complex128).T[::-1]

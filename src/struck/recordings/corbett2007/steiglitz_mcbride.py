"""Damped exponentials from a few of their samples (Steiglitz & McBride 1965)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complex128]

ITERATIONS = 5
"""Rounds of prefiltering; more do not change poles of clean signals."""


def steiglitz_mcbride(signal: Complex, terms: int, iterations: int = ITERATIONS) -> Complex:
    """Return the poles of the rational filter whose impulse response is nearest to a signal.

    Each round filters signal and impulse by the last denominator, after which numerator and
    denominator follow from a linear least-squares problem; Prony's method gives the first one.
    Unstable poles are mirrored into the unit circle between rounds.

    Parameters
    ----------
    signal : array (n,), complex
        n at least twice `terms`.
    terms : int
        Poles; the numerator has as many coefficients.
    iterations : int
        Rounds.

    Returns
    -------
    array (at most terms,), complex
        Poles z of sum c z^n; none where the signal has no such model.

    Notes
    -----
    K. Steiglitz and L. E. McBride, "A technique for the identification of linear systems", IEEE
    Transactions on Automatic Control 10(4), 461-464, 1965.
    """
    from scipy.signal import lfilter

    impulse = np.zeros_like(signal)
    impulse[0] = 1
    denominator = _prony(signal, terms)
    for _ in range(iterations):
        if not np.isfinite(denominator).all():
            return np.zeros(0, np.complex128)
        denominator = _stable(denominator)
        filtered = lfilter([1], denominator, signal)
        answer = lfilter([1], denominator, impulse)
        columns = _delayed(-filtered, range(1, terms + 1)), _delayed(answer, range(terms))
        solution = np.linalg.lstsq(np.hstack(columns), filtered, rcond=None)[0]
        denominator = np.concatenate([[1], solution[:terms]])
    finite = np.isfinite(denominator).all()
    return np.asarray(np.roots(denominator) if finite else [], np.complex128)


def residues(signal: Complex, poles: Complex) -> Complex:
    """Return the factors c of sum c z^n that fit a signal (n,) best, for given poles (P,)."""
    powers = poles ** np.arange(len(signal))[:, None]
    return np.asarray(np.linalg.lstsq(powers, signal, rcond=None)[0], np.complex128)


def _prony(signal: Complex, terms: int) -> Complex:
    """Return 1, a_1 ... of the recursion that predicts a signal best from its last samples."""
    stretches = np.lib.stride_tricks.sliding_window_view(signal, terms + 1)[:, ::-1]
    prediction = np.linalg.lstsq(stretches[:, 1:], stretches[:, 0], rcond=None)[0]
    return np.concatenate([[1], -prediction])


def _stable(denominator: Complex) -> Complex:
    """Return the polynomial with the roots outside of the unit circle mirrored into it."""
    roots = np.roots(denominator)
    outside = np.abs(roots) > 1
    roots[outside] = 1 / roots[outside].conj()
    return np.asarray(np.poly(roots), np.complex128)


def _delayed(signal: Complex, delays: Iterable[int]) -> Complex:
    """Return a signal (n,) delayed by several numbers of samples, one a column."""
    count = len(signal)
    return np.stack([np.pad(signal, (delay, 0))[:count] for delay in delays], axis=1)

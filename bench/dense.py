"""Dense refinement of shared poles: what the blocks of struck are measured against.

Levenberg-Marquardt of all poles at once, as in the prototype that the research began with: the
complex gains eliminated (variable projection, Kaufman's derivative), every mode against every
other, inner products of exponentials as sums in closed form, and one pass over all samples of all
channels for each step that is tried.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]

_GONE = -27.6
"""An exponential is over when this is its logarithm."""
_SETTLED = 1e-9
_TRIES = 5
_SLOWEST = 0.02


def _correlate(
    ratios: Complex, samples: Array, interval: float, plain: Complex, timed: Complex
) -> None:
    """Sum conj(z)^n x[n], and the same times n interval, into (C, M) each."""
    numbers = np.arange(samples.shape[1])
    for mode, log in enumerate(np.log(np.conj(ratios))):
        last = int(_GONE / log.real) + 2
        powers = np.exp(log * numbers[:last])
        products = np.stack([powers, powers * (numbers[:last] * interval)], axis=1)
        parts = np.hstack([products.real, products.imag])  # real products with real samples
        sums = samples[:, :last] @ parts
        plain[:, mode] = sums[:, 0] + 1j * sums[:, 2]
        timed[:, mode] = sums[:, 1] + 1j * sums[:, 3]


def _moments(ratios: Complex, length: int, interval: float) -> tuple[Complex, Complex, Complex]:
    """Return the sums over n of t^k q^n, k = 0, 1, 2, t = n interval."""
    over, last, n = 1 / (1 - ratios), ratios**length, length
    first = ratios - last * (n - (n - 1) * ratios)
    square = n**2 - (2 * n**2 - 2 * n - 1) * ratios + (n - 1) ** 2 * ratios**2
    second = ratios * (1 + ratios) - last * square
    return (1 - last) * over, first * over**2 * interval, second * over**3 * interval**2


def _products(direct: Complex, mirrored: Complex, left: Complex, right: Complex) -> Array:
    """Return inner products of Re a w and Re i a w with those of b, (2M, 2M)."""
    same = np.outer(left.conj(), right) * direct
    other = np.outer(left, right) * mirrored
    return 0.5 * np.block(
        [
            [(same + other).real, -(same + other).imag],
            [(same - other).imag, (same - other).real],
        ]
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _State:
    """Poles, their moments and correlations, and the best gains (C, 2M), real parts first."""

    poles: Complex
    direct: tuple[Complex, Complex, Complex]
    mirrored: tuple[Complex, Complex, Complex]
    timed: Complex
    gram: Array
    gains: Array
    explained: float

    @classmethod
    def at(cls, poles: Complex, samples: Array, weights: Array, sample_rate: float) -> _State:
        ratios = np.exp(poles / sample_rate)
        shape, length = (len(samples), len(poles)), samples.shape[1]
        plain, timed = np.empty(shape, complex), np.empty(shape, complex)
        _correlate(ratios, samples, 1 / sample_rate, plain, timed)
        direct = _moments(np.outer(ratios.conj(), ratios), length, 1 / sample_rate)
        mirrored = _moments(np.outer(ratios, ratios), length, 1 / sample_rate)
        ones = np.ones(len(poles), complex)
        gram = _products(direct[0], mirrored[0], ones, ones)
        gram[np.diag_indices_from(gram)] *= 1 + 1e-10
        sides = np.hstack((plain.real, plain.imag))
        gains = np.linalg.solve(gram, sides.T).T
        return cls(
            poles=poles,
            direct=direct,
            mirrored=mirrored,
            timed=timed,
            gram=gram,
            gains=gains,
            explained=float(weights @ (sides * gains).sum(axis=1)),
        )

    def normal_equations(self, weights: Array) -> tuple[Array, Array]:
        """Return matrix (2M, 2M) and right side (2M,) for steps of the poles."""
        count = len(self.poles)
        ones, inverse = np.ones(count, complex), np.linalg.inv(self.gram)
        matrix, side = np.zeros((2 * count, 2 * count)), np.zeros(2 * count)
        for weight, gains, timed in zip(weights, self.gains, self.timed, strict=True):
            own = gains[:count] + 1j * gains[count:]
            mixed = _products(self.direct[1], self.mirrored[1], ones, own)
            whole = _products(self.direct[2], self.mirrored[2], own, own)
            data = own.conj() * timed
            matrix += weight * (whole - mixed.T @ inverse @ mixed)
            side += weight * (np.concatenate((data.real, data.imag)) - mixed.T @ gains)
        return matrix, side


def refined(
    poles: Complex, samples: Array, noise: Array, sample_rate: float, steps: int = 12
) -> Complex:
    """Return the poles of least squares.

    Parameters
    ----------
    poles : array (M,), complex
        Where to start, -d + 2 pi i f, 1/s.
    samples : array (C, n)
        All channels, which ring freely from their first sample on.
    noise : array (C,)
        Rms of the noise in each.
    sample_rate : float
        Hz.
    steps : int
        Not more steps than these.
    """
    weights, damping = noise.min() ** 2 / noise**2, 1e-3
    here = _State.at(poles, samples, weights, sample_rate)
    for _ in range(steps):
        matrix, side = here.normal_equations(weights)
        scale = np.maximum(np.abs(np.diag(matrix)), 1e-14 * np.abs(np.diag(matrix)).max())
        for _ in range(_TRIES):
            step = np.linalg.solve(matrix + damping * np.diag(scale), side)
            there = _State.at(_stepped(here.poles, step), samples, weights, sample_rate)
            if there.explained >= here.explained:
                break
            damping *= 8
        else:
            break
        gained, here = there.explained / here.explained - 1, there
        damping = max(damping / 5, 1e-9)
        if gained < _SETTLED:
            break
    return here.poles


def _stepped(poles: Complex, step: Array) -> Complex:
    """Step by half a decay rate at most, twice that in angular frequency, and stay damped."""
    most = np.maximum(-0.5 * poles.real, 2.0)
    real = np.clip(step[: len(poles)], -most, most)
    imaginary = np.clip(step[len(poles) :], -2 * most, 2 * most)
    moved = poles + real + 1j * imaginary
    return np.minimum(moved.real, -_SLOWEST) + 1j * moved.imag

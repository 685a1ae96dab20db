"""Free ringing: sums of decaying exponentials, in time and as exact discrete spectra."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_FEW = 8


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ringing:
    """What rings: channel c is the sum over modes of Im[g_c exp(s t)].

    Parameters
    ----------
    poles : array (M,), complex
        s = -d + 2 pi i f, 1/s.
    gains : array (C, M), complex
        g, in the unit of the samples; row by row the channels of all segments.
    """

    poles: Complex
    gains: Complex

    @classmethod
    def silence(cls, channels: int) -> Ringing:
        """Return no modes at all."""
        return cls(poles=np.zeros(0, complex), gains=np.zeros((channels, 0), complex))

    @property
    def count(self) -> int:
        """Number of modes."""
        return len(self.poles)

    @property
    def frequencies(self) -> Array:
        """Ringing frequencies, Hz."""
        return np.asarray(self.poles.imag / (2 * np.pi), float)

    @property
    def decays(self) -> Array:
        """Amplitude decay rates, 1/s."""
        return np.asarray(-self.poles.real, float)

    def of(self, modes: Index | Mask) -> Ringing:
        """Return some of the modes."""
        return Ringing(poles=self.poles[modes], gains=self.gains[:, modes])

    def joined(self, poles: Complex) -> Ringing:
        """Return a copy with more modes, silent as yet."""
        silent = np.zeros((len(self.gains), len(poles)), complex)
        return Ringing(
            poles=np.concatenate((self.poles, poles)), gains=np.hstack((self.gains, silent))
        )

    def by_frequency(self) -> Ringing:
        """Return a copy in ascending order of frequency."""
        return self.of(np.argsort(self.poles.imag))


def samples(poles: Complex, gains: Complex, length: int, sample_rate: float) -> Array:
    """Return the sum of Im[g exp(s n / rate)], (C, length).

    A sample index is a row and a column, n = row * width + column, and so each exponential the
    product of two short ones: all modes add up in a product of two matrices.
    """
    width = int(np.ceil(np.sqrt(length)))
    coarse = _powers(poles * (width / sample_rate), -(-length // width)).T
    fine = _powers(poles / sample_rate, width)
    sums = [
        coarse.real @ (gain[:, None] * fine).imag + coarse.imag @ (gain[:, None] * fine).real
        for gain in gains
    ]
    return np.reshape(sums, (len(gains), -1))[:, :length]


def correlations(poles: Complex, samples: Array, sample_rate: float) -> Complex:
    """Return the sums of conj(exp(s n / rate)) x[n], (C, M), by the same factors."""
    channels, length = samples.shape
    width = int(np.ceil(np.sqrt(length)))
    count = -(-length // width)
    folded = np.zeros((channels, count * width))
    folded[:, :length] = samples
    coarse = _powers(poles.conj() * (width / sample_rate), count).T
    fine = _powers(poles.conj() / sample_rate, width).T
    rows = folded.reshape(channels, count, width)
    inner = rows @ fine.real + 1j * (rows @ fine.imag)
    return (inner * coarse).sum(axis=1)


def _powers(exponents: Complex, count: int) -> Complex:
    """Return exp(x n) for n below the count, (M, count), by the same factors once more."""
    width = int(np.ceil(np.sqrt(count)))
    rows = -(-count // width)
    coarse: Complex = np.exp(np.outer(exponents, width * np.arange(rows)))
    fine: Complex = np.exp(np.outer(exponents, np.arange(width)))
    products = coarse[:, :, None] * fine[:, None, :]
    return products.reshape(len(exponents), rows * width)[:, :count]


def best_gains(poles: Complex, samples: Array, sample_rate: float) -> Complex:
    """Return the gains (C, M) of least squares of all modes at once, over all samples.

    The inner products of exponentials are geometric series, so only the correlations touch the
    samples.
    """
    length = samples.shape[1]
    steps = poles / sample_rate
    direct = _series(steps.conj(), steps, length)
    mirrored = _series(steps, steps, length)
    # Im[g w] = Re g Im w + Im g Re w: products of the real waves Im w and Re w.
    matrix = 0.5 * np.block(
        [
            [direct.real - mirrored.real, direct.imag.T + mirrored.imag],
            [direct.imag + mirrored.imag, direct.real + mirrored.real],
        ]
    )
    matrix[np.diag_indices_from(matrix)] *= 1 + 1e-10
    sums = correlations(poles, samples, sample_rate)
    sides = np.hstack((-sums.imag, sums.real))
    solved = np.linalg.solve(matrix, sides.T).T
    return solved[:, : len(poles)] + 1j * solved[:, len(poles) :]


def _series(left: Complex, right: Complex, length: int) -> Complex:
    """Return the sums of exp((x + y) n) for n below the length, one row for each x."""
    last = np.outer(np.exp(left * length), np.exp(right * length))
    return np.asarray((last - 1) / np.expm1(np.add.outer(left, right)), complex)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spectrum:
    """The discrete Fourier transform of a segment's first samples.

    A mode that rings from the first of N samples on has the transform r / (1 - z / u) at
    u = exp(2 pi i k / N), exactly: z = exp(s / rate) and r = g (1 - z^N) / 2i. Its conjugate
    belongs to it, for samples are real.

    Parameters
    ----------
    values : array (N / 2 + 1, C), complex
        From 0 Hz to half the sample rate.
    length : int
        N.
    sample_rate : float
        Hz.
    """

    values: Complex
    length: int
    sample_rate: float

    @classmethod
    def of(cls, samples: Array, length: int, sample_rate: float) -> Spectrum:
        """Transform the first samples of each channel, (C, n)."""
        values = np.ascontiguousarray(np.fft.rfft(samples[:, :length], axis=1).T)
        return cls(values=values, length=length, sample_rate=sample_rate)

    @property
    def spacing(self) -> float:
        """From one bin to the next, Hz."""
        return self.sample_rate / self.length

    def lines(self, bins: Index, poles: Complex) -> Complex:
        """Return 1 / (1 - z / u), (bins, M)."""
        turns = np.exp((-2j * np.pi / self.length) * bins)
        return np.reciprocal(1 - turns[:, None] * np.exp(poles / self.sample_rate))

    def residues(self, poles: Complex, gains: Complex) -> Complex:
        """Return r of gains (C, M)."""
        return gains * self._span(poles)

    def gains(self, poles: Complex, residues: Complex) -> Complex:
        """Return the gains of residues (C, M)."""
        return residues / self._span(poles)

    def at(self, bins: Index, ringing: Ringing, gains: Complex) -> Complex:
        """Return the transform of modes with these gains (C, M), (bins, C)."""
        # r / (1 - z / u) and its conjugate's line over one denominator: sums of real products.
        residues = self.residues(ringing.poles, gains)
        ratios: Complex = np.exp(ringing.poles / self.sample_rate)
        angles = np.asarray((2 * np.pi / self.length) * bins, float)
        shapes = _inverses(angles, ratios)
        factors = 2 * np.concatenate((residues.real, (residues * ratios.conj()).real))
        real, imaginary = (_summed(shape, factors) for shape in shapes)
        turned, still = np.hsplit(real - 1j * imaginary, 2)
        return np.exp(1j * angles)[:, None] * turned - still

    def mirrored(self, bins: Index, poles: Complex, gains: Complex) -> Complex:
        """Return what the conjugate poles add, at the bins of positive frequencies."""
        return _summed(self.lines(bins, poles.conj()), self.residues(poles, gains).conj())

    def near(self, poles: Complex, halfwidths: Array) -> Index:
        """Return the bins within so many Hz of each pole."""
        middles, reach = poles.imag / (2 * np.pi * self.spacing), halfwidths / self.spacing
        last = len(self.values) - 1
        low = np.clip(np.ceil(middles - reach), 1, last - 1).astype(int)
        high = np.clip(np.floor(middles + reach), 1, last - 1).astype(int)
        first = int(low.min())
        inside = np.zeros(int(high.max()) + 1 - first, bool)
        for begin, end in zip((low - first).tolist(), (high + 1 - first).tolist(), strict=True):
            inside[begin:end] = True
        return np.asarray(first + np.flatnonzero(inside), np.int64)

    def _span(self, poles: Complex) -> Complex:
        return np.asarray(-np.expm1(poles * (self.length / self.sample_rate)) / 2j, complex)


def _inverses(angles: Array, ratios: Complex) -> tuple[Array, Array]:
    """Return 1 / ((1 - z / u) (u - conj(z))) at u = exp(i angle): real part, less the other."""
    squares = np.abs(ratios) ** 2
    real: Array = np.outer(np.cos(angles), 1 + squares)
    real -= 2 * ratios.real
    imaginary: Array = np.outer(np.sin(angles), 1 - squares)
    inverse = real * real
    inverse += imaginary * imaginary
    np.reciprocal(inverse, out=inverse)
    real *= inverse
    imaginary *= inverse
    return real, imaginary


def _summed(lines: NDArray[Any], residues: NDArray[Any]) -> NDArray[Any]:
    """Return lines (K, M) times residues (C, M), (K, C).

    For few channels without BLAS: its threads take longer to meet than one needs for the work.
    """
    if len(residues) <= _FEW:
        return np.stack([np.einsum("km,m->k", lines, each) for each in residues], axis=1)
    return lines @ residues.T

"""Free ringing: sums of decaying exponentials, in time and as exact discrete spectra."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_FEW = 4


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
    rows = np.arange(-(-length // width)) * (width / sample_rate)
    coarse: Complex = np.exp(rows[:, None] * poles)
    fine: Complex = np.exp(poles[:, None] * (np.arange(width) / sample_rate))
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
    coarse: Complex = np.exp((np.arange(count) * (width / sample_rate))[:, None] * poles.conj())
    fine: Complex = np.exp((np.arange(width) / sample_rate)[:, None] * poles.conj())
    rows = folded.reshape(channels, count, width)
    inner = rows @ fine.real + 1j * (rows @ fine.imag)
    return (inner * coarse).sum(axis=1)


def best_gains(poles: Complex, samples: Array, sample_rate: float) -> Complex:
    """Return the gains (C, M) of least squares of all modes at once, over all samples.

    The inner products of exponentials are geometric series, so only the correlations touch the
    samples.
    """
    length = samples.shape[1]
    steps = poles / sample_rate
    direct = _series(np.add.outer(steps.conj(), steps), length)
    mirrored = _series(np.add.outer(steps, steps), length)
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


def _series(exponents: Complex, length: int) -> Complex:
    """Return the sums of exp(x n) for n below the length."""
    return np.asarray(np.expm1(exponents * length) / np.expm1(exponents), complex)


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
        residues = self.residues(ringing.poles, gains)
        direct = _summed(self.lines(bins, ringing.poles), residues)
        return direct + self.mirrored(bins, ringing.poles, gains)

    def mirrored(self, bins: Index, poles: Complex, gains: Complex) -> Complex:
        """Return what the conjugate poles add, at the bins of positive frequencies."""
        return _summed(self.lines(bins, poles.conj()), self.residues(poles, gains).conj())

    def near(self, poles: Complex, halfwidths: Array) -> Index:
        """Return the bins within so many Hz of each pole."""
        middles, reach = poles.imag / (2 * np.pi * self.spacing), halfwidths / self.spacing
        last = len(self.values) - 1
        low = np.clip(np.ceil(middles - reach), 1, last - 1).astype(int)
        high = np.clip(np.floor(middles + reach), 1, last - 1).astype(int)
        return np.unique(
            np.concatenate([np.arange(a, b + 1) for a, b in zip(low, high, strict=True)])
        )

    def _span(self, poles: Complex) -> Complex:
        return np.asarray(-np.expm1(poles * (self.length / self.sample_rate)) / 2j, complex)


def _summed(lines: Complex, residues: Complex) -> Complex:
    """Return lines (K, M) times residues (C, M), (K, C).

    For few channels without BLAS: its threads take longer to meet than one needs for the work.
    """
    if len(residues) <= _FEW:
        return np.stack([(lines * each).sum(axis=1) for each in residues], axis=1)
    return lines @ residues.T

"""Sums of decaying exponentials: free vibration in time, and its exact discrete spectrum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from struck.model.arrays import AnyComplex, Array, Index, Mask, brief

_NEAR = 1e-2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exponentials:
    """Decaying exponentials: channel c is the sum over modes of Im[g_c exp(s t)].

    Parameters
    ----------
    poles : array (M,)
        s = -d + 2 pi i f, 1/s.
    gains : array (C, M)
        g, in the unit of the samples; channels of all segments in order.
    """

    __repr__ = brief
    poles: AnyComplex
    gains: AnyComplex

    @classmethod
    def silence(cls, channels: int) -> Exponentials:
        """Make exponentials without any mode.

        Parameters
        ----------
        channels : int
            Number of channels.

        Returns
        -------
        Exponentials
            No poles, and gains (channels, 0).
        """
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

    def of(self, modes: Index | Mask) -> Exponentials:
        """Select modes.

        Parameters
        ----------
        modes : array (K,) of int, or (M,) of bool
            Numbers of the modes, or a mask.

        Returns
        -------
        Exponentials
            The selected modes.
        """
        return Exponentials(poles=self.poles[modes], gains=self.gains[:, modes])

    def joined(self, poles: AnyComplex) -> Exponentials:
        """Return a copy with more poles, whose gains are 0.

        Parameters
        ----------
        poles : array (K,), complex
            Further poles, 1/s.

        Returns
        -------
        Exponentials
            The extended copy.
        """
        silent = np.zeros((len(self.gains), len(poles)), complex)
        return Exponentials(
            poles=np.concatenate((self.poles, poles)), gains=np.hstack((self.gains, silent))
        )

    def by_frequency(self) -> Exponentials:
        """Return a copy in ascending order of frequency.

        Returns
        -------
        Exponentials
            The sorted copy.
        """
        return self.of(np.argsort(self.poles.imag))


def samples(poles: AnyComplex, gains: AnyComplex, length: int, sample_rate: float) -> Array:
    """Return the samples (C, length) of the sum of Im[g exp(s n / rate)]."""
    # A sample's index is row * width + column, and so each exponential the product of two short
    # ones: all modes add up in a product of two matrices.
    rows = samples_in_rows(poles, gains, length, sample_rate)
    return rows.reshape(len(gains), -1)[:, :length]


def samples_in_rows(
    poles: AnyComplex, gains: AnyComplex, length: int, sample_rate: float, every: int = 1
) -> Array:
    """Return one in `every` rows of the samples, (C, rows, width); the width is root length."""
    width = row_width(length)
    coarse_powers = _powers(poles * (every * width / sample_rate), -(-length // (every * width))).T
    fine = _powers(poles / sample_rate, width)
    stacked = np.hstack((coarse_powers.real, coarse_powers.imag))
    rotated_powers = (gain[:, None] * fine for gain in gains)
    rows = [
        stacked @ np.vstack((row_powers.imag, row_powers.real)) for row_powers in rotated_powers
    ]
    return np.reshape(np.asarray(rows, float), (len(gains), len(coarse_powers), width))


def row_width(length: int) -> int:
    """Return the number of samples in a row."""
    return int(np.ceil(np.sqrt(length)))


def correlations(poles: AnyComplex, samples: Array, sample_rate: float) -> AnyComplex:
    """Return the sums of conj(exp(s n / rate)) x[n], (C, M)."""
    channels, length = samples.shape
    width = row_width(length)
    count = -(-length // width)
    folded = np.zeros((channels, count * width))
    folded[:, :length] = samples
    coarse_powers = _powers(poles.conj() * (width / sample_rate), count).T
    fine = _powers(poles.conj() / sample_rate, width).T
    inner = folded.reshape(channels, count, width) @ np.hstack((fine.real, fine.imag))
    real, imaginary = inner[..., : len(poles)], inner[..., len(poles) :]
    return np.einsum("crm,rm->cm", real + 1j * imaginary, coarse_powers)


def _powers(exponents: AnyComplex, count: int) -> AnyComplex:
    """Return exp(x n) for n below the count, (M, count), as products of two short factors."""
    width = row_width(count)
    rows = -(-count // width)
    coarse_powers: AnyComplex = np.exp(np.outer(exponents, width * np.arange(rows)))
    fine: AnyComplex = np.exp(np.outer(exponents, np.arange(width)))
    products = coarse_powers[:, :, None] * fine[:, None, :]
    return products.reshape(len(exponents), rows * width)[:, :count]


def best_gains(
    poles: AnyComplex, samples: Array, sample_rate: float, sums: AnyComplex | None = None
) -> AnyComplex:
    """Return least-squares gains (C, M) of all modes; sums are their `correlations`, if known."""
    # Inner products of exponentials are geometric series: only `correlations` touches samples.
    length = samples.shape[1]
    steps = poles / sample_rate
    direct_sums = _series(steps.conj(), steps, length)
    mirror_sums = _series(steps, steps, length)
    # Im[g w] = Re g Im w + Im g Re w: products of the real waves Im w and Re w.
    matrix = 0.5 * np.block(
        [
            [direct_sums.real - mirror_sums.real, direct_sums.imag.T + mirror_sums.imag],
            [direct_sums.imag + mirror_sums.imag, direct_sums.real + mirror_sums.real],
        ]
    )
    powers = matrix.diagonal()  # none at all is what the sine of a mode at 0 Hz has
    matrix += np.diag(1e-10 * powers + 1e-14 * powers.max(initial=0.0))
    sums = correlations(poles, samples, sample_rate) if sums is None else sums
    solution = np.linalg.solve(matrix, np.hstack((-sums.imag, sums.real)).T).T
    return solution[:, : len(poles)] + 1j * solution[:, len(poles) :]


def _series(left: AnyComplex, right: AnyComplex, length: int) -> AnyComplex:
    """Return the sums of exp((x + y) n) for n below the length, one row for each x."""
    last = np.outer(np.exp(left * length), np.exp(right * length))
    first = np.outer(np.exp(left), np.exp(right)) - 1
    # Where much cancels, digit by digit.
    x, y = np.nonzero(np.abs(first) < _NEAR)
    first[x, y] = np.expm1(left[x] + right[y])
    return np.asarray((last - 1) / first, complex)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SegmentSpectrum:
    """The discrete Fourier transform of a segment's first N samples."""

    # A mode that rings from the first of N samples on has the transform r / (1 - z / u) at
    # u = exp(2 pi i k / N), exactly: z = exp(s / rate) and r = g (1 - z^N) / 2i. Its conjugate
    # belongs to it, for samples are real.
    values: AnyComplex  # (N / 2 + 1, C), from 0 Hz to half the sample rate
    turns: AnyComplex  # (N / 2 + 1,), 1 / u
    length: int  # N
    sample_rate: float  # Hz

    @classmethod
    def of(cls, samples: Array, length: int, sample_rate: float) -> SegmentSpectrum:
        """Transform the first samples of each channel, (C, n)."""
        values = np.ascontiguousarray(np.fft.rfft(samples[:, :length], axis=1).T)
        turns = np.exp((-2j * np.pi / length) * np.arange(len(values)))
        return cls(values=values, turns=turns, length=length, sample_rate=sample_rate)

    @property
    def spacing(self) -> float:
        """Distance between bins, Hz."""
        return self.sample_rate / self.length

"""First estimates of poles: ESPRIT in the bins of windowed transforms, and matched filters.

In a bin of a transform whose frames look forward each mode is an exponential from frame to frame,
and few modes share a bin. Poles follow from the invariance of the signal subspace under a shift by
one frame (Roy and Kailath 1989), against noise whitened for the overlap of the frames.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import fft
from scipy.linalg import toeplitz
from scipy.ndimage import uniform_filter1d
from scipy.signal import fftconvolve

from struck.model.arrays import AnyComplex, Array, Index
from struck.perception.auditory_scale import erb_number
from struck.recordings.noise import Noise, blackman_harris, frames
from struck.recordings.segments import Segment

_OVERLAP = 8
_RISE = 8.0  # least power of a bin's first frames over the noise that is searched: 9 dB
_GONE = 3.0  # power over noise down to which frames count
_FIRST = 6
_FEWEST = 12
_WINDOW = 28
_BATCH = 64
_DIRECTIONS = 8
_COUNTS = np.array([24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256, 300])


@dataclass(frozen=True, slots=True, kw_only=True)
class Resolution:
    """Window of a transform and the poles that are looked for in its bins."""

    window: int  # samples, a power of two
    fastest: float  # largest decay rate, 1/s
    frames: int  # at most
    orders: int  # poles of a bin at most


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Candidates:
    """Poles (M,), 1/s, and their energies, in the unit of the noise's density."""

    poles: AnyComplex
    energies: Array

    @classmethod
    def joined(cls, parts: Sequence[Candidates]) -> Candidates:
        """Return the candidates of all parts."""
        return cls(
            poles=np.concatenate([np.zeros(0, complex), *(part.poles for part in parts)]),
            energies=np.concatenate([np.zeros(0), *(part.energies for part in parts)]),
        )

    def distinct(self, resolved: float, share: float) -> Candidates:
        """Return the strongest of poles closer than `resolved` Hz or a share of their widths."""
        order = np.argsort(self.poles.imag)
        poles, energies = self.poles[order], self.energies[order]
        frequencies, widths = poles.imag / (2 * np.pi), -poles.real / (2 * np.pi)
        reaches = np.maximum(resolved, share * (widths + widths.max(initial=0.0)))
        firsts = np.searchsorted(frequencies, frequencies - reaches)
        lasts = np.searchsorted(frequencies, frequencies + reaches, "right")
        open_ = np.ones(len(poles), bool)
        kept = []
        for mode in np.argsort(-energies):
            if open_[mode]:
                kept.append(mode)
                near = slice(firsts[mode], lasts[mode])
                reach = np.maximum(resolved, share * (widths[near] + widths[mode]))
                open_[near] &= np.abs(frequencies[near] - frequencies[mode]) >= reach
        return Candidates(poles=poles[kept], energies=energies[kept])


def candidates(
    segments: Sequence[Segment],
    left: Sequence[Array],
    resolution: Resolution,
    per_band: int | None = None,
) -> Candidates:
    """Search recordings less the modes found so far for further ones, by ESPRIT, in all segments.

    Residuals are of shape (C, n); segments too short for the window give none.

    `per_band` is how many bins are searched in each auditory band (ERB) at most, the loudest.
    """
    search = _Search(
        window=blackman_harris(resolution.window),
        step=resolution.window // _OVERLAP,
        sample_rate=segments[0].sample_rate,
        resolution=resolution,
    )
    white = search.white(segments, left)
    if white.shape[1] < _FEWEST:
        return Candidates.joined([])
    powers = np.max([each.real**2 + each.imag**2 for each in white], axis=0)
    found = []
    for count, bins in _counted(powers, search.spacing, search.sample_rate, per_band):
        for part in np.array_split(bins, -(-len(bins) // _BATCH)):
            found += search.bins(white[:, :count, part].transpose(2, 0, 1), part)
    return Candidates.joined(found).distinct(0.02 * search.spacing, share=0.1)


def _counted(
    powers: Array, spacing: float, sample_rate: float, per_band: int | None
) -> Iterator[tuple[int, Index]]:
    """Yield numbers of frames and the bins that stay over the noise for about that long."""
    total = len(powers)
    centres = np.arange(powers.shape[1]) * spacing
    heard = (powers[:_FIRST].max(axis=0) > _RISE) & (centres > 30) & (centres < 0.47 * sample_rate)
    bins = np.flatnonzero(heard)
    if per_band is not None:
        bins = bins[loudest_per_band(powers[:, bins].sum(axis=0), centres[bins], per_band)]
    alive = uniform_filter1d(powers[:, bins], 5, axis=0, mode="constant") > _GONE
    last = np.where(alive.any(axis=0), total - np.argmax(alive[::-1], axis=0), 0)
    counts = np.append(_COUNTS[total > _COUNTS], total)
    wanted = counts[np.searchsorted(counts, np.minimum(last, total))]
    for count in np.unique(wanted):
        yield int(count), bins[wanted == count]


def loudest_per_band(energies: Array, frequencies: Array, most: int) -> Index:
    """Return which places (K,), ascending, have the most energy of their auditory band (ERB)."""
    bands = erb_number(frequencies).astype(int)
    order = np.lexsort((-energies, bands))
    firsts = np.searchsorted(bands[order], bands[order])
    return np.sort(order[np.arange(len(order)) - firsts < most])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Search:
    window: Array
    step: int
    sample_rate: float
    resolution: Resolution

    @property
    def spacing(self) -> float:
        """From one bin to the next, Hz."""
        return self.sample_rate / len(self.window)

    def white(self, segments: Sequence[Segment], left: Sequence[Array]) -> AnyComplex:
        """Return frames of the long segments (C, frames, bins), in units of the noise."""
        counts = [(each.shape[1] - len(self.window)) // self.step + 1 for each in left]
        most = min(max(counts), self.resolution.frames)
        count = min(each for each in (*counts, most) if each >= most / 2)
        centres = np.arange(len(self.window) // 2) * self.spacing
        energy = (self.window**2).sum()
        parts = [
            frames(samples, self.window, self.step, count)
            / np.sqrt(segment.noise.at(centres) * energy)[:, None].astype(np.float32)
            for segment, samples, here in zip(segments, left, counts, strict=True)
            if here >= count
        ]
        return np.concatenate(parts)

    def bins(self, white: AnyComplex, bins: Index) -> list[Candidates]:
        """Return the poles in some bins of white frames (bins, C, frames)."""
        count = white.shape[2]
        length = min(count // 2, _WINDOW)
        whitening, back = _whitening(self.resolution.window, length)
        strongest = _strongest_directions(white.astype(complex))
        sliding = np.lib.stride_tricks.sliding_window_view(strongest, length, axis=2)
        rows = sliding.reshape(len(bins), -1, length)
        pieces = strongest.shape[1] * sliding.shape[2]
        covariance = rows.swapaxes(1, 2) @ rows.conj() / pieces
        powers, vectors = np.linalg.eigh(whitening @ covariance @ whitening.conj().T)
        noise = 3 * (1 + np.sqrt(2 * length / pieces)) ** 2
        orders = np.minimum((powers > noise).sum(axis=1), self.resolution.orders)
        found = []
        for order in np.unique(orders[orders > 0]):
            these = orders == order
            signals = np.asarray(back @ vectors[these][:, :, -order:], complex)
            ratios = _ratios(signals)
            found.append(self._accepted(ratios, white[these], bins[these]))
        return found

    def _accepted(self, ratios: AnyComplex, white: AnyComplex, bins: Index) -> Candidates:
        """Return the poles that lie in their own bin and do not merely cancel others."""
        rate = self.sample_rate / self.step
        modulus = np.clip(np.abs(ratios), 1e-2, np.exp(-0.05 / rate))
        decays, shifts = -np.log(modulus) * rate, np.angle(ratios) * rate / (2 * np.pi)
        times = np.arange(white.shape[2]) / rate
        waves = np.exp(times[:, None] * (-decays + 2j * np.pi * shifts)[:, None, :])
        amplitudes = _least_squares(waves, white.swapaxes(1, 2))
        observed = np.abs(white).max(axis=(1, 2))[:, None]
        good = np.abs(shifts) < 0.55 * self.spacing
        good &= (decays < self.resolution.fastest) & (np.abs(amplitudes).max(axis=2) < 2 * observed)
        energies = (np.abs(amplitudes) ** 2).sum(axis=2) * (np.abs(waves) ** 2).sum(axis=1)
        frequencies = (bins * self.spacing)[:, None] + shifts
        return Candidates(
            poles=(-decays + 2j * np.pi * frequencies)[good],
            energies=(2 * self.step / len(self.window) * energies)[good],
        )


@cache
def _whitening(size: int, length: int) -> tuple[Array, Array]:
    """Return the matrix that makes noise in overlapping frames nearly white, and its inverse."""
    window, step = blackman_harris(size), size // _OVERLAP
    shifts = range(0, min(length * step, size), step)
    lags = [(window[: size - each] * window[each:]).sum() / (window**2).sum() for each in shifts]
    correlation = np.pad(lags, (0, length - len(lags)))
    regular = toeplitz(correlation) + 5e-3 * np.eye(length)
    whitening = np.asarray(np.linalg.inv(np.linalg.cholesky(regular)), float)
    return whitening, np.asarray(np.linalg.inv(whitening), float)


def _strongest_directions(white: AnyComplex) -> AnyComplex:
    """Return white frames with channels reduced to the directions of most energy."""
    if white.shape[1] <= 2 * _DIRECTIONS:
        return white
    _, vectors = np.linalg.eigh(white @ white.conj().swapaxes(1, 2))
    return vectors[:, :, -_DIRECTIONS:].conj().swapaxes(1, 2) @ white


def _ratios(subspaces: AnyComplex) -> AnyComplex:
    """Return the eigenvalues of the shift by one frame within each subspace."""
    before, after = subspaces[:, :-1], subspaces[:, 1:]
    return np.linalg.eigvals(_least_squares(before, after))


def _least_squares(matrices: AnyComplex, sides: AnyComplex) -> AnyComplex:
    adjoint = matrices.conj().swapaxes(1, 2)
    normal = adjoint @ matrices
    size = np.trace(normal, axis1=1, axis2=2).real[:, None, None]
    return np.linalg.solve(normal + 1e-10 * size * np.eye(normal.shape[1]), adjoint @ sides)


_LOW, _LONG = 1000.0, 0.3  # Hz and s that the search for broad modes covers
_TAPS, _ORDER, _WEAKEST = 4, 24, 1e-7  # of its filter, over the decimation; poles; of the energy


def broad(segments: Sequence[Segment], left: Sequence[Array]) -> Candidates:
    """Search the low end of the residuals (C, n) of all segments for broad modes, as drums have.

    In a window of a transform there is too little of them: here ESPRIT takes the beginning of the
    sound as a whole, decimated by a filter that looks forward, which leaves exponentials what they
    are.
    """
    rate = segments[0].sample_rate
    factor = max(1, int(rate / (4 * _LOW)))
    length = min(*(each.shape[1] for each in left), round(_LONG * rate))
    taps = np.hanning(_TAPS * factor + 2)[1:-1]
    densities = np.concatenate([each.noise.at([_LOW / 2]) for each in segments])
    whole = np.concatenate([each[:, :length] for each in left]) / np.sqrt(densities)
    low = fftconvolve(whole, taps[None, ::-1] / taps.sum(), "valid", axes=1)[:, ::factor]
    size = low.shape[1] // 2
    if size < _FEWEST:
        return Candidates.joined([])
    rows = np.lib.stride_tricks.sliding_window_view(low, size, axis=1).reshape(-1, size)
    powers, vectors = np.linalg.eigh(rows.T @ rows)
    order = min(_ORDER, np.count_nonzero(powers > _WEAKEST * powers[-1]))
    ratios = _ratios(vectors[None, :, -order:].astype(complex))[0]
    poles = np.log(ratios) * rate / factor
    waves = np.exp(np.outer(np.arange(low.shape[1]) * factor / rate, poles))
    amplitudes = _least_squares(waves[None], low.T[None].astype(complex))[0]
    passed = taps @ np.exp(np.outer(np.arange(len(taps)) / rate, poles)) / taps.sum()
    energies = (np.abs(amplitudes) ** 2).sum(axis=1) / np.abs(passed) ** 2
    energies *= rate / np.maximum(-poles.real, 1e-3)
    good = (poles.imag > 2 * np.pi * _LOWEST / 2) & (poles.imag < 2 * np.pi * _LOW)
    good &= poles.real < 0
    return Candidates(poles=poles[good], energies=energies[good])


# 1/s; between two of them a twelfth of the energy is lost at most
DECAYS = (0.7, 2.0, 6.0, 18.0, 54.0, 160.0, 480.0)
_BREADTH = 30.0  # Hz over which the residual is averaged
_LOWEST, _HIGHEST = 30.0, 0.47  # frequencies, Hz and of the sample rate


def matched(segments: Sequence[Segment], left: Sequence[Array], least: float) -> Candidates:
    """Search the residuals (C, n) of all segments for modes with at least this energy over noise.

    Energies are summed over channels; where more than noise is left over a breadth of bins, they
    count over that. Against white noise nothing detects a mode of known decay better than the
    correlation with its exponential: one Fourier transform for each decay rate.
    """
    rate = segments[0].sample_rate
    noises = [
        segment.noise.raised(samples, rate, _BREADTH)
        for segment, samples in zip(segments, left, strict=True)
    ]
    found = []
    for decay in DECAYS:
        size = fft.next_fast_len(2 * max(_count(decay, each, rate) for each in left), real=True)
        frequencies = np.arange(size // 2 + 1) * (rate / size)
        energies = np.zeros(len(frequencies))
        for noise, samples in zip(noises, left, strict=True):
            energies += _energies(noise, samples, decay, frequencies)
        peaks = _peaks(energies, least)
        heard = (frequencies[peaks] > _LOWEST) & (frequencies[peaks] < _HIGHEST * rate)
        peaks = peaks[heard & (decay < np.pi * frequencies[peaks])]
        poles = -decay + 2j * np.pi * frequencies[peaks]
        found.append(Candidates(poles=poles, energies=energies[peaks]))
    longest = max(each.shape[1] for each in left)
    return Candidates.joined(found).distinct(rate / longest, share=1.0)


def _count(decay: float, samples: Array, sample_rate: float) -> int:
    return min(samples.shape[1], int(8 / decay * sample_rate))


def _energies(
    noise: Noise, samples: Array, decay: float, frequencies: NDArray[np.floating]
) -> Array:
    """Return energies along one exponential over noise, summed over channels."""
    size, rate = 2 * (len(frequencies) - 1), 2 * frequencies[-1]
    shape = np.exp(-decay / rate * np.arange(_count(decay, samples, rate)))
    floor = noise.at(frequencies) * (shape**2).sum()
    total = np.zeros(len(frequencies))
    for channel, density in zip(samples, floor, strict=True):
        transform = fft.rfft(channel[: len(shape)] * shape, size)
        total += (transform.real**2 + transform.imag**2) / density
    return total


def _peaks(values: Array, least: float) -> NDArray[np.int64]:
    middle = values[1:-1]
    return 1 + np.flatnonzero((middle > least) & (middle >= values[:-2]) & (middle > values[2:]))

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
_END_POWER = 3.0  # power over noise down to which frames count
_FIRST = 6
_MIN_FRAMES = 12
_WINDOW = 28
_BATCH = 64
_DIRECTIONS = 8
_COUNTS = np.array([24, 28, 32, 40, 48, 56, 64, 80, 96, 112, 128, 160, 192, 224, 256, 300])


@dataclass(frozen=True, slots=True, kw_only=True)
class Resolution:
    """Window of a transform, and bounds of the poles in its bins."""

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

    def distinct(self, resolution: float, width_factor: float) -> Candidates:
        """Return the strongest of poles within `resolution` Hz or a fraction of their widths."""
        order = np.argsort(self.poles.imag)
        poles, energies = self.poles[order], self.energies[order]
        frequencies, widths = poles.imag / (2 * np.pi), -poles.real / (2 * np.pi)
        max_distances = np.maximum(resolution, width_factor * (widths + widths.max(initial=0.0)))
        firsts = np.searchsorted(frequencies, frequencies - max_distances)
        stops = np.searchsorted(frequencies, frequencies + max_distances, "right")
        is_open = np.ones(len(poles), bool)
        modes = []
        for mode in np.argsort(-energies):
            if is_open[mode]:
                modes.append(mode)
                neighbours = slice(firsts[mode], stops[mode])
                reach = np.maximum(resolution, width_factor * (widths[neighbours] + widths[mode]))
                is_open[neighbours] &= np.abs(frequencies[neighbours] - frequencies[mode]) >= reach
        return Candidates(poles=poles[modes], energies=energies[modes])


def find_candidates(
    segments: Sequence[Segment],
    left: Sequence[Array],
    resolution: Resolution,
    per_band: int | None = None,
) -> Candidates:
    """Search the residuals of all segments for further modes by ESPRIT.

    Residuals are of shape (C, n); segments too short for the window give none. `per_band` is the
    largest number of bins that are searched in each auditory band (ERB), the loudest ones.
    """
    search = _Search(
        window=blackman_harris(resolution.window),
        step=resolution.window // _OVERLAP,
        sample_rate=segments[0].sample_rate,
        resolution=resolution,
    )
    white = search.white(segments, left)
    if white.shape[1] < _MIN_FRAMES:
        return Candidates.joined([])
    powers = np.max([spectra.real**2 + spectra.imag**2 for spectra in white], axis=0)
    parts = []
    for count, bins in _group_by_duration(powers, search.spacing, search.sample_rate, per_band):
        for part in np.array_split(bins, -(-len(bins) // _BATCH)):
            parts += search.bins(white[:, :count, part].transpose(2, 0, 1), part)
    return Candidates.joined(parts).distinct(0.02 * search.spacing, width_factor=0.1)


def _group_by_duration(
    powers: Array, spacing: float, sample_rate: float, per_band: int | None
) -> Iterator[tuple[int, Index]]:
    """Yield numbers of frames and the bins that stay over the noise for about that long."""
    total_frames = len(powers)
    centres = np.arange(powers.shape[1]) * spacing
    is_loud = (
        (powers[:_FIRST].max(axis=0) > _RISE) & (centres > 30) & (centres < 0.47 * sample_rate)
    )
    bins = np.flatnonzero(is_loud)
    if per_band is not None:
        bins = bins[loudest_per_band(powers[:, bins].sum(axis=0), centres[bins], per_band)]
    is_alive = uniform_filter1d(powers[:, bins], 5, axis=0, mode="constant") > _END_POWER
    last = np.where(is_alive.any(axis=0), total_frames - np.argmax(is_alive[::-1], axis=0), 0)
    counts = np.append(_COUNTS[total_frames > _COUNTS], total_frames)
    frame_counts = counts[np.searchsorted(counts, np.minimum(last, total_frames))]
    for count in np.unique(frame_counts):
        yield int(count), bins[frame_counts == count]


def loudest_per_band(energies: Array, frequencies: Array, max_count: int) -> Index:
    """Return which places (K,), ascending, have the most energy of their auditory band (ERB)."""
    bands = erb_number(frequencies).astype(int)
    order = np.lexsort((-energies, bands))
    firsts = np.searchsorted(bands[order], bands[order])
    return np.sort(order[np.arange(len(order)) - firsts < max_count])


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
        counts = [(samples.shape[1] - len(self.window)) // self.step + 1 for samples in left]
        max_count = min(max(counts), self.resolution.frames)
        count = min(number for number in (*counts, max_count) if number >= max_count / 2)
        centres = np.arange(len(self.window) // 2) * self.spacing
        energy = (self.window**2).sum()
        parts = [
            frames(samples, self.window, self.step, count)
            / np.sqrt(segment.noise.at(centres) * energy)[:, None].astype(np.float32)
            for segment, samples, segment_count in zip(segments, left, counts, strict=True)
            if segment_count >= count
        ]
        return np.concatenate(parts)

    def bins(self, white: AnyComplex, bins: Index) -> list[Candidates]:
        """Return the poles in some bins of white frames (bins, C, frames)."""
        count = white.shape[2]
        length = min(count // 2, _WINDOW)
        whitening, back = _whitening(self.resolution.window, length)
        main_directions = _reduce_channels(white.astype(complex))
        sliding = np.lib.stride_tricks.sliding_window_view(main_directions, length, axis=2)
        rows = sliding.reshape(len(bins), -1, length)
        pieces = main_directions.shape[1] * sliding.shape[2]
        covariance = rows.swapaxes(1, 2) @ rows.conj() / pieces
        powers, vectors = np.linalg.eigh(whitening @ covariance @ whitening.conj().T)
        noise = 3 * (1 + np.sqrt(2 * length / pieces)) ** 2
        orders = np.minimum((powers > noise).sum(axis=1), self.resolution.orders)
        parts = []
        for order in np.unique(orders[orders > 0]):
            has_order = orders == order
            signals = np.asarray(back @ vectors[has_order][:, :, -order:], complex)
            ratios = _ratios(signals)
            parts.append(self._accepted(ratios, white[has_order], bins[has_order]))
        return parts

    def _accepted(self, ratios: AnyComplex, white: AnyComplex, bins: Index) -> Candidates:
        """Return the poles that lie in their own bin and do not merely cancel others."""
        rate = self.sample_rate / self.step
        modulus = np.clip(np.abs(ratios), 1e-2, np.exp(-0.05 / rate))
        decays, shifts = -np.log(modulus) * rate, np.angle(ratios) * rate / (2 * np.pi)
        times = np.arange(white.shape[2]) / rate
        waves = np.exp(times[:, None] * (-decays + 2j * np.pi * shifts)[:, None, :])
        amplitudes = _solve_least_squares(waves, white.swapaxes(1, 2))
        peak_magnitudes = np.abs(white).max(axis=(1, 2))[:, None]
        is_good = np.abs(shifts) < 0.55 * self.spacing
        is_good &= (decays < self.resolution.fastest) & (
            np.abs(amplitudes).max(axis=2) < 2 * peak_magnitudes
        )
        energies = (np.abs(amplitudes) ** 2).sum(axis=2) * (np.abs(waves) ** 2).sum(axis=1)
        frequencies = (bins * self.spacing)[:, None] + shifts
        return Candidates(
            poles=(-decays + 2j * np.pi * frequencies)[is_good],
            energies=(2 * self.step / len(self.window) * energies)[is_good],
        )


@cache
def _whitening(size: int, length: int) -> tuple[Array, Array]:
    """Return the matrix that makes noise in overlapping frames nearly white, and its inverse."""
    window, step = blackman_harris(size), size // _OVERLAP
    shifts = range(0, min(length * step, size), step)
    lags = [(window[: size - shift] * window[shift:]).sum() / (window**2).sum() for shift in shifts]
    correlation = np.pad(lags, (0, length - len(lags)))
    regular = toeplitz(correlation) + 5e-3 * np.eye(length)
    whitening = np.asarray(np.linalg.inv(np.linalg.cholesky(regular)), float)
    return whitening, np.asarray(np.linalg.inv(whitening), float)


def _reduce_channels(white: AnyComplex) -> AnyComplex:
    """Return white frames with channels reduced to the directions of most energy."""
    if white.shape[1] <= 2 * _DIRECTIONS:
        return white
    _, vectors = np.linalg.eigh(white @ white.conj().swapaxes(1, 2))
    return vectors[:, :, -_DIRECTIONS:].conj().swapaxes(1, 2) @ white


def _ratios(subspaces: AnyComplex) -> AnyComplex:
    """Return the eigenvalues of the shift by one frame within each subspace."""
    earlier_vectors, later_vectors = subspaces[:, :-1], subspaces[:, 1:]
    return np.linalg.eigvals(_solve_least_squares(earlier_vectors, later_vectors))


def _solve_least_squares(matrices: AnyComplex, sides: AnyComplex) -> AnyComplex:
    adjoint = matrices.conj().swapaxes(1, 2)
    normal_matrix = adjoint @ matrices
    size = np.trace(normal_matrix, axis1=1, axis2=2).real[:, None, None]
    return np.linalg.solve(
        normal_matrix + 1e-10 * size * np.eye(normal_matrix.shape[1]), adjoint @ sides
    )


_LOW, _LONG = 1000.0, 0.3  # Hz and s that the search for broad modes covers
_TAPS = 4  # of its filter, over the decimation
_ORDER = 24  # poles
_MIN_POWER_RATIO = 1e-7  # of the largest eigenvalue of the covariance


def find_broad(segments: Sequence[Segment], left: Sequence[Array]) -> Candidates:
    """Search the low end of the residuals (C, n) of all segments for broad modes, as drums have.

    In a window of a transform there is too little of them: here ESPRIT takes the beginning of the
    sound as a whole, decimated by a filter that looks forward, which leaves exponentials what they
    are.
    """
    rate = segments[0].sample_rate
    factor = max(1, int(rate / (4 * _LOW)))
    length = min(*(residual.shape[1] for residual in left), round(_LONG * rate))
    taps = np.hanning(_TAPS * factor + 2)[1:-1]
    densities = np.concatenate([segment.noise.at([_LOW / 2]) for segment in segments])
    whitened_samples = np.concatenate([residual[:, :length] for residual in left]) / np.sqrt(
        densities
    )
    low = fftconvolve(whitened_samples, taps[None, ::-1] / taps.sum(), "valid", axes=1)[:, ::factor]
    size = low.shape[1] // 2
    if size < _MIN_FRAMES:
        return Candidates.joined([])
    rows = np.lib.stride_tricks.sliding_window_view(low, size, axis=1).reshape(-1, size)
    powers, vectors = np.linalg.eigh(rows.T @ rows)
    order = min(_ORDER, np.count_nonzero(powers > _MIN_POWER_RATIO * powers[-1]))
    ratios = _ratios(vectors[None, :, -order:].astype(complex))[0]
    poles = np.log(ratios) * rate / factor
    waves = np.exp(np.outer(np.arange(low.shape[1]) * factor / rate, poles))
    amplitudes = _solve_least_squares(waves[None], low.T[None].astype(complex))[0]
    filter_gains = taps @ np.exp(np.outer(np.arange(len(taps)) / rate, poles)) / taps.sum()
    energies = (np.abs(amplitudes) ** 2).sum(axis=1) / np.abs(filter_gains) ** 2
    energies *= rate / np.maximum(-poles.real, 1e-3)
    is_good = (poles.imag > 2 * np.pi * _MIN_FREQUENCY / 2) & (poles.imag < 2 * np.pi * _LOW)
    is_good &= poles.real < 0
    return Candidates(poles=poles[is_good], energies=energies[is_good])


# 1/s; between two of them a twelfth of the energy is lost at most
DECAYS = (0.7, 2.0, 6.0, 18.0, 54.0, 160.0, 480.0)
_BREADTH = 30.0  # Hz over which the residual is averaged
_MIN_FREQUENCY, _MAX_RATE_FRACTION = 30.0, 0.47  # frequencies, Hz and of the sample rate


def match_filters(
    segments: Sequence[Segment], left: Sequence[Array], min_energy: float
) -> Candidates:
    """Search the residuals (C, n) of all segments for modes with at least this energy over noise.

    Energies are summed over channels; if the residual exceeds the noise over a breadth of bins,
    they are relative to it. Against white noise nothing detects a mode of known decay better than
    the correlation with its exponential: one Fourier transform for each decay rate.
    """
    rate = segments[0].sample_rate
    noises = [
        segment.noise.raised(samples, rate, _BREADTH)
        for segment, samples in zip(segments, left, strict=True)
    ]
    parts = []
    for decay in DECAYS:
        size = fft.next_fast_len(
            2 * max(_count(decay, residual, rate) for residual in left), real=True
        )
        frequencies = np.arange(size // 2 + 1) * (rate / size)
        energies = np.zeros(len(frequencies))
        for noise, samples in zip(noises, left, strict=True):
            energies += _energies(noise, samples, decay, frequencies)
        peaks = _peaks(energies, min_energy)
        is_in_band = (frequencies[peaks] > _MIN_FREQUENCY) & (
            frequencies[peaks] < _MAX_RATE_FRACTION * rate
        )
        peaks = peaks[is_in_band & (decay < np.pi * frequencies[peaks])]
        poles = -decay + 2j * np.pi * frequencies[peaks]
        parts.append(Candidates(poles=poles, energies=energies[peaks]))
    longest = max(residual.shape[1] for residual in left)
    return Candidates.joined(parts).distinct(rate / longest, width_factor=1.0)


def _count(decay: float, samples: Array, sample_rate: float) -> int:
    return min(samples.shape[1], int(8 / decay * sample_rate))


def _energies(
    noise: Noise, samples: Array, decay: float, frequencies: NDArray[np.floating]
) -> Array:
    """Return energies along one exponential over noise, summed over channels."""
    size, rate = 2 * (len(frequencies) - 1), 2 * frequencies[-1]
    shape = np.exp(-decay / rate * np.arange(_count(decay, samples, rate)))
    floor = noise.at(frequencies) * (shape**2).sum()
    energies = np.zeros(len(frequencies))
    for channel, density in zip(samples, floor, strict=True):
        transform = fft.rfft(channel[: len(shape)] * shape, size)
        energies += (transform.real**2 + transform.imag**2) / density
    return energies


def _peaks(values: Array, threshold: float) -> NDArray[np.int64]:
    inner_values = values[1:-1]
    return 1 + np.flatnonzero(
        (inner_values > threshold) & (inner_values >= values[:-2]) & (inner_values > values[2:])
    )

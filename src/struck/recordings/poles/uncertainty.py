"""Standard errors of fitted frequencies, decays and gains, and signs of unresolved pairs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.special import gammainc
from scipy.stats import chi2, gamma

from struck.core import entry
from struck.model.arrays import AnyComplex, Array, Index
from struck.model.exponentials import Exponentials, correlations
from struck.recordings.noise import Noise, blackman_harris, frames
from struck.recordings.poles.normal_equations import normal_equations
from struck.recordings.poles.projection import (
    GroupBlocks,
    Projection,
    inverse_spreads,
    misfit,
    orthonormalised,
    project,
    slopes_of,
    solve_damped,
    span,
    subtract_others,
    without,
)
from struck.recordings.poles.refinement import blocks_around, find_groups
from struck.recordings.segments import Segment

CHANCE = 2e-9  # that noise alone explains a mode: 16 dB of energy in one channel


@cache
def significance(channels: int, chance: float = CHANCE) -> float:
    """Return the energy over noise that noise in these channels exceeds by this chance.

    The energy of complex noise along one direction is exponentially distributed, its sum over
    channels a gamma distribution.
    """
    return float(gamma.isf(chance, channels))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PoleStatistics:
    """Cramer-Rao variances of M poles and of gains in C channels, signs of unresolved pairs."""

    order: Index  # (M,), modes group by group
    variances: Array  # (M,), of the poles, 1/s^2
    sizes: Array  # (C, M), variances of the gains' sizes
    energies: Array  # (M,), of the residual along the modes' second derivatives, over chance
    crossed: AnyComplex  # (M,), products of that residual with the modes
    whole: Array  # (M,), of the modes with themselves


def pole_statistics(segments: Sequence[Segment], ringing: Exponentials) -> PoleStatistics:
    """Return the statistics of fitted modes from the bins of all segments."""
    count, gains = ringing.count, np.ascontiguousarray(ringing.gains)
    statistics = PoleStatistics(
        order=np.zeros(count, np.int64),
        variances=np.zeros(count),
        sizes=np.zeros(gains.shape),
        energies=np.zeros(count),
        crossed=np.zeros(count, complex),
        whole=np.zeros(count),
    )
    if count:
        duration = max(segment.duration for segment in segments)
        blocks = blocks_around(segments, ringing.poles, find_groups(ringing.poles, duration))
        statistics.order[:] = blocks.members
        write_statistics(blocks, np.ascontiguousarray(ringing.poles), gains, statistics)
    return statistics


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StandardErrors:
    """Standard errors of a fit."""

    frequencies: Array  # (M,), Hz
    decays: Array  # (M,), 1/s
    gains: Array  # (C, M), of the sizes, unit of the samples


def standard_errors(segments: Sequence[Segment], ringing: Exponentials) -> StandardErrors:
    """Return the Cramer-Rao bounds of a fit, from all channels and hits together.

    The inverse of the Fisher information of the poles of a group, its complex gains eliminated; for
    exponentials in noise it is the same for the angular frequency as for the decay rate. Where a
    fit leaves more than the noise, the residual takes the noise's place, as far as it sounds while
    a mode does. Gains are bounded with the poles as they are.
    """
    raised_segments = [_raise_noise(segment, ringing) for segment in segments]
    statistics = pole_statistics([segment for segment, _ in raised_segments], ringing)
    errors = np.sqrt(statistics.variances / 2)
    sizes = statistics.sizes * np.concatenate([gain_ratios for _, gain_ratios in raised_segments])
    return StandardErrors(frequencies=errors / (2 * np.pi), decays=errors, gains=np.sqrt(sizes))


def between_takes(
    segments: Sequence[Segment], takes: Index, ringing: Exponentials
) -> tuple[Array, Array]:
    """Return by how much frequencies, Hz, and decays, 1/s, differ between takes of rows (C,).

    Standard deviations (M,), 0 where noise may explain them, of the step from the common pole to
    that of each take, its gains refitted (random effects of DerSimonian and Laird 1986).
    """
    frequencies, double_decays = ringing.frequencies, 2 * ringing.decays
    steps = np.zeros((takes.max(initial=0) + 1, ringing.count), complex)
    weights, has_several_takes = np.zeros(steps.shape), len(np.unique(takes)) > 1
    for segment in segments if has_several_takes else ():
        take_numbers, left, rate = (
            takes[segment.rows],
            segment.residual(ringing),
            segment.sample_rate,
        )
        ends = (
            double_decays * segment.duration
        )  # integrals of t^k exp(-2 d t) over it, k from 0 to 2
        one, first, second_moment = (
            gammainc(k, ends) * max(k - 1, 1) / double_decays**k for k in (1, 2, 3)
        )
        times = np.arange(left.shape[1]) / rate
        sums, weighted_sums = np.split(
            correlations(ringing.poles, np.r_[left, left * times], rate), 2
        )
        gains, noise = ringing.gains[segment.rows], segment.noise.at(frequencies)
        np.add.at(
            steps, take_numbers, 1j * gains.conj() * (weighted_sums - first / one * sums) / noise
        )
        variance = rate * (second_moment - first**2 / one)
        np.add.at(weights, take_numbers, np.abs(gains) ** 2 * variance / (2 * noise))
    steps /= np.maximum(weights, _MIN_DIVISOR)
    weights = weights[np.unique(takes)]
    steps, total_weights = steps[np.unique(takes)], np.maximum(weights.sum(axis=0), _MIN_DIVISOR)
    freedom = max(len(steps) - 1, 1)
    deviations = []
    for parts in (np.imag(steps), np.real(steps)):
        differences = parts - (weights * parts).sum(axis=0) / total_weights
        scatter = (weights * differences**2).sum(axis=0)
        excess_variance = (scatter - freedom) / np.maximum(
            total_weights - (weights**2).sum(axis=0) / total_weights, _MIN_DIVISOR
        )
        deviations.append(
            np.sqrt(np.where(scatter > chi2.isf(_DIFFERENCE_CHANCE, freedom), excess_variance, 0.0))
        )
    return deviations[0] / (2 * np.pi), deviations[1]


def densities_at_modes(segments: Sequence[Segment], ringing: Exponentials) -> tuple[Array, Array]:
    """Return the densities (C, M) of noise, or of a louder residual, for poles and for gains."""
    parts = [_raise_noise(segment, ringing) for segment in segments]
    poles = np.concatenate([segment.noise.at(ringing.frequencies) for segment, _ in parts])
    return poles, poles * np.concatenate([gain_ratios for _, gain_ratios in parts])


_WINDOW, _BREADTH = 0.023, 4  # s, and its bins on either side that tell what is left at a mode
_FRAMES = 4  # at least


def _raise_noise(segment: Segment, ringing: Exponentials) -> tuple[Segment, Array]:
    """Return a segment with its noise as the modes meet it: raised to the residual in their bands.

    The noise is weighted for the poles, whose derivative is t exp(-d t). The second result (C, M)
    is the noise weighted for the gains, by exp(-d t), over it.
    """
    rate, order = segment.sample_rate, np.argsort(ringing.frequencies)
    size = 2 ** int(np.log2(min(_WINDOW * rate, segment.samples.shape[1] / _FRAMES)))
    if not ringing.count or size < 2 * _BREADTH:
        return segment, np.ones((len(segment.samples), ringing.count))
    window = blackman_harris(size)
    left = np.pad(segment.residual(ringing), ((0, 0), (size // 2, 0)), mode="reflect")
    powers = np.abs(frames(left, window, size // 2)) ** 2 / (window**2).sum()
    smooth_powers = uniform_filter1d(powers, 2 * _BREADTH + 1, axis=2)
    bins = np.minimum(np.round(ringing.frequencies * size / rate).astype(int), size // 2 - 1)
    times = np.arange(powers.shape[1])[:, None] * (size // 2) / rate
    noise_densities = segment.noise.at(ringing.frequencies)
    mode_envelopes = np.exp(-2 * ringing.decays * times)
    slope_weights = (
        mode_envelopes
        * (times - (mode_envelopes * times).sum(axis=0) / mode_envelopes.sum(axis=0)) ** 2
    )
    mode_powers = smooth_powers[:, :, bins]
    poles, gains = (
        _exceeding_densities(mode_powers, weights, noise_densities)
        for weights in (slope_weights, mode_envelopes)
    )
    places, first = np.unique(ringing.frequencies[order], return_index=True)
    noise = Noise(frequencies=places, densities=poles[:, order][:, first])
    return replace(segment, noise=noise), gains / poles


def _exceeding_densities(powers: Array, weights: Array, noise_densities: Array) -> Array:
    """Return weighted means (C, M) of powers (C, T, M) where they exceed the usual by chance."""
    normal_weights = weights / np.maximum(weights.sum(axis=0), _MIN_DIVISOR)
    ratios = np.einsum("ctm,tm->cm", powers, normal_weights) / noise_densities
    values = _BREADTH / np.square(normal_weights).sum(axis=0)
    return np.where(ratios > 1 + _CHANCE / np.sqrt(values), ratios, 1.0) * noise_densities


_REGULARISATION = 1e-13  # share by which the matrix's diagonal is raised
_MIN_DIVISOR = 1e-300  # least divisor
_DIFFERENCE_CHANCE = 1e-6  # probability that noise makes takes differ by more
_CHANCE = 3.0  # standard deviations by which a residual exceeds the noise


def write_statistics(
    blocks: GroupBlocks, poles: AnyComplex, gains: AnyComplex, statistics: PoleStatistics
) -> None:
    """Write the statistics of all modes; energies and sums begin as zeros."""
    loop = entry("uncertainty_write_statistics")
    if loop is not None:
        arguments, space = blocks.for_core(blocks.starts, len(poles))
        sums = statistics.energies, statistics.crossed, statistics.whole
        loop(*arguments, poles, gains, statistics.variances, statistics.sizes, *sums, space)
        return
    for group in range(len(blocks.starts) - 1):
        members = blocks.members[blocks.starts[group] : blocks.starts[group + 1]]
        fits, cost = project(
            blocks, group, subtract_others(blocks, group, poles, gains), poles[members]
        )
        noise_ratio = misfit(fits, cost)
        information, _ = normal_equations(blocks, group, fits)
        statistics.variances[members] = noise_ratio * _compute_inverse_diagonal(information)
        for block, fit in zip(blocks.blocks(group), fits, strict=True):
            spans = np.abs(span(poles[members], block.length)) ** 2
            factors = noise_ratio * inverse_spreads(fit.triangle) / spans
            statistics.sizes[block.rows, members] = factors / block.weights[:, None]
            _add_curvatures(fit, block.weights, blocks.sample_rate, members, statistics)
        statistics.energies[members] /= noise_ratio


def _compute_inverse_diagonal(matrix: AnyComplex) -> Array:
    """Return the diagonal of the inverse of a Hermitian matrix, scaled to a diagonal of ones."""
    scale = 1 / np.sqrt(np.maximum(matrix.diagonal().real, _MIN_DIVISOR))
    scaled_matrix = matrix * np.outer(scale, scale)
    inverse_matrix = solve_damped(
        scaled_matrix, _REGULARISATION, np.eye(len(matrix), dtype=complex)
    )
    return inverse_matrix.diagonal().real * scale**2


def _add_curvatures(
    fit: Projection, weights: Array, sample_rate: float, members: Index, statistics: PoleStatistics
) -> None:
    """Add the residual's energies along second derivatives, and its products with the modes.

    The derivatives are taken less their fit by lines and first derivatives.
    """
    slopes = slopes_of(fit.lines, sample_rate)
    known_basis, _ = orthonormalised(np.vstack((fit.basis, slopes)))
    shapes = without((2 * fit.lines - 1) * slopes / sample_rate, known_basis)
    norms = 1 / np.maximum((np.abs(shapes) ** 2).sum(axis=1), _MIN_DIVISOR)
    projections = shapes.conj() @ fit.left.T
    statistics.energies[members] += np.abs(projections) ** 2 @ weights * norms
    statistics.crossed[members] += (fit.residues.conj() * projections) @ weights * norms
    statistics.whole[members] += np.abs(fit.residues) ** 2 @ weights

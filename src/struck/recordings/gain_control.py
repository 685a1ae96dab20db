"""Automatic gain control of a take, estimated from its noise and undone.

Phones turn the gain down when something is struck and up again while it dies away: all modes seem
to ring longer. The noise of the surroundings is stationary, and its level shows the gain at each
moment, in those bands in which nothing rings. Neither beats nor a damping hand change it there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import uniform_filter1d

from struck.model.arrays import Array, Index, Mask
from struck.recordings.disturbances import measure_loss, stiffness
from struck.recordings.noise import blackman_harris, frames
from struck.recordings.onsets import Hit, lead_in
from struck.recordings.takes import Take

_WINDOW, _CHUNK = 0.0116, 4096  # s, and windows transformed at a time
_FIRST, _BINS = 4, 8  # bins left out at 0 Hz, and bins of a band
_MIN_WINDOWS = 8  # windows of a lead-in
_NOISE_DIVISOR = 4  # one in this many bands of a window, the softest, is taken as noise
_SILENT = 1e-12  # of the loudest: less is no noise
_ROUNDS = 12
# standard deviations over the noise at which a band contains a ringing mode
_NOISE_DEVIATIONS = 2.0
_INDEPENDENT_FRACTION = 0.35  # share of a window that is independent of the others
_BENDS = 160.0  # variance of the change of slope of the logarithm of the gain in a second, 1/s^3
_ATTACK = 0.005  # s after a hit in which the noise does not show the gain
_RINGS = 0.35  # nepers over the lead-in: not noise
_MIN_DEPTH = 0.17  # nepers (1.5 dB) by which the gain falls at least
_MIN_STANDARD_ERRORS = 6.0  # the same in standard errors
_MAX_LEAD_IN_CHANGE = 0.3  # of that, how far it may move before the hit
_SETTLING_TIME = 0.02  # s after a hit until which the gain follows it
MAX_DECAY_ERROR = 0.05  # largest standard error of a decay, in the median over the modes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GainControl:
    """Gain of a take over time, that of its lead-in being 1."""

    times: Array  # (F,), s
    logarithms: Array  # (F,), nepers
    precision: Array  # (3, F), upper bands of the inverse of their covariance
    onsets: Array  # (H,), of the hits, s

    @property
    def depth(self) -> float:
        """Return by how much the gain falls, dB."""
        return float(-20 * np.log10(np.e) * self.logarithms.min())

    def undone(self, take: Take) -> Take:
        """Return a take as it was before its gain was controlled."""
        times = np.arange(take.samples.shape[1]) / take.sample_rate
        gains = np.exp(np.interp(times, self.times, self.logarithms))
        return replace(take, samples=take.samples / gains)

    def settled(self, hits: Sequence[Hit], sample_rate: float) -> list[Hit]:
        """Return hits that ring freely only when the gain follows them no more."""
        delay = round(_SETTLING_TIME * sample_rate)
        return [replace(hit, start=min(max(hit.start, hit.onset + delay), hit.end)) for hit in hits]

    def decay_errors(self, decays: Array) -> Array:
        """Return standard errors of decays (M,), 1/s, that come from the gain's errors.

        A mode's decay is fitted to the logarithm of its amplitude with the weight of its energy.
        """
        step = self.times[1] - self.times[0]
        rates = np.clip(decays, 1 / (self.times[-1] - self.times[0]), 0.25 / step)
        ends = np.append(self.onsets[1:], self.times[-1])
        errors = np.full(len(decays), np.inf)
        for onset, end in zip(self.onsets, ends, strict=True):
            elapsed_times = (self.times - onset - _SETTLING_TIME)[:, None]
            is_inside = (elapsed_times >= 0) & (self.times < end)[:, None]
            if np.count_nonzero(is_inside) < _MIN_WINDOWS:
                continue
            energies = np.where(
                is_inside, np.exp(-2 * rates * np.where(is_inside, elapsed_times, 0.0)), 0.0
            )
            slopes = energies * (
                elapsed_times - (energies * elapsed_times).sum(axis=0) / energies.sum(axis=0)
            )
            slopes /= (slopes * elapsed_times).sum(axis=0)
            variances = (slopes * solveh_banded(self.precision, slopes)).sum(axis=0)
            errors = np.minimum(errors, np.sqrt(variances))
        return errors


def gain_control(take: Take, hits: Sequence[Hit]) -> GainControl | None:
    """Return the gain control of a take, or None where its noise shows none."""
    rate, lead_length = take.sample_rate, lead_in(take, hits).shape[1] if hits else 0
    size = 2 ** round(np.log2(_WINDOW * rate))
    step = size // 4
    if lead_length < size + _MIN_WINDOWS * step or any(
        measure_loss(channel, rate) for channel in take.samples
    ):
        return None
    powers = _band_powers(take, size, step)
    centres = np.arange(len(powers)) * step + size // 2
    is_quiet = centres < lead_length - size // 2
    if np.median(powers[is_quiet]) <= _SILENT * powers.max():
        return None
    levels, bands = _noise_levels(powers, is_quiet)
    onsets = np.array([hit.onset for hit in hits])
    scatter = float(levels[is_quiet].var()) * float(np.median(bands[is_quiet]))
    weights = _INDEPENDENT_FRACTION * bands / max(scatter, 1e-12)
    rising = centres[:, None] - onsets
    is_struck = (rising > -size / 2) & (rising < size / 2 + _ATTACK * rate)
    weights[is_struck.any(axis=1) | (levels > _RINGS)] = 0.0
    estimate = _smooth_levels(levels, weights, np.searchsorted(centres, onsets), step / rate)
    control = GainControl(
        times=centres / rate,
        logarithms=np.minimum(estimate[0] - np.average(estimate[0][is_quiet]), _RINGS),
        precision=estimate[1],
        onsets=onsets / rate,
    )
    return control if _is_sure(control, is_quiet, weights > 0) else None


def _is_sure(control: GainControl, is_quiet: Mask, is_measured: Mask) -> bool:
    """Return whether the gain has fallen by more than noise would, and not before the hit."""
    levels = np.where(is_measured & ~is_quiet, control.logarithms, 0.0)
    deepest_frame = int(levels.argmin())
    unit = np.zeros(len(levels))
    unit[deepest_frame] = 1.0
    error = np.sqrt(solveh_banded(control.precision, unit)[deepest_frame])
    depth = -levels[deepest_frame]
    lead_in_change = np.abs(control.logarithms[is_quiet]).max()
    return bool(
        depth > max(_MIN_DEPTH, _MIN_STANDARD_ERRORS * error)
        and lead_in_change < _MAX_LEAD_IN_CHANGE * depth
    )


def _band_powers(take: Take, size: int, step: int) -> Array:
    """Return powers (frames, bands) of all channels, one after the other."""
    window = blackman_harris(size)
    count = (size // 2 - 2 * _FIRST) // _BINS * _BINS
    parts = []
    for start in range(0, take.samples.shape[1] - size + 1, _CHUNK * step):
        piece = take.samples[:, start : start + (_CHUNK - 1) * step + size]
        powers = np.abs(frames(piece, window, step)[:, :, _FIRST : _FIRST + count]) ** 2
        bands = powers.reshape(*powers.shape[:2], -1, _BINS).astype(float)
        parts.append(np.concatenate(list(bands), axis=1))
    return np.concatenate(parts).reshape(-1, parts[0].shape[1] * _BINS)


def _noise_levels(powers: Array, is_quiet: Mask) -> tuple[Array, Array]:
    """Return the level of the noise in each window (F,), nepers, and how many bands show it.

    The softest bands are noise for sure; others are while they are no louder than noise can be.
    """
    mean_powers = uniform_filter1d(powers[is_quiet].mean(axis=0), 5)
    relative_powers = powers / np.maximum(mean_powers, max(_SILENT * float(powers.max()), 1e-300))
    relative_powers = relative_powers.reshape(len(powers), -1, _BINS).mean(axis=2)
    spread = float(relative_powers[is_quiet].std())
    relative_powers.sort(axis=1)
    level = relative_powers[:, : max(1, relative_powers.shape[1] // _NOISE_DIVISOR)].mean(axis=1)
    places = np.arange(len(relative_powers))
    sums = np.cumsum(relative_powers, axis=1)
    count = np.ones(len(relative_powers), int)
    for _ in range(_ROUNDS):
        count = (relative_powers < ((1 + _NOISE_DEVIATIONS * spread) * level)[:, None]).sum(axis=1)
        count = np.maximum(count, 1)
        level = sums[places, count - 1] / count
    median_level = float(np.median(level[is_quiet]))
    return 0.5 * np.log(np.clip(level / max(median_level, 1e-12), 1e-12, 1e12)), count


def _smooth_levels(
    levels: Array, weights: Array, breaks: Index, step: float
) -> tuple[Array, Array]:
    """Return the likeliest smooth course of levels (F,) that bends at breaks, and its precision.

    Its slope is a random walk (Kitagawa and Gersch 1984).
    """
    bends = np.full(len(levels) - 2, 1 / (_BENDS * step**3))
    for place in breaks:
        bends[max(0, place - 2) : place] = 0.0
    precision = stiffness(bends)
    precision[2] += weights + 1e-6
    return solveh_banded(precision, weights * levels), precision

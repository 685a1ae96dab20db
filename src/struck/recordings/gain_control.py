"""Automatic gain control of a take, found by its noise and undone.

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
from struck.recordings.disturbances import lossy, stiffness
from struck.recordings.noise import blackman_harris, frames
from struck.recordings.onsets import Hit, lead_in
from struck.recordings.takes import Take

_WINDOW, _CHUNK = 0.0116, 4096  # s, and windows transformed at a time
_FIRST, _BINS = 4, 8  # bins left out at 0 Hz, and bins of a band
_FEWEST, _LOWEST = 8, 4  # windows of a lead-in, and of its bands the share that is noise: 1 in 4
_SILENT = 1e-12  # of the loudest: less is no noise
_ROUNDS, _BEYOND = 12, 2.0  # standard deviations over the noise: something rings in the band
_ALIKE = 0.35  # share of a window that is independent of the others
_BENDS = 160.0  # variance of the change of slope of the logarithm of the gain in a second, 1/s^3
_ATTACK = 0.005  # s after a hit until which nothing is told by the noise
_RINGS = 0.35  # nepers over the lead-in: not noise
_DEEP, _SURE = 0.17, 6.0  # nepers (1.5 dB), and in standard errors, that the gain falls at least
_CALM = 0.3  # of that, how far it may move before the hit
_SETTLED = 0.02  # s after a hit until which the gain follows it
UNKNOWN = 0.05  # largest standard error of a decay, in the median over the modes


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
        wait = round(_SETTLED * sample_rate)
        return [replace(hit, start=min(max(hit.start, hit.onset + wait), hit.end)) for hit in hits]

    def decay_errors(self, decays: Array) -> Array:
        """Return standard errors of decays (M,), 1/s, that come from the gain's errors.

        A mode's decay is fitted to the logarithm of its amplitude with the weight of its energy.
        """
        step = self.times[1] - self.times[0]
        rates = np.clip(decays, 1 / (self.times[-1] - self.times[0]), 0.25 / step)
        ends = np.append(self.onsets[1:], self.times[-1])
        found = np.full(len(decays), np.inf)
        for onset, end in zip(self.onsets, ends, strict=True):
            since = (self.times - onset - _SETTLED)[:, None]
            inside = (since >= 0) & (self.times < end)[:, None]
            if np.count_nonzero(inside) < _FEWEST:
                continue
            energies = np.where(inside, np.exp(-2 * rates * np.where(inside, since, 0.0)), 0.0)
            slopes = energies * (since - (energies * since).sum(axis=0) / energies.sum(axis=0))
            slopes /= (slopes * since).sum(axis=0)
            variances = (slopes * solveh_banded(self.precision, slopes)).sum(axis=0)
            found = np.minimum(found, np.sqrt(variances))
        return found


def gain_control(take: Take, hits: Sequence[Hit]) -> GainControl | None:
    """Return the gain control of a take, or None where its noise shows none."""
    rate, before = take.sample_rate, lead_in(take, hits).shape[1] if hits else 0
    size = 2 ** round(np.log2(_WINDOW * rate))
    step = size // 4
    if before < size + _FEWEST * step or any(lossy(each, rate) for each in take.samples):
        return None
    powers = _band_powers(take, size, step)
    middles = np.arange(len(powers)) * step + size // 2
    quiet = middles < before - size // 2
    if np.median(powers[quiet]) <= _SILENT * powers.max():
        return None
    levels, bands = _noise_levels(powers, quiet)
    onsets = np.array([hit.onset for hit in hits])
    scatter = float(levels[quiet].var()) * float(np.median(bands[quiet]))
    weights = _ALIKE * bands / max(scatter, 1e-12)
    rising = middles[:, None] - onsets
    struck = (rising > -size / 2) & (rising < size / 2 + _ATTACK * rate)
    weights[struck.any(axis=1) | (levels > _RINGS)] = 0.0
    found = _smooth(levels, weights, np.searchsorted(middles, onsets), step / rate)
    control = GainControl(
        times=middles / rate,
        logarithms=np.minimum(found[0] - np.average(found[0][quiet]), _RINGS),
        precision=found[1],
        onsets=onsets / rate,
    )
    return control if _is_sure(control, quiet, weights > 0) else None


def _is_sure(control: GainControl, quiet: Mask, heard: Mask) -> bool:
    """Return whether the gain has fallen by more than noise would, and not before the hit."""
    shown = np.where(heard & ~quiet, control.logarithms, 0.0)
    deepest = int(shown.argmin())
    there = np.zeros(len(shown))
    there[deepest] = 1.0
    error = np.sqrt(solveh_banded(control.precision, there)[deepest])
    fallen = -shown[deepest]
    moved = np.abs(control.logarithms[quiet]).max()
    return bool(fallen > max(_DEEP, _SURE * error) and moved < _CALM * fallen)


def _band_powers(take: Take, size: int, step: int) -> Array:
    """Return powers (frames, bands) of all channels, one after the other."""
    window = blackman_harris(size)
    count = (size // 2 - 2 * _FIRST) // _BINS * _BINS
    parts = []
    for start in range(0, take.samples.shape[1] - size + 1, _CHUNK * step):
        piece = take.samples[:, start : start + (_CHUNK - 1) * step + size]
        heard = np.abs(frames(piece, window, step)[:, :, _FIRST : _FIRST + count]) ** 2
        bands = heard.reshape(*heard.shape[:2], -1, _BINS).astype(float)
        parts.append(np.concatenate(list(bands), axis=1))
    return np.concatenate(parts).reshape(-1, parts[0].shape[1] * _BINS)


def _noise_levels(powers: Array, quiet: Mask) -> tuple[Array, Array]:
    """Return the level of the noise in each window (F,), nepers, and how many bands show it.

    The softest bands are noise for sure; others are while they are no louder than noise can be.
    """
    usual = uniform_filter1d(powers[quiet].mean(axis=0), 5)
    relative = powers / np.maximum(usual, max(_SILENT * float(powers.max()), 1e-300))
    relative = relative.reshape(len(powers), -1, _BINS).mean(axis=2)
    spread = float(relative[quiet].std())
    relative.sort(axis=1)
    level = relative[:, : max(1, relative.shape[1] // _LOWEST)].mean(axis=1)
    places = np.arange(len(relative))
    sums = np.cumsum(relative, axis=1)
    count = np.ones(len(relative), int)
    for _ in range(_ROUNDS):
        count = (relative < ((1 + _BEYOND * spread) * level)[:, None]).sum(axis=1)
        count = np.maximum(count, 1)
        level = sums[places, count - 1] / count
    usually = float(np.median(level[quiet]))
    return 0.5 * np.log(np.clip(level / max(usually, 1e-12), 1e-12, 1e12)), count


def _smooth(levels: Array, weights: Array, breaks: Index, step: float) -> tuple[Array, Array]:
    """Return the likeliest smooth course of levels (F,) that bends at breaks, and its precision.

    Its slope is a random walk (Kitagawa and Gersch 1984).
    """
    bends = np.full(len(levels) - 2, 1 / (_BENDS * step**3))
    for place in breaks:
        bends[max(0, place - 2) : place] = 0.0
    precision = stiffness(bends)
    precision[2] += weights + 1e-6
    return solveh_banded(precision, weights * levels), precision

"""Hits in a take: when something was struck, and from where on it rings freely.

A hit is a rise of many frequency bands at once, also where the tail of the last hit is louder as a
whole: bands in which that tail is over show it. The moment itself is the steepest rise nearby.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz
from scipy.ndimage import maximum_filter1d, median_filter, uniform_filter1d

from struck.perception.auditory_scale import erb_number
from struck.recordings.takes.frames import blackman_harris, frames
from struck.recordings.takes.take import Take

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_WINDOW, _STEP, _CHUNK = 0.023, 0.0029, 4096
"""Windows, their distance, s, and how many are transformed at a time."""
_RISE, _LAG = 2.5, 4
"""dB, mean over bands, from so many windows before."""
_USUAL = 0.5
"""A rise is compared with the usual ones within this time, s."""
_DEPTH = 60.0
"""dB under the loudest moment that count."""
_APART, _REACH, _BLOCK = 0.06, 0.015, 0.001
_STEEP = 2.0
_ORDER, _PAST = 32, 50
"""Of linear prediction, and how many milliseconds it learns from."""
_CLOSE = 0.01
"""Within this time after a hit the sound is at its loudest, s."""
_ARRIVED = 3e-4
"""Of a hit's energy: so much may have sounded before it is taken to have arrived."""
_EDGE, _FAINT = 0.01, 10 ** (-26 / 10)
"""A beginning that sounds already is no hit when it is so much quieter than the loudest."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Hit:
    """One strike.

    Parameters
    ----------
    onset : int
        Sample at which the sound begins to rise.
    arrival : int
        Sample from which on nearly all of the sound is heard, the blow included.
    start : int
        Sample from which it is taken as free ringing: the rise is over.
    end : int
        Sample at which the next hit begins, or the take ends.
    """

    onset: int
    arrival: int
    start: int
    end: int


def find_hits(take: Take) -> list[Hit]:
    """Return the hits of a take in order of time; none where it only swells."""
    onsets = list(_steepest(take, _rises(take)))
    ends = [*onsets, take.samples.shape[1]][1:]
    hits = [hit_at(take, onset, end) for onset, end in zip(onsets, ends, strict=True)]
    loudness = [_energy(take, hit.start, _USUAL / 10) for hit in hits]
    cut_off = hits and hits[0].onset < _EDGE * take.sample_rate
    return hits[1:] if cut_off and loudness[0] < _FAINT * max(loudness) else hits


def hit_at(take: Take, onset: int, end: int) -> Hit:
    """Return the hit that begins at a known sample, and is over at `end`, maybe at once."""
    size = max(1, round(_BLOCK * take.sample_rate))
    energy = (take.samples**2).sum(axis=0)
    start = _risen(energy, onset, end, size)
    arrival = min(_arrived(energy, onset, end, size), start)
    return Hit(onset=onset, arrival=arrival, start=start, end=end)


def _arrived(energy: Array, onset: int, end: int, size: int) -> int:
    """Return the sample by which so little of the hit has sounded that it may be left out."""
    tail = float(energy[max(0, onset - 4 * size) : onset].mean()) if onset else 0.0
    heard = np.cumsum(energy[onset:end] - tail)
    # Within a millisecond the tail of the last hit may fluctuate by as much as it holds.
    least = max(_ARRIVED * float(heard.max(initial=0.0)), size * tail)
    return onset + int(np.argmax(heard > least)) if len(heard) else onset


def _risen(energy: Array, onset: int, end: int, size: int) -> int:
    """Return the sample by which the sound has risen to half of its loudest."""
    last = min(end, onset + round(_CLOSE / _BLOCK) * size)
    if last <= onset:
        return onset
    following = uniform_filter1d(energy[onset:last], size, origin=-(size // 2), mode="constant")
    risen = int(np.argmax(following >= 0.5 * following.max(initial=0.0)))
    return min(onset + risen + size // 2, end)


def _energy(take: Take, start: int, seconds: float) -> float:
    return float((take.samples[:, start : start + round(seconds * take.sample_rate)] ** 2).sum())


def _rises(take: Take) -> Index:
    """Return samples around which the bands of hearing rise together."""
    size = 2 ** round(np.log2(_WINDOW * take.sample_rate))
    step = max(1, round(_STEP * take.sample_rate))
    powers = sum(_band_powers(np.pad(channel, size), size, step, take) for channel in take.samples)
    # Four times the quietest moments: so noise that sets in with the take is no rise.
    quiet = 4 * np.quantile(powers, 0.1, axis=0)
    levels = 10 * np.log10(powers + np.maximum(quiet, 10 ** (-_DEPTH / 10) * np.max(powers)))
    before = maximum_filter1d(levels, 3, axis=0)[:-_LAG]
    flux = np.maximum(levels[_LAG:] - before, 0).mean(axis=1)
    peaks = flux == maximum_filter1d(flux, 2 * round(_APART / _STEP) + 1)
    usual = median_filter(flux, round(_USUAL / _STEP) // 2 * 2 + 1)
    return (np.flatnonzero(peaks & (flux > usual + _RISE)) + _LAG) * step - size // 2


def _band_powers(channel: Array, size: int, step: int, take: Take) -> Array:
    """Return powers (frames, bands) of one channel, its loudest frame being 1."""
    bands = erb_number(np.arange(size // 2) * (take.sample_rate / size)).astype(int)
    firsts = np.flatnonzero(np.diff(bands, prepend=-1))
    window = blackman_harris(size)
    parts = []
    for start in range(0, len(channel) - size + 1, _CHUNK * step):
        piece = channel[None, start : start + (_CHUNK - 1) * step + size]
        parts.append(np.add.reduceat(np.abs(frames(piece, window, step)[0]) ** 2, firsts, axis=1))
    powers = np.concatenate(parts)
    return powers / powers.sum(axis=1).max()


def _steepest(take: Take, around: Index) -> Iterator[int]:
    """Move each to the steepest rise nearby, and drop those without one."""
    size = max(1, round(_BLOCK * take.sample_rate))
    reach = round(_REACH * take.sample_rate)
    apart = round(_APART / 2 * take.sample_rate)
    last = -apart - 1
    for middle in around:
        first = max(0, middle - reach)
        rise = _rise(take.samples, first, middle + reach, size)
        best = int(first + np.argmax(rise)) if rise.size else last
        if best - last > apart and rise.max() > _STEEP:
            last = best
            yield best


def _rise(samples: Array, first: int, last: int, size: int) -> Array:
    """Return the energy of the next millisecond over that of the last four.

    Of what the past does not predict: a ringing tail is predicted, a hit is not.
    """
    margin = 4 * size
    start, stop = max(0, first - margin), min(samples.shape[1], last + margin)
    energy = np.zeros(stop - start)
    for channel in samples:
        past = channel[max(0, start - _PAST * size) : start]
        surprise = _unpredicted(past, channel[start:stop])
        energy += surprise / max(float(surprise.mean()), 1e-300)
    after = uniform_filter1d(energy, size, origin=-(size // 2), mode="constant")
    before = uniform_filter1d(energy, margin, origin=margin // 2 - 1, mode="constant")
    rise = after / (before + 1e-6 * after.max(initial=0.0) + 1e-300)
    return rise[first - start : last - start]


def _unpredicted(past: Array, now: Array) -> Array:
    """Return the squared error of linear prediction, by coefficients of the past."""
    if len(past) < 4 * _ORDER or not np.ptp(past):
        return np.square(np.diff(now, prepend=0.0))
    lags = np.correlate(past, past[: len(past) - _ORDER], "valid")
    lags = lags[: _ORDER + 1] * np.r_[1 + 1e-6, np.ones(_ORDER)]
    weights = solve_toeplitz(lags[:-1], lags[1:])
    whole = np.concatenate((past[-_ORDER:], now))
    return np.square(np.convolve(whole, np.r_[1.0, -weights], "valid"))

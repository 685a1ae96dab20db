"""From measured responses to aligned ones: onsets, delays, level and directions between."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from struck.ears.hrtf import HrtfSet
from struck.ears.sphere import arrival_delay, pressure

Array = NDArray[np.float64]

LEAD = 8 / 48000  # s, kept ahead of an onset: what a limited band rings before it
LASTING = 448 / 48000  # s, of a response with its lead: all that KEMAR has
BRIEF = 256 / 48000  # s, of one for playing live: deep notches at 8 kHz take all
ONSET = 0.1  # of a response's peak: what comes first above it is the onset
EARS = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
_FINER = 8  # onsets are sought between samples
_AT_ONCE = 2**21  # values, to bound the memory that long responses take
_FADE_IN, _FADE_OUT = 0.5, 0.0625  # of the lead, of the whole
_PASS = 0.9  # of the band that both sample rates hold: above, responses fade out
_LEVEL_BAND = np.linspace(200, 500, 7)  # Hz, where heads are spheres and loudspeakers work
_DEGREES, _SMOOTHNESS = 80, 2.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Aligned:
    """Responses of one set at one sample rate, all with their onset at the same sample.

    Parameters
    ----------
    directions : array (M, 3)
        None twice.
    delays : array (M, 2)
        From the head's centre, were there no head, to a response's first sample, s.
    responses : array (M, 2, taps)
        Relative to the free field at the head's centre.
    gain : float
        By which the set's own level was multiplied for that.
    """

    directions: Array
    delays: Array
    responses: Array
    gain: float


def aligned(
    measured: HrtfSet, sample_rate: float, nodes: Array, lasting: float = LASTING
) -> Aligned:
    """Align the responses of a set, bring them to a sample rate and to the free field's level.

    Where a set has more directions than there are nodes (W, 3), those nearest to nodes are kept.

    The time that both ears share is arbitrary in most sets, and in some from one elevation to the
    next (by 0.2 ms in KEMAR's): it is set such that sound comes to the nearer ear as on a rigid
    sphere. The time between the ears stays as it was measured. The level that all responses share
    is set such that the mean power from 200 to 500 Hz is that on the sphere.
    """
    chosen = _chosen(measured.directions, nodes)
    directions, responses = measured.directions[chosen], measured.responses[chosen]
    parts = np.array_split(responses, math.ceil(responses.size / _AT_ONCE))
    onsets = np.concatenate([_onsets(part) for part in parts]) / measured.sample_rate
    gain = _gain(directions, responses, measured)
    late = onsets + measured.delays[chosen]
    excess = late - arrival_delay(_angles(directions), measured.distance)
    nearer = (1 + directions @ EARS.T) / 2  # both add up to one, so no ear takes over at once
    shared = np.sum(excess * nearer, axis=1, keepdims=True)
    starts = np.array_split(onsets - LEAD, len(parts))
    how = measured.sample_rate, sample_rate, lasting
    sampled = [_sampled(part, start, *how) for part, start in zip(parts, starts, strict=True)]
    return Aligned(
        directions=directions,
        delays=late - shared - LEAD,
        responses=gain * np.concatenate(sampled),
        gain=gain,
    )


def _angles(directions: Array) -> Array:
    """Return the angles (M, 2) between sources and the ears, rad."""
    return np.arccos(np.clip(directions @ EARS.T, -1, 1))


def _chosen(directions: Array, nodes: Array) -> NDArray[np.intp]:
    """Return which directions to keep: none twice, as poles often are, and not too many."""
    rounded = np.round(directions, 3) + 0.0  # no negative zeros
    distinct = np.sort(np.unique(rounded, axis=0, return_index=True)[1])
    if len(distinct) <= len(nodes):
        return distinct
    return distinct[np.unique(KDTree(directions[distinct]).query(nodes)[1])]


def _onsets(responses: Array) -> Array:
    """Return where responses (M, 2, N) first exceed a share of their peak, in samples.

    Of the estimators that were tried, cross-correlation with the minimum-phase response jumps by
    samples between neighbours, where a zero leaves the unit circle, and this one does not.
    """
    taps = responses.shape[-1]
    ahead = 16  # a limited band rings before its onset, also before the first sample
    length = (taps + 2 * ahead) * _FINER
    spectra = np.fft.rfft(np.pad(responses, ((0, 0), (0, 0), (ahead, ahead))), axis=-1)
    finer = np.abs(np.fft.irfft(spectra, length, axis=-1))
    level = ONSET * finer.max(axis=-1, keepdims=True)
    finer[..., 0] = 0
    first = np.maximum(np.argmax(finer > level, axis=-1), 1)[..., np.newaxis]
    before = np.take_along_axis(finer, first - 1, axis=-1)
    after = np.take_along_axis(finer, first, axis=-1)
    return ((first - (after - level) / (after - before)) / _FINER - ahead)[..., 0]


def _gain(directions: Array, responses: Array, measured: HrtfSet) -> float:
    """Return by what responses have to be multiplied to be relative to the free field."""
    phases = np.outer(np.arange(responses.shape[-1]), _LEVEL_BAND / measured.sample_rate)
    here = np.mean(np.abs(responses @ np.exp(-2j * np.pi * phases)) ** 2)
    angles, counts = np.unique(np.round(_angles(directions), 3), return_counts=True)
    there = np.mean(np.abs(pressure(_LEVEL_BAND, angles, measured.distance)) ** 2, axis=0)
    return math.sqrt(np.average(there, weights=counts) / here)


def _sampled(
    responses: Array, starts: Array, old_rate: float, new_rate: float, lasting: float
) -> Array:
    """Return the responses (M, 2, taps) from their starts (s) on, at a new sample rate.

    Each is a sum of cosines between its samples; taking them at other times shifts by parts of a
    sample and changes the rate in one step.
    """
    length = 2 * responses.shape[-1] + 2 * math.ceil(lasting * old_rate)
    frequencies = np.arange(length // 2 + 1) * (old_rate / length)
    spectra = np.fft.rfft(responses, length, axis=-1) * _fading(frequencies, old_rate, new_rate)
    spectra *= np.exp(2j * np.pi * frequencies * starts[..., np.newaxis])
    times = np.arange(round(lasting * new_rate)) / new_rate
    phases = 2 * np.pi * np.outer(frequencies, times)
    cosines, sines = np.cos(phases), np.sin(phases)
    # The sum over the spectrum is 1 / length; a response is a density over time, 1 / rate each.
    spectra[..., 1:] *= 2
    sums = spectra.real @ cosines - spectra.imag @ sines
    return sums * (old_rate / new_rate / length) * _window(round(lasting * new_rate), new_rate)


def _fading(frequencies: Array, old_rate: float, new_rate: float) -> Array:
    """Return one in the band that both rates hold, and half a cosine down to zero at its end."""
    highest = min(old_rate, new_rate) / 2
    along = np.clip((frequencies / highest - _PASS) / (1 - _PASS), 0, 1)
    return 0.5 + 0.5 * np.cos(np.pi * along)


def _window(taps: int, sample_rate: float) -> Array:
    """Return ones with eased ends, for responses cut at a lead and a length."""
    start = np.arange(taps) / (_FADE_IN * LEAD * sample_rate)
    end = np.arange(taps)[::-1] / (_FADE_OUT * taps)
    return np.sin(0.5 * np.pi * np.clip(np.minimum(start, end) + 0.05, 0, 1)) ** 2


def spline_weights(measured: Array, wanted: Array) -> Array:
    """Return the weights (W, M) by which values in measured directions make others.

    A spline on the sphere: exact where measured, and of the least mean square of a derivative of
    order 2.5 (of Laplace and Beltrami) between, so that it stays bounded where none is near.

    References
    ----------
    Wahba 1981, SIAM J. Sci. Stat. Comput. 2(1), 5, with a series for its kernel.
    """
    count = len(measured)
    system = np.ones((count + 1, count + 1))
    system[:count, :count] = _kernel(measured @ measured.T)
    system[count, count] = 0
    right = np.ones((len(wanted), count + 1))
    right[:, :count] = _kernel(wanted @ measured.T)
    return np.asarray(np.linalg.solve(system, right.T).T[:, :count], dtype=np.float64)


def _kernel(cosines: Array) -> Array:
    degrees = np.arange(1.0, _DEGREES + 1)
    series = np.zeros(_DEGREES + 1)
    series[1:] = (2 * degrees + 1) / (degrees * (degrees + 1)) ** _SMOOTHNESS
    values = np.polynomial.legendre.legval(np.clip(cosines, -1, 1), series)
    return np.asarray(values, dtype=np.float64)

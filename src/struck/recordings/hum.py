"""Hum: steady tones of the surroundings, taken out of a take before hits are looked for.

What a lead-in holds as a spectral line, and the end of the take as loud, was there all the time:
mains hum and its harmonics, a fan, a screen. Each is followed through the take, slowly varying in
size and phase; where the object sounds, that is interpolated from where it does not.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import maximum_filter1d, median_filter

from struck.model.arrays import AnyComplex, Array, Mask
from struck.model.exponentials import Exponentials
from struck.recordings.takes import Take

_LEAST, _MOST = 0.25, 10.0  # of the lead-in that is looked at, s
_BLOCK = 0.1  # s: five periods of 50 Hz and six of 60 Hz
_BEGUN = 0.1  # of the loudest block's power: something was struck
_CLEAR = 300.0  # power of a line over that of its surroundings
_NEIGHBOURS = 40.0  # Hz
_CHANGED, _WAVERS = 4.0, 2.0  # largest ratio of its usual power to that at the end, and before
_LOWEST = 20.0  # Hz
_HIGHEST = 0.45  # of the sample rate
_ASIDE = 30.0  # Hz from a tone: what is heard there is something else
_EXACT = 1e-3  # of a tone's power: what is less does not disturb it
_STIFF = 10.0  # how little a tone changes from block to block
_LOUD = 1e-3  # least power of a tone over the lead-in's whole


def without_hum(take: Take) -> tuple[Take, Array]:
    """Return a take without the steady tones of its surroundings, and these (K, 2).

    Each by its frequency, Hz, and amplitude. None where no lead-in shows them.
    """
    size = round(_BLOCK * take.sample_rate)
    count = take.samples.shape[1] // size
    blocks = take.samples[:, : count * size].reshape(take.channels, count, size)
    powers = (blocks**2).mean(axis=(0, 2))
    before = int(np.argmax(powers > _BEGUN * powers.max()))
    found: list[tuple[float, float]] = []
    if before * _BLOCK < _LEAST:
        return take, np.zeros((0, 2))
    samples = take.samples.copy()
    for tone in _lines(take, before * size):
        samples, loudness, exact = _cleared(samples, tone, take.sample_rate, before)
        if loudness:
            found.append((exact, loudness))
    if not found:
        return take, np.zeros((0, 2))
    return replace(take, samples=samples), np.array(found)


def _lines(take: Take, before: int) -> Iterator[float]:
    """Yield frequencies, Hz, of the lines in the lead-in."""
    lead = take.samples[:, max(0, before - round(_MOST * take.sample_rate)) : before]
    length = lead.shape[1]
    size = 4 * length
    spectrum = np.fft.rfft(lead * np.hanning(length), size, axis=1)
    powers = (np.abs(spectrum) ** 2).mean(axis=0)
    spacing = take.sample_rate / size
    broad = median_filter(powers, 2 * round(_NEIGHBOURS / spacing) + 1, mode="nearest")
    whole = float((lead**2).mean()) * (np.hanning(length).sum() ** 2) / 2
    peaks = powers == maximum_filter1d(powers, 2 * round(8 / _BLOCK / 4 / spacing) + 1)
    for place in np.flatnonzero(peaks & (powers > _CLEAR * broad) & (powers > _LOUD * whole)):
        if _LOWEST < place * spacing < _HIGHEST * take.sample_rate:
            left, middle, right = np.log(powers[place - 1 : place + 2])
            shift = 0.5 * (left - right) / (left - 2 * middle + right)
            yield float((place + shift) * spacing)


def _cleared(samples: Array, tone: float, rate: int, before: int) -> tuple[Array, float, float]:
    """Return samples (C, n) without a tone, its amplitude, 0 if it is not steady, and its Hz.

    The first `before` blocks hold ambient sound alone. Others count by how little is heard beside
    the tone.
    """
    size = round(_BLOCK * rate)
    count = samples.shape[1] // size
    window = np.hanning(size) * 2 / np.hanning(size).sum()
    aside = np.exp(2j * np.pi * _ASIDE * np.arange(size) / rate)
    times = np.arange(samples.shape[1]) / rate
    turned = samples * np.exp(-2j * np.pi * tone * times)
    blocks = turned[:, : count * size].reshape(len(samples), count, size)
    sizes = blocks @ window
    steps = (sizes[:, 1:before] * sizes[:, : before - 1].conj()).sum()
    heard = (np.abs(sizes) ** 2).mean(axis=0)
    usual = float(np.median(heard[:before]))
    if usual > min(_CHANGED * heard[-2:].mean(), _WAVERS * heard[:before].min()):
        return samples, 0.0, tone
    others = sum((np.abs(blocks @ (window * way)) ** 2).mean(axis=0) for way in (aside, 1 / aside))
    weights = 1 / (others + np.maximum(heard - _CHANGED * usual, 0) + _EXACT * usual) ** 2
    drift = float(np.angle(steps)) / (2 * np.pi * size)
    middles = (np.arange(count) + 0.5) * size
    calm = _smooth(sizes * np.exp(-2j * np.pi * drift * middles), weights)
    places = np.arange(samples.shape[1])
    envelope = np.array([np.interp(places, middles, each) for each in calm])
    turn = np.exp(2j * np.pi * (tone * times + drift * places))
    return samples - (envelope * turn).real, usual**0.5, tone + drift * rate


def _smooth(sizes: AnyComplex, weights: Array) -> AnyComplex:
    """Return weighted sizes (C, B) with as small second differences as they allow."""
    count = sizes.shape[1]
    weights = weights / weights.max()
    bands = np.zeros((3, count))
    for row in range(count - 2):
        for one, first in enumerate((1.0, -2.0, 1.0)):
            for other, second in enumerate((1.0, -2.0, 1.0)):
                if other >= one:
                    bands[2 - (other - one), row + other] += _STIFF * first * second
    bands[2] += weights + 1e-9
    return solveh_banded(bands, (weights * sizes).T).T


_LEFT_FROM, _LEFT, _LASTS = 1.0, 0.3, 2.0  # Hz from a tone, of its amplitude, and slower, 1/s


def of_hum(tones: Array, ringing: Exponentials) -> Mask:
    """Return which modes (M,) are what is left of tones (K, 2) that were taken out."""
    near = np.abs(ringing.frequencies[:, None] - tones[:, 0]) < _LEFT_FROM
    sizes = np.abs(ringing.gains).max(axis=0, initial=0.0)
    faint = sizes[:, None] < _LEFT * tones[:, 1]
    return (near & faint).any(axis=1) & (ringing.decays < _LASTS)

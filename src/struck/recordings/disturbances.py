"""Disturbances of a take: steady tones, lossy coding and a constant offset.

What a lead-in holds as a spectral line, and the end of the take as loud, was there all the time:
mains hum and its harmonics, a fan, a screen. Each is followed through the take, slowly varying in
size and phase; where the object sounds, that is interpolated from where it does not.

A perceptual coder such as MP3 or AAC rounds each band of each short frame to as few bits as the
loud bands beside it allow, many of them to nothing. What it leaves are holes: a band falls silent
for a frame or two and comes back, while others go on. No sound in air does that: a mode falls and
stays down, a beat comes and goes in narrow bands and slowly, noise summed over some bins varies by
few decibels. A low-pass at 16 kHz alone, as old converters and codecs both have it, shows nothing.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import PurePath

import numpy as np
from scipy.linalg import solveh_banded
from scipy.ndimage import maximum_filter1d, median_filter

from struck.errors import rounded
from struck.model.arrays import AnyComplex, Array, Mask
from struck.model.exponentials import Exponentials
from struck.recordings.takes import Take, left_out

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


def stiffness(bends: Array) -> Array:
    """Return bands (3, B) of the matrix that weighs second differences by bends (B - 2,)."""
    bands = np.zeros((3, len(bends) + 2))
    for one, first in enumerate((1.0, -2.0, 1.0)):
        for other, second in enumerate((1.0, -2.0, 1.0)[one:], one):
            bands[2 - (other - one), other : len(bends) + other] += bends * first * second
    return bands


def _smooth(sizes: AnyComplex, weights: Array) -> AnyComplex:
    """Return weighted sizes (C, B) with as small second differences as they allow."""
    weights = weights / weights.max()
    bands = stiffness(np.full(sizes.shape[1] - 2, _STIFF))
    bands[2] += weights + 1e-9
    return solveh_banded(bands, (weights * sizes).T).T


_LEFT_FROM, _LEFT, _LASTS = 1.0, 0.3, 2.0  # Hz from a tone, of its amplitude, and slower, 1/s


def of_hum(tones: Array, ringing: Exponentials) -> Mask:
    """Return which modes (M,) are remainders of tones (K, 2) of hum that were subtracted."""
    near = np.abs(ringing.frequencies[:, None] - tones[:, 0]) < _LEFT_FROM
    sizes = np.abs(ringing.gains).max(axis=0, initial=0.0)
    faint = sizes[:, None] < _LEFT * tones[:, 1]
    return (near & faint).any(axis=1) & (ringing.decays < _LASTS)


# Lossy coding and offsets.

_FRAME = 0.026  # of sound that a coder treats alike, about, s
_BINS = 8  # in a band
_DEEP = 15.0  # by which a hole lies below what comes before and after it, dB
_NEAR = 4  # half frames within which that is
_RANGE = 110.0  # below the loudest band, dB: softer ones are rounding
_RISE, _RENEWED = 6.0, 0.3  # dB, and share of bands that rise so: a new sound, not one come back
_MOST_HELD = 40.0  # s that are looked at: the loudest
# Of coded takes at 128 kbit/s 0.17 to 0.6 % of all places are holes, in 9 frames and 10 bands or
# more; a beat makes its holes in one band, other takes none.
_SHARE, _FRAMES, _BANDS, _ENOUGH = 1.2e-3, 6, 6, 40
_CERTAIN = 0.01  # of all places: fewer are as often of a scrape, or of a listener who walks
_HOLES, _MOVES = "bands fall silent and come back", ", as they also do where something moves"
_LOSSY = {".ogg", ".oga", ".opus"}
_OFFSET = 2e-3  # smallest mean over peak that is reported


def processed(take: Take) -> Iterator[str]:
    """Yield a sentence about each processing found in a take: lossy coding, offset."""
    heard = take.samples[~left_out(take)]
    if not heard.size:
        return
    loudest = heard[int(np.square(heard).sum(axis=1).argmax())]
    why = "as its ending says" if PurePath(take.name).suffix.lower() in _LOSSY else _HOLES
    share = 1.0 if why != _HOLES else lossy(loudest, take.sample_rate)
    if share:
        sure, moved = ("was", "") if share > _CERTAIN else ("may have been", _MOVES)
        yield (
            f"{take.name} {sure} coded with loss (MP3, AAC, OGG): {why}{moved}; weak modes may be "
            "false or missing, so record without compression"
        )
    offset = float(np.abs(heard.mean(axis=1)).max() / max(np.abs(heard).max(), 1e-300))
    if offset > _OFFSET:
        yield (
            f"{take.name} has a constant offset of {rounded(100 * offset, 2)} % of its peak: no "
            "mode is fitted to it; look at the converter or the cable"
        )


def lossy(samples: Array, sample_rate: float) -> float:
    """Return the share of holes of a lossy coder in samples (n,), half a second or more, or 0."""
    levels = _bands(_loudest_part(samples, sample_rate), sample_rate)
    if len(levels) < _ENOUGH:  # half a second
        return 0.0
    holes, possible = _holes(levels)
    share = np.count_nonzero(holes) / max(np.count_nonzero(possible), 1)
    frames, bands = (np.count_nonzero(holes.any(axis=axis)) for axis in (1, 0))
    return share if share > _SHARE and frames >= _FRAMES and bands >= _BANDS else 0.0


def _loudest_part(samples: Array, sample_rate: float) -> Array:
    """Return the part about the peak, of a long take."""
    half = round(_MOST_HELD / 2 * sample_rate)
    first = max(0, int(np.abs(samples).argmax()) - half)
    return samples[first : first + 2 * half]


def _bands(samples: Array, sample_rate: float) -> Array:
    """Return levels of bands in overlapping frames (frames, bands), dB."""
    size = 2 ** round(np.log2(_FRAME * sample_rate))
    if len(samples) < size:
        return np.zeros((0, 0))
    frames = np.lib.stride_tricks.sliding_window_view(samples, size)[:: size // 2]
    powers = np.abs(np.fft.rfft(frames * np.hanning(size), axis=1)) ** 2
    whole = powers[:, : powers.shape[1] // _BINS * _BINS].reshape(len(powers), -1, _BINS)
    return 10 * np.log10(whole.sum(axis=2) + 1e-30)


def _holes(levels: Array) -> tuple[Mask, Mask]:
    """Return which bands of which frames are holes, and which might be."""
    before, after = (
        np.max([np.roll(levels, sign * by, axis=0) for by in range(1, _NEAR + 1)], axis=0)
        for sign in (1, -1)
    )
    beside, least = np.minimum(before, after), levels.max() - _RANGE
    heard = np.maximum(before, after) > least
    new = (heard & (after > levels + _RISE)).sum(axis=1) >= _RENEWED * heard.sum(axis=1)
    possible = (beside > least) & ~new[:, None]
    possible[:_NEAR] = possible[-_NEAR:] = False
    return possible & (levels < beside - _DEEP), possible

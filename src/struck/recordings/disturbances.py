"""Disturbances of a take: steady tones, lossy coding and a constant offset.

What a lead-in holds as a spectral line, and the end of the take as loud, was there all the time:
mains hum and its harmonics, a fan, a screen. Each is followed through the take, slowly varying in
size and phase; where the object sounds, that is interpolated from where it does not.

A perceptual coder such as MP3 or AAC rounds each band of each short frame to as few bits as the
neighbouring loud bands allow, many of them to zero. The result has holes: a band falls silent for a
frame or two and comes back, while others continue. No sound in air does that: a mode falls and
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

_MIN_LEAD_IN, _MAX_LEAD_IN = 0.25, 10.0  # length of the lead-in that is analyzed, s
_BLOCK = 0.1  # s: five periods of 50 Hz and six of 60 Hz
_ONSET_FRACTION = 0.1  # of the loudest block's power: something was struck
_CLEAR = 300.0  # power of a line over that of its surroundings
_NEIGHBOURS = 40.0  # Hz
_MAX_CHANGE = 4.0  # largest ratio of a tone's median power in the lead-in to that at the end
_MAX_FLUCTUATION = 2.0  # the same ratio to its least power in the lead-in
_MIN_FREQUENCY = 20.0  # Hz
_MAX_RATE_FRACTION = 0.45  # of the sample rate
_SIDE_DISTANCE = 30.0  # Hz from a tone: power there is of other sounds
_POWER_TOLERANCE = 1e-3  # of a tone's power: less power does not disturb it
_STIFFNESS = 10.0  # penalty of second differences from block to block
_MIN_POWER_RATIO = 1e-3  # least power of a tone over the lead-in's whole


def without_hum(take: Take) -> tuple[Take, Array]:
    """Return a take without the steady tones of its surroundings, and these (K, 2).

    Each by its frequency, Hz, and amplitude. None where no lead-in shows them.
    """
    size = round(_BLOCK * take.sample_rate)
    count = take.samples.shape[1] // size
    blocks = take.samples[:, : count * size].reshape(take.channels, count, size)
    powers = (blocks**2).mean(axis=(0, 2))
    lead_blocks = int(np.argmax(powers > _ONSET_FRACTION * powers.max()))
    tones: list[tuple[float, float]] = []
    if lead_blocks * _BLOCK < _MIN_LEAD_IN:
        return take, np.zeros((0, 2))
    samples = take.samples.copy()
    for tone in _lines(take, lead_blocks * size):
        samples, loudness, tone_frequency = _subtract_tone(
            samples, tone, take.sample_rate, lead_blocks
        )
        if loudness:
            tones.append((tone_frequency, loudness))
    if not tones:
        return take, np.zeros((0, 2))
    return replace(take, samples=samples), np.array(tones)


def _lines(take: Take, lead_length: int) -> Iterator[float]:
    """Yield frequencies, Hz, of the lines in the lead-in."""
    lead_in = take.samples[
        :, max(0, lead_length - round(_MAX_LEAD_IN * take.sample_rate)) : lead_length
    ]
    length = lead_in.shape[1]
    size = 4 * length
    spectrum = np.fft.rfft(lead_in * np.hanning(length), size, axis=1)
    powers = (np.abs(spectrum) ** 2).mean(axis=0)
    spacing = take.sample_rate / size
    broad = median_filter(powers, 2 * round(_NEIGHBOURS / spacing) + 1, mode="nearest")
    line_power = float((lead_in**2).mean()) * (np.hanning(length).sum() ** 2) / 2
    peaks = powers == maximum_filter1d(powers, 2 * round(8 / _BLOCK / 4 / spacing) + 1)
    for place in np.flatnonzero(
        peaks & (powers > _CLEAR * broad) & (powers > _MIN_POWER_RATIO * line_power)
    ):
        if _MIN_FREQUENCY < place * spacing < _MAX_RATE_FRACTION * take.sample_rate:
            left, centre, right = np.log(powers[place - 1 : place + 2])
            shift = 0.5 * (left - right) / (left - 2 * centre + right)
            yield float((place + shift) * spacing)


def _subtract_tone(
    samples: Array, tone: float, rate: int, lead_blocks: int
) -> tuple[Array, float, float]:
    """Return samples (C, n) without a tone, its amplitude, 0 if it is not steady, and its Hz.

    The first `lead_blocks` blocks hold ambient sound alone. The weights of others fall with the
    power near the tone.
    """
    size = round(_BLOCK * rate)
    count = samples.shape[1] // size
    window = np.hanning(size) * 2 / np.hanning(size).sum()
    side_shift = np.exp(2j * np.pi * _SIDE_DISTANCE * np.arange(size) / rate)
    times = np.arange(samples.shape[1]) / rate
    demodulated_samples = samples * np.exp(-2j * np.pi * tone * times)
    blocks = demodulated_samples[:, : count * size].reshape(len(samples), count, size)
    sizes = blocks @ window
    steps = (sizes[:, 1:lead_blocks] * sizes[:, : lead_blocks - 1].conj()).sum()
    powers = (np.abs(sizes) ** 2).mean(axis=0)
    median_power = float(np.median(powers[:lead_blocks]))
    if median_power > min(
        _MAX_CHANGE * powers[-2:].mean(), _MAX_FLUCTUATION * powers[:lead_blocks].min()
    ):
        return samples, 0.0, tone
    others = sum(
        (np.abs(blocks @ (window * shift)) ** 2).mean(axis=0)
        for shift in (side_shift, 1 / side_shift)
    )
    weights = (
        1
        / (
            others
            + np.maximum(powers - _MAX_CHANGE * median_power, 0)
            + _POWER_TOLERANCE * median_power
        )
        ** 2
    )
    drift = float(np.angle(steps)) / (2 * np.pi * size)
    block_centres = (np.arange(count) + 0.5) * size
    smooth_sizes = _smooth_amplitudes(sizes * np.exp(-2j * np.pi * drift * block_centres), weights)
    places = np.arange(samples.shape[1])
    envelope = np.array(
        [np.interp(places, block_centres, amplitudes) for amplitudes in smooth_sizes]
    )
    carrier = np.exp(2j * np.pi * (tone * times + drift * places))
    return samples - (envelope * carrier).real, median_power**0.5, tone + drift * rate


def stiffness(bends: Array) -> Array:
    """Return bands (3, B) of the matrix that weighs second differences by bends (B - 2,)."""
    bands = np.zeros((3, len(bends) + 2))
    for row, first in enumerate((1.0, -2.0, 1.0)):
        for column, second in enumerate((1.0, -2.0, 1.0)[row:], row):
            bands[2 - (column - row), column : len(bends) + column] += bends * first * second
    return bands


def _smooth_amplitudes(sizes: AnyComplex, weights: Array) -> AnyComplex:
    """Return weighted sizes (C, B) with as small second differences as they allow."""
    weights = weights / weights.max()
    bands = stiffness(np.full(sizes.shape[1] - 2, _STIFFNESS))
    bands[2] += weights + 1e-9
    return solveh_banded(bands, (weights * sizes).T).T


_REMAINDER_DISTANCE = 1.0  # Hz from a subtracted tone
_REMAINDER_FRACTION = 0.3  # of its amplitude
_MAX_REMAINDER_DECAY = 2.0  # 1/s, of slower modes


def find_hum(tones: Array, ringing: Exponentials) -> Mask:
    """Return which modes (M,) are remainders of tones (K, 2) of hum that were subtracted."""
    is_near = np.abs(ringing.frequencies[:, None] - tones[:, 0]) < _REMAINDER_DISTANCE
    sizes = np.abs(ringing.gains).max(axis=0, initial=0.0)
    is_faint = sizes[:, None] < _REMAINDER_FRACTION * tones[:, 1]
    return (is_near & is_faint).any(axis=1) & (ringing.decays < _MAX_REMAINDER_DECAY)


# Lossy coding and offsets.

_FRAME = 0.026  # approximate length of a coder's frame, s
_BINS = 8  # in a band
_DEEP = 15.0  # by which a hole lies below what comes before and after it, dB
_HOLE_REACH = 4  # half frames within which that is
_RANGE = 110.0  # below the loudest band, dB: softer ones are rounding
_RISE = 6.0  # dB
_NEW_SOUND_FRACTION = 0.3  # fraction of bands that rise by it when a new sound begins
_MAX_SECONDS = 40.0  # s that are analyzed, around the peak
# In coded takes at 128 kbit/s, 0.17 to 0.6 % of all bands and frames are holes, in 9 frames and 10
# bands or more; a beat makes its holes in one band, other takes none.
_MIN_HOLE_FRACTION, _FRAMES, _BANDS, _MIN_FRAMES = 1.2e-3, 6, 6, 40
# Fraction of holes below which they may come from a scrape or a moving listener.
_CERTAIN_FRACTION = 0.01
_HOLE_REASON, _MOTION_REMARK = (
    "bands fall silent and come back",
    ", as they also do where something moves",
)
_LOSSY = {".ogg", ".oga", ".opus"}
_OFFSET = 2e-3  # smallest mean over peak that is reported


def note_processing(take: Take) -> Iterator[str]:
    """Yield a sentence about each processing found in a take: lossy coding, offset."""
    samples = take.samples[~left_out(take)]
    if not samples.size:
        return
    loudest_channel = samples[int(np.square(samples).sum(axis=1).argmax())]
    reason = "as its ending says" if PurePath(take.name).suffix.lower() in _LOSSY else _HOLE_REASON
    hole_fraction = (
        1.0 if reason != _HOLE_REASON else measure_loss(loudest_channel, take.sample_rate)
    )
    if hole_fraction:
        verb, remark = (
            ("was", "") if hole_fraction > _CERTAIN_FRACTION else ("may have been", _MOTION_REMARK)
        )
        yield (
            f"{take.name} {verb} coded with loss (MP3, AAC, OGG): {reason}{remark}; weak modes "
            "may be false or missing, so record without compression"
        )
    offset = float(np.abs(samples.mean(axis=1)).max() / max(np.abs(samples).max(), 1e-300))
    if offset > _OFFSET:
        yield (
            f"{take.name} has a constant offset of {rounded(100 * offset, 2)} % of its peak: no "
            "mode is fitted to it; look at the converter or the cable"
        )


def measure_loss(samples: Array, sample_rate: float) -> float:
    """Return the fraction of holes of a lossy coder in samples (n,); 0 if there are too few."""
    levels = _bands(_select_loudest_part(samples, sample_rate), sample_rate)
    if len(levels) < _MIN_FRAMES:  # half a second
        return 0.0
    is_hole, is_possible = _holes(levels)
    fraction = np.count_nonzero(is_hole) / max(np.count_nonzero(is_possible), 1)
    frames, bands = (np.count_nonzero(is_hole.any(axis=axis)) for axis in (1, 0))
    return (
        fraction if fraction > _MIN_HOLE_FRACTION and frames >= _FRAMES and bands >= _BANDS else 0.0
    )


def _select_loudest_part(samples: Array, sample_rate: float) -> Array:
    """Return the part about the peak, of a long take."""
    half = round(_MAX_SECONDS / 2 * sample_rate)
    first = max(0, int(np.abs(samples).argmax()) - half)
    return samples[first : first + 2 * half]


def _bands(samples: Array, sample_rate: float) -> Array:
    """Return levels of bands in overlapping frames (frames, bands), dB."""
    size = 2 ** round(np.log2(_FRAME * sample_rate))
    if len(samples) < size:
        return np.zeros((0, 0))
    frames = np.lib.stride_tricks.sliding_window_view(samples, size)[:: size // 2]
    powers = np.abs(np.fft.rfft(frames * np.hanning(size), axis=1)) ** 2
    whole_bands = powers[:, : powers.shape[1] // _BINS * _BINS].reshape(len(powers), -1, _BINS)
    return 10 * np.log10(whole_bands.sum(axis=2) + 1e-30)


def _holes(levels: Array) -> tuple[Mask, Mask]:
    """Return which bands of which frames are holes, and which might be."""
    earlier_levels, later_levels = (
        np.max([np.roll(levels, sign * by, axis=0) for by in range(1, _HOLE_REACH + 1)], axis=0)
        for sign in (1, -1)
    )
    lower_levels, min_level = np.minimum(earlier_levels, later_levels), levels.max() - _RANGE
    is_sounding = np.maximum(earlier_levels, later_levels) > min_level
    has_new_sound = (is_sounding & (later_levels > levels + _RISE)).sum(
        axis=1
    ) >= _NEW_SOUND_FRACTION * is_sounding.sum(axis=1)
    is_possible = (lower_levels > min_level) & ~has_new_sound[:, None]
    is_possible[:_HOLE_REACH] = is_possible[-_HOLE_REACH:] = False
    return is_possible & (levels < lower_levels - _DEEP), is_possible

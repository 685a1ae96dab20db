"""Processing of a take before it came here: lossy coding, and a constant offset.

A perceptual coder such as MP3 or AAC rounds each band of each short frame to as few bits as the
loud bands beside it allow, many of them to nothing. What it leaves are holes: a band falls silent
for a frame or two and comes back, while others go on. No sound in air does that: a mode falls and
stays down, a beat comes and goes in narrow bands and slowly, noise summed over some bins varies by
few decibels. A low-pass at 16 kHz alone, as old converters and codecs both have it, shows nothing.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from struck.model.arrays import Array, Mask
from struck.recordings.takes import Take, force_channels

_FRAME = 0.026  # of sound that a coder treats alike, about, s
_BINS = 8  # in a band
_DEEP = 15.0  # by which a hole lies below what comes before and after it, dB
_NEAR = 4  # half frames within which that is
_RANGE = 110.0  # below the loudest band, dB: softer ones are rounding
_RISE = 6.0  # of the whole, dB: it is a new sound that comes, not the band that comes back
_MOST_HELD = 40.0  # s that are looked at: the loudest
# Of coded takes at 128 kbit/s 0.17 to 0.6 % of all places are holes, in 9 frames and 10 bands or
# more; a beat makes its holes in one band, other takes none.
_SHARE, _FRAMES, _BANDS, _ENOUGH = 1.2e-3, 6, 6, 40
_OFFSET = 2e-3  # mean over the peak that is worth a word


def processed(take: Take) -> Iterator[str]:
    """Yield what was done to a take before it came here, one sentence each."""
    heard = take.samples[~force_channels(take)]
    if not heard.size:
        return
    loudest = heard[int(np.square(heard).sum(axis=1).argmax())]
    if lossy(loudest, take.sample_rate):
        yield (
            f"{take.name} was coded with loss (MP3, AAC): bands fall silent and come back; weak "
            "modes may be false or missing, so record without compression"
        )
    offset = float(np.abs(heard.mean(axis=1)).max() / max(np.abs(heard).max(), 1e-300))
    if offset > _OFFSET:
        yield (
            f"{take.name} has a constant offset of {100 * offset:.2g} % of its peak: no mode is "
            "fitted to it; look at the converter or the cable"
        )


def lossy(samples: Array, sample_rate: float) -> bool:
    """Return whether samples (n,), half a second or more, have the holes of a lossy coder."""
    levels = _bands(_loudest_part(samples, sample_rate), sample_rate)
    if len(levels) < _ENOUGH:  # half a second
        return False
    holes, possible = _holes(levels)
    share = np.count_nonzero(holes) / max(np.count_nonzero(possible), 1)
    frames, bands = (np.count_nonzero(holes.any(axis=axis)) for axis in (1, 0))
    return bool(share > _SHARE and frames >= _FRAMES and bands >= _BANDS)


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
    shifts = range(1, _NEAR + 1)
    total = 10 * np.log10((10 ** (levels / 10)).sum(axis=1))
    coming = np.max([np.roll(total, -shift) for shift in shifts], axis=0)
    before, after = (
        np.max([np.roll(levels, sign * shift, axis=0) for shift in shifts], axis=0)
        for sign in (1, -1)
    )
    beside = np.minimum(before, after)
    possible = (beside > levels.max() - _RANGE) & (coming < total + _RISE)[:, None]
    possible[:_NEAR] = possible[-_NEAR:] = False
    return possible & (levels < beside - _DEEP), possible

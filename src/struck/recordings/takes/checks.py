"""What is wrong with a take, as far as samples tell."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from struck.recordings.onsets import Hit
from struck.recordings.takes.force import force_channels
from struck.recordings.takes.take import Take

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

LEAD_IN = 0.1
"""Ambient sound before the first hit that tells the noise, s."""
MARGIN = 0.005
"""Between the ambient sound and the hit, s."""
_FLAT, _TOPS = 4, 3
_FULL_SCALE = 0.98
_QUIET = -50.0
_AUDIBLE = 20.0
_CHANGED = 6.0
_BLOCK = 0.05
_FALLEN = 40.0
_STEP = 2.0**-23
"""Of 24 bits, under the peak: what is softer than its rounding is no sound of a room."""


def clipped(take: Take) -> Mask:
    """Return which samples (n,) are cut off: a flat top at full scale, or three below it."""
    found = np.zeros(take.samples.shape[1], bool)
    for channel in take.samples:
        for side in (channel, -channel):
            top = side.max()
            inside = np.convolve(side == top, np.ones(_FLAT), "valid") > _FLAT - 0.5
            runs = np.count_nonzero(np.diff(inside.astype(int), prepend=0) == 1)
            if runs >= (1 if top >= _FULL_SCALE else _TOPS):
                found |= side == top
    return found


def lead_in(take: Take, hits: Sequence[Hit]) -> Array:
    """Return the samples before the first hit, (channels, n); none where it is not quiet there."""
    first = hits[0].onset - round(MARGIN * take.sample_rate)
    before = take.samples[:, : max(first, 0)]
    return before if before.shape[1] >= LEAD_IN * take.sample_rate else before[:, :0]


def findings(take: Take, hits: Sequence[Hit]) -> Iterator[str]:
    """Yield what a person should know of a take, one sentence each."""
    yield from _forces(take)
    yield from _clipping(take)
    peak = 20 * np.log10(np.abs(take.samples).max())
    if peak < _QUIET:
        yield f"{take.name} is quiet: its peak is {peak:.0f} dB of full scale"
    if not lead_in(take, hits).shape[1]:
        yield (
            f"{take.name} has no lead-in: its noise is guessed from its quietest moment; leave "
            f"{LEAD_IN} s or more of silence before the hit"
        )
        return
    yield from _ending(take, lead_in(take, hits))


def _ending(take: Take, before: Array) -> Iterator[str]:
    """Compare how a take ends with what was heard before its first hit."""
    softest = _softest(take)
    levels, quiet = np.maximum(_levels(take), softest), _level(before)
    end = float(levels[-3:].mean())
    if quiet <= softest:  # digital silence: it tells nothing of the noise
        fallen = float(levels.max()) - end
        if fallen < _FALLEN:
            yield (
                f"{take.name} is cut short: it has fallen by {fallen:.0f} dB when it ends, so slow "
                "decays are less certain; record longer"
            )
    elif end - quiet > _AUDIBLE:
        yield (
            f"{take.name} is cut short: it ends {end - quiet:.0f} dB over its lead-in, so slow "
            "decays are less certain; record longer"
        )
    elif abs(end - quiet) > _CHANGED and levels.min() - quiet < -_CHANGED:
        yield (
            f"the noise of {take.name} changes by {levels.min() - quiet:.0f} dB: turn automatic "
            "gain and noise suppression off, for decays are wrong with them"
        )


def _forces(take: Take) -> Iterator[str]:
    for channel in np.flatnonzero(force_channels(take)):
        yield (
            f"channel {channel + 1} of {take.name} holds the force of the blows, short and of one "
            "sign, and no sound: it is left out"
        )


def _clipping(take: Take) -> Iterator[str]:
    count = np.count_nonzero(clipped(take))
    if count:
        yield (
            f"{take.name} is clipped for {1e3 * count / take.sample_rate:.1f} ms: what follows is "
            "fitted; turn the gain down"
        )


def _levels(take: Take) -> Array:
    size = max(1, round(_BLOCK * take.sample_rate))
    count = take.samples.shape[1] // size
    blocks = take.samples[:, : count * size].reshape(take.channels, count, size)
    return 10 * np.log10((blocks**2).mean(axis=(0, 2)) + 1e-30)


def _level(samples: Array) -> float:
    return float(10 * np.log10((samples**2).mean() + 1e-30))


def _softest(take: Take) -> float:
    """Return the level of the rounding error of `_STEP`, which is uniform, dB."""
    return float(20 * np.log10(np.abs(take.samples).max() * _STEP / np.sqrt(12)))

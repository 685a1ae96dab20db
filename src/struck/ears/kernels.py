"""The loops over samples of the delay lines, compiled."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from struck.synth.compiling import jitted

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Index = NDArray[np.int64]


@jitted
def hear(
    lines: Single,
    now: int,
    between: Single,
    line_of: Index,
    ear_of: Index,
    delays: Array,
    gains: Array,
    before: Single,
    after: Single,
    since: int,
    stretch: int,
    history: Single,
    heard: Single,
) -> None:
    """Read all paths and add what they sound like at the ears.

    Parameters
    ----------
    lines : array (L, 2 H)
        Each line twice, one after the other; sample n stands at n modulo H. H is a power of two.
    now : int
        Number of the block's first sample.
    between : array (S + 1, READ)
        As `lines.between`.
    line_of, ear_of, delays, gains, before, after
        As `lines.Paths`; responses of a multiple of eight taps.
    since, stretch : int
        Samples of the stretch that are over, and of all of it.
    history : array (P, taps - 1 + block)
        What was read in the blocks before.
    heard : array (ears, block)
        Added to.
    """
    block, taps = heard.shape[1], before.shape[1]
    faded = np.zeros((2, block), np.float32)
    for path in range(line_of.size):
        room = history[path]
        fresh = room[taps - 1 : taps - 1 + block]
        read(lines[line_of[path]], now, between, delays[path], gains[path], since, stretch, fresh)
        faded[:] = np.float32(0)
        convolve(room, before[path], faded[0])
        convolve(room, after[path], faded[1])
        ear = heard[ear_of[path]]
        for k in range(block):
            share = np.float32((since + k + 1) / stretch)
            ear[k] += faded[0, k] + share * (faded[1, k] - faded[0, k])
        for k in range(taps - 1):
            room[k] = room[k + block]


@jitted
def read(
    line: Single,
    now: int,
    between: Single,
    delays: Array,
    gains: Array,
    since: int,
    stretch: int,
    into: Single,
) -> None:
    """Read a line, as late and as loudly as a parabola through three values says."""
    half, fine, width = line.size // 2, between.shape[0] - 1, between.shape[1]
    for k in range(into.size):
        u = (since + k + 1) / stretch
        first, middle, last = (1 - u) * (1 - 2 * u), 4 * u * (1 - u), u * (2 * u - 1)
        place = now + k - (first * delays[0] + middle * delays[1] + last * delays[2])
        gain = first * gains[0] + middle * gains[1] + last * gains[2]
        whole = int(np.floor(place))
        row = (place - whole) * fine
        low = min(int(row), fine - 1)
        share = np.float32(row - low)
        start = (whole - (width // 2 - 1)) & (half - 1)
        some, begin, end = line[start : start + width], between[low], between[low + 1]
        total = np.float32(0)
        for n in range(width):
            total += (begin[n] + share * (end[n] - begin[n])) * some[n]
        into[k] = np.float32(gain) * total


@jitted
def convolve(samples: Single, response: Single, into: Single) -> None:
    """Add the convolution; `samples` begin as many before `into` as the response is long, less one.

    Eight taps at a time, so that a sum crosses memory once for all of them.
    """
    block, taps = into.size, response.size
    for t in range(0, taps, 8):
        h0, h1, h2, h3 = response[t], response[t + 1], response[t + 2], response[t + 3]
        h4, h5, h6, h7 = response[t + 4], response[t + 5], response[t + 6], response[t + 7]
        some = samples[taps - 8 - t : taps - 1 - t + block]
        for k in range(block):
            late = h4 * some[k + 3] + h5 * some[k + 2] + h6 * some[k + 1] + h7 * some[k]
            early = h0 * some[k + 7] + h1 * some[k + 6] + h2 * some[k + 5] + h3 * some[k + 4]
            into[k] += early + late

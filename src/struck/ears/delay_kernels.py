"""The loops over samples of the delay lines, compiled."""

from __future__ import annotations

import numpy as np

from struck.model.arrays import Array, Index, Single
from struck.synth.sample_loop import jitted, jitted_within


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
        As `delay_lines.between`.
    line_of, ear_of, delays, gains, before, after
        As `delay_lines.Paths`; responses of a multiple of four taps.
    since, stretch : int
        Samples of the stretch that are over, and of all of it.
    history : array (P, taps - 1 + block)
        What was read in the blocks before.
    heard : array (ears, block)
        Added to.
    """
    block, taps = heard.shape[1], before.shape[1]
    shares, total = np.empty(block, np.float32), np.zeros(block, np.float32)
    for k in range(block):
        shares[k] = (since + k + 1) / stretch
    for path in range(line_of.size):
        room = history[path]
        fresh = room[taps - 1 : taps - 1 + block]
        read(lines[line_of[path]], now, between, delays[path], gains[path], since, stretch, fresh)
        convolve(room, before[path], after[path], shares, total)
        ear = heard[ear_of[path]]
        for k in range(block):
            ear[k] += total[k]
            total[k] = 0
        for k in range(taps - 1):
            room[k] = room[k + block]


@jitted_within
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
    """Read a line, as late and as loudly as a parabola through three values says.

    Where to read is found for all samples first: sums then do not wait for it.
    """
    half, fine, width = line.size // 2, between.shape[0] - 1, between.shape[1]
    starts, rows = np.empty(into.size, np.int64), np.empty(into.size)
    for k in range(into.size):
        u = (since + k + 1) / stretch
        first, middle, last = (1 - u) * (1 - 2 * u), 4 * u * (1 - u), u * (2 * u - 1)
        place = now + k - (first * delays[0] + middle * delays[1] + last * delays[2])
        whole = np.floor(place)
        starts[k] = (int(whole) - (width // 2 - 1)) & (half - 1)
        rows[k] = (place - whole) * fine
        into[k] = first * gains[0] + middle * gains[1] + last * gains[2]
    for k in range(into.size):
        start, low = starts[k], min(int(rows[k]), fine - 1)
        share = np.float32(rows[k] - low)
        some, begin, end = line[start : start + width], between[low], between[low + 1]
        total = np.float32(0)
        for n in range(width):
            total += (begin[n] + share * (end[n] - begin[n])) * some[n]
        into[k] *= total


@jitted_within
def convolve(samples: Single, before: Single, after: Single, shares: Single, into: Single) -> None:
    """Add the convolution with a response that has gone a share of the way to another.

    `samples` begin as many before `into` as the response is long, less one. Four taps at a time, so
    that a sum crosses memory once for all of them.
    """
    block, taps = into.size, before.size
    for t in range(0, taps, 4):
        h0, h1, h2, h3 = before[t], before[t + 1], before[t + 2], before[t + 3]
        d0, d1, d2, d3 = after[t] - h0, after[t + 1] - h1, after[t + 2] - h2, after[t + 3] - h3
        some = samples[taps - 4 - t : taps - 1 - t + block]
        for k in range(block):
            share = shares[k]
            late = (h2 + share * d2) * some[k + 1] + (h3 + share * d3) * some[k]
            early = (h0 + share * d0) * some[k + 3] + (h1 + share * d1) * some[k + 2]
            into[k] += early + late

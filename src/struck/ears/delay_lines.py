"""Delay lines: the sound of bodies, read again when it arrives at an ear.

A line stores the sound of one body at 1 m. A path reads it, delayed by the time that sound takes to
an ear, interpolated between samples and scaled by the gain of the distance, and convolves it with
the ear's response. Delays and gains follow a parabola within a stretch of time, which gives moving
bodies their Doppler shift; responses fade from those of its start to those of its end.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from struck.core import entry
from struck.errors import OptionError
from struck.model.arrays import Array, Index, Single

READ = 32  # samples that a value between samples is made of
_FINE = 256  # places between two samples
_STEEPNESS = 9.0  # of Kaiser's window
_GROUP = 8  # taps are padded to a multiple


@cache
def interpolation_kernel() -> Single:
    """Return the weights (257, 32) of `READ` samples for places between two of them.

    A sinc under Kaiser's window: true to -85 dB up to 0.4 of the sample rate (Laakso et al. 1996).
    """
    shares = np.arange(_FINE + 1)[:, None] / _FINE
    places = np.arange(READ) - (READ // 2 - 1) - shares
    roots = np.sqrt(np.clip(1 - (places / (READ / 2)) ** 2, 0, None))
    weights = np.sinc(places) * np.i0(_STEEPNESS * roots) / np.i0(_STEEPNESS)
    return (weights / weights.sum(axis=1, keepdims=True)).astype(np.float32)


@dataclass(kw_only=True)
class Paths:
    """Propagation along P paths from lines to ears, within a stretch of time."""

    lines: Index  # (P,): from which line
    ears: Index  # (P,): to which ear
    delays: Array  # (P, 3), samples: at the begin, middle and end of the stretch
    gains: Array  # (P, 3)
    before: Single  # (P, taps): responses at the begin
    after: Single  # (P, taps): and at the end
    stretch: int  # samples


class DelayLines:
    """All lines of a scene, and the sound on its way through the ears' responses.

    `block` and `longest` are the most samples read at a time, and the largest delay in samples.
    """

    def __init__(self, *, lines: int, paths: int, block: int, longest: float, taps: int) -> None:
        self.block, self._now = block, 0
        self._lines = np.zeros((lines, 2 * self._length(longest)), np.float32)
        padded_taps = -(-taps // _GROUP) * _GROUP
        self._history = np.zeros((paths, padded_taps - 1 + block), np.float32)

    @property
    def longest(self) -> int:
        """The longest delay that can be read, samples."""
        return self._lines.shape[1] // 2 - self.block - READ

    def _length(self, longest: float) -> int:
        return 1 << int(np.ceil(np.log2(longest + self.block + READ + 1)))

    def lengthen(self, longest: float) -> None:
        """Make room in the delay lines for longer delays.

        Samples older than the present longest delay are lost: a path that grows at less than the
        speed of sound never reads them.
        """
        if longest <= self.longest:
            return
        old, half = self._lines, self._lines.shape[1] // 2
        length = self._length(longest)
        numbers = np.arange(self._now - half, self._now)
        self._lines = np.zeros((len(old), 2 * length), np.float32)
        for copy in (0, length):
            self._lines[:, copy + numbers % length] = old[:, numbers % half]

    def next_block(self, samples: Array, paths: Paths, ears: int, *, since: int = 0) -> Array:
        """Write samples (lines, n) and return the sound at the ears in the meantime (ears, n).

        A delay of `READ` / 2 samples or more reads what has been written by then; `since` samples
        of the paths' stretch are over.
        """
        count, half = samples.shape[1], self._lines.shape[1] // 2
        start, copies = self._now % half, self._lines.reshape(-1, 2, half)
        copies[:, :, start : start + count] = samples[:, None, : half - start]
        copies[:, :, : max(0, start + count - half)] = samples[:, None, half - start :]
        output = np.zeros((ears, count), np.float32)
        hear(
            *(
                self._lines,
                self._now,
                interpolation_kernel(),
                paths.lines,
                paths.ears,
                paths.delays,
            ),
            *(paths.gains, self._padded(paths.before), self._padded(paths.after)),
            *(since, paths.stretch, self._history, output),
        )
        self._now += count
        return output.astype(np.float64)

    def _padded(self, responses: Single) -> Single:
        taps = self._history.shape[1] - self.block + 1
        if responses.shape[1] == taps:
            return responses
        return np.pad(responses, ((0, 0), (0, taps - responses.shape[1])))


def hear(
    lines: Single,
    block_start: int,
    kernel: Single,
    line_of: Index,
    ear_of: Index,
    delays: Array,
    gains: Array,
    before: Single,
    after: Single,
    since: int,
    stretch: int,
    history: Single,
    output: Single,
) -> None:
    """Read all delay lines and add the sound of each path at the ears.

    Parameters
    ----------
    lines : array (L, 2 H)
        Each line twice, one after the other; sample n stands at n modulo H. H is a power of two.
    block_start : int
        Number of the block's first sample.
    kernel : array (S + 1, READ)
        Interpolation weights, as `interpolation_kernel` returns them.
    line_of : array (P,)
        Line that each path reads.
    ear_of : array (P,)
        Ear that each path is added to.
    delays : array (P, 3)
        As in `Paths`, samples.
    gains : array (P, 3)
        As in `Paths`.
    before : array (P, taps), float32
        Responses at the start of the stretch, of a multiple of four taps.
    after : array (P, taps), float32
        Responses at the end of the stretch.
    since : int
        Samples of the stretch that are over.
    stretch : int
        Length of the stretch, samples.
    history : array (P, taps - 1 + block or more)
        Samples read in the earlier blocks.
    output : array (ears, block)
        The sound of the paths is added to it.
    """
    loop = entry("ears_hear")
    if loop is None:
        plain = lines, block_start, kernel, line_of, ear_of, delays, gains, before, after
        hear_plainly(*plain, since, stretch, history, output)
        return
    if history.shape[1] < before.shape[1] - 1 + output.shape[1]:
        raise OptionError(f"{output.shape[1]} samples at a time are more than there is room for")
    loop(
        *(lines, lines.shape[1] // 2, block_start, kernel, len(kernel) - 1),
        *(len(line_of), line_of, ear_of, delays, gains),
        *(before.shape[1], before, after, since, stretch, output.shape[1]),
        *(history, history.shape[1], output),
    )


def hear_plainly(
    lines: Single,
    block_start: int,
    kernel: Single,
    line_of: Index,
    ear_of: Index,
    delays: Array,
    gains: Array,
    before: Single,
    after: Single,
    since: int,
    stretch: int,
    history: Single,
    output: Single,
) -> None:
    """Read all paths and add their sound at the ears as `hear` does, in plain NumPy."""
    block, taps = output.shape[1], before.shape[1]
    u = np.arange(since + 1, since + block + 1) / stretch
    parabola = np.stack([(1 - u) * (1 - 2 * u), 4 * u * (1 - u), u * (2 * u - 1)])
    for path, (line, ear) in enumerate(zip(line_of, ear_of, strict=True)):
        room = history[path]
        places = block_start + np.arange(block) - delays[path] @ parabola
        room[taps - 1 : taps - 1 + block] = (gains[path] @ parabola) * _read(
            lines[line], kernel, places
        )
        first, last = (
            np.convolve(room[: taps - 1 + block], responses[path], "valid")
            for responses in (before, after)
        )
        output[ear] += first + u * (last - first)
        room[: taps - 1] = room[block : block + taps - 1].copy()


def _read(line: Single, kernel: Single, places: Array) -> Array:
    half, width = len(line) // 2, kernel.shape[1]
    floors = np.floor(places)
    rows = (places - floors) * (len(kernel) - 1)
    low = np.minimum(rows.astype(int), len(kernel) - 2)
    fractions = (rows - low)[:, None]
    weights = (1 - fractions) * kernel[low] + fractions * kernel[low + 1]
    numbers = floors.astype(int)[:, None] - (width // 2 - 1) + np.arange(width)
    return (weights * line[numbers % half]).sum(axis=1)

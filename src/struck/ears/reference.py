"""The same as `kernels` in plain NumPy: what that is tested against."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Single = NDArray[np.float32]
Index = NDArray[np.int64]


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
    """Read all paths and add what they sound like at the ears; see `kernels.hear`."""
    block, taps = heard.shape[1], before.shape[1]
    u = np.arange(since + 1, since + block + 1) / stretch
    parabola = np.stack([(1 - u) * (1 - 2 * u), 4 * u * (1 - u), u * (2 * u - 1)])
    for path, (line, ear) in enumerate(zip(line_of, ear_of, strict=True)):
        room = history[path]
        places = now + np.arange(block) - delays[path] @ parabola
        room[taps - 1 : taps - 1 + block] = (gains[path] @ parabola) * _read(
            lines[line], between, places
        )
        first, last = (
            np.convolve(room[: taps - 1 + block], each[path], "valid") for each in (before, after)
        )
        heard[ear] += first + u * (last - first)
        room[: taps - 1] = room[block : block + taps - 1].copy()


def _read(line: Single, between: Single, places: Array) -> Array:
    half, width = len(line) // 2, between.shape[1]
    whole = np.floor(places)
    rows = (places - whole) * (len(between) - 1)
    low = np.minimum(rows.astype(int), len(between) - 2)
    share = (rows - low)[:, None]
    weights = (1 - share) * between[low] + share * between[low + 1]
    numbers = whole.astype(int)[:, None] - (width // 2 - 1) + np.arange(width)
    return (weights * line[numbers % half]).sum(axis=1)

"""What charts have in common: paper, axes of frequency, levels."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from struck.files.sound import Sound

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

INK, FAINT, GRID = "#222222", "#6b6b6b", "#dddddd"
"""Of what is read first, of what is read second, and of lines behind it."""
BLUE, ORANGE = "#20558a", "#d1611c"
"""Of one thing, and of another beside it."""
RANGE = 90.0
"""Levels that are shown below the strongest, dB."""
_BANDS = 1200
_TICKS = (20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 20000)


def chart(width: float, height: float) -> Figure:
    """Return an empty figure of so many inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=120, layout="constrained", facecolor="white")


def label_frequencies(axis: Axis) -> None:
    """Label a logarithmic axis in Hz."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    axis.set_major_locator(FixedLocator(_TICKS))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(
        FuncFormatter(lambda hertz, _: f"{hertz:g}" if hertz < 1e3 else f"{hertz / 1e3:g}k")
    )


def lighten(axes: Axes) -> None:
    """Draw a faint grid behind, and no frame above and to the right."""
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def strongest(sound: Sound) -> tuple[Array, Array]:
    """Return narrow bands (B,), Hz, and the strongest power of all channels together in each."""
    frequencies, values = sound.spectrum()
    edges = np.geomspace(20.0, sound.sample_rate / 2, _BANDS)
    starts = np.unique(np.searchsorted(frequencies, edges))
    starts = starts[starts < len(frequencies)]
    powers = np.square(values).sum(axis=0)
    return frequencies[starts], np.asarray(np.maximum.reduceat(powers, starts), np.float64)


def decibels(power: Array) -> Array:
    """Return levels below the strongest, down to -200."""
    return 10 * np.log10(np.maximum(power / max(power.max(), 1e-300), 1e-20))

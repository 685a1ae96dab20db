"""Pictures of a comparison: both spectra in one, and how the modes differ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from struck.charts import (
    BLUE,
    INK,
    ORANGE,
    RANGE,
    chart,
    decibels,
    label_frequencies,
    lighten,
    strongest,
)
from struck.comparison.sides import Side
from struck.files.sound import Sound

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Index = NDArray[np.int64]

COLOURS = (BLUE, ORANGE)
"""Of the first side and of the second."""
_LABELS = ("frequency (cents)", "decay rate (%)", "level (dB)")


def spectra(sides: Sequence[Side], sounds: Sequence[Sound], alone: Sequence[Index]) -> Figure:
    """Draw both spectra in one, with ticks where only one side has a mode.

    Parameters
    ----------
    sides : pair of Side
    sounds : pair of Sound
        What they sound like.
    alone : pair of arrays
        Numbers of the modes that the other side lacks.
    """
    figure = chart(11.0, 4.6)
    axes = figure.subplots()
    for side, sound, colour in zip(sides, sounds, COLOURS, strict=True):
        frequencies, powers = strongest(sound)
        axes.plot(
            frequencies, decibels(powers), color=colour, linewidth=0.9, alpha=0.75, label=side.name
        )
    for side, modes, colour, height in zip(sides, alone, COLOURS, (5.0, 10.0), strict=True):
        if len(modes):
            lonely = side.partials.frequencies[modes]
            label = f"in the {side.name} alone"
            axes.plot(lonely, np.full(len(lonely), height), "|", color=colour, label=label)
    axes.set(xlabel="frequency (Hz)", ylabel="level (dB, strongest = 0)", ylim=(-RANGE, 14))
    _frequency_axis(axes, sides)
    axes.legend(loc="lower left", fontsize=8, framealpha=0.85, edgecolor="none")
    return figure


def differences(
    sides: Sequence[Side], frequencies: Array, values: Sequence[Array], sure: Array
) -> Figure:
    """Draw how the second side's modes differ from the first's.

    Parameters
    ----------
    sides : pair of Side
    frequencies : array (P,)
        Of the first side's modes, Hz.
    values : three arrays (P,)
        Cents, % of decay, dB.
    sure : array (P,)
        How sure each pair is: the fainter, the less.
    """
    figure = chart(11.0, 6.4)
    panels = figure.subplots(3, 1, sharex=True)
    for axes, each, label in zip(panels, values, _LABELS, strict=True):
        axes.axhline(0, color=INK, linewidth=0.7)
        axes.vlines(frequencies, 0, each, color=COLOURS[1], alpha=0.35, linewidth=1)
        axes.scatter(frequencies, each, s=16, color=COLOURS[1], alpha=np.clip(sure, 0.2, 1.0))
        axes.set_ylabel(label)
        _frequency_axis(axes, sides)
    figure.supxlabel("frequency (Hz)", fontsize=10)
    figure.suptitle(f"{sides[1].name} less {sides[0].name}", fontsize=11)
    return figure


def _frequency_axis(axes: Axes, sides: Sequence[Side]) -> None:
    every = np.concatenate([side.partials.frequencies for side in sides])
    axes.set_xscale("log")
    axes.set_xlim(0.7 * float(every.min()), 1.2 * float(every.max()))
    label_frequencies(axes.xaxis)
    lighten(axes)

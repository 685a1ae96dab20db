"""Pictures of a report: how gains go over contacts and listeners."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from struck.charts import BLUE, INK, ORANGE, chart, label_frequencies, lighten
from struck.fitting.report_pictures import label_sizes
from struck.model.survey import Survey

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Mask = NDArray[np.bool_]

_WIDE = 11.0
_DEEP = 40.0
"""Levels that a map shows below the loudest place of each mode, dB."""
_LABELS = 24
_SAME = 1e-6


def rank_errors(frequencies: Array, errors: Array, unmeasured: Mask) -> Figure:
    """Draw how far the gains of each mode are from a product, %, those not measured apart."""
    figure = chart(_WIDE, 3.2)
    axes = figure.subplots()
    kinds = ((~unmeasured, "o", BLUE, "measured"), (unmeasured, "x", ORANGE, "not measured"))
    for chosen, mark, colour, label in kinds:
        if chosen.any():
            shares = 100 * errors[chosen]
            axes.plot(frequencies[chosen], shares, mark, color=colour, markersize=5, label=label)
    axes.set(xlabel="frequency (Hz)", ylabel="rank error (%)", xscale="log", yscale="log")
    label_sizes(axes)
    label_frequencies(axes.xaxis)
    lighten(axes)
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2, fontsize=9, frameon=False)
    return figure


def gain_map(
    levels: Array, frequencies: Array, places: Sequence[str], unmeasured: Mask, what: str
) -> Figure:
    """Draw how loud each mode is at each place.

    Parameters
    ----------
    levels : array (P, M)
        Below each mode's loudest place, dB.
    frequencies : array (M,)
        Hz.
    places : sequence of P str
        What to call them.
    unmeasured : array (M,)
        Modes that are marked.
    what : str
        What the places are.
    """
    figure = chart(_WIDE, float(np.clip(0.24 * len(places) + 1.8, 2.6, 8.0)))
    axes = figure.subplots()
    image = axes.imshow(
        levels, aspect="auto", cmap="viridis", vmin=-_DEEP, vmax=0, interpolation="nearest"
    )
    axes.set_title("each mode below its loudest place", fontsize=9, color=INK, loc="left")
    _label_modes(axes, frequencies, unmeasured)
    shown = _spread(len(places))
    axes.set_yticks(shown, [places[place] for place in shown], fontsize=8)
    axes.set(ylabel=what, xlabel="mode (Hz)")
    bar = figure.colorbar(image, ax=axes, pad=0.01, label="level (dB)")
    bar.outline.set_visible(False)  # type: ignore[operator] - stubs take an outline for a spine
    return figure


def levels_at(survey: Survey, side: int) -> Array:
    """Return how loud modes are at contacts (side 0) or listeners (side 1), dB (places, M).

    Root mean squares over the other side, below each mode's loudest place; NaN where nothing was
    recorded.
    """
    count = len(survey.contacts if side == 0 else survey.listeners)
    powers = np.full((count, len(survey.frequencies)), np.nan)
    squares = np.square(np.abs(survey.gains))
    for place in np.unique(survey.pairs[:, side]):
        powers[place] = squares[survey.pairs[:, side] == place].mean(axis=0)
    loudest = np.maximum(np.nanmax(powers, axis=0), 1e-300)
    return np.asarray(10 * np.log10(np.maximum(powers / loudest, 1e-20)), np.float64)


def named(places: Array) -> list[str]:
    """Return coordinates (n, D) as text, without the last digits of what should be 0."""
    step = max(float(np.abs(places).max()), 1e-300) * _SAME
    tidy = np.round(places / step) * step + 0.0
    return [", ".join(f"{value:.3g}" for value in place) for place in tidy]


def _label_modes(axes: Axes, frequencies: Array, unmeasured: Mask) -> None:
    shown = _spread(len(frequencies), 2 * _LABELS)
    axes.set_xticks(shown, [f"{frequencies[mode]:.0f}" for mode in shown], rotation=90, fontsize=8)
    axes.tick_params(length=0)
    marked = np.flatnonzero(unmeasured)
    if len(marked):
        above = axes.secondary_xaxis("top")
        above.set_xticks(marked, ["\N{MULTIPLICATION SIGN}"] * len(marked), color=ORANGE)
        above.tick_params(length=0)
        axes.set_title(
            "\N{MULTIPLICATION SIGN} not measured", fontsize=9, color=ORANGE, loc="right"
        )
    axes.xaxis.label.set_color(INK)


def _spread(count: int, most: int = _LABELS) -> list[int]:
    """Return so many numbers below the count, spread evenly."""
    return list(range(0, count, -(-count // most)))

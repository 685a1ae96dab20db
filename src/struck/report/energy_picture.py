"""Pictures of radiation: efficiency and share of the air by mode, and energies in third octaves."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from struck.errors import OptionError
from struck.model.arrays import Array
from struck.model.model import ModalModel
from struck.model.picture_style import in_default_style
from struck.model.third_octaves import NumberTable, ThirdOctaves
from struck.report.charts import (
    BLUE,
    FAINT,
    INK,
    ORANGE,
    chart,
    description,
    frequency_axis,
    plain,
    quantity,
)
from struck.scene.energy import Energy

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_MIN_EFFICIENCY = 1e-4  # lowest radiation efficiency in a picture, chosen by judgement
# Losses from below upward; grey and ochre stay with the body, blue and orange are the air's.
_COLOURS = {
    "material": "#b9b9b9",
    "support": "#8a7a55",
    "hold": "#c9b27c",
    "surface": BLUE,
    "sound": ORANGE,
}
_GAP = 0.06  # fraction of a band that is left free between bars


@in_default_style
def radiation_picture(model: ModalModel) -> Figure:
    """Draw the radiation efficiency of each mode, and the part of its energy lost as sound."""
    if not len(model.frequencies):
        raise OptionError("the model has no modes whose radiation could be drawn")
    power = model.radiated_power()
    bands, table = ThirdOctaves.of(power.frequencies), power.bands
    figure = chart(9.0, 6.4)
    figure.suptitle(_title(model), fontsize=12, color=INK)
    efficiency_axes, loss_axes = figure.subplots(2, 1, sharex=True)
    _draw_values(
        efficiency_axes, power.frequencies, power.efficiencies, bands, table, "radiation efficiency"
    )
    efficiency_axes.axhline(1.0, color=FAINT, linewidth=0.8, linestyle=":")
    min_shown_efficiency = max(power.efficiencies.min(), _MIN_EFFICIENCY) / 1.5
    max_shown_efficiency = max(power.efficiencies.max(), 1.0) * 1.5
    efficiency_axes.set(
        yscale="log",
        ylim=(min_shown_efficiency, max_shown_efficiency),
        ylabel="radiation efficiency",
    )
    efficiency_axes.legend(loc="lower right", fontsize=9, frameon=False)
    _draw_values(
        loss_axes, power.frequencies, 100 * power.fractions, bands, table, "lost as sound (%)"
    )
    loss_axes.set(ylim=(0, 100), ylabel="energy lost as sound (%)", xlabel="frequency (Hz)")
    _frame([efficiency_axes, loss_axes], bands)
    efficiency_axes.tick_params(labelbottom=False)
    return figure


@in_default_style
def balance_picture(model: ModalModel, energy: Energy) -> Figure:
    """Draw where the energy of excitations goes, in third octaves."""
    if not len(energy.frequencies):
        raise OptionError("the model has no modes that could take energy")
    bands = ThirdOctaves.of(energy.frequencies)
    figure = chart(9.0, 4.4)
    entered_text, sound_text = (
        quantity(energy.total[name], "J", 3) for name in ("entered", "sound")
    )
    figure.suptitle(
        f"{_title(model)}: {entered_text} into the modes, {sound_text} of it lost as sound",
        fontsize=12,
        color=INK,
    )
    axes = figure.subplots()
    edges, base = bands.edges, np.zeros(len(bands.counts))
    widths = np.diff(edges)
    scale, unit = _unit(bands.sums(energy.entered).max())
    for name, colour in _COLOURS.items():
        heights = bands.sums(getattr(energy, name)) / scale
        if not heights.any():
            continue
        axes.bar(
            edges[:-1] + _GAP / 2 * widths,
            heights,
            (1 - _GAP) * widths,
            bottom=base,
            align="edge",
            color=colour,
            label=name,
        )
        base = base + heights
    axes.set(xlabel="third octave (Hz)", ylabel=f"energy ({unit})")
    _frame([axes], bands)
    axes.legend(fontsize=9, frameon=False)
    return figure


def _unit(max_energy: float) -> tuple[float, str]:
    """Return a unit of energy in J, and its name, in which a value is at least 1."""
    units = {"J": 1.0, "mJ": 1e-3, "\N{MICRO SIGN}J": 1e-6}
    fitting = ((scale, name) for name, scale in units.items() if max_energy >= scale)
    return next(fitting, (1e-9, "nJ"))


def _title(model: ModalModel) -> str:
    return plain(description(model)) or "losses of the modes"


def _frame(panels: list[Axes], bands: ThirdOctaves) -> None:
    for axes in panels:
        frequency_axis(axes, bands.edges[0], bands.edges[-1])


def _draw_values(
    axes: Axes,
    frequencies: Array,
    values: Array,
    bands: ThirdOctaves,
    table: NumberTable,
    heading: str,
) -> None:
    """Draw a value of each mode, and its means in the third octaves (a column of the table)."""
    means, edges = np.asarray(table.columns[heading]), bands.edges
    axes.plot(frequencies, values, "o", ms=4, color=BLUE, alpha=0.7, label="mode")
    label = "mean of a third octave"
    axes.hlines(means, edges[:-1], edges[1:], color=ORANGE, linewidth=2.5, label=label)

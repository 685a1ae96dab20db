"""Pictures of a comparison: both spectra in one, and how the modes differ."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from struck.files.sound import Sound
from struck.model.arrays import Array, Index
from struck.model.html import document, picture, table
from struck.report.charts import (
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
from struck.report.comparison_sides import Side

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

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


# One HTML page that shows how two bodies differ, and plays both.

HEADINGS = (
    "mode",
    "model (Hz)",
    "other (Hz)",
    "cents",
    "T60 model (s)",
    "T60 other (s)",
    "decay (%)",
    "level (dB)",
    "sure (%)",
)
"""Of the table of paired modes."""


def page(
    *,
    names: Sequence[str],
    lines: Sequence[str],
    sounds: Sequence[Sound],
    spectrograms: Sequence[Figure],
    pictures: Sequence[tuple[str, Figure]],
    rows: Sequence[Sequence[str]],
    alone: Sequence[NDArray[np.float64]],
) -> str:
    """Return a page that needs no other file.

    Parameters
    ----------
    names, sounds, spectrograms : pairs
        Of both sides.
    lines : sequence of str
        How they differ.
    pictures : sequence of (caption, Figure)
    rows : sequence of rows
        Under `HEADINGS`.
    alone : pair of arrays
        Frequencies of the modes that the other side lacks, Hz.
    """
    heard = zip(names, sounds, spectrograms, COLOURS, strict=True)
    body = _BODY.format(
        lines="".join(f"<li>{html.escape(line)}</li>" for line in lines),
        sounds="".join(_heard(*each) for each in heard),
        pictures="".join(picture(caption, figure) for caption, figure in pictures),
        table=table(HEADINGS, rows),
        alone="".join(_alone(*each) for each in zip(names, alone, strict=True)),
    )
    return document(f"struck: {' and '.join(names)}", body, style=_STYLE)


def _heard(name: str, sound: Sound, figure: Figure, colour: str) -> str:
    return (
        f'<figure><figcaption><b style="color:{colour}">{html.escape(name)}</b></figcaption>'
        f"{sound._repr_html_()}{picture(f'Spectrogram of the {name}', figure)}</figure>"
    )


def _alone(name: str, frequencies: NDArray[np.float64]) -> str:
    told = ", ".join(f"{frequency:.1f}" for frequency in frequencies) or "none"
    return f"<p><b>In the {html.escape(name)} alone</b> (Hz): {told}</p>"


_STYLE = """\
button { font: inherit; padding: .3rem 1rem; margin-bottom: 1rem; }
.modes { max-height: 32rem; overflow: auto; }
"""
_BODY = """\
<section><ul>{lines}</ul></section>
<section><h2>Sounds</h2><button id="switch">play, then switch between the two</button>
<div class="sounds">{sounds}</div></section>
<section><h2>Modes</h2>{pictures}<div class="modes">{table}</div>{alone}</section>
<script>
const [a, b] = document.querySelectorAll(".sounds audio");
for (const [one, other] of [[a, b], [b, a]])
  one.addEventListener("play", () => other.pause());
document.getElementById("switch").addEventListener("click", () => {{
  const [now, next] = b.paused ? [a, b] : [b, a];
  const playing = !now.paused && !now.ended;
  const chosen = playing ? next : a;
  chosen.currentTime = playing ? now.currentTime : 0;
  now.pause();
  chosen.play();
}});
</script>
"""

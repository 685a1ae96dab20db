"""What charts have in common: paper, axes of frequency, levels."""

from __future__ import annotations

import io
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import FileFormatError, OptionError
from struck.files.atomic import write_bytes
from struck.files.sound import Sound
from struck.model.arrays import Array
from struck.model.gains import ShapeGains
from struck.report.surface_picture import Drawable, Painter, columns_for

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure, SubFigure

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


# Pictures: spectra, spectrograms and mode shapes, as figures that save themselves.

_SHORTEST = 0.1
_ENDINGS = (".png", ".pdf", ".svg")
_HEARING = 2e-5


def spectrum(sound: Sound) -> Figure:
    """Draw the spectrum of a sound, its strongest peaks labelled in Hz."""
    figure = chart(8.0, 4.0)
    _draw_spectrum(figure.subplots(), sound)
    return figure


def spectrogram(sound: Sound, lowest: float | None = None) -> Figure:
    """Draw how the spectrum of a sound goes on in time.

    From `lowest` on, Hz; from below its lowest peak unless given.
    """
    figure = chart(8.0, 4.5)
    axes = figure.subplots()
    times, frequencies, levels = _levels_in_time(sound, lowest)
    image = axes.pcolormesh(
        times, frequencies, levels, cmap="magma", vmin=-RANGE, vmax=0, rasterized=True
    )
    axes.set(xlabel="time (s)", ylabel="frequency (Hz)", title=_heading(sound), yscale="log")
    label_frequencies(axes.yaxis)
    bar = figure.colorbar(image, ax=axes, pad=0.01, label="level (dB, strongest = 0)")
    bar.outline.set_visible(False)  # type: ignore[operator]
    return figure


def mode_shapes(model: Drawable, which: int | Sequence[int] = 6) -> Figure:
    """Draw a body as its modes displace it, exaggerated.

    Parameters
    ----------
    model : ModalModel
        With mode shapes on a surface.
    which : int or sequence of int
        So many from the lowest, or these (0 is the lowest).

    Returns
    -------
    Figure
        Coloured by the displacement along the surface's normal, as a share of the mode's largest
        displacement. A surface of more than 20,000 faces is drawn with fewer, and the figure says
        so.

    Raises
    ------
    OptionError
        When the model has no surface with mode shapes, or no such modes.
    """
    gains, modes = _shaped(model), _chosen(model, which)
    painter = Painter.of(gains.surface)
    width, height = painter.panel
    columns = columns_for(len(modes), width)
    rows = -(-len(modes) // columns)
    figure = chart(max(columns * width, 4.5), rows * height + 0.8)
    _draw_modes(figure, painter, model, modes, columns)
    return figure


def overview(model: Drawable, sound: Sound | None = None, title: str | None = None) -> Figure:
    """Draw a body, its first modes, and the spectrum of a strike (else how long modes ring).

    Of a body without mode shapes, as of one that was recorded, how long modes ring is drawn in
    their place.

    Parameters
    ----------
    model : ModalModel
    sound : Sound, optional
        What it sounds like.
    title : str, optional
        What to write above; material and mass unless given.

    Raises
    ------
    OptionError
        When the model has no modes.
    """
    if not isinstance(model.gains, ShapeGains):
        return _unshaped_overview(model, sound, title)
    gains = _shaped(model)
    painter = Painter.of(gains.surface)
    modes = _chosen(model, 5)
    height = float(np.clip(2.1 / painter.aspect, 1.2, 3.6)) + 1.3
    figure = chart(11.0, 3.8 + height)
    figure.suptitle(_title(model) if title is None else title, fontsize=13, color=INK)
    above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=(3.8, height)).flat
    body, levels = above.subplots(1, 2, width_ratios=(1.0, 1.9))
    painter.paint(body)
    body.set_title(_dimensions(gains), fontsize=9, color=FAINT)
    if sound is None:
        _draw_ringing(levels, model)
    else:
        _draw_spectrum(levels, sound)
    _draw_modes(below, painter, model, modes, len(modes))
    return figure


def _unshaped_overview(model: Drawable, sound: Sound | None, title: str | None) -> Figure:
    _require_modes(model)
    figure = chart(11.0, 4.2)
    figure.suptitle(_title(model) if title is None else title, fontsize=13, color=INK)
    panels = figure.subplots(1, 1 if sound is None else 2, squeeze=False)[0]
    _draw_ringing(panels[0], model)
    if sound is not None:
        _draw_spectrum(panels[1], sound)
    return figure


def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure as .png, .pdf or .svg, whole or not at all.

    Raises
    ------
    FileFormatError
        When the ending is another, or the file cannot be written.
    """
    ending = Path(path).suffix.lower()
    if ending not in _ENDINGS:
        raise FileFormatError(f"{path} ends in {ending!r}: pictures end in {', '.join(_ENDINGS)}")
    data = io.BytesIO()
    figure.savefig(data, format=ending[1:])
    write_bytes(path, data.getvalue())


def _shaped(model: Drawable) -> ShapeGains:
    if not isinstance(model.gains, ShapeGains):
        raise OptionError(
            "this model has no mode shapes on a surface to draw: draw the spectrum of its sound"
        )
    _require_modes(model)
    return model.gains


def _require_modes(model: Drawable) -> None:
    if not len(model.frequencies):
        raise OptionError("this model has 0 modes, so there is nothing to draw: widen its band")


def _chosen(model: Drawable, which: int | Sequence[int]) -> list[int]:
    count = len(model.frequencies)
    modes = list(range(min(which, count))) if isinstance(which, int) else [int(m) for m in which]
    if not modes or min(modes) < 0 or max(modes) >= count:
        raise OptionError(f"which is {which!r}: give modes of 0 to {count - 1}, or how many")
    return modes


def _draw_modes(
    figure: Figure | SubFigure,
    painter: Painter,
    model: Drawable,
    modes: Sequence[int],
    columns: int,
) -> None:
    shapes = [_shaped(model).shapes[:, :, mode].astype(np.float64) for mode in modes]
    titles = [f"{mode + 1}:  {_hertz(model.frequencies[mode])}" for mode in modes]
    captions = [_ringing_time(model.decays[mode]) for mode in modes]
    painter.paint_panels(figure, shapes, titles, captions, columns=columns)


def _draw_spectrum(axes: Axes, sound: Sound) -> None:
    frequencies, levels = _levels(sound)
    axes.plot(frequencies, levels, color=BLUE, linewidth=0.8)
    peaks = _peaks(frequencies, levels)
    for peak in peaks:
        axes.annotate(
            f"{frequencies[peak]:.0f}", (frequencies[peak], levels[peak]), (0, 4),
            textcoords="offset points", ha="center", fontsize=8, color=INK,
        )  # fmt: skip
    axes.set(xlabel="frequency (Hz)", ylabel="level (dB, strongest = 0)", xscale="log")
    label_frequencies(axes.xaxis)
    highest = sound.sample_rate / 2
    axes.set_xlim(_lowest_shown(frequencies[peaks], highest), highest)
    axes.set_ylim(-RANGE, 8)
    axes.set_title(_heading(sound), fontsize=10, color=INK)
    lighten(axes)


def _draw_ringing(axes: Axes, model: Drawable) -> None:
    frequencies, decays = model.frequencies[model.decays > 0], model.decays[model.decays > 0]
    times = np.log(1000) / decays
    axes.plot(frequencies, times, "o", color=BLUE, markersize=4, alpha=0.7)
    axes.set(xlabel="frequency (Hz)", ylabel="time to fall by 60 dB (s)")
    axes.set(xscale="log", yscale="log")
    label_frequencies(axes.xaxis)
    highest = max(20000.0, 1.2 * frequencies.max(initial=0))
    axes.set_xlim(_lowest_shown(frequencies, highest), highest)
    axes.set_ylim(min(0.1, times.min(initial=1) / 2), max(1, times.max(initial=1) * 2))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")
    count = len(model.frequencies)
    axes.set_title(f"{count} mode{'s' * (count != 1)}", fontsize=10, color=INK)
    lighten(axes)


def _levels(sound: Sound) -> tuple[Array, Array]:
    """Return audible frequencies, and levels of all channels together."""
    lacking = max(0, round(_SHORTEST * sound.sample_rate) - sound.samples.shape[1])
    longer = replace(sound, samples=np.pad(sound.samples, ((0, 0), (0, lacking))))
    frequencies, values = longer.spectrum()
    heard = frequencies >= min(20.0, frequencies[-1] / 2)
    return frequencies[heard], decibels(np.square(values[:, heard]).sum(axis=0))


def _lowest_shown(frequencies: Array, highest: float) -> float:
    """Return where an axis up to `highest` begins so that all `frequencies` have room."""
    lowest = max(20.0, 0.5 * frequencies.min()) if len(frequencies) else 20.0
    return min(lowest, highest / 2)


def _peaks(frequencies: Array, levels: Array, most: int = 8) -> list[int]:
    """Return the strongest peaks, no two closer than 10 %, so that labels do not collide."""
    from scipy.signal import find_peaks

    found, _ = find_peaks(levels, height=-60, prominence=12)
    chosen: list[int] = []
    for peak in found[np.argsort(-levels[found])]:
        apart = np.abs(np.log(frequencies[chosen] / frequencies[peak]))
        if len(chosen) < most and apart.min(initial=np.inf) > 0.1:
            chosen.append(int(peak))
    return chosen


def _levels_in_time(sound: Sound, lowest: float | None) -> tuple[Array, Array, Array]:
    """Return times (T,), log-spaced frequencies (B,) and levels (B, T) in dB of the strongest."""
    step = max(0.002, sound.duration / 900, 1 / sound.sample_rate)
    window = max(0.05, 4 / sound.sample_rate)
    times, linear, amplitudes = sound.spectrogram(window=window, step=step)
    levels = decibels(np.square(amplitudes).sum(axis=0))
    if lowest is None:
        heard, spectrum_levels = _levels(sound)
        lowest = _lowest_shown(heard[_peaks(heard, spectrum_levels)], linear[-1])
    frequencies = np.geomspace(min(lowest, linear[-1] / 2), linear[-1], 400)
    rows = np.stack([np.interp(frequencies, linear, column) for column in levels.T], axis=1)
    return times, frequencies, rows


def _heading(sound: Sound) -> str:
    if not sound.calibrated or not sound.peak:
        return f"{sound.duration:.2f} s, relative level"
    decibels = 20 * np.log10(sound.peak / _HEARING)
    return f"{sound.duration:.2f} s, peak {sound.peak:.3g} Pa ({decibels:.0f} dB)"


def _hertz(frequency: float) -> str:
    return f"{frequency:.1f} Hz" if frequency < 1000 else f"{frequency / 1000:.3f} kHz"


def _ringing_time(decay: float) -> str:
    return f"T60 {np.log(1000) / decay:.2g} s" if decay else "undamped"


def _dimensions(gains: ShapeGains) -> str:
    size = np.ptp(gains.surface.bounds, axis=0)
    unit, factor = ("mm", 1e3) if size.max() < 1 else ("m", 1.0)
    return " \N{MULTIPLICATION SIGN} ".join(f"{edge * factor:.3g}" for edge in size) + f" {unit}"


def _title(model: Drawable) -> str:
    name = "" if model.material is None else model.material.name
    mass = "" if model.mass is None else f"{model.mass:.3g} kg"
    return ", ".join(part for part in (name, mass) if part)

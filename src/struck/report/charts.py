"""Charts: spectra, spectrograms, ringing times and overviews of models."""

from __future__ import annotations

import io
import os
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import counted, rounded
from struck.files.atomic import require_ending, write_bytes
from struck.files.sound import Sound
from struck.model.arrays import Array, checked
from struck.model.gains import ShapeGains
from struck.model.model import ModalModel
from struck.model.picture_style import in_default_style
from struck.report.surface_picture import Painter

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.collections import QuadMesh
    from matplotlib.figure import Figure, SubFigure
    from matplotlib.image import AxesImage

INK, FAINT, GRID = "#222222", "#6b6b6b", "#dddddd"  # read first, read second, lines behind
BLUE, ORANGE = "#20558a", "#d1611c"  # two things to compare
RANGE = 90.0  # levels shown below the strongest, dB
_BANDS = 1200
_TICKS = (20, 50, 100, 200, 500, 1000, 2000, 5000, 10000, 20000)
_SHORTEST = 0.1  # sounds are padded to this length before their spectrum is drawn, s
PICTURES = (".png", ".pdf", ".svg")
_HEARING = 2e-5  # Pa
_PREFIXES = {"k": 1e3, "": 1.0, "m": 1e-3, "\N{MICRO SIGN}": 1e-6, "n": 1e-9}
_MODES = 5  # mode shapes in an overview


@in_default_style
def spectrogram(sound: Sound, lowest: float | None = None) -> Figure:
    """Draw levels over time and frequency, from `lowest` Hz or below the lowest peak on."""
    figure = chart(8.0, 4.5)
    axes = figure.subplots()
    if lowest is None:
        frequencies, levels = _levels(sound)
        lowest = _lowest_shown(frequencies[_peaks(frequencies, levels)], sound.sample_rate / 2)
    times, frequencies, powers, strongest = powers_in_time(sound, lowest)
    levels = 10 * np.log10(np.maximum(powers / max(strongest, 1e-200), 1e-20))
    image = draw_spectrogram(axes, times, frequencies, levels)
    axes.set(ylabel="frequency (Hz)", title=_heading(sound))
    colour_bar(figure, image, [axes], "level (dB, strongest = 0)")
    return figure


@in_default_style
@checked
def overview(
    model: ModalModel, sound: Sound | None = None, title: str | None = None, *, at: str = ""
) -> Figure:
    """Draw a body, its first modes, and the spectrum of a sound, otherwise the decays of its modes.

    Parameters
    ----------
    model : ModalModel
        The model.
    sound : Sound, optional
        Sound of the model. Default: decays instead of its spectrum.
    title : str, optional
        Title of the picture.
    at : str, default ""
        Contact of the strike of the sound, in words, above its spectrum.

    Returns
    -------
    matplotlib.figure.Figure
        The picture.
    """
    if not len(model.frequencies) and model.recoil is None:
        sound = None  # silent
    title = description(model) if title is None else title
    if not isinstance(model.gains, ShapeGains):  # of a body that was recorded
        return _unshaped_overview(model, sound, title, at)
    painter = Painter.of(model.gains.surface)
    modes = min(_MODES, len(model.frequencies))
    height = float(np.clip(2.1 / painter.aspect, 1.2, 3.6)) + 1.3
    figure = chart(11.0, 3.8 + height * (modes > 0))
    figure.suptitle(plain(title), fontsize=13, color=INK)
    above: Figure | SubFigure = figure
    if modes:
        above, below = figure.subfigures(2, 1, squeeze=False, height_ratios=(3.8, height)).flat
        _draw_modes(below, painter, model, model.gains, modes)
    body, levels = above.subplots(1, 2, width_ratios=(1.0, 1.9))
    painter.paint(body)
    body.set_title(_dimensions(model.gains), fontsize=9, color=FAINT)
    if sound is None:
        _draw_ringing(levels, model)
    else:
        _draw_spectrum(levels, sound, model, at)
    return figure


@in_default_style
def save(figure: Figure, path: str | os.PathLike[str]) -> None:
    """Write a figure as .png, .pdf or .svg, whole or not at all."""
    require_ending(path, PICTURES, "pictures")
    data = io.BytesIO()
    figure.savefig(data, format=Path(path).suffix[1:].lower())
    write_bytes(path, data.getvalue())


def chart(width: float, height: float) -> Figure:
    """Return an empty figure of a width and a height in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), dpi=120, layout="constrained", facecolor="white")


def label_frequencies(axis: Axis) -> None:
    """Label a logarithmic axis in Hz."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    axis.set_major_locator(FixedLocator(_TICKS))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(
        FuncFormatter(
            lambda hertz, _: rounded(hertz) if hertz < 1e3 else f"{rounded(hertz / 1e3)}k"
        )
    )


def frequency_axis(axes: Axes, lowest: float, highest: float) -> None:
    """Make the horizontal axis one of frequency, Hz, over a faint grid without a frame."""
    axes.set_xscale("log")
    axes.set_xlim(lowest, highest)
    label_frequencies(axes.xaxis)
    lighten(axes)


def lighten(axes: Axes) -> None:
    """Draw a faint grid behind, and no frame above and to the right."""
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[["top", "right"]].set_visible(False)


def colour_bar(figure: Figure, image: QuadMesh | AxesImage, panels: list[Axes], label: str) -> None:
    """Draw the colour scale of an image next to some panels."""
    bar = figure.colorbar(image, ax=panels, pad=0.01, label=label)
    bar.outline.set_visible(False)  # type: ignore[operator] - stubs take an outline for a spine


def draw_spectrogram(axes: Axes, times: Array, frequencies: Array, levels: Array) -> QuadMesh:
    """Draw levels (B, T), dB, over times (T,), s, and frequencies (B,), Hz."""
    image = axes.pcolormesh(
        times, frequencies, levels, cmap="magma", vmin=-RANGE, vmax=0, rasterized=True
    )
    axes.set(xlabel="time (s)", yscale="log")
    label_frequencies(axes.yaxis)
    return image


def powers_in_time(
    sound: Sound, lowest: float, *, columns: int = 900, rows: int = 400
) -> tuple[Array, Array, Array, float]:
    """Return times (T,), log-spaced frequencies (B,), powers (B, T) and the strongest power."""
    step = max(0.002, sound.duration / columns, 1 / sound.sample_rate)
    window = max(0.05, 4 / sound.sample_rate)
    times, linear, amplitudes = sound.spectrogram(window=window, step=step)
    powers = np.square(amplitudes).sum(axis=0)
    frequencies = np.geomspace(min(lowest, linear[-1] / 2), linear[-1], rows)
    levels = np.log(powers + 1e-300)
    spaced = np.stack([np.interp(frequencies, linear, column) for column in levels.T], axis=1)
    return times, frequencies, np.exp(spaced), float(powers.max())


def strongest(sound: Sound) -> tuple[Array, Array]:
    """Return narrow bands (B,), Hz, and the strongest power of all channels together in each."""
    frequencies, values = sound.spectrum()
    edges = np.geomspace(20.0, sound.sample_rate / 2, _BANDS)
    starts = np.unique(np.searchsorted(frequencies, edges))
    starts = starts[starts < len(frequencies)]
    powers = np.square(values).sum(axis=0)
    return frequencies[starts], np.asarray(np.maximum.reduceat(powers, starts), np.float64)


def decibels(power: Array) -> Array:
    """Return levels below the strongest, down to -200 dB."""
    return 10 * np.log10(np.maximum(power / max(power.max(), 1e-300), 1e-20))


def quantity(value: float, unit: str, digits: int = 2) -> str:
    """Return a number with its unit, whose prefix keeps it between 1 and 1000, as "170 µm"."""
    number = float(rounded(value, digits))
    if not number:
        return f"0 {unit}"
    fitting = (prefix for prefix, factor in _PREFIXES.items() if abs(number) >= factor)
    prefix = next(fitting, "n")
    return f"{rounded(number / _PREFIXES[prefix], digits)} {prefix}{unit}"


def plain(text: str) -> str:
    """Return a text from outside for a picture, where two $ would begin a formula."""
    return text.replace("$", r"\$")


@in_default_style
def _unshaped_overview(model: ModalModel, sound: Sound | None, title: str, at: str) -> Figure:
    figure = chart(11.0, 4.2)
    figure.suptitle(plain(title), fontsize=13, color=INK)
    panels = figure.subplots(1, 1 if sound is None else 2, squeeze=False)[0]
    _draw_ringing(panels[0], model)
    if sound is not None:
        _draw_spectrum(panels[1], sound, model, at)
    return figure


def _draw_modes(
    figure: Figure | SubFigure, painter: Painter, model: ModalModel, gains: ShapeGains, count: int
) -> None:
    modes = range(count)
    shapes = [gains.shapes[:, :, mode].astype(np.float64) for mode in modes]
    titles = [f"{mode + 1}:  {hertz(model.frequencies[mode])}" for mode in modes]
    times = [np.log(1000) / decay if decay else None for decay in model.decays[modes]]
    captions = [f"T60 {rounded(time, 2)} s" if time else "undamped" for time in times]
    painter.paint_modes(figure, shapes, titles, captions)


def _draw_spectrum(axes: Axes, sound: Sound, model: ModalModel | None = None, at: str = "") -> None:
    """Draw the spectrum of a sound, its strongest peaks labelled in Hz.

    It begins below those and the lowest mode of its model; `at` is where that was struck, in words.
    """
    frequencies, levels = _levels(sound)
    axes.plot(frequencies, levels, color=BLUE, linewidth=0.8)
    peaks = _peaks(frequencies, levels)
    for peak in peaks:
        axes.annotate(
            f"{frequencies[peak]:.0f}", (frequencies[peak], levels[peak]), (0, 4),
            textcoords="offset points", ha="center", fontsize=8, color=INK,
        )  # fmt: skip
    highest = sound.sample_rate / 2
    modes = np.zeros(0) if model is None else model.frequencies[model.of_object]
    shown = np.concatenate([frequencies[peaks], modes[:1]])
    frequency_axis(axes, _lowest_shown(shown, highest), highest)
    axes.set(xlabel="frequency (Hz)", ylabel="level (dB, strongest = 0)", ylim=(-RANGE, 8))
    struck = f"struck at {at}\n" if at else ""
    axes.set_title(f"{struck}{_heading(sound)}", fontsize=10, color=INK)


def _draw_ringing(axes: Axes, model: ModalModel) -> None:
    """Draw how long each mode takes to fall by 60 dB over its frequency."""
    frequencies, decays = model.frequencies[model.decays > 0], model.decays[model.decays > 0]
    times = np.log(1000) / decays
    axes.plot(frequencies, times, "o", color=BLUE, markersize=4, alpha=0.7)
    axes.set(xlabel="frequency (Hz)", ylabel="time to fall by 60 dB (s)", yscale="log")
    highest = max(20000.0, 1.2 * frequencies.max(initial=0))
    frequency_axis(axes, _lowest_shown(frequencies, highest), highest)
    axes.set_ylim(min(0.1, times.min(initial=1) / 2), max(1, times.max(initial=1) * 2))
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("")
    axes.set_title(counted(len(model.frequencies), "mode"), fontsize=10, color=INK)


def _levels(sound: Sound) -> tuple[Array, Array]:
    """Return audible frequencies, and levels of all channels together."""
    missing_count = max(0, round(_SHORTEST * sound.sample_rate) - sound.samples.shape[1])
    padded_sound = replace(sound, samples=np.pad(sound.samples, ((0, 0), (0, missing_count))))
    frequencies, values = padded_sound.spectrum()
    is_audible = frequencies >= min(20.0, frequencies[-1] / 2)
    return frequencies[is_audible], decibels(np.square(values[:, is_audible]).sum(axis=0))


def _lowest_shown(frequencies: Array, highest: float) -> float:
    """Return where an axis up to `highest` begins so that all `frequencies` have room."""
    lowest = max(20.0, 0.5 * frequencies.min()) if len(frequencies) else 20.0
    return min(lowest, highest / 2)


def _peaks(frequencies: Array, levels: Array, count: int = 8) -> list[int]:
    """Return the strongest peaks whose labels do not collide: 25 %, or 10 % and 6 dB, apart."""
    from scipy.signal import find_peaks

    peaks, _ = find_peaks(levels, height=-60, prominence=12)
    chosen: list[int] = []
    for peak in peaks[np.argsort(-levels[peaks])]:
        distances = np.abs(np.log(frequencies[chosen] / frequencies[peak]))
        differences = np.abs(levels[chosen] - levels[peak])
        if len(chosen) < count and bool(
            ((distances > 0.25) | ((distances > 0.1) & (differences > 6))).all()
        ):
            chosen.append(int(peak))
    return chosen


def _heading(sound: Sound) -> str:
    if not sound.calibrated or not sound.peak:
        return f"{sound.duration:.2f} s, relative level"
    level = 20 * np.log10(sound.peak / _HEARING)
    return f"{sound.duration:.2f} s, peak {quantity(sound.peak, 'Pa', 3)} ({level:.0f} dB)"


def hertz(frequency: float) -> str:
    """Return a frequency in words."""
    return f"{frequency:.1f} Hz" if frequency < 1000 else f"{frequency / 1000:.3f} kHz"


def _dimensions(gains: ShapeGains) -> str:
    size = np.ptp(gains.surface.bounds, axis=0)
    unit, factor = ("mm", 1e3) if size.max() < 1 else ("m", 1.0)
    return " \N{MULTIPLICATION SIGN} ".join(rounded(edge * factor, 3) for edge in size) + f" {unit}"


def description(model: ModalModel) -> str:
    """Return the material and the mass of a body, for a picture's title."""
    name = "" if model.material is None else model.material.name
    mass = "" if model.mass is None else f"{rounded(model.mass, 3)} kg"
    return ", ".join(part for part in (name, mass) if part)

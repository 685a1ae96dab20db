"""Pictures of a report: how a hit sounds and what its modes leave, and how long these ring."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from struck.charts import (
    BLUE,
    FAINT,
    INK,
    ORANGE,
    RANGE,
    chart,
    decibels,
    label_frequencies,
    lighten,
    strongest,
)
from struck.files.sound import Sound
from struck.report.fit_pictures import Played

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

_LINES = 300
_COLUMNS = 500
_WIDE = 11.0


def spectrograms(hit: Played, lowest: float) -> Figure:
    """Draw original, model and residual from a lowest frequency on, on one scale of colours."""
    named = (("original", hit.original), ("model", hit.modes), ("residual", hit.rest))
    seen = [_powers(samples, hit.sample_rate, lowest) for _, samples in named]
    loudest = max(float(seen[0][2].max()), 1e-300)
    figure = chart(_WIDE, 4.2)
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    for axes, (caption, _), (times, frequencies, powers) in zip(panels, named, seen, strict=True):
        levels = 10 * np.log10(np.maximum(powers / loudest, 1e-20))
        axes.pcolormesh(
            times - hit.lead, frequencies, levels, cmap="magma", vmin=-RANGE, vmax=0,
            rasterized=True,
        )  # fmt: skip
        axes.set_title(caption, fontsize=10, color=INK)
        axes.set(xlabel="time (s)", yscale="log")
        label_frequencies(axes.yaxis)
    panels[0].set_ylabel("frequency (Hz)")
    image = panels[0].collections[0]
    bar = figure.colorbar(image, ax=panels, pad=0.01, label="level (dB, loudest = 0)")
    bar.outline.set_visible(False)  # type: ignore[operator] - stubs take an outline for a spine
    return figure


def spectra(hit: Played, frequencies: Array, lowest: float) -> Figure:
    """Draw the spectra of original and residual, with the frequencies of the modes marked."""
    figure = chart(_WIDE, 4.4)
    axes = figure.subplots()
    middles, heard = strongest(_sound(hit.original, hit.sample_rate))
    _, left = strongest(_sound(hit.rest, hit.sample_rate))
    levels = decibels(np.concatenate([heard, left])).reshape(2, -1)
    axes.plot(middles, levels[0], color=BLUE, linewidth=0.9, label="original")
    axes.plot(middles, levels[1], color=ORANGE, linewidth=0.8, alpha=0.8, label="residual")
    if len(frequencies):
        heights = np.interp(frequencies, middles, levels[0])
        axes.vlines(frequencies, heights, 6, color=FAINT, linewidth=0.5, alpha=0.5)
        axes.plot(frequencies, np.full(len(frequencies), 6.0), "v", color=INK, markersize=4,
                  label="modes")  # fmt: skip
    axes.set(xlabel="frequency (Hz)", ylabel="level (dB, strongest = 0)", ylim=(-RANGE, 12))
    _frequency_axis(axes, lowest, hit.sample_rate / 2)
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=3, fontsize=9, frameon=False)
    return figure


def ringing_times(frequencies: Array, decays: Array, errors: Array, highest: float) -> Figure:
    """Draw how long each mode rings, with its standard error where one is known.

    Parameters
    ----------
    frequencies, decays, errors : array (M,)
        Hz, 1/s and the decays' standard errors, 1/s; NaN where unknown.
    highest : float
        Where the axis of frequencies ends, Hz.
    """
    figure = chart(_WIDE, 3.6)
    axes = figure.subplots()
    known = np.isfinite(errors)
    over = np.where(known, errors, 0.0)
    times = np.log(1000) / decays
    # As far as one standard error up and down in the decay, which is not alike in the time.
    longest = np.log(1000) / np.maximum(decays - over, 0.1 * decays)
    ends = [times - np.log(1000) / (decays + over), longest - times]
    axes.errorbar(
        frequencies, times, yerr=ends, fmt="o", color=BLUE, ecolor=ORANGE, elinewidth=1.2,
        capsize=2.5, markersize=4,
    )  # fmt: skip
    axes.set(xlabel="frequency (Hz)", ylabel="T60 (s)", yscale="log")
    label_sizes(axes)
    _frequency_axis(axes, lowest_shown(frequencies), highest)
    return figure


def label_sizes(axes: Axes) -> None:
    """Label a logarithmic axis upwards at 1, 2, 5, 10 ..."""
    from matplotlib.ticker import LogLocator, NullLocator

    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")


def lowest_shown(frequencies: Array) -> float:
    """Return where axes of frequency begin, Hz."""
    return max(20.0, 0.6 * float(frequencies.min())) if len(frequencies) else 20.0


def _powers(samples: Array, sample_rate: int, lowest: float) -> tuple[Array, Array, Array]:
    """Return times (T,), log-spaced frequencies (B,) and powers of all channels (B, T)."""
    sound = _sound(samples, sample_rate)
    step = max(0.002, sound.duration / _COLUMNS)
    times, linear, amplitudes = sound.spectrogram(window=0.05, step=step)
    frequencies = np.geomspace(min(lowest, linear[-1] / 2), linear[-1], _LINES)
    levels = np.log(np.square(amplitudes).sum(axis=0) + 1e-300)
    rows = np.stack([np.interp(frequencies, linear, column) for column in levels.T], axis=1)
    return times, frequencies, np.exp(rows)


def _sound(samples: Array, sample_rate: int) -> Sound:
    return Sound(samples=samples.astype(np.float32), sample_rate=sample_rate)


def _frequency_axis(axes: Axes, lowest: float, highest: float) -> None:
    axes.set_xscale("log")
    axes.set_xlim(min(lowest, highest / 2), highest)
    label_frequencies(axes.xaxis)
    lighten(axes)

"""Pictures of a fit, and the hits it plays: as recorded, as fitted, and the residual."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np

from struck.errors import rounded
from struck.files.sound import Sound
from struck.model.arrays import Array, Mask
from struck.model.picture_style import in_default_style
from struck.model.residual import Residual
from struck.model.survey import Survey
from struck.recordings.gain_table import arrivals
from struck.recordings.poles.search import PoleFit
from struck.recordings.takes import RecordingSet
from struck.report.charts import (
    BLUE,
    FAINT,
    INK,
    ORANGE,
    RANGE,
    chart,
    colour_bar,
    decibels,
    draw_spectrogram,
    frequency_axis,
    label_frequencies,
    lighten,
    plain,
    powers_in_time,
    strongest,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MOST = 6  # Hits that are played
LEAD = 0.1  # recording shown before its hit, s
WIDE = 11.0  # of figures, inches
_EARS = 2
_BACKWARDS = 0.003
_FADE_IN, _FADE_OUT = 0.01, 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RenderedHit:
    """One hit from shortly before it on: as recorded, its modes, and its attack and noise."""

    take: int  # which, counted from 0
    onset: float  # when the hit began in its take, s
    lead: float  # from the beginning of the samples to the hit, s
    original: Array  # (channels, n): as recorded
    modes: Array  # (channels, n): fitted sound, faded at the ends as the original
    beside: Array | None  # (channels, n): attack and noise as the model has them
    sample_rate: int  # Hz

    @property
    def rest(self) -> Array:
        """Recording less the modes (channels, n)."""
        return self.original - self.modes

    @property
    def duration(self) -> float:
        """Length of the sounds, s."""
        return self.original.shape[1] / self.sample_rate

    def sounds(self) -> Iterator[tuple[str, Array]]:
        """Yield captions and samples (channels, n), all on one scale."""
        yield "original", self.original
        yield "model", self.modes
        if self.beside is not None:
            yield "model with residual", self.modes + self.beside
        yield "residual", self.rest

    def shortened(self, seconds: float) -> RenderedHit:
        """Return the beginning of the hit, faded out."""
        length = round(seconds * self.sample_rate)
        if length >= self.original.shape[1]:
            return self
        fade = _fades(length, 0, round(_FADE_OUT * self.sample_rate))
        return self._changed(lambda samples: samples[:, :length] * fade)

    def in_one_channel(self) -> RenderedHit:
        """Return the hit in its loudest channel alone."""
        best = int((self.original**2).sum(axis=1).argmax())
        return self._changed(lambda samples: samples[best, None])

    def _changed(self, change: Callable[[Array], Array]) -> RenderedHit:
        beside = None if self.beside is None else change(self.beside)
        return replace(
            self, original=change(self.original), modes=change(self.modes), beside=beside
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Energies:
    """Energy of each row of a fit, and of its remainder without the modes."""

    signal: Array  # (rows,): sums of squares over the stretch that was fitted
    left: Array  # (rows,): of what the modes leave

    @classmethod
    def of(cls, fitted: PoleFit) -> Energies:
        """Return the energies of every channel of every hit."""
        rows = (fitted.samples_and_model(row) for row in range(len(fitted.rows)))
        energies = [((one**2).sum(), ((one - modes) ** 2).sum()) for one, modes in rows]
        signal, left = np.array(energies).reshape(-1, 2).T
        return cls(signal=signal, left=left)

    def ratio(self, rows: Sequence[int]) -> float:
        """Return signal to residual of some rows, dB; infinite where the residual is zero."""
        chosen = list(rows)
        signal, left = float(self.signal[chosen].sum()), float(self.left[chosen].sum())
        return 10 * np.log10(signal / left) if left > 0 else np.inf


def hits_of(fitted: PoleFit) -> list[list[int]]:
    """Return the rows of a fit hit by hit."""
    rows_by_hit: dict[tuple[int, int], list[int]] = {}
    for row, part in enumerate(fitted.rows):
        rows_by_hit.setdefault((part.take, part.hit), []).append(row)
    return list(rows_by_hit.values())


def chosen_hits(fitted: PoleFit, energies: Energies, most: int = MOST) -> list[list[int]]:
    """Return the rows of hits worth hearing: the loudest, then others spread over the takes."""
    hits = sorted(hits_of(fitted), key=lambda rows: -energies.signal[rows].max())
    loudest, others = hits[0], hits[1:]
    takes: dict[int, list[int]] = {}
    for rows in others:
        takes.setdefault(fitted.rows[rows[0]].take, rows)
    has_several = len({row.take for row in fitted.rows}) > 1
    if has_several:
        takes.pop(fitted.rows[loudest[0]].take, None)
    spread = sorted(takes.values() if has_several else others)
    places = np.linspace(0, len(spread) - 1, min(most - 1, len(spread))).round().astype(int)
    return [loudest, *(spread[place] for place in places)]


def setting_in(fitted: PoleFit, recorded: RecordingSet, lead: float) -> Array:
    """Return when the modes of each row set in (rows,), s in its take."""
    # As long after the sound arrived as the model has it, but little before the fitted part: run
    # backwards, fast modes grow beyond all bounds.
    times = np.array([row.time for row in fitted.rows])
    return np.maximum(arrivals(fitted, recorded) + lead, times - _BACKWARDS)


def played(
    fitted: PoleFit, recorded: RecordingSet, rows: Sequence[int], times: Array
) -> RenderedHit:
    """Return one hit of some rows, in the loudest channel where there are more than two."""
    recordings = [fitted.samples_and_model(row)[0] for row in rows]
    if len(rows) > _EARS:
        loudest_index = int(np.argmax([(recording**2).sum() for recording in recordings]))
        rows, recordings = [rows[loudest_index]], [recordings[loudest_index]]
    part = fitted.rows[rows[0]]
    take = recorded.takes[part.take]
    rate = take.sample_rate
    onset = round(part.onset * rate)
    first, last = max(0, onset - round(LEAD * rate)), round(part.time * rate) + len(recordings[0])
    original = take.samples[[fitted.rows[row].channel for row in rows], first:last]
    modes = np.zeros_like(original)
    for channel, row in enumerate(rows):
        start = min(max(first, round(times[row] * rate)), last)
        modes[channel, start - first :] = fitted.ringing(row, start / rate, last - start)
    fade_gains = _fades(last - first, round(_FADE_IN * rate), round(_FADE_OUT * rate))
    return RenderedHit(
        take=part.take,
        onset=part.onset,
        lead=(onset - first) / rate,
        original=original * fade_gains,
        modes=modes * fade_gains,
        beside=None,
        sample_rate=rate,
    )


def with_residual(hit: RenderedHit, residual: Residual, distance: float) -> RenderedHit:
    """Return the loudest hit with attack and noise as well, recorded from `distance` m away."""
    # They are those of the channel that holds most; in another they are as loud as what is left.
    residual_samples = residual.samples(hit.sample_rate) / distance
    first = round(hit.lead * hit.sample_rate)
    shifted_samples = np.zeros(hit.original.shape[1])
    part = residual_samples[: len(shifted_samples) - first]
    shifted_samples[first : first + len(part)] = part
    levels = np.sqrt((hit.rest**2).sum(axis=1))
    loudest_channel = int((hit.original**2).sum(axis=1).argmax())
    factors = levels / max(float(levels[loudest_channel]), 1e-300)
    fade_gains = _fades(len(shifted_samples), 0, round(_FADE_OUT * hit.sample_rate))
    return replace(hit, beside=cast("Array", np.outer(factors, shifted_samples * fade_gains)))


def _fades(length: int, rising: int, falling: int) -> Array:
    """Return factors (length,) that rise from 0 at the beginning and fall to it at the end."""
    factors = np.ones(length)
    up, down = min(rising, length), min(falling, length)
    factors[:up] *= np.sin(np.linspace(0, np.pi / 2, up)) ** 2
    factors[length - down :] *= np.cos(np.linspace(0, np.pi / 2, down)) ** 2
    return factors


# Spectra of a hit and of what its modes leave, and how long these ring.


@in_default_style
def spectrograms(hit: RenderedHit, lowest: float) -> Figure:
    """Draw original, model and residual from a lowest frequency on, on one scale of colours."""
    spectra_parts = (("original", hit.original), ("model", hit.modes), ("residual", hit.rest))
    spectra_rows = [
        powers_in_time(_sound(samples, hit.sample_rate), lowest, columns=500, rows=300)[:3]
        for _, samples in spectra_parts
    ]
    loudest = max(float(spectra_rows[0][2].max()), 1e-300)
    figure = chart(WIDE, 4.2)
    panels = figure.subplots(1, 3, sharex=True, sharey=True)
    for axes, (caption, _), (times, frequencies, powers) in zip(
        panels, spectra_parts, spectra_rows, strict=True
    ):
        levels = 10 * np.log10(np.maximum(powers / loudest, 1e-20))
        draw_spectrogram(axes, times - hit.lead, frequencies, levels)
        axes.set_title(caption, fontsize=10, color=INK)
    panels[0].set_ylabel("frequency (Hz)")
    colour_bar(figure, panels[0].collections[0], list(panels), "level (dB, loudest = 0)")
    return figure


@in_default_style
def spectra(hit: RenderedHit, frequencies: Array, sure: Mask, lowest: float) -> Figure:
    """Draw the spectra of original and residual, with the `sure` modes (M,) and others marked."""
    figure = chart(WIDE, 4.4)
    axes = figure.subplots()
    centre_frequencies, original_spectrum = strongest(_sound(hit.original, hit.sample_rate))
    _, residual_spectrum = strongest(_sound(hit.rest, hit.sample_rate))
    levels = decibels(np.concatenate([original_spectrum, residual_spectrum])).reshape(2, -1)
    axes.plot(centre_frequencies, levels[0], color=BLUE, linewidth=0.9, label="original")
    axes.plot(
        centre_frequencies, levels[1], color=ORANGE, linewidth=0.8, alpha=0.8, label="residual"
    )
    kinds = ((sure, INK, "modes"), (~sure, FAINT, "of the blow, or vague"))
    for tones, colour, label in ((frequencies[is_kind], *style) for is_kind, *style in kinds):
        if len(tones):
            heights = np.interp(tones, centre_frequencies, levels[0])
            axes.vlines(tones, heights, 6, color=FAINT, linewidth=0.5, alpha=0.5)
            axes.plot(tones, np.full(len(tones), 6.0), "v", color=colour, markersize=4, label=label)
    axes.set(xlabel="frequency (Hz)", ylabel="level (dB, strongest = 0)", ylim=(-RANGE, 12))
    nyquist = hit.sample_rate / 2
    frequency_axis(axes, min(lowest, nyquist / 2), nyquist)
    axes.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=4, fontsize=9, frameon=False)
    return figure


# `errors`: standard errors of the decays, 1/s, NaN where unknown; `highest`: of the axis, Hz.
@in_default_style
def ringing_times(frequencies: Array, decays: Array, errors: Array, highest: float) -> Figure:
    """Draw how long each mode rings, with its standard error where one is known."""
    figure = chart(WIDE, 3.6)
    axes = figure.subplots()
    over = np.where(np.isfinite(errors), errors, 0.0)
    times = np.log(1000) / decays
    # As far as one standard error up and down in the decay, which is not symmetric in the time.
    longest = np.log(1000) / np.maximum(decays - over, 0.1 * decays)
    ends = [times - np.log(1000) / (decays + over), longest - times]
    axes.errorbar(
        frequencies, times, yerr=ends, fmt="o", color=BLUE, ecolor=ORANGE, elinewidth=1.2,
        capsize=2.5, markersize=4,
    )  # fmt: skip
    axes.set(xlabel="frequency (Hz)", ylabel="T60 (s)", yscale="log")
    label_sizes(axes)
    frequency_axis(axes, min(lowest_shown(frequencies), highest / 2), highest)
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


def _sound(samples: Array, sample_rate: int) -> Sound:
    return Sound(samples=samples.astype(np.float32), sample_rate=sample_rate)


# Gains over contacts and listeners.

_DEEP = 40.0  # Levels that a map shows below the loudest place of each mode, dB
_LABELS = 24
_SAME = 1e-6


@in_default_style
def rank_errors(frequencies: Array, errors: Array, unmeasured: Mask) -> Figure:
    """Draw how far each mode's gains are from a product of contact and listener, %."""
    figure = chart(WIDE, 3.2)
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


@in_default_style
def gain_map(
    levels: Array, frequencies: Array, places: Sequence[str], unmeasured: Mask, what: str
) -> Figure:
    """Draw how loud each mode is at each place, dB below its loudest place (P, M)."""
    figure = chart(WIDE, float(np.clip(0.24 * len(places) + 1.8, 2.6, 8.0)))
    axes = figure.subplots()
    image = axes.imshow(
        levels, aspect="auto", cmap="viridis", vmin=-_DEEP, vmax=0, interpolation="nearest"
    )
    axes.set_title("each mode below its loudest place", fontsize=9, color=INK, loc="left")
    _label_modes(axes, frequencies, unmeasured)
    shown = _spread(len(places))
    axes.set_yticks(shown, [places[place] for place in shown], fontsize=8)
    axes.set(ylabel=plain(what), xlabel="mode (Hz)")
    colour_bar(figure, image, [axes], "level (dB)")
    return figure


def levels_at(survey: Survey, side: int) -> Array:
    """Return levels of modes at contacts (side 0) or listeners (side 1), dB (places, M)."""
    # Root mean squares over the other side, below each mode's loudest place; NaN where nothing was
    # recorded.
    count = len(survey.contacts if side == 0 else survey.listeners)
    powers = np.full((count, len(survey.frequencies)), np.nan)
    squares = np.square(np.abs(survey.gains))
    for place in np.unique(survey.pairs[:, side]):
        powers[place] = squares[survey.pairs[:, side] == place].mean(axis=0)
    loudest = np.maximum(np.nanmax(powers, axis=0), 1e-300)
    return np.asarray(10 * np.log10(np.maximum(powers / loudest, 1e-20)), np.float64)


def named(places: Array) -> list[str]:
    """Return coordinates (n, D) as text, with rounding errors about zero written as 0."""
    step = max(float(np.abs(places).max()), 1e-300) * _SAME
    rounded_places = np.round(places / step) * step + 0.0
    return [", ".join(rounded(value, 3) for value in place) for place in rounded_places]


def _label_modes(axes: Axes, frequencies: Array, unmeasured: Mask) -> None:
    shown = _spread(len(frequencies), 2 * _LABELS)
    axes.set_xticks(shown, [f"{frequencies[mode]:.0f}" for mode in shown], rotation=90, fontsize=8)
    axes.tick_params(length=0)
    marked_indices = np.flatnonzero(unmeasured)
    if len(marked_indices):
        above = axes.secondary_xaxis("top")
        above.set_xticks(
            marked_indices, ["\N{MULTIPLICATION SIGN}"] * len(marked_indices), color=ORANGE
        )
        above.tick_params(length=0)
        axes.set_title(
            "\N{MULTIPLICATION SIGN} not measured", fontsize=9, color=ORANGE, loc="right"
        )
    axes.xaxis.label.set_color(INK)


def _spread(count: int, most: int = _LABELS) -> list[int]:
    """Return at most `most` numbers below the count, spread evenly."""
    return list(range(0, count, -(-count // most)))

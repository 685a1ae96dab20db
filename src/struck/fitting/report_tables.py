"""Words and tables of a report: what was found, how sure it is, and in which takes."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

import numpy as np
from numpy.typing import NDArray

from struck.recordings.gain_table import Recorded
from struck.recordings.poles.fitted import Fitted
from struck.recordings.poles.verdict import LEAST, Verdict
from struck.report.fit_pictures import Energies, hits_of
from struck.tables import note

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

MODES = ("mode", "Hz", "note", "\u00b1 Hz", "T60 (s)", "\u00b1 %", "Q", "level (dB)")
"""Headings of the table of modes."""
PLACES = ("rank error (%)", "measured")
"""Further ones, of gains over contacts and listeners."""
ROOM = ("of the room",)
"""One more, where the room's reverberation was told."""
TAKES = ("take", "hits", "channels", "peak (dB FS)", "lead-in (dB FS)", "signal to residual (dB)")
"""Headings of the table of takes."""
_LITTLE = 20.0
_HARDLY_ANY = 30.0
_OF_NOISE = 3.0


def verdict_lines(verdict: Verdict, count: int) -> list[str]:
    """Return what to think of a fit of so many modes, in plain words."""
    if not verdict.modal:
        return [f"Not modal: {verdict.reason}.", *([_ratio(verdict)] if count else [])]
    return ["Modal: decaying modes explain what was recorded.", _ratio(verdict)]


def _ratio(verdict: Verdict) -> str:
    ratio = verdict.signal_to_residual
    if not np.isfinite(ratio):
        return "The modes leave nothing."
    share = 100 * 10 ** (-ratio / 10)
    return (
        f"Signal to residual {ratio:.1f} dB: what the modes leave holds {share:.2g} % of the "
        f"energy; {_meaning(verdict)}."
    )


def _meaning(verdict: Verdict) -> str:
    ratio = verdict.signal_to_residual
    if verdict.signal_to_misfit > ratio + _OF_NOISE:
        return "most of that is the noise of the recording"
    if ratio >= _HARDLY_ANY:
        return "hardly anything is missing"
    if ratio >= _LITTLE:
        return "little is missing: as a rule the attack, and the room"
    if ratio >= LEAST:
        return "part of the sound is missing: attack, room, noise; listen to the residual"
    return "the modes are not what one hears"


def modes_line(frequencies: Array, decays: Array) -> str:
    """Return how many modes there are, how high, and how long they ring."""
    count = len(frequencies)
    if not count:
        return "No modes were found."
    times = np.log(1000) / np.maximum(decays, np.finfo(float).tiny)
    low, high = frequencies.min(), frequencies.max()
    return (
        f"{counted(count, 'mode')} from {low:.1f} to {high:.1f} Hz, which fall by 60 dB in "
        f"{times.min():.2g} to {times.max():.2g} s."
    )


def mode_table(fitted: Fitted, known: Mask) -> list[list[str]]:
    """Return a row for each mode, under `MODES`.

    Parameters
    ----------
    fitted : Fitted
    known : array (M,)
        Of which modes the errors are known.
    """
    columns = (
        fitted.frequencies,
        np.where(known, fitted.frequency_errors, np.nan),
        np.maximum(fitted.decays, 1e-300),
        np.where(known, fitted.decay_errors, np.nan),
        _levels(fitted),
    )
    return [
        [str(number), *_mode_row(*values)]
        for number, values in enumerate(zip(*columns, strict=True), start=1)
    ]


def _mode_row(
    frequency: float, frequency_error: float, decay: float, decay_error: float, level: float
) -> list[str]:
    quality = np.pi * frequency / decay
    return [
        f"{frequency:.3f}",
        note(frequency),
        figure(frequency_error),
        figure(np.log(1000) / decay, 3),
        figure(100 * decay_error / decay),
        figure(quality, 3) if quality < 100 else f"{quality:.0f}",
        f"{level:.1f}" if np.isfinite(level) else "-",
    ]


def place_columns(rank_errors: Array, unmeasured: Mask) -> list[list[str]]:
    """Return what there is to tell of each mode's gains, under `PLACES`."""
    return [
        [figure(100 * error), "not measured" if lost else "yes"]
        for error, lost in zip(rank_errors, unmeasured, strict=True)
    ]


def take_table(fitted: Fitted, recorded: Recorded, energies: Energies) -> list[list[str]]:
    """Return a row for each take, under `TAKES`."""
    names = short_names(recorded)
    return [
        _take_row(names[number], number, fitted, recorded, energies)
        for number in range(len(recorded.takes))
    ]


def short_names(recorded: Recorded) -> list[str]:
    """Return the names of takes without folders, where that tells them apart."""
    names = [take.name for take in recorded.takes]
    short = [PurePath(name).name or name for name in names]
    return short if len(set(short)) == len(set(names)) else names


def counted(count: int, thing: str) -> str:
    """Return so many of a thing."""
    return f"{count} {thing}{'s' * (count != 1)}"


def figure(value: float, digits: int = 2) -> str:
    """Return a number of so many digits, without an exponent; a dash where it is unknown."""
    if not np.isfinite(value):
        return "-"
    return np.format_float_positional(value, digits, fractional=False, trim="-")


def _levels(fitted: Fitted) -> Array:
    """Return how loud modes are where they are loudest, dB below the loudest of all (M,)."""
    sizes = np.abs(fitted.gains).max(axis=0, initial=0.0)
    with np.errstate(divide="ignore"):
        return np.asarray(20 * np.log10(sizes / sizes.max(initial=1e-300)), np.float64)


def _take_row(
    name: str, number: int, fitted: Fitted, recorded: Recorded, energies: Energies
) -> list[str]:
    take = recorded.takes[number]
    hits = [rows for rows in hits_of(fitted) if fitted.rows[rows[0]].take == number]
    rows = [row for hit in hits for row in hit]
    return [
        name,
        str(len(hits)),
        str(take.channels),
        f"{_decibels(float(np.abs(take.samples).max())):.1f}",
        _lead_in(fitted, rows),
        f"{energies.ratio(rows):.1f}" if rows else "-",
    ]


def _lead_in(fitted: Fitted, rows: Sequence[int]) -> str:
    """Return the level of the sound before the first hit."""
    before = [_before(fitted, row) for row in rows]
    heard = [samples for samples in before if samples.size]
    if not heard:
        return "-"
    level = _decibels(float(np.sqrt(np.mean([np.mean(samples**2) for samples in heard]))))
    return f"{level:.1f}" if np.isfinite(level) else "silent"


def _before(fitted: Fitted, row: int) -> Array:
    place = int(fitted.order[row])
    segment = next(each for each in fitted.segments if place < each.rows.stop)
    return segment.before[place - segment.rows.start]


def _decibels(size: float) -> float:
    return float(20 * np.log10(size)) if size > 0 else -np.inf

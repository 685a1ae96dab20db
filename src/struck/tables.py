"""Tables of modes for people: frequency, note, decay."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from struck.model.html import table

Array = NDArray[np.float64]
_NAMES = ("C", "C#", "D", "D#", "E", "F", "F#", "G", "G#", "A", "A#", "B")
HEADINGS = ("Hz", "note", "T60 (s)", "Q", "error (%)")


def note(frequency: float) -> str:
    """Return the nearest equal-tempered note (A4 = 440 Hz) with the cents beside it."""
    semitones = 69 + 12 * math.log2(frequency / 440)
    nearest = round(semitones)
    cents = round(100 * (semitones - nearest))
    return f"{_NAMES[nearest % 12]}{nearest // 12 - 1} {cents:+d}"


def modes_rows(
    frequencies: Array, t60: Array, decays: Array, errors: Array | None
) -> list[tuple[str, ...]]:
    """Return one row of text a mode, under `HEADINGS`."""
    known = np.full(len(frequencies), np.nan) if errors is None else errors
    return [
        (
            f"{f:.2f}",
            note(f),
            f"{t:.3g}" if d else "endless",
            f"{math.pi * f / d:.4g}" if d else "endless",
            f"{100 * e:.2g}" if np.isfinite(e) else "-",
        )
        for f, t, d, e in zip(frequencies, t60, decays, known, strict=True)
    ]


def modes_table(frequencies: Array, t60: Array, decays: Array, errors: Array | None) -> str:
    """Return the modes as an HTML table."""
    return table(HEADINGS, modes_rows(frequencies, t60, decays, errors))


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Return rows as text in columns, the first to the left, the others to the right."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    )

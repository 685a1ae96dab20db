"""HTML pages that need no other file, and tables of modes in HTML and in text."""

from __future__ import annotations

import base64
import html
import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np

from struck.errors import rounded
from struck.model.damping import NAMES
from struck.model.picture_style import in_default_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from struck.model.arrays import Array, Index, Mask

# The look of all pages.
STYLE = """\
body { font: 16px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 68rem;
  padding: 0 1rem; color: #222; background: #fbfaf8; }
section { margin: 2rem 0; padding: 1.5rem; background: #fff; border-radius: 8px;
  box-shadow: 0 1px 4px #0002; }
h1, h2 { font-weight: 600; margin-top: 0; }
img { max-width: 100%; }
.sounds { display: flex; flex-wrap: wrap; gap: 1rem; }
figure { margin: 0; flex: 1 1 26rem; max-width: 32rem; }
figcaption { font-size: .9rem; color: #555; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
td, th { padding: .15rem .8rem; text-align: right; }
th { position: sticky; top: 0; background: #fff; border-bottom: 1px solid #bbb; }
"""

PAGES = (".html", ".htm")  # endings of their files


def document(title: str, body: str, *, style: str = "") -> str:
    """Return an HTML page with a title (text), a body (HTML) and CSS besides `STYLE`."""
    name = html.escape(title)
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>{name}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><style>\n'
        f"{STYLE}{style}</style></head><body><h1>{name}</h1>\n{body}\n</body></html>\n"
    )


@in_default_style
def picture(text: str, figure: Figure) -> str:
    """Return a figure as an image within the page, with `text` for blind readers."""
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=110)
    image_text = base64.b64encode(data.getvalue()).decode("ascii")
    return f'<img alt="{html.escape(text)}" src="data:image/png;base64,{image_text}">'


def table(headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return an HTML table of text cells."""
    head = "".join(f"<th>{html.escape(heading)}</th>" for heading in headings)
    body = "".join(
        f"<tr>{''.join(f'<td>{html.escape(cell)}</td>' for cell in row)}</tr>" for row in rows
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


class DecayingModes(Protocol):
    """Modes of a model, as their table needs them."""

    @property
    def frequencies(self) -> Array:
        """Ringing frequencies (M,), Hz."""
        ...

    @property
    def decays(self) -> Array:
        """Decay rates (M,), 1/s."""
        ...

    @property
    def t60(self) -> Array:
        """Times of a decay by 60 dB (M,), s."""
        ...

    @property
    def errors(self) -> Array | None:
        """Relative errors of the frequencies (M,)."""
        ...

    @property
    def decay_bounds(self) -> tuple[Array, Array] | None:
        """Lowest and highest decay rates (M,), 1/s."""
        ...


HEADINGS = ("Hz", "note", "T60 (s)", "Q", "error (%)")


def note(frequency: float) -> str:
    """Return the nearest equal-tempered note (A4 = 440 Hz) and the distance from it in cents.

    A mode that damping keeps from ringing, at 0 Hz, has none: "-".
    """
    if not frequency:
        return "-"
    semitones = 69 + 12 * math.log2(frequency / 440)
    nearest = round(semitones)
    return f"{NAMES[nearest % 12]}{nearest // 12 - 1} {round(100 * (semitones - nearest)):+d}"


def modes_rows(model: DecayingModes, modes: Index | Mask) -> list[tuple[str, ...]]:
    """Return one row of text for each of some modes of a model, under `headings`."""
    errors = np.full(len(model.decays), np.nan) if model.errors is None else model.errors
    rows = [
        (
            f"{frequency:.2f}",
            note(frequency),
            rounded(t60, 3) if decay else "endless",
            rounded(math.pi * frequency / decay, 4) if decay else "endless",
            rounded(100 * error, 2) if np.isfinite(error) else "-",
        )
        for frequency, t60, decay, error in zip(
            model.frequencies[modes],
            model.t60[modes],
            model.decays[modes],
            errors[modes],
            strict=True,
        )
    ]
    if model.decay_bounds is None:
        return rows
    low, high = (bound[modes] for bound in model.decay_bounds)
    return [
        (*row, f"{_ringing_time(fast)} to {_ringing_time(slow)}")
        for row, slow, fast in zip(rows, low, high, strict=True)
    ]


def _ringing_time(decay: float) -> str:
    """Return the time of a decay by 60 dB as text, s."""
    return rounded(math.log(1000) / decay, 2) if decay else "endless"


def headings(model: DecayingModes) -> tuple[str, ...]:
    """Return the headings of `modes_rows`; the last is of uncertain losses to the air."""
    return HEADINGS if model.decay_bounds is None else (*HEADINGS, "T60 within (s)")


def modes_table(model: DecayingModes, modes: Index | Mask) -> str:
    """Return some modes of a model as an HTML table."""
    return table(headings(model), modes_rows(model, modes))


def aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    """Return rows as lines of text in columns, the first to the left, the others to the right."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    return [
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in rows
    ]

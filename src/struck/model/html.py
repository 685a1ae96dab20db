"""HTML pages that need no other file, and tables of modes in HTML and in text."""

from __future__ import annotations

import base64
import html
import io
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from struck.errors import rounded
from struck.model.arrays import Array
from struck.model.damping import NAMES
from struck.model.picture_style import in_default_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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


def modes_rows(
    frequencies: Array, t60: Array, decays: Array, errors: Array | None
) -> list[tuple[str, ...]]:
    """Return one row of text for each mode, under `HEADINGS`."""
    mode_errors = np.full(len(frequencies), np.nan) if errors is None else errors
    return [
        (
            f"{f:.2f}",
            note(f),
            rounded(t, 3) if d else "endless",
            rounded(math.pi * f / d, 4) if d else "endless",
            rounded(100 * e, 2) if np.isfinite(e) else "-",
        )
        for f, t, d, e in zip(frequencies, t60, decays, mode_errors, strict=True)
    ]


def modes_table(frequencies: Array, t60: Array, decays: Array, errors: Array | None) -> str:
    """Return the modes as an HTML table."""
    return table(HEADINGS, modes_rows(frequencies, t60, decays, errors))


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

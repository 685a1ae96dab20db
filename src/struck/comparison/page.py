"""One HTML page that shows how two bodies differ, and plays both."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from struck.comparison.pictures import COLOURS
from struck.sound import Sound

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    return _PAGE.format(
        title=html.escape(" and ".join(names)),
        lines="".join(f"<li>{html.escape(line)}</li>" for line in lines),
        sounds="".join(_heard(*each) for each in heard),
        pictures="".join(_image(caption, figure) for caption, figure in pictures),
        table=_table(rows),
        alone="".join(_alone(*each) for each in zip(names, alone, strict=True)),
    )


def _heard(name: str, sound: Sound, picture: Figure, colour: str) -> str:
    return (
        f'<figure><figcaption><b style="color:{colour}">{html.escape(name)}</b></figcaption>'
        f"{sound._repr_html_()}{_image(f'Spectrogram of the {name}', picture)}</figure>"
    )


def _table(rows: Sequence[Sequence[str]]) -> str:
    head = "".join(f"<th>{heading}</th>" for heading in HEADINGS)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"


def _alone(name: str, frequencies: NDArray[np.float64]) -> str:
    told = ", ".join(f"{frequency:.1f}" for frequency in frequencies) or "none"
    return f"<p><b>In the {html.escape(name)} alone</b> (Hz): {told}</p>"


def _image(text: str, figure: Figure) -> str:
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=110)
    encoded = base64.b64encode(data.getvalue()).decode("ascii")
    return f'<img alt="{html.escape(text)}" src="data:image/png;base64,{encoded}">'


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>struck: {title}</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>
body {{ font: 16px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 68rem;
  padding: 0 1rem; color: #222; background: #fbfaf8; }}
section {{ margin: 2rem 0; padding: 1.5rem; background: #fff; border-radius: 8px;
  box-shadow: 0 1px 4px #0002; }}
h1, h2 {{ font-weight: 600; margin-top: 0; }}
img {{ max-width: 100%; }}
.sounds {{ display: flex; flex-wrap: wrap; gap: 1rem; }}
figure {{ margin: 0; flex: 1 1 26rem; }}
button {{ font: inherit; padding: .3rem 1rem; margin-bottom: 1rem; }}
.modes {{ max-height: 32rem; overflow: auto; }}
table {{ border-collapse: collapse; font-variant-numeric: tabular-nums; }}
td, th {{ padding: .15rem .8rem; text-align: right; }}
th {{ position: sticky; top: 0; background: #fff; border-bottom: 1px solid #bbb; }}
</style></head><body><h1>{title}</h1>
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
</body></html>
"""

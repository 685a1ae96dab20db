"""One HTML page that shows how two bodies differ, and plays both."""

from __future__ import annotations

import html
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from struck.comparison.pictures import COLOURS
from struck.files.sound import Sound
from struck.model.html import document, picture, table

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

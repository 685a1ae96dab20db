"""Players of a report: each hit as recorded and as fitted, one switched for the other."""

from __future__ import annotations

import base64
import html

import numpy as np

from struck.files import wav
from struck.files.sound import PEAK
from struck.model.arrays import Array
from struck.report.fit_pictures import RenderedHit

_BYTES = 2 * 4 / 3
"""Of one sample of 16 bits, as text."""
_SHORTER = 0.1
"""A sound may lack so much of its end without a word, s."""

STYLE = """\
.hit + .hit, .hit + details { margin-top: 1.5rem; }
.hit + .hit { border-top: 1px solid #ddd; padding-top: 1rem; }
summary { cursor: pointer; margin-bottom: 1rem; }
.hit p { margin: 0 0 .5rem; overflow-wrap: anywhere; }
.hit figure { flex: 1 1 13rem; }
.hit button { font: inherit; font-weight: 600; padding: .2rem .8rem; border-radius: 6px;
  border: 1px solid #20558a; background: #fff; color: #20558a; cursor: pointer; }
.hit .playing button { background: #20558a; color: #fff; }
.hit audio { width: 100%; margin-top: .4rem; }
"""
SCRIPT = """\
for (const hit of document.querySelectorAll(".hit")) {
  const sounds = [...hit.querySelectorAll("audio")];
  hit.querySelectorAll("button").forEach((button, which) => button.addEventListener("click", () => {
    const now = sounds.find((each) => !each.paused && !each.ended);
    const next = sounds[which];
    if (now === next) return next.pause();
    next.currentTime = now ? now.currentTime : 0;
    if (now) now.pause();
    next.play();
  }));
}
for (const kind of ["play", "pause", "ended"])
  document.addEventListener(kind, (event) => {
    event.target.closest("figure").classList.toggle("playing", kind === "play");
    if (kind === "play")
      for (const each of document.querySelectorAll("audio"))
        if (each !== event.target) each.pause();
  }, true);
"""
"""A button goes on where the sound that plays is; one that plays silences all others."""


def player(told: str, hit: RenderedHit, size: float) -> str:
    """Return the sounds of one hit on one scale, the loudest 1 dB below full scale.

    Parameters
    ----------
    told : str
        What it is, as text.
    hit : Played
    size : float
        What it may take in the page, bytes: longer ones are shortened, and the player says so.
    """
    count = sum(1 for _ in hit.sounds()) * len(hit.original)
    heard = hit.shortened(size / (_BYTES * count * hit.sample_rate))
    if hit.duration - heard.duration > _SHORTER:
        told = f"{told}; its first {heard.duration:.1f} s of {hit.duration:.1f}"
    loudest = max(float(np.abs(samples).max()) for _, samples in heard.sounds())
    factor = PEAK / loudest if loudest else 1.0
    sounds = "".join(
        f'<figure><figcaption><button type="button">{caption}</button>'
        f"</figcaption>{_audio(factor * samples, heard.sample_rate)}</figure>"
        for caption, samples in heard.sounds()
    )
    return f'<div class="hit"><p>{html.escape(told)}</p><div class="sounds">{sounds}</div></div>'


def _audio(samples: Array, sample_rate: int) -> str:
    recording = wav.Recording(samples=samples.astype(np.float32), sample_rate=sample_rate)
    data = base64.b64encode(wav.encode(recording, "int16")).decode("ascii")
    return f'<audio controls src="data:audio/wav;base64,{data}"></audio>'

"""Stems: the sound of each body of a scene by itself, in files that add up to the whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from struck.files.sound import FULL_SCALE
from struck.scene.body import Scene
from struck.scene.render import render

if TYPE_CHECKING:
    from struck.ears.listeners import Listener
    from struck.ears.room import Room


def save_stems(
    scene: Scene,
    whole: Path,
    *,
    factor: float,
    seconds: float,
    listener: Listener | None,
    room: Room | None = None,
    sample_rate: int = 48_000,
) -> list[Path]:
    """Write what is heard of each body beside the file of all, and return the files.

    Parameters
    ----------
    scene : Scene
        Its bodies excited.
    whole : Path
        WHOLE.wav, beside which WHOLE.BODY.wav are written.
    factor : float
        What the samples of the whole were multiplied by in its file; so are these.
    seconds, listener, room, sample_rate
        As for `render`.
    """
    written = []
    for name, body in scene.bodies.items():
        if body.silent or not body.actions:
            continue
        alone = render(
            [body], listener=listener, room=room, seconds=seconds, sample_rate=sample_rate
        )
        safe = "".join(letter if letter.isalnum() or letter in "-_" else "_" for letter in name)
        written.append(whole.with_name(f"{whole.stem}.{safe}.wav"))
        scaled = replace(alone, samples=alone.samples * (factor * FULL_SCALE))
        scaled.save(written[-1], level="absolute")
    return written

"""Stems: the sound of each body of a scene by itself, in files that add up to the whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from struck.files.sound import FULL_SCALE
from struck.scene.body import Scene
from struck.scene.ending import faded, is_cut_off
from struck.scene.render import render


def save_stems(scene: Scene, path: Path, *, factor: float, **heard: Any) -> list[Path]:  # noqa: ANN401 - of `render`
    """Write one file with the sound of each excited body next to that of all; return the paths.

    `factor` is what the samples of all, in the file at `path`, were multiplied by; so are those of
    stems, which fade out together if what they add up to is cut off. `heard` are the options of
    `render`.
    """
    fade = heard.pop("fade", None)
    excited = {n: body for n, body in scene.bodies.items() if not body.silent and body.actions}
    stems = {name: render([body], **heard, fade=0) for name, body in excited.items()}
    longest = max((sound.samples.shape[1] for sound in stems.values()), default=0)
    padded = [
        np.pad(sound.samples, ((0, 0), (0, longest - sound.samples.shape[1])))
        for sound in stems.values()
    ]
    total = np.sum(padded, axis=0)
    written = []
    for name, sound in stems.items():
        samples = sound.samples
        if fade != 0 and is_cut_off(total, sound.sample_rate):
            samples = faded(samples, sound.sample_rate, fade)
        safe = "".join(each if each.isalnum() or each in "-_" else "_" for each in name)
        written.append(path.with_name(f"{path.stem}.{safe}.wav"))
        scaled = replace(sound, samples=samples * (factor * FULL_SCALE))
        scaled.save(written[-1], level="absolute")
    return written

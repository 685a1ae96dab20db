"""Stems: the separate sound of each body of a scene, in files that add up to the mix."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from struck.files.sound import FULL_SCALE
from struck.scene.body import Scene
from struck.scene.ending import faded, is_cut_off
from struck.scene.render import render


def save_stems(scene: Scene, path: Path, *, factor: float, **options: Any) -> list[Path]:  # noqa: ANN401 - of `render`
    """Write one file with the sound of each excited body next to that of all; return the paths.

    `factor` is what the samples of all, in the file at `path`, were multiplied by; so are those of
    stems, which fade out together if what they add up to is cut off. `options` are those of
    `render`.
    """
    fade = options.pop("fade", None)
    excited_bodies = {
        n: body for n, body in scene.bodies.items() if not body.silent and body.actions
    }
    stems = {name: render([body], **options, fade=0) for name, body in excited_bodies.items()}
    longest = max((sound.samples.shape[1] for sound in stems.values()), default=0)
    padded_samples = [
        np.pad(sound.samples, ((0, 0), (0, longest - sound.samples.shape[1])))
        for sound in stems.values()
    ]
    mix = np.sum(padded_samples, axis=0)
    paths = []
    for name, sound in stems.items():
        samples = sound.samples
        if fade != 0 and is_cut_off(mix, sound.sample_rate):
            samples = faded(samples, sound.sample_rate, fade)
        safe = "".join(
            character if character.isalnum() or character in "-_" else "_" for character in name
        )
        paths.append(path.with_name(f"{path.stem}.{safe}.wav"))
        stem = replace(sound, samples=samples * (factor * FULL_SCALE))
        stem.save(paths[-1], level="absolute")
    return paths

"""Stems: the sound of each body of a scene by itself, in files that add up to the whole."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from struck.files.sound import FULL_SCALE
from struck.scene.body import Scene
from struck.scene.render import render


def save_stems(scene: Scene, whole: Path, *, factor: float, **heard: Any) -> list[Path]:  # noqa: ANN401 - of `render`
    """Write one file with the sound of each excited body next to the whole; return the paths.

    `factor` is what the samples of the whole were multiplied by in its file; so are these. The
    rest is said to `render`.
    """
    written = []
    for name, body in scene.bodies.items():
        if not body.silent and body.actions:
            alone = render([body], **heard)
            safe = "".join(each if each.isalnum() or each in "-_" else "_" for each in name)
            written.append(whole.with_name(f"{whole.stem}.{safe}.wav"))
            scaled = replace(alone, samples=alone.samples * (factor * FULL_SCALE))
            scaled.save(written[-1], level="absolute")
    return written

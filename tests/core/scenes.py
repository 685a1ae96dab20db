"""Scenes of resonators by chance, remade from their seeds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from struck.excitation.excitation import Push
from struck.synth.resonators import Resonators

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Modes:
    frequencies: Array
    decays: Array


# Modes of each body, block, output points, complex outputs, voices of each body.
SCENES = {
    "real, steady": ((40, 13), 128, 1, False, 1),
    "complex, blocks with a remainder": ((24, 7), 100, 2, True, 2),
    "many voices and points": ((17,), 64, 9, True, 6),
    "few samples": ((50,), 5, 1, False, 3),
}
BLOCKS = 12


def played(name: str, engine: Callable[..., Resonators] = Resonators) -> Array:
    """Return the last blocks of a scene in which gains, poles and pushes come, move and go."""
    counts, block, points, turned, voices = SCENES[name]
    rng = np.random.default_rng(list(SCENES).index(name))
    bodies = [
        Modes(frequencies=rng.uniform(40.0, 20e3, m), decays=rng.uniform(0.5, 300.0, m))
        for m in counts
    ]
    modes = engine(bodies, sample_rate=48_000, block=block, points=points)
    drives = {(b, v): rng.normal(size=counts[b]) for b in range(len(counts)) for v in range(voices)}
    heard = []
    for number in range(BLOCKS):
        outputs = [
            rng.normal(size=(points, m)) + 1j * turned * rng.normal(size=(points, m))
            if number % 4 == 0
            else None
            for m in counts
        ]
        if number % 3 == 1:
            drives = {key: drive * rng.uniform(0.5, 1.5) for key, drive in drives.items()}
        if number == 7:
            modes.change(
                0, Modes(frequencies=bodies[0].frequencies * 1.05, decays=bodies[0].decays)
            )
        pushes = [
            Push(body=body, voice=voice, force=rng.normal(size=block), drive=drive)
            for (body, voice), drive in drives.items()
            if (number + voice) % 5 != 4
        ]
        heard.append(modes.process(pushes, outputs).copy())
    return np.concatenate(heard[-2:], axis=2)

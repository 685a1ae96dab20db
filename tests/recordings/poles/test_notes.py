"""Findings on takes, each told once."""

from __future__ import annotations

import numpy as np

from struck.recordings.onsets import hit_at
from struck.recordings.poles.search import notes_on
from struck.recordings.takes import Take


def quiet(name: str, seed: int, peak: float) -> Take:
    samples = np.random.default_rng(seed).standard_normal(8000)
    return Take(samples=peak * samples / np.abs(samples).max(), sample_rate=8000, name=name)


def test_what_several_takes_share_is_told_once_without_folders() -> None:
    takes = [
        quiet(f"/somewhere/tap{number}.wav", number, 10 ** -(3 + number / 4)) for number in range(3)
    ]
    takes.append(quiet("/somewhere/loud.wav", 9, 0.5))
    notes = list(notes_on(takes, [[hit_at(take, 4000, 8000)] for take in takes]))
    (told,) = [note for note in notes if "quiet" in note]
    assert told == "tap0.wav is quiet: its peak is -60 dB of full scale; so 2 more takes"
    assert not any("somewhere" in note for note in notes)


def test_takes_normalised_one_by_one_are_told() -> None:
    takes = [quiet(f"tap{number}.wav", number, 0.98) for number in range(3)]
    hits = [[hit_at(take, 4000, 8000)] for take in takes]
    (note,) = (each for each in notes_on(takes, hits) if "normalised" in each)
    assert note.startswith("all 3 takes have the peak -0.2 dB")
    takes[1] = quiet("tap1.wav", 1, 0.5)
    assert not any("normalised" in each for each in notes_on(takes, hits))

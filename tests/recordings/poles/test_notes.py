"""Findings on takes, each told once."""

from __future__ import annotations

import re

import numpy as np
import pytest

import struck
from struck.files.sound import Sound
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
    assert note.startswith("all 3 hits have the peak -0.2 dB")
    one = Take(
        samples=np.hstack([take.samples for take in takes]), sample_rate=8000, name="taps.wav"
    )
    three = [hit_at(one, 8000 * number + 4000, 8000 * number + 8000) for number in range(3)]
    assert note in notes_on([one], [three])
    takes[1] = quiet("tap1.wav", 1, 0.5)
    assert not any("normalised" in each for each in notes_on(takes, hits))


def ringing(seed: int, *, after: float = 0.0, strength: float = 1.0) -> Sound:
    """Return a sound of ten made-up modes of an object, `after` s after its blow, over noise."""
    chance = np.random.default_rng(seed)
    frequencies, decays = np.sort(chance.uniform(300, 9000, 10)), chance.uniform(5, 30, 10)
    heard = np.random.default_rng([seed, round(1e3 * strength)])
    gains, times = heard.normal(size=10), np.arange(24_000) / 24_000 + after
    waves = np.sin(2 * np.pi * np.outer(frequencies, times)) * np.exp(-np.outer(decays, times))
    samples = 0.05 * strength * gains @ waves + 1e-5 * heard.normal(size=24_000)
    return Sound(samples=samples[None].astype(np.float32), sample_rate=24_000)


@pytest.mark.prove
def test_another_object_among_takes_is_told() -> None:
    same = [ringing(1, strength=strength) for strength in (1.0, 0.7, 0.3)]
    assert not any("two objects" in each for each in noted(same))
    told = "at most 0.0 % of the sound is common to take 1 and take 4: they may be of two"
    assert [note for note in noted([*same, ringing(2)]) if note.startswith(told)]


def test_a_take_that_begins_within_its_ring_is_told() -> None:
    (note,) = noted([ringing(1, after=0.0517)])
    begun = re.search(r"recording 1 begins within its sound, at (\d+) % of its peak", note)
    whole = np.abs(ringing(1, after=0.0517).samples[0])
    assert int(begun[1]) == round(100 * whole[0] / whole.max())
    assert "so that the blow and all that had died away are missing" in note
    (note,) = noted([ringing(1)])
    assert note.startswith("recording 1 has no lead-in: its noise is guessed")


def noted(takes: list[Sound]) -> tuple[str, ...]:
    return struck.fit(takes, cache=False, progress=None).provenance.dropped

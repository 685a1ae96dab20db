"""What was done to a take before: coded ones are noted as lossy, others are not."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest
from numpy.random import default_rng
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from struck.errors import RecordingError
from struck.recordings.disturbances import measure_loss, note_processing
from struck.recordings.onsets import find_hits, findings
from struck.recordings.poles.search import fit_poles
from struck.recordings.takes import Take
from tests.recordings import sounds

Array = NDArray[np.float64]

RATE = 44100
SEEDS = pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.prove) for seed in range(1, 5))]
)
RECORDINGS = Path(__file__).parents[3] / "shared/data/recordings"


def struck_body(seed: int, *, modes: int = 40, level: float = 50.0) -> Array:
    """Return half a second of noise and two of a body with so many modes, noise `level` dB down."""
    chance = default_rng(seed)
    frequencies = np.exp(chance.uniform(np.log(120), np.log(14000), modes))
    decays = (1.5 + 2.5e-7 * frequencies**2) * np.exp(chance.normal(0, 0.4, modes))
    gains = 10 ** (chance.normal(0, 8, modes) / 20) * np.exp(1j * chance.uniform(0, 7, modes))
    times = np.arange(2 * RATE) / RATE
    rung = (np.exp(np.outer(times, -decays + 2j * np.pi * frequencies)) @ gains).imag
    strength = np.sqrt(np.square(rung[: RATE // 10]).mean()) * 10 ** (-level / 20)
    sound = np.pad(rung, (RATE // 2, 0)) + strength * chance.standard_normal(5 * RATE // 2)
    return 0.7 * sound / np.abs(sound).max()


def coded(samples: Array, kilobits: int) -> Array:
    """Return what is left when a take was an MP3 of so many kilobits a second."""
    soundfile = pytest.importorskip("soundfile", reason="NO TAKE WAS CODED: pip install soundfile")
    file, level = io.BytesIO(), (320 - kilobits) / (320 - 32)
    options = {"subtype": "MPEG_LAYER_III", "bitrate_mode": "CONSTANT", "compression_level": level}
    soundfile.write(file, samples, RATE, format="MP3", **options)
    assert 8e-3 * len(file.getvalue()) * RATE / len(samples) == pytest.approx(kilobits, rel=0.1)
    file.seek(0)
    return np.asarray(soundfile.read(file)[0], np.float64)


@pytest.mark.parametrize(("name", "told"), [("tap.OGG", 1), ("tap.opus", 1), ("tap.flac", 0)])
def test_files_of_a_coder_are_noted_by_their_ending(name: str, told: int) -> None:
    notes = list(note_processing(Take(samples=struck_body(0)[None], sample_rate=RATE, name=name)))
    assert len(notes) == told
    assert all(f"{name} was coded with loss" in note for note in notes)
    assert all("as its ending says" in note for note in notes)


@SEEDS
def test_coded_takes_are_noted_as_lossy(seed: int) -> None:
    clean = struck_body(seed)
    assert measure_loss(coded(clean, 128), RATE)
    assert measure_loss(coded(clean, 64), RATE)
    assert measure_loss(np.round(32767 * coded(clean, 64)) / 32767, RATE)  # saved in 16 bits


@SEEDS
def test_uncoded_and_low_passed_takes_are_not(seed: int) -> None:
    clean = struck_body(seed)
    low = sosfilt(butter(8, 16000, fs=RATE, output="sos"), clean)
    for each in (clean, low, np.round(32767 * low) / 32767):
        assert not measure_loss(each, RATE)


@pytest.mark.prove
@pytest.mark.parametrize("make", [sounds.speech, sounds.cymbal, sounds.burst])
def test_other_sounds_are_not(make: object) -> None:
    chance = default_rng(1)
    sound = make(chance)  # type: ignore[operator]
    assert not measure_loss(sound + 1e-5 * chance.standard_normal(len(sound)), RATE)


def test_beating_pairs_and_silence_are_not() -> None:
    times = np.arange(2 * RATE) / RATE
    pairs = [np.sin(2 * np.pi * (f + df) * times) for f in (800, 3000, 9000) for df in (0, 20)]
    noise = 1e-4 * default_rng(0).standard_normal(len(times))
    assert not measure_loss(np.exp(-3 * times) * np.sum(pairs, axis=0) + noise, RATE)
    assert not measure_loss(np.zeros(RATE), RATE)
    assert not measure_loss(np.ones(10), RATE)


@SEEDS
def test_hits_that_fall_silent_in_between_are_not(seed: int) -> None:
    """As of a body that bounces and hums: bands fall silent and come back, but most at once."""
    chance = default_rng(seed)
    times = np.arange(RATE // 2) / RATE
    tones = np.geomspace(300, 15000, 40) * chance.uniform(0.97, 1.03, 40)
    rung = np.exp(-60 * times) * np.sin(2 * np.pi * tones[:, None] * times)
    hit, sound = chance.uniform(0.2, 1, 40) @ rung, np.zeros(4 * RATE)
    for begin in np.cumsum(chance.uniform(0.1, 0.3, 14)):
        place = round(begin * RATE)
        sound[place : place + len(hit)] += chance.uniform(0.5, 1) * hit
    sound += 20 * np.sin(2 * np.pi * 150 * np.arange(len(sound)) / RATE)
    assert not measure_loss(sound / np.abs(sound).max(), RATE)


@pytest.mark.prove
def test_a_coder_that_leaves_few_holes_is_only_supposed() -> None:
    told = told_of(coded(struck_body(0), 128))
    assert "may have been coded with loss (MP3, AAC, OGG): bands fall silent" in told
    assert "was coded with loss" in told_of(coded(struck_body(0), 64))


def test_a_take_is_told_what_was_done_to_it() -> None:
    take = Take(samples=coded(struck_body(0), 64)[None] + 0.01, sample_rate=RATE, name="phone")
    told = list(findings(take, find_hits(take)))
    assert any("coded with loss" in note for note in told)
    assert any("constant offset of 1." in note for note in told)
    clean = Take(samples=struck_body(0)[None], sample_rate=RATE, name="bell")
    assert not any(
        "coded" in note or "offset" in note for note in findings(clean, find_hits(clean))
    )


def rung(seconds: float, rate: int = RATE) -> Array:
    times = np.arange(round(seconds * rate)) / rate
    waves = (
        np.sin(2 * np.pi * np.outer(times, [440.0, 1210.0, 2600.0])) * np.exp(-8 * times)[:, None]
    )
    return 0.2 * waves.sum(axis=1) + 1e-4 * default_rng(5).standard_normal(len(times))


def told_of(samples: Array) -> str:
    take = Take(samples=np.round(32767 * samples)[None] / 32767, sample_rate=RATE, name="tap.wav")
    return " ".join(findings(take, find_hits(take)))


def test_a_loop_is_told_and_a_body_is_not_accused() -> None:
    clean = rung(1.0)
    begin, end = round(0.4 * RATE), round(0.55 * RATE)
    looped = np.concatenate([clean[:end], np.tile(clean[begin:end], 4)])
    assert "tap.wav repeats 0.150 s of itself from 0.5" in told_of(looped)
    assert "repeats" not in told_of(clean)
    assert "repeats" not in told_of(np.pad(clean, (RATE, RATE)))  # digital silence


def test_a_take_of_a_tenth_of_a_second_is_told_what_it_lacks() -> None:
    assert "tap.wav holds 0.1 s after a hit at most: tones nearer than 10 Hz" in told_of(rung(0.1))
    assert "after a hit" not in told_of(rung(1.0))
    faded = rung(0.2) * np.exp(-60 * np.arange(round(0.2 * RATE)) / RATE)
    assert "after a hit" not in told_of(faded)
    soon = np.pad(rung(0.04), (round(0.1 * RATE), 0))
    with pytest.raises(RecordingError, match="it ends 40 ms after its last hit"):
        fit_poles(Take(samples=soon[None], sample_rate=RATE, name="tap.wav"))


@pytest.mark.prove
@pytest.mark.skipif(not RECORDINGS.is_dir(), reason="recordings are not beside the checkout")
def test_no_real_take_is_accused() -> None:
    takes = [Take.load(path) for path in sorted(RECORDINGS.glob("**/*.wav"))]
    accused = [each.name for each in takes if measure_loss(each.samples[0], each.sample_rate)]
    assert not accused
    assert not any("repeats" in note for each in takes for note in findings(each, find_hits(each)))

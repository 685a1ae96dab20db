"""Takes from files and samples, good and bad, and what is found wrong with them."""

from __future__ import annotations

import builtins
import re
import time
from pathlib import Path

import numpy as np
import pytest
import soundfile
from numpy.typing import NDArray

from struck.errors import FileFormatError, MissingDependencyError, RecordingError
from struck.files import wav
from struck.files.sound import Sound
from struck.recordings.onsets import find_clipped, find_hits, findings, lead_in
from struck.recordings.takes import Take, require_one_rate

RATE = 44100

Array = NDArray[np.float64]


def rung(lead: float = 0.5, seconds: float = 1.0, noise: float = 1e-4, decay: float = 12) -> Array:
    times = np.arange(round(seconds * RATE)) / RATE
    sound = 0.5 * np.sin(2 * np.pi * 880 * times) * np.exp(-decay * times)
    padded = np.pad(sound, (round(lead * RATE), 0))
    return padded + noise * np.random.default_rng(1).standard_normal(len(padded))


def take(samples: Array) -> Take:
    return Take(samples=samples, sample_rate=RATE)


def told(samples: Array) -> str:
    return "\n".join(findings(take(samples), find_hits(take(samples))))


@pytest.mark.parametrize(
    ("suffix", "subtype"),
    [
        ("wav", "PCM_16"),
        ("wav", "PCM_24"),
        ("wav", "FLOAT"),
        ("wav", "DOUBLE"),
        ("wav", "PCM_32"),
        ("flac", "PCM_24"),
        ("aiff", "PCM_16"),
    ],
)
def test_files_come_back_as_they_were_written(tmp_path: Path, suffix: str, subtype: str) -> None:
    stereo = 0.4 * np.random.default_rng(0).uniform(-1, 1, (9600, 2))
    path = tmp_path / f"take.{suffix}"
    soundfile.write(path, stereo, 48000, subtype=subtype)
    read = Take.load(path)
    assert (read.channels, read.sample_rate, read.duration) == (2, 48000, 0.2)
    assert np.allclose(read.samples, stereo.T, rtol=0, atol=2.0**-15)


def test_a_sound_becomes_a_take() -> None:
    sound = Sound(samples=rung().astype(np.float32), sample_rate=RATE)
    assert np.array_equal(Take.of(sound).samples, sound.samples)


@pytest.mark.parametrize("rate", [8000, 192_000])
def test_any_usual_rate_is_taken(rate: int) -> None:
    assert Take(samples=np.ones(rate).cumsum(), sample_rate=rate).duration == 1


def test_not_a_number_is_refused_with_its_place() -> None:
    samples = rung()
    samples[4410:4413] = np.nan
    with pytest.raises(RecordingError, match=r"3 samples .* first at 0\.1000 s"):
        take(samples)


@pytest.mark.parametrize(
    ("samples", "rate", "message"),
    [
        (np.zeros(RATE), RATE, "silent in channel 1"),
        (np.stack((np.ones(RATE).cumsum(), np.full(RATE, 0.1))), RATE, "silent in channel 2"),
        (np.ones(100), RATE, "give 0.1 s or more"),
        (np.ones((2, 2, RATE)), RATE, "shape"),
        (np.ones(100), 100, "sample rate of 100"),
    ],
)
def test_what_holds_no_sound_is_refused(samples: Array, rate: int, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        Take(samples=samples, sample_rate=rate)


def test_takes_of_different_rates_are_refused() -> None:
    other = Take(samples=rung(), sample_rate=48000, name="b.wav")
    with pytest.raises(RecordingError, match=r"b\.wav was recorded at 48000 Hz"):
        require_one_rate([take(rung()), other])


@pytest.mark.parametrize("suffix", ["wav", "flac"])
def test_a_file_cut_short_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"take.{suffix}"
    soundfile.write(path, rung(), RATE)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with pytest.raises(FileFormatError):
        Take.load(path)


def test_what_is_no_sound_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes.wav").write_text("not a sound")
    for path in (tmp_path / "notes.wav", tmp_path / "missing.wav", tmp_path):
        with pytest.raises(FileFormatError):
            Take.load(path)


def test_wav_needs_no_other_library_and_others_say_which(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, other = tmp_path / "plain.wav", tmp_path / "other.flac"
    plain.write_bytes(
        wav.encode(wav.Recording(samples=rung()[None].astype(np.float32), sample_rate=RATE))
    )
    soundfile.write(other, rung(), RATE)
    usual = builtins.__import__

    def without(name: str, *rest: object) -> object:
        if name == "soundfile":
            raise ImportError(name)
        return usual(name, *rest)  # pyright: ignore[reportArgumentType] - passed on as they came

    monkeypatch.setattr(builtins, "__import__", without)
    assert Take.load(plain).sample_rate == RATE
    with pytest.raises(MissingDependencyError, match=r"pip install struck\[recordings\]"):
        Take.load(other)


def test_a_good_take_has_no_findings() -> None:
    assert not told(rung())


def test_clipped_samples_are_found_at_full_scale_and_below() -> None:
    loud = 2.6 * rung()
    for limit in (1.0, 0.7):
        flat = find_clipped(take(np.clip(loud, -limit, limit)))
        assert flat.sum() > 50
        assert np.abs(loud[flat]).min() >= limit
    assert not find_clipped(take(rung())).any()
    assert "is clipped" in told(np.clip(loud, -1, 1))


def test_a_take_without_lead_in_is_told() -> None:
    samples = rung(lead=0.0)
    assert "no lead-in" in told(samples)
    assert not lead_in(take(samples), find_hits(take(samples))).size


def test_a_take_cut_short_is_told() -> None:
    assert "cut short" in told(rung(seconds=0.3))


def test_a_quiet_take_is_told() -> None:
    assert "is quiet: its peak is -5" in told(3e-3 * rung())


def test_noise_suppression_is_suspected() -> None:
    samples = rung(seconds=3.0, noise=1e-3)
    samples[2 * RATE :] *= 0.05
    assert "noise suppression" in told(samples)


def test_a_digitally_silent_lead_in_tells_no_noise() -> None:
    """Levels over it have no end, so what counts is how far the sound has fallen."""
    whole, short = rung(seconds=3.0, noise=0.0), rung(seconds=0.3, noise=0.0)
    for samples in (whole, short):
        first = find_hits(take(samples))[0].onset
        samples[: first - 1] = 0.0
    assert not told(whole)
    assert "cut short: it has fallen by" in told(short)


def test_a_tail_that_is_gated_is_told_in_decibels_of_files() -> None:
    samples = rung(seconds=3.0, noise=1e-3)
    samples[2 * RATE :] = 0.0
    found = re.search(r"changes by -(\d+) dB", told(samples))
    assert found
    assert int(found[1]) < 100


@pytest.mark.parametrize("head", [b"ID3\x04", b"\xff\xfb\x90\x00"])
@pytest.mark.parametrize("name", ["tap.mp3", "tap.flac"])
def test_mp3_is_refused_in_one_line(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], head: bytes, name: str
) -> None:
    path = tmp_path / name
    path.write_bytes(head + bytes(4000))
    with pytest.raises(FileFormatError, match="convert it to one of them") as caught:
        Take.load(path)
    assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "message"), [("takes.csv", "manifest="), ("mug.struck", "a model, not a recording")]
)
def test_what_is_given_for_a_recording_is_told(tmp_path: Path, name: str, message: str) -> None:
    (tmp_path / name).write_text("file,u\n")
    with pytest.raises(FileFormatError, match=message):
        Take.load(tmp_path / name)


def test_an_hour_is_refused_before_it_is_read(tmp_path: Path) -> None:
    path = tmp_path / "hour.wav"
    with path.open("wb") as file:
        file.truncate(2 * 44_100 * 3600)  # a hole: no disk is filled
    begun = time.perf_counter()
    with pytest.raises(RecordingError, match=r"hour\.wav holds 159 million values, and at most 30"):
        Take.load(path)
    assert time.perf_counter() - begun < 5

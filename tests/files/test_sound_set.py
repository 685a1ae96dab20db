"""Sound files by their ending, and sets of sounds that keep how loud they are beside each other."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile

import struck
from struck.cli import main
from struck.errors import FileFormatError, MissingDependencyError, OptionError
from struck.files import save_set
from struck.shapes import Bar

RATE = 48_000
STRIKERS = ("fingertip", "felt", "rubber", "wood", "plastic", "steel")
SPEEDS = (0.1, 0.3, 1.0, 3.0)


@pytest.fixture(scope="module")
def model() -> struck.ModalModel:
    return struck.analyze(Bar(length=0.6, width=0.05, thickness=0.004), "steel")


@pytest.fixture(scope="module")
def hits(model: struck.ModalModel) -> dict[str, struck.Sound]:
    """Return 24 hits, from a fingertip at 0.1 m/s to steel at 3 m/s."""
    return {
        f"{striker}_{speed:g}": struck.render(
            model, struck.Strike(at=(0.05, 0.0, 0.002), striker=striker, speed=speed), seconds=0.4
        )
        for striker in STRIKERS
        for speed in SPEEDS
    }


def tone(seconds: float = 0.7, pressure: float = 0.5) -> struck.Sound:
    time = np.arange(round(seconds * RATE)) / RATE
    wave = pressure * np.exp(-4 * time) * np.sin(2 * np.pi * 500 * time)
    return struck.Sound(samples=np.float32(wave), sample_rate=RATE, calibrated=True)


def decibels(samples: np.ndarray) -> float:
    return 10 * np.log10(np.sum(np.square(samples.astype(np.float64))))


@pytest.mark.parametrize("ending", ["flac", "ogg", "aiff", "mp3", "wav"])
def test_an_ending_means_what_it_says(tmp_path: Path, ending: str) -> None:
    sound = tone()
    factor = sound.save(tmp_path / f"x.{ending}")
    told = soundfile.info(tmp_path / f"x.{ending}")
    assert told.format == {"wav": "WAV"}.get(ending, ending.upper())
    samples, rate = soundfile.read(tmp_path / f"x.{ending}")
    assert (rate, len(samples)) == (RATE, sound.samples.shape[1])
    assert decibels(samples) == pytest.approx(decibels(sound.samples * factor), abs=0.2)
    again = struck.Sound.load(tmp_path / f"x.{ending}")
    assert again.samples.shape == sound.samples.shape


@pytest.mark.parametrize("name", ["x.wma", "x", "x.m4a"])
def test_an_ending_of_no_sound_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(OptionError, match=r"sounds end in .wav, .flac.* as x.wav"):
        tone().save(tmp_path / name)
    assert not list(tmp_path.iterdir())


def test_without_soundfile_the_line_that_installs_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "soundfile", None)
    with pytest.raises(MissingDependencyError, match=r"MP3 files need soundfile: pip install"):
        tone().save(tmp_path / "x.mp3")
    tone().save(tmp_path / "x.wav")


def test_a_pressure_is_full_scale(tmp_path: Path) -> None:
    sound = tone()
    assert sound.save(tmp_path / "x.wav", level=2.0) == 0.5
    samples, _ = soundfile.read(tmp_path / "x.wav")
    assert np.abs(samples).max() == pytest.approx(sound.peak / 2, rel=1e-6)
    with pytest.raises(OptionError, match="times full scale, which FLAC would clip"):
        sound.save(tmp_path / "x.flac", level=0.1)
    for level, words in ((0.0, "give 'peak'"), (-1, "give 'peak'"), ("loud", "'loud'")):
        with pytest.raises(OptionError, match=words):
            sound.save(tmp_path / "x.wav", level=level)


@pytest.mark.parametrize(
    ("ending", "encoding"), [(".wav", None), (".wav", "int24"), (".flac", None)]
)
def test_24_hits_keep_their_level_differences(
    tmp_path: Path, hits: dict[str, struck.Sound], ending: str, encoding: str | None
) -> None:
    if (ending, encoding) != (".wav", None):  # 24 bits reach 115 dB down, floats any depth
        with pytest.raises(OptionError, match=r"peaks 1[23]\d.* and int24 would"):
            save_set(hits, tmp_path / "set", ending=ending, encoding=encoding)
        loudest = max(sound.peak for sound in hits.values())
        hits = {name: sound for name, sound in hits.items() if sound.peak > 2e-6 * loudest}
    rows = save_set(hits, tmp_path / "set", ending=ending, encoding=encoding)
    true = np.array([decibels(sound.samples) for sound in hits.values()])
    read = np.array([decibels(soundfile.read(tmp_path / "set" / row["file"])[0]) for row in rows])
    assert np.ptp(true) > 80
    assert np.ptp(read - true) < 0.1
    assert max(row["level_db"] for row in rows) == pytest.approx(-1.0)
    table = list(csv.DictReader(io.StringIO((tmp_path / "set" / "set.csv").read_text())))
    assert [row["name"] for row in table] == list(hits)
    assert float(table[0]["full_scale"]) == rows[0]["full_scale"]


@pytest.mark.parametrize("ending", ["ogg", "mp3"])
def test_coders_keep_levels_within_a_decibel(
    tmp_path: Path, hits: dict[str, struck.Sound], ending: str
) -> None:
    loud = max(hits.values(), key=lambda sound: sound.peak)
    fading = {f"{n}": dataclasses.replace(loud, samples=loud.samples * 10**-n) for n in range(4)}
    rows = save_set(fading, tmp_path / "set", ending=ending)
    files = [tmp_path / "set" / row["file"] for row in rows]
    read = np.array([decibels(soundfile.read(file)[0] * rows[0]["full_scale"]) for file in files])
    off = np.abs(read - [decibels(sound.samples) for sound in fading.values()])
    assert 0.02 < off.max() < 1
    with pytest.raises(OptionError, match=r"more than 1: save|leave silence of it"):
        save_set({"soft": tone(pressure=1e-7)}, tmp_path / "soft", level=1.0, ending=ending)


def test_16_bits_are_refused_with_the_figure(tmp_path: Path, hits: dict[str, struck.Sound]) -> None:
    with pytest.raises(OptionError, match=r"peaks [\d.]+ dB below full scale .* and int16 would"):
        save_set(hits, tmp_path / "set", encoding="int16")
    assert not (tmp_path / "set").exists()


def test_what_is_wrong_with_a_set_is_told(tmp_path: Path) -> None:
    silent = struck.Sound(samples=np.zeros(100, np.float32), sample_rate=RATE, calibrated=True)
    rows = save_set({"silent": silent, "loud": tone()}, tmp_path / "set", encoding="int24")
    assert [row["level_db"] is None for row in rows] == [True, False]
    (only,) = save_set({"silent": silent}, tmp_path / "none")
    assert only["level_db"] is None
    relative = struck.Sound(samples=np.ones(9, np.float32), sample_rate=RATE)
    (tmp_path / "file").write_text("no folder")
    for sounds, folder, words in (
        ([("a", tone()), ("b", tone()), ("a", tone())], "x", "sound 1 is .* sound 3 'a', which"),
        ([("a", tone()), ("A", tone())], "x", "sound 1 is called 'a' and sound 2 'A'"),
        ([("../a", tone())], "x", "'../a', as sound 1 is"),
        ([], "x", "0 sounds"),
        ([("a", tone()), ("b", relative)], "x", "some relative"),
    ):
        with pytest.raises(OptionError, match=words):
            save_set(sounds, tmp_path / folder)
    with pytest.raises(FileFormatError, match="cannot be made"):
        save_set({"a": tone()}, tmp_path / "file")
    with pytest.raises(FileFormatError, match=r"cannot be made .* give another"):
        save_set({"a": tone()}, "/proc/set")
    assert not (tmp_path / "x").exists()


def test_the_shell_writes_a_set(
    tmp_path: Path,
    model: struck.ModalModel,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    struck.save(model, "b.struck")
    Path("t.csv").write_text("name,at,striker,speed\nsoft,middle,fingertip,0.1\n,end,steel,3\n")
    assert main(["render", "b.struck", "--strikes", "t.csv", "-o", "out", "--seconds", "0.2"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("wrote 2 sounds and set.csv to out: full scale is ")
    assert " Pa, peaks from -" in last
    assert last.endswith("to -1.0 dB of it")
    assert {path.name for path in Path("out").iterdir()} == {
        "soft.wav", "002_end_steel.wav", "set.csv",
    }  # fmt: skip
    words = ["render", "b.struck", "--seconds", "0.2", "-o"]
    assert main([*words, "x.flac", "--level", "200"]) == 0
    assert "full scale, which is 200 Pa)" in capsys.readouterr().out
    assert main([*words, "x.wma", "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["kind"] == "OptionError"
    assert main(["render", "b.struck", "--strikes", "t.csv"]) == 2
    assert "give -o FOLDER" in capsys.readouterr().err
    assert main(["render", "x.flac"]) == 2
    assert "x.flac is a sound (FLAC) and not a model" in capsys.readouterr().err


def test_a_set_is_made_again_from_its_own_table(
    tmp_path: Path,
    model: struck.ModalModel,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    struck.save(model, "bar.struck")
    Path("hits.csv").write_text(
        "name,at,striker,energy,direction,duration,shape,patch,transient,time,seed,listener\n"
        "a,0.0512345678901 0 0.002,wood,0.01,0.1 0 -1,0.002,hertz,0.003,0.2,0.01,7,0 0 2\n"
        "b,middle,,,,,,,,,,\n"
    )
    again = ["render", "bar.struck", "--seconds", "0.1", "--strikes"]
    assert main([*again, "hits.csv", "-o", "one"]) == 0
    assert main([*again, "one/set.csv", "-o", "two"]) == 0
    for name in ("a.wav", "b.wav"):
        assert Path("one", name).read_bytes() == Path("two", name).read_bytes()
    given = {field.name for field in dataclasses.fields(struck.Strike)} | {"name", "listener"}
    rows = list(csv.DictReader(io.StringIO(Path("one/set.csv").read_text())))
    assert given < set(rows[0])
    assert rows[0]["listener"] == "0.0 0.0 2.0"
    strikes = [struck.Strike(at="end"), (struck.Strike(time=0.1), np.array([0, 0, 2.0]))]
    rows = save_set({"a": tone(), "b": tone()}, "three", strikes=strikes)
    assert [(row["time"], row["listener"]) for row in rows] == [(0.0, None), (0.1, "0.0 0.0 2.0")]
    assert "shape" not in rows[0]
    Path("hits.csv").write_text("name,at\na,start\nb,middle\nA,end\n")
    capsys.readouterr()
    assert main([*again, "hits.csv", "-o", "four"]) == 2
    assert "row 1 is called 'a' and row 3 of hits.csv 'A', which" in capsys.readouterr().err

"""No reader waits for a pipe, follows a device without end, or fails raw on an odd name."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.cli.options import _walk
from struck.errors import FileFormatError, StruckError
from struck.files.sound import Sound
from struck.perception.sound_map import SoundMap
from struck.recordings.capture_plan import read_plan
from struck.recordings.manifest import read_manifest
from struck.recordings.takes import Take

READERS: dict[str, tuple[str, Callable[[str], object]]] = {
    "model": (".struck", struck.load),
    "field": (".sofa", struck.load),
    "sound": (".wav", Sound.load),
    "take": (".flac", Take.load),
    "fit": (".wav", lambda path: struck.fit([path], cache=False)),
    "fit by manifest": (".toml", lambda path: struck.fit(path, cache=False)),
    "fit of a folder": ("", lambda path: struck.fit(path, cache=False)),
    "manifest": (".toml", read_manifest),
    "table": (".csv", read_manifest),
    "plan": (".toml", read_plan),
    "map": (".map", SoundMap.load),
    "force": (".wav", lambda path: struck.ForceTrack(force=path)),
    "walk": (".csv", _walk),
}


def pipe(path: Path) -> Path:
    os.mkfifo(path)
    return path


def endless(path: Path) -> Path:
    path.symlink_to("/dev/zero")
    return path


def huge(path: Path) -> Path:
    with path.open("wb") as file:
        file.truncate(2**40)
    return path


def loop(path: Path) -> Path:
    path.symlink_to(path)
    return path


def folder(path: Path) -> Path:
    path.mkdir()
    return path


def long(path: Path) -> Path:
    return path.with_name("n" * 300 + path.suffix)


def far_down(path: Path) -> Path:
    return Path("/".join(["n" * 200] * 30) + path.suffix)


def below_a_file(path: Path) -> Path:
    path.write_bytes(b"")
    return path / f"b{path.suffix}"


def no_name(path: Path) -> Path:
    return path.with_name(f"a\0b{path.suffix}")


KINDS = (pipe, endless, huge, loop, folder, long, far_down, below_a_file, no_name)


class HangError(BaseException):
    """What no reader takes for an error of its own."""


@pytest.fixture
def at_once() -> Iterator[None]:
    """Fail a test that waits for 5 s."""

    def hang(*_: object) -> None:
        raise HangError

    before = signal.signal(signal.SIGALRM, hang)
    signal.setitimer(signal.ITIMER_REAL, 5.0)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes among files")
@pytest.mark.usefixtures("at_once")
@pytest.mark.parametrize("reader", READERS)
def test_special_files_are_refused(reader: str, tmp_path: Path) -> None:
    suffix, read = READERS[reader]
    for kind in KINDS:
        path = kind(tmp_path / f"{kind.__name__}{suffix}")
        with pytest.raises(StruckError) as refused:
            read(str(path))
        assert len(str(refused.value)) > 40, kind


def test_what_is_refused_is_told(tmp_path: Path) -> None:
    reasons = {pipe: "a pipe or a device", endless: "a pipe or a device", huge: "has 1099511627776"}
    for kind, reason in reasons.items():
        with pytest.raises(FileFormatError, match=reason):
            struck.load(kind(tmp_path / f"{kind.__name__}.struck"))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes among files")
@pytest.mark.usefixtures("at_once")
def test_a_pipe_that_takes_the_place_of_a_file_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, swapped = tmp_path / "plain", pipe(tmp_path / "swapped")
    plain.write_bytes(b"")
    status = plain.stat()
    monkeypatch.setattr(Path, "stat", lambda *_, **__: status)
    with pytest.raises(FileFormatError, match="a pipe or a device"):
        Sound.load(swapped)


def test_names_that_cannot_be_are_refused_also_for_writing(tmp_path: Path) -> None:
    sound = Sound(samples=np.zeros((1, 10)), sample_rate=8000)
    for kind in (long, far_down, no_name, folder, below_a_file):
        with pytest.raises(FileFormatError):
            sound.save(kind(tmp_path / f"{kind.__name__}.wav"))


TOML = {
    "lists in lists": ("centre = " + "[" * 20_000, "too deep"),
    "tables in tables": ("centre = " + "{a=" * 20_000, "too deep"),
    "a key of many parts": (".".join("a" * 20_000) + " = 1", "more than 8 parts"),
    "a table of many parts": ("[" + ' . "a"' * 20_000 + "]", "more than 8 parts"),
    "an integer of many digits": ("centre = " + "9" * 5000, "no TOML"),
    "an integer of many bits": ("centre = [0, 0, 0x" + "f" * 5000 + "]", "20000 bits"),
    "an integer beyond a float": ("centre = [0, 0, " + "9" * 400 + "]", "bits"),
}


@pytest.mark.usefixtures("at_once")
@pytest.mark.parametrize("case", TOML)
@pytest.mark.parametrize("read", [read_manifest, read_plan])
def test_toml_is_read_within_bounds(
    case: str, read: Callable[[Path], object], tmp_path: Path
) -> None:
    text, reason = TOML[case]
    (tmp_path / "a.toml").write_text(text, encoding="utf-8")
    with pytest.raises(FileFormatError, match=reason):
        read(tmp_path / "a.toml")


def test_notes_with_many_stops_are_no_keys(tmp_path: Path) -> None:
    (tmp_path / "a.wav").write_bytes(b"")
    numbers = ", ".join(["1.5"] * 3)
    note = "." * 200 + " The bell. Struck by hand, twice." * 40
    text = f'centre = [{numbers}]\n[[takes]]\nfile = "a.wav"\nnote = "{note}"\n'
    (tmp_path / "a.toml").write_text(text, encoding="utf-8")
    assert read_manifest(tmp_path / "a.toml").entries[0].note == note

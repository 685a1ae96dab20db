"""`struck fit` from the shell."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.cli import main
from struck.errors import FileFormatError
from tests.recordings.sounds import cymbal
from tests.recordings.strings import FREQUENCIES, hit, sound


@pytest.fixture
def taps(tmp_path: Path) -> list[str]:
    """Return three files of taps, and beside them `takes.csv` that tells where they were."""
    lines, names = [["file", "u"]], []
    for number, contact in enumerate((0.0, 0.3, 0.8)):
        path = tmp_path / f"tap{number}.wav"
        sound(hit(contact, seed=number)).save(path)
        names.append(str(path))
        lines.append([path.name, str(contact)])
    with (tmp_path / "takes.csv").open("w", newline="") as file:
        csv.writer(file).writerows(lines)
    return names


def run(*words: object) -> int:
    return main([str(word) for word in words])


def test_files_become_a_model_and_a_page(
    taps: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output, report = tmp_path / "mug.struck", tmp_path / "mug.html"
    assert run("fit", *taps, "-o", output, "--report", report) == 0
    told = capsys.readouterr().out
    assert f"wrote {output}" in told
    assert f"wrote {report}" in told
    assert "signal to residual" in told
    assert struck.load(output).frequencies == pytest.approx(FREQUENCIES, rel=1e-4)
    assert report.read_text(encoding="utf-8").startswith("<!doctype html>")


def test_a_manifest_makes_a_field_that_plays(taps: list[str], tmp_path: Path) -> None:
    output = tmp_path / "mug.struck"
    manifest = tmp_path / "takes.csv"
    assert run("fit", *taps, "--manifest", manifest, "-o", output, "--residual") == 0
    assert struck.load(output).coordinates == ("u",)
    assert struck.load(output).residual is not None
    wav = tmp_path / "mug.wav"
    assert run("render", output, "--strike", "0.45", "--seconds", "0.3", "-o", wav) == 0
    assert struck.Sound.load(wav).peak > 0


def test_a_machine_is_told_the_errors(
    taps: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("fit", taps[0], "-o", tmp_path / "mug.struck", "--modes", "4", "--json") == 0
    told = json.loads(capsys.readouterr().out)
    assert len(told["frequencies"]) == len(told["decay_errors"]) == 4
    assert told["modal"] is True
    assert told["signal_to_residual"] > 10
    assert 0.9 < told["provenance"]["details"]["explained_by_one_strike"] <= 1
    assert told["report"] is None


def test_all_modes_may_be_asked_for(taps: list[str], tmp_path: Path) -> None:
    output = tmp_path / "mug.struck"
    assert run("fit", *taps, "-o", output, "--modes", "all") == 0
    assert struck.load(output).frequencies == pytest.approx(FREQUENCIES, rel=1e-4)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--modes", "many"], "--modes: it is 'many'"),
        (["--modes", "²"], "--modes: it is '²'"),
        (["--modes", "0"], "--modes: it is '0': give a whole number of at least 1, or all"),
        (["--interpolation", "cloud"], "interpolation is 'cloud'"),
        (["--report", "nowhere/page.html"], "no folder nowhere"),
        (["--manifest", "none.csv"], "none.csv"),
    ],
)
def test_bad_options_write_nothing(
    taps: list[str],
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    message: str,
) -> None:
    assert run("fit", taps[0], "-o", tmp_path / "mug.struck", *words) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "mug.struck").exists()


@pytest.mark.prove
def test_what_nobody_struck_writes_nothing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STRUCK_CACHE", str(tmp_path / "cache"))  # the second fit goes on
    crash = np.float32(cymbal(np.random.default_rng(2), 0.3))
    struck.Sound(samples=crash, sample_rate=44100).save(tmp_path / "crash.wav")
    output = tmp_path / "crash.struck"
    assert run("fit", tmp_path / "crash.wav", "-o", output, "--modes", "16") == 2
    assert "not modal" in capsys.readouterr().err
    assert not output.exists()
    assert run("fit", tmp_path / "crash.wav", "-o", output, "--modes", "16", "--force") == 0
    assert "caution" in capsys.readouterr().out


@pytest.mark.parametrize("damage", ["cut short", "text", "empty"])
def test_a_damaged_file_writes_nothing(
    taps: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], damage: str
) -> None:
    broken, output = tmp_path / "broken.wav", tmp_path / "broken.struck"
    whole = Path(taps[0]).read_bytes()
    broken.write_bytes(
        {"cut short": whole[: len(whole) // 2], "text": b"a mug", "empty": b""}[damage]
    )
    assert run("fit", taps[1], broken, "-o", output, "--report", tmp_path / "page.html") == 2
    told = capsys.readouterr().err
    assert "broken.wav" in told
    assert "Traceback" not in told
    assert not output.exists()
    assert not (tmp_path / "page.html").exists()


def test_no_input_is_overwritten(
    taps: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    (tmp_path / "takes").mkdir()
    (tmp_path / "takes" / "manifest.toml").write_text("[[takes]]\nfile = '../tap2.wav'\n")
    model = tmp_path / "mug.struck"
    manifest = tmp_path / "takes.csv"
    for words in (
        [*taps, "-o", taps[0]],
        [taps[1], "-o", taps[0]],
        [*taps, "-o", model, "--report", taps[1]],
        [*taps, "-o", model, "--report", model],
        [*taps, "--manifest", manifest, "-o", model, "--report", manifest],
        [manifest, "-o", model, "--report", taps[2]],
        [tmp_path / "takes", "-o", model, "--report", taps[2]],
        [tmp_path / "takes", "-o", model, "--report", tmp_path / "takes" / "manifest.toml"],
    ):
        assert run("fit", *words) == 2
        told = capsys.readouterr().err
        assert told.startswith("struck: ")
        assert told.count("\n") == 1
    with pytest.raises(FileFormatError, match="another name"):
        struck.fit(taps, report=taps[2])
    with pytest.raises(FileFormatError, match="another name"):
        struck.fit(taps[0], report=Path(taps[0]))
    after = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    assert after == before


def test_a_manifest_among_files_is_told(
    taps: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [taps[0], tmp_path / "takes.csv", "-o", tmp_path / "mug.struck"]
    assert run("fit", *words) == 2
    assert "takes.csv is a list of recordings, not one" in capsys.readouterr().err


def test_the_model_of_this_folder_has_its_name(
    taps: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "mug v2.1"
    folder.mkdir()
    Path(taps[0]).rename(folder / "tap.wav")
    (folder / "manifest.toml").write_text("[[takes]]\nfile = 'tap.wav'\n")
    monkeypatch.chdir(folder)
    assert run("fit", ".", "--modes", "4") == 0
    assert sorted(path.name for path in folder.glob("*.struck")) == ["mug v2.1.struck"]


def test_gains_alone_are_written_with_a_word_on_what_they_lack(
    taps: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("h5py")
    output = tmp_path / "mug.sofa"
    assert run("fit", taps[0], "-o", output, "--residual", "--modes", "4") == 0
    told = capsys.readouterr()
    assert "without its residual (attack and noise): keep a .struck file as well" in told.err
    fitted, again = struck.fit(taps[0], modes=4), struck.load(output)
    assert fitted.cite() == again.cite() != ""
    assert fitted.errors is not None
    assert again.errors is not None
    assert fitted.errors.tolist() == again.errors.tolist()

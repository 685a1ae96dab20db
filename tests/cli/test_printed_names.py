"""Names with control characters: they are printed escaped, wherever the shell prints."""

from __future__ import annotations

import argparse
import io
import os
import sys
import unicodedata
from pathlib import Path

import numpy as np
import pytest

import struck
from struck.cli import COMMANDS, Parser, complain, declare, main
from struck.errors import printable
from struck.model.html import aligned
from struck.model.provenance import TerminalProgress

HOSTILE = "a\x1b[31mb\nstruck: c\td\re\x9bf\u202eg\u2066h\u2028i\u200fj\x00\x7f"
# What a file can be called.
NAME = HOSTILE.replace("\x00", "")
CONTROLS = {"Cc", "Cf", "Cs", "Zl", "Zp"}


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain.wav", "plain.wav"),
        ("Glöckchen 鐘 🔔 e\u0301", "Glöckchen 鐘 🔔 e\u0301"),
        ("a\u00a0b", "a\u00a0b"),  # a space that does not break
        ("C:\\bell.wav", "C:\\bell.wav"),
        ("a\nb", r"a\nb"),
        ("a\tb\rc", r"a\tb\rc"),
        ("\x1b[31m", r"\x1b[31m"),
        ("\x00\x07\x7f", r"\x00\x07\x7f"),
        ("\x85\x9b", r"\x85\x9b"),
        ("\u202e\u2066\u200e", r"\u202e\u2066\u200e"),
        ("\u2028\u2029", r"\u2028\u2029"),
        ("\u200b\ufeff\u00ad", r"\u200b\ufeff\xad"),
        ("\U000e0041", r"\U000e0041"),
        (os.fsdecode(b"a\xff\x9b") if os.name != "nt" else "a\udcff\udc9b", r"a\xff\x9b"),
        ("\ud800", r"\ud800"),
    ],
)
def test_table(text: str, shown: str) -> None:
    assert printable(text) == shown
    assert printable(shown) == shown
    assert len(shown.splitlines()) == 1
    shown.encode()


def test_every_control_character_is_escaped_and_no_other() -> None:
    for letter in map(chr, (*range(0x10000), *range(0xE0000, 0xE0200))):
        assert (printable(letter) != letter) == (unicodedata.category(letter) in CONTROLS)


def require_clean(text: str, *, lines: int | None = None) -> None:
    """Require that a printed text holds no control character but ends of lines."""
    assert not [each for each in text if each != "\n" and unicodedata.category(each) in CONTROLS]
    assert lines in {None, text.count("\n")}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such names")
@pytest.mark.usefixtures("folder")
def test_results_escape_names(capsys: pytest.CaptureFixture[str]) -> None:
    """Names of files, and of what is in them."""
    body = struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005)
    steel = struck.Material.named("steel")
    material = struck.Material(
        name=NAME,
        density=steel.density,
        youngs_modulus=steel.youngs_modulus,
        poisson_ratio=steel.poisson_ratio,
        damping=steel.damping,
    )
    model, lines = f"{NAME}.struck", {}
    struck.save(struck.analyze(body, material, band=(20, 2000)), model)
    sound = struck.Sound(samples=np.ones((1, 9), np.float32), sample_rate=8000)
    sound.save(f"{NAME}.wav")
    bar = "bar:length=0.3,width=0.03,thickness=0.005 --material steel --band 20,2000 -o"
    for words in (
        [*f"analyze {bar}".split(), f"2{model}"],
        ["info", model, "--all"],
        ["render", model, "--strike", "end", "--seconds", "0.01", "-o", f"2{NAME}.wav"],
        ["export", model, "--contacts", "0.02", "--listeners", "1,0,0", "-o", f"{NAME}.sofa"],
        ["export", model, "-o", f"{NAME}.vtu"],
    ):
        assert main(words) == 0
        printed = capsys.readouterr()
        require_clean(printed.out)
        require_clean(printed.err)
        lines[words[0]] = printed.out.splitlines()
        assert not [line for line in lines[words[0]] if line.startswith("struck: c")]
    assert lines["analyze"][-1] == f"wrote 2{printable(NAME)}.struck"
    assert lines["render"][-1].startswith(f"wrote 2{printable(NAME)}.wav (0.01 s")
    assert any(printable(NAME) in line for line in lines["info"])


def positionals() -> list[str]:
    """Return the commands that read a file, or several."""
    chosen = []
    for name in COMMANDS:
        parser = Parser(prog="struck")
        one = parser.add_subparsers().add_parser(name)
        declare(one, name)
        actions = [each for each in one._actions if not each.option_strings]
        chosen += [name] if any(isinstance(each, argparse.Action) for each in actions) else []
    return chosen


@pytest.mark.parametrize("name", positionals())
@pytest.mark.usefixtures("folder")
def test_an_error_is_one_line(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    more = {
        "analyze": ["--material", "steel"],
        "analyze-many": ["--material", "steel", "-o", "models"],
        "radiate": ["-o", "made.struck"],
        "export": ["--contacts", "0.02", "--listeners", "1,0,0"],
        "tune": [*["--material", "steel", "--vary", "length", "--lowest", "400"]],
        "compare": ["other.wav"],
        "calibrate": ["tap.wav"],
        "explore": ["--no-browser"],
    }
    assert main([name, f"{HOSTILE}.struck", *more.get(name, [])]) == 2
    printed = capsys.readouterr()
    assert not printed.out
    require_clean(printed.err, lines=1)
    assert printed.err.startswith("struck: ")


@pytest.mark.parametrize("words", [[HOSTILE], ["info", f"--{HOSTILE}"], ["render", "a", HOSTILE]])
def test_an_error_of_the_words_is_one_line(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words) == 2
    require_clean(capsys.readouterr().err, lines=1)


def test_progress_and_tables_are_escaped(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    complain(HOSTILE)
    monkeypatch.setattr("struck.model.provenance._FIRST_DELAY", 0.0)
    TerminalProgress()(HOSTILE, 0.5)
    require_clean(capsys.readouterr().err, lines=2)
    assert len(aligned([[HOSTILE, "b"], ["c", "d"]])) == 2


def test_letters_that_an_encoding_lacks_are_escaped(monkeypatch: pytest.MonkeyPatch) -> None:
    data = io.BytesIO()
    monkeypatch.setattr(sys, "stdout", io.TextIOWrapper(data, encoding="ascii"))
    assert main(["analyze", "--list"]) == 0
    monkeypatch.setattr("struck.cli.struck.__version__", "1\N{BELL}")
    assert main(["--version"]) == 0
    sys.stdout.flush()
    assert data.getvalue().endswith(b"struck 1\\U0001f514\n")


@pytest.mark.parametrize(
    ("words", "ending"),
    [
        ("analyze bar:length=0.3,width=0.03,thickness=0.005 --material steel -o", "struck"),
        ("render bar.struck -o", "wav"),
        ("show bar.struck -o", "png"),
        ("export bar.struck -o", "sofa"),
        ("sound-map bar.struck -o", "png"),
        ("compare bar.struck tap.wav -o", "html"),
    ],
)
@pytest.mark.usefixtures("folder")
def test_no_name_and_that_of_a_folder_are_no_files(
    words: str, ending: str, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, why in (("", "empty"), (f"o.{ending}/", "the name of a folder")):
        assert main([*words.split(), name]) == 2
        assert why in capsys.readouterr().err
    assert not list(Path().iterdir())


@pytest.mark.parametrize("name", ["", "o.wav/"])
@pytest.mark.usefixtures("folder")
def test_a_sound_needs_the_name_of_a_file(name: str) -> None:
    sound = struck.Sound(samples=np.ones((1, 9), np.float32), sample_rate=8000)
    with pytest.raises(struck.errors.StruckError, match=r"empty|a folder|no ending"):
        sound.save(name)
    assert not list(Path().iterdir())


@pytest.mark.parametrize("words", ["explore --no-browser --objects ,", "demo --pieces string,,bar"])
@pytest.mark.usefixtures("folder")
def test_missing_names_of_a_list_are_refused(
    words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words.split()) == 2
    assert "give names with commas between" in capsys.readouterr().err

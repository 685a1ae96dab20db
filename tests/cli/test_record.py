"""`struck record` from the shell, against simulated and dummy devices."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest

from struck.cli import Parser, Result, declare
from struck.cli.record import Terminal
from struck.errors import FileFormatError, OptionError, RecordingError
from struck.live import device as binding
from struck.model.provenance import TerminalProgress
from struck.recordings.manifest import read_manifest
from tests.recordings.hits import LEAD_IN, SECONDS, hit, write


def parser() -> Parser:
    whole = Parser(prog="struck")
    declare(whole.add_subparsers().add_parser("record"), "record")
    return whole


def struck_record(*arguments: object) -> Result:
    options = parser().parse_args(["record", *map(str, arguments)])
    return options.run(options, TerminalProgress())


@pytest.fixture
def plan(tmp_path: Path) -> Path:
    """Return a plan of two takes, with a folder `simulated` of files for it."""
    path = tmp_path / "mug.toml"
    path.write_text(f"seconds = {SECONDS}\nlead_in = {LEAD_IN}\ncontacts = [[1.0], [0.5]]\n")
    (tmp_path / "simulated").mkdir()
    for number in (1, 2):
        write(tmp_path / "simulated" / f"contact{number}_1.wav", hit(seed=number))
    return path


def test_takes_and_manifest_are_written_beside_the_plan(
    plan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    simulated = plan.parent / "simulated"
    result = struck_record(plan, "--simulate", simulated)
    manifest = plan.parent / "mug_takes" / "manifest.toml"
    assert result.lines == ["recorded 2 of 2 takes", f"wrote {manifest}"]
    assert read_manifest(manifest).contacts.tolist() == [[1.0], [0.5]]
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.splitlines() == [
        "contact1, hit 1 of 1: contact 1.0",
        "strike now",
        "contact2, hit 1 of 1: contact 0.5",
        "strike now",
    ]
    again = struck_record(plan, "--simulate", simulated)
    assert again.lines[0].startswith("recorded 0 of 2 takes (2 were there)")


def test_json_output_counts_recorded_earlier_and_refused_takes(plan: Path) -> None:
    simulated, takes = plan.parent / "simulated", plan.parent / "takes"
    write(simulated / "contact2_1.wav", np.clip(3 * hit(), -1, 1))
    write(simulated / "contact2_1.2.wav", hit())
    result = struck_record(plan, "-o", takes, "--simulate", simulated, "--json")
    assert "2 of 2 takes, 1 refused" in result.lines[0]
    facts = json.loads(json.dumps(result.facts))
    [refusal] = facts.pop("refusals")
    assert facts == {
        "manifest": str(takes / "manifest.toml"),
        "planned": 2,
        "recorded": 2,
        "earlier": 0,
    }
    assert (refusal["file"], refusal["attempt"]) == ("contact2_1.wav", 1)
    assert "clipped" in refusal["reason"]


def test_bad_input_is_named(plan: Path) -> None:
    with pytest.raises(OptionError, match="nothing to record: give a plan"):
        struck_record()
    with pytest.raises(FileFormatError, match=r"none\.toml is missing"):
        struck_record(plan.with_name("none.toml"))
    with pytest.raises(RecordingError, match=r"files called contact1_1\.wav, contact2_1\.wav$"):
        struck_record(plan, "--simulate", plan.parent)
    (plan.parent / "simulated" / "contact2_1.wav").unlink()
    with pytest.raises(RecordingError, match=r"contact2_1\.wav is missing"):
        struck_record(plan, "--simulate", plan.parent / "simulated")


def test_without_portaudio_it_says_what_to_install(
    plan: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(binding, "_candidates", lambda: iter(()))
    with pytest.raises(ImportError, match="apt install libportaudio2"):
        struck_record(plan)


def test_help_has_an_example(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        parser().parse_args(["record", "--help"])
    assert ended.value.code == 0
    assert "struck record plan.toml -o takes" in capsys.readouterr().out


def test_a_person_presses_enter_and_nobody_does_not(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("sys.stdin", io.StringIO("\n"))
    person = Terminal(TerminalProgress(), waits=True)
    person.ready("rim, hit 1 of 1")
    assert "rim, hit 1 of 1\n  press Enter" in capsys.readouterr().err
    with pytest.raises(RecordingError, match="Enter was not pressed"):
        person.ready("rim, hit 2 of 2")

"""`struck play` from the shell."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path

import pytest

import struck
from struck.cli import main
from struck.live import device as binding
from struck.live.keys import places_by_key
from tests.live.hand import ball


@pytest.fixture
def model(tmp_path: Path) -> str:
    path = tmp_path / "ball.struck"
    struck.save(ball(), path)
    return str(path)


def test_every_named_place_and_many_vertices_have_a_key() -> None:
    model = ball()
    places = places_by_key(model)
    assert places[" "] is None
    assert (places["1"], places["2"]) == ("top", "side")
    assert len(places) == 1 + 2 + 25
    assert "q" not in places
    for place in places.values():
        model.contact(place)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ([], "nothing to play"),
        (["missing.struck"], "missing.struck"),
        (["--seconds", "-1"], "--seconds is -1.0"),
        (["--scrapes", "-1"], "--scrapes is -1"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_two(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["play", *arguments]) == 2
    told = capsys.readouterr().err
    assert words in told
    assert told.count("\n") == 1


def test_without_portaudio_it_says_what_to_install(
    model: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(binding, "_candidates", lambda: iter(()))
    assert main(["play", model]) == 2
    told = capsys.readouterr().err
    assert "apt install libportaudio2" in told
    assert "struck render" in told
    assert told.count("\n") == 1


@pytest.mark.usefixtures("jack")
def test_devices_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["play", "--list-devices"]) == 0
    assert "JACK" in capsys.readouterr().out


@pytest.mark.usefixtures("jack")
@pytest.mark.parametrize(
    "ears",
    [
        pytest.param((), id="one ear"),
        pytest.param(("--hrtf", "kemar"), marks=pytest.mark.prove, id="kemar"),
    ],
)
def test_it_plays_without_a_terminal_and_tells_how_it_went(
    model: str, ears: tuple[str, ...], capsys: pytest.CaptureFixture[str]
) -> None:
    given = ["--seconds", "1", "--strikes-per-second", "50", "--scrapes", "1", "--json", *ears]
    assert main(["play", model, *given]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["modes"] == 40
    assert 20 <= told["strikes"] <= 60
    assert told["peak"] > 0.01
    assert told["underflows"] >= 0
    assert told["late"] >= 0


@pytest.mark.usefixtures("jack")
def test_a_budget_of_modes_is_told(model: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["play", model, "--seconds", "0.1", "--modes", "12"]) == 0
    told = capsys.readouterr().out
    assert told.startswith("28 of 40 modes are beyond the number asked for, which changes no")
    assert "12 modes" in told
    with struck.play(struck.load(model), modes=12) as player:
        assert player.notes == (told.splitlines()[0],)


@pytest.mark.usefixtures("jack")
def test_a_device_that_does_not_exist_is_refused(
    model: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["play", model, "--device", "nobody"]) == 2
    assert "no audio device is named like 'nobody'" in capsys.readouterr().err


@pytest.mark.skipif(sys.platform == "win32", reason="a terminal of POSIX")
@pytest.mark.usefixtures("jack")
def test_typed_keys_strike_and_q_ends(
    model: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import pty

    ours, theirs = pty.openpty()
    with os.fdopen(theirs) as terminal:
        monkeypatch.setattr(sys, "stdin", terminal)
        os.write(ours, b" 12aX!q")
        assert main(["play", model, "--json", "--seconds", "20"]) == 0
    os.close(ours)
    assert json.loads(capsys.readouterr().out)["strikes"] == 5

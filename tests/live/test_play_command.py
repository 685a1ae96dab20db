"""`struck play` from the shell."""

from __future__ import annotations

import json
import os
import sys
import time
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest

import struck
from struck.cli import main
from struck.live import device as binding
from struck.live.keys import places_by_key, terminal_keys
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


@pytest.mark.usefixtures("jack")
@pytest.mark.parametrize(
    ("typed", "more", "strikes", "most"),
    [
        (b" 12q" + b" " * 9, (), 3, 1.5),  # what follows q is not played
        (b" 12", (), 3, 4.0),  # the end of the input, once the last strike was heard
        (b"", (), 0, 1.5),
        (b"", ("--seconds", "0.4", "--scrapes", "1"), 0, 1.5),  # a robot goes on
    ],
)
@pytest.mark.parametrize("kind", ["pipe", "file"])
def test_piped_keys_strike_and_q_or_their_end_ends(
    model: str,
    tmp_path: Path,
    typed: bytes,
    more: tuple[str, ...],
    strikes: int,
    most: float,
    kind: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    if kind == "pipe":
        theirs, ours = os.pipe()
        os.write(ours, typed)
        os.close(ours)
    else:
        (tmp_path / "keys").write_bytes(typed)
        theirs = os.open(tmp_path / "keys", os.O_RDONLY)
    with os.fdopen(theirs) as keys:
        monkeypatch.setattr(sys, "stdin", keys)
        assert main(["play", model, "--json", *(more or ("--seconds", "20"))]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["strikes"] == strikes
    assert (0.4 if more else 0.0) <= facts["seconds"] < most


@pytest.mark.parametrize(
    ("typed", "plays", "struck_at", "seconds"),
    [
        (b" 1q2", False, [None, "top"], 0.0),
        (b" 1", False, [None, "top"], 0.2),  # the last strike is heard after the end
        (b"", False, [], 0.0),
        (b"", True, [], 0.5),  # a robot strikes until the time is over
    ],
)
def test_the_end_of_piped_keys_ends_what_no_robot_plays(
    typed: bytes,
    plays: bool,  # noqa: FBT001
    struck_at: list[str | None],
    seconds: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    command = import_module("struck.cli.play")
    monkeypatch.setattr(command, "_RING", 0.2)
    theirs, ours = os.pipe()
    os.write(ours, typed)
    os.close(ours)
    places: list[str | None] = []

    def strike(at: str | None) -> None:
        places.append(at)

    player = SimpleNamespace(active=True, strike=strike)
    robot = SimpleNamespace(plays=plays, go_on=lambda: None)
    begun = time.monotonic()
    with os.fdopen(theirs) as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        monkeypatch.setattr(command, "_line", lambda _player: "")
        with terminal_keys() as keys:
            until = begun + (seconds if plays else 20.0)  # far off: a busy machine may stall
            count = command._loop(player, keys, {" ": None, "1": "top"}, robot, until)
    assert count == len(struck_at)
    assert places == struck_at
    assert seconds <= time.monotonic() - begun < seconds + 5.0


def test_a_null_device_is_no_end_of_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    with Path(os.devnull).open() as nothing:
        monkeypatch.setattr(sys, "stdin", nothing)
        with terminal_keys() as keys:
            assert (keys.pressed(0.01), keys.ended) == ("", False)

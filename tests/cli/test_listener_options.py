"""Ears and rooms as the shell takes them."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pytest

from struck.cli import Parser
from struck.cli.options import add_listener, add_room, listener, room
from struck.ears.listeners import Binaural, Mono, Stereo
from struck.errors import FileFormatError, OptionError


def parsed(*words: str) -> argparse.Namespace:
    parser = Parser()
    add_listener(parser)
    add_room(parser)
    return parser.parse_args(words)


def test_a_bare_position_stays_one() -> None:
    assert listener(parsed("--listener", "1,2,3")) == (1, 2, 3)
    assert listener(parsed()) is None


def test_heads_are_taken_by_name_and_by_file() -> None:
    words = ("--listener", "0,2,0", "--facing", "1,0,0")
    assert listener(parsed(*words, "--hrtf", "kemar")) == Binaural(
        position=(0, 2, 0), facing=(1, 0, 0)
    )
    assert listener(parsed(*words, "--head", "woodworth")) == Stereo(
        position=(0, 2, 0), facing=(1, 0, 0), head="woodworth"
    )


def test_a_room_has_walls_and_a_reverberation() -> None:
    given = room(parsed("--room", "5,4,3", "--walls", "wood", "--reverberation", "0.8"))
    assert given is not None
    assert given.walls == "wood"
    assert given.reverberation is not None
    np.testing.assert_allclose(given.reverberation.volume, 60.0)
    assert room(parsed()) is None


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--hrtf", "kemar", "--head", "exact"), "two heads"),
        (("--facing", "1,0,0"), "--facing needs two ears"),
        (("--head", "round"), "head is 'round'"),
    ],
)
def test_what_makes_no_listener_is_refused(words: tuple[str, ...], message: str) -> None:
    with pytest.raises(OptionError, match=message):
        listener(parsed(*words))


def test_a_reverberation_without_a_room_is_refused() -> None:
    with pytest.raises(OptionError, match=r"--reverberation 1\.0 needs a room"):
        room(parsed("--reverberation", "1"))


def test_somebody_walks_by_a_file(tmp_path: Path) -> None:
    path = tmp_path / "walk.csv"
    path.write_text("0,1,0,0\n1.5,0,1,0\n\n3,-1,0,0\n")
    found = listener(parsed("--walk", str(path)))
    assert isinstance(found, Mono)
    times, places = found.position
    assert times.tolist() == [0, 1.5, 3]
    assert places.tolist() == [[1, 0, 0], [0, 1, 0], [-1, 0, 0]]
    assert isinstance(listener(parsed("--walk", str(path), "--head", "exact")), Stereo)
    with pytest.raises(OptionError, match="two places"):
        listener(parsed("--walk", str(path), "--listener", "1,0,0"))


@pytest.mark.parametrize("text", ["0,1,0", "time,x,y,z\n0,1,0,0", "0,1,0,0\n1,2"])
def test_a_file_that_is_no_walk_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "walk.csv").write_text(text)
    with pytest.raises(FileFormatError, match="four numbers"):
        listener(parsed("--walk", str(tmp_path / "walk.csv")))

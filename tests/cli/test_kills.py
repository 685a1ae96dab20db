"""Kills at any moment of the commands that write: old files or new ones, and work that resumes."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import trimesh

import struck
from tests.commands import write_inputs

pytestmark = [
    pytest.mark.prove,
    pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGKILL"),
]
COUNT = 50  # kills of each command: 300 in all
SCENE = """<mujoco><option timestep="0.002"/><worldbody>
<geom name="floor" type="plane" size="1 1 .1"/>
<body name="block" pos="0 0 .1"><freejoint/><geom type="box" size=".05 .03 .01"/></body>
</worldbody></mujoco>"""
QUICK = "--material steel --accuracy preview"


@dataclass(frozen=True, kw_only=True)
class Command:
    """A command, what it writes, and how the content of each file is read."""

    words: str
    longest: float  # about how long it takes, s
    files: Mapping[str, Callable[[Path], bytes]]  # by pattern


def model_of(path: Path) -> bytes:
    struck.load(path)
    return path.read_bytes()


def sound_of(path: Path) -> bytes:
    struck.Sound.load(path)
    return path.read_bytes()


def gains_of(path: Path) -> bytes:
    """Return numbers of a SOFA file, whose bytes hold the time at which it was written."""
    model = struck.load(path)
    contact = model.contact(None)
    return model.gains.at(contact.point[None], contact.direction[None]).tobytes()


COMMANDS = {
    "analyze": Command(
        words=f"analyze ball.stl {QUICK} -o out/ball.struck",
        longest=3.0,
        files={"out/*.struck": model_of},
    ),
    "fit": Command(
        words="fit tap.wav -o out/tap.struck", longest=2.5, files={"out/*.struck": model_of}
    ),
    "analyze-many": Command(
        words=f"analyze-many ball.stl box.stl {QUICK} --strikes 2 --seconds 0.1 -o out",
        longest=6.0,
        files={"out/**/*.struck": model_of, "out/**/*.wav": sound_of},
    ),
    "render": Command(
        words="render bar.struck --strike 0.02 --seconds 30 -o out/bar.flac",
        longest=1.5,
        files={"out/*.flac": sound_of},
    ),
    "export": Command(
        words="export bar.struck --contacts 0.02 --listeners 1,0,0 -o out/bar.sofa",
        longest=1.5,
        files={"out/*.sofa": gains_of},
    ),
    "simulate": Command(
        words=f"simulate scene.xml {QUICK.replace('material ', 'material block=')} --seconds 0.5 "
        "-o out/scene.wav",
        longest=4.0,
        files={"out/*.wav": sound_of},
    ),
}


def make_folder(folder: Path) -> Path:
    """Make a folder with a model, a recording, two meshes and a scene, and return it."""
    folder.mkdir()
    write_inputs(folder)
    trimesh.creation.box((0.1, 0.05, 0.01)).export(folder / "box.stl")
    (folder / "scene.xml").write_text(SCENE, encoding="utf-8")
    (folder / "out").mkdir()
    return folder


def start(folder: Path, words: str, cache: str) -> subprocess.Popen[bytes]:
    """Start a command in a session of its own, with a cache."""
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "struck", *words.split(), "--quiet"],
        cwd=folder,
        env={**os.environ, "STRUCK_CACHE": cache},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        start_new_session=True,
    )


def written(folder: Path, command: Command) -> dict[str, bytes]:
    """Return the files of a command, each read as what it is."""
    contents = {}
    for pattern, read in command.files.items():
        for path in folder.glob(pattern):
            contents[path.relative_to(folder).as_posix()] = read(path)
    return contents


@pytest.mark.parametrize("name", COMMANDS)
def test_files_are_old_or_new_and_work_resumes(name: str, tmp_path: Path) -> None:
    command = COMMANDS[name]
    whole, folder = make_folder(tmp_path / "whole"), make_folder(tmp_path / "killed")
    process = start(whole, command.words, "off")
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors.decode()
    expected = written(whole, command)
    assert expected
    chance = np.random.default_rng(sorted(COMMANDS).index(name))
    for moment in chance.uniform(0.2, command.longest, COUNT):
        process = start(folder, command.words, str(tmp_path / "cache"))
        time.sleep(float(moment))
        with suppress(ProcessLookupError):  # it has ended by itself
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate(timeout=60)
        contents = written(folder, command)
        assert contents.items() <= expected.items(), (name, moment)
        if contents == expected:  # it was finished: begin again
            for path in contents:
                (folder / path).unlink()
    process = start(folder, command.words, str(tmp_path / "cache"))
    _, errors = process.communicate(timeout=300)
    assert process.returncode == 0, errors.decode()
    assert written(folder, command) == expected
    assert not list(folder.rglob("*.part"))

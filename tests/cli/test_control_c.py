"""Ctrl-C at any moment of any command: one line, 130, and nothing left behind."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from itertools import cycle, islice
from pathlib import Path

import numpy as np
import pytest

from tests.commands import write_inputs

pytestmark = pytest.mark.skipif(os.name == "nt", reason="Windows has no SIGINT for others")
BEGUN = b"."
# What the command `struck` does, which tells that it begins once it looks out for Ctrl-C.
SHELL = (
    "import os, sys; import struck.__main__ as it; first = it._choose_kernels; "
    f"it._choose_kernels = lambda: (os.write(1, {BEGUN!r}), first()); sys.exit(it.main())"
)
STRING = "string:length=0.65,radius=2e-4,tension=60 --material steel"
CHIME = "tube:length=0.5,radius=0.0125,wall=0.001 --material aluminium"
_SPAN = 0.75  # of a command's time, within which it is interrupted: quick machines take less
# About how long each takes, s, and its words.
COMMANDS = [
    (0.3, "materials"),
    (0.4, "info bar.struck"),
    (0.6, "render bar.struck --strike 0.02 --seconds 60 -o made.wav"),
    (1.2, "show bar.struck -o made.png"),
    (1.5, "sound-map bar.struck --threshold 6 -o made.png"),
    (0.6, f"analyze {STRING} -o made.struck"),
    (2.5, "analyze ball.stl --material steel --accuracy preview -o made.struck"),
    (1.5, "fit tap.wav -o made.struck"),
    (2.0, "compare bar.struck tap.wav"),
    (1.5, "calibrate bar.struck tap.wav"),
    (0.6, "export bar.struck --contacts 0.02 --listeners 1,0,0 -o made.sofa"),
    (1.8, f"tune {CHIME} --vary length --lowest 587.33 --accuracy preview"),
    (0.3, "cache"),
]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a model, a recording of it and a mesh."""
    return write_inputs(tmp_path_factory.mktemp("interrupted"))


def interrupted(folder: Path, words: str, moment: float) -> tuple[int, str]:
    """Press Ctrl-C so long after a command's first line; return its exit code and what it said."""
    before = sorted(folder.iterdir())
    process = subprocess.Popen(
        [sys.executable, "-c", SHELL, *words.split()],
        cwd=folder,
        env={**os.environ, "STRUCK_CACHE": "off"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )
    assert process.stdout is not None
    assert process.stdout.read(1) == BEGUN
    time.sleep(moment)
    asked = time.perf_counter()
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=60)
    if process.returncode == 0:  # it was finished before
        for path in set(folder.iterdir()) - set(before):
            path.unlink()
    else:
        assert time.perf_counter() - asked < 20  # 5 s of an idle machine
    assert sorted(folder.iterdir()) == before
    return process.returncode, said.decode()


def moments(count: int, seed: int, latest: float) -> Iterator[tuple[str, float]]:
    """Yield commands in turn, each with a moment of its course by chance."""
    chance = np.random.default_rng(seed)
    for longest, words in islice(cycle(COMMANDS), count):
        yield words, float(chance.uniform(0, min(_SPAN * longest, latest)))


def require_interruptions(folder: Path, count: int, seed: int, latest: float = 60.0) -> None:
    codes = []
    for words, moment in moments(count, seed, latest):
        code, said = interrupted(folder, words, moment)
        codes.append(code)
        assert code in {0, 130}, (words, moment, said)
        last = said.splitlines()[-1:]  # after lines of progress
        assert code == 0 or last == ["struck: interrupted"], (words, moment, said)
        assert "Traceback" not in said, (words, moment, said)
    assert codes.count(130) > 0.6 * count  # else the moments are too late to tell anything


@pytest.mark.parametrize(
    "count", [len(COMMANDS), pytest.param(40, marks=pytest.mark.prove, id="forty")]
)
def test_early_moments(folder: Path, count: int) -> None:
    """Most of them while modules load."""
    require_interruptions(folder, count, 1, latest=0.3)


WAITING = """
import signal, time
from struck.__main__ import Interruption

class ExtensionFileLoader:
    loaded = "in part"

    def exec_module(self):
        signal.raise_signal(signal.SIGINT)
        time.sleep(0.05)
        self.loaded = "whole"

Interruption()
loader = ExtensionFileLoader()
try:
    loader.exec_module()
    time.sleep(20)
except KeyboardInterrupt:
    print(loader.loaded, "interrupted", sep="\\n")
"""


def test_a_compiled_module_is_loaded_whole_before() -> None:
    """nanobind ends the process (SIGABRT) where Python raises while its modules load."""
    done = subprocess.run(
        [sys.executable, "-c", WAITING], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stdout.split() == ["whole", "interrupted"]


FINALIZING = """
import signal, time
from struck.__main__ import Interruption

class Finalized:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)

Interruption()
try:
    thing = Finalized()
    del thing
    time.sleep(20)
except KeyboardInterrupt:
    print("interrupted")
"""


def test_what_comes_amid_a_finalizer_comes_again() -> None:
    """Python drops what a finalizer raises, and says so on standard error."""
    done = subprocess.run(
        [sys.executable, "-c", FINALIZING], capture_output=True, text=True, timeout=60, check=True
    )
    assert (done.stdout, done.stderr) == ("interrupted\n", "")


@pytest.mark.prove
@pytest.mark.parametrize("seed", range(2, 7))
def test_moments_of_every_command(folder: Path, seed: int) -> None:
    """Four of each command; with the forty early ones 300 in all."""
    require_interruptions(folder, 4 * len(COMMANDS), seed)

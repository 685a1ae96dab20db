"""Commands in a limited address space: a result, or one line that says what is short."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import trimesh

import struck
from struck.cli import COMMANDS, memory_limit
from struck.errors import MissingDependencyError
from tests.commands import write_inputs

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="Linux alone limits address space")
MIB = 2**20
CHIME = "tube:length=0.5,radius=0.0125,wall=0.001 --material aluminium"
QUICK = "--material steel --accuracy preview"
# Sets the limit, and does then what the command `struck` does.
SHELL = """
import resource, sys
limit = int(sys.argv.pop(1))
resource.setrlimit(resource.RLIMIT_AS, (limit, limit))
from struck.__main__ import main
sys.exit(main())
"""
WORDS = [
    "analyze string:length=0.65,radius=2e-4,tension=60 --material steel -o made.struck",
    f"analyze ball.stl {QUICK} -o made.struck",
    "analyze box.stl --material steel -o made.struck",
    f"analyze-many ball.stl box.stl {QUICK} -o made",
    "radiate box.struck -o made.struck",
    "info bar.struck",
    "show bar.struck -o made.png",
    "render bar.struck --strike 0.02 --seconds 10 -o made.wav",
    "render bar.struck --strike 0.02 --seconds 900 -o made.flac",
    f"simulate scene.xml {QUICK.replace('material ', 'material block=')} --seconds 0.5 -o made.wav",
    "sound-map bar.struck --threshold 6 -o made.png",
    "play bar.struck --seconds 1",
    "explore bar.struck --no-browser --seconds 1",
    "record plan.toml -o made",
    "fit tap.wav -o made.struck",
    "compare bar.struck tap.wav",
    "calibrate bar.struck tap.wav",
    "export bar.struck --contacts 0.02 --listeners 1,0,0 -o made.sofa",
    f"tune {CHIME} --vary length --lowest 587.33 --accuracy preview",
    "materials",
    "cache",
    "demo --out made --pieces string",
]
# Address space in MiB, of which Python itself takes 20.
LIMITS = (30, 200, 650, 670, 760, 1300)
LEAST = 660
SCENE = """<mujoco><option timestep="0.002"/><worldbody>
<geom name="floor" type="plane" size="1 1 .1"/>
<body name="block" pos="0 0 .1"><freejoint/><geom type="box" size=".05 .03 .01"/></body>
</worldbody></mujoco>"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with models, a recording, meshes and a scene."""
    folder = write_inputs(tmp_path_factory.mktemp("short"))
    trimesh.creation.box((0.1, 0.05, 0.01)).export(folder / "box.stl")
    (folder / "scene.xml").write_text(SCENE, encoding="utf-8")
    (folder / "plan.toml").write_text("seconds = 0.1\n", encoding="utf-8")
    return folder


def limited(folder: Path, words: str, mebibytes: int) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-P", "-c", SHELL, str(mebibytes * MIB), *words.split()],
        cwd=folder,
        env={**os.environ, "STRUCK_CACHE": "off"},
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def test_every_command_is_among_them() -> None:
    assert {words.split()[0] for words in WORDS} == {*COMMANDS}


def require_one_line(folder: Path, words: str, limit: int) -> None:
    """Run a command; it must have a result, or tell in one line why it has none."""
    before = {*folder.iterdir()}
    done = limited(folder, f"{words} --quiet", limit)
    made = {*folder.iterdir()} - before
    for path in made:
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    case = f"{words} in {limit} MiB: {done.returncode}, {done.stderr}"
    assert "Traceback" not in done.stderr, case
    assert (limit < LEAST) == ("struck's libraries need" in done.stderr), case
    if words.startswith("analyze-many") and done.returncode == 3:
        return  # each body has its line in the report
    assert done.returncode in {0, 2}, case
    if done.returncode == 2:
        assert re.fullmatch("struck: .*\n", done.stderr), case
        assert not [path for path in made if path.suffix == ".part"], case


@pytest.mark.parametrize(
    ("number", "limit"), [(1, 700), (6, 80), (8, 670), (-2, 30), (-2, 670), (-3, 670)]
)
def test_a_sample_of_commands(folder: Path, number: int, limit: int) -> None:
    require_one_line(folder, WORDS[number], limit)


@pytest.mark.prove
@pytest.mark.parametrize("words", WORDS)
def test_a_result_or_one_line(folder: Path, words: str) -> None:
    if "box.struck" in words:
        box = struck.solids.Block(size=(0.1, 0.05, 0.01))
        quick = {"accuracy": "preview", "band": (20, 6000), "cache": False, "progress": None}
        struck.save(struck.analyze(box, "steel", **quick), folder / "box.struck")
    for limit in LIMITS:
        require_one_line(folder, words, limit)


def test_machines_read_it_too(folder: Path) -> None:
    done = limited(folder, "materials --json", 100)
    answer = json.loads(done.stdout)
    assert (done.returncode, answer["kind"]) == (2, "MemoryError")
    assert "640 MiB: raise the limit" in answer["error"]


BUFFERS = """
import resource
from struck.cli import memory_limit
from struck.processes.address_space import free_address_space

def limit(free):
    used = 1024 * int(open("/proc/self/status").read().partition("VmSize:")[2].split()[0])
    resource.setrlimit(resource.RLIMIT_AS, (used + free, resource.RLIM_INFINITY))

limit(800 * 2**20)
assert memory_limit.prepare() == ""
import numpy as np
from scipy import linalg

matrix = np.ones((200, 200))
copies = [np.empty((200, 200)) for _ in range(8)]
limit(2**20)
np.matmul(matrix, matrix, out=copies[0])
linalg.blas.dgemm(1.0, matrix.T, matrix.T, c=copies[1].T, overwrite_c=True)
print("done", free_address_space() < 2**21)
"""


def test_buffers_of_openblas_are_there_before() -> None:
    """Without one OpenBLAS ends the process: no Python is asked."""
    command = [sys.executable, "-c", BUFFERS]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.stdout, done.stderr) == ("done True\n", "")


def test_what_libraries_make_of_a_shortage_is_known() -> None:
    assert memory_limit.is_shortage(MemoryError())
    assert memory_limit.is_shortage(OSError(12, "Cannot allocate memory"))
    assert memory_limit.is_shortage(RuntimeError("can't start new thread"))
    assert memory_limit.is_shortage(ImportError("a.so: failed to map segment from shared object"))
    error = MissingDependencyError("needs it")
    error.__cause__ = MemoryError()
    assert memory_limit.is_shortage(error)
    for other in (RuntimeError("a fault"), OSError(2, "No such file"), ImportError("no module a")):
        assert not memory_limit.is_shortage(other)


def test_the_way_out_names_the_limit_where_there_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_limit, "free_address_space", lambda: 5)
    text = memory_limit.explain(MemoryError("Unable to allocate 3 GiB."))
    assert text.startswith("memory is short (Unable to allocate 3 GiB): choose")
    assert text.endswith("raise the limit by ulimit -v")
    monkeypatch.setattr(memory_limit, "free_address_space", lambda: None)
    assert memory_limit.explain(MemoryError()).endswith("a machine with more memory")

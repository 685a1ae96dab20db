"""Every command in a folder of files named like modules, and with settings of matplotlib."""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import numpy as np
import pytest
import trimesh

import struck
from struck.cli import COMMANDS, Parser, _declare_commands
from struck.core.build import compiler
from tests.explorer.served import Client, patience
from tests.recordings.hits import LEAD_IN, SECONDS, hit, write

PACKAGE = Path(struck.__file__).parent
SCRIPT = Path(sys.executable).with_name("struck.exe" if os.name == "nt" else "struck")
HOSTILE_STYLE = b"""\
text.usetex: True
backend: nonsense
figure.figsize: 90, 90
savefig.dpi: 1
savefig.bbox: tight
font.size: 90
axes.facecolor: red
lines.linewidth: 40
no colon here
"""
BAR = "bar:length=0.3,width=0.03,thickness=0.005"
SCENE = """<mujoco><option timestep="0.001"/><worldbody>
<geom name="shelf" type="box" size=".05 .04 .006" pos="0 0 -.006"/>
<body name="tile" pos="0 0 .06" euler="30 20 0"><freejoint/>
<geom type="box" size=".05 .04 .006"/></body></worldbody></mujoco>"""


@dataclass(frozen=True)
class Case:
    """Words of a command, and the files that it makes."""

    words: str
    files: tuple[str, ...] = ()
    code: int = 0
    default: bool = False  # whether each run of the tests has it


CASES: Mapping[str, Case] = {
    "analyze": Case(
        "ball.stl --material steel --accuracy preview -o made.struck",
        ("made.struck",),
    ),
    "analyze-many": Case(
        "ball.stl --material steel --accuracy preview -o models --processes 1",
        ("models/ball.struck", "models/report.html"),
    ),
    "radiate": Case("bar.struck --band 20,1000 -o made.struck", ("made.struck",)),
    "info": Case("ball.stl", default=True),  # which another process reads
    "show": Case("bar.struck -o made.png", ("made.png",)),  # see the picture of a clean folder
    "render": Case("bar.struck --strike end -o made.wav", ("made.wav",), default=True),
    "simulate": Case(
        "scene.xml --seconds 0.2 --ring 0.1 --accuracy preview --restitution 0.5 "
        "--material tile=steel --material shelf=steel -o made.wav",
        ("made.wav", "made.npz"),
    ),
    "sound-map": Case("bar.struck --threshold 6 -o made.png", ("made.png",)),
    "play": Case("bar.struck --seconds 0.2 --device none", code=2),
    "explore": Case("--objects string --no-browser"),
    "record": Case("plan.toml -o made --simulate takes", ("made/manifest.toml",)),
    "fit": Case("tap.wav -o made.struck --report made.html", ("made.struck", "made.html")),
    "compare": Case("bar.struck tap.wav -o made.html", ("made.html",)),
    "calibrate": Case("bar.struck tap.wav"),
    "export": Case("bar.struck --contacts 0.02 --listeners 1,0,0 -o made.sofa", ("made.sofa",)),
    "tune": Case(
        "tube:length=0.5,radius=0.0125,wall=0.001 --material aluminium --vary length "
        "--lowest 587.33 --accuracy preview"
    ),
    "materials": Case("", default=True),
    "cache": Case("", default=True),
    "demo": Case("--out made --pieces string", ("made/index.html", "made/string.png")),
}


def commands() -> set[str]:
    """Return the commands that the parser of the shell knows."""
    parser = Parser(prog="struck")
    _declare_commands(parser, None)
    (several,) = (each for each in parser._actions if isinstance(each, argparse._SubParsersAction))
    return set(several.choices)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with what the commands read, and the picture of a model."""
    folder = tmp_path_factory.mktemp("inputs")
    bar = struck.analyze(struck.shapes.Bar(length=0.3, width=0.03, thickness=0.005), "steel")
    struck.save(bar, folder / "bar.struck")
    struck.show(bar, folder / "bar.png")
    sound = struck.render(bar, struck.Strike(at=(0.02,), time=0.5), seconds=1.5)
    noise = 1e-5 * np.random.default_rng(0).standard_normal(sound.samples.shape)
    write(folder / "tap.wav", 0.5 * sound.samples / sound.peak + noise, 48_000)
    trimesh.creation.icosphere(subdivisions=1, radius=0.08).export(folder / "ball.stl")
    (folder / "scene.xml").write_text(SCENE)
    (folder / "takes").mkdir()
    (folder / "plan.toml").write_text(
        f"seconds = {SECONDS}\nlead_in = {LEAD_IN}\ncontacts = [[1.0]]\n"
    )
    write(folder / "takes/contact1_1.wav", hit(seed=1))
    return folder


@cache
def module_names() -> list[str]:
    """Return names of modules: those that Python and its start look for, and all installed."""
    names = {"struck", "sitecustomize", "usercustomize"}
    names |= {
        name for name in {*sys.stdlib_module_names, *packages_distributions()} if name[0] != "_"
    }
    return sorted(name for name in names if name.isidentifier())


def hostile(folder: Path, inputs: Path, style: bytes) -> Path:
    """Fill a folder with the inputs, with modules that say they ran, and settings."""
    shutil.copytree(inputs, folder)
    for number, name in enumerate(module_names()):
        place = folder / f"{name}.py"
        if number % 3 == 0 or name == "struck":
            (folder / name).mkdir()
            place = folder / name / "__init__.py"
        place.write_text(f"open({str(folder.parent / f'ran {name}')!r}, 'w').close()\n")
    (folder / "matplotlibrc").write_bytes(style)
    return folder


def environment(scratch: Path) -> dict[str, str]:
    """Return the variables of a person who has set none for Python or matplotlib."""
    scratch.mkdir(exist_ok=True)
    unset = re.compile("(?!PYTHONPATH$)(PYTHON|MPL)")  # by that one a changed copy is tested
    kept = {name: value for name, value in os.environ.items() if not unset.match(name)}
    return {**kept, "STRUCK_CACHE": "off", "TMPDIR": str(scratch)}


def run(name: str, folder: Path) -> tuple[int, str]:
    """Run the command of that name; return its exit code and its standard error."""
    words = [str(SCRIPT), name, *CASES[name].words.split()]
    variables = environment(folder.parent / "scratch")
    if name == "explore":
        return explored(words, folder, variables)
    done = subprocess.run(
        words, cwd=folder, env=variables, capture_output=True, text=True, timeout=600, check=False
    )
    return done.returncode, done.stderr


def explored(words: list[str], folder: Path, variables: dict[str, str]) -> tuple[int, str]:
    """Open the room until its object is there, and end it by Ctrl-C."""
    limit = time.monotonic() + 60 * patience()
    with subprocess.Popen(
        words,
        cwd=folder,
        env=variables,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        assert process.stderr is not None
        client = Client(process.stderr.readline().strip())
        client.enter()
        while True:
            (thing,) = client.ask("GET", "/api/room").json["objects"]
            if thing["state"] in {"ready", "failed"}:
                break
            assert time.monotonic() < limit, thing
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        _, errors = process.communicate(timeout=60)
    assert thing["state"] == "ready", thing
    return process.returncode, errors


def require_as_usual(name: str, folder: Path) -> None:
    """Require what a case says, and that no module of the folder ran."""
    code, errors = run(name, folder)
    assert sorted(path.name for path in folder.parent.glob("ran *")) == []
    assert code == CASES[name].code, errors
    assert "matplotlibrc" not in errors
    missing = [each for each in CASES[name].files if not (folder / each).stat().st_size]
    assert not missing


def test_each_command_has_a_case() -> None:
    assert commands() == set(COMMANDS) == set(CASES)
    assert len(module_names()) > 40


@pytest.mark.parametrize(
    "name",
    [
        name if case.default else pytest.param(name, marks=pytest.mark.prove)
        for name, case in CASES.items()
    ],
)
def test_nothing_in_the_folder_is_imported(name: str, inputs: Path, tmp_path: Path) -> None:
    if name == "simulate":
        pytest.importorskip("mujoco")
    require_as_usual(name, hostile(tmp_path / "hostile", inputs, HOSTILE_STYLE))


@pytest.mark.prove
@pytest.mark.parametrize("style", [HOSTILE_STYLE, b"font.size: \xff\n"])
def test_picture_is_that_of_a_clean_folder(style: bytes, inputs: Path, tmp_path: Path) -> None:
    folder = hostile(tmp_path / "hostile", inputs, style)
    require_as_usual("show", folder)
    assert (folder / "made.png").read_bytes() == (inputs / "bar.png").read_bytes()


@pytest.mark.prove
@pytest.mark.parametrize("name", ["show", "sound-map", "render", "demo", "export", "record"])
def test_files_are_those_of_a_clean_folder(name: str, inputs: Path, tmp_path: Path) -> None:
    clean = tmp_path / "clean/files"
    clean.parent.mkdir()
    shutil.copytree(inputs, clean)
    (tmp_path / "other").mkdir()
    folder = hostile(tmp_path / "other/hostile", inputs, HOSTILE_STYLE)
    assert run(name, clean)[0] == run(name, folder)[0] == 0
    endings = {".png", ".wav"}
    made = [path.relative_to(clean) for path in clean.rglob("made*/**/*")]
    made += [path.relative_to(clean) for path in clean.glob("made*") if path.is_file()]
    assert made
    for path in made:
        one, other = clean / path, folder / path
        assert other.exists(), path
        if path.suffix in endings:
            assert one.read_bytes() == other.read_bytes(), path


def test_only_one_place_starts_python() -> None:
    """And that one, and the compiler which must do without it, pass over the current folder."""
    users = {
        path.relative_to(PACKAGE).as_posix()
        for path in PACKAGE.rglob("*.py")
        if re.search(r"\bexecutable\b|multiprocessing", path.read_text(encoding="utf-8"))
    }
    assert users == {"processes/child_process.py", "core/build.py"}


@pytest.mark.skipif(os.name == "nt", reason="a shell script")
def test_compiler_passes_over_the_folder(tmp_path: Path) -> None:
    folder = tmp_path / "hostile"
    folder.mkdir()
    for name in ("ziglang", "os", "subprocess", "platform"):
        (folder / f"{name}.py").write_text(f"open({str(tmp_path / 'ran')!r}, 'w').close()\n")
    done = subprocess.run(
        [*compiler(), "--version"],
        cwd=folder,
        env=environment(tmp_path / "scratch"),
        capture_output=True,
        text=True,
        check=True,
    )
    assert "clang" in done.stdout
    assert not (tmp_path / "ran").exists()

"""What the documents show runs: Python blocks, shell lines and examples."""

from __future__ import annotations

import os
import re
import runpy
import shlex
import subprocess
import sys
from operator import attrgetter
from pathlib import Path

import pytest
from _pytest.mark import ParameterSet

import struck

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    *sorted(p for p in (ROOT / "docs").rglob("*.md") if "_build" not in p.parts),
]
EXAMPLES = sorted((ROOT / "examples").rglob("*.py"))
GALLERY = "examples/gallery/"
# Each takes seconds, and shows what a test elsewhere samples: make prove runs them.
DEAR = {
    "README.md",
    "docs/how-to/closed_forms.md",
    "docs/how-to/data_sets.md",
    "docs/how-to/fit_recordings.md",
    "docs/how-to/hear_a_simulation.md",
    "docs/how-to/hear_in_space.md",
    "docs/how-to/long_work.md",
    "docs/how-to/many_meshes.md",
    "docs/how-to/modes_of_your_own.md",
    "docs/how-to/play_live.md",
    "docs/how-to/simulate.md",
    "docs/how-to/timbre_fields.md",
    "docs/how-to/touch_a_body.md",
    "docs/how-to/use_a_mesh_file.md",
    "docs/how-to/volume_meshes.md",
    "docs/tutorial/first_sound.md",
    "examples/a_broken_file.py",
    "examples/data_set.py",
    "examples/hollow_figurine.py",
    "examples/model_of_a_recording.py",
    "examples/one_body_many_materials.py",
    "examples/play_a_scene.py",
    "examples/scenes_of_2002.py",
    "examples/sounds_of_shapes.py",
    "examples/touch_a_plate.py",
    "examples/tune_a_chime.py",
    "examples/two_ears.py",
    "examples/vase_of_2007.py",
    "examples/walk_past.py",
    "examples/walk_round_a_bowl.py",
}
SAMPLE = {"examples/gallery/f_pluck_and_release.py"}  # of the gallery, whose pages run all of it
# What each page of the gallery shows: a verb of struck, or something that pushes a body.
SHOWN = {
    *("Binaural", "ForceTrack", "Hold", "Pluck", "Release", "Roll", "Room", "Scrape", "Strike"),
    *("TouchLog", "analyze", "analyze_many", "audible", "calibrated", "capture", "compare"),
    *(
        "energy",
        "explore",
        "fit",
        "load",
        "Player",
        "radiating",
        "render",
        "save",
        "show",
        "simulate",
    ),
    *("sonic_distance", "sound_map", "tune"),
}
BLOCK = re.compile(
    r"^```(?P<kind>python|console)(?P<words>[^\n]*)\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
INSTALLING = {"cd", "git", "make", "pip", "python"}  # lines for a person's own machine


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def in_its_run(path: Path) -> ParameterSet:
    name = name_of(path)
    dear = name in DEAR or (name.startswith(GALLERY) and name not in SAMPLE)
    return pytest.param(path, marks=[pytest.mark.prove] if dear else [], id=name)


def run_python(code: str, namespace: dict[str, object], page: Path, line: int) -> None:
    located = "\n" * line + code  # so that a traceback names the page's own line
    exec(compile(located, str(page), "exec"), namespace)  # noqa: S102 - our own documents


def run_console(code: str) -> None:
    for line in code.splitlines():
        command, *arguments = shlex.split(line.removeprefix("$ ")) if line[:2] == "$ " else [""]
        if not command or command in INSTALLING:
            continue
        assert command == "struck", f"the documents show a command that no test runs: {line}"
        assert run_struck(arguments) == 0, line


def run_struck(arguments: list[str]) -> int:
    from struck.cli import main

    try:
        return main(arguments) or 0
    except SystemExit as end:
        return 0 if end.code is None else int(end.code)


@pytest.fixture(autouse=True)
def as_a_person_works(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Work in an empty folder, with one cache for all pages."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path_factory.getbasetemp()
    shared = folder.parent if "PYTEST_XDIST_WORKER" in os.environ else folder
    monkeypatch.setenv("STRUCK_CACHE", str(shared / "documents"))


def test_python_of_the_readme_runs() -> None:
    """Its shell lines, which show what tests of `cli` sample, run with the other pages."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (block,) = [block for block in BLOCK.finditer(text) if block["kind"] == "python"]
    run_python(block["code"], {"__name__": "__main__"}, ROOT / "README.md", 0)


@pytest.mark.parametrize("page", [in_its_run(page) for page in PAGES])
def test_page(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = page.read_text(encoding="utf-8")
    if "cache --clear" in text:  # not what the others share
        monkeypatch.setenv("STRUCK_CACHE", str(tmp_path / "cache"))
    namespace: dict[str, object] = {"__name__": "__main__"}
    for block in BLOCK.finditer(text):
        assert not block["words"].strip(), f"{name_of(page)}: a block may not opt out of running"
        if block["kind"] == "python":
            run_python(block["code"], namespace, page, text[: block.start("code")].count("\n"))
        else:
            run_console(block["code"])


@pytest.mark.parametrize("example", [in_its_run(each) for each in EXAMPLES])
def test_example(example: Path) -> None:
    runpy.run_path(str(example), run_name="__main__")


def test_gallery_shows_every_verb_and_excitation() -> None:
    text = "\n".join(path.read_text(encoding="utf-8") for path in EXAMPLES if GALLERY in str(path))
    verbs = {name for name in struck.__all__ if name[0].islower()} - {"materials", "play"}
    assert verbs <= SHOWN
    assert {name for name in SHOWN if f"{name}(" in text} == SHOWN


LINK = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")


def test_readme_starts_with_the_two_commands_and_links_every_guide() -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    first_block = text.split("```sh\n")[1].split("```")[0]
    commands = re.findall(r"^make (\w+)", first_block, re.MULTILINE)
    assert commands == ["demo", "test"]
    assert text.index("make test") < text.index("pip install")
    assert all(re.search(rf"^{command}:.* ## ", makefile, re.MULTILINE) for command in commands)
    guides = {name_of(page) for page in (ROOT / "docs/how-to").glob("*.md")}
    pages = {"CONTRIBUTING.md", "docs/explanation/architecture.md", "docs/explanation/trust.md"}
    assert guides | pages <= set(LINK.findall(text))


@pytest.mark.parametrize("page", [pytest.param(page, id=name_of(page)) for page in PAGES])
def test_links_lead_to_files_that_exist(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    links = {link for link in LINK.findall(text) if "://" not in link}
    generated = {"gallery/index"}  # pages that Sphinx makes
    assert not {each for each in links - generated if not (page.parent / each).exists()}


MAX_CHANGELOG_LINES = 60


def test_changelog_is_short_and_names_every_verb() -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= MAX_CHANGELOG_LINES
    names = re.findall(r"`(struck\.[\w.]+)`", text)
    for name in names:
        assert attrgetter(name.removeprefix("struck."))(struck), name
    verbs = {name for name in struck.__all__ if name[0].islower()}
    assert {f"struck.{verb}" for verb in verbs} <= set(names)


OFFLINE = """
import runpy, socket, sys
def refuse(*_): raise OSError("there is no network")
socket.socket.connect = socket.getaddrinfo = refuse
sys.argv = ["sphinx", "-W", "--keep-going", "-q", "-b", "html", "docs", sys.argv[1]]
runpy.run_module("sphinx", run_name="__main__")
"""


@pytest.mark.prove
def test_pages_are_made_without_network_sound_device_or_home(tmp_path: Path) -> None:
    pytest.importorskip("sphinx_gallery")
    done = subprocess.run(
        [sys.executable, "-c", OFFLINE, str(tmp_path / "pages")],
        cwd=ROOT,
        env={**homeless(tmp_path), "STRUCK_CACHE": os.environ["STRUCK_CACHE"]},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    first = (tmp_path / "pages/index.html").read_text(encoding="utf-8")
    played = re.findall(r'src="(_static/sounds/\w+\.wav)"', first)
    assert played
    assert all((tmp_path / "pages" / each).stat().st_size > 10_000 for each in played)
    shown = sorted((tmp_path / "pages/gallery").glob("[a-z]_*.html"))
    assert len(shown) >= 20
    for page in shown:
        text = page.read_text(encoding="utf-8")
        assert "sphx_glr_" in text, page.name  # a picture
        assert "<audio" in text or page.name.startswith("t_"), page.name


def homeless(folder: Path) -> dict[str, str]:
    """Return an environment whose home no folder can be made in, not even by root."""
    (folder / "file").touch()
    nowhere = str(folder / "file/home")
    kept = {name: os.environ[name] for name in ("PATH", "SYSTEMROOT") if name in os.environ}
    return {**kept, "HOME": nowhere, "USERPROFILE": nowhere, "MPLBACKEND": "Agg"}


FIRST_RUN = """
import struck
from struck.shapes import Bar
bar = struck.analyze(Bar(length=0.2, width=0.03, thickness=0.006, ends="free"), "steel")
struck.render(bar, struck.Strike(at="end"), seconds=0.5).save("bar.wav")
struck.save(bar, "bar.struck")
struck.show(bar, "bar.png")
"""
NO_HOME = """
import os, pathlib
def homeless(*_): raise RuntimeError("Could not determine home directory.")
pathlib.Path.home = homeless
"""


@pytest.mark.prove
@pytest.mark.parametrize("home", [pytest.param("read-only", marks=pytest.mark.prove), "none"])
def test_first_run_needs_no_home(home: str, tmp_path: Path) -> None:
    environment = homeless(tmp_path)
    if home == "none":
        del environment["HOME"], environment["USERPROFILE"]
    program = (NO_HOME if home == "none" else "") + FIRST_RUN
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    assert all((tmp_path / f"bar.{ending}").exists() for ending in ("wav", "struck", "png"))
    assert done.stderr.count("CacheWarning") <= 1, done.stderr

"""What the documents show runs: Python blocks, shell lines and examples."""

from __future__ import annotations

import os
import re
import runpy
import shlex
from pathlib import Path

import pytest
from _pytest.mark import ParameterSet

ROOT = Path(__file__).parents[1]
PAGES = [
    ROOT / "README.md",
    *sorted(p for p in (ROOT / "docs").rglob("*.md") if "_build" not in p.parts),
]
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
# Each takes seconds, and shows what a test elsewhere samples: make prove runs them.
DEAR = {
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
BLOCK = re.compile(
    r"^```(?P<kind>python|console)(?P<words>[^\n]*)\n(?P<code>.*?)^```$",
    re.MULTILINE | re.DOTALL,
)
INSTALLING = {"cd", "git", "make", "pip", "python"}  # lines for a person's own machine


def name_of(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def in_its_run(path: Path) -> ParameterSet:
    marks = [pytest.mark.prove] if name_of(path) in DEAR else []
    return pytest.param(path, marks=marks, id=name_of(path))


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

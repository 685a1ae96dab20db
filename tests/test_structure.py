"""The shape of the code: layers, budgets, what an import costs, what no file may name."""

from __future__ import annotations

import ast
import graphlib
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import grimp
import pytest

import struck

ROOT = Path(__file__).parents[1]
SOURCES = sorted((ROOT / "src").rglob("*.py"))

LINES_A_FILE = 750
LINES_A_FUNCTION = 40
PUBLIC_NAMES = 40
# What may exceed its budget and why, by "struck/module.py" or "struck/module.py:function".
EXCEPTIONS: dict[str, str] = {}
# Libraries that are imported by the function that uses them.
HEAVY = {"igl", "matplotlib", "meshio", "numba", "scipy.signal", "trimesh"}
# Paths of one machine, and where packages are fetched from.
FOREIGN = re.compile(
    r"(?<![\w.-])/(?:work|root|home/\w+|tmp/\w+)\b"
    r"|index[-]url|https?:/{2}\S*/simple\b|py[p]i\.org|python[h]osted|registry\.npm[j]s"
)


def name_of(path: Path) -> str:
    return path.relative_to(ROOT / "src").as_posix()


def sizes(path: Path) -> Iterator[tuple[str, int, int]]:
    """Yield name, lines and budget of a file and of each of its functions."""
    text = path.read_text(encoding="utf-8")
    yield name_of(path), len(text.splitlines()), LINES_A_FILE
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield f"{name_of(path)}:{node.name}", lines_of_code(node), LINES_A_FUNCTION


def lines_of_code(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    """Return the lines of a function's body, without signature and docstring."""
    documented = ast.get_docstring(function) is not None
    body = function.body[1:] if documented else function.body
    return (body[-1].end_lineno or 0) - body[0].lineno + 1 if body else 0


def written_files() -> Iterator[Path]:
    folders = ("src", "tests", "docs", "bench", "examples", ".ci")
    inside = (path for folder in folders for path in (ROOT / folder).rglob("*"))
    for path in (*ROOT.iterdir(), *inside):
        generated = {"__pycache__", "_build"} & set(path.parts)
        if path.is_file() and path.name != ".git" and not generated:
            yield path


@pytest.mark.parametrize("path", SOURCES, ids=name_of)
def test_file_and_functions_stay_within_their_budgets(path: Path) -> None:
    excess = {name: lines for name, lines, budget in sizes(path) if lines > budget}
    assert not excess.keys() - EXCEPTIONS.keys(), excess


def test_public_names_are_few_and_exist() -> None:
    assert 0 < len(struck.__all__) <= PUBLIC_NAMES
    assert len(set(struck.__all__)) == len(struck.__all__)
    assert not [name for name in struck.__all__ if not hasattr(struck, name)]


def test_modules_do_not_import_each_other_in_circles() -> None:
    graph = grimp.build_graph("struck", cache_dir=None)
    imports = {module: graph.find_modules_directly_imported_by(module) for module in graph.modules}
    graphlib.TopologicalSorter(imports).prepare()  # raises CycleError, which names the circle


def test_layers_hold() -> None:
    linter = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run(
        [linter, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


def test_import_is_light() -> None:
    program = f"import sys, struck; print(*sorted({HEAVY} & set(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True
    )
    assert not done.stdout.split()


@pytest.mark.parametrize("path", [["", "root", "struck"], ["cd ", "work", "x"], ["'", "tmp", "a"]])
def test_paths_of_a_machine_are_recognised(path: list[str]) -> None:
    assert FOREIGN.search("/".join(path))


def test_no_file_names_a_machine_or_a_registry() -> None:
    texts = {path: path.read_bytes().decode("utf-8", errors="ignore") for path in written_files()}
    found = {path.relative_to(ROOT).as_posix(): FOREIGN.findall(texts[path]) for path in texts}
    assert not {name: hits for name, hits in found.items() if hits}
